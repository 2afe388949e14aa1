"""Verdicts beside what MuJoCo says in seeded families: ``python -m benchmarks.holding``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np
from tabulate import tabulate
from tests.simulation.holding_scenes import FAMILIES, holding_scenes

from graspless_pin import Scene, Stability, free_motions, stability
from graspless_pin.problem.checks import FloatArray
from graspless_pin.simulation import SimulatedOutcome, simulate

SCENES = 5
_SHARE = 0.3
"""Of Algorithm 1's torques, beside what carries the hand's own weight: often too little."""
_MARGIN = 0.1
"""N that Algorithm 2 asks for."""
_FREE = "free motions"
_RUNS = "stiff", "soft", "stiff, at once"
"""Two in a fixture first, and one that nothing holds."""


@dataclass(frozen=True)
class Compared:
    """One scene with some torques.

    Attributes:
        family: Its family.
        number: Which of the family's scenes.
        torques: Whose.
        contacts: How many.
        group: The verdict, or that there are free motions.
        programs: Linear programs of the verdict.
        outcomes: What MuJoCo says in each run.
        displacements: In each run, m.
        rotations: In each run, rad.
    """

    family: str
    number: int
    torques: str
    contacts: int
    group: str
    programs: int
    outcomes: tuple[SimulatedOutcome, ...]
    displacements: tuple[float, ...]
    rotations: tuple[float, ...]

    def contradicts(self, run: int = 0) -> bool:
        """Whether a proven rest is not held in a run, or what cannot rest does not move."""
        if self.group == Stability.STRONG:
            return self.outcomes[run] is not SimulatedOutcome.HELD
        return self.group == Stability.NONE and self.outcomes[run] is not SimulatedOutcome.MOVED

    def __str__(self) -> str:
        """Return it in one line."""
        runs = ", ".join(
            f"{run} {outcome} ({1e3 * way:.2f} mm, {np.degrees(angle):.2f} deg)"
            for run, outcome, way, angle in zip(
                _RUNS, self.outcomes, self.displacements, self.rotations, strict=True
            )
        )
        return f"{self.family} {self.number}, {self.torques}: {self.group}, {runs}"


def compared(family: str, count: int) -> list[Compared]:
    """Compare the first scenes of a family; each case is told on standard error as well.

    So many have no free motions. Of others before them Algorithm 1's torques are compared.
    """
    found = []
    for case in _each(family, count):
        found.append(case)
        print(f"{case}, {case.programs} LPs", file=sys.stderr, flush=True)
    return found


def _each(family: str, count: int) -> Iterator[Compared]:
    left = count
    for number, scene in enumerate(holding_scenes(family, sys.maxsize)):
        problem = scene.problem()
        free = len(free_motions(problem)) > 0
        left -= not free
        for name, torques in _torques(scene, alone=free).items():
            verdict = stability(problem, torques)
            at_once = simulate(scene, torques, protocol="step")
            runs = (*simulate(scene, torques).runs, at_once.runs[0])
            yield Compared(
                family,
                number,
                name,
                problem.contact_count,
                _FREE if free else str(verdict.status),
                verdict.programs,
                tuple(run.outcome for run in runs),
                tuple(run.displacement for run in runs),
                tuple(run.rotation for run in runs),
            )
        if not left:
            return


def _torques(scene: Scene, *, alone: bool) -> dict[str, FloatArray]:
    """Return Algorithm 1's torques by name, and where they are not alone, others."""
    weight, best = scene.problem().gravity_torques, scene.solve("margin")
    torques = {"Algorithm 1": best.torques}
    if alone:
        return torques
    least = scene.solve("torque", margin=_MARGIN)
    if least.found:
        torques["Algorithm 2"] = least.torques
    torques[f"{_SHARE:g} of Algorithm 1"] = weight + _SHARE * (best.torques - weight)
    return torques


def holding(count: int = SCENES, jobs: int = 2) -> str:
    """A table of verdicts and outcomes, and each contradiction."""
    with ProcessPoolExecutor(jobs) as pool:
        found = pool.map(partial(compared, count=count), FAMILIES)
        return compared_text(list(chain.from_iterable(found)))


def compared_text(results: Sequence[Compared]) -> str:
    """Return the table of all cases, and each contradiction."""
    groups = dict.fromkeys(sorted((one.family, one.group) for one in results))
    rows = [
        _row(family, [one for one in results if (one.family, one.group) == (family, group)])
        for family, group in groups
    ]
    counts = [f"{run}: {', '.join(SimulatedOutcome)}" for run in _RUNS]
    headers = ["family", "verdict", "cases", "contacts", "LPs, median / most", *counts]
    text = [tabulate(rows, headers, tablefmt="github"), ""]
    for run, name in enumerate(_RUNS):
        odd = [f"- {one}" for one in results if one.contradicts(run)]
        text += [f"Contradicted ({name}):", *odd] if odd else []
        text += [] if odd else [f"No verdict is contradicted ({name})."]
    return "\n".join(text)


def _row(family: str, cases: Sequence[Compared]) -> list[object]:
    contacts = [case.contacts for case in cases]
    programs = [case.programs for case in cases]
    return [
        family,
        cases[0].group,
        len(cases),
        f"{min(contacts)} to {max(contacts)}",
        f"{np.median(programs):.0f} / {max(programs)}",
        *(
            ", ".join(
                str(sum(case.outcomes[run] is kind for case in cases)) for kind in SimulatedOutcome
            )
            for run in range(len(_RUNS))
        ),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.holding", description=__doc__)
    parser.add_argument(
        "--count", type=int, default=SCENES, help="of each family, without free motions"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    print(holding(given.count, given.jobs))


if __name__ == "__main__":
    main()
