"""Boxes and convex hulls as polytopes: vertices, faces and edges in their own frame, metres."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, TypeGuard

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import MeshError
from graspless_pin.geometry.bodies.convex_sets import (
    AT_BORDER,
    FLAT,
    NEAR_FACE,
    PARALLEL_ANGLE,
    SAME_SURFACE,
    BoundedSet,
    ConvexSet,
    edge_curvature_radii,
    foot_on_segment,
)
from graspless_pin.problem.checks import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

_COS_PARALLEL = math.cos(PARALLEL_ANGLE)
_COPLANAR = 1e-3  # rad: triangles of one face, up to the noise of a mesh file
_FEW_FACES = 24  # so few are all tried, which is cheap and independent of the nearest point
_ON_FACE = 1e-9  # m


@dataclass(frozen=True, eq=False)
class Polytope(BoundedSet):
    """A bounded polytope with interior points.

    Attributes:
        vertices: (V, 3) vertices, m.
        face_normals: (F, 3) outward unit normals.
        face_offsets: (F,) distances of the faces from the origin, m.
        faces: (F, 3 or 4) vertices of each face; a flat face may consist of several triangles.
        edges: Per vertex, the neighbours along sharp edges as (index, length of the edge).
    """

    vertices: FloatArray
    face_normals: FloatArray
    face_offsets: FloatArray
    faces: NDArray[np.int64]
    edges: tuple[tuple[tuple[int, float], ...], ...]

    is_curved = False

    @property
    def constant_normals(self) -> FloatArray:
        """(F, 3) all face normals if they are few; else none: see `normals_near`."""
        return self.face_normals if len(self.face_normals) <= _FEW_FACES else np.empty((0, 3))

    @cached_property
    def radius(self) -> float:
        """See `BoundedSet.radius`."""
        return float(np.max(np.linalg.norm(self.vertices - self.center, axis=1)))

    def support_values(self, directions: FloatArray) -> FloatArray:
        """Largest d . x over the set for each row d of ``directions`` (K, 3): (K,)."""
        return (directions @ self.vertices.T).max(axis=1)

    def feature(self, direction: FloatArray) -> FloatArray:
        """Return the vertices of the face, edge or vertex farthest along a unit direction.

        Args:
            direction: (3,) unit vector.

        Returns:
            (K, 3) vertices in ascending order of their indices.
        """
        return self.vertices.take(self.farthest_vertices(direction), axis=0)

    def farthest_vertices(self, direction: FloatArray) -> tuple[int, ...]:
        """Return indices of the vertices of the feature farthest along a unit direction (3,).

        These are the vertices of all faces tilted by less than `PARALLEL_ANGLE`, and those that
        are connected to the farthest vertex by edges that descend by less than that angle. The
        rule has no length scale: a wide box and a fine mesh are both judged by angles.
        """
        heights = (self.vertices @ direction).tolist()
        start = max(range(len(heights)), key=heights.__getitem__)
        reached = {start}
        reached.update(self.faces[self.face_normals @ direction > _COS_PARALLEL].ravel().tolist())
        pending = list(reached)
        while pending:
            vertex = pending.pop()
            for neighbour, length in self.edges[vertex]:
                if (
                    neighbour not in reached
                    and heights[vertex] - heights[neighbour] <= PARALLEL_ANGLE * length
                ):
                    reached.add(neighbour)
                    pending.append(neighbour)
        return tuple(sorted(reached))

    def face_normal(self, corners: tuple[int, ...]) -> FloatArray | None:
        """Return the outward unit normal (3,) of the flat face with given vertices, else None.

        It is the mean of the normals of all faces spanned by these vertices. If every one of them
        is tilted against the mean by more than `PARALLEL_ANGLE`, the face is not flat.
        """
        normals = self.face_normals[np.isin(self.faces, corners).all(axis=1)]
        if not len(normals):
            return None
        total = normals.sum(axis=0)
        mean = total / np.linalg.norm(total)
        return mean if float((normals @ mean).max()) > _COS_PARALLEL else None

    def normals_near(self, point: FloatArray, direction: FloatArray) -> FloatArray:  # noqa: ARG002
        """See `BoundedSet.normals_near`: faces within `NEAR_FACE`, unless all are tried anyway."""
        if len(self.constant_normals):
            return np.empty((0, 3))
        return self.face_normals[self.face_offsets - self.face_normals @ point <= NEAR_FACE]

    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the outward face normals (K, 3) and a point's (3,) heights (K,) over them, m."""
        return self.face_normals, self.face_normals @ point - self.face_offsets

    def flat_faces(self) -> tuple[FloatArray, FloatArray]:
        """See `BoundedSet.flat_faces`."""
        return self.face_normals, self.face_offsets

    def has_higher_points(self, point: FloatArray, direction: FloatArray) -> bool:
        """See `BoundedSet.has_higher_points`; the tolerance grows with a vertex's distance."""
        arms = self.vertices - point
        lengths = np.linalg.norm(arms, axis=1)
        return bool((arms @ direction > SAME_SURFACE + PARALLEL_ANGLE * lengths).any())

    def radii_of_curvature(
        self, point: FloatArray, outward: FloatArray, tangents: FloatArray
    ) -> FloatArray:
        """Return the radii (2, 2) of a face, edge or vertex: `FLAT` if flat, else 0, m."""
        corners = self.farthest_vertices(outward)
        if len(corners) == 1:
            return np.zeros((2, 2))
        if len(corners) == 2:
            return edge_curvature_radii(self.vertices[list(corners)], point, tangents)
        # At the border of a face the contact may be that of an edge or a vertex.
        feature_vertices = set(corners)
        for first in corners:
            for second, _ in self.edges[first]:
                if first < second and second in feature_vertices:
                    ends = self.vertices[[first, second]]
                    if np.linalg.norm(foot_on_segment(point, *ends) - point) < AT_BORDER:
                        return edge_curvature_radii(ends, point, tangents)
        return FLAT * np.eye(2)

    def heights_from(self, points: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the distances (K,) of points (K, 3) to the surface along a unit direction (3,), m.

        Negative where a point is beyond the surface. The surface is extended past its border: if
        the farthest feature along the direction is a face, faces tilted by more than 60 degrees
        are ignored; if it is an edge or a vertex, the line through it is a lower bound.
        """
        cosines = self.face_normals @ direction
        on_face = bool((cosines > _COS_PARALLEL).any())
        ahead = cosines > (0.5 if on_face else 0.0)
        normals = self.face_normals[ahead]
        gaps = ((self.face_offsets[ahead] - points @ normals.T) / cosines[ahead]).min(axis=1)
        if on_face:
            return gaps
        ridge = self.feature(direction)
        return np.maximum(gaps, _ridge_heights(ridge, points, direction) - points @ direction)

    def highest_face(self, point: FloatArray) -> tuple[int, float, bool]:
        """Return the face over which a point (3,) is highest, the height, m, and a flag.

        The flag is True if the foot of the point lies on that face, or the point is inside; then
        no other direction has a larger gap to the point.
        """
        heights = self.face_normals @ point - self.face_offsets
        face = int(heights.argmax())
        height = float(heights[face])
        foot_heights = heights - height * (self.face_normals @ self.face_normals[face])
        return face, height, height <= 0.0 or bool(foot_heights.max() <= _ON_FACE)


def _ridge_heights(ridge: FloatArray, points: FloatArray, direction: FloatArray) -> FloatArray:
    """Return heights (K,) along a unit direction of the line below an edge's vertices (N, 3), m.

    A point (K, 3) off the line, seen along the direction, gets the height of its foot on the line.
    """
    middle = ridge.mean(axis=0)
    arms = ridge - middle
    rises = arms @ direction
    across = arms - np.outer(rises, direction)
    longest_arm = across[int(np.einsum("ni,ni->n", across, across).argmax())]
    positions = across @ longest_arm
    slope = float(rises @ positions / (positions @ positions)) if positions.any() else 0.0
    return (
        middle @ direction
        + slope * ((points - middle) @ longest_arm)
        + float((rises - slope * positions).min())
    )


@dataclass(frozen=True, eq=False)
class Cuboid(Polytope):
    """A box about the origin; the vertex of index 4x + 2y + z lies at the signs of x, y and z."""

    def farthest_vertices(self, direction: FloatArray) -> tuple[int, ...]:
        """See `Polytope.farthest_vertices`; edges along axes of small components are level."""
        x, y, z = direction.tolist()
        signs = (
            0 if abs(x) <= PARALLEL_ANGLE else (1 if x > 0.0 else -1),
            0 if abs(y) <= PARALLEL_ANGLE else (1 if y > 0.0 else -1),
            0 if abs(z) <= PARALLEL_ANGLE else (1 if z > 0.0 else -1),
        )
        return _box_corners(signs)


def is_hull(solid: ConvexSet) -> TypeGuard[Polytope]:
    """Return whether a set is a hull of points, whose faces may be those of a rough mesh."""
    return isinstance(solid, Polytope) and not isinstance(solid, Cuboid)


@cache
def _box_corners(signs: tuple[int, int, int]) -> tuple[int, ...]:
    """Return the vertices of a box with given signs; a sign of 0 means both sides."""
    indices = [0]
    for bit, sign in zip((4, 2, 1), signs, strict=True):
        if sign == 0:
            indices += [index + bit for index in indices]
        elif sign > 0:
            indices = [index + bit for index in indices]
    return tuple(sorted(indices))


def box_polytope(half: FloatArray) -> Cuboid:
    """Return the box about the origin with given half edge lengths (3,)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    edges = tuple(
        tuple((vertex ^ bit, 2.0 * float(half[axis])) for bit, axis in ((4, 0), (2, 1), (1, 2)))
        for vertex in range(8)
    )
    normals = np.vstack([np.eye(3), -np.eye(3)])
    offsets = np.concatenate([half, half])
    faces = np.array([np.flatnonzero(signs @ normal > 0) for normal in normals])
    return Cuboid(signs * half, normals, offsets, faces, edges)


def qhull(points: FloatArray, label: str, options: str | None = None) -> ConvexHull:
    """Return Qhull's convex hull of (N, 3) points.

    Args:
        points: In metres.
        label: The name of the points in messages.
        options: Options of Qhull; None: its defaults.

    Raises:
        MeshError: All points lie in one plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points, qhull_options=options)
    except (QhullError, ValueError) as error:
        raise MeshError(
            f"{label} encloses no volume: all of its vertices lie in one plane"
        ) from error


def hull_polytope(points: FloatArray, label: str = "its convex hull") -> Polytope:
    """Return the convex hull of (N, 3) points as a polytope; arguments and errors as `qhull`."""
    hull = qhull(points, label)
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
        tuple((j, float(np.linalg.norm(vertices[i] - vertices[j]))) for j in sorted(adjacent))
        for i, adjacent in enumerate(neighbours)
    )
    return Polytope(vertices, normals, -hull.equations[:, 3], triangles, edges)
