"""Shapes of objects and supports, and their coal geometries. Lengths in metres, axes as in URDF."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, cast

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.bounds import LARGEST_LENGTH, SMALLEST_LENGTH
from graspless_pin.errors import ArgumentError, MeshError
from graspless_pin.findings import Finding, FindingCode, heard, tell
from graspless_pin.geometry.bodies.decomposition import (
    DEFAULT_CONCAVITY,
    DEFAULT_TIME_LIMIT,
    Cut,
    convex_pieces,
)
from graspless_pin.geometry.bodies.meshes import file_state, hull_points, scaled_mesh

_RANGE = f"from {SMALLEST_LENGTH:g} to {LARGEST_LENGTH:g} m"
_THINNEST = 1e-6
"""Thickness of a hull over its width; coal crashes from about 1e-7 on."""


@dataclass(frozen=True)
class Box:
    """A box about its frame's origin.

    Attributes:
        size: Full edge lengths along x, y, z, m.

    Examples:
        >>> from graspless_pin.geometry import Box
        >>> Box((0.06, 0.04, 0.02))  # m
        Box(size=(0.06, 0.04, 0.02))
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
    """A sphere about its frame's origin. See the example of `Box`.

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
    """A cylinder along z, centred at its frame's origin. See the example of `Box`.

    Attributes:
        radius: m.
        length: Full height, m.
    """


@dataclass(frozen=True)
class Capsule(_Axial):
    """A cylinder along z with half spheres at both ends, centred at its frame's origin.

    See the example of `Box`.

    Attributes:
        radius: m.
        length: Height of the cylinder without its ends, m.
    """


@dataclass(frozen=True)
class Cone(_Axial):
    """A cone with its tip at z = +length/2 and its base at z = -length/2.

    See the example of `Box`.

    Attributes:
        radius: Radius of the base, m.
        length: Full height, m.
    """


@dataclass(frozen=True)
class HalfSpace:
    """Everything at z <= 0 of its frame; the outward normal is +z. See the example of `Box`."""


@dataclass(frozen=True)
class MeshShape:
    """A mesh file, in the file's own coordinates, made convex in one of two ways.

    See the example of `Box`.

    Attributes:
        path: STL, OBJ, DAE, GLB, glTF, PLY or OFF file. A DAE is in the unit that it states, and
            the axis that it says is up becomes z.
        scale: Metres per unit of the file, or of what a DAE states; one number, or three along x,
            y, z.
        convex: ``hull`` fills all hollows; ``decompose`` cuts the mesh into convex pieces, which
            keeps them (see `decomposition`).
        concavity: For ``decompose``: deepest hollow that is filled all the same, as a share of half
            the largest extent, 0.01 to 1.
        decompose_time_limit: Seconds that the cut may take, at most 1e6.
        max_pieces: Most convex pieces; None: as many as the concavity takes.
    """

    path: Path
    scale: float | tuple[float, float, float] = 1.0
    convex: Literal["hull", "decompose"] = "hull"
    concavity: float = DEFAULT_CONCAVITY
    decompose_time_limit: float = DEFAULT_TIME_LIMIT
    max_pieces: int | None = None

    def __post_init__(self) -> None:
        """Check the numbers; the file is read when its geometry is asked for.

        Raises:
            ArgumentError: The scale is not one or three positive numbers, or the choice of convex
                parts is unknown or out of range.
        """
        object.__setattr__(self, "path", Path(self.path))
        if np.ndim(self.scale) == 0:
            _check_positive("scale", cast("float", self.scale))
        else:
            object.__setattr__(self, "scale", _lengths("scale", self.scale))
        if self.convex not in ("hull", "decompose"):
            raise ArgumentError("convex", f"needs 'hull' or 'decompose', got {self.convex!r}")
        self.cut()

    def cut(self) -> Cut:
        """Return how the mesh is cut into convex pieces, if it is."""
        return Cut(self.concavity, self.decompose_time_limit, self.max_pieces)


Shape = Box | Sphere | Cylinder | Capsule | Cone | HalfSpace | MeshShape


def coal_geometry(shape: Shape) -> Any:
    """Make the coal geometry of a shape that is one convex piece; of a mesh, of its convex hull.

    Raises:
        MeshError: The mesh file is missing, unreadable or encloses no volume.

    Warns:
        GrasplessPinWarning: The mesh is larger than 5 m or smaller than 1 mm.
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
            return convex_geometry(
                hull_points(shape.path, shape.scale), f"mesh file '{shape.path}'"
            )


def coal_geometries(shape: Shape) -> tuple[Any, ...]:
    """Make the coal geometries of all convex pieces of a shape.

    A shape is one piece unless it is a mesh that is to be decomposed.

    Raises:
        MeshError: The mesh file is missing, unreadable or encloses no volume.

    Warns:
        GrasplessPinWarning: The mesh is larger than 5 m or smaller than 1 mm, or one that is cut is
            not watertight, or its pieces cannot be kept on disk.
    """
    if not isinstance(shape, MeshShape) or shape.convex == "hull":
        return (coal_geometry(shape),)
    with heard() as said:
        hull_points(shape.path, shape.scale)
    tell(*(one for one in said if one.code is not FindingCode.SIMPLIFIED_HULL))  # pieces stand here
    pieces, found = _decomposed(shape, file_state(shape.path))
    tell(*found)
    return pieces


def shape_of(geometry: Any) -> Shape | NDArray[np.float64]:
    """Return the shape of a coal geometry; of a convex hull, its corners (V, 3).

    Raises:
        ArgumentError: It is neither a bounded primitive nor a convex hull.
    """
    match geometry:
        case coal.Box():
            x, y, z = (2.0 * np.array(geometry.halfSide)).tolist()
            return Box((x, y, z))
        case coal.Sphere():
            return Sphere(geometry.radius)
        case coal.Capsule():
            return Capsule(geometry.radius, 2.0 * geometry.halfLength)
        case coal.Cylinder():
            return Cylinder(geometry.radius, 2.0 * geometry.halfLength)
        case coal.Cone():
            return Cone(geometry.radius, 2.0 * geometry.halfLength)
        case coal.ConvexBase():
            return np.array(geometry.points())
    raise ArgumentError(
        "geometry", f"needs a bounded primitive or a convex hull, got {type(geometry).__name__}"
    )


@lru_cache(maxsize=32)
def _decomposed(
    shape: MeshShape, _state: tuple[str, int, int]
) -> tuple[tuple[Any, ...], tuple[Finding, ...]]:
    """Cut a mesh; the same geometries and findings again for an object that was only moved."""
    mesh = scaled_mesh(shape.path, shape.scale)
    label = f"mesh file '{shape.path}'"
    with heard() as found:
        pieces = convex_pieces(mesh, label, shape.cut())
    return tuple(convex_geometry(piece, label) for piece in pieces), tuple(found)


def convex_geometry(points: NDArray[np.float64], label: str = "the mesh") -> Any:
    """Make the coal geometry of the convex hull of points that are not all in one plane.

    Args:
        points: (V, 3), m.
        label: What messages call them.

    Raises:
        MeshError: coal cannot use their hull, or would crash over it since it is next to flat.
    """
    _check_thickness(points, label)
    corners: Any = coal.StdVec_Vec3s()
    for point in points:
        corners.append(point)
    error: Exception | None = None
    # A flat face of hundreds of corners is one fan of triangles with "Qt", of which coal refuses
    # the hub; joggling ("QJ") splits the face otherwise and leaves the corners where they are.
    for option in ("Qt", "QJ"):
        try:
            return coal.Convex.convexHull(corners, True, option)  # noqa: FBT003 - keep triangles
        except (RuntimeError, ValueError) as failure:
            error = failure
    raise MeshError(f"{label} has no usable convex hull; simplify it ({error})") from error


def _check_thickness(points: NDArray[np.float64], label: str) -> None:
    """Refuse what is so thin that coal ends the process over it.

    Raises:
        MeshError: If it is.
    """
    centered = points - points.mean(axis=0)
    across = np.linalg.svd(centered, full_matrices=False)[2]
    size = float(np.ptp(centered, axis=0).max())
    thickness = float(np.ptp(centered @ across[-1]))
    if thickness < _THINNEST * size:
        raise MeshError(
            f"{label} is next to flat: {thickness:.3g} m thick and {size:.3g} m wide; give it a "
            f"thickness of at least {_THINNEST:g} of its width"
        )


def _check_positive(name: str, value: float) -> None:
    if not isinstance(value, (int, float, np.floating)) or isinstance(value, bool):
        raise ArgumentError(name, f"needs a positive number, got {value!r}")
    if not SMALLEST_LENGTH <= value <= LARGEST_LENGTH:
        raise ArgumentError(name, f"needs a positive number {_RANGE}, got {value!r}")


def _lengths(name: str, values: ArrayLike) -> tuple[float, float, float]:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ArgumentError(name, f"needs three positive numbers, got {values!r}") from error
    if (
        array.shape != (3,)
        or not (array >= SMALLEST_LENGTH).all()
        or not (array <= LARGEST_LENGTH).all()
    ):
        raise ArgumentError(name, f"needs three positive numbers {_RANGE}, got {array.tolist()}")
    x, y, z = array.tolist()
    return x, y, z
