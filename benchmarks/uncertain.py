"""One vector of torques for a whole set, beside one solve of the nominal problem."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import numpy as np
from tabulate import tabulate

from benchmarks.programs import bare_solve
from benchmarks.timing import as_new, medians, timed
from graspless_pin import Uncertainty, load_scene, minimize_torque
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
}  # fmt: skip
MARGIN = 0.02


def uncertain() -> str:
    """Sets of 16 and 256 corners under plain Coulomb friction."""
    rows = [[name, *_measured(name, stiffness)] for name, stiffness in SCENES.items()]
    rows.append(["median", *np.median([row[1:] for row in rows], axis=0)])
    headers = ["scene", "first call [ms]", "its LP [ms]"]
    headers += [f"{name}, over {what}" for name in SETS for what in ("a first call", "its LP")]
    table = tabulate(rows, headers, "pipe", floatfmt=("", ".2f", ".3f", *[".1f"] * 4))
    return (
        "## What is not known exactly\n\nThe least torques for all members of a set, plain Coulomb "
        "friction, over a first call for the nominal problem, and over one bare dense PIQP solve "
        f"of that problem's program, set-up included; time of the processor.\n\n{table}"
    )


def _measured(name: str, feedback: float | None) -> list[float]:
    problem = load_scene(EXAMPLES / f"{name}.yaml").problem()
    nominal = partial(minimize_torque, margin=MARGIN, static_friction="coulomb")
    program = formulate(problem, Torque(MARGIN)).program

    def over_set(given: dict[str, object]) -> object:
        known = Uncertainty(**given)  # type: ignore[arg-type]
        return nominal(as_new(problem), uncertainty=known, feedback=feedback)

    first, bare, *sets = medians(
        [
            lambda: timed(partial(nominal, as_new(problem)), time.process_time),
            lambda: timed(partial(bare_solve, program), time.process_time),
            *(
                partial(timed, partial(over_set, given), time.process_time)
                for given in SETS.values()
            ),
        ],
        budget=3.0,
    )
    ratios = [one / over for one in sets for over in (first, bare)]
    return [1e3 * first, 1e3 * bare, *ratios]
