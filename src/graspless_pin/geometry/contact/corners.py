"""Corners of a patch in its plane: the extreme ones in order, and the few that stand for them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from graspless_pin.geometry.contact.polygons import (
    SAME,
    first_corner,
    planar_hull,
    reduce_polygon,
)
from graspless_pin.problem.checks import FloatArray

Groups = list[list[int]]
"""For each contact point the corners of the patch that it is the mean of."""


def plane_basis(normal: FloatArray) -> FloatArray:
    """Two unit vectors (2, 3), read-only, that with the normal make a right-handed frame."""
    return _basis(*normal.tolist())


@lru_cache(maxsize=256)
def _basis(x: float, y: float, z: float) -> FloatArray:
    # The branch-free construction of Duff et al., which is smooth but at z = 0.
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    basis = np.array([[1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]])
    basis.setflags(write=False)
    return basis


def hull_order(points: FloatArray, normal: FloatArray, straight: float = SAME) -> list[int]:
    """Return which of some points are extreme ones of their projection along a normal.

    Args:
        points: (K, 3) m.
        normal: (3,) unit.
        straight: Points that stick out by less than this lie on a line, m.

    Returns:
        Their indices, counterclockwise about the normal.
    """
    flat = [(u, v) for u, v in (points @ plane_basis(normal).T).tolist()]
    index = {point: k for k, point in enumerate(flat)}
    return [index[point] for point in planar_hull(flat, straight)]


def corner_groups(
    points: FloatArray,
    normal: FloatArray,
    *,
    object_first: bool,
    T_second: FloatArray,
    T_object: FloatArray,
    merge_distance: float,
    max_points: int,
) -> Groups:
    """Choose the contact points of a patch.

    Args:
        points: (K, 3) corners, counterclockwise about the normal, world, m.
        normal: (3,) unit, from the pair's first body to the second, world axes.
        object_first: Whether the object is the first body.
        T_second: (4, 4) pose of the second body's geometry.
        T_object: (4, 4) pose of the object's geometry.
        merge_distance: Corners closer together than this become one, m.
        max_points: Largest number of contact points, at least 3.

    Returns:
        Groups of corners, counterclockwise about the normal into the object, from the point that
        comes first in the object's geometry frame.
    """
    around = _from_first_corner(points, T_second)
    flat = (points[around] @ plane_basis(normal).T).tolist()
    reduced = reduce_polygon([(u, v) for u, v in flat], merge_distance, max_points)
    groups = [[around[k] for k in group] for group in reduced]
    if object_first:
        groups.reverse()
    if object_first or len(groups) < len(around):
        turn = _from_first_corner(group_means(points, groups), T_object)
        groups = [groups[k] for k in turn]
    return groups


def group_means(points: FloatArray, groups: Groups) -> FloatArray:
    """Return the mean of the points (K, 3) of each group."""
    return np.array([points[group].mean(axis=0) for group in groups])


def _from_first_corner(points: FloatArray, T: FloatArray) -> list[int]:
    """Order of world points (K, 3) from the one that comes first in a body's geometry frame."""
    start = first_corner(((points - T[:3, 3]) @ T[:3, :3]).tolist())
    return [*range(start, len(points)), *range(start)]
