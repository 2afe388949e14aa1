"""The form in which hands, objects and supports hand their geometry to contact detection.

Convex pieces at poses; boxes and convex hulls by their corners, faces and edges, in the geometry's
own frame, metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, MeshError
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import unchecked

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull


@dataclass(frozen=True, eq=False)
class CollisionBody:
    """One convex piece of geometry at a pose.

    What is derived from the geometry (vertices, faces) is remembered for as long as the geometry
    object lives: keep one Python object per shape and make new bodies from it.

    Attributes:
        name: Name of the hand link, support or object that the geometry belongs to.
        geometry: coal primitive or convex hull, never a triangle soup.
        T_world_geometry: (4, 4) read-only pose of the geometry, m.
    """

    name: str
    geometry: Any
    T_world_geometry: FloatArray

    def __post_init__(self) -> None:
        """Copy the pose.

        Raises:
            ArgumentError: The pose is not a (4, 4) array.
        """
        pose = np.array(self.T_world_geometry, dtype=float)
        if pose.shape != (4, 4):
            raise ArgumentError("T_world_geometry", f"needs shape (4, 4), got {pose.shape}")
        object.__setattr__(self, "T_world_geometry", read_only(pose))


@dataclass(frozen=True, eq=False)
class BodyShapes:
    """What does not change when bodies move. Keep one object for all their poses.

    Attributes:
        names: K names of hand links, supports or objects.
        geometries: K coal primitives or convex hulls.
    """

    names: tuple[str, ...]
    geometries: tuple[Any, ...]


class PlacedBodies(Sequence[CollisionBody]):
    """Bodies at poses, each made when it is asked for: most of a hand touches nothing.

    Attributes:
        shapes: What they are.
        poses: (K, 4, 4) read-only poses of the geometries, m.
    """

    __slots__ = ("_made", "poses", "shapes")

    def __init__(self, shapes: BodyShapes, poses: FloatArray) -> None:
        """Place the shapes; ``poses`` is kept, not copied."""
        self.shapes = shapes
        self.poses = read_only(poses)
        self._made: dict[int, CollisionBody] = {}

    @classmethod
    def at_one_pose(cls, shapes: BodyShapes, T: FloatArray) -> PlacedBodies:
        """Place all shapes, at least one, at the same pose (4, 4), which is kept."""
        count = len(shapes.names)
        return cls(shapes, T[None] if count == 1 else np.repeat(T[None], count, axis=0))

    @classmethod
    def joined(cls, parts: Sequence[PlacedBodies]) -> PlacedBodies:
        """Put bodies that are placed together one after the other."""
        if len(parts) == 1:
            return parts[0]
        names = tuple(name for part in parts for name in part.shapes.names)
        geometries = tuple(shape for part in parts for shape in part.shapes.geometries)
        poses = np.concatenate([np.empty((0, 4, 4)), *(part.poses for part in parts)])
        return cls(BodyShapes(names, geometries), poses)

    @classmethod
    def of(cls, bodies: Sequence[CollisionBody]) -> PlacedBodies:
        """Take bodies that are given one by one; placed bodies are returned as they are."""
        if isinstance(bodies, PlacedBodies):
            return bodies
        shapes = BodyShapes(
            tuple([body.name for body in bodies]), tuple([body.geometry for body in bodies])
        )
        poses = np.array([body.T_world_geometry for body in bodies], dtype=float)
        placed = cls(shapes, poses.reshape(-1, 4, 4))
        placed._made.update(enumerate(bodies))
        return placed

    def __len__(self) -> int:
        """K."""
        return len(self.shapes.names)

    @overload
    def __getitem__(self, index: int) -> CollisionBody: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[CollisionBody, ...]: ...
    def __getitem__(self, index: int | slice) -> CollisionBody | tuple[CollisionBody, ...]:
        """Return the body, which is the same object each time."""
        if isinstance(index, slice):
            return tuple([self[k] for k in range(*index.indices(len(self)))])
        k = range(len(self.shapes.names))[index]
        body = self._made.get(k)
        if body is None:
            body = unchecked(  # its pose is read-only already: no copy
                CollisionBody,
                name=self.shapes.names[k],
                geometry=self.shapes.geometries[k],
                T_world_geometry=self.poses[k],
            )
            self._made[k] = body
        return body


PARALLEL_ANGLE = 5e-3
"""Faces and edges tilted by less than this angle (rad) against the contact plane lie in it."""

_COS_PARALLEL = math.cos(PARALLEL_ANGLE)
_COPLANAR = 1e-3  # rad: triangles of one face, up to the noise of a mesh file
_FEW_FACES = 24  # trying them all costs nothing and does not depend on the nearest point
_ON_FACE = 1e-9  # m
_NEAR_FACE = 1e-3  # a face within 1 mm of the nearest point may be the touching one


@dataclass(frozen=True, eq=False)
class Polytope:
    """A bounded polytope with interior points.

    Attributes:
        vertices: (V, 3) corner points.
        face_normals: (F, 3) outward unit normals.
        face_offsets: (F,) distances of the faces from the origin, m.
        faces: (F, 3 or 4) vertices of each face; a flat face may come in several triangles.
        edges: Per vertex, the neighbours along true edges as (index, length of the edge).
        center: (3,) centre of a sphere around the set, and of the box around it along its axes.
        radius: Radius of that sphere, m.
        half_extents: (3,) half the edge lengths of that box, m.
    """

    vertices: FloatArray
    face_normals: FloatArray
    face_offsets: FloatArray
    faces: NDArray[np.int64]
    edges: tuple[tuple[tuple[int, float], ...], ...]
    center: FloatArray
    radius: float
    half_extents: FloatArray

    @cached_property
    def constant_normals(self) -> FloatArray | None:
        """All face normals (F, 3) if they are few; None if those near a point must be picked."""
        return self.face_normals if len(self.face_normals) <= _FEW_FACES else None

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
        """Outward normals (K, 3) of the faces within a millimetre of a point (3,); of few, all."""
        if self.constant_normals is not None:
            return self.constant_normals
        return self.face_normals[self.face_offsets - self.face_normals @ point <= _NEAR_FACE]

    def faces_at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outward normals (K, 3) of the faces and a point's (3,) heights (K,) over them, m."""
        return self.face_normals, self.face_normals @ point - self.face_offsets

    def heights_from(self, points: FloatArray, direction: FloatArray) -> FloatArray:
        """Return how far (K,) the surface is from points (K, 3) along a unit direction (3,), m.

        Negative where a point is beyond it. Past a border the surface goes on: where a face lies
        farthest along the direction, those tilted by more than 60 degrees against it do not count;
        where an edge or a corner does, the line along that is the least height.
        """
        leanings = self.face_normals @ direction
        on_face = bool((leanings > _COS_PARALLEL).any())
        ahead = leanings > (0.5 if on_face else 0.0)
        normals = self.face_normals[ahead]
        away = ((self.face_offsets[ahead] - points @ normals.T) / leanings[ahead]).min(axis=1)
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
    radius = float(np.linalg.norm(half))
    return Cuboid(signs * half, normals, offsets, faces, edges, np.zeros(3), radius, half)


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
        tuple((j, float(np.linalg.norm(vertices[i] - vertices[j]))) for j in sorted(near))
        for i, near in enumerate(neighbours)
    )
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    center, half = 0.5 * (low + high), 0.5 * (high - low)
    radius = float(np.max(np.linalg.norm(vertices - center, axis=1)))
    offsets = -hull.equations[:, 3]
    return Polytope(vertices, normals, offsets, triangles, edges, center, radius, half)
