"""Have the checker verify what `Evaluator.evaluate_many` says of random states: `make states`.

Half of the states lie along paths, half are drawn at random, of scenes with and without a search
over modes, for both algorithms. Of each that has contacts the solution document is written, with
the forces, the mode and the multipliers that the batch found, and gone through by the checker,
which shares no code with what made it.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from benchmarks.many import drawn, paths

from graspless_pin import Evaluator, load_scene
from graspless_pin.planning import StateStatus
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCENES = ("allegro_box_on_slope", "trihand_push_box", "paper/cuboid_at_rest")
ALGORITHMS = ("margin", "torque")
SAME = 1e-9
"""N or N m, between the optimum of a batch and that of the same state by itself."""
BLOCK = 100
"""States that are evaluated, and kept as a whole, at a time."""


def verified(scene: str, algorithm: str, count: int) -> Iterator[tuple[StateStatus, str]]:
    """Yield the status of each state, and what the checker objects to; empty: nothing."""
    evaluator = Evaluator(load_scene(EXAMPLES / f"{scene}.yaml"), algorithm=algorithm)
    half = -(-count // 2)
    walked, random = paths(evaluator, half, 0.001), drawn(evaluator, half)
    states = np.concatenate([walked, random])[np.random.default_rng(2).permutation(2 * half)]
    for start in range(0, count, BLOCK):
        block = states[start : min(start + BLOCK, count)]
        found = evaluator.evaluate_many(block)
        kept = evaluator.evaluate_many(block, evaluations=range(len(block)))
        for number, evaluation in kept.evaluations.items():
            said = []
            if evaluation.has_contacts:
                document = solution_document(evaluation.solution, evaluation.scene)
                verification = verify_document(document)
                said += [str(one) for one in verification.checks if one.passed is not True]
            if found.statuses[number] is not evaluation.status:
                said.append(f"{evaluation.status} is {found.statuses[number]} in the batch")
            if evaluation.found:
                torques = found.torques[number], evaluation.torques
                least = [float(np.abs(one).max(initial=0.0)) for one in torques]
                best = [float(found.margins[number]), evaluation.margin]
                one, other = best if algorithm == "margin" else least
                if abs(one - other) > SAME:
                    said.append(f"the optimum {other} is {one} in the batch")
            yield evaluation.status, "; ".join(said)


def main() -> int:
    """Verify as many states as are asked for; 1 where the checker objects."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    count = parser.parse_args().count
    cases = [(scene, algorithm) for scene in SCENES for algorithm in ALGORITHMS]
    share = -(-count // len(cases))
    faults = 0
    for scene, algorithm in cases:
        seen: Counter[StateStatus] = Counter()
        for number, (status, said) in enumerate(verified(scene, algorithm, share)):
            seen[status] += 1
            if said:
                faults += 1
                print(f"{scene}, {algorithm}, state {number}: {said}")
        told = ", ".join(f"{many} {status.name.lower()}" for status, many in seen.most_common())
        print(f"{scene}, {algorithm}: {told}", flush=True)
    print(f"{share * len(cases)} states, the checker objects to {faults}")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
