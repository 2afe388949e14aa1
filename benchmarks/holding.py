"""Verdicts beside what MuJoCo says in seeded families: ``python -m benchmarks.holding``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import chain

import numpy as np
from tabulate import tabulate
from tests.simulation.holding_scenes import FAMILIES, holding_scenes

from graspless_pin import Stability, free_motions, stability
from graspless_pin.simulation import SimulatedOutcome, simulate

SCENES = 5
SHARES = 1.0, 0.3
"""Of Algorithm 1's torques, beside what carries the hand's own weight."""
_FREE = "free motions"


@dataclass(frozen=True)
class Compared:
    """One scene with some torques.

    Attributes:
        family: Its family.
        number: Which of the family's scenes.
        share: Of Algorithm 1's torques.
        contacts: How many.
        group: The verdict, or that there are free motions.
        programs: Linear programs of the verdict.
        outcomes: What MuJoCo says with stiff and with soft bodies.
        displacement: With stiff bodies, m.
    """

    family: str
    number: int
    share: float
    contacts: int
    group: str
    programs: int
    outcomes: tuple[SimulatedOutcome, ...]
    displacement: float

    @property
    def contradicts(self) -> bool:
        """Whether a proven rest moves with stiff bodies, or what cannot rest is held."""
        stiff = self.outcomes[0]
        if self.group == Stability.STRONG:
            return stiff is not SimulatedOutcome.HELD
        return self.group == Stability.NONE and stiff is SimulatedOutcome.HELD


def compared(family: str, count: int) -> list[Compared]:
    """Compare the first scenes of a family."""
    return list(_each(family, count))


def _each(family: str, count: int) -> Iterator[Compared]:
    for number, scene in enumerate(holding_scenes(family, count)):
        problem = scene.problem()
        weight = problem.gravity_torques
        best = scene.solve("margin").torques
        for share in SHARES:
            torques = weight + share * (best - weight)
            verdict = stability(problem, torques)
            found = simulate(scene, torques)
            yield Compared(
                family,
                number,
                share,
                problem.contact_count,
                _FREE if len(free_motions(problem)) else str(verdict.status),
                verdict.programs,
                tuple(run.outcome for run in found.runs),
                found.runs[0].displacement,
            )


def holding(count: int = SCENES, jobs: int = 2) -> str:
    """A table of verdicts and outcomes, and each contradiction."""
    with ProcessPoolExecutor(jobs) as pool:
        results = list(chain.from_iterable(pool.map(partial(compared, count=count), FAMILIES)))
    groups = dict.fromkeys(sorted((one.family, one.group) for one in results))
    rows = [
        _row(family, [one for one in results if (one.family, one.group) == (family, group)])
        for family, group in groups
    ]
    counts = [f"{run}: {', '.join(SimulatedOutcome)}" for run in ("stiff", "soft")]
    headers = ["family", "verdict", "cases", "contacts", "LPs, median / most", *counts]
    text = [tabulate(rows, headers, tablefmt="github"), ""]
    odd = [result for result in results if result.contradicts]
    text += [
        f"- {one.family} {one.number} with {one.share:g} of the torques: {one.group}, but "
        f"{one.outcomes[0]} ({one.displacement * 1e3:.2f} mm)"
        for one in odd
    ] or ["No verdict is contradicted with stiff bodies."]
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
            for run in range(2)
        ),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.holding", description=__doc__)
    parser.add_argument("--count", type=int, default=SCENES, help="scenes of each family")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    print(holding(given.count, given.jobs))


if __name__ == "__main__":
    main()
