"""Triangles of shapes and collision geometries, for drawing them; metres, outward faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.geometry.bodies.dense_hulls import with_fewer_triangles
from graspless_pin.geometry.bodies.meshes import MeshScale, file_state, scaled_mesh

_REMEMBERED = 256

MOST_FACES = 4000
"""Of a surface that is drawn, if nothing else is said."""


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


def slab_triangles(center: ArrayLike, half_width: float, thickness: float) -> Triangles:
    """Return a square slab whose top is the plane of a half-space, in the half-space's frame.

    Args:
        center: (2,) middle of the top, m.
        half_width: Half the edge of the square, m.
        thickness: How far the slab goes down, m.
    """
    x, y = np.asarray(center, dtype=float).tolist()
    slab = unit_surface("box", (2.0 * half_width, 2.0 * half_width, thickness))
    return Triangles(slab.vertices + np.array([x, y, -0.5 * thickness]), slab.faces)


def simplified(triangles: Triangles, max_faces: int) -> Triangles:
    """Return a surface of about so many triangles, or the same if it has no more.

    Good for looking at, not for computing with.
    """
    if len(triangles.faces) <= max_faces:
        return triangles
    return Triangles(*with_fewer_triangles(triangles.vertices, triangles.faces, max_faces))


@lru_cache(maxsize=_REMEMBERED)
def unit_surface(
    name: str,
    factors: float | tuple[float, ...],
    *sizes: float,
    lowered: float = 0.0,
    **options: Any,
) -> Triangles:
    """Make a primitive at unit size first: trimesh drops triangles that it finds too small.

    Args:
        name: Of a function of `trimesh.creation`.
        factors: What its vertices are scaled by, one number or three along x, y, z, m.
        sizes: What the function takes.
        lowered: How far the vertices are moved down before they are scaled.
        options: What else the function takes.
    """
    import trimesh

    unit = getattr(trimesh.creation, name)(*sizes, **options)
    unit.apply_translation((0.0, 0.0, -lowered))
    return Triangles(np.array(unit.vertices) * np.asarray(factors), unit.faces)


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
    mesh = scaled_mesh(path, scale, upright=upright)
    return simplified(Triangles(mesh.vertices, mesh.faces), max_faces)
