"""What verdicts cost: linear programs by contacts, and each in units of a bare solve."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np
from tabulate import tabulate
from tests.simulation.holding_scenes import (
    FAMILIES,
    holding_scenes,
    room_corner,
    solvable_scenes,
)

from benchmarks.programs import bare_solve, relaxed_program
from benchmarks.timing import medians, timer
from graspless_pin import QuasistaticProblem, Scene, Stability, load_scene, stability
from graspless_pin.holding.certificate import balance

EXAMPLES = Path(__file__).parents[1] / "examples"
SCENES = 10
"""Of each family."""
SEVERAL = 20
"""Bare solves in a row."""
GROUPS = (range(3, 5), range(5, 6), range(6, 7), range(7, 9), range(9, 12), range(12, 16))


@dataclass(frozen=True, eq=False)
class Cost:
    """One verdict.

    Attributes:
        contacts: Of the problem.
        status: Of the verdict.
        programs: Linear programs.
        each: One of them, in bare solves; NaN where it took fewer than twenty.
        certificate: The certificate's own program, in bare solves.
    """

    contacts: int
    status: Stability
    programs: int
    each: float
    certificate: float


def verdicts() -> str:
    """Linear programs and their cost, by contacts."""
    costs = [cost(problem, torques) for problem, torques in _cases()]
    rows = [_row(group, [one for one in costs if one.contacts in group]) for group in GROUPS]
    headers = ["contacts", "cases", *Stability, "LPs, median / 90 % / most",
               "an LP in bare solves", "certificate in bare solves"]  # fmt: skip
    table = tabulate(rows, headers, "pipe", floatfmt=".1f")
    return (
        "## Verdicts\n\nOf seeded families and examples at rest, on torques of Algorithms 1 and 2 "
        "and on a part of those; bare solves of the relaxed LP with 8 edges, "
        "in seconds of the processor.\n\n" + table
    )


def cost(problem: QuasistaticProblem, torques: np.ndarray) -> Cost:
    """Ask for a verdict, and time it beside bare solves."""
    verdict = stability(problem, torques)
    program = relaxed_program(problem.with_changes(cone_edges=8))
    none = np.zeros(problem.contact_count)
    # A verdict solves program after program: so do its yardsticks, with caches as warm.
    several = range(SEVERAL)
    bare, certificate, whole = medians(
        [
            timer(lambda: [bare_solve(program) for _ in several], time.process_time),
            timer(lambda: [balance(problem, torques, none) for _ in several], time.process_time),
            timer(partial(stability, problem, torques), time.process_time),
        ],
        budget=0.1,
    )
    each = whole / verdict.programs / (bare / SEVERAL) if verdict.programs >= 20 else np.nan
    return Cost(problem.contact_count, verdict.status, verdict.programs, each, certificate / bare)


def _cases() -> Iterator[tuple[QuasistaticProblem, np.ndarray]]:
    families = chain.from_iterable(holding_scenes(family, SCENES) for family in FAMILIES)
    corners = solvable_scenes(room_corner, [0, len(FAMILIES)], SCENES)
    examples = map(load_scene, [*EXAMPLES.glob("*.yaml"), *EXAMPLES.glob("paper/*.yaml")])
    for scene in chain(families, corners, filter(_is_at_rest, examples)):
        problem = scene.problem()
        weight = problem.gravity_torques
        for algorithm, shares in (("margin", (1.0, 0.3)), ("torque", (1.0,))):
            solution = scene.solve(algorithm)
            if solution.found:
                for share in shares:
                    yield problem, weight + share * (solution.torques - weight)


def _is_at_rest(scene: Scene) -> bool:
    return not scene.problem().is_sliding.any()


def _row(group: range, costs: Sequence[Cost]) -> list[object]:
    programs = [one.programs for one in costs]
    return [
        f"{group[0]} to {group[-1]}" if len(group) > 1 else str(group[0]),
        len(costs),
        *(sum(one.status is status for one in costs) for status in Stability),
        f"{np.median(programs):.0f} / {np.quantile(programs, 0.9):.0f} / {max(programs)}",
        float(np.nanmedian([one.each for one in costs])),
        float(np.median([one.certificate for one in costs])),
    ]
