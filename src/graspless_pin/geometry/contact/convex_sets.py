"""Convex sets by their support functions, faces and edges, and where two of them touch.

coal finds the nearest points of two bodies reliably, but its support polygons depend on the order
of the shapes and collapse at zero gap. Here every geometry is one of three sets whose touching
part in a given direction is known in closed form:

- `Plane`: a half-space;
- `Polytope`: a box or a convex hull;
- `Revolved`: a sphere, capsule, cylinder or cone, that is, the hull of two coaxial discs, swept by
  a sphere.

All coordinates are those of the geometry's own frame, in metres.

Two bodies touch in the polygon that they share, at a gap of either sign and at none. coal's nearest
points tell where two bodies are close. Direction and points are then found from the bodies' own
faces, edges and corners: the signed distance of convex bodies is the largest gap that any direction
leaves between them, so among coal's normal and the normals of the faces at hand the one with the
largest gap is right. Along it, the face, edge or corner of each body that lies farthest is
projected onto the contact plane, and their common part is where they touch. A half-space, and a
sphere on a face, need no coal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import coal  # pyright: ignore[reportMissingImports]
import numpy as np

from graspless_pin.caching import Derived
from graspless_pin.errors import MeshError, SceneError
from graspless_pin.geometry.bodies.collision import (
    PARALLEL_ANGLE,
    CollisionBody,
    Cuboid,
    Polytope,
    box_of,
    hull_of,
)
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

RIM_POINTS = 8
"""A rim stands for the inscribed regular polygon of so many points, the first on the x axis."""

DISTANCE_REQUEST: Any = coal.DistanceRequest()
"""With coal's default of 1e-6, one pair in hundreds comes out inside out at a micrometre of gap."""
DISTANCE_REQUEST.gjk_tolerance = DISTANCE_REQUEST.epa_tolerance = 1e-9

_NEAR_FACE = 1e-3  # a face within 1 mm of the nearest point may be the touching one
_RIM = np.array(
    [
        [math.cos(2.0 * math.pi * k / RIM_POINTS), math.sin(2.0 * math.pi * k / RIM_POINTS), 0.0]
        for k in range(RIM_POINTS)
    ]
)


@dataclass(frozen=True, eq=False)
class Plane:
    """The half-space normal . x <= offset.

    Attributes:
        normal: (3,) outward unit normal.
        offset: Distance of the plane from the origin along the normal, m.
    """

    normal: FloatArray
    offset: float

    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outward normals (1, 3) of the faces and a point's (3,) heights (1,) over them, m."""
        return self.normal[None], np.array([self.normal @ point - self.offset])


@dataclass(frozen=True, eq=False)
class Revolved:
    """The hull of two discs about the z axis, swept by a sphere.

    Attributes:
        bottom_radius: Radius of the disc at z = -half_length, m.
        top_radius: Radius of the disc at z = +half_length, m.
        half_length: Half the distance of the discs, m.
        swept_radius: Radius of the sweeping sphere, m.
    """

    bottom_radius: float
    top_radius: float
    half_length: float
    swept_radius: float

    constant_normals = None

    @cached_property
    def center(self) -> FloatArray:
        """(3,) centre of a sphere around the set, and of the box around it along its axes."""
        return np.zeros(3)

    @cached_property
    def radius(self) -> float:
        """Radius of that sphere, m."""
        disc = max(self.bottom_radius, self.top_radius)
        return math.hypot(disc, self.half_length) + self.swept_radius

    @cached_property
    def half_extents(self) -> FloatArray:
        """(3,) half the edge lengths of that box, m."""
        disc = max(self.bottom_radius, self.top_radius)
        return np.array([disc, disc, self.half_length]) + self.swept_radius

    @cached_property
    def is_sphere(self) -> bool:
        """Whether nothing but the sweeping sphere is left."""
        return self.half_length == self.bottom_radius == self.top_radius == 0.0

    def support_values(self, directions: FloatArray) -> FloatArray:
        """Largest d . x over the set for each row d of ``directions`` (K, 3): (K,)."""
        along = self.half_length * directions[:, 2]
        across = np.hypot(directions[:, 0], directions[:, 1])
        discs = np.maximum(self.bottom_radius * across - along, self.top_radius * across + along)
        return discs + self.swept_radius * np.linalg.norm(directions, axis=1)

    def feature(self, direction: FloatArray) -> FloatArray:
        """Rim, line ends or point that lies farthest along a unit direction.

        Args:
            direction: (3,) unit vector.

        Returns:
            (`RIM_POINTS`, 3) for a flat end, (2, 3) for a line of the mantle, (1, 3) for a point.
        """
        shift = self.swept_radius * direction
        if self.is_sphere:
            return shift[None]
        x, y, z = direction.tolist()
        across = math.hypot(x, y)
        if across <= PARALLEL_ANGLE:
            disc = self.top_radius if z > 0 else self.bottom_radius
            end = np.array([0.0, 0.0, math.copysign(self.half_length, z)])
            return end + shift + disc * _RIM if disc > 0 else (end + shift)[None]
        radial = np.array([x / across, y / across, 0.0])
        bottom = self.bottom_radius * radial - [0.0, 0.0, self.half_length]
        top = self.top_radius * radial + [0.0, 0.0, self.half_length]
        line = top - bottom
        length = float(np.linalg.norm(line))
        rise = float(line @ direction)
        if length > 0 and abs(rise) <= PARALLEL_ANGLE * length:
            return np.stack([bottom, top]) + shift
        return (top if rise > 0 else bottom)[None] + shift

    def normals_near(self, point: FloatArray, direction: FloatArray) -> FloatArray:
        """Outward normals (K, 3) of the flat ends near a point and of the mantle in a direction."""
        normals = []
        if self.top_radius > 0 and self.half_length - point[2] <= _NEAR_FACE:
            normals.append([0.0, 0.0, 1.0])
        if self.bottom_radius > 0 and self.half_length + point[2] <= _NEAR_FACE:
            normals.append([0.0, 0.0, -1.0])
        across = math.hypot(direction[0], direction[1])
        if self.half_length > 0 and across > 0:
            normals.append(self._mantle_normal(direction[0] / across, direction[1] / across))
        return np.array(normals).reshape(-1, 3)

    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outward normals (K, 3) of the faces and a point's (3,) heights (K,) over them, m.

        Of the mantle, the tangent plane that is nearest to the point counts.
        """
        x, y, z = point.tolist()
        if self.swept_radius > 0.0:
            core = np.array([0.0, 0.0, min(max(z, -self.half_length), self.half_length)])
            away = point - core
            distance = float(np.linalg.norm(away))
            normal = away / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
            return normal[None], np.array([distance - self.swept_radius])
        across = math.hypot(x, y)
        mantle = self._mantle_normal(*((x / across, y / across) if across > 0.0 else (1.0, 0.0)))
        normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], mantle])
        return normals, normals @ point - self.support_values(normals)

    def _mantle_normal(self, x: float, y: float) -> list[float]:
        """Return the normal of the mantle towards the unit vector (x, y)."""
        taper = self.bottom_radius - self.top_radius
        slant = math.hypot(2.0 * self.half_length, taper)
        outward = 2.0 * self.half_length / slant
        return [x * outward, y * outward, taper / slant]


ConvexSet = Plane | Polytope | Revolved


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


def is_hull(solid: ConvexSet) -> bool:
    """Return whether a set is the hull of points, whose faces may be those of a rough mesh."""
    return isinstance(solid, Polytope) and not isinstance(solid, Cuboid)


def _convert(geometry: Any) -> ConvexSet:
    if isinstance(geometry, coal.ShapeBase) and geometry.getSweptSphereRadius() == 0.0:
        match geometry:
            case coal.Halfspace():
                return Plane(np.array(geometry.n, dtype=float), float(geometry.d))
            case coal.Box():
                return box_of(np.array(geometry.halfSide, dtype=float))
            case coal.Convex():
                return hull_of(np.array(geometry.points(), dtype=float))
            case coal.Sphere():
                return Revolved(0.0, 0.0, 0.0, geometry.radius)
            case coal.Capsule():
                return Revolved(0.0, 0.0, geometry.halfLength, geometry.radius)
            case coal.Cylinder():
                return Revolved(geometry.radius, geometry.radius, geometry.halfLength, 0.0)
            case coal.Cone():
                return Revolved(geometry.radius, 0.0, geometry.halfLength, 0.0)
    raise SceneError(
        f"contacts cannot be found for a {type(geometry).__name__}; use a box, "
        "sphere, capsule, cylinder, cone, half-space or convex hull without a swept radius"
    )


_set_of: Derived[Any, ConvexSet] = Derived(_convert, most=math.inf)


_IDENTITY: Any = coal.Transform3s()
_DISTANCE_ERROR = 1e-4  # coal's distance is far better; this leaves room for large bodies
_PULLED_APART = 1e-3  # m: a gap at which coal's direction is sure
_MOST_ATTEMPTS = 5
_AGREED_COSINE = 1.0 - 1e-5  # cosine between a face normal and coal's direction
_SAME_GAP = 1e-9  # directions whose gaps differ by less are equally good


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
    if isinstance(one, Polytope) and isinstance(two, Revolved) and two.is_sphere:
        face, height, on_face = one.highest_face(t)
        gap = height - two.radius
        if gap > tolerance:
            return None
        if on_face:
            normal = R @ one.face_normals[face]
            middle = origin_second - 0.5 * (height + two.radius) * normal
            return Patch(normal, middle[None], [gap])
    relative = R.T @ R_second
    nearest = _Nearest(first, one, second, two, relative, t).find(tolerance, max_penetration)
    if nearest is None:
        return None
    normal, witness, gap = nearest
    back = -(normal @ relative)
    window, subject = one.feature(normal), two.feature(back) @ relative.T + t
    basis = plane_basis(normal)
    if len(subject) == 1 or len(window) == 1:
        # Along the direction that leaves the largest gap the point is one of the nearest pair.
        side = -0.5 if len(subject) == 1 else 0.5
        points, gaps = (subject if len(subject) == 1 else window) + side * gap * normal, [gap]
    else:
        # With nothing in common the bodies meet at the borders of their features. Where all corners
        # are too far apart, surfaces that bend less than `PARALLEL_ANGLE` touch between them.
        flat, other = _project(window, basis), _project(subject, basis)
        polygon = intersection(flat, other) or shared_border(flat, other)
        feet = np.array([*polygon, basis @ witness]) @ basis
        low = _heights(one, normal, feet, window, basis)
        across = (subject - t) @ relative, basis @ relative
        high = -_heights(two, back, (feet - t) @ relative, *across)
        middles = feet + (0.5 * (low + high))[:, None] * normal
        gaps = (high - low).tolist()
        near = [k for k in range(len(polygon)) if gaps[k] <= tolerance] or [-1]
        points, gaps = middles[near], [gaps[k] for k in near]
    return Patch(R @ normal, points @ R.T + origin, gaps)


def _on_plane(
    normal: FloatArray, offset: float, subject: FloatArray, tolerance: float
) -> Patch | None:
    heights = subject @ normal - offset
    gaps = heights.tolist()
    near = [k for k, gap in enumerate(gaps) if gap <= tolerance]
    if not near:
        return None
    points = (subject - (0.5 * heights)[:, None] * normal)[near]
    order = hull_order(points, normal) if len(near) > 1 else [0]
    return Patch(normal, points[order], [gaps[near[k]] for k in order])


def _heights(
    solid: Polytope | Revolved,
    direction: FloatArray,
    points: FloatArray,
    feature: FloatArray,
    basis: FloatArray,
) -> FloatArray:
    """Return how far (K,) a body's surface is from points (K, 3) along a direction, own frame, m.

    Of a hull it is the surface itself. All others touch along a plane or a line, that of the
    feature (N, 3), which goes on beyond them; ``basis`` (2, 3) spans what is across the direction.
    """
    if isinstance(solid, Polytope) and is_hull(solid):
        return solid.heights_from(points, direction)
    flat = feature @ np.vstack([basis, direction]).T
    over = plane_fit([(u, v, h) for u, v, h in flat.tolist()])
    return np.array([over((u, v)) for u, v in (points @ basis.T).tolist()]) - points @ direction


@dataclass(frozen=True, eq=False)
class _Nearest:
    """Search for the direction from one body to the other and a point between them.

    coal's direction is only as good as its distance, and at a gap of a micrometre that is poor. Of
    all directions the true one leaves the largest gap, so that the faces near the nearest points
    are tried against it. An overlap along no face is asked for again with the bodies pulled apart,
    first along their middles, then along the best direction so far: of rims that overlap by a
    hair, coal may take any direction for the shallowest, while of bodies apart it is sure.
    """

    first: CollisionBody
    one: Polytope | Revolved
    second: CollisionBody
    two: Polytope | Revolved
    R: FloatArray
    t: FloatArray

    def find(
        self, tolerance: float, max_penetration: float
    ) -> tuple[FloatArray, FloatArray, float] | None:
        """Return direction (3,), point (3,) and gap, m; None if the bodies are far apart."""
        fixed = self._constant_directions()
        fixed_gaps = self._gaps(fixed)
        if len(fixed) and float(fixed_gaps.max()) > tolerance:
            return None
        middles = unit_vector(self.t + self.R @ self.two.center - self.one.center)
        best_gap, best, witness = -np.inf, middles, self.t
        apart = np.zeros(3)
        for attempt in range(_MOST_ATTEMPTS):
            distance, on_first, on_second, guess = self._ask_coal(apart)
            if attempt == 0 and distance > tolerance + _DISTANCE_ERROR:
                return None
            guess = middles if guess is None else guess
            near = self._directions_near(on_first, on_second, guess)
            gaps = np.concatenate([fixed_gaps, self._gaps(near)])
            k = int((gaps >= gaps.max() - _SAME_GAP).argmax())
            direction = fixed[k] if k < len(fixed) else near[k - len(fixed)]
            gain = float(gaps[k]) - best_gap
            if gain > 0.0:
                best_gap, best = float(gaps[k]), direction
                witness = 0.5 * (on_first + on_second)
            on_a_face = k < len(gaps) - 1 and direction @ guess > _AGREED_COSINE
            settled = on_a_face or (attempt >= 2 and gain <= _SAME_GAP)
            if best_gap >= 0.0 or (settled and best_gap >= -max_penetration):
                break
            axis = middles if attempt == 0 else best
            apart = (_PULLED_APART - float(self._gaps(axis[None])[0])) * axis
        return (best, witness, best_gap) if best_gap <= tolerance else None

    def _gaps(self, directions: FloatArray) -> FloatArray:
        """Gap that each direction (K, 3) leaves between the bodies."""
        return (
            directions @ self.t
            - self.two.support_values(-(directions @ self.R))
            - self.one.support_values(directions)
        )

    def _constant_directions(self) -> FloatArray:
        """Directions (K, 3) that are tried wherever the nearest points are."""
        parts = []
        if self.one.constant_normals is not None:
            parts.append(self.one.constant_normals)
        if self.two.constant_normals is not None:
            parts.append(-self.two.constant_normals @ self.R.T)
        return np.concatenate(parts) if parts else np.empty((0, 3))

    def _directions_near(
        self, on_first: FloatArray, on_second: FloatArray, guess: FloatArray
    ) -> FloatArray:
        """Directions (K, 3) to try for nearest points and coal's direction, which comes last."""
        parts = [guess[None]]
        crossing = self._across_edges(guess)
        if crossing is not None:
            parts.insert(0, crossing[None])
        if self.two.constant_normals is None:
            near = self.two.normals_near((on_second - self.t) @ self.R, -(guess @ self.R))
            parts.insert(0, -near @ self.R.T)
        if self.one.constant_normals is None:
            parts.insert(0, self.one.normals_near(on_first, guess))
        return np.concatenate(parts)

    def _across_edges(self, guess: FloatArray) -> FloatArray | None:
        """Return common normal of two crossing edges, along the guess; None for other features."""
        first = self.one.feature(guess)
        if len(first) != 2:
            return None
        second = self.two.feature(-(guess @ self.R))
        if len(second) != 2:
            return None
        edge, other = first[1] - first[0], (second[1] - second[0]) @ self.R.T
        normal = np.cross(edge, other)
        length = float(np.linalg.norm(normal))
        if length <= 1e-3 * np.linalg.norm(edge) * np.linalg.norm(other):
            return None
        return np.sign(normal @ guess) * normal / length

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


def _project(points: FloatArray, basis: FloatArray) -> Polygon:
    return planar_hull([(u, v) for u, v in (points @ basis.T).tolist()])
