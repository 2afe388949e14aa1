"""Where a hand is in itself or in a support, or how far from it; no contact is meant there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.caching import Derived
from graspless_pin.compiled import core
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.contact.distances import least_gaps, near_solids, separation, solids_of
from graspless_pin.geometry.contact.finding import BodyKind
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.posed_links import posed_links
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.problem.checks import FloatArray


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

    Links of one robot are not compared if they are rigidly joined or neighbours at a joint, if an
    SRDF disables the pair (a file of the URDF's name beside it or in ``../srdf``), nor if they
    overlap when all joints are at zero (or at the limit nearest to it): collision shapes are often
    so wide that they do so for ever.

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
    bodies = hand.placed_bodies
    pairs = pairs_of(hand.tree)
    found: dict[tuple[str, str], float] = {}
    for i, j in pairs.within(bodies, tolerance):
        depth = _depth(bodies[i], bodies[j])
        if depth > tolerance:
            names = bodies[i].name, bodies[j].name
            found[names] = max(found.get(names, 0.0), depth)
    overlaps = [Overlap(*names, BodyKind.HAND, depth) for names, depth in found.items()]
    for support in supports:
        pieces = support.placed_bodies
        deepest: dict[str, float] = {}
        for i, k in pairs.beside(bodies, pieces, tolerance):
            depth = _depth(bodies[i], pieces[k])
            if depth > tolerance:
                deepest[bodies[i].name] = max(deepest.get(bodies[i].name, 0.0), depth)
        overlaps += [
            Overlap(link, support.name, BodyKind.SUPPORT, d) for link, d in deepest.items()
        ]
    return tuple(overlaps)


@dataclass(frozen=True, eq=False)
class LinkPairs:
    """The pairs of a hand's shapes that should not be in each other, and what finds those that may.

    Attributes:
        places: (i, j) of each pair among the shapes, i below j, in model order.
        loops: The same as compiled loops; None: nothing was compiled.
    """

    places: tuple[tuple[int, int], ...]
    loops: Any

    def within(self, bodies: PlacedBodies, depth: float) -> list[tuple[int, int]]:
        """Return the pairs that are not known to overlap by less than a depth.

        Args:
            bodies: The hand's shapes at a configuration.
            depth: m, not negative.
        """
        if self.loops is not None:
            return self.loops.within(bodies.poses, depth)
        solids = solids_of(bodies.shapes)
        near = set(near_solids(bodies, solids, bodies, solids, -depth))
        return [pair for pair in self.places if pair in near]

    def beside(
        self, bodies: PlacedBodies, pieces: PlacedBodies, depth: float
    ) -> list[tuple[int, int]]:
        """Return the pairs of a shape and a support's piece of which that is not known.

        Args:
            bodies: The hand's shapes at a configuration.
            pieces: The support's.
            depth: m, not negative.
        """
        solids = solids_of(pieces.shapes)
        if self.loops is not None:
            return self.loops.beside(bodies.poses, solids.for_loops, pieces.poses, depth)
        return sorted(near_solids(bodies, solids_of(bodies.shapes), pieces, solids, -depth))


def pairs_of(tree: KinematicTree) -> LinkPairs:
    """Return the pairs of a hand's shapes that `unwanted_overlaps` compares."""
    return _PAIRS.of(tree)


def _pairs(tree: KinematicTree) -> LinkPairs:
    parents = [int(parent) for parent in tree.pinocchio_model.parents]
    robot_of = {name: k for k, (names, _) in enumerate(tree.bases) for name in names}
    robots = [robot_of[link] for link in tree.shapes.names]
    joints = [item.joint for item in tree.geometries]
    apart, of_one_robot = [], []
    for j in range(len(joints)):
        for i in range(j):
            joined = joints[i] == joints[j] or joints[i] == parents[joints[j]]
            joined |= joints[j] == parents[joints[i]]
            if robots[i] != robots[j]:
                apart.append((i, j))
            elif not joined:
                of_one_robot.append((i, j))
    links = [frozenset((tree.shapes.names[i], tree.shapes.names[j])) for i, j in of_one_robot]
    neutral = tree.coupling.all_positions(np.clip(0.0, *tree.ranges))
    bodies = posed_links(tree, neutral).bodies
    all_of_them = _made(tree, of_one_robot)
    ever = tree.disabled_pairs | {
        frozenset((bodies[i].name, bodies[j].name))
        for i, j in all_of_them.within(bodies, 0.0)
        if _depth(bodies[i], bodies[j]) > 0.0
    }
    own = [pair for pair, names in zip(of_one_robot, links, strict=True) if names not in ever]
    return _made(tree, sorted([*apart, *own]))


def _made(tree: KinematicTree, places: Sequence[tuple[int, int]]) -> LinkPairs:
    loops = None
    if core is not None:
        sets = solids_of(tree.shapes).for_loops
        loops = core.BodyPairs(sets, [i for i, _ in places], [j for _, j in places])
    return LinkPairs(tuple(places), loops)


def _depth(first: CollisionBody, second: CollisionBody) -> float:
    """Return how deep two convex pieces overlap, zero if they do not."""
    return max(-separation(first, second).distance, 0.0)


_PAIRS: Derived[KinematicTree, LinkPairs] = Derived(_pairs)


class Clearance(NamedTuple):
    """The two bodies that are nearest to each other, or deepest in each other.

    Attributes:
        distance: Between them, m; negative: how far they must be moved to only touch.
        bodies: Their names; none, where nothing is compared and the distance infinite.
    """

    distance: float
    bodies: tuple[str, ...]


_NOTHING = Clearance(np.inf, ())


def least_clearance(
    hand: Hand | None, supports: Sequence[Support], moved: PlacedBodies, depth: float, gap: float
) -> Clearance:
    """Return the least distance of bodies that shall not touch.

    That is of links and supports, of the pairs of links that `unwanted_overlaps` compares, and of
    the object and supports that it does not touch. Links that no joint moves count only where they
    are too deep in a support, and so do links and the object.

    Args:
        hand: The hand at its configuration; None: there is none.
        supports: All supports.
        moved: The object's pieces; empty where it is not looked at.
        depth: Deepest overlap that passes for contact, m.
        gap: Largest gap that passes for contact, m.
    """
    least = _NOTHING
    for support in supports:
        own = _least(moved, support.placed_bodies, _NOTHING)
        if not -depth <= own.distance <= gap:
            least = min(least, own)
    if hand is None:
        return least
    links = hand.placed_bodies
    moves = hand.tree.shape_placements[0] > 0
    for support in supports:
        least = _least(links, support.placed_bodies, least, np.where(moves, np.inf, -depth))
    least = _least(links, moved, least, np.full(len(links), -depth))
    solids, places = solids_of(links.shapes), pairs_of(hand.tree).places
    if not places:
        return least
    first, second = np.array(places).T
    bounds = least_gaps(links, solids, links, solids)[second, first]
    for place in np.argsort(bounds, kind="stable").tolist():
        if bounds[place] >= least.distance:
            break
        least = min(least, _measured(links, links, *places[place]))
    return least


def _least(
    one: PlacedBodies, two: PlacedBodies, least: Clearance, below: FloatArray | float = np.inf
) -> Clearance:
    """Return the least clearance of two bodies, if it is less than one that is known.

    Args:
        one: The pieces of the first.
        two: Those of the second.
        least: What is known.
        below: Distances that do not count for a piece of the first, from which on, m.
    """
    if not len(one) or not len(two):
        return least
    bounds = least_gaps(one, solids_of(one.shapes), two, solids_of(two.shapes))
    bounds = np.where(bounds < below, bounds, np.inf)
    for place in np.argsort(bounds, axis=None, kind="stable").tolist():
        if bounds.flat[place] >= least.distance:
            break
        k, p = divmod(place, len(one))
        own = _measured(one, two, p, k)
        if own.distance < np.broadcast_to(below, len(one))[p]:
            least = min(least, own)
    return least


def _measured(one: PlacedBodies, two: PlacedBodies, p: int, k: int) -> Clearance:
    first, second = one[p], two[k]
    return Clearance(separation(first, second).distance, (first.name, second.name))
