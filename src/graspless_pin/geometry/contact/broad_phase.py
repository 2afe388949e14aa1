"""Which of many bodies may touch, by the boxes around them, all at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.solids import Solids, solids_of

Array = NDArray[np.float64]

_FEW = 4  # pairs at which a closer look costs less than a second look at their boxes


def near_pairs(
    first: Sequence[CollisionBody], second: Sequence[CollisionBody], tolerance: float
) -> list[tuple[int, int]]:
    """Pairs whose gap may be within the tolerance; half-spaces are always near.

    A pair is far if a side of the first body's box, along that body's own axes, parts it from the
    sphere around the second; where more than a few pairs are left, also if a side of one of the
    boxes along the bodies' own axes parts the two boxes.

    Args:
        first: P bodies, no half-spaces.
        second: K bodies.
        tolerance: m.

    Returns:
        Indices into ``first`` and ``second``, ordered by the second, then by the first.

    Raises:
        SceneError: A geometry is of a kind that contacts cannot be found for.
    """
    if not first or not second:
        return []
    one, two = PlacedBodies.of(first), PlacedBodies.of(second)
    return near_solids(one, solids_of(one.shapes), two, solids_of(two.shapes), tolerance)


def near_solids(
    one: PlacedBodies, solids: Solids, two: PlacedBodies, others: Solids, tolerance: float
) -> list[tuple[int, int]]:
    """Return what `near_pairs` does for at least one body each, whose sets are known."""
    if others.only_planes:
        return [(p, k) for k in range(len(two)) for p in range(len(one))]
    R = one.poses[:, :3, :3]
    offsets = (_centers(two, others) - _centers(one, solids)[:, None]) @ R
    beyond = np.abs(offsets) - solids.half_extents[:, None]
    k, p = np.nonzero((beyond <= others.reaches[:, None] + tolerance).all(axis=2).T)
    if len(p) > _FEW:
        relative = R.transpose(0, 2, 1)[p] @ two.poses[k, :3, :3]
        size = np.abs(relative)
        along = beyond[p, k] - (size @ others.half_extents[k, :, None])[..., 0]
        across = np.abs((offsets[p, k, None] @ relative)[:, 0]) - others.half_extents[k]
        across -= (solids.half_extents[p, None] @ size)[:, 0]
        near = (np.maximum(along, across) <= tolerance).all(axis=1)
        p, k = p[near], k[near]
    return list(zip(p.tolist(), k.tolist(), strict=True))


def _centers(bodies: PlacedBodies, solids: Solids) -> Array:
    """(K, 3) centres of the boxes around bodies, world frame, m."""
    if solids.centered:
        return bodies.poses[:, :3, 3]
    return (bodies.poses[:, :3, :3] @ solids.centers)[..., 0] + bodies.poses[:, :3, 3]
