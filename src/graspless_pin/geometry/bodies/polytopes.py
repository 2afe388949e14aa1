"""Boxes and convex hulls by their corners, faces and edges, in the geometry's own frame, metres."""

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
    edge_radii,
    foot_on_segment,
)
from graspless_pin.problem.checks import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

_COS_PARALLEL = math.cos(PARALLEL_ANGLE)
_COPLANAR = 1e-3  # rad: triangles of one face, up to the noise of a mesh file
_FEW_FACES = 24  # trying them all costs nothing and does not depend on the nearest point
_ON_FACE = 1e-9  # m


@dataclass(frozen=True, eq=False)
class Polytope(BoundedSet):
    """A bounded polytope with interior points.

    Attributes:
        vertices: (V, 3) corner points.
        face_normals: (F, 3) outward unit normals.
        face_offsets: (F,) distances of the faces from the origin, m.
        faces: (F, 3 or 4) vertices of each face; a flat face may come in several triangles.
        edges: Per vertex, the neighbours along true edges as (index, length of the edge).
    """

    vertices: FloatArray
    face_normals: FloatArray
    face_offsets: FloatArray
    faces: NDArray[np.int64]
    edges: tuple[tuple[tuple[int, float], ...], ...]

    is_curved = False

    @property
    def constant_normals(self) -> FloatArray:
        """All face normals if they are few; else those near a point are picked."""
        return self.face_normals if len(self.face_normals) <= _FEW_FACES else np.empty((0, 3))

    @cached_property
    def radius(self) -> float:
        """See `BoundedSet.radius`."""
        return float(np.max(np.linalg.norm(self.vertices - self.center, axis=1)))

    def support_values(self, directions: FloatArray) -> FloatArray:
        """Largest d . x over the set for each row d of ``directions`` (K, 3): (K,)."""
        return (directions @ self.vertices.T).max(axis=1)

    def feature(self, direction: FloatArray) -> FloatArray:
        """Corner points of the face, edge or corner that lies farthest along a unit direction.

        Args:
            direction: (3,) unit vector.

        Returns:
            (K, 3) vertices by rising index.
        """
        return self.vertices.take(self.farthest(direction), axis=0)

    def farthest(self, direction: FloatArray) -> tuple[int, ...]:
        """Return the vertices of the face, edge or corner farthest along a unit direction (3,).

        That is, the faces tilted by less than `PARALLEL_ANGLE`, and what can be reached from the
        farthest vertex along edges that fall off by less than it. The rule has no length in it, so
        that a wide box and the hull of a fine mesh are both judged by their angles.
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
        return tuple(sorted(reached))

    def face_normal(self, corners: tuple[int, ...]) -> FloatArray | None:
        """Outward unit normal (3,) of the flat face with these vertices; None for other features.

        That is, the mean of the normals of all faces that lie between them. Where each of these
        is tilted against it by more than `PARALLEL_ANGLE`, they do not make one flat face.
        """
        between = self.face_normals[np.isin(self.faces, corners).all(axis=1)]
        if not len(between):
            return None
        total = between.sum(axis=0)
        mean = total / np.linalg.norm(total)
        return mean if float((between @ mean).max()) > _COS_PARALLEL else None

    def normals_near(self, point: FloatArray, direction: FloatArray) -> FloatArray:  # noqa: ARG002
        """See `BoundedSet.normals_near`: those of many faces that are within a millimetre."""
        if len(self.constant_normals):
            return np.empty((0, 3))
        return self.face_normals[self.face_offsets - self.face_normals @ point <= NEAR_FACE]

    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outward normals (K, 3) of the faces and a point's (3,) heights (K,) over them, m."""
        return self.face_normals, self.face_normals @ point - self.face_offsets

    def flat_faces(self) -> tuple[FloatArray, FloatArray]:
        """See `BoundedSet.flat_faces`."""
        return self.face_normals, self.face_offsets

    def rises(self, point: FloatArray, direction: FloatArray) -> bool:
        """See `BoundedSet.rises`; how far away a corner is counts."""
        arms = self.vertices - point
        lengths = np.linalg.norm(arms, axis=1)
        return bool((arms @ direction > SAME_SURFACE + PARALLEL_ANGLE * lengths).any())

    def radii_of_curvature(
        self, point: FloatArray, outward: FloatArray, tangents: FloatArray
    ) -> FloatArray:
        """Return the radii of a face, edge or corner: `FLAT` along what is flat, else zero."""
        corners = self.farthest(outward)
        if len(corners) == 1:
            return np.zeros((2, 2))
        if len(corners) == 2:
            return edge_radii(self.vertices[list(corners)], point, tangents)
        # A point on the border of a face may be where a corner or an edge of it rests.
        inside = set(corners)
        for first in corners:
            for second, _ in self.edges[first]:
                if first < second and second in inside:
                    ends = self.vertices[[first, second]]
                    if np.linalg.norm(foot_on_segment(point, *ends) - point) < AT_BORDER:
                        return edge_radii(ends, point, tangents)
        return FLAT * np.eye(2)

    def heights_from(self, points: FloatArray, direction: FloatArray) -> FloatArray:
        """Return how far (K,) the surface is from points (K, 3) along a unit direction (3,), m.

        Negative where a point is beyond it. Past a border the surface goes on: where a face lies
        farthest along the direction, those tilted by more than 60 degrees against it do not count;
        where an edge or a corner does, the line along that is the least height.
        """
        cosines = self.face_normals @ direction
        on_face = bool((cosines > _COS_PARALLEL).any())
        ahead = cosines > (0.5 if on_face else 0.0)
        normals = self.face_normals[ahead]
        away = ((self.face_offsets[ahead] - points @ normals.T) / cosines[ahead]).min(axis=1)
        if on_face:
            return away
        ridge = self.feature(direction)
        return np.maximum(away, _heights_of_line(ridge, points, direction) - points @ direction)

    def highest_face(self, point: FloatArray) -> tuple[int, float, bool]:
        """Tell over which face a point (3,) is highest, how high, m, and if its foot is on it.

        If the foot is, or if the point is inside, no other direction leaves a larger gap to it.
        """
        over = self.face_normals @ point - self.face_offsets
        face = int(over.argmax())
        height = float(over[face])
        of_foot = over - height * (self.face_normals @ self.face_normals[face])
        return face, height, height <= 0.0 or bool(of_foot.max() <= _ON_FACE)


def _heights_of_line(ridge: FloatArray, points: FloatArray, direction: FloatArray) -> FloatArray:
    """Heights (K,) along a unit direction of the line under the corners (N, 3) of an edge, m.

    Seen along the direction, a point (K, 3) beside the line has that of its foot.
    """
    middle = ridge.mean(axis=0)
    arms = ridge - middle
    rises = arms @ direction
    across = arms - np.outer(rises, direction)
    longest = across[int(np.einsum("ni,ni->n", across, across).argmax())]
    along = across @ longest
    slope = float(rises @ along / (along @ along)) if along.any() else 0.0
    return (
        middle @ direction
        + slope * ((points - middle) @ longest)
        + float((rises - slope * along).min())
    )


@dataclass(frozen=True, eq=False)
class Cuboid(Polytope):
    """A box about the origin; the vertex of index 4x + 2y + z lies at the signs of x, y and z."""

    def farthest(self, direction: FloatArray) -> tuple[int, ...]:
        """See `Polytope.farthest`; along each axis the edges fall off by the direction's part."""
        x, y, z = direction.tolist()
        signs = (
            0 if abs(x) <= PARALLEL_ANGLE else (1 if x > 0.0 else -1),
            0 if abs(y) <= PARALLEL_ANGLE else (1 if y > 0.0 else -1),
            0 if abs(z) <= PARALLEL_ANGLE else (1 if z > 0.0 else -1),
        )
        return _box_corners(signs)


def is_hull(solid: ConvexSet) -> TypeGuard[Polytope]:
    """Return whether a set is the hull of points, whose faces may be those of a rough mesh."""
    return isinstance(solid, Polytope) and not isinstance(solid, Cuboid)


@cache
def _box_corners(signs: tuple[int, int, int]) -> tuple[int, ...]:
    """Return a box's vertices on the sides of some signs, of both sides where the sign is 0."""
    indices = [0]
    for bit, sign in zip((4, 2, 1), signs, strict=True):
        if sign == 0:
            indices += [index + bit for index in indices]
        elif sign > 0:
            indices = [index + bit for index in indices]
    return tuple(sorted(indices))


def box_of(half: FloatArray) -> Cuboid:
    """Return the box about the origin with (3,) half edge lengths."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    edges = tuple(
        tuple((vertex ^ bit, 2.0 * float(half[axis])) for bit, axis in ((4, 0), (2, 1), (1, 2)))
        for vertex in range(8)
    )
    normals = np.vstack([np.eye(3), -np.eye(3)])
    offsets = np.concatenate([half, half])
    faces = np.array([np.flatnonzero(signs @ normal > 0) for normal in normals])
    return Cuboid(signs * half, normals, offsets, faces, edges)


def qhull(points: FloatArray, what: str, options: str | None = None) -> ConvexHull:
    """Return the convex hull of (N, 3) points as Qhull has it.

    Args:
        points: In metres.
        what: What messages call them.
        options: Of Qhull; None: its own.

    Raises:
        MeshError: All points lie in one plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points, qhull_options=options)
    except (QhullError, ValueError) as error:
        raise MeshError(
            f"{what} encloses no volume: all of its vertices lie in one plane"
        ) from error


def hull_of(points: FloatArray, what: str = "its convex hull") -> Polytope:
    """Return the convex hull of (N, 3) points; arguments and errors as of `qhull`."""
    hull = qhull(points, what)
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
