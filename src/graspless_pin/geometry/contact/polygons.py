"""Convex polygons in the contact plane: hull, intersection, and reduction to few points.

A polygon is a list of (u, v) pairs in metres, counterclockwise; a list of two is a segment, of one
a point. Plain floats are used: for a handful of vertices arrays are slower.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache

import numpy as np

from graspless_pin.problem.checks import FloatArray, read_only

Point = tuple[float, float]
Polygon = list[Point]

SAME = 1e-7
"""Distance below which points coincide and lines are straight, m."""

_PARALLEL = 5e-3  # rad: segments at a smaller angle touch along a line
_TIE = 1e-9
_SAME_COORDINATE = 1e-6  # m


def planar_hull(points: Iterable[Point], straight: float = SAME) -> Polygon:
    """Return the convex hull, counterclockwise; a segment or a point if the area is zero.

    Args:
        points: At least one.
        straight: Distance by which a vertex must protrude from the line of its neighbours, m.
    """
    ordered = sorted(points)
    hull = _half_hull(ordered)[:-1] + _half_hull(ordered[::-1])[:-1] or ordered[:1]
    # Points on a line up to rounding form a sliver. Distances are measured to the segment between
    # the neighbours, not to the line through them, so that the ends of a sliver are kept.
    while len(hull) > 1:
        distances = [
            _segment_distance(hull[k - 1], hull[(k + 1) % len(hull)], point)
            for k, point in enumerate(hull)
        ]
        least = min(distances)
        if least > straight:
            break
        del hull[distances.index(least)]
    return hull


def _half_hull(ordered: Polygon) -> Polygon:
    chain: Polygon = []
    for point in ordered:
        while len(chain) >= 2 and _cross(chain[-2], chain[-1], point) <= 0.0:
            chain.pop()
        chain.append(point)
    return chain


def _segment_distance(start: Point, end: Point, point: Point) -> float:
    along = (end[0] - start[0], end[1] - start[1])
    square = along[0] ** 2 + along[1] ** 2
    share = 0.0
    if square > 0.0:
        share = ((point[0] - start[0]) * along[0] + (point[1] - start[1]) * along[1]) / square
        share = min(max(share, 0.0), 1.0)
    return math.dist(point, (start[0] + share * along[0], start[1] + share * along[1]))


def _cross(origin: Point, a: Point, b: Point) -> float:
    return (a[0] - origin[0]) * (b[1] - origin[1]) - (a[1] - origin[1]) * (b[0] - origin[0])


def _line_offset(start: Point, end: Point, point: Point) -> float:
    """Return the distance of a point to the left of the line from start to end, m."""
    length = math.dist(start, end)
    return math.dist(start, point) if length == 0.0 else _cross(start, end, point) / length


def intersection(first: Polygon, second: Polygon) -> Polygon:
    """Return the intersection of convex polygons, segments or points; empty if they are apart.

    A single point is returned as it is: it comes from a pair of nearest points, and so touches.
    """
    if len(first) == 1:
        return first
    if len(second) == 1:
        return second
    if len(first) == 2 and len(second) == 2:
        return _segment_intersection(first, second)
    subject, window = (first, second) if len(first) <= len(second) else (second, first)
    result = subject
    for start, end in zip(window, window[1:] + window[:1], strict=True):
        result = _clip(result, start, end)
    return planar_hull(result)


def _clip(polygon: Polygon, start: Point, end: Point) -> Polygon:
    """Return the part of a polygon to the left of a line."""
    offsets = [_line_offset(start, end, point) for point in polygon]
    kept: Polygon = []
    for k, (point, offset) in enumerate(zip(polygon, offsets, strict=True)):
        before, offset_before = polygon[k - 1], offsets[k - 1]
        if (offset < -SAME and offset_before > SAME) or (offset > SAME and offset_before < -SAME):
            share = offset_before / (offset_before - offset)
            kept.append(
                (
                    before[0] + share * (point[0] - before[0]),
                    before[1] + share * (point[1] - before[1]),
                )
            )
        if offset >= -SAME:
            kept.append(point)
    return kept


def shared_border(first: Polygon, second: Polygon) -> Polygon:
    """Return the segment or point midway between the nearest borders of two separate polygons.

    Empty if they are nearest at two vertices.

    Args:
        first: Two vertices or more.
        second: Two vertices or more.
    """
    largest_gap, border = 0.0, []
    for polygon, other in ((first, second), (second, first)):
        for start, end in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            offsets = [_line_offset(start, end, point) for point in other]
            k = max(range(len(other)), key=offsets.__getitem__)
            if -offsets[k] > largest_gap:
                neighbour = max((k - 1, k + 1 - len(other)), key=offsets.__getitem__)
                largest_gap, border = -offsets[k], [[start, end], [other[k], other[neighbour]]]
    if not border:
        return []
    (start, end), _ = border
    half = 0.5 * largest_gap / math.dist(start, end)
    across = half * (end[1] - start[1]), half * (start[0] - end[0])
    return [(u + across[0], v + across[1]) for u, v in _segment_intersection(*border)]


def _segment_intersection(first: Polygon, second: Polygon) -> Polygon:
    a, b = first
    c, d = second
    length, other_length = math.dist(a, b), math.dist(c, d)
    ux, uy = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    sine = ux * (d[1] - c[1]) - uy * (d[0] - c[0])
    if abs(sine) > _PARALLEL * other_length:
        share = (uy * (c[0] - a[0]) - ux * (c[1] - a[1])) / sine
        share = min(max(share, 0.0), 1.0)
        return [(c[0] + share * (d[0] - c[0]), c[1] + share * (d[1] - c[1]))]
    ends_along = sorted(ux * (p[0] - a[0]) + uy * (p[1] - a[1]) for p in (c, d))
    start, stop = max(ends_along[0], 0.0), min(ends_along[1], length)
    if stop < start - SAME:
        return []
    shared_ends = [start] if stop - start <= SAME else [start, stop]
    return [(a[0] + s * ux, a[1] + s * uy) for s in shared_ends]


def first_corner(keys: list[list[float]]) -> int:
    """Return the index of the lexicographically first key: a vertex in a body's own frame, m."""
    candidates = list(range(len(keys)))
    for axis in range(len(keys[0])):
        threshold = min([keys[k][axis] for k in candidates]) + _SAME_COORDINATE
        candidates = [k for k in candidates if keys[k][axis] <= threshold]
        if len(candidates) == 1:
            break
    return candidates[0]


def reduce_polygon(polygon: Polygon, merge_distance: float, max_points: int) -> list[list[int]]:
    """Reduce a convex polygon to few points, each the mean of a group of vertices.

    Neighbours closer than ``merge_distance`` are replaced by their mean; vertices that protrude by
    less than a tenth of it are dropped; while there are more than ``max_points``, the vertex that
    cuts off the least area is dropped. Of nearly equal candidates the first is taken, so that
    rounding does not decide.

    Args:
        polygon: Vertices, whose order is kept.
        merge_distance: m.
        max_points: At least 3.

    Returns:
        Indices of the vertices that each remaining point is the mean of, in the order given.
    """
    groups = [[k] for k in range(len(polygon))]
    points = list(polygon)
    while len(points) > 1:
        lengths = [math.dist(points[k - 1], points[k]) for k in range(1, len(points))]
        lengths.append(math.dist(points[-1], points[0]))
        k = _first_near_minimum(lengths, _TIE)
        if lengths[k] >= merge_distance:
            break
        keep, removed = sorted((k, (k + 1) % len(points)))
        groups[keep] += groups.pop(removed)
        del points[removed]
        members = [polygon[member] for member in groups[keep]]
        points[keep] = (
            math.fsum(u for u, _ in members) / len(members),
            math.fsum(v for _, v in members) / len(members),
        )
    while len(points) > 3:
        offsets = [
            -_line_offset(points[k - 1], points[(k + 1) % len(points)], points[k])
            for k in range(len(points))
        ]
        k = _first_near_minimum(offsets, _TIE)
        if offsets[k] >= 0.1 * merge_distance:
            break
        del points[k], groups[k]
    while len(points) > max_points:
        areas = [
            abs(_cross(points[k - 1], points[k], points[(k + 1) % len(points)]))
            for k in range(len(points))
        ]
        k = _first_near_minimum(areas, 1e-6 * max(areas))
        del points[k], groups[k]
    return groups


def plane_fit(points: list[tuple[float, float, float]]) -> Callable[[Point], float]:
    """Return the height over (u, v) of the least-squares plane of points (u, v, height).

    Vertices of a strip narrower than its own roughness would tilt the plane: it has no slope in
    directions in which the points extend less than 1e-4 of their largest extent.
    """
    count = len(points)
    u0 = sum(u for u, _, _ in points) / count
    v0 = sum(v for _, v, _ in points) / count
    h0 = sum(h for _, _, h in points) / count
    suu = suv = svv = suh = svh = 0.0
    for u, v, h in points:
        du, dv, dh = u - u0, v - v0, h - h0
        suu += du * du
        suv += du * dv
        svv += dv * dv
        suh += du * dh
        svh += dv * dh
    middle, spread = 0.5 * (suu + svv), math.hypot(0.5 * (suu - svv), suv)
    large, small = middle + spread, middle - spread
    if large == 0.0:
        return lambda _: h0
    # The axis (c, s) of the largest extent, and the one across it.
    angle = 0.5 * math.atan2(2.0 * suv, suu - svv)
    c, s = math.cos(angle), math.sin(angle)
    along = (c * suh + s * svh) / large
    across = (c * svh - s * suh) / small if small > 1e-8 * large else 0.0
    gu, gv = c * along - s * across, s * along + c * across
    return lambda point: h0 + gu * (point[0] - u0) + gv * (point[1] - v0)


def _first_near_minimum(values: list[float], tie: float) -> int:
    minimum = min(values)
    return next(k for k, value in enumerate(values) if value <= minimum + tie)


Groups = list[list[int]]
"""For each contact point the indices of the patch's vertices that it is the mean of."""


def plane_basis(normal: FloatArray) -> FloatArray:
    """Return two unit vectors (2, 3), read-only, that form a right-handed frame with the normal."""
    return _cached_basis(*normal.tolist())


@lru_cache(maxsize=256)
def _cached_basis(x: float, y: float, z: float) -> FloatArray:
    # The branch-free construction of Duff et al., which is smooth except at z = 0.
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    rows = [[1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]]
    return read_only(np.array(rows))


def hull_order(points: FloatArray, normal: FloatArray, straight: float = SAME) -> list[int]:
    """Return the points that are vertices of the hull of all, projected along a normal.

    Args:
        points: (K, 3) m.
        normal: (3,) unit.
        straight: See `planar_hull`, m.

    Returns:
        Indices of these points, counterclockwise about the normal.
    """
    coordinates = [(u, v) for u, v in (points @ plane_basis(normal).T).tolist()]
    index = {point: k for k, point in enumerate(coordinates)}
    return [index[point] for point in planar_hull(coordinates, straight)]


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
        points: (K, 3) vertices, counterclockwise about the normal, world, m.
        normal: (3,) unit, from the pair's first body to the second, world axes.
        object_first: Whether the object is the first body.
        T_second: (4, 4) pose of the second body's geometry.
        T_object: (4, 4) pose of the object's geometry.
        merge_distance: Distance below which vertices are merged, m.
        max_points: Largest number of contact points, at least 3.

    Returns:
        Groups of vertices, counterclockwise about the normal into the object, from the point that
        is first in the object's geometry frame, see `first_corner`.
    """
    order = _order_from_first_corner(points, T_second)
    coordinates = (points[order] @ plane_basis(normal).T).tolist()
    reduced = reduce_polygon([(u, v) for u, v in coordinates], merge_distance, max_points)
    groups = [[order[k] for k in group] for group in reduced]
    if object_first:
        groups.reverse()
    if object_first or len(groups) < len(order):
        group_order = _order_from_first_corner(group_means(points, groups), T_object)
        groups = [groups[k] for k in group_order]
    return groups


def group_means(points: FloatArray, groups: Groups) -> FloatArray:
    """Return the mean of the points (K, 3) of each group."""
    return np.array([points[group].mean(axis=0) for group in groups])


def _order_from_first_corner(points: FloatArray, T: FloatArray) -> list[int]:
    """Return the cyclic order of world points (K, 3) from the first in a body's frame."""
    start = first_corner(((points - T[:3, 3]) @ T[:3, :3]).tolist())
    return [*range(start, len(points)), *range(start)]
