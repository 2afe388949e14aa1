"""Triangles of shapes and collision geometries, for drawing them; metres, outward faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.dense_hulls import with_fewer_triangles
from graspless_pin.geometry.bodies.meshes import MeshScale, file_state, hull_points, scaled_mesh
from graspless_pin.geometry.bodies.shapes import (
    Box,
    Capsule,
    Cone,
    Cylinder,
    HalfSpace,
    MeshShape,
    Shape,
    Sphere,
    shape_of,
)

if TYPE_CHECKING:
    import trimesh

_SECTIONS = 32  # of a circle
_CAPSULE_SECTIONS = (16, 32)
_SPHERE_SUBDIVISIONS = 3  # 1280 triangles
_REMEMBERED = 256


@dataclass(frozen=True, eq=False)
class Triangles:
    """A surface of triangles, counterclockwise when seen from outside.

    Attributes:
        vertices: (V, 3) read-only, m.
        faces: (F, 3) read-only indices of vertices.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name, dtype in (("vertices", np.float64), ("faces", np.int64)):
            array = np.array(getattr(self, name), dtype=dtype).reshape(-1, 3)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def moved(self, T: ArrayLike) -> Triangles:
        """Return the surface at a (4, 4) pose."""
        pose = np.asarray(T, dtype=float)
        return Triangles(self.vertices @ pose[:3, :3].T + pose[:3, 3], self.faces)


def shape_triangles(shape: Shape, *, max_faces: int = 4000) -> Triangles:
    """Return the surface of a bounded shape, in its own frame.

    A mesh file is drawn as it is, whatever convex pieces stand for it in contact detection.

    Args:
        shape: Any shape but a half-space, see `slab_triangles`.
        max_faces: A mesh with more triangles is simplified, see `simplified`.

    Raises:
        ArgumentError: The shape is a half-space.
        MeshError: The mesh file is missing, unreadable or encloses no volume.

    Warns:
        MeshScaleWarning: The mesh is larger than 5 m or smaller than 1 mm.
    """
    if isinstance(shape, MeshShape):
        hull_points(shape.path, shape.scale)  # says what is wrong with the file
        return file_triangles(shape.path, shape.scale, max_faces)
    return _primitive_triangles(shape)


def geometry_triangles(geometry: Any) -> Triangles:
    """Return the surface of a coal geometry, in its own frame.

    Args:
        geometry: What collision bodies are made of: a primitive or a convex hull.

    Raises:
        ArgumentError: It is anything else.
    """
    shape = shape_of(geometry)
    if isinstance(shape, np.ndarray):
        import trimesh

        return _of(trimesh.convex.convex_hull(shape))
    return _primitive_triangles(shape)


def slab_triangles(center: ArrayLike, half_width: float, thickness: float) -> Triangles:
    """Return a square slab whose top is the plane of a half-space, in the half-space's frame.

    Args:
        center: (2,) middle of the top, m.
        half_width: Half the edge of the square, m.
        thickness: How far the slab goes down, m.
    """
    x, y = np.asarray(center, dtype=float).tolist()
    slab = _primitive_triangles(Box((2.0 * half_width, 2.0 * half_width, thickness)))
    return Triangles(slab.vertices + np.array([x, y, -0.5 * thickness]), slab.faces)


def simplified(triangles: Triangles, max_faces: int) -> Triangles:
    """Return a surface of about so many triangles, or the same if it has no more.

    Good for looking at, not for computing with.
    """
    if len(triangles.faces) <= max_faces:
        return triangles
    return Triangles(*with_fewer_triangles(triangles.vertices, triangles.faces, max_faces))


@lru_cache(maxsize=_REMEMBERED)
def _primitive_triangles(shape: Shape) -> Triangles:
    """Make a primitive at unit size first: trimesh drops triangles that it finds too small."""
    import trimesh

    match shape:
        case Box(size):
            return _scaled(trimesh.creation.box(), size)
        case Sphere(radius):
            return _scaled(trimesh.creation.icosphere(_SPHERE_SUBDIVISIONS), radius)
        case Cylinder(radius, length):
            unit = trimesh.creation.cylinder(1.0, 1.0, sections=_SECTIONS)
            return _scaled(unit, (radius, radius, length))
        case Capsule(radius, length):
            unit = trimesh.creation.capsule(length / radius, 1.0, count=_CAPSULE_SECTIONS)
            return _scaled(unit, radius)
        case Cone(radius, length):
            unit = trimesh.creation.cone(1.0, 1.0, sections=_SECTIONS)
            unit.apply_translation((0.0, 0.0, -0.5))
            return _scaled(unit, (radius, radius, length))
        case HalfSpace():
            raise ArgumentError("shape", "a half-space has no end; draw it with slab_triangles")
        case MeshShape():
            raise ArgumentError("shape", "a mesh is no primitive")


def file_triangles(
    path: Path, scale: MeshScale, max_faces: int, *, upright: bool = True
) -> Triangles:
    """Return the surface of a mesh file, the same as long as the file does not change.

    Args:
        path: See `scaled_mesh`.
        scale: See `scaled_mesh`; one that mirrors turns the triangles round.
        max_faces: A mesh with more triangles is simplified, see `simplified`.
        upright: See `load_mesh`.

    Raises:
        MeshError: The file is missing or unreadable.
    """
    return _file_triangles(path, scale, max_faces, upright, file_state(path))


@lru_cache(maxsize=_REMEMBERED)
def _file_triangles(
    path: Path, scale: MeshScale, max_faces: int, upright: bool, _state: tuple[str, int, int]
) -> Triangles:
    return simplified(_of(scaled_mesh(path, scale, upright=upright)), max_faces)


def _scaled(mesh: trimesh.Trimesh, factors: ArrayLike) -> Triangles:
    return Triangles(np.array(mesh.vertices) * np.asarray(factors), np.array(mesh.faces))


def _of(mesh: trimesh.Trimesh) -> Triangles:
    return Triangles(np.array(mesh.vertices), np.array(mesh.faces))
