"""Round cones beside pyramids: bare solves, and what a whole call adds."""

from __future__ import annotations

from functools import partial

import numpy as np
from tabulate import tabulate
from tests.core.random_scenes import general_scene

from benchmarks.programs import bare_round_solve, bare_solve, relaxed_program
from benchmarks.timing import as_new, medians, timed, timer
from graspless_pin import maximize_margin

CONTACTS = (3, 6, 10, 16, 24)
SCENES = 10


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
