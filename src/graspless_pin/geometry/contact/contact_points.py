"""Contacts as records and, many at once, as arrays; and what a declared motion does at each.

There the object sticks, slides, parts or penetrates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError, StateError, StateFault
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.poses import turning_velocities
from graspless_pin.problem.checks import (
    FloatArray,
    finite_array,
    read_only,
    squared_lengths,
)
from graspless_pin.records import Brief, unchecked


class BodyKind(Enum):
    """What touches the object. See the example of `place_fingertips`."""

    HAND = "hand"
    SUPPORT = "support"


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One point at which something touches the object.

    See the example of `place_fingertips`.

    Attributes:
        body: Name of the hand link or support.
        kind: Which of the two it is.
        position: (3,) read-only point midway between the two surfaces, world frame, m.
        normal: (3,) read-only unit vector into the object, world axes.
        distance: Gap between the surfaces along the normal, negative where they overlap, m.
    """

    body: str
    kind: BodyKind
    position: FloatArray
    normal: FloatArray
    distance: float

    def __post_init__(self) -> None:
        """Make the arrays read-only copies."""
        for field in ("position", "normal"):
            array = getattr(self, field)
            if not isinstance(array, np.ndarray) or array.flags.writeable:
                object.__setattr__(self, field, read_only(np.array(array, dtype=float)))


@dataclass(frozen=True, eq=False, repr=False)
class ContactArrays(Brief, Sequence[ContactPoint]):
    """M contacts as arrays; a contact is made when it is asked for.

    Attributes:
        bodies: M names of hand links and supports.
        kinds: M kinds of these bodies.
        positions: (M, 3) read-only, world frame, m.
        normals: (M, 3) read-only unit vectors into the object, world axes.
        distances: M gaps, m.
    """

    bodies: tuple[str, ...]
    kinds: tuple[BodyKind, ...]
    positions: FloatArray
    normals: FloatArray
    distances: tuple[float, ...]

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        self.positions.setflags(write=False)
        self.normals.setflags(write=False)

    @classmethod
    def of(cls, contacts: Sequence[ContactPoint]) -> ContactArrays:
        """Take contacts that are given one by one; arrays are returned as they are."""
        if isinstance(contacts, ContactArrays):
            return contacts
        return cls(
            tuple(contact.body for contact in contacts),
            tuple(contact.kind for contact in contacts),
            np.array([contact.position for contact in contacts], dtype=float).reshape(-1, 3),
            np.array([contact.normal for contact in contacts], dtype=float).reshape(-1, 3),
            tuple(contact.distance for contact in contacts),
        )

    @classmethod
    def of_own(
        cls,
        bodies: tuple[str, ...],
        kinds: tuple[BodyKind, ...],
        positions: FloatArray,
        normals: FloatArray,
        distances: tuple[float, ...],
    ) -> ContactArrays:
        """Do what the constructor does in a third of its time."""
        return unchecked(
            cls,
            bodies=bodies,
            kinds=kinds,
            positions=read_only(positions),
            normals=read_only(normals),
            distances=distances,
        )

    @property
    def hand_count(self) -> int:
        """How many are on hand links."""
        return self.kinds.count(BodyKind.HAND)

    def __len__(self) -> int:
        """M."""
        return len(self.bodies)

    @overload
    def __getitem__(self, index: int) -> ContactPoint: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[ContactPoint, ...]: ...
    def __getitem__(self, index: int | slice) -> ContactPoint | tuple[ContactPoint, ...]:
        """One contact, or some."""
        if isinstance(index, slice):
            return tuple([self[k] for k in range(*index.indices(len(self)))])
        return ContactPoint(
            self.bodies[index],
            self.kinds[index],
            self.positions[index],
            self.normals[index],
            self.distances[index],
        )

    def chosen(self, rows: Sequence[int]) -> ContactArrays:
        """Return the contacts at some indices."""
        return ContactArrays(
            tuple([self.bodies[k] for k in rows]),
            tuple([self.kinds[k] for k in rows]),
            self.positions[rows],
            self.normals[rows],
            tuple([self.distances[k] for k in rows]),
        )

    def followed_by(self, others: ContactArrays) -> ContactArrays:
        """Return these contacts and then the others."""
        return self.of_own(
            self.bodies + others.bodies,
            self.kinds + others.kinds,
            np.concatenate((self.positions, others.positions)),
            np.concatenate((self.normals, others.normals)),
            self.distances + others.distances,
        )


SPEED_TOLERANCE = 1e-3
"""Speeds below this share of the fastest are zero: motions are typed in with a few digits."""


class ContactMotion(Enum):
    """What the two surfaces do at a contact.

    A rolling contact is a sticking one about which the bodies turn relative to each other, other
    than about the normal: a ball on a table, a fingertip on a face, an edge that a box tips over.
    """

    STICKING = "sticking"
    ROLLING = "rolling"
    SLIDING = "sliding"
    SEPARATING = "separating"
    PENETRATING = "penetrating"

    @property
    def sticks(self) -> bool:
        """Whether the points that touch move alike: sticking or rolling."""
        return self in (ContactMotion.STICKING, ContactMotion.ROLLING)


_STATES = tuple(ContactMotion)
_SLIDES, _PARTS, _PENETRATES = 2, 3, 4


@dataclass(frozen=True, eq=False)
class ClassifiedMotion:
    """The motion at each of M contacts.

    Attributes:
        states: M states.
        sliding: (M, 3) read-only tangential velocity of the object relative to the other body,
            world axes, m/s; zero rows where the contact does not slide.
        normal_speeds: (M,) read-only speed at which the object leaves the other body, m/s.
    """

    states: tuple[ContactMotion, ...]
    sliding: FloatArray
    normal_speeds: FloatArray


def twist_velocities(twist: ArrayLike, center: ArrayLike, points: ArrayLike) -> FloatArray:
    """Velocities v + omega x (p - c) of a rigid body's points.

    Args:
        twist: (6,) [v; omega] about ``center`` in world axes, m/s and rad/s.
        center: (3,) world frame, m.
        points: (M, 3) world frame, m.

    Returns:
        (M, 3) world axes, m/s.

    Raises:
        ArgumentError: A shape is wrong or a number is not finite.
    """
    motion = checked_twist("twist", twist)
    origin = finite_array("center", center, (3,))
    return velocities_at(motion, origin, np.asarray(points, dtype=float).reshape(-1, 3))


def velocities_at(twist: FloatArray, center: FloatArray, points: FloatArray) -> FloatArray:
    """Do what `twist_velocities` does for arrays that need no check."""
    return twist[:3] + turning_velocities(twist[3:], points - center)


def checked_twist(name: str, twist: ArrayLike) -> FloatArray:
    """Return a twist (6,) as an array.

    Raises:
        ArgumentError: The shape is wrong or a number is not finite.
    """
    return finite_array(name, twist, (6,))


def support_velocities(
    contacts: Sequence[ContactPoint], supports: Sequence[Support]
) -> tuple[FloatArray, FloatArray]:
    """Velocities of the supports at the contacts.

    Args:
        contacts: M contacts; those of the hand get zeros.
        supports: All supports that contacts name.

    Returns:
        (M, 3) velocity of the support's material point at each contact (m/s) and (M, 3) angular
        velocity of the support (rad/s), world axes.

    Raises:
        ArgumentError: A contact names a support that is not there.
    """
    by_name = {support.name: support for support in supports}
    touching = ContactArrays.of(contacts)
    linear, angular = np.zeros((len(touching), 3)), np.zeros((len(touching), 3))
    rows: dict[str, list[int]] = {}
    for k, (body, kind) in enumerate(zip(touching.bodies, touching.kinds, strict=True)):
        if kind is BodyKind.SUPPORT:
            rows.setdefault(body, []).append(k)
    for name, own in rows.items():
        support = by_name.get(name)
        if support is None:
            known = ", ".join(f"'{name}'" for name in by_name) or "none"
            raise ArgumentError("supports", f"has no support '{name}'; known: {known}")
        if support.is_moving:
            linear[own] = twist_velocities(
                support.velocity, support.T_world_support[:3, 3], touching.positions[own]
            )
            angular[own] = support.velocity[3:]
    return linear, angular


def classify_motion(
    contacts: Sequence[ContactPoint],
    object_twist: ArrayLike,
    center_of_mass: ArrayLike,
    body_velocities: ArrayLike | None = None,
    body_angular_velocities: ArrayLike | None = None,
    *,
    speed_tolerance: float = SPEED_TOLERANCE,
) -> ClassifiedMotion:
    """Tell what each contact does under the motion of the object and of the bodies that it touches.

    With u = v_object - v_body at the contact and n into the object, the contact separates for n .
    u > 0, penetrates for n . u < 0 and slides with u - (n . u) n. For u = 0 it rolls if the bodies'
    relative angular velocity has a part across n, and sticks if not.

    Args:
        contacts: M contacts.
        object_twist: (6,) [v; omega] of the object about its centre of mass, world axes, m/s and
            rad/s.
        center_of_mass: (3,) of the object, world frame, m.
        body_velocities: (M, 3) velocity of the other body's material point at each contact, world
            axes, m/s; None if all are at rest.
        body_angular_velocities: (M, 3) of those bodies, world axes, rad/s; None if none turns.
        speed_tolerance: Share of the fastest speed at hand below which a speed is zero, likewise
            of angular speeds.

    Returns:
        State and sliding velocity per contact, in their order.

    Raises:
        ArgumentError: A shape is wrong or a number is not finite.
    """
    count = len(contacts)
    touching = ContactArrays.of(contacts)
    twist = checked_twist("object_twist", object_twist)
    center = finite_array("center_of_mass", center_of_mass, (3,))
    others, turning = np.zeros((count, 3)), None
    if body_velocities is not None:
        others = finite_array("body_velocities", body_velocities, (count, 3))
    if body_angular_velocities is not None:
        turning = finite_array("body_angular_velocities", body_angular_velocities, (count, 3))
    return classified(touching, twist, center, others, turning, speed_tolerance)


def classified(
    touching: ContactArrays,
    twist: FloatArray,
    center: FloatArray,
    others: FloatArray,
    turning: FloatArray | None = None,
    speed_tolerance: float = SPEED_TOLERANCE,
) -> ClassifiedMotion:
    """Do what `classify_motion` does for arrays that need no check."""
    numbers, sliding, leaving = _motion_states(
        touching.positions, touching.normals, twist, center, others, turning, speed_tolerance
    )
    states = tuple([_STATES[number] for number in numbers])
    return ClassifiedMotion(states, read_only(sliding), read_only(leaving))


def _motion_states(
    points: FloatArray,
    normals: FloatArray,
    twist: FloatArray,
    center: FloatArray,
    others: FloatArray,
    turning: FloatArray | None,
    tolerance: float,
) -> tuple[list[int], FloatArray, FloatArray]:
    """Numbers among `_STATES`, sliding velocities, and normal speeds; see `classify_motion`."""
    # The object's own parts of speed, not their sum: at a pivot they cancel, and what is left
    # there is nothing.
    arms = points - center
    linear, spin = math.hypot(*twist[:3].tolist()), math.hypot(*twist[3:].tolist())
    fastest = max(linear, spin * _longest(arms), _longest(others))
    fastest_turn = max(spin, 0.0 if turning is None else _longest(turning))
    threshold, slow_turn = tolerance * fastest, tolerance * fastest_turn
    relative = twist[:3] + turning_velocities(twist[3:], arms) - others
    leaving, sliding = _split(relative, normals)
    spins = np.zeros_like(arms) + twist[3:] if turning is None else twist[3:] - turning
    _, rolling = _split(spins, normals)
    slides, rolls = (np.sqrt(squared_lengths(part)) for part in (sliding, rolling))
    states = np.where(slides > threshold, _SLIDES, rolls > slow_turn)
    states = np.where(leaving > threshold, _PARTS, states)
    states = np.where(leaving < -threshold, _PENETRATES, states)
    sliding[states != _SLIDES] = 0.0
    return states.tolist(), sliding, leaving


def contacts_that_stay(
    contacts: Sequence[ContactPoint], motion: ClassifiedMotion, object_name: str
) -> list[int]:
    """Return the indices of the contacts that do not part.

    Raises:
        StateError: The motion drives the object into another body.
    """
    if ContactMotion.PENETRATING in motion.states:
        touching = ContactArrays.of(contacts)
        worst: dict[tuple[BodyKind, str], float] = {}
        for k, state in enumerate(motion.states):
            if state is ContactMotion.PENETRATING:
                key = (touching.kinds[k], touching.bodies[k])
                worst[key] = max(worst.get(key, 0.0), -float(motion.normal_speeds[k]))
        hits = ", ".join(
            f"{'hand link' if kind is BodyKind.HAND else 'support'} '{body}' at {speed:.3g} m/s"
            for (kind, body), speed in worst.items()
        )
        raise StateError(
            StateFault.BLOCKED,
            f"the declared motion drives object '{object_name}' into {hits}; "
            "change the object's twist or the motion of what it runs into",
        )
    if ContactMotion.SEPARATING not in motion.states:
        return list(range(len(motion.states)))
    return [k for k, state in enumerate(motion.states) if state is not ContactMotion.SEPARATING]


def _split(vectors: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (M,) the parts of vectors along normals, and (M, 3) what is left of them."""
    along = np.einsum("ij,ij->i", vectors, normals)
    return along, vectors - along[:, None] * normals


def _longest(vectors: FloatArray) -> float:
    """Length of the longest row, 0 without any."""
    return float(np.sqrt(squared_lengths(vectors)).max(initial=0.0))
