"""Where a hand is in itself or in a support, or how far from it; no contact is meant there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.caching import Derived
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.geometry.contact.distances import deep_pairs, gap_lower_bounds, separation
from graspless_pin.geometry.hand.configuration import posed_links
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.problem.checks import FloatArray, read_only, real_number


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
    tolerance = real_number("tolerance", tolerance, 0.0)
    links = hand.placed_bodies
    compared = [(BodyKind.HAND, links, pairs_of(hand.tree))]
    for pieces in (support.placed_bodies for support in supports):
        every = np.indices((len(links), len(pieces))).reshape(2, -1).T
        compared.append((BodyKind.SUPPORT, pieces, every))
    return tuple(
        Overlap(*names, kind, depth)
        for kind, others, pairs in compared
        for names, depth in _deepest(links, others, pairs, tolerance).items()
    )


def _deepest(
    one: PlacedBodies, two: PlacedBodies, pairs: NDArray[np.intp], tolerance: float
) -> dict[tuple[str, str], float]:
    """Return how deep bodies are in others, by their names, if by more than a tolerance, m.

    Args:
        one: Bodies, no half-spaces.
        two: Others.
        pairs: (P, 2) indices into both, of those that are compared.
        tolerance: m, not negative.
    """
    found: dict[tuple[str, str], float] = {}
    for i, k in deep_pairs(one, two, pairs, tolerance).tolist():
        depth = -separation(one[i], two[k]).distance
        if depth > tolerance:
            names = one[i].name, two[k].name
            found[names] = max(found.get(names, 0.0), depth)
    return found


@Derived
def pairs_of(tree: KinematicTree) -> NDArray[np.intp]:
    """Return the (P, 2) pairs of a hand's shapes that `unwanted_overlaps` compares, i below j."""
    parents = [int(parent) for parent in tree.pinocchio_model.parents]
    robots = [tree.mount_of[link] for link in tree.shapes.names]
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
    rows = np.array(of_one_robot, dtype=np.intp).reshape(-1, 2)
    ever = tree.disabled_pairs | {frozenset(names) for names in _deepest(bodies, bodies, rows, 0.0)}
    own = [pair for pair, names in zip(of_one_robot, links, strict=True) if names not in ever]
    return read_only(np.array(sorted([*apart, *own]), dtype=np.intp).reshape(-1, 2))


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
        own = lesser_clearance(moved, support.placed_bodies, _NOTHING)
        if not -depth <= own.distance <= gap:
            least = min(least, own)
    if hand is None:
        return least
    links = hand.placed_bodies
    moves = hand.tree.shape_placements[0] > 0
    for support in supports:
        least = lesser_clearance(
            links, support.placed_bodies, least, np.where(moves, np.inf, -depth)
        )
    least = lesser_clearance(links, moved, least, np.full(len(links), -depth))
    pairs = pairs_of(hand.tree)
    bounds = gap_lower_bounds(links, links)[pairs[:, 1], pairs[:, 0]]
    for place in np.argsort(bounds, kind="stable").tolist():
        if bounds[place] >= least.distance:
            break
        least = min(least, _measured(links, links, *pairs[place].tolist()))
    return least


def lesser_clearance(
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
    bounds = gap_lower_bounds(one, two)
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
