"""Algorithms 1 and 2 over all friction modes, in units of one bare solve of the relaxed LP."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from tabulate import tabulate
from tests.core.random_scenes import general_scene, slope_scene
from tests.core.scenes import scene
from tests.oracles.mixed_integer import solve_by_mixed_integer

from benchmarks.programs import bare_solve, relaxed_program
from benchmarks.timing import as_new, medians, timed, timer
from graspless_pin import (
    QuasistaticProblem,
    Status,
    TorqueSolution,
    maximize_margin,
    minimize_torque,
    solve_each_mode,
)

Solve = Callable[..., TorqueSolution]

ALGORITHMS: dict[int, Solve] = {1: maximize_margin, 2: partial(minimize_torque, margin=0.1)}
PAPER = {"A": "sphere", "B at rest": "rest", "B sliding up": "up", "B sliding down": "down"}
FAMILIES: dict[str, Callable[[int, int], QuasistaticProblem]] = {
    "fingers of 3 or 4 joints": partial(general_scene, joints=(3, 4)),
    "fingers of 2 to 4 joints": general_scene,
    "box on a slope, 1-joint fingers": slope_scene,
}
SIZES = (6, 12, 24, 48)
SCENES = 20
TIME_LIMIT = 1.0
MILP = "HiGHS' MILP"
MILP_SCENES = 4
RIVAL_TIME_LIMIT = 10.0
OPEN = frozenset({Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED})


@dataclass(frozen=True, eq=False)
class Measured:
    """One problem under one algorithm.

    Attributes:
        bare: Seconds of a bare solve.
        again: Bare solves that a call on a problem solved before takes.
        first: Bare solves that the first call on a new problem object takes.
        solution: What was found.
    """

    bare: float
    again: float
    first: float
    solution: TorqueSolution


def measure(problem: QuasistaticProblem, solve: Solve, *, budget: float) -> Measured:
    """Time one algorithm on one problem against the bare solve."""
    bare = timer(partial(bare_solve, relaxed_program(problem)))
    solution = solve(problem, time_limit=TIME_LIMIT)
    if solution.status in OPEN:
        # The limit ended the search, so its time says little: once is enough.
        unit = medians([bare], budget=budget)[0]
        return Measured(unit, TIME_LIMIT / unit, TIME_LIMIT / unit, solution)
    again = timer(partial(solve, problem))
    unit, repeated, new = medians(
        [bare, again, lambda: timed(partial(solve, as_new(problem)))], budget=budget
    )
    return Measured(unit, repeated / unit, new / unit, solution)


def paper_scenes() -> str:
    """The paper's four scenes."""
    rows = []
    for title, name in PAPER.items():
        for number, solve in ALGORITHMS.items():
            one = measure(scene(name), solve, budget=1.0)
            proof = one.solution.certificate
            rows.append(
                [title, number, 1e3 * one.bare, one.again, one.first, proof.nodes,
                 proof.force_programs, proof.kinematic_programs]
            )  # fmt: skip
    headers = ["scene", "algorithm", "bare solve [ms]", "again", "first call", "nodes", "LPs",
               "kinematic programs"]  # fmt: skip
    return _section(
        "The paper's scenes",
        "Times in bare solves (one dense PIQP solve of the relaxed LP, set-up included): again on "
        "a problem solved before, and the first call on a new problem object.",
        tabulate(rows, headers, "pipe", floatfmt=("", "", ".3f", ".1f", ".1f", "", "", "")),
    )


def random_scenes() -> str:
    """Random scenes of each family and size."""
    rows = []
    for family, make in FAMILIES.items():
        for contacts in SIZES:
            problems = [make(seed, contacts) for seed in range(SCENES)]
            for number, solve in ALGORITHMS.items():
                rows.append(_random_row(family, contacts, number, solve, problems))
    headers = ["scenes", "contacts", "joints", "algorithm", "bare solve [ms]", "again: median",
               "worst", "first call: median", "LPs: median", "worst", "kinematic: median",
               "worst", "optimal / none / open"]  # fmt: skip
    formats = ("", "", ".0f", "", ".2f", ".1f", ".0f", ".1f", ".0f", ".0f", ".0f", ".0f", "")
    return _section(
        "Random scenes",
        f"{SCENES} scenes a row, times in bare solves as above. Open: a limit of {TIME_LIMIT:g} s "
        "ended the search, and the limit is what counts.",
        tabulate(rows, headers, "pipe", floatfmt=formats),
    )


def _random_row(
    family: str, contacts: int, number: int, solve: Solve, problems: list[QuasistaticProblem]
) -> list[object]:
    """One row of the table of random scenes."""
    measured = [measure(problem, solve, budget=0.08) for problem in problems]
    proofs = [one.solution.certificate for one in measured]
    statuses = [one.solution.status for one in measured]
    unfinished = sum(status in OPEN for status in statuses)
    optimal = statuses.count(Status.OPTIMAL)
    again = [one.again for one in measured]
    programs = [proof.force_programs for proof in proofs]
    kinematic = [proof.kinematic_programs for proof in proofs]
    return [
        family,
        contacts,
        np.mean([problem.joint_count for problem in problems]),
        number,
        1e3 * np.median([one.bare for one in measured]),
        np.median(again),
        max(again),
        np.median([one.first for one in measured]),
        np.median(programs),
        max(programs),
        np.median(kinematic),
        max(kinematic),
        f"{optimal} / {len(problems) - optimal - unfinished} / {unfinished}",
    ]


def rivals() -> str:
    """Enumeration and the MILP against the default search."""
    rest = scene("rest")
    rows = []
    for number, solve in ALGORITHMS.items():
        name = "margin" if number == 1 else "torque"
        others = {
            "each maximal mode solved": partial(_solve_each_mode, rest, name),
            'search="enumerate"': partial(solve, rest, search="enumerate"),
            MILP: partial(solve_by_mixed_integer, rest, name),
        }
        for rival, call in others.items():
            slower = _times_slower(rest, solve, call)
            rows.append(["B at rest", number, rival, slower, slower])
    for family, make in FAMILIES.items():
        problems = [make(seed, 24) for seed in range(MILP_SCENES)]
        for number, solve in ALGORITHMS.items():
            name = "margin" if number == 1 else "torque"
            slower = [
                _times_slower(
                    problem,
                    solve,
                    partial(solve_by_mixed_integer, problem, name, time_limit=RIVAL_TIME_LIMIT),
                )
                for problem in problems
            ]
            what = f"{family}, 24 contacts, {MILP_SCENES} scenes"
            rows.append([what, number, MILP, np.median(slower), min(slower)])
    headers = ["scenes", "algorithm", "rival", "times slower: median", "least"]
    return _section(
        "Against enumeration and the MILP",
        'How many times as long as `search="auto"` they take. Each maximal mode solved: without '
        'the relaxation that `search="enumerate"` may stop at. On the random scenes a limit of '
        f"{RIVAL_TIME_LIMIT:g} s ends either search, and the limit counts.",
        tabulate(rows, headers, "pipe", floatfmt=("", "", "", ".0f", ".1f")),
    )


def _times_slower(problem: QuasistaticProblem, solve: Solve, rival: Callable[[], object]) -> float:
    """Time of a rival over that of the default search."""
    search = partial(solve, problem, time_limit=RIVAL_TIME_LIMIT)
    # Not in turns: the rival would leave the caches cold for the much shorter search.
    own = medians([timer(search)], budget=0.1)[0]
    other = medians([timer(rival)], budget=0.5)[0]
    return other / own


def _solve_each_mode(problem: QuasistaticProblem, algorithm: str) -> None:
    for _ in solve_each_mode(problem, algorithm):
        pass


def _section(title: str, text: str, table: str) -> str:
    return f"### {title}\n\n{text}\n\n{table}"
