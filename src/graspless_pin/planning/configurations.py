"""States of a scene as planners give them: configurations by joint name or as plain arrays.

Pins are pairs of bodies whose nearest points count as contacts, whatever the gap between them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.contact.curvature import (
    Rates,
    Velocities,
    face_along,
    half_space,
    nearest_patch,
    nearest_rates,
    rates_over_face,
)
from graspless_pin.geometry.hand.joint_columns import JointColumns
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import invert, transformed
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, unit_vector, unknown_name
from graspless_pin.records import changed
from graspless_pin.scene import Scene
from graspless_pin.scene.stated import GivenContact, Motion

PinEntry = tuple[str, str] | tuple[str, str, ArrayLike]
"""Two bodies, and optionally the outward direction, in its own axes, of one face of the second."""


@dataclass(frozen=True, eq=False)
class Pin:
    """One contact that is kept whatever the gap.

    Attributes:
        first: The object, a hand link or a support.
        second: Another of them; one of the two is the object.
        plane: (3,) outward normal and offset, m, in its own frame, of the face of the second body
            that is used; None: its whole surface is.
        point: (3,) point of the first body that is used, in its own frame, m; None: the nearest.
    """

    first: str
    second: str
    plane: tuple[FloatArray, float] | None = None
    point: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class PinnedPoint:
    """The contact of a pin in one state.

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

    Where a pair touches along a face or a line in the scene's own state, it has one pin for each
    corner of that: a fixed point of the first body over the plane of the second.

    Args:
        scene: The scene.
        entries: The pairs.

    Raises:
        ArgumentError: If an entry is no pair of bodies that can touch.
    """
    if isinstance(entries, str) or not np.iterable(entries) or not len(entries):
        raise ArgumentError("pins", "needs at least one pair of bodies, e.g. ('finger_tip', 'box')")
    pins: list[Pin] = []
    for index, entry in enumerate(entries):
        pins += _pins_of_entry(scene, f"pins[{index}]", entry)
    return tuple(sorted(pins, key=lambda pin: _other_body(scene, pin) not in _link_names(scene)))


def _pins_of_entry(scene: Scene, name: str, entry: PinEntry) -> list[Pin]:
    if isinstance(entry, str) or not np.iterable(entry) or len(entry) not in (2, 3):
        raise ArgumentError(name, f"needs two bodies and optionally a direction, got {entry!r}")
    own, links = scene.object.name, _link_names(scene)
    known = [own, *links, *(support.name for support in scene.supports)]
    bodies = [own if body == "object" else str(body) for body in entry[:2]]
    for body in bodies:
        if body not in known:
            raise unknown_name(name, "body", body, known)
    if bodies.count(own) != 1:
        raise ArgumentError(
            name, f"pairs {bodies}; exactly one of them must be the object, {own!r}"
        )
    first, second = bodies
    for body in (first, second):
        if not _placed_shapes(scene, body)[0]:
            raise ArgumentError(name, f"{body!r} has no collision shape; give it one")
    plane = None
    if len(entry) == 3:
        plane = face_along(name, *_placed_shapes(scene, second), unit_vector(name, entry[2]))
    pin = Pin(first, second, plane)
    patch = nearest_patch(*_pin_bodies(scene, pin))
    if len(patch.gaps) == 1:
        return [pin]
    to_first, to_second = (invert(_placed_shapes(scene, body)[1]) for body in (first, second))
    n = patch.normal
    pins = []
    for middle, gap in zip(patch.points, patch.gaps, strict=True):
        point = transformed(to_first, middle - 0.5 * gap * n)
        normal = -to_second[:3, :3] @ n
        offset = float(normal @ transformed(to_second, middle + 0.5 * gap * n))
        pins.append(replace(pin, plane=plane or (normal, offset), point=point))
    return pins


def pinned_point(scene: Scene, pin: Pin) -> PinnedPoint:
    """Return the contact of a pin in a state of its scene."""
    if pin.point is None or pin.plane is None:
        patch = nearest_patch(*_pin_bodies(scene, pin))
        nearest = int(np.argmin(patch.gaps))
        n, middle, gap = patch.normal, patch.points[nearest], patch.gaps[nearest]
    else:
        T = _placed_shapes(scene, pin.second)[1]
        n = -T[:3, :3] @ pin.plane[0]
        place = transformed(_placed_shapes(scene, pin.first)[1], pin.point)
        gap = float(-n @ (place - T[:3, 3])) - pin.plane[1]
        middle = place + 0.5 * gap * n
    into = n if pin.second == scene.object.name else -n
    return PinnedPoint(pin, GivenContact(_other_body(scene, pin), middle, into), gap)


def pin_rates(scene: Scene, columns: JointColumns | None, at: PinnedPoint) -> Rates:
    """Return the derivatives of a pinned contact, whose normal points into the object.

    Args:
        scene: The scene in the state.
        columns: The joint columns of its hand; None: it has none.
        at: The pinned point in this state.

    Returns:
        Derivatives by the n movable joints, rad or m, and by the object's twist about its centre of
        mass, [linear; angular], world axes.
    """
    pin, middle, gap = at.pin, at.contact.position, at.gap
    n = at.contact.normal if pin.second == scene.object.name else -at.contact.normal
    ends = middle - 0.5 * gap * n, middle + 0.5 * gap * n
    first, second = (
        _velocities(scene, columns, body, end)
        for body, end in zip((pin.first, pin.second), ends, strict=True)
    )
    if pin.point is None:
        bodies = _pin_bodies(scene, pin)
        rates = nearest_rates(*bodies, nearest_patch(*bodies), (first, second))
    else:
        rates = rates_over_face(n, gap, first, second)
    return rates if pin.second == scene.object.name else rates._replace(normal=-rates.normal)


def _velocities(
    scene: Scene, columns: JointColumns | None, body: str, point: FloatArray
) -> Velocities:
    """Return velocities of a body at a point, by the n joints and then by the object's twist."""
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


def _other_body(scene: Scene, pin: Pin) -> str:
    """Return the name of the body that is not the object."""
    return pin.first if pin.second == scene.object.name else pin.second


def _link_names(scene: Scene) -> tuple[str, ...]:
    return () if scene.hand is None else scene.hand.link_names


def _pin_bodies(scene: Scene, pin: Pin) -> tuple[Sequence[CollisionBody], Sequence[CollisionBody]]:
    second, T = _placed_shapes(scene, pin.second)
    if pin.plane is not None:
        second = [half_space(pin.second, *pin.plane, T)]
    return _placed_shapes(scene, pin.first)[0], second


def _placed_shapes(scene: Scene, name: str) -> tuple[Sequence[CollisionBody], FloatArray]:
    """Return the collision shapes of a body, and the (4, 4) pose of its own frame."""
    if name == scene.object.name:
        return scene.object.placed_bodies, scene.object.T_world_object
    for support in scene.supports:
        if support.name == name:
            return support.placed_bodies, support.T_world_support
    assert scene.hand is not None  # noqa: S101 - names are checked
    bodies = scene.hand.placed_bodies
    shapes = [bodies[k] for k, link in enumerate(bodies.shapes.names) if link == name]
    return shapes, scene.hand.pose_of(name)


Configuration = Mapping[str, float] | ArrayLike


class Configurations:
    """The states that a scene can be put into.

    Attributes:
        scene: The scene; what a state does not specify is as in it.
        joint_names: The a joints that do not follow others, in the hand's order.
        joint_units: ``rad`` or ``m`` of each.
        pins: Contacts that are kept whatever the gap, those of the hand first; None: contacts are
            found.
        joint_limits: (lower, upper), each (a,), rad or m; infinite where there is no limit, and
            narrowed by the limits of the joints that follow.
    """

    def __init__(self, scene: Scene, pins: Sequence[PinEntry] | None = None) -> None:
        """Prepare the states of a scene, with its pins: see `Evaluator`."""
        self.pins = None if pins is None else pins_of(scene, pins)
        self.scene = scene if self.pins is None else _with_pinned_contacts(scene, self.pins)
        self._hand = hand = scene.hand
        self.joint_names: tuple[str, ...] = ()
        self.joint_units: tuple[str, ...] = ()
        self.joint_limits: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros(0))
        if hand is not None:
            leaders = list(hand.tree.coupling.leaders)
            self.joint_names = tuple(hand.joint_names[leader] for leader in leaders)
            kinds = [hand.tree.joint_kinds[leader] for leader in leaders]
            self.joint_units = tuple("m" if kind == "prismatic" else "rad" for kind in kinds)
            self.joint_limits = hand.tree.ranges

    def hand_at(self, q: Configuration) -> Hand | None:
        """Return the hand at a configuration; None if there is no hand.

        Args:
            q: Positions by joint name, or (a,) positions of `joint_names`, rad or m.

        Raises:
            ArgumentError: If a joint is unknown, a number not finite, the shape wrong, or a joint
                outside its limits.
        """
        positions = self._named_positions(q) if isinstance(q, Mapping) else self._position_array(q)
        return None if self._hand is None else self._hand.with_configuration(positions)

    def array(self, q: Configuration) -> FloatArray:
        """Return (a,) positions of `joint_names`; joints that are not named stay as in the hand.

        Args:
            q: See `hand_at`.

        Raises:
            ArgumentError: As for `hand_at`, but joints may be outside their limits.
        """
        if not isinstance(q, Mapping):
            return self._position_array(q).copy()
        now: Mapping[str, float] = {} if self._hand is None else self._hand.q
        named = self._named_positions(q)
        if not named.keys() <= set(self.joint_names):
            self.without_limits.hand_at(named)  # refuses one that is not where its leaders take it
        positions = {**now, **named}
        return np.array([positions[name] for name in self.joint_names])

    def position_row(self, q: Configuration | None) -> FloatArray | None:
        """Return (a,) positions of `joint_names`; None: a joint that follows others is named.

        Args:
            q: See `Evaluator.evaluate`.

        Raises:
            ArgumentError: As for `array`.
        """
        named = q if isinstance(q, Mapping) else {}
        if self._hand is None or not named.keys() <= set(self.joint_names):
            return None
        return self.array({} if q is None else q)

    def with_scene(self, scene: Scene) -> Configurations:
        """Return the same states of a scene that differs in mass and friction alone."""
        changed = copy(self)
        vars(changed).pop("without_limits", None)
        changed.scene = scene
        return changed

    @cached_property
    def without_limits(self) -> Configurations:
        """The same states without joint limits."""
        free = Configurations(without_joint_limits(self.scene))
        free.pins = self.pins
        return free

    motors_carry = False
    """Whether joints under force control carry the link that the object moves with."""

    def axes_at(self, scene: Scene) -> FloatArray | None:  # noqa: ARG002
        """Return (3, 3) axes in which states are solved, as columns; None: the world's."""
        return None

    def shared_problem(self, scene: Scene, problem: QuasistaticProblem) -> QuasistaticProblem:  # noqa: ARG002
        """Return the problem of a state in the form shared by states with the same contacts."""
        return problem

    def object_overlap(self, scene: Scene) -> str:  # noqa: ARG002
        """Return a message on overlaps of the object that contacts do not show; empty: none."""
        return ""

    def solved_scene_at(
        self,
        q: Configuration | None,
        T_world_object: ArrayLike | None,
        twist: ArrayLike | Motion | None,
    ) -> Scene:
        """Return the scene in one state as it is solved."""
        return self.scene_at(q, T_world_object, twist)

    def scene_at(
        self,
        q: Configuration | None,
        T_world_object: ArrayLike | None,
        twist: ArrayLike | Motion | None,
    ) -> Scene:
        """Return the scene in one state: see `Evaluator.scene_at`."""
        changes: dict[str, Any] = {}
        if q is not None:
            changes["hand"] = self.hand_at(q)
        if T_world_object is not None:
            changes["object"] = self.scene.object.with_pose(T_world_object)
        if twist is not None:
            changes["motion"] = (
                twist if isinstance(twist, Motion) else Motion(finite_array("twist", twist, (6,)))
            )
        scene = self.scene.with_changes(**changes)
        return scene if self.pins is None else _with_pinned_contacts(scene, self.pins)

    def _named_positions(self, q: Mapping[str, float]) -> dict[str, float]:
        known = () if self._hand is None else self._hand.joint_names
        for name in q:
            if name not in known:
                raise unknown_name("q", "joint", name, known)
        values = finite_array("q", list(q.values()), (len(q),)).tolist()
        return dict(zip(q, values, strict=True))

    def _position_array(self, q: ArrayLike) -> FloatArray:
        shape = (len(self.joint_names),)
        if (
            isinstance(q, np.ndarray)
            and q.dtype == np.float64
            and q.shape == shape
            and math.isfinite(q @ q)  # a finite sum of squares has finite terms
        ):
            return q
        return finite_array("q", q, shape)


def _with_pinned_contacts(scene: Scene, pins: Sequence[Pin]) -> Scene:
    """Return a scene whose given contacts are those of the pins."""
    return scene.with_changes(given_contacts=[pinned_point(scene, pin).contact for pin in pins])


def without_joint_limits(scene: Scene) -> Scene:
    """Return a scene whose joints have no position limits."""
    hand = scene.hand
    if hand is None:
        return scene
    largest = np.full(len(hand.joint_names), np.finfo(float).max)
    tree = changed(hand.tree, tolerated_limits=(-largest, largest))
    return scene.with_changes(hand=changed(hand, tree=tree))
