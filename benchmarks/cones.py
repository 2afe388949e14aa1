"""Round cones beside pyramids: bare solves, and what a whole call adds."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from tabulate import tabulate
from tests.core.random_scenes import general_scene

from benchmarks.programs import bare_round_solve, bare_solve, relaxed_program
from benchmarks.timing import as_new, medians, timed, timer
from graspless_pin import QuasistaticProblem, load_scene, maximize_margin, minimize_torque
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.programs.objectives import Margin, Torque

CONTACTS = (3, 6, 10, 16, 24)
SCENES = 10
PAPER = Path(__file__).parents[1] / "examples" / "paper"


def round_cones() -> str:
    """The margin programs of random scenes, round and with 8 and 32 edges."""
    rows = []
    for contacts in CONTACTS:
        measured = [_measured(seed, contacts) for seed in range(SCENES)]
        rows.append([contacts, *np.median(measured, axis=0)])
    headers = ["contacts", "round [ms]", "over 8 edges", "over 32 edges", "again", "first call"]
    table = tabulate(rows, headers, "pipe", floatfmt=("", ".3f", ".2f", ".2f", ".1f", ".1f"))
    return (
        "## Round cones\n\nOne bare Clarabel solve of the round margin program, over one bare "
        "dense PIQP solve of that with 8 and with 32 edges, all with set-up; whole calls on round "
        f"scenes, in bare round solves. Medians over {SCENES} random scenes.\n\n{table}"
    )


def _measured(seed: int, contacts: int) -> tuple[float, ...]:
    scene = general_scene(seed, contacts)
    problem = scene.with_changes(cone="round")
    fine = scene.with_changes(cone_edges=32)
    whole = partial(maximize_margin, problem)
    bare, coarse, finer, again, first = medians(
        [
            timer(partial(bare_round_solve, relaxed_program(problem))),
            timer(partial(bare_solve, relaxed_program(scene))),
            timer(partial(bare_solve, relaxed_program(fine))),
            timer(whole),
            lambda: timed(partial(maximize_margin, as_new(problem))),
        ],
        budget=0.2,
    )
    return 1e3 * bare, bare / coarse, bare / finer, again / bare, first / bare


def directions() -> str:
    """Whole calls under the rule of directions on the paper's scenes."""
    rows, costs = [], []
    for path in sorted(PAPER.glob("*.yaml")):
        problem = load_scene(path).problem()
        for name, margin in (("margin", None), ("torque", 0.1)):
            rows.append([path.stem, name, *_by_directions(problem, margin)])
            costs.append(rows[-1][-2:])
    rows.append(["median", "", "", "", *np.median(costs, axis=0)])
    headers = ["scene", "algorithm", "nodes", "bare [ms]", "again", "first call"]
    table = tabulate(rows, headers, "pipe", floatfmt=("", "", "", ".3f", ".1f", ".1f"))
    return (
        "## Directions\n\nWhole calls under the rule of directions, gap 1e-4, in bare Clarabel "
        f"solves of the round program with set-up.\n\n{table}"
    )


def _by_directions(problem: QuasistaticProblem, margin: float | None) -> tuple[float, ...]:
    given = partial(maximize_margin) if margin is None else partial(minimize_torque, margin=margin)
    objective = Margin() if margin is None else Torque(margin)
    program = formulate(problem.with_changes(cone="round"), objective).program
    whole = partial(given, problem, sign_rule="direction")
    bare, again, first = medians(
        [
            timer(partial(bare_round_solve, program)),
            timer(whole),
            lambda: timed(partial(given, as_new(problem), sign_rule="direction")),
        ],
        budget=0.5,
    )
    return whole().certificate.nodes, 1e3 * bare, again / bare, first / bare
