"""Contacts as records and, many at once, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import overload

import numpy as np

from graspless_pin.problem.checks import FloatArray, read_only
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

    def positions_about(self, point: FloatArray) -> FloatArray:
        """Return the (M, 3) positions seen from a point (3,), m."""
        return self.positions - point

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
            _stacked(self.positions, others.positions),
            _stacked(self.normals, others.normals),
            self.distances + others.distances,
        )


def _stacked(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the rows of two (K, 3) arrays."""
    return np.concatenate((first, second))
