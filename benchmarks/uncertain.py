"""One vector of torques for a whole set, beside one solve of the nominal problem.

Of one problem after the other, and of the states of an evaluator.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from benchmarks.programs import bare_solve
from benchmarks.timing import as_new, medians, timed
from graspless_pin import Evaluator, Uncertainty, load_scene, minimize_torque
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.programs.objectives import Torque

EXAMPLES = Path(__file__).parents[1] / "examples"
SCENES = {
    "paper/cuboid_at_rest": None, "paper/cuboid_sliding_up": None,
    "allegro_mug_against_wall": None, "allegro_box_on_slope": None,
    "allegro_sphere_on_slope": 1.0, "trihand_push_box": None,
}  # fmt: skip
"""With the joints' stiffness, N m/rad, where constant torques serve no set."""
SETS = {
    "16 corners": {"mass": 0.1, "center_of_mass": 0.004},
    "256 corners": {
        "mass": 0.1, "center_of_mass": 0.004, "force": 0.05, "moment": (0.002, 0.0, 0.0)
    },
    "a ball": {"force_radius": 0.05},
}  # fmt: skip
MARGIN = 0.02
STATES = {
    "allegro_mug_against_wall": ({}, 0.001), "panda_carry_bar": ({"attached_to": "panda_hand"}, 0.2)
}  # fmt: skip
"""How an evaluator is made, and how far joints are off the scene's, rad, root mean square."""
RULES = {"plain Coulomb": {"static_friction": "coulomb"}, "virtual sliding": {}}
COUNT = 12
"""States of each scene; each is asked three times, and the nominal ones again and again."""


def uncertain() -> str:
    """Sets of 16 and 256 corners and a ball, plain Coulomb friction; states of an evaluator."""
    rows = [[name, *_measured(name, stiffness)] for name, stiffness in SCENES.items()]
    rows.append(["median", *np.median([row[1:] for row in rows], axis=0)])
    headers = ["scene", "first call [ms]", "its LP [ms]"]
    headers += [f"{name}, over {what}" for name in SETS for what in ("a first call", "its LP")]
    table = tabulate(rows, headers, "pipe", floatfmt=("", ".2f", ".3f", *[".1f"] * 6))
    return (
        "## What is not known exactly\n\nThe least torques for all members of a set, plain Coulomb "
        "friction, over a first call for the nominal problem, and over one bare dense PIQP solve "
        f"of that problem's program, set-up included; time of the processor.\n\n{table}"
        f"\n\n{_states()}"
    )


def _states() -> str:
    """States per second of evaluators with and without 16 corners, Algorithm 1."""
    rows = []
    for name, (how, spread) in STATES.items():
        scene = load_scene(EXAMPLES / f"{name}.yaml")
        for told, rules in RULES.items():
            unknown = Uncertainty(**SETS["16 corners"])
            nominal, robust = (
                Evaluator(scene, algorithm="margin", uncertainty=one, **how, **rules)
                for one in (None, unknown)
            )
            home, rng = robust.configuration(), np.random.default_rng(0)
            q = home + rng.normal(0.0, spread, (COUNT, len(home)))
            q = np.clip(q, *robust.joint_limits)
            margin = 0.5 * nominal.evaluate_many(q).margins.max()
            figures = []
            for ask in ("evaluate_many", "are_feasible"):
                asked = {"margin": margin} if ask == "are_feasible" else {}
                calls = [
                    partial(getattr(one, ask), q, workers=1, **asked) for one in (nominal, robust)
                ]
                paces = medians(
                    [partial(timed, call, time.process_time) for call in calls], budget=3.0
                )
                figures += [COUNT / paces[0], COUNT / paces[1], paces[1] / paces[0]]
            rows.append([name, told, *figures])
    headers = ["scene", "friction"]
    for what in ("evaluate_many", "are_feasible"):
        headers += [f"{what}, nominal [1/s]", "for 16 corners [1/s]", "time over nominal"]
    table = tabulate(rows, headers, "pipe", floatfmt=("", "", *[".0f", ".1f", ".0f"] * 2))
    return (
        f"States of an evaluator, {COUNT} near the scene's, evaluated before; feasible with half "
        f"of the largest nominal margin.\n\n{table}"
    )


def _measured(name: str, feedback: float | None) -> list[float]:
    problem = load_scene(EXAMPLES / f"{name}.yaml").problem()
    nominal = partial(minimize_torque, margin=MARGIN, static_friction="coulomb")
    program = formulate(problem, Torque(MARGIN)).program

    def of_new(given: dict[str, Any] | None) -> float:
        new, more = as_new(problem), {}
        if given is not None:
            more = {"uncertainty": Uncertainty(**given), "feedback": feedback}
        return timed(partial(nominal, new, **more), time.process_time)

    first, bare, *sets = medians(
        [
            partial(of_new, None),
            lambda: timed(partial(bare_solve, program), time.process_time),
            *(partial(of_new, given) for given in SETS.values()),
        ],
        budget=3.0,
    )
    ratios = [one / over for one in sets for over in (first, bare)]
    return [1e3 * first, 1e3 * bare, *ratios]
