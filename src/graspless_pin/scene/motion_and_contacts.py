"""What a scene is told of contacts and motion, and the contacts that it ends up with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.contact.contact_points import (
    BodyKind,
    ContactArrays,
    ContactPoint,
    support_velocities,
    velocities_at,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Brief


@dataclass(frozen=True, eq=False)
class GivenContact:
    """A contact that the scene states instead of having it found.

    See the example of `load_scene`.

    Attributes:
        body: Hand link or support.
        position: (3,) world frame, m.
        normal: (3,) unit, into the object, world axes.
    """

    body: str
    position: FloatArray
    normal: FloatArray


def given_arrays(given: Sequence[GivenContact], links: Sequence[str]) -> ContactArrays:
    """Return stated contacts as found ones are returned: those on hand links come first."""
    kinds = [BodyKind.HAND if contact.body in links else BodyKind.SUPPORT for contact in given]
    points = [
        ContactPoint(contact.body, kind, contact.position, contact.normal, 0.0)
        for contact, kind in zip(given, kinds, strict=True)
    ]
    return ContactArrays.of(sorted(points, key=lambda one: one.kind is BodyKind.SUPPORT))


@dataclass(frozen=True, eq=False)
class HandMotion:
    """The hand's own motion. See the example of `load_scene`.

    Attributes:
        base_twist: (6,) [v; omega], world axes, m/s and rad/s.
        joint_velocities: rad/s or m/s by joint name.
    """

    base_twist: FloatArray
    joint_velocities: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Motion:
    """The declared motion. See the example of `load_scene`.

    Attributes:
        object_twist: (6,) [v; omega] of the object about its centre of mass, world axes.
        hand: The hand's own motion; None: its contacts follow the object and stick.
    """

    object_twist: FloatArray
    hand: HandMotion | None = None


def body_velocities(
    touching: ContactArrays,
    moved: ManipulatedObject,
    hand: Hand | None,
    supports: Sequence[Support],
    motion: Motion,
    twist: FloatArray,
) -> FloatArray:
    """Return the velocities of what the object touches; hand contacts follow it by default.

    Args:
        touching: M contacts, hand first.
        moved: The object.
        hand: The hand, if there is one.
        supports: All supports; none if all stand still.
        motion: The declared motion.
        twist: (6,) the object's, checked.

    Returns:
        (M, 3) m/s, world axes.
    """
    count = touching.hand_count
    velocities = np.zeros((len(touching), 3))
    if supports:
        velocities = support_velocities(touching, supports)
    if motion.hand is None:
        velocities[:count] = velocities_at(
            twist, moved.center_of_mass_world, touching.positions[:count]
        )
    elif hand is not None:
        velocities[:count] = hand.point_velocities(
            touching.bodies[:count],
            touching.positions[:count],
            motion.hand.joint_velocities,
            motion.hand.base_twist,
        )
    return velocities


@dataclass(frozen=True, eq=False, repr=False)
class SceneContacts(Brief):
    """The contacts of a scene that carry force. See the example of `load_scene`.

    Attributes:
        arrays: M contacts, hand first.
        sliding: (M, 3) velocity of the object relative to the other body, zero where it sticks.
    """

    arrays: ContactArrays
    sliding: FloatArray

    @cached_property
    def points(self) -> tuple[ContactPoint, ...]:
        """The M contacts one by one."""
        return tuple(self.arrays)

    @property
    def bodies(self) -> tuple[str, ...]:
        """M names of the hand links and supports that touch the object."""
        return self.arrays.bodies
