"""Shapes of objects and supports, and their coal geometries. Lengths in metres, axes as in URDF."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import QhullError

from graspless_pin.errors import ArgumentError, MeshError, MeshScaleWarning
from graspless_pin.geometry.convex_sets import hull_of

LARGEST_MESH = 5.0
SMALLEST_MESH = 1e-3
MESH_FORMATS = (".stl", ".obj", ".dae", ".glb", ".gltf", ".ply", ".off")


@dataclass(frozen=True)
class Box:
    """A box about its frame's origin.

    Attributes:
        size: Full edge lengths along x, y, z, m.
    """

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        """Check the size.

        Raises:
            ArgumentError: It is not three positive numbers.
        """
        object.__setattr__(self, "size", _lengths("size", self.size))


@dataclass(frozen=True)
class Sphere:
    """A sphere about its frame's origin.

    Attributes:
        radius: m.
    """

    radius: float

    def __post_init__(self) -> None:
        """Check the radius.

        Raises:
            ArgumentError: It is not a positive number.
        """
        _check_positive("radius", self.radius)


@dataclass(frozen=True)
class _Axial:
    radius: float
    length: float

    def __post_init__(self) -> None:
        """Check the lengths.

        Raises:
            ArgumentError: One is not a positive number.
        """
        _check_positive("radius", self.radius)
        _check_positive("length", self.length)


@dataclass(frozen=True)
class Cylinder(_Axial):
    """A cylinder along z, centred at its frame's origin.

    Attributes:
        radius: m.
        length: Full height, m.
    """


@dataclass(frozen=True)
class Capsule(_Axial):
    """A cylinder along z with half spheres at both ends, centred at its frame's origin.

    Attributes:
        radius: m.
        length: Height of the cylinder without its ends, m.
    """


@dataclass(frozen=True)
class Cone(_Axial):
    """A cone with its tip at z = +length/2 and its base at z = -length/2.

    Attributes:
        radius: Radius of the base, m.
        length: Full height, m.
    """


@dataclass(frozen=True)
class HalfSpace:
    """Everything at z <= 0 of its frame; the outward normal is +z."""


@dataclass(frozen=True)
class MeshShape:
    """The convex hull of a mesh file, in the file's own coordinates.

    Attributes:
        path: STL, OBJ, DAE, GLB, glTF, PLY or OFF file. A unit written in the file is not applied.
        scale: Metres per unit of the file; one number, or three along x, y, z.
    """

    path: Path
    scale: float | tuple[float, float, float] = 1.0

    def __post_init__(self) -> None:
        """Check the scale; the file is read when its geometry is asked for.

        Raises:
            ArgumentError: The scale is not one or three positive numbers.
        """
        object.__setattr__(self, "path", Path(self.path))
        if np.ndim(self.scale) == 0:
            _check_positive("scale", cast("float", self.scale))
        else:
            object.__setattr__(self, "scale", _lengths("scale", self.scale))


Shape = Box | Sphere | Cylinder | Capsule | Cone | HalfSpace | MeshShape


def coal_geometry(shape: Shape) -> Any:
    """Make the coal geometry of a shape; of a mesh, of its convex hull.

    Raises:
        MeshError: The mesh file is missing, unreadable or encloses no volume.

    Warns:
        MeshScaleWarning: The mesh is larger than 5 m or smaller than 1 mm.
    """
    match shape:
        case Box(size):
            return coal.Box(*size)
        case Sphere(radius):
            return coal.Sphere(radius)
        case Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case Capsule(radius, length):
            return coal.Capsule(radius, length)
        case Cone(radius, length):
            return coal.Cone(radius, length)
        case HalfSpace():
            return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        case MeshShape():
            points: Any = coal.StdVec_Vec3s()
            for point in _hull_points(shape):
                points.append(point)
            return coal.Convex.convexHull(points, True, "Qt")  # noqa: FBT003 - keep the triangles


def shape_extent(shape: Shape) -> NDArray[np.float64]:
    """Edge lengths (3,) of the box around a shape along its own axes, m; infinite for a half-space.

    Raises:
        MeshError: The mesh file is missing, unreadable or encloses no volume.
    """
    match shape:
        case Box(size):
            return np.array(size)
        case Sphere(radius):
            return np.full(3, 2.0 * radius)
        case Capsule(radius, length):
            return np.array([2.0 * radius, 2.0 * radius, length + 2.0 * radius])
        case Cylinder(radius, length) | Cone(radius, length):
            return np.array([2.0 * radius, 2.0 * radius, length])
        case HalfSpace():
            return np.full(3, np.inf)
        case MeshShape():
            return np.ptp(_hull_points(shape), axis=0)


def load_mesh(path: Path) -> trimesh.Trimesh:
    """Read all parts of a mesh file as one mesh, in the file's units.

    Raises:
        MeshError: The file is missing, of an unknown format, unreadable or without faces.
    """
    if not path.is_file():
        raise MeshError(
            f"mesh file '{path}' does not exist; check the path and what it is relative to"
        )
    if path.suffix.lower() not in MESH_FORMATS:
        raise MeshError(
            f"mesh file '{path}' has the unknown ending '{path.suffix}'; "
            f"use one of {', '.join(MESH_FORMATS)}"
        )
    if path.suffix.lower() == ".dae" and b"<!DOCTYPE" in path.read_bytes():
        raise MeshError(f"mesh file '{path}' declares XML entities; export it without a DOCTYPE")
    try:
        mesh = trimesh.load_mesh(str(path))
    except Exception as error:  # the readers behind trimesh raise whatever comes up
        raise MeshError(
            f"mesh file '{path}' cannot be read as {path.suffix[1:].upper()}: {error}"
        ) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise MeshError(f"mesh file '{path}' has no faces; export it as a triangle mesh")
    return mesh


def _hull_points(shape: MeshShape) -> NDArray[np.float64]:
    mesh = load_mesh(shape.path)
    points = np.asarray(mesh.vertices, dtype=float) * np.asarray(shape.scale)
    if not np.isfinite(points).all():
        raise MeshError(f"mesh file '{shape.path}' has vertices that are not finite numbers")
    try:
        points = hull_of(points).vertices
    except (QhullError, ValueError) as error:
        raise MeshError(
            f"mesh file '{shape.path}' encloses no volume: all of its vertices lie in one plane"
        ) from error
    extent = float(np.ptp(points, axis=0).max())
    if not SMALLEST_MESH <= extent <= LARGEST_MESH:
        warnings.warn(
            f"mesh '{shape.path}' with scale {shape.scale} is {extent:.3g} m large; "
            "lengths are metres: a file in millimetres needs scale 0.001",
            MeshScaleWarning,
            stacklevel=3,
        )
    return points


def _check_positive(name: str, value: float) -> None:
    if not isinstance(value, (int, float, np.floating)) or isinstance(value, bool):
        raise ArgumentError(name, f"needs a positive number, got {value!r}")
    if not (math.isfinite(value) and value > 0.0):
        raise ArgumentError(name, f"needs a positive number, got {value!r}")


def _lengths(name: str, values: ArrayLike) -> tuple[float, float, float]:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ArgumentError(name, f"needs three positive numbers, got {values!r}") from error
    if array.shape != (3,) or not np.isfinite(array).all() or not (array > 0.0).all():
        raise ArgumentError(name, f"needs three positive numbers, got {array.tolist()}")
    x, y, z = array.tolist()
    return x, y, z
