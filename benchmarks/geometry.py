"""From a posed scene to its problem, against Pinocchio's and coal's own passes in C++."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from tabulate import tabulate

from benchmarks.timing import medians, timer
from graspless_pin import Hand, Scene, load_scene

_EXAMPLES = Path(__file__).parents[1] / "examples"
_MARGIN = 1e-3


def scene_problem() -> str:
    """`Scene.problem()` of a newly posed Allegro, box and slope in C++ passes over all pairs."""
    scene = load_scene(_EXAMPLES / "allegro_box_on_slope.yaml")
    hand = scene.hand
    if hand is None:
        raise ValueError("the scene has no hand")
    cpp, pairs = _cpp_pass(scene, hand)
    q = dict(hand.q)

    def posed() -> None:
        scene.with_changes(hand=hand.with_configuration(q)).problem()

    yardstick, ours = medians([timer(cpp), timer(posed)], budget=2.0)
    rows = [
        ["kinematics, collisions and patches in C++", f"{1e6 * yardstick:.0f}", "1"],
        ["`Scene.problem()`", f"{1e6 * ours:.0f}", f"{ours / yardstick:.0f}"],
    ]
    table = tabulate(rows, ["", "us", "ratio"], tablefmt="github")
    return f"## A posed scene\n\nAllegro hand, box and slope, {pairs} pairs of bodies.\n\n{table}"


def _cpp_pass(scene: Scene, hand: Hand) -> tuple[Any, int]:
    """One call that poses the hand, finds all collisions and their patches; number of pairs."""
    model = hand.tree.model
    geometry = pin.GeometryModel()
    links = []
    for number, item in enumerate(hand.tree.geometries):
        placement = pin.SE3(np.array(item.T_joint_geometry))
        body = pin.GeometryObject(f"hand_{number}", item.joint, placement, item.shape)
        links.append(geometry.addGeometryObject(body))
    bodies = [scene.object.collision_body(), *(item.collision_body() for item in scene.supports)]
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
    q = hand.tree.configuration(hand.positions)

    def run() -> None:
        pin.computeJointJacobians(model, data, q)
        pin.computeCollisions(model, data, geometry, geometry_data, q, False)  # noqa: FBT003
        pin.computeContactPatches(geometry, geometry_data)

    return run, len(pairs)
