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
import weakref
from dataclasses import dataclass
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from graspless_pin.errors import MeshError, SceneError

Array = NDArray[np.float64]

PARALLEL_ANGLE = 5e-3
"""Faces and edges tilted by less than this angle (rad) against the contact plane lie in it."""

RIM_POINTS = 8
"""A rim stands for the inscribed regular polygon of so many points, the first on the x axis."""

_COS_PARALLEL = math.cos(PARALLEL_ANGLE)
_COPLANAR = 1e-3  # rad: triangles of one face, up to the noise of a mesh file
_FEW_FACES = 24  # trying them all costs nothing and does not depend on the nearest point
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

    normal: Array
    offset: float


@dataclass(frozen=True, eq=False)
class Polytope:
    """A bounded polytope with interior points.

    Attributes:
        vertices: (V, 3) corner points.
        face_normals: (F, 3) outward unit normals.
        face_offsets: (F,) distances of the faces from the origin, m.
        faces: (F, 3 or 4) vertices of each face; a flat face may come in several triangles.
        edges: Per vertex, the neighbours along true edges as (index, length of the edge).
        center: (3,) centre of a sphere around the set.
        radius: Radius of that sphere, m.
    """

    vertices: Array
    face_normals: Array
    face_offsets: Array
    faces: NDArray[np.int64]
    edges: tuple[tuple[tuple[int, float], ...], ...]
    center: Array
    radius: float

    def support_values(self, directions: Array) -> Array:
        """Largest d . x over the set for each row d of ``directions`` (K, 3): (K,)."""
        return np.max(directions @ self.vertices.T, axis=1)

    def feature(self, direction: Array) -> Array:
        """Corner points of the face, edge or corner that lies farthest along a unit direction.

        That is, the faces tilted by less than `PARALLEL_ANGLE`, and what can be reached from the
        farthest vertex along edges that fall off by less than it. The rule has no length in it, so
        that a wide box and the hull of a fine mesh are both judged by their angles.

        Args:
            direction: (3,) unit vector.

        Returns:
            (K, 3) vertices by rising index.
        """
        heights = (self.vertices @ direction).tolist()
        start = max(range(len(heights)), key=heights.__getitem__)
        reached = {start}
        reached.update(self.faces[self.face_normals @ direction > _COS_PARALLEL].ravel().tolist())
        waiting = list(reached)
        while waiting:
            here = waiting.pop()
            for there, length in self.edges[here]:
                if (
                    there not in reached
                    and heights[here] - heights[there] <= PARALLEL_ANGLE * length
                ):
                    reached.add(there)
                    waiting.append(there)
        return self.vertices[sorted(reached)]

    def normals_near(self, point: Array, direction: Array) -> Array:  # noqa: ARG002
        """Outward normals (K, 3) of the faces within a millimetre of a point (3,); of few, all."""
        if len(self.face_normals) <= _FEW_FACES:
            return self.face_normals
        return self.face_normals[self.face_offsets - self.face_normals @ point <= _NEAR_FACE]


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

    @property
    def center(self) -> Array:
        """(3,) centre of a sphere around the set."""
        return np.zeros(3)

    @property
    def radius(self) -> float:
        """Radius of that sphere, m."""
        disc = max(self.bottom_radius, self.top_radius)
        return math.hypot(disc, self.half_length) + self.swept_radius

    def support_values(self, directions: Array) -> Array:
        """Largest d . x over the set for each row d of ``directions`` (K, 3): (K,)."""
        along = self.half_length * directions[:, 2]
        across = np.hypot(directions[:, 0], directions[:, 1])
        discs = np.maximum(self.bottom_radius * across - along, self.top_radius * across + along)
        return discs + self.swept_radius * np.linalg.norm(directions, axis=1)

    def feature(self, direction: Array) -> Array:
        """Rim, line ends or point that lies farthest along a unit direction.

        Args:
            direction: (3,) unit vector.

        Returns:
            (`RIM_POINTS`, 3) for a flat end, (2, 3) for a line of the mantle, (1, 3) for a point.
        """
        x, y, z = direction.tolist()
        across = math.hypot(x, y)
        shift = self.swept_radius * direction
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

    def normals_near(self, point: Array, direction: Array) -> Array:
        """Outward normals (K, 3) of the flat ends near a point and of the mantle in a direction."""
        normals = []
        if self.top_radius > 0 and self.half_length - point[2] <= _NEAR_FACE:
            normals.append([0.0, 0.0, 1.0])
        if self.bottom_radius > 0 and self.half_length + point[2] <= _NEAR_FACE:
            normals.append([0.0, 0.0, -1.0])
        across = math.hypot(direction[0], direction[1])
        if self.half_length > 0 and across > 0:
            taper = self.bottom_radius - self.top_radius
            slant = math.hypot(2.0 * self.half_length, taper)
            outward = 2.0 * self.half_length / slant / across
            normals.append([direction[0] * outward, direction[1] * outward, taper / slant])
        return np.array(normals).reshape(-1, 3)


ConvexSet = Plane | Polytope | Revolved

# coal compares geometries by value but hashes them by identity, so that a weak table finds the
# very object.
_known: weakref.WeakKeyDictionary[Any, ConvexSet] = weakref.WeakKeyDictionary()


def convex_set(name: str, geometry: Any) -> ConvexSet:
    """The set that a coal geometry fills, remembered for as long as the geometry object lives.

    Args:
        name: Name of the body, for the message.
        geometry: coal primitive or convex hull.

    Raises:
        SceneError: The geometry is a triangle soup or a kind that contacts cannot be found for.
        MeshError: The points of a hull all lie in one plane.
    """
    known = _known.get(geometry)
    if known is None:
        known = _known[geometry] = _convert(name, geometry)
    return known


def _convert(name: str, geometry: Any) -> ConvexSet:
    if isinstance(geometry, coal.ShapeBase) and geometry.getSweptSphereRadius() == 0.0:
        match geometry:
            case coal.Halfspace():
                return Plane(np.array(geometry.n, dtype=float), float(geometry.d))
            case coal.Box():
                return _box(np.array(geometry.halfSide, dtype=float))
            case coal.Convex():
                try:
                    return hull_of(np.array(geometry.points(), dtype=float))
                except QhullError as error:
                    raise MeshError(f"body '{name}': its convex hull encloses no volume") from error
            case coal.Sphere():
                return Revolved(0.0, 0.0, 0.0, geometry.radius)
            case coal.Capsule():
                return Revolved(0.0, 0.0, geometry.halfLength, geometry.radius)
            case coal.Cylinder():
                return Revolved(geometry.radius, geometry.radius, geometry.halfLength, 0.0)
            case coal.Cone():
                return Revolved(geometry.radius, 0.0, geometry.halfLength, 0.0)
            case _:
                pass
    raise SceneError(
        f"body '{name}': contacts cannot be found for a {type(geometry).__name__}; use a box, "
        "sphere, capsule, cylinder, cone, half-space or convex hull without a swept radius"
    )


def _box(half: Array) -> Polytope:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    edges = tuple(
        tuple((vertex ^ bit, 2.0 * float(half[axis])) for bit, axis in ((4, 0), (2, 1), (1, 2)))
        for vertex in range(8)
    )
    normals = np.vstack([np.eye(3), -np.eye(3)])
    offsets = np.concatenate([half, half])
    faces = np.array([np.flatnonzero(signs @ normal > 0) for normal in normals])
    radius = float(np.linalg.norm(half))
    return Polytope(signs * half, normals, offsets, faces, edges, np.zeros(3), radius)


def hull_of(points: Array) -> Polytope:
    """The convex hull of (N, 3) points that do not all lie in one plane."""
    hull = ConvexHull(points)
    index = np.full(len(points), -1)
    index[hull.vertices] = np.arange(len(hull.vertices))
    vertices = points[hull.vertices]
    triangles = index[hull.simplices]
    normals = hull.equations[:, :3]
    neighbours: list[set[int]] = [set() for _ in vertices]
    for corner in range(3):
        # Qhull's k-th neighbour of a triangle lies across the edge opposite to its k-th corner.
        turn = np.linalg.norm(np.cross(normals, normals[hull.neighbors[:, corner]]), axis=1)
        opposite = np.einsum("fi,fi->f", normals, normals[hull.neighbors[:, corner]]) < 0
        sharp = triangles[(turn > _COPLANAR) | opposite]
        for a, b in np.delete(sharp, corner, axis=1).tolist():
            neighbours[a].add(b)
            neighbours[b].add(a)
    edges = tuple(
        tuple((j, float(np.linalg.norm(vertices[i] - vertices[j]))) for j in sorted(near))
        for i, near in enumerate(neighbours)
    )
    center = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = float(np.max(np.linalg.norm(vertices - center, axis=1)))
    return Polytope(vertices, normals, -hull.equations[:, 3], triangles, edges, center, radius)
