"""Where two convex bodies touch: the polygon that they share, at a gap of either sign and at none.

coal's nearest points tell where two bodies are close. Direction and points are then found from the
bodies' own faces, edges and corners: the signed distance of convex bodies is the largest gap that
any direction leaves between them, so among coal's normal and the normals of the faces at hand the
one with the largest gap is right. Along it, the face, edge or corner of each body that lies
farthest is projected onto the contact plane, and the extreme points of the common part are the
contact points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import SceneError
from graspless_pin.geometry.collision import CollisionBody
from graspless_pin.geometry.convex_sets import Plane, Polytope, Revolved, convex_set
from graspless_pin.geometry.polygons import (
    Point,
    Polygon,
    first_corner,
    intersection,
    planar_hull,
    reduce_polygon,
)
from graspless_pin.geometry.poses import invert

Array = NDArray[np.float64]

# With coal's default of 1e-6, one pair in hundreds comes out inside out at a micrometre of gap.
_REQUEST: Any = coal.DistanceRequest()
_REQUEST.gjk_tolerance = 1e-9
_REQUEST.epa_tolerance = 1e-9
_IDENTITY: Any = coal.Transform3s()
_DISTANCE_ERROR = 1e-4  # coal's distance is far better; this leaves room for large bodies
_PULLED_APART = 1e-3  # m: a gap at which coal's direction is sure
_ATTEMPTS = 5
_AGREED = 1.0 - 1e-5  # cosine between a face normal and coal's direction
_SAME_GAP = 1e-9  # directions whose gaps differ by less are equally good


@dataclass(frozen=True, eq=False)
class Patch:
    """Contact points of two bodies, in the frame of the first.

    Attributes:
        normal: (3,) from the first body to the second.
        points: (K, 3) counterclockwise about the normal.
        gaps: (K,) signed gaps.
    """

    normal: Array
    points: Array
    gaps: Array


@dataclass(frozen=True)
class PatchLimits:
    """What counts as touching; see `find_contacts` for the fields, in m."""

    tolerance: float
    max_penetration: float
    merge_distance: float
    max_points: int


def find_patch(first: CollisionBody, second: CollisionBody, limits: PatchLimits) -> Patch | None:
    """Find the points at which two bodies touch.

    Args:
        first: Half-space, polytope or curved body.
        second: The other body; not a half-space.
        limits: What counts as touching.

    Returns:
        The points, in the frame of the first body's geometry; None if the gap is wider than the
        tolerance.

    Raises:
        SceneError: A geometry is of a kind that cannot be used, or the second is a half-space.
    """
    one = convex_set(first.name, first.geometry)
    two = convex_set(second.name, second.geometry)
    if isinstance(two, Plane):
        raise SceneError(f"half-space '{second.name}' must come before '{first.name}' in a pair")
    T_first_second = invert(first.T_world_geometry) @ second.T_world_geometry
    R, t = T_first_second[:3, :3], T_first_second[:3, 3]
    if isinstance(one, Plane):
        normal = one.normal
        witness = one.offset * normal
        if -two.support_values(-(normal @ R)[None])[0] + normal @ t > one.offset + limits.tolerance:
            return None
        window = witness[None]
    else:
        nearest = _nearest(first, one, second, two, T_first_second, limits)
        if nearest is None:
            return None
        normal, witness = nearest
        window = one.feature(normal)
    subject = two.feature(-(normal @ R)) @ R.T + t
    basis = _plane_basis(normal)
    polygon = _project(subject, basis)
    if not isinstance(one, Plane):
        polygon = intersection(_project(window, basis), polygon)
    # Nothing in common means that the bodies meet at the border of their features, where the
    # nearest points are.
    polygon = polygon or [(float(basis[0] @ witness), float(basis[1] @ witness))]
    low = _height_over_plane(window, basis, normal)
    high = _height_over_plane(subject, basis, normal)
    gaps = [high(point) - low(point) for point in polygon]
    closest = min(gaps)
    if closest > limits.tolerance:
        return None
    polygon = [p for p, gap in zip(polygon, gaps, strict=True) if gap <= limits.tolerance]
    in_second = [
        [float(x) for x in ((u * basis[0] + v * basis[1] + high((u, v)) * normal - t) @ R)]
        for u, v in polygon
    ]
    start = first_corner(in_second)
    polygon = polygon[start:] + polygon[:start]
    polygon = reduce_polygon(polygon, limits.merge_distance, limits.max_points)
    heights = np.array([(low(point), high(point)) for point in polygon])
    points = np.array(polygon) @ basis + heights.mean(axis=1)[:, None] * normal
    return Patch(normal, points, heights[:, 1] - heights[:, 0])


def _nearest(
    first: CollisionBody,
    one: Polytope | Revolved,
    second: CollisionBody,
    two: Polytope | Revolved,
    T_first_second: Array,
    limits: PatchLimits,
) -> tuple[Array, Array] | None:
    """Direction from the first body to the second and a point between; None if far apart.

    coal's direction is only as good as its distance, and at a gap of a micrometre that is poor. Of
    all directions the true one leaves the largest gap, so that the faces near the nearest points
    are tried against it. An overlap along no face is asked for again with the bodies pulled apart,
    first along their middles, then along the best direction so far: of rims that overlap by a
    hair, coal may take any direction for the shallowest, while of bodies apart it is sure.
    """
    R, t = T_first_second[:3, :3], T_first_second[:3, 3]

    def leave(directions: Array) -> Array:
        """Gap that each direction (K, 3) leaves between the bodies."""
        return directions @ t - two.support_values(-directions @ R) - one.support_values(directions)

    middles = _unit(t + R @ two.center - one.center)
    best_gap, best, witness = -np.inf, middles, t
    apart = np.zeros(3)
    for attempt in range(_ATTEMPTS):
        result: Any = coal.DistanceResult()
        placed = coal.Transform3s(np.ascontiguousarray(R), t + apart)
        distance = coal.distance(
            first.geometry, _IDENTITY, second.geometry, placed, _REQUEST, result
        )
        if attempt == 0 and distance > limits.tolerance + _DISTANCE_ERROR:
            return None
        on_first = np.array(result.getNearestPoint1())
        on_second = np.array(result.getNearestPoint2()) - apart
        guess = np.array(result.normal)
        guess = _unit(guess) if np.isfinite(guess).all() and guess.any() else middles
        directions = np.vstack(
            [
                one.normals_near(on_first, guess),
                -two.normals_near((on_second - t) @ R, -(guess @ R)) @ R.T,
                _across_edges(one.feature(guess), two.feature(-(guess @ R)) @ R.T, guess),
                guess,
            ]
        )
        gaps = leave(directions)
        k = int(np.flatnonzero(gaps >= gaps.max() - _SAME_GAP)[0])
        gain = float(gaps[k]) - best_gap
        if gain > 0.0:
            best_gap, best = float(gaps[k]), directions[k]
            witness = 0.5 * (on_first + on_second)
        on_a_face = k < len(directions) - 1 and directions[k] @ guess > _AGREED
        settled = on_a_face or (attempt >= 2 and gain <= _SAME_GAP)
        if best_gap >= 0.0 or (settled and best_gap >= -limits.max_penetration):
            break
        axis = middles if attempt == 0 else best
        apart = (_PULLED_APART - float(leave(axis[None])[0])) * axis
    return (best, witness) if best_gap <= limits.tolerance else None


def _unit(vector: Array) -> Array:
    """The vector at length one; z if it has no length."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else np.array([0.0, 0.0, 1.0])


def _across_edges(first: Array, second: Array, guess: Array) -> Array:
    """Common normal (1, 3) of two crossing edges, along the guess; (0, 3) for other features."""
    if len(first) == 2 and len(second) == 2:
        normal = np.cross(first[1] - first[0], second[1] - second[0])
        length = float(np.linalg.norm(normal))
        if length > 1e-3 * np.linalg.norm(first[1] - first[0]) * np.linalg.norm(
            second[1] - second[0]
        ):
            return np.sign(normal @ guess) * normal[None] / length
    return np.empty((0, 3))


def _plane_basis(normal: Array) -> Array:
    """Two unit vectors (2, 3) that with the normal make a right-handed frame (u, v, normal)."""
    x, y, z = normal.tolist()
    # The branch-free construction of Duff et al., which is smooth but at z = 0.
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]])


def _project(points: Array, basis: Array) -> Polygon:
    return planar_hull([(u, v) for u, v in (points @ basis.T).tolist()])


def _height_over_plane(points: Array, basis: Array, normal: Array) -> Callable[[Point], float]:
    """Height along the normal of the plane or line through (K, 3) points, over (u, v)."""
    center = points.mean(axis=0)
    u0, v0 = (basis @ center).tolist()
    h0 = float(normal @ center)
    if len(points) == 1:
        return lambda _: h0
    offsets = points - center
    # Corners of a strip narrower than its own roughness would tilt the plane: such directions are
    # left level.
    gu, gv = np.linalg.lstsq(offsets @ basis.T, offsets @ normal, rcond=1e-4)[0].tolist()
    return lambda point: h0 + gu * (point[0] - u0) + gv * (point[1] - v0)
