"""What is asked of virtual motions, and the two answers: a witness or a conflict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from graspless_pin.problem.checks import FloatArray


class Requirement(NamedTuple):
    """What is asked of the virtual sliding at one selected contact.

    Attributes:
        contact: Index of the contact.
        signs: s_l1, s_l2 in {-1, 0, 1}; what 0 asks depends on the sign rule: under ``exact`` the
            component is zero; under ``strict`` and ``nonzero`` it is not looked at, and neither
            is, under ``nonzero``, whether the contact moves at all.
    """

    contact: int
    signs: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Conflict:
    """A proof that requirements exclude each other: a combination of them all but vanishes.

    Attributes:
        signs: (contact, component, sign) items that take part with a positive weight.
        contacts: Contacts that take part only by being selected (normal velocity zero, or
            tangential velocity zero under ``exact``).
        combination: (M, 3) weights of the contact velocities along n, t1, t2. Those of the items
            have their signs and a sum of 1 (under ``nonzero``: the smaller of each contact's two);
            the part of them that any motion can see is shorter than the threshold, so no motion of
            unit contact velocities slides as fast as the threshold in all items.
    """

    signs: tuple[tuple[int, int, int], ...]
    contacts: tuple[int, ...]
    combination: FloatArray

    @property
    def involved(self) -> frozenset[int]:
        """All contacts that take part."""
        return frozenset([*self.contacts, *(contact for contact, _, _ in self.signs)])


@dataclass(frozen=True, eq=False)
class Blocked:
    """A proof that requirements let a selected contact slide neither way along one tangent.

    Attributes:
        contact: Index of the contact.
        component: 0 for t1, 1 for t2.
        conflicts: One for each sign that was left to the component.
    """

    contact: int
    component: int
    conflicts: tuple[Conflict, ...]

    @property
    def involved(self) -> frozenset[int]:
        """All contacts that take part."""
        return frozenset([self.contact]).union(*(one.involved for one in self.conflicts))


@dataclass(frozen=True, eq=False)
class Witness:
    """A virtual motion that meets the requirements.

    Attributes:
        coordinates: (r,) y of the motion, see `VirtualKinematics.scaled_motion`.
        velocities: (M, 3) relative velocity of the object at each contact along n, t1, t2, to
            scale. Those of the motion nudged within its slack in a fixed generic direction, so that
            a component that can move does not vanish by symmetry.
        slowest: The slowest required sliding over the length of all contact velocities; inf where
            nothing has to slide.
    """

    coordinates: FloatArray
    velocities: FloatArray
    slowest: float
