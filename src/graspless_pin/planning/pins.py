"""Pins: pairs of bodies whose nearest points are contacts, whatever the gap between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.contact.nearest_points import (
    Rates,
    Velocities,
    face_along,
    half_space,
    nearest_patch,
    nearest_rates,
    rates_over_face,
)
from graspless_pin.geometry.hand.joint_columns import JointColumns
from graspless_pin.geometry.poses import invert, transformed
from graspless_pin.problem.checks import FloatArray, finite_array, unknown_name
from graspless_pin.scene import Scene
from graspless_pin.scene.motion_and_contacts import GivenContact

PinEntry = tuple[str, str] | tuple[str, str, ArrayLike]
"""Two bodies, and perhaps the way that the face of the second looks which counts, its own axes."""


@dataclass(frozen=True, eq=False)
class Pin:
    """One contact that is kept whatever the gap.

    Attributes:
        first: The object, a hand link or a support.
        second: Another of them; one of the two is the object.
        plane: (3,) outward normal and offset, m, of the face of the second body that counts, in its
            own frame; None: all of it does.
        point: (3,) the point of the first body that counts, in its own frame, m; None: the one that
            is nearest.
    """

    first: str
    second: str
    plane: tuple[FloatArray, float] | None = None
    point: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class PinnedPoint:
    """Where a pin is in one state.

    Attributes:
        pin: The pin.
        contact: The contact, midway in the gap.
        gap: Negative where the bodies overlap, m.
    """

    pin: Pin
    contact: GivenContact
    gap: float


def pins_of(scene: Scene, entries: Sequence[PinEntry]) -> tuple[Pin, ...]:
    """Return the pins of a scene, those of the hand first.

    Where a pair touches along a face or a line in the scene's own state, the corners of that stay
    where they are on the first body, each over the plane of the second.

    Args:
        scene: The scene.
        entries: The pairs.

    Raises:
        ArgumentError: If an entry is no pair of bodies that can touch.
    """
    if isinstance(entries, str) or not entries:
        raise ArgumentError("pins", "needs at least one pair of bodies, e.g. ('finger_tip', 'box')")
    pins: list[Pin] = []
    for index, entry in enumerate(entries):
        pins += _resolved(scene, f"pins[{index}]", entry)
    return tuple(sorted(pins, key=lambda pin: _other(scene, pin) not in _links(scene)))


def _resolved(scene: Scene, name: str, entry: PinEntry) -> list[Pin]:
    if isinstance(entry, str) or len(entry) not in (2, 3):
        raise ArgumentError(name, f"needs two bodies and perhaps a direction, got {entry!r}")
    own, links = scene.object.name, _links(scene)
    known = [own, *links, *(support.name for support in scene.supports)]
    bodies = [own if body == "object" else str(body) for body in entry[:2]]
    for body in bodies:
        if body not in known:
            raise unknown_name(name, "body", body, known)
    if bodies.count(own) != 1:
        raise ArgumentError(name, f"pairs {bodies}; one of the two has to be the object, {own!r}")
    first, second = bodies
    for body in (first, second):
        if not _pieces(scene, body):
            raise ArgumentError(name, f"{body!r} has no collision shape")
    plane = None
    if len(entry) == 3:
        direction = finite_array(name, entry[2], (3,))
        if not direction.any():
            raise ArgumentError(name, "needs a direction that is not zero")
        plane = face_along(name, _pieces(scene, second), _pose(scene, second), direction)
    pin = Pin(first, second, plane)
    patch = nearest_patch(*_bodies(scene, pin))
    if len(patch.gaps) == 1:
        return [pin]
    to_first, to_second = (invert(_pose(scene, body)) for body in (first, second))
    n = patch.normal
    pins = []
    for middle, gap in zip(patch.points, patch.gaps, strict=True):
        point = transformed(to_first, middle - 0.5 * gap * n)
        normal = -to_second[:3, :3] @ n
        offset = float(normal @ transformed(to_second, middle + 0.5 * gap * n))
        pins.append(replace(pin, plane=plane or (normal, offset), point=point))
    return pins


def pinned_points(scene: Scene, pins: Sequence[Pin]) -> tuple[PinnedPoint, ...]:
    """Return where the pins of a scene are in one of its states."""
    return tuple([_point(scene, pin) for pin in pins])


def _point(scene: Scene, pin: Pin) -> PinnedPoint:
    if pin.point is None or pin.plane is None:
        patch = nearest_patch(*_bodies(scene, pin))
        nearest = int(np.argmin(patch.gaps))
        n, middle, gap = patch.normal, patch.points[nearest], patch.gaps[nearest]
    else:
        T = _pose(scene, pin.second)
        n = -T[:3, :3] @ pin.plane[0]
        place = transformed(_pose(scene, pin.first), pin.point)
        gap = float(-n @ (place - T[:3, 3])) - pin.plane[1]
        middle = place + 0.5 * gap * n
    into = n if pin.second == scene.object.name else -n
    return PinnedPoint(pin, GivenContact(_other(scene, pin), middle, into), gap)


def pin_rates(
    scene: Scene, columns: JointColumns | None, points: Sequence[PinnedPoint]
) -> tuple[Rates, ...]:
    """Return how pinned contacts move, their normals those into the object.

    Args:
        scene: The scene in the state.
        columns: Of its hand; None: it has none.
        points: What `pinned_points` returns.

    Returns:
        Of each by the n movable joints, rad or m, and by the object's twist about its centre of
        mass, [linear; angular], world axes.
    """
    return tuple([_rates(scene, columns, one) for one in points])


def _rates(scene: Scene, columns: JointColumns | None, at: PinnedPoint) -> Rates:
    pin, middle, gap = at.pin, at.contact.position, at.gap
    n = at.contact.normal if pin.second == scene.object.name else -at.contact.normal
    ends = middle - 0.5 * gap * n, middle + 0.5 * gap * n
    one, other = (
        _velocities(scene, columns, body, end)
        for body, end in zip((pin.first, pin.second), ends, strict=True)
    )
    if pin.point is None:
        bodies = _bodies(scene, pin)
        found = nearest_rates(*bodies, nearest_patch(*bodies), (one, other))
    else:
        found = rates_over_face(n, gap, one, other)
    return found if pin.second == scene.object.name else found._replace(normal=-found.normal)


def _velocities(
    scene: Scene, columns: JointColumns | None, body: str, point: FloatArray
) -> Velocities:
    """Return how a body moves at a point: by the joints, then by the object's twist."""
    count = 0 if columns is None else len(columns.linear)
    linear, angular = np.zeros((3, count + 6)), np.zeros((3, count + 6))
    if body == scene.object.name:
        arm = point - scene.object.center_of_mass_world
        linear[:, count : count + 3] = angular[:, count + 3 :] = np.eye(3)
        linear[:, count + 3 :] = np.cross(np.eye(3), arm).T
    elif columns is not None and scene.hand is not None and body in scene.hand.tree.link_joints:
        joint = scene.hand.tree.link_joints[body]
        linear[:, :count] = columns.velocity(joint, point)
        angular[:, :count] = columns.rotation(joint)
    return Velocities(linear, angular)


def _other(scene: Scene, pin: Pin) -> str:
    """Return the name of the body that is not the object."""
    return pin.first if pin.second == scene.object.name else pin.second


def _links(scene: Scene) -> tuple[str, ...]:
    return () if scene.hand is None else scene.hand.link_names


def _bodies(scene: Scene, pin: Pin) -> tuple[Sequence[CollisionBody], Sequence[CollisionBody]]:
    second = _pieces(scene, pin.second)
    if pin.plane is not None:
        second = [half_space(pin.second, *pin.plane, _pose(scene, pin.second))]
    return _pieces(scene, pin.first), second


def _body(scene: Scene, name: str) -> Any:
    """Return the object or a support by name; None: it is a link."""
    bodies = (scene.object, *scene.supports)
    return next((body for body in bodies if body.name == name), None)


def _pieces(scene: Scene, name: str) -> Sequence[CollisionBody]:
    body = _body(scene, name)
    if body is not None:
        return body.placed_bodies
    hand = scene.hand
    assert hand is not None  # noqa: S101 - names are checked
    names = hand.placed_bodies.shapes.names
    return [hand.placed_bodies[k] for k, link in enumerate(names) if link == name]


def _pose(scene: Scene, name: str) -> FloatArray:
    """(4, 4) pose of a body's own frame."""
    body = _body(scene, name)
    if body is not None:
        return body.T_world_object if body is scene.object else body.T_world_support
    assert scene.hand is not None  # noqa: S101 - names are checked
    return scene.hand.pose_of(name)
