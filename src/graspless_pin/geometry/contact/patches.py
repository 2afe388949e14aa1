"""Where two convex bodies touch: in the polygon that they share, at a gap of either sign or none.

coal's nearest points tell where two bodies are close. Direction and points are then found from the
bodies' own faces, edges and corners (`convex_sets`): the signed distance of convex bodies is the
largest gap that any direction leaves between them, so among coal's normal and the normals of the
faces at hand the one with the largest gap is right. Along it, the face, edge or corner of each body
that lies farthest is projected onto the contact plane, and their common part is where they touch. A
half-space, and a sphere on a face, need no coal.
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
"""With coal's default of 1e-6, one pair in hundreds comes out inside out at a micrometre of gap."""
DISTANCE_REQUEST.gjk_tolerance = DISTANCE_REQUEST.epa_tolerance = 1e-9

_IDENTITY: Any = coal.Transform3s()
_DISTANCE_ERROR = 1e-4  # coal's distance is far better; this leaves room for large bodies
_PULLED_APART = 1e-3  # m: a gap at which coal's direction is sure; of small bodies, less
_PULLED_SHARE = 0.02  # of the smaller radius
_MOST_ATTEMPTS = 5
_AGREED_COSINE = 1.0 - 1e-5  # cosine between a face normal and coal's direction
_SAME_GAP = 1e-9  # directions whose gaps differ by less are equally good


def convex_set(name: str, geometry: Any) -> ConvexSet:
    """Return the set that a coal geometry fills, remembered while the geometry object lives.

    Args:
        name: Name of the body, for the message.
        geometry: coal primitive or convex hull.

    Raises:
        SceneError: The geometry is a triangle soup or a kind that contacts cannot be found for.
        MeshError: The points of a hull all lie in one plane.
    """
    try:
        return _set_of(geometry)
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
def _set_of(geometry: Any) -> ConvexSet:
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
    """Find where two bodies touch.

    Args:
        first: Half-space, polytope or curved body.
        second: The other body; not a half-space.
        tolerance: Gaps up to this count as touching, m.
        max_penetration: Overlaps up to this pass for contact, m.

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
        return _on_plane(normal, float(normal @ origin) + one.offset, subject, tolerance)
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
    pair = _Pair(first, one, second, two, R.T @ R_second, t)
    nearest = pair.nearest(tolerance, max_penetration)
    if nearest is None:
        return None
    points, gaps = pair.shared(*nearest, tolerance)
    return Patch(R @ nearest[0], points @ R.T + origin, gaps)


def _on_plane(
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


def _heights(
    solid: BoundedSet,
    direction: FloatArray,
    points: FloatArray,
    feature: FloatArray,
    basis: FloatArray,
) -> FloatArray:
    """Return how far (K,) a body's surface is from points (K, 3) along a direction, own frame, m.

    Of a hull it is the surface itself. All others touch along a plane or a line, that of the
    feature (N, 3), which goes on beyond them; ``basis`` (2, 3) spans what is across the direction.
    """
    if is_hull(solid):
        return solid.heights_from(points, direction)
    flat = feature @ np.vstack([basis, direction]).T
    over = plane_fit([(u, v, h) for u, v, h in flat.tolist()])
    return np.array([over((u, v)) for u, v in (points @ basis.T).tolist()]) - points @ direction


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two bounded bodies in the frame of the first.

    Attributes:
        first: The first body.
        one: Its set.
        second: The second body.
        two: Its set.
        R: (3, 3) rotation of the second in the first's frame.
        t: (3,) its origin there, m.
    """

    first: CollisionBody
    one: BoundedSet
    second: CollisionBody
    two: BoundedSet
    R: FloatArray
    t: FloatArray

    def nearest(
        self, tolerance: float, max_penetration: float
    ) -> tuple[FloatArray, FloatArray, float] | None:
        """Search for the direction from one body to the other and a point between them.

        coal's direction is only as good as its distance, and at a gap of a micrometre that is poor.
        Of all directions the true one leaves the largest gap, so that the faces near the nearest
        points are tried against it. An overlap along no face is asked for again with the bodies
        pulled apart, first along their middles, then along the best direction so far: of rims that
        overlap by a hair, coal may take any direction for the shallowest, while of bodies apart it
        is sure.

        Returns:
            Direction (3,), point (3,) and gap, m; None if the bodies are far apart.
        """
        fixed = np.concatenate([self.one.constant_normals, -self.two.constant_normals @ self.R.T])
        fixed_gaps = self._gaps(fixed)
        if len(fixed) and float(fixed_gaps.max()) > tolerance:
            return None
        middles = unit_vector(self.t + self.R @ self.two.center - self.one.center)
        best_gap, best, witness = -np.inf, middles, self.t
        pulled = min(_PULLED_APART, _PULLED_SHARE * min(self.one.radius, self.two.radius))
        apart = np.zeros(3)
        for attempt in range(_MOST_ATTEMPTS):
            distance, on_first, on_second, guess = self._ask_coal(apart)
            if attempt == 0 and distance > tolerance + _DISTANCE_ERROR:
                return None
            guess = middles if guess is None else guess
            nearby = self._directions_near(on_first, on_second, guess)
            gaps = np.concatenate([fixed_gaps, self._gaps(nearby)])
            k = int((gaps >= gaps.max() - _SAME_GAP).argmax())
            direction = fixed[k] if k < len(fixed) else nearby[k - len(fixed)]
            gain = float(gaps[k]) - best_gap
            if gain > 0.0:
                best_gap, best = float(gaps[k]), direction
                witness = 0.5 * (on_first + on_second)
            on_a_face = k < len(gaps) - 1 and direction @ guess > _AGREED_COSINE
            known = on_a_face and (attempt > 0 or k < len(fixed))
            settled = known or (attempt >= 2 and gain <= _SAME_GAP)
            if best_gap >= 0.0 or (settled and best_gap >= -max_penetration):
                break
            axis = middles if attempt == 0 else best
            apart = (pulled - float(self._gaps(axis[None])[0])) * axis
        return (best, witness, best_gap) if best_gap <= tolerance else None

    def _gaps(self, directions: FloatArray) -> FloatArray:
        """Gap that each direction (K, 3) leaves between the bodies."""
        return (
            directions @ self.t
            - self.two.support_values(-(directions @ self.R))
            - self.one.support_values(directions)
        )

    def _directions_near(
        self, on_first: FloatArray, on_second: FloatArray, guess: FloatArray
    ) -> FloatArray:
        """Directions (K, 3) to try for nearest points and coal's direction, which comes last."""
        beside = self.two.normals_near((on_second - self.t) @ self.R, -(guess @ self.R))
        return np.concatenate(
            [
                self.one.normals_near(on_first, guess),
                -beside @ self.R.T,
                self._across_edges(guess),
                guess[None],
            ]
        )

    def _across_edges(self, guess: FloatArray) -> FloatArray:
        """Return the common normal (1, 3) of crossing edges, along the guess; (0, 3) for others."""
        first = self.one.feature(guess)
        second = self.two.feature(-(guess @ self.R)) if len(first) == 2 else first
        if len(first) == len(second) == 2:
            edge, other = first[1] - first[0], (second[1] - second[0]) @ self.R.T
            normal = np.cross(edge, other)
            length = float(np.linalg.norm(normal))
            if length > 1e-3 * np.linalg.norm(edge) * np.linalg.norm(other):
                return (np.sign(normal @ guess) * normal / length)[None]
        return np.empty((0, 3))

    def _ask_coal(
        self, apart: FloatArray
    ) -> tuple[float, FloatArray, FloatArray, FloatArray | None]:
        """Distance, nearest points and direction with the second body moved by ``apart``."""
        result: Any = coal.DistanceResult()
        placed = coal.Transform3s(np.ascontiguousarray(self.R), self.t + apart)
        distance = coal.distance(
            self.first.geometry, _IDENTITY, self.second.geometry, placed, DISTANCE_REQUEST, result
        )
        guess = np.array(result.normal)
        sure = bool(np.isfinite(guess).all() and guess.any())
        return (
            float(distance),
            np.array(result.getNearestPoint1()),
            np.array(result.getNearestPoint2()) - apart,
            unit_vector(guess) if sure else None,
        )

    def shared(
        self, normal: FloatArray, witness: FloatArray, gap: float, tolerance: float
    ) -> tuple[FloatArray, list[float]]:
        """Return points (K, 3) of what the bodies share along a direction, and their gaps, m."""
        window = self.one.feature(normal)
        back = -(normal @ self.R)
        subject = self.two.feature(back) @ self.R.T + self.t
        if len(subject) == 1 or len(window) == 1:
            # Along the direction that leaves the largest gap the point is one of the nearest pair.
            side = -0.5 if len(subject) == 1 else 0.5
            return (subject if len(subject) == 1 else window) + side * gap * normal, [gap]
        # With nothing in common the bodies meet at the borders of their features. Where all corners
        # are too far apart, surfaces that bend less than `PARALLEL_ANGLE` touch between them.
        basis = plane_basis(normal)
        flat, other = _project(window, basis), _project(subject, basis)
        polygon = intersection(flat, other) or shared_border(flat, other)
        feet = np.array([*polygon, basis @ witness]) @ basis
        low = _heights(self.one, normal, feet, window, basis)
        across = (subject - self.t) @ self.R, basis @ self.R
        high = -_heights(self.two, back, (feet - self.t) @ self.R, *across)
        middles = feet + (0.5 * (low + high))[:, None] * normal
        gaps = (high - low).tolist()
        kept = [k for k in range(len(polygon)) if gaps[k] <= tolerance] or [-1]
        return middles[kept], [gaps[k] for k in kept]


def _project(points: FloatArray, basis: FloatArray) -> Polygon:
    return planar_hull([(u, v) for u, v in (points @ basis.T).tolist()])
