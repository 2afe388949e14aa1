"""Contacts as records and as arrays, and the effect of a declared motion at each contact.

At a contact the object sticks, slides, separates or penetrates.
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
    """The kind of body that touches the object. See the example of `place_fingertips`."""

    HAND = "hand"
    SUPPORT = "support"


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """A point at which a hand link or support touches the object.

    See the example of `place_fingertips`.

    Attributes:
        body: Name of the hand link or support.
        kind: Whether the body is a hand link or a support.
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
        """Store the arrays as read-only copies."""
        for field in ("position", "normal"):
            array = getattr(self, field)
            if not isinstance(array, np.ndarray) or array.flags.writeable:
                object.__setattr__(self, field, read_only(np.array(array, dtype=float)))


@dataclass(frozen=True, eq=False, repr=False)
class ContactArrays(Brief, Record, Sequence[ContactPoint]):
    """M contacts as arrays; a `ContactPoint` is made on access.

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
        """Return contacts given one by one as arrays; arrays are returned as they are."""
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
        """Number of contacts on hand links."""
        return self.kinds.count(BodyKind.HAND)

    def __len__(self) -> int:
        """Return the number of contacts."""
        return len(self.bodies)

    @overload
    def __getitem__(self, index: int) -> ContactPoint: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[ContactPoint, ...]: ...
    def __getitem__(self, index: int | slice) -> ContactPoint | tuple[ContactPoint, ...]:
        """Return one contact, or a tuple of a slice."""
        if isinstance(index, slice):
            return tuple([self[k] for k in range(*index.indices(len(self)))])
        return ContactPoint(
            self.bodies[index],
            self.kinds[index],
            self.positions[index],
            self.normals[index],
            self.distances[index],
        )

    def at_indices(self, rows: Sequence[int]) -> ContactArrays:
        """Return the contacts at given indices."""
        return ContactArrays(
            tuple([self.bodies[k] for k in rows]),
            tuple([self.kinds[k] for k in rows]),
            self.positions[rows],
            self.normals[rows],
            tuple([self.distances[k] for k in rows]),
        )

    def followed_by(self, others: ContactArrays) -> ContactArrays:
        """Return these contacts followed by others."""
        return ContactArrays(
            self.bodies + others.bodies,
            self.kinds + others.kinds,
            np.concatenate((self.positions, others.positions)),
            np.concatenate((self.normals, others.normals)),
            self.distances + others.distances,
        )


SPEED_TOLERANCE = 1e-3
"""Speeds below this share of the largest count as zero: motions are stated with few digits."""


def velocities_at(twist: FloatArray, center: FloatArray, points: FloatArray) -> FloatArray:
    """Return the velocities v + omega x (p - c) of points of a rigid body.

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
        contacts: M contacts; contacts on the hand have zero velocity.
        supports: All supports that contacts name.

    Returns:
        (M, 3) velocity of the support's material point at each contact, world axes, m/s.

    Raises:
        ArgumentError: A contact names an unknown support.
    """
    by_name = {support.name: support for support in supports}
    touching = ContactArrays.of(contacts)
    velocities = np.zeros((len(touching), 3))
    rows: dict[str, list[int]] = {}
    for k, (body, kind) in enumerate(zip(touching.bodies, touching.kinds, strict=True)):
        if kind is BodyKind.SUPPORT:
            rows.setdefault(body, []).append(k)
    check_known("supports", "support", rows, by_name)
    for name, indices in rows.items():
        support = by_name[name]
        if support.is_moving:
            velocities[indices] = velocities_at(
                support.velocity, support.T_world_support[:3, 3], touching.positions[indices]
            )
    return velocities


def contacts_that_stay(
    contacts: Sequence[ContactPoint],
    twist: FloatArray,
    center: FloatArray,
    body_velocities: FloatArray,
    object_name: str,
) -> tuple[list[int], FloatArray]:
    """Return the contacts that a motion does not separate, and the sliding velocities.

    With u = v_object - v_body at the contact and n into the object, the contact separates for
    n . u > 0, penetrates for n . u < 0 and slides with u - (n . u) n. For u = 0 it sticks, and the
    bodies may roll on each other.

    Args:
        contacts: M contacts.
        twist: (6,) [v; omega] of the object about its centre of mass, world axes, m/s and rad/s.
        center: (3,) the object's centre of mass, world frame, m.
        body_velocities: (M, 3) velocity of the other body's material point at each contact, world
            axes, m/s.
        object_name: Name of the object in messages.

    Returns:
        The indices of the contacts that do not separate, and (M, 3) read-only tangential velocity
        of the object relative to the other body at all contacts, world axes, m/s; a row is zero if
        its contact does not slide.

    Raises:
        StateError: The motion drives the object into another body.
    """
    touching = ContactArrays.of(contacts)
    # The linear and the angular part of the speed separately: at a pivot their sum vanishes.
    linear, spin = math.hypot(*twist[:3].tolist()), math.hypot(*twist[3:].tolist())
    fastest = max(linear, spin * _max_norm(touching.positions - center), _max_norm(body_velocities))
    threshold = SPEED_TOLERANCE * fastest
    relative = velocities_at(twist, center, touching.positions) - body_velocities
    normal_speeds = np.einsum("ij,ij->i", relative, touching.normals)
    penetration_speeds: dict[tuple[BodyKind, str], float] = {}
    for k in np.flatnonzero(normal_speeds < -threshold).tolist():
        key = (touching.kinds[k], touching.bodies[k])
        penetration_speeds[key] = max(penetration_speeds.get(key, 0.0), -float(normal_speeds[k]))
    if penetration_speeds:
        words = ", ".join(
            f"{'hand link' if kind is BodyKind.HAND else 'support'} '{body}' at {speed:.3g} m/s"
            for (kind, body), speed in penetration_speeds.items()
        )
        raise StateError(
            StateFault.BLOCKED,
            f"the declared motion drives object '{object_name}' into {words}; "
            "change the object's twist or the motion of what it runs into",
        )
    sliding = relative - normal_speeds[:, None] * touching.normals
    is_sliding = np.sqrt(squared_lengths(sliding)) > threshold
    sliding[~is_sliding | (normal_speeds > threshold)] = 0.0
    return np.flatnonzero(normal_speeds <= threshold).tolist(), read_only(sliding)


def _max_norm(vectors: FloatArray) -> float:
    """Return the largest norm of the rows, 0 without any."""
    return float(np.sqrt(squared_lengths(vectors)).max(initial=0.0))
