"""Convex polygons in the plane of a contact: hull, intersection, and few points in their stead.

A polygon is a list of (u, v) pairs in metres, counterclockwise; a list of two is a segment, of one
a point. Plain floats: the polygons have a handful of corners, for which arrays are slower.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

Point = tuple[float, float]
Polygon = list[Point]

_SAME = 1e-7  # m: closer than this, points coincide and lines are straight
_PARALLEL = 5e-3  # rad: segments closer in direction than this touch along a line
_TIE = 1e-9


def planar_hull(points: Iterable[Point]) -> Polygon:
    """Extreme points, counterclockwise; a segment or a point where the points have no area."""
    ordered = sorted(points)
    hull = _chain(ordered)[:-1] + _chain(ordered[::-1])[:-1] or ordered[:1]
    # Points on a line up to rounding make a sliver. Measured against the segment between its
    # neighbours, and not against the line through them, the end of a sliver stays.
    while len(hull) > 1:
        distances = [
            _segment_distance(hull[k - 1], hull[(k + 1) % len(hull)], point)
            for k, point in enumerate(hull)
        ]
        least = min(distances)
        if least > _SAME:
            break
        del hull[distances.index(least)]
    return hull


def _chain(ordered: Polygon) -> Polygon:
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


def _offset(start: Point, end: Point, point: Point) -> float:
    """Distance of a point to the left of the line from start to end."""
    length = math.dist(start, end)
    return math.dist(start, point) if length == 0.0 else _cross(start, end, point) / length


def intersection(first: Polygon, second: Polygon) -> Polygon:
    """Common part of two convex polygons, segments or points; empty if they have none.

    A point touches what it is held against, since it comes from a pair of nearest points: it is
    returned as is.
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
    """Part of a polygon to the left of a line."""
    offsets = [_offset(start, end, point) for point in polygon]
    kept: Polygon = []
    for k, (point, offset) in enumerate(zip(polygon, offsets, strict=True)):
        before, offset_before = polygon[k - 1], offsets[k - 1]
        if (offset < -_SAME and offset_before > _SAME) or (
            offset > _SAME and offset_before < -_SAME
        ):
            share = offset_before / (offset_before - offset)
            kept.append(
                (
                    before[0] + share * (point[0] - before[0]),
                    before[1] + share * (point[1] - before[1]),
                )
            )
        if offset >= -_SAME:
            kept.append(point)
    return kept


def _segment_intersection(first: Polygon, second: Polygon) -> Polygon:
    a, b = first
    c, d = second
    length, other_length = math.dist(a, b), math.dist(c, d)
    ux, uy = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    turn = ux * (d[1] - c[1]) - uy * (d[0] - c[0])
    if abs(turn) > _PARALLEL * other_length:
        share = (uy * (c[0] - a[0]) - ux * (c[1] - a[1])) / turn
        share = min(max(share, 0.0), 1.0)
        return [(c[0] + share * (d[0] - c[0]), c[1] + share * (d[1] - c[1]))]
    along = sorted(ux * (p[0] - a[0]) + uy * (p[1] - a[1]) for p in (c, d))
    start, stop = max(along[0], 0.0), min(along[1], length)
    if stop < start - _SAME:
        return []
    ends = [start] if stop - start <= _SAME else [start, stop]
    return [(a[0] + s * ux, a[1] + s * uy) for s in ends]


def first_corner(keys: list[list[float]], resolution: float = 1e-6) -> int:
    """Index of the corner whose key comes first.

    Args:
        keys: One list of coordinates per corner, in a frame that moves with a body.
        resolution: Coordinates that differ by less are the same, m.
    """
    candidates = list(range(len(keys)))
    for axis in range(len(keys[0])):
        least = min(keys[k][axis] for k in candidates)
        candidates = [k for k in candidates if keys[k][axis] <= least + resolution]
    return candidates[0]


def reduce_polygon(polygon: Polygon, merge_distance: float, max_points: int) -> Polygon:
    """Few points that stand for a convex polygon.

    Neighbours closer than ``merge_distance`` become their mean; corners that stick out by less
    than a tenth of it are dropped; beyond ``max_points`` the corner that cuts off the least area
    goes, and so on. Of equal candidates the first is taken, so that rounding does not decide.

    Args:
        polygon: Corners, in an order that is meant to be kept.
        merge_distance: m.
        max_points: At least 3.
    """
    corners = [(point, 1.0) for point in polygon]
    while len(corners) > 1:
        lengths = [
            math.dist(corners[k][0], corners[(k + 1) % len(corners)][0])
            for k in range(len(corners))
        ]
        k = _first_least(lengths, _TIE)
        if lengths[k] >= merge_distance:
            break
        following = (k + 1) % len(corners)
        merged = _mean(corners[k], corners[following])
        corners[min(k, following)] = merged
        del corners[max(k, following)]
    points = [point for point, _ in corners]
    while len(points) > 3:
        offsets = [
            -_offset(points[k - 1], points[(k + 1) % len(points)], points[k])
            for k in range(len(points))
        ]
        k = _first_least(offsets, _TIE)
        if offsets[k] >= 0.1 * merge_distance:
            break
        del points[k]
    while len(points) > max_points:
        areas = [
            abs(_cross(points[k - 1], points[k], points[(k + 1) % len(points)]))
            for k in range(len(points))
        ]
        del points[_first_least(areas, 1e-6 * max(areas))]
    return points


def _first_least(values: list[float], tie: float) -> int:
    least = min(values)
    return next(k for k, value in enumerate(values) if value <= least + tie)


def _mean(first: tuple[Point, float], second: tuple[Point, float]) -> tuple[Point, float]:
    (a, weight), (b, other) = first, second
    total = weight + other
    return (
        (weight * a[0] + other * b[0]) / total,
        (weight * a[1] + other * b[1]) / total,
    ), total
