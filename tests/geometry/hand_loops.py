"""A hand as compiled loops take it, of which a test tells what it is about."""

from typing import Any

import numpy as np

from graspless_pin import compiled
from graspless_pin.geometry.bodies.collision import BodyShapes
from graspless_pin.geometry.contact.distances import solids_of

NO_JOINTS = {
    "parents": [0], "placements": np.eye(4)[None], "axes": np.empty((0, 6)),
    "masses": np.zeros(1), "centers": np.zeros((1, 3)),
}  # fmt: skip


def hand_loops(**told: Any) -> Any:
    """Loops of a hand without shapes, joints, limits and weight but for what is told."""
    assert compiled.core is not None
    arguments = NO_JOINTS | told
    count = len(arguments["axes"])
    nothing, no_poses = solids_of(BodyShapes((), ())).compiled_sets, np.empty((0, 4, 4))
    shapes = arguments.get("shapes", no_poses)
    others = {
        "coupling": np.eye(count), "offset": np.zeros(count), "lower": np.full(count, -np.inf),
        "upper": np.full(count, np.inf), "gravity": np.zeros(3),
        "carriers": np.zeros(len(shapes), int), "shapes": shapes, "links": nothing,
        "pieces": nothing, "poses": no_poses, "pairs": None, "around": nothing,
        "around_poses": no_poses, "tolerance": 1e-3, "max_penetration": 5e-3,
    }  # fmt: skip
    return compiled.core.HandStates(**(others | arguments))


def may_be_deep(pairs: Any, sets: Any, poses: Any, around: Any, there: Any, depth: float) -> bool:
    """Whether loops leave a hand of shapes that stand still to be measured."""
    loops = hand_loops(
        links=sets, shapes=poses, pairs=pairs, around=around, around_poses=there,
        max_penetration=depth,
    )  # fmt: skip
    return bool(loops.at(np.empty((1, 0)))[5][0])
