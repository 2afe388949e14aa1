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

from graspless_pin.errors import StateError, StateFault
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.poses import turning_velocities
from graspless_pin.problem.checks import FloatArray, check_known, read_only, squared_lengths
from graspless_pin.records import Brief, Record


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
class ContactArrays(Brief, Record, Sequence[ContactPoint]):
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
        return ContactArrays(
            self.bodies + others.bodies,
            self.kinds + others.kinds,
            np.concatenate((self.positions, others.positions)),
            np.concatenate((self.normals, others.normals)),
            self.distances + others.distances,
        )


SPEED_TOLERANCE = 1e-3
"""Speeds below this share of the fastest are zero: motions are typed in with a few digits."""


def velocities_at(twist: FloatArray, center: FloatArray, points: FloatArray) -> FloatArray:
    """Return the velocities v + omega x (p - c) of a rigid body's points.

    Args:
        twist: (6,) [v; omega] about ``center`` in world axes, m/s and rad/s.
        center: (3,) world frame, m.
        points: (M, 3) world frame, m.

    Returns:
        (M, 3) world axes, m/s.
    """
    return twist[:3] + turning_velocities(twist[3:], points - center)


def support_velocities(contacts: Sequence[ContactPoint], supports: Sequence[Support]) -> FloatArray:
    """Return the velocities of the supports at the contacts.

    Args:
        contacts: M contacts; those of the hand get zeros.
        supports: All supports that contacts name.

    Returns:
        (M, 3) velocity of the support's material point at each contact, world axes, m/s.

    Raises:
        ArgumentError: A contact names a support that is not there.
    """
    by_name = {support.name: support for support in supports}
    touching = ContactArrays.of(contacts)
    velocities = np.zeros((len(touching), 3))
    rows: dict[str, list[int]] = {}
    for k, (body, kind) in enumerate(zip(touching.bodies, touching.kinds, strict=True)):
        if kind is BodyKind.SUPPORT:
            rows.setdefault(body, []).append(k)
    check_known("supports", "support", rows, by_name)
    for name, own in rows.items():
        support = by_name[name]
        if support.is_moving:
            velocities[own] = velocities_at(
                support.velocity, support.T_world_support[:3, 3], touching.positions[own]
            )
    return velocities


def contacts_that_stay(
    contacts: Sequence[ContactPoint],
    twist: FloatArray,
    center: FloatArray,
    body_velocities: FloatArray,
    object_name: str,
) -> tuple[list[int], FloatArray]:
    """Tell at which contacts the object stays under a motion, and how it slides there.

    With u = v_object - v_body at the contact and n into the object, the contact separates for n .
    u > 0, penetrates for n . u < 0 and slides with u - (n . u) n. Where u = 0 it sticks, and the
    bodies may roll on each other.

    Args:
        contacts: M contacts.
        twist: (6,) [v; omega] of the object about its centre of mass, world axes, m/s and rad/s.
        center: (3,) the object's centre of mass, world frame, m.
        body_velocities: (M, 3) velocity of the other body's material point at each contact, world
            axes, m/s.
        object_name: What messages call the object.

    Returns:
        The indices of the contacts that do not separate, and (M, 3) read-only tangential velocity
        of the object relative to the other body at all, world axes, m/s; zero rows where a contact
        does not slide.

    Raises:
        StateError: The motion drives the object into another body.
    """
    touching = ContactArrays.of(contacts)
    # The object's own parts of speed, not their sum: at a pivot they cancel, and what is left
    # there is nothing.
    linear, spin = math.hypot(*twist[:3].tolist()), math.hypot(*twist[3:].tolist())
    fastest = max(linear, spin * _longest(touching.positions - center), _longest(body_velocities))
    threshold = SPEED_TOLERANCE * fastest
    relative = velocities_at(twist, center, touching.positions) - body_velocities
    leaving = np.einsum("ij,ij->i", relative, touching.normals)
    worst: dict[tuple[BodyKind, str], float] = {}
    for k in np.flatnonzero(leaving < -threshold).tolist():
        key = (touching.kinds[k], touching.bodies[k])
        worst[key] = max(worst.get(key, 0.0), -float(leaving[k]))
    if worst:
        hits = ", ".join(
            f"{'hand link' if kind is BodyKind.HAND else 'support'} '{body}' at {speed:.3g} m/s"
            for (kind, body), speed in worst.items()
        )
        raise StateError(
            StateFault.BLOCKED,
            f"the declared motion drives object '{object_name}' into {hits}; "
            "change the object's twist or the motion of what it runs into",
        )
    sliding = relative - leaving[:, None] * touching.normals
    slides = np.sqrt(squared_lengths(sliding)) > threshold
    sliding[~slides | (leaving > threshold)] = 0.0
    return np.flatnonzero(leaving <= threshold).tolist(), read_only(sliding)


def _longest(vectors: FloatArray) -> float:
    """Length of the longest row, 0 without any."""
    return float(np.sqrt(squared_lengths(vectors)).max(initial=0.0))
