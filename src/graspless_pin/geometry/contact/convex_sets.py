"""Convex sets by their support functions, faces and edges: what contact patches are made from.

coal finds the nearest points of two bodies reliably, but its support polygons depend on the order
of the shapes and collapse at zero gap. Here every geometry is one of three sets whose touching
part in a given direction is known in closed form:

- `Plane`: a half-space;
- `Polytope`: a box or a convex hull;
- `Revolved`: a sphere, capsule, cylinder or cone, that is, the hull of two coaxial discs, swept by
  a sphere.

All coordinates are those of the geometry's own frame, in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np

from graspless_pin.caching import Derived
from graspless_pin.errors import MeshError, SceneError
from graspless_pin.geometry.bodies.polytopes import PARALLEL_ANGLE, Polytope, box_of, hull_of
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
        return _SETS.of(geometry)
    except (SceneError, MeshError) as error:
        raise type(error)(f"body '{name}': {error}") from error


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


_SETS: Derived[Any, ConvexSet] = Derived(_convert, most=math.inf)
