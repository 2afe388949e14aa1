"""How far a hand and an object are from what they shall not touch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.contact.broad_phase import least_gaps, solids_of
from graspless_pin.geometry.contact.distances import separation
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.overlaps import pairs_of
from graspless_pin.problem.checks import FloatArray


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
