"""Convex sets by their support functions, faces and edges: what contacts are found with.

coal finds the nearest points of two bodies reliably, but its support polygons depend on the order
of the shapes and collapse at zero gap. Here every geometry is a set whose touching part in a given
direction is known in closed form: a `Plane`, or a `BoundedSet`, which is

- a `polytopes.Polytope`: a box or a convex hull;
- `Revolved`: a sphere, capsule, cylinder or cone, that is, the hull of two coaxial discs, swept by
  a sphere;
- or another kind of surface: a subclass has all that is asked about it, beside the shape that
  makes it (`shape.Shape.set_of`).

All coordinates are those of the geometry's own frame, in metres.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from graspless_pin.problem.checks import FloatArray, read_only

PARALLEL_ANGLE = 5e-3
"""Faces and edges tilted by less than this angle (rad) against the contact plane lie in it."""

RIM_POINTS = 8
"""A rim stands for the inscribed regular polygon of so many points, the first on the x axis."""

FLAT = 1e6
"""Radius of curvature of what is flat, m."""

SAME_SURFACE = 1e-4
"""How far pieces of one body may be off where they meet, m."""

NEAR_FACE = 1e-3
"""A face within 1 mm of the nearest point may be the touching one."""

AT_BORDER = 1e-6
"""What is nearer to an edge or corner is on it, m."""

_ENDLESS = 1e12  # m; finite, as zero times infinity is not a number
_RIM = np.array(
    [
        [math.cos(2.0 * math.pi * k / RIM_POINTS), math.sin(2.0 * math.pi * k / RIM_POINTS), 0.0]
        for k in range(RIM_POINTS)
    ]
)


@dataclass(frozen=True, eq=False)
class Plane:
    """The half-space normal . x <= offset; its methods are as those of `BoundedSet`.

    Attributes:
        normal: (3,) outward unit normal.
        offset: Distance of the plane from the origin along the normal, m.
    """

    normal: FloatArray
    offset: float

    is_curved: ClassVar[bool] = False
    center: ClassVar[FloatArray] = read_only(np.zeros(3))
    half_extents: ClassVar[FloatArray] = read_only(np.full(3, _ENDLESS))
    radius: ClassVar[float] = _ENDLESS

    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outward normals (1, 3) of the faces and a point's (3,) heights (1,) over them, m."""
        return self.normal[None], np.array([self.normal @ point - self.offset])

    def flat_faces(self) -> tuple[FloatArray, FloatArray]:
        """Return the outward normal (1, 3) and the offset (1,), m."""
        return self.normal[None], np.array([self.offset])

    def rises(self, point: FloatArray, direction: FloatArray) -> bool:  # noqa: ARG002
        """Return whether it has points higher along a direction than a point of its surface."""
        return bool(self.normal @ direction < math.cos(PARALLEL_ANGLE))

    def radii_of_curvature(
        self,
        point: FloatArray,  # noqa: ARG002
        outward: FloatArray,  # noqa: ARG002
        tangents: FloatArray,  # noqa: ARG002
    ) -> FloatArray:
        """Return `FLAT` in all directions: (2, 2), m."""
        return FLAT * np.eye(2)


class BoundedSet(ABC):
    """A bounded convex set with interior points: one kind of surface.

    A kind of surface has to tell what is abstract here. The rest holds for any; a kind that knows
    more about itself says so.

    Attributes:
        is_curved: Whether it has a curved surface. If not, it is made of faces, whose edges and
            corners its normal jumps at.
        swept_radius: Radius of a sphere that sweeps all of it, m: where it is rounded by that, the
            farthest point along a direction moves over it as it turns.
    """

    is_curved: ClassVar[bool] = True
    swept_radius: float = 0.0

    @abstractmethod
    def support_values(self, directions: FloatArray) -> FloatArray:
        """Largest d . x over the set for each row d of ``directions`` (K, 3): (K,)."""

    @abstractmethod
    def feature(self, direction: FloatArray) -> FloatArray:
        """Return the face, edge or point that lies farthest along a unit direction (3,).

        Returns:
            (K, 3) its corners: 1 for a point, 2 for an edge or line.
        """

    @abstractmethod
    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outward normals (K, 3) of the faces and a point's (3,) heights (K,) over them, m.

        Of what is curved, the tangent plane that is nearest to the point counts.
        """

    @abstractmethod
    def radii_of_curvature(
        self, point: FloatArray, outward: FloatArray, tangents: FloatArray
    ) -> FloatArray:
        """Return the radii of curvature at a point (3,) of the surface.

        Args:
            point: (3,) m.
            outward: (3,) unit normal there.
            tangents: (3, 2) along which they are asked for.

        Returns:
            (2, 2) symmetric, m: `FLAT` along what is flat, zero across an edge and at a corner.
        """

    @cached_property
    def center(self) -> FloatArray:
        """(3,) centre of a sphere around the set, and of the box around it along its axes."""
        return 0.5 * (self.support_values(np.eye(3)) - self.support_values(-np.eye(3)))

    @cached_property
    def half_extents(self) -> FloatArray:
        """(3,) half the edge lengths of that box, m."""
        return 0.5 * (self.support_values(np.eye(3)) + self.support_values(-np.eye(3)))

    @cached_property
    def radius(self) -> float:
        """Radius of that sphere, m; a sphere's own."""
        return float(np.linalg.norm(self.half_extents))

    @property
    def is_sphere(self) -> bool:
        """Whether nothing but the sweeping sphere is left, about the origin."""
        return self.swept_radius == self.radius

    @property
    def constant_normals(self) -> FloatArray:
        """Outward normals (K, 3) to try wherever the nearest point is."""
        return np.empty((0, 3))

    def normals_near(self, point: FloatArray, direction: FloatArray) -> FloatArray:  # noqa: ARG002
        """Outward normals (K, 3) to try, too, near a point close to the surface.

        Args:
            point: (3,) where coal has the nearest point, m.
            direction: (3,) unit, out of the set, as coal has it.
        """
        return self.faces_at(point)[0]

    def flat_faces(self) -> tuple[FloatArray, FloatArray]:
        """Outward normals (F, 3) of all flat faces, and their offsets (F,), m."""
        return np.empty((0, 3)), np.empty(0)

    def rises(self, point: FloatArray, direction: FloatArray) -> bool:
        """Return whether it has points higher along a direction than a point of its surface."""
        rise = float(self.support_values(direction[None])[0] - direction @ point)
        return rise > SAME_SURFACE + PARALLEL_ANGLE * 2.0 * self.radius


ConvexSet = Plane | BoundedSet


@dataclass(frozen=True, eq=False)
class Revolved(BoundedSet):
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
    swept_radius: float = 0.0

    @cached_property
    def radius(self) -> float:
        """See `BoundedSet.radius`."""
        disc = max(self.bottom_radius, self.top_radius)
        return math.hypot(disc, self.half_length) + self.swept_radius

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
        if self.top_radius > 0 and self.half_length - point[2] <= NEAR_FACE:
            normals.append([0.0, 0.0, 1.0])
        if self.bottom_radius > 0 and self.half_length + point[2] <= NEAR_FACE:
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

    def flat_faces(self) -> tuple[FloatArray, FloatArray]:
        """See `BoundedSet.flat_faces`: the ends that are discs."""
        normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
        wide = np.array([self.top_radius, self.bottom_radius]) > 0.0
        return normals[wide], self.support_values(normals)[wide]

    def radii_of_curvature(
        self, point: FloatArray, outward: FloatArray, tangents: FloatArray
    ) -> FloatArray:
        """Return the radii of two discs' hull, and those of the sphere that sweeps it."""
        swept = self.swept_radius * np.eye(2)
        across = math.hypot(outward[0], outward[1])
        feature = self.feature(outward)
        if across <= PARALLEL_ANGLE:
            disc = self.top_radius if outward[2] > 0.0 else self.bottom_radius
            at_rim = math.hypot(point[0], point[1]) > disc - AT_BORDER
            return swept if at_rim else swept + FLAT * np.eye(2)
        azimuth = np.array([-outward[1], outward[0], 0.0]) / across @ tangents
        disc = math.hypot(point[0], point[1]) - self.swept_radius * across
        radii = max(disc, 0.0) / across * np.outer(azimuth, azimuth)
        if len(feature) == 2:
            radii = radii + edge_radii(feature, point, tangents)
        return radii + swept

    def _mantle_normal(self, x: float, y: float) -> list[float]:
        """Return the normal of the mantle towards the unit vector (x, y)."""
        taper = self.bottom_radius - self.top_radius
        slant = math.hypot(2.0 * self.half_length, taper)
        outward = 2.0 * self.half_length / slant
        return [x * outward, y * outward, taper / slant]


def edge_radii(ends: FloatArray, point: FloatArray, tangents: FloatArray) -> FloatArray:
    """Return the radii (2, 2) at a point of an edge: `FLAT` along it, and zero at its ends, m.

    Args:
        ends: (2, 3) of the edge, m.
        point: (3,) on it, m.
        tangents: (3, 2) along which the radii are asked for.
    """
    if float(np.linalg.norm(point - ends, axis=1).min()) < AT_BORDER:
        return np.zeros((2, 2))
    along = (ends[1] - ends[0]) @ tangents
    return FLAT * (np.outer(along, along) / float(along @ along))


def foot_on_segment(point: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the point (3,) of a segment that is nearest to a point, m."""
    line = second - first
    share = float(np.clip((point - first) @ line / (line @ line), 0.0, 1.0))
    return first + share * line
