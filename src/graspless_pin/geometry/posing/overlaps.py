"""Unwanted overlaps of a hand with itself or a support, and clearances between such bodies."""

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
    """Two overlapping bodies. See the example of `unwanted_overlaps`.

    Attributes:
        link: A hand link.
        other: Another link of the hand, or a support.
        kind: Whether ``other`` is a hand link or a support.
        depth: Distance by which they must be moved to only touch, m; of bodies in several convex
            pieces, that of the deepest pair of pieces.
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
    so wide that they overlap in all configurations.

    Args:
        hand: The hand at its configuration.
        supports: The supports that it must not overlap.
        tolerance: Largest overlap of bodies that count as only touching, m.

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
    compared = [(BodyKind.HAND, links, overlap_pairs(hand.tree))]
    for pieces in (support.placed_bodies for support in supports):
        all_pairs = np.indices((len(links), len(pieces))).reshape(2, -1).T
        compared.append((BodyKind.SUPPORT, pieces, all_pairs))
    return tuple(
        Overlap(*names, kind, depth)
        for kind, others, pairs in compared
        for names, depth in _deepest_overlaps(links, others, pairs, tolerance).items()
    )


def _deepest_overlaps(
    bodies: PlacedBodies, others: PlacedBodies, pairs: NDArray[np.intp], tolerance: float
) -> dict[tuple[str, str], float]:
    """Return the largest overlap above a tolerance of each two bodies, by their names, m.

    Args:
        bodies: Bodies, no half-spaces.
        others: Other bodies.
        pairs: (P, 2) indices into both: the pairs that are compared.
        tolerance: m, not negative.
    """
    overlaps: dict[tuple[str, str], float] = {}
    for i, k in deep_pairs(bodies, others, pairs, tolerance).tolist():
        depth = -separation(bodies[i], others[k]).distance
        if depth > tolerance:
            names = bodies[i].name, others[k].name
            overlaps[names] = max(overlaps.get(names, 0.0), depth)
    return overlaps


@Derived
def overlap_pairs(tree: KinematicTree) -> NDArray[np.intp]:
    """Return the (P, 2) pairs of a hand's shapes that `unwanted_overlaps` compares, i below j."""
    parents = [int(parent) for parent in tree.pinocchio_model.parents]
    robots = [tree.mount_of[link] for link in tree.shapes.names]
    joints = [item.joint for item in tree.geometries]
    other_robots, same_robot = [], []
    for j in range(len(joints)):
        for i in range(j):
            is_adjacent = joints[i] == joints[j] or joints[i] == parents[joints[j]]
            is_adjacent |= joints[j] == parents[joints[i]]
            if robots[i] != robots[j]:
                other_robots.append((i, j))
            elif not is_adjacent:
                same_robot.append((i, j))
    links = [frozenset((tree.shapes.names[i], tree.shapes.names[j])) for i, j in same_robot]
    neutral = tree.coupling.all_positions(np.clip(0.0, *tree.ranges))
    bodies = posed_links(tree, neutral).bodies
    rows = np.array(same_robot, dtype=np.intp).reshape(-1, 2)
    ignored = tree.disabled_pairs | {
        frozenset(names) for names in _deepest_overlaps(bodies, bodies, rows, 0.0)
    }
    compared = [pair for pair, names in zip(same_robot, links, strict=True) if names not in ignored]
    return read_only(np.array(sorted([*other_robots, *compared]), dtype=np.intp).reshape(-1, 2))


class Clearance(NamedTuple):
    """The two bodies with the least signed distance.

    Attributes:
        distance: Signed distance, m; if negative, its amount is the motion until they only touch.
        bodies: Their names; empty if no bodies are compared and the distance is infinite.
    """

    distance: float
    bodies: tuple[str, ...]


_NO_BODIES = Clearance(np.inf, ())


def least_clearance(
    hand: Hand | None, supports: Sequence[Support], moved: PlacedBodies, depth: float, gap: float
) -> Clearance:
    """Return the least clearance of bodies that must not touch.

    These are links and supports, the pairs of links that `unwanted_overlaps` compares, and the
    object and supports that it does not touch. Links that no joint moves count only if they overlap
    a support by more than ``depth``; links and the object likewise.

    Args:
        hand: The hand at its configuration; None: there is none.
        supports: All supports.
        moved: The object's pieces; empty if the object is not considered.
        depth: Largest overlap of a contact, m.
        gap: Largest gap of a contact, m.
    """
    least = _NO_BODIES
    for support in supports:
        clearance = smaller_clearance(moved, support.placed_bodies, _NO_BODIES)
        if not -depth <= clearance.distance <= gap:
            least = min(least, clearance)
    if hand is None:
        return least
    links = hand.placed_bodies
    is_moved = hand.tree.shape_placements[0] > 0
    for support in supports:
        least = smaller_clearance(
            links, support.placed_bodies, least, np.where(is_moved, np.inf, -depth)
        )
    least = smaller_clearance(links, moved, least, np.full(len(links), -depth))
    pairs = overlap_pairs(hand.tree)
    bounds = gap_lower_bounds(links, links)[pairs[:, 1], pairs[:, 0]]
    for place in np.argsort(bounds, kind="stable").tolist():
        if bounds[place] >= least.distance:
            break
        least = min(least, _pair_clearance(links, links, *pairs[place].tolist()))
    return least


def smaller_clearance(
    first: PlacedBodies, second: PlacedBodies, least: Clearance, below: FloatArray | float = np.inf
) -> Clearance:
    """Return the clearance of two bodies if it is less than a known one, else the known one.

    Args:
        first: The pieces of the first body.
        second: The pieces of the second body.
        least: The known clearance.
        below: Distance from which on a piece of the first body is ignored, m.
    """
    if not len(first) or not len(second):
        return least
    bounds = gap_lower_bounds(first, second)
    bounds = np.where(bounds < below, bounds, np.inf)
    for place in np.argsort(bounds, axis=None, kind="stable").tolist():
        if bounds.flat[place] >= least.distance:
            break
        k, p = divmod(place, len(first))
        clearance = _pair_clearance(first, second, p, k)
        if clearance.distance < np.broadcast_to(below, len(first))[p]:
            least = min(least, clearance)
    return least


def _pair_clearance(bodies: PlacedBodies, others: PlacedBodies, i: int, j: int) -> Clearance:
    first, second = bodies[i], others[j]
    return Clearance(separation(first, second).distance, (first.name, second.name))
