"""Object, supports and friction of a scene in MJCF, and what a scene in MuJoCo may not have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from graspless_pin.errors import SceneError
from graspless_pin.geometry import ManipulatedObject, Support
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import Scene
from graspless_pin.scene.fields import label_of
from graspless_pin.scene.friction import FrictionTable
from graspless_pin.simulation.mjcf import Mjcf, Surface, add, add_mass

OBJECT = "object"
"""Name of the manipulated object's body."""

_HAND, _SUPPORT = 2, 0  # contype; the object's is 1
_MEETS_OBJECT, _MEETS_BOTH = 1, 3  # conaffinity


def check_at_rest(scene: Scene) -> None:
    """Refuse a scene in which something moves.

    Raises:
        SceneError: If it does.
    """
    where = label_of(scene)
    if scene.motion is not None:
        raise SceneError(
            f"{where}: motion: declares a motion, and the simulation tells whether rest lasts; "
            "leave the key out to ask for rest"
        )
    for support in scene.supports:
        if support.velocity.any():
            raise SceneError(
                f"{where}: support {support.name!r} moves, and the simulation tells whether rest "
                "lasts; leave its velocity out"
            )


class FrictionOf:
    """Coefficients by body, times a factor."""

    def __init__(self, scene: Scene, factor: float = 1.0) -> None:
        """Take what a scene says of friction."""
        materials = scene.hand_material, scene.object.material, scene.materials
        self._table = FrictionTable(scene.supports, scene.friction, *materials)
        self._where = label_of(scene)
        self._factor = factor

    def __call__(self, group: str, body: str) -> float:
        """Return the coefficient of a body of the group ``hand`` or ``supports``.

        Raises:
            SceneError: If it has none.
        """
        try:
            return self._factor * self._table.coefficient(group, body)
        except SceneError as error:
            raise error.at(self._where) from error


def hand_surface(friction: FrictionOf, link: str) -> Surface:
    """Return how a link meets the object, and supports."""
    return Surface(friction("hand", link), 1, _HAND, _MEETS_OBJECT)


def placed_pieces(body: ManipulatedObject | Support) -> Iterator[tuple[Any, FloatArray]]:
    """Yield the convex pieces of a body, each with its (4, 4) pose in the body's frame."""
    poses = body.shape.placements()
    for number, piece in enumerate(body.geometries):
        yield piece, np.eye(4) if poses is None else poses[number]


def write_supports(
    document: Mjcf, scene: Scene, friction: FrictionOf, prefix: str = "support/"
) -> Iterator[tuple[str, str]]:
    """Write the supports; yield the name of each shape, and the support's."""
    for support in scene.supports:
        name = f"{prefix}{support.name}"
        body = document.body(document.section("worldbody"), name, support.T_world_support)
        surface = Surface(friction("supports", support.name), 1, _SUPPORT, _MEETS_BOTH)
        for number, (piece, T) in enumerate(placed_pieces(support)):
            document.shape(body, f"{name}/{number}", piece, T, surface)
            yield f"{name}/{number}", support.name


def write_object(
    document: Mjcf, scene: Scene, manipulated: ManipulatedObject, name: str = OBJECT
) -> None:
    """Write the object at its pose, with a free joint and its payloads."""
    body = document.body(document.section("worldbody"), name, manipulated.T_world_object)
    add(body, "freejoint", name=name)
    add_mass(body, manipulated.mass, manipulated.center_of_mass, manipulated.own_inertia)
    for load in scene.loads:
        if load.mass:
            T = np.eye(4)
            T[:3, 3] = manipulated.center_of_mass if load.at is None else load.at
            payload = document.body(body, f"load/{load.name}", T)
            add_mass(payload, load.mass, np.zeros(3), np.zeros((3, 3)))
    surface = Surface(1.0, 0, 1, 0)  # the other body's friction counts
    for number, (piece, T) in enumerate(placed_pieces(manipulated)):
        document.shape(body, f"{name}/{number}", piece, T, surface)
