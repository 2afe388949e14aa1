"""Which of many bodies may touch, by the boxes around them, all at once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.contact.convex_sets import ConvexSet, Plane, convex_set

Array = NDArray[np.float64]

_ENDLESS = 1e12  # m; finite, as zero times infinity is not a number


def near_pairs(
    first: Sequence[CollisionBody], second: Sequence[CollisionBody], tolerance: float
) -> list[tuple[int, int]]:
    """Pairs whose gap may be within the tolerance; half-spaces are always near.

    A pair is far if a side of one of the boxes along the bodies' own axes parts the two boxes.

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
    R, centers, halves = _placed(first)
    R_other, other_centers, other_halves = _placed(second)
    offsets = other_centers - centers[:, None]
    size = np.abs(R.transpose(0, 2, 1)[:, None] @ R_other)
    along = np.abs(offsets @ R) - halves[:, None] - (size @ other_halves[:, :, None])[..., 0]
    other_along = np.abs(offsets[:, :, None] @ R_other) - halves[:, None, None] @ size
    gap = np.maximum(along, other_along[:, :, 0] - other_halves)
    near = (gap <= tolerance).all(axis=2)
    return [(p, k) for k, p in np.argwhere(near.T).tolist()]


def _placed(bodies: Sequence[CollisionBody]) -> tuple[Array, Array, Array]:
    """Rotations (K, 3, 3), world centres (K, 3) and half extents (K, 3) of boxes around bodies."""
    centers, halves = _boxes(tuple([convex_set(body.name, body.geometry) for body in bodies]))
    poses = np.concatenate([body.T_world_geometry for body in bodies]).reshape(-1, 4, 4)
    R = poses[:, :3, :3]
    return R, (R @ centers)[:, :, 0] + poses[:, :3, 3], halves


@lru_cache(maxsize=32)
def _boxes(solids: tuple[ConvexSet, ...]) -> tuple[Array, Array]:
    """Local centres (K, 3, 1) and half extents (K, 3)."""
    boxes = [
        (np.zeros(3), np.full(3, _ENDLESS))
        if isinstance(solid, Plane)
        else (solid.center, solid.half_extents)
        for solid in solids
    ]
    return np.array([center for center, _ in boxes])[:, :, None], np.array([h for _, h in boxes])
