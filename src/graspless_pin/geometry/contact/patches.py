"""Contact patches of two convex bodies: the polygon that they share, at a signed gap.

coal's nearest points locate the contact. Direction and points are then found from the bodies' own
faces, edges and vertices (`convex_sets`): the signed distance of convex bodies is the largest gap
over all directions, so among coal's normal and the normals of nearby faces the one with the largest
gap is right. Along it, the farthest feature (face, edge or vertex) of each body is projected onto
the contact plane; the patch is their intersection. Half-spaces, and spheres on faces, do not need
coal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import coal  # pyright: ignore[reportMissingImports]
import numpy as np

from graspless_pin.caching import Derived
from graspless_pin.errors import MeshError, SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.convex_sets import BoundedSet, ConvexSet, Plane
from graspless_pin.geometry.bodies.polytopes import Polytope, is_hull
from graspless_pin.geometry.bodies.shapes import kind_of
from graspless_pin.geometry.contact.polygons import (
    Polygon,
    hull_order,
    intersection,
    planar_hull,
    plane_basis,
    plane_fit,
    shared_border,
)
from graspless_pin.geometry.poses import unit_vector
from graspless_pin.problem.checks import FloatArray

DISTANCE_REQUEST: Any = coal.DistanceRequest()
"""Tolerance 1e-9: at coal's default of 1e-6 one pair in hundreds is inverted at gaps of 1e-6 m."""
DISTANCE_REQUEST.gjk_tolerance = DISTANCE_REQUEST.epa_tolerance = 1e-9

_IDENTITY: Any = coal.Transform3s()
_DISTANCE_ERROR = 1e-4  # coal's distance is far better; this leaves room for large bodies
_PULLED_APART = 1e-3  # m: a gap at which coal's direction is reliable; less for small bodies
_PULLED_SHARE = 0.02  # of the smaller radius
_MOST_ATTEMPTS = 5
_AGREED_COSINE = 1.0 - 1e-5  # cosine between a face normal and coal's direction
_SAME_GAP = 1e-9  # m: directions whose gaps differ by less are equivalent


def convex_set(name: str, geometry: Any) -> ConvexSet:
    """Return the set that a coal geometry fills, cached while the geometry object lives.

    Args:
        name: Name of the body, for the message.
        geometry: coal primitive or convex hull.

    Raises:
        SceneError: The geometry is a triangle soup or of a kind without contact detection.
        MeshError: The points of a hull all lie in one plane.
    """
    try:
        return _cached_set(geometry)
    except (SceneError, MeshError) as error:
        raise type(error)(f"body '{name}': {error}") from error


def placed_set(body: CollisionBody) -> tuple[ConvexSet, FloatArray, FloatArray]:
    """Return the set that a body fills, and the rotation (3, 3) and origin (3,) of its frame, m.

    Raises:
        SceneError: See `convex_set`.
        MeshError: See `convex_set`.
    """
    T = body.T_world_geometry
    return convex_set(body.name, body.geometry), T[:3, :3], T[:3, 3]


@partial(Derived, most=math.inf)
def _cached_set(geometry: Any) -> ConvexSet:
    kind = kind_of(geometry)
    if kind is None or geometry.getSweptSphereRadius() != 0.0:
        raise SceneError(
            f"contacts cannot be found for a {type(geometry).__name__}; use a box, sphere, "
            "capsule, cylinder, cone, half-space or convex hull without a swept radius, or add a "
            "shape of this kind to `SHAPES`"
        )
    return kind.set_of(geometry)


class Patch(NamedTuple):
    """The polygon, segment or point at which two bodies touch.

    Attributes:
        normal: (3,) from the first body to the second, world axes.
        points: (K, 3) extreme points midway between the bodies, counterclockwise about the normal,
            world, m.
        gaps: K signed gaps at the points, m.
    """

    normal: FloatArray
    points: FloatArray
    gaps: list[float]


def find_patch(
    first: CollisionBody, second: CollisionBody, tolerance: float, max_penetration: float
) -> Patch | None:
    """Find the patch at which two bodies touch.

    Args:
        first: Half-space, polytope or curved body.
        second: The other body; not a half-space.
        tolerance: Largest gap that counts as touching, m.
        max_penetration: Largest overlap that counts as contact, m.

    Returns:
        The patch; None if the gap is wider than the tolerance.

    Raises:
        SceneError: The second body is a half-space.
    """
    (one, R, origin), (two, R_second, origin_second) = placed_set(first), placed_set(second)
    if isinstance(two, Plane):
        raise SceneError(f"half-space '{second.name}' must come before '{first.name}' in a pair")
    if isinstance(one, Plane):
        normal = R @ one.normal
        subject = two.feature(-(normal @ R_second)) @ R_second.T + origin_second
        return _half_space_patch(normal, float(normal @ origin) + one.offset, subject, tolerance)
    t = (origin_second - origin) @ R
    if isinstance(one, Polytope) and two.is_sphere:
        face, height, on_face = one.highest_face(t)
        gap = height - two.radius
        if gap > tolerance:
            return None
        if on_face:
            normal = R @ one.face_normals[face]
            middle = origin_second - 0.5 * (height + two.radius) * normal
            return Patch(normal, middle[None], [gap])
    pair = _BodyPair(first, one, second, two, R.T @ R_second, t)
    contact = pair.nearest_direction(tolerance, max_penetration)
    if contact is None:
        return None
    points, gaps = pair.shared_points(*contact, tolerance)
    return Patch(R @ contact[0], points @ R.T + origin, gaps)


def _half_space_patch(
    normal: FloatArray, offset: float, subject: FloatArray, tolerance: float
) -> Patch | None:
    heights = subject @ normal - offset
    gaps = heights.tolist()
    touching = [k for k, gap in enumerate(gaps) if gap <= tolerance]
    if not touching:
        return None
    points = (subject - (0.5 * heights)[:, None] * normal)[touching]
    order = hull_order(points, normal) if len(touching) > 1 else [0]
    return Patch(normal, points[order], [gaps[touching[k]] for k in order])


def _surface_distances(
    solid: BoundedSet,
    direction: FloatArray,
    points: FloatArray,
    feature: FloatArray,
    basis: FloatArray,
) -> FloatArray:
    """Return distances (K,) of points (K, 3) to a body's surface along a direction, own frame, m.

    For a hull it is the surface itself. Other sets touch along the plane or line of the feature
    (N, 3), which is extended beyond it; ``basis`` (2, 3) spans the plane across the direction.
    """
    if is_hull(solid):
        return solid.heights_from(points, direction)
    coordinates = feature @ np.vstack([basis, direction]).T
    plane = plane_fit([(u, v, h) for u, v, h in coordinates.tolist()])
    return np.array([plane((u, v)) for u, v in (points @ basis.T).tolist()]) - points @ direction


@dataclass(frozen=True, eq=False)
class _BodyPair:
    """Two bounded bodies in the frame of the first.

    Attributes:
        first: The first body.
        one: The convex set of the first body.
        second: The second body.
        two: The convex set of the second body.
        R: (3, 3) rotation of the second body in the first's frame.
        t: (3,) origin of the second body in the first's frame, m.
    """

    first: CollisionBody
    one: BoundedSet
    second: CollisionBody
    two: BoundedSet
    R: FloatArray
    t: FloatArray

    def nearest_direction(
        self, tolerance: float, max_penetration: float
    ) -> tuple[FloatArray, FloatArray, float] | None:
        """Search for the contact normal from the first body to the second and a point between them.

        coal's direction is only as accurate as its distance, which is poor at micrometre gaps. The
        true direction has the largest gap of all, so it is compared with the normals of the faces
        near the nearest points. If the best direction of an overlap is not a face normal, coal is
        called again with the bodies pulled apart, first along their centres, then along the best
        direction so far: for slightly overlapping rims coal may return any direction, while for
        separated bodies it is reliable.

        Returns:
            Direction (3,), point (3,) and gap, m; None if the bodies are far apart.
        """
        fixed = np.concatenate([self.one.constant_normals, -self.two.constant_normals @ self.R.T])
        fixed_gaps = self._gaps_along(fixed)
        if len(fixed) and float(fixed_gaps.max()) > tolerance:
            return None
        center_axis = unit_vector(self.t + self.R @ self.two.center - self.one.center)
        best_gap, best, witness = -np.inf, center_axis, self.t
        pull_gap = min(_PULLED_APART, _PULLED_SHARE * min(self.one.radius, self.two.radius))
        offset = np.zeros(3)
        for attempt in range(_MOST_ATTEMPTS):
            distance, on_first, on_second, coal_direction = self._coal_distance(offset)
            if attempt == 0 and distance > tolerance + _DISTANCE_ERROR:
                return None
            coal_direction = center_axis if coal_direction is None else coal_direction
            candidates = self._candidate_directions(on_first, on_second, coal_direction)
            gaps = np.concatenate([fixed_gaps, self._gaps_along(candidates)])
            k = int((gaps >= gaps.max() - _SAME_GAP).argmax())
            direction = fixed[k] if k < len(fixed) else candidates[k - len(fixed)]
            gain = float(gaps[k]) - best_gap
            if gain > 0.0:
                best_gap, best = float(gaps[k]), direction
                witness = 0.5 * (on_first + on_second)
            on_a_face = k < len(gaps) - 1 and direction @ coal_direction > _AGREED_COSINE
            is_confirmed = on_a_face and (attempt > 0 or k < len(fixed))
            is_settled = is_confirmed or (attempt >= 2 and gain <= _SAME_GAP)
            if best_gap >= 0.0 or (is_settled and best_gap >= -max_penetration):
                break
            axis = center_axis if attempt == 0 else best
            offset = (pull_gap - float(self._gaps_along(axis[None])[0])) * axis
        return (best, witness, best_gap) if best_gap <= tolerance else None

    def _gaps_along(self, directions: FloatArray) -> FloatArray:
        """Return the gap (K,) between the bodies along each direction (K, 3), m."""
        return (
            directions @ self.t
            - self.two.support_values(-(directions @ self.R))
            - self.one.support_values(directions)
        )

    def _candidate_directions(
        self, on_first: FloatArray, on_second: FloatArray, guess: FloatArray
    ) -> FloatArray:
        """Return directions (K, 3) to try for nearest points, with coal's direction as the last."""
        second_normals = self.two.normals_near((on_second - self.t) @ self.R, -(guess @ self.R))
        return np.concatenate(
            [
                self.one.normals_near(on_first, guess),
                -second_normals @ self.R.T,
                self._crossed_edges_normal(guess),
                guess[None],
            ]
        )

    def _crossed_edges_normal(self, guess: FloatArray) -> FloatArray:
        """Return the common normal (1, 3) of two crossing edges, along the guess; else (0, 3)."""
        first = self.one.feature(guess)
        second = self.two.feature(-(guess @ self.R)) if len(first) == 2 else first
        if len(first) == len(second) == 2:
            edge, other_edge = first[1] - first[0], (second[1] - second[0]) @ self.R.T
            normal = np.cross(edge, other_edge)
            length = float(np.linalg.norm(normal))
            if length > 1e-3 * np.linalg.norm(edge) * np.linalg.norm(other_edge):
                return (np.sign(normal @ guess) * normal / length)[None]
        return np.empty((0, 3))

    def _coal_distance(
        self, offset: FloatArray
    ) -> tuple[float, FloatArray, FloatArray, FloatArray | None]:
        """Return coal's distance, nearest points and direction with the second body shifted."""
        result: Any = coal.DistanceResult()
        pose = coal.Transform3s(np.ascontiguousarray(self.R), self.t + offset)
        distance = coal.distance(
            self.first.geometry, _IDENTITY, self.second.geometry, pose, DISTANCE_REQUEST, result
        )
        direction = np.array(result.normal)
        is_valid = bool(np.isfinite(direction).all() and direction.any())
        return (
            float(distance),
            np.array(result.getNearestPoint1()),
            np.array(result.getNearestPoint2()) - offset,
            unit_vector(direction) if is_valid else None,
        )

    def shared_points(
        self, normal: FloatArray, witness: FloatArray, gap: float, tolerance: float
    ) -> tuple[FloatArray, list[float]]:
        """Return the points (K, 3) that the bodies share along a normal, and their gaps, m."""
        window = self.one.feature(normal)
        back = -(normal @ self.R)
        subject = self.two.feature(back) @ self.R.T + self.t
        if len(subject) == 1 or len(window) == 1:
            # Along the direction of the largest gap a single point is one of the nearest points.
            side = -0.5 if len(subject) == 1 else 0.5
            return (subject if len(subject) == 1 else window) + side * gap * normal, [gap]
        # Without an intersection the bodies meet at the borders of their features. If the gaps at
        # all vertices are too wide, surfaces bent by less than `PARALLEL_ANGLE` touch between them.
        basis = plane_basis(normal)
        first, second = _project(window, basis), _project(subject, basis)
        polygon = intersection(first, second) or shared_border(first, second)
        feet = np.array([*polygon, basis @ witness]) @ basis
        low = _surface_distances(self.one, normal, feet, window, basis)
        second_frame = (subject - self.t) @ self.R, basis @ self.R
        high = -_surface_distances(self.two, back, (feet - self.t) @ self.R, *second_frame)
        middles = feet + (0.5 * (low + high))[:, None] * normal
        gaps = (high - low).tolist()
        kept = [k for k in range(len(polygon)) if gaps[k] <= tolerance] or [-1]
        return middles[kept], [gaps[k] for k in kept]


def _project(points: FloatArray, basis: FloatArray) -> Polygon:
    return planar_hull([(u, v) for u, v in (points @ basis.T).tolist()])
