"""Which of many bodies may touch, by the boxes around them, all at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.solids import Solids, solids_of
from graspless_pin.problem.checks import FloatArray


def near_pairs(
    first: Sequence[CollisionBody], second: Sequence[CollisionBody], tolerance: float
) -> list[tuple[int, int]]:
    """Pairs whose gap may be within the tolerance; half-spaces are always near.

    A pair is far if a side of the first body's box, along that body's own axes, parts it from the
    sphere around the second, or if a side of one of the boxes along the bodies' own axes parts the
    two boxes.

    Args:
        first: P bodies, no half-spaces.
        second: K bodies.
        tolerance: m.

    Returns:
        Indices into ``first`` and ``second``, ordered by the second, then by the first.

    Raises:
        SceneError: A geometry is of a kind that contacts cannot be found for.
    """
    one, two = PlacedBodies.of(first), PlacedBodies.of(second)
    return near_solids(one, solids_of(one.shapes), two, solids_of(two.shapes), tolerance)


def near_solids(
    one: PlacedBodies, solids: Solids, two: PlacedBodies, others: Solids, tolerance: float
) -> list[tuple[int, int]]:
    """Return what `near_pairs` does for bodies whose sets are known."""
    R = one.poses[:, :3, :3]
    # For each of the second's bodies and each of the first's, in the frame of the latter.
    axes = R.transpose(0, 2, 1) @ two.poses[:, None, :3, :3]
    offsets = box_centers(two, others)[:, None] - box_centers(one, solids)
    local = (offsets[..., None, :] @ R)[..., 0, :]
    size = np.abs(axes)
    reach = np.minimum(
        (size @ others.half_extents[:, None, :, None])[..., 0], others.reaches[:, None, None]
    )
    along = np.abs(local) - solids.half_extents - reach
    across = np.abs((local[..., None, :] @ axes)[..., 0, :]) - others.half_extents[:, None]
    across -= (solids.half_extents[:, None] @ size)[..., 0, :]
    k, p = np.nonzero(np.maximum(along, across).max(axis=2) <= tolerance)
    return list(zip(p.tolist(), k.tolist(), strict=True))


def box_centers(bodies: PlacedBodies, solids: Solids) -> FloatArray:
    """(K, 3) centres of the boxes around bodies, world frame, m."""
    rotated = bodies.poses[:, :3, :3] @ solids.centers[..., None]
    return rotated[..., 0] + bodies.poses[:, :3, 3]
