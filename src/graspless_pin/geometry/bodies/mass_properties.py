"""Volume, mass, centre of mass and inertia of shapes that are filled evenly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding, FindingCode, tell
from graspless_pin.geometry.bodies.dense_hulls import DENSE_MESH, HULL_TOLERANCE
from graspless_pin.geometry.bodies.meshes import hull_points, scaled_mesh
from graspless_pin.geometry.bodies.shapes import (
    Box,
    Capsule,
    Cone,
    Cylinder,
    HalfSpace,
    MeshShape,
    Shape,
    Sphere,
)
from graspless_pin.problem.checks import FloatArray, checked_inertia, read_only

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass of a rigid body and how it is spread.

    Attributes:
        mass: kg.
        center_of_mass: (3,) read-only, in the shape's frame, m.
        inertia: (3, 3) read-only, about the centre of mass, the shape's axes, kg m^2.
    """

    mass: float
    center_of_mass: FloatArray
    inertia: FloatArray


class Filling(NamedTuple):
    """What a shape encloses.

    Attributes:
        volume: m^3.
        centroid: (3,) read-only, in the shape's frame, m.
        gyration: (3, 3) read-only inertia per mass about the centroid, the shape's axes, m^2.
    """

    volume: float
    centroid: FloatArray
    gyration: FloatArray


def mass_properties(
    shape: Shape, *, mass: float | None = None, density: float | None = None
) -> MassProperties:
    """Return mass, centre of mass and inertia of a shape that is filled evenly.

    Args:
        shape: Bounded shape.
        mass: kg; or
        density: kg/m^3.

    Returns:
        The given mass, or density times volume, and how it is spread about its centroid.

    Raises:
        ArgumentError: Not exactly one of mass and density is given, it is not positive, or the
            shape is a half-space.
        MeshError: The mesh file is missing, unreadable or encloses no volume.

    Warns:
        GrasplessPinWarning: See `filling`.
    """
    if (mass is None) == (density is None):
        found = "neither" if mass is None else "both"
        raise ArgumentError("mass", f"needs either a mass in kg or a density, found {found}")
    name, value, unit = ("mass", mass, "kg") if density is None else ("density", density, "kg/m^3")
    if value is None or not (math.isfinite(value) and value > 0.0):
        raise ArgumentError(name, f"needs a positive number of {unit}, got {value!r}")
    filled = filling(shape)
    total = value if density is None else density * filled.volume
    return MassProperties(total, filled.centroid, read_only(total * filled.gyration))


def filling(shape: Shape) -> Filling:
    """Return volume, centroid and inertia per mass of a shape.

    Raises:
        ArgumentError: The shape is a half-space.
        MeshError: The mesh file is missing, unreadable or encloses no volume.

    Warns:
        GrasplessPinWarning: A mesh is not watertight; its convex hull counts instead.
    """
    centroid = np.zeros(3)
    match shape:
        case Box(size):
            volume = math.prod(size)
            squares = np.square(size) / 12.0  # mean squares of x, y, z about the centroid
        case Sphere(radius):
            volume = 4.0 / 3.0 * math.pi * radius**3
            squares = np.full(3, radius**2 / 5.0)
        case Cylinder(radius, length):
            volume = math.pi * radius**2 * length
            squares = np.array([radius**2 / 4.0, radius**2 / 4.0, length**2 / 12.0])
        case Capsule(radius, length):
            volume = math.pi * radius**2 * (length + 4.0 / 3.0 * radius)
            ends = 4.0 * radius / (3.0 * length + 4.0 * radius)  # their share of the volume
            across = radius**2 * ((1.0 - ends) / 4.0 + ends / 5.0)
            beyond = length**2 / 4.0 + 3.0 / 8.0 * length * radius + radius**2 / 5.0
            along = (1.0 - ends) * length**2 / 12.0 + ends * beyond
            squares = np.array([across, across, along])
        case Cone(radius, length):
            volume = math.pi * radius**2 * length / 3.0
            centroid[2] = -0.25 * length
            squares = np.array([radius**2, radius**2, length**2 / 4.0]) * 3.0 / 20.0
        case HalfSpace():
            raise ArgumentError("shape", "a half-space has no mass; use a bounded shape")
        case MeshShape():
            return _of_mesh(shape)
    return Filling(volume, read_only(centroid), read_only(np.diag(squares.sum() - squares)))


def checked_body_inertia(inertia: ArrayLike) -> FloatArray:
    """Return the (3, 3) inertia of a rigid body about its centre of mass, kg m^2, read-only.

    Args:
        inertia: (3, 3), or (3,) its diagonal.

    Raises:
        ArgumentError: It is not symmetric and positive definite, or one principal moment exceeds
            the two others together.
    """
    given = np.asarray(inertia)
    matrix = checked_inertia(
        "inertia", np.diag(given) if given.shape == (3,) else given, 3, definite=True
    )
    low, middle, high = np.linalg.eigvalsh(matrix).tolist()
    if high > (low + middle) * (1.0 + 1e-9):
        raise ArgumentError(
            "inertia",
            f"has the principal moments {low:g}, {middle:g} and {high:g} kg m^2; none may "
            "be larger than the two others together",
        )
    return matrix


def _of_mesh(shape: MeshShape) -> Filling:
    import trimesh

    hull = trimesh.convex.convex_hull(hull_points(shape.path, shape.scale))
    mesh = scaled_mesh(shape.path, shape.scale)
    if mesh.is_watertight and mesh.is_winding_consistent and mesh.volume != 0.0:
        # Turned inside out, a mesh has a negative volume; centroid and gyration stay.
        left_out = (
            HULL_TOLERANCE * hull.scale * hull.area if len(mesh.vertices) > DENSE_MESH else 0.0
        )
        if abs(float(mesh.volume)) <= float(hull.volume) * (1.0 + 1e-9) + left_out:
            return _filled(mesh)
        problem = "has parts that lie in each other"
    else:
        problem = "is not watertight"
    tell(
        Finding(
            FindingCode.OPEN_MESH,
            str(shape.path),
            f"mesh '{shape.path}' {problem}: volume and centre of mass, and the inertia, are "
            "those of its convex hull",
            "repair the mesh, or give mass, centre of mass and inertia",
            ("object", "shape"),
        )
    )
    return _filled(hull)


def _filled(mesh: trimesh.Trimesh) -> Filling:
    volume, gyration = float(mesh.volume), np.array(mesh.moment_inertia, dtype=float)
    gyration = 0.5 * (gyration + gyration.T) / volume
    return Filling(abs(volume), read_only(np.array(mesh.center_mass)), read_only(gyration))
