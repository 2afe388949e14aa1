"""From a posed scene to its problem, against Pinocchio's and coal's own passes in C++."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from tabulate import tabulate

from benchmarks.timing import Timer, medians, timed, timer
from graspless_pin import Hand, Scene, load_scene
from graspless_pin.scene.stated import Motion

_EXAMPLES = Path(__file__).parents[1] / "examples"
_MARGIN = 1e-3
_CONFIGURATIONS = 10
_STEP = 1e-4  # rad and m: every call sees another configuration, and the contacts stay


def scene_problem() -> str:
    """`Scene.problem()` of a newly posed Allegro, box and slope in C++ passes over all pairs."""
    # Two scenes, as one keeps what was found for the last pose of the object.
    scene, other = (load_scene(_EXAMPLES / "allegro_box_on_slope.yaml") for _ in range(2))
    hand = scene.hand
    if hand is None:
        raise ValueError("the scene has no hand")
    run, pairs = _cpp_pass(scene, hand)
    leaders = list(hand.tree.coupling.leaders)
    uphill = scene.object.T_world_object[:3, 0]
    sliding = Motion(np.concatenate([0.05 * uphill, np.zeros(3)]))
    rng = np.random.default_rng(0)
    seconds = []
    for _ in range(_CONFIGURATIONS):
        q = hand.positions[leaders] + rng.uniform(-_STEP, _STEP, len(leaders))
        T = np.array(scene.object.T_world_object)
        T[:3, 3] -= rng.uniform(0.0, _STEP) * uphill

        positions = hand.with_configuration(q).positions

        def hand_moved(q: Any = q) -> Scene:
            return scene.with_changes(hand=hand.with_configuration(q))

        def both_moved(q: Any = q, T: Any = T, **more: Any) -> Scene:
            box = other.object.with_pose(T)
            return other.with_changes(hand=hand.with_configuration(q), object=box, **more)

        posed = [hand_moved, both_moved, partial(both_moved, motion=sliding)]
        timers = [timer(partial(run, positions)), timer(both_moved), *map(_problem_timer, posed)]
        seconds.append(medians(timers, budget=1.0))
    times = np.median(seconds, axis=0)
    names = [
        "kinematics, collisions and patches in C++",
        "posing hand and object",
        "`Scene.problem()`, the hand moved",
        "`Scene.problem()`, hand and object moved",
        "the same, the object sliding",
    ]
    rows = [
        [name, f"{1e6 * time:.0f}", f"{time / times[0]:.1f}"]
        for name, time in zip(names, times, strict=True)
    ]
    table = tabulate(rows, ["", "us", "ratio"], tablefmt="github", disable_numparse=True)
    return f"## A posed scene\n\nAllegro hand, box and slope, {pairs} pairs of bodies.\n\n{table}"


def _problem_timer(posed: Callable[[], Scene]) -> Timer:
    """A function that times `Scene.problem()` of a scene that was only just posed."""
    return lambda: timed(posed().problem)


def _cpp_pass(scene: Scene, hand: Hand) -> tuple[Callable[[Any], None], int]:
    """What poses the hand, finds all collisions and their patches; and the number of pairs."""
    model = hand.tree.pinocchio_model
    geometry = pin.GeometryModel()
    links = []
    for number, item in enumerate(hand.tree.geometries):
        placement = pin.SE3(np.array(item.T_joint_geometry))
        body = pin.GeometryObject(f"hand_{number}", item.joint, placement, item.shape)
        links.append(geometry.addGeometryObject(body))
    bodies = [*scene.object.collision_bodies()]
    bodies += [body for item in scene.supports for body in item.collision_bodies()]
    fixed = [
        geometry.addGeometryObject(
            pin.GeometryObject(
                item.name, 0, pin.SE3(np.array(item.T_world_geometry)), item.geometry
            )
        )
        for item in bodies
    ]
    pairs = [(link, other) for link in links for other in fixed]
    pairs += [(fixed[0], other) for other in fixed[1:]]
    for first, second in pairs:
        geometry.addCollisionPair(pin.CollisionPair(first, second))
    data, geometry_data = model.createData(), geometry.createData()
    for request in geometry_data.collisionRequests:
        request.security_margin = _MARGIN
        request.num_max_contacts = 1
        request.enable_contact = True

    def run(positions: Any) -> None:
        q = hand.tree.configuration(positions)
        pin.computeJointJacobians(model, data, q)
        pin.computeCollisions(model, data, geometry, geometry_data, q, False)  # noqa: FBT003
        pin.computeContactPatches(geometry, geometry_data)

    return run, len(pairs)
