"""Which of many bodies may touch, by the boxes around them, all at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.solids import Solids, solids_of
from graspless_pin.problem.checks import FloatArray

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
    centers = _centers(two, others)
    under = centers.dot(_sides(one, solids).T)
    within = (under >= solids.reaches_under(others, tolerance)).reshape(len(two), len(one), 6)
    count = len(one)
    hits = np.logical_and.reduce(within, axis=2).ravel().nonzero()[0].tolist()
    near = [(hit % count, hit // count) for hit in hits]
    if len(near) <= _FEW:
        return near
    p, k = np.array(near).T
    R, offsets = one.poses[p, :3, :3], centers[k, :3] - _centers(one, solids)[p, :3]
    relative = R.transpose(0, 2, 1) @ two.poses[k, :3, :3]
    size = np.abs(relative)
    offsets = offsets[:, None] @ R
    along = np.abs(offsets[:, 0]) - solids.half_extents[p]
    along -= (size @ others.half_extents[k, :, None])[..., 0]
    across = np.abs((offsets @ relative)[:, 0]) - others.half_extents[k]
    across -= (solids.half_extents[p, None] @ size)[:, 0]
    gaps = np.maximum(along, across).max(axis=1).tolist()
    return [pair for pair, gap in zip(near, gaps, strict=True) if gap <= tolerance]


def _sides(bodies: PlacedBodies, solids: Solids) -> FloatArray:
    """(6 P, 4) sides of the boxes around bodies in the world, see `Solids.sides`."""
    sides = bodies.notes.get("sides")
    if sides is None:
        if bodies.together:
            sides = solids.sides.reshape(-1, 4).dot(bodies.T_body_world(0))
        else:
            inverses = [bodies.T_body_world(index) for index in range(len(bodies))]
            sides = (solids.sides @ inverses).reshape(-1, 4)
        bodies.notes["sides"] = sides
    return sides


def _centers(bodies: PlacedBodies, solids: Solids) -> FloatArray:
    """(K, 4) centres [x, y, z, 1] of the boxes around bodies, world frame, m."""
    if solids.centered:
        return bodies.poses[:, :, 3]
    return (bodies.poses @ solids.centers[..., None])[..., 0]
