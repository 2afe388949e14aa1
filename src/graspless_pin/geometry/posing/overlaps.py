"""Where a hand is in itself or in a support, which no contact is meant to be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.contact.broad_phase import near_pairs
from graspless_pin.geometry.contact.distances import separation
from graspless_pin.geometry.contact.finding import BodyKind
from graspless_pin.geometry.hand.model import Hand


@dataclass(frozen=True)
class Overlap:
    """Two bodies that are in each other. See the example of `unwanted_overlaps`.

    Attributes:
        link: A hand link.
        other: Another link of the hand, or a support.
        kind: Whether ``other`` is of the hand too, or a support.
        depth: How far they must be moved to only touch, m; of bodies in several convex pieces, as
            far as the deepest pair of pieces tells.
    """

    link: str
    other: str
    kind: BodyKind
    depth: float

    def __str__(self) -> str:
        """One line for a message."""
        what = "support" if self.kind is BodyKind.SUPPORT else "hand link"
        depth = f"{self.depth * 1e3:.2f} mm"
        return f"hand link '{self.link}' and {what} '{self.other}' overlap by {depth}"


def unwanted_overlaps(
    hand: Hand, supports: Sequence[Support] = (), *, tolerance: float = 1e-4
) -> tuple[Overlap, ...]:
    """Find where a hand overlaps itself or a support.

    Links of one robot are not compared if they are rigidly joined or neighbours at a joint, nor if
    they overlap when all joints are at zero (or at the limit nearest to it): collision shapes are
    often so wide that they do so for ever.

    Args:
        hand: The hand at its configuration.
        supports: What it should stay out of.
        tolerance: Overlap up to which bodies count as touching only, m.

    Returns:
        Self-overlaps, then those with supports, each in model order.

    Raises:
        ArgumentError: If ``tolerance`` is negative or not finite.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.geometry import unwanted_overlaps
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> unwanted_overlaps(scene.hand, scene.supports)
        ()
    """
    if not (np.isfinite(tolerance) and tolerance >= 0.0):
        raise ArgumentError("tolerance", f"needs zero or more metres, got {tolerance!r}")
    bodies = hand.collision_bodies()
    found: dict[tuple[str, str], float] = {}
    at_neutral: tuple[CollisionBody, ...] = ()
    ignored: set[tuple[str, str]] = set()
    for i, j in _pairs(hand, bodies):
        depth = _depth(bodies[i], bodies[j])
        if depth <= tolerance:
            continue
        pair = (bodies[i].name, bodies[j].name)
        if _mount(hand, pair[0]) == _mount(hand, pair[1]):
            at_neutral = at_neutral or _neutral(hand).collision_bodies()
            if _depth(at_neutral[i], at_neutral[j]) > 0.0:
                ignored.add(pair)
        found[pair] = max(found.get(pair, 0.0), depth)
    overlaps = [Overlap(*pair, BodyKind.HAND, found[pair]) for pair in found if pair not in ignored]
    for support in supports:
        pieces = support.collision_bodies()
        deepest: dict[str, float] = {}
        for i, k in sorted(near_pairs(bodies, pieces, 0.0)):
            depth = _depth(bodies[i], pieces[k])
            if depth > tolerance:
                deepest[bodies[i].name] = max(deepest.get(bodies[i].name, 0.0), depth)
        overlaps += [
            Overlap(link, support.name, BodyKind.SUPPORT, d) for link, d in deepest.items()
        ]
    return tuple(overlaps)


def _pairs(hand: Hand, bodies: Sequence[CollisionBody]) -> Iterator[tuple[int, int]]:
    """Shapes that may meet: not rigidly joined or neighbours, unless of two robots."""
    parents = [int(parent) for parent in hand.tree.pinocchio_model.parents]
    for i, j in sorted(near_pairs(bodies, bodies, 0.0)):
        if i >= j:
            continue
        first, second = hand.tree.geometries[i], hand.tree.geometries[j]
        joined = (
            first.joint == second.joint
            or parents[second.joint] == first.joint
            or parents[first.joint] == second.joint
        )
        if not joined or _mount(hand, first.link) != _mount(hand, second.link):
            yield i, j


def _mount(hand: Hand, link: str) -> str:
    """Return the prefix of the robot that a link belongs to."""
    return max((prefix for prefix in hand.base_poses if link.startswith(prefix)), key=len)


def _neutral(hand: Hand) -> Hand:
    tree = hand.tree
    rest = np.clip(0.0, tree.lower, tree.upper)
    return hand.with_configuration(
        {hand.joint_names[index]: float(rest[index]) for index in tree.coupling.leaders}
    )


def _depth(first: CollisionBody, second: CollisionBody) -> float:
    """Return how deep two convex pieces overlap, zero if they do not."""
    return max(-separation(first, second).distance, 0.0)
