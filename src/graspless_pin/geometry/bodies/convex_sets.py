"""Convex sets by their support functions, faces and edges, for contact detection.

coal finds the nearest points of two bodies reliably, but its support polygons depend on the order
of the shapes and collapse at zero gap. Here every geometry is a set whose farthest feature in a
given direction is known in closed form: a `Plane`, or a `BoundedSet`, which is

- a `polytopes.Polytope`: a box or a convex hull;
- `SolidOfRevolution`: a sphere, capsule, cylinder or cone, that is, the hull of two coaxial discs,
  swept by a sphere;
- or another kind of surface: a subclass of `BoundedSet`, made by its shape
  (`shape.Shape.set_of`).

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
"""Faces and edges tilted by less than this against the contact plane lie in it, rad."""

RIM_POINTS = 8
"""Vertices of the inscribed regular polygon that replaces a rim; one is on the x axis."""

FLAT = 1e6
"""Radius of curvature that represents a flat direction, m."""

SAME_SURFACE = 1e-4
"""Largest offset between the surfaces of two pieces of one body where they meet, m."""

NEAR_FACE = 1e-3
"""Distance of the nearest point from a face up to which the face may be in contact, m."""

AT_BORDER = 1e-6
"""Distance from an edge or vertex up to which a point lies on it, m."""

_UNBOUNDED = 1e12  # m; finite, as zero times infinity is not a number
_RIM = np.array(
    [
        [math.cos(2.0 * math.pi * k / RIM_POINTS), math.sin(2.0 * math.pi * k / RIM_POINTS), 0.0]
        for k in range(RIM_POINTS)
    ]
)


@dataclass(frozen=True, eq=False)
class Plane:
    """The half-space normal . x <= offset; its methods are those of `BoundedSet`.

    Attributes:
        normal: (3,) outward unit normal.
        offset: Distance of the plane from the origin along the normal, m.
    """

    normal: FloatArray
    offset: float

    is_curved: ClassVar[bool] = False
    center: ClassVar[FloatArray] = read_only(np.zeros(3))
    half_extents: ClassVar[FloatArray] = read_only(np.full(3, _UNBOUNDED))
    radius: ClassVar[float] = _UNBOUNDED

    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the outward normal (1, 3) and a point's (3,) height (1,) over the plane, m."""
        return self.normal[None], np.array([self.normal @ point - self.offset])

    def flat_faces(self) -> tuple[FloatArray, FloatArray]:
        """Return the outward normal (1, 3) and the offset (1,), m."""
        return self.normal[None], np.array([self.offset])

    def has_higher_points(self, point: FloatArray, direction: FloatArray) -> bool:  # noqa: ARG002
        """See `BoundedSet.has_higher_points`: all unless the direction is the normal."""
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

    A subclass implements the abstract methods. The other methods hold for any such set; a subclass
    may override them with something more exact.

    Attributes:
        is_curved: Whether the surface is curved. If not, it consists of flat faces, and the normal
            jumps at their edges and vertices.
        swept_radius: Radius of a sphere that sweeps the whole set, m. Where the set is rounded by
            it, the farthest point along a direction moves over the surface as the set turns.
    """

    is_curved: ClassVar[bool] = True
    swept_radius: float = 0.0

    @abstractmethod
    def support_values(self, directions: FloatArray) -> FloatArray:
        """Return the support function: (K,) largest d . x for each row d of ``directions``."""

    @abstractmethod
    def feature(self, direction: FloatArray) -> FloatArray:
        """Return the face, edge or point that lies farthest along a unit direction (3,).

        Returns:
            (K, 3) its vertices: 1 for a point, 2 for an edge or line.
        """

    @abstractmethod
    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return outward face normals (K, 3) and a point's (3,) heights (K,) over the faces, m.

        A curved surface is represented by its tangent plane nearest to the point.
        """

    @abstractmethod
    def radii_of_curvature(
        self, point: FloatArray, outward: FloatArray, tangents: FloatArray
    ) -> FloatArray:
        """Return the radii of curvature at a point (3,) of the surface.

        Args:
            point: (3,) m.
            outward: (3,) unit normal there.
            tangents: (3, 2) directions of the rows and columns.

        Returns:
            (2, 2) symmetric, m: `FLAT` along flat directions, zero across an edge and at a vertex.
        """

    @cached_property
    def center(self) -> FloatArray:
        """(3,) centre of the bounding sphere and of the axis-aligned bounding box, m."""
        return 0.5 * (self.support_values(np.eye(3)) - self.support_values(-np.eye(3)))

    @cached_property
    def half_extents(self) -> FloatArray:
        """(3,) half the edge lengths of the axis-aligned bounding box, m."""
        return 0.5 * (self.support_values(np.eye(3)) + self.support_values(-np.eye(3)))

    @cached_property
    def radius(self) -> float:
        """Radius of the bounding sphere about `center`, m; of a sphere, its own."""
        return float(np.linalg.norm(self.half_extents))

    @property
    def is_sphere(self) -> bool:
        """Whether the set is the sweeping sphere alone, about the origin."""
        return self.swept_radius == self.radius

    @property
    def constant_normals(self) -> FloatArray:
        """(K, 3) outward normals to try as contact normals for any nearest point."""
        return np.empty((0, 3))

    def normals_near(self, point: FloatArray, direction: FloatArray) -> FloatArray:  # noqa: ARG002
        """Return further outward normals (K, 3) to try near a point close to the surface.

        Args:
            point: (3,) coal's nearest point, m.
            direction: (3,) coal's unit direction out of the set.
        """
        return self.faces_at(point)[0]

    def flat_faces(self) -> tuple[FloatArray, FloatArray]:
        """Return outward normals (F, 3) of all flat faces, and their offsets (F,), m."""
        return np.empty((0, 3)), np.empty(0)

    def has_higher_points(self, point: FloatArray, direction: FloatArray) -> bool:
        """Return whether the set has points higher along a direction than a surface point."""
        rise = float(self.support_values(direction[None])[0] - direction @ point)
        return rise > SAME_SURFACE + PARALLEL_ANGLE * 2.0 * self.radius


ConvexSet = Plane | BoundedSet


@dataclass(frozen=True, eq=False)
class SolidOfRevolution(BoundedSet):
    """The convex hull of two discs about the z axis, swept by a sphere.

    Attributes:
        bottom_radius: Radius of the disc at z = -half_length, m.
        top_radius: Radius of the disc at z = +half_length, m.
        half_length: Half the distance between the discs, m.
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
        """See `BoundedSet.support_values`."""
        axial = self.half_length * directions[:, 2]
        radial = np.hypot(directions[:, 0], directions[:, 1])
        discs = np.maximum(self.bottom_radius * radial - axial, self.top_radius * radial + axial)
        return discs + self.swept_radius * np.linalg.norm(directions, axis=1)

    def feature(self, direction: FloatArray) -> FloatArray:
        """Return the rim, line ends or point farthest along a unit direction.

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
        """Return normals (K, 3) of the flat ends near a point and of the mantle in a direction."""
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
        """See `BoundedSet.faces_at`; the mantle is represented by its nearest tangent plane."""
        x, y, z = point.tolist()
        if self.swept_radius > 0.0:
            core = np.array([0.0, 0.0, min(max(z, -self.half_length), self.half_length)])
            offset = point - core
            distance = float(np.linalg.norm(offset))
            normal = offset / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
            return normal[None], np.array([distance - self.swept_radius])
        across = math.hypot(x, y)
        mantle = self._mantle_normal(*((x / across, y / across) if across > 0.0 else (1.0, 0.0)))
        normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], mantle])
        return normals, normals @ point - self.support_values(normals)

    def flat_faces(self) -> tuple[FloatArray, FloatArray]:
        """See `BoundedSet.flat_faces`: the ends that are discs of positive radius."""
        normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
        is_disc = np.array([self.top_radius, self.bottom_radius]) > 0.0
        return normals[is_disc], self.support_values(normals)[is_disc]

    def radii_of_curvature(
        self, point: FloatArray, outward: FloatArray, tangents: FloatArray
    ) -> FloatArray:
        """Return the radii of the hull of the discs plus the radius of the sweeping sphere."""
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
            radii = radii + edge_curvature_radii(feature, point, tangents)
        return radii + swept

    def _mantle_normal(self, x: float, y: float) -> list[float]:
        """Return the outward normal of the mantle at the azimuth (x, y), a unit vector."""
        taper = self.bottom_radius - self.top_radius
        slant = math.hypot(2.0 * self.half_length, taper)
        radial_part = 2.0 * self.half_length / slant
        return [x * radial_part, y * radial_part, taper / slant]


def edge_curvature_radii(ends: FloatArray, point: FloatArray, tangents: FloatArray) -> FloatArray:
    """Return the radii (2, 2) at a point of an edge: `FLAT` along it, zero at its ends, m.

    Args:
        ends: (2, 3) ends of the edge, m.
        point: (3,) point on the edge, m.
        tangents: (3, 2) directions of the rows and columns.
    """
    if float(np.linalg.norm(point - ends, axis=1).min()) < AT_BORDER:
        return np.zeros((2, 2))
    edge = (ends[1] - ends[0]) @ tangents
    return FLAT * (np.outer(edge, edge) / float(edge @ edge))


def foot_on_segment(point: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the point (3,) of a segment nearest to a given point, m."""
    line = second - first
    share = float(np.clip((point - first) @ line / (line @ line), 0.0, 1.0))
    return first + share * line
