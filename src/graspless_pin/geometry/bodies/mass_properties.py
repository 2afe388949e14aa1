"""Volume, mass and centre of mass of shapes that are filled evenly."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
import trimesh

from graspless_pin.errors import ArgumentError, GrasplessPinWarning
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
from graspless_pin.problem.checks import FloatArray


@dataclass(frozen=True, eq=False)
class MassProperties:
    """What statics needs to know of a rigid body.

    Attributes:
        mass: kg.
        center_of_mass: (3,) read-only, in the shape's frame, m.
    """

    mass: float
    center_of_mass: FloatArray


def mass_properties(
    shape: Shape, *, mass: float | None = None, density: float | None = None
) -> MassProperties:
    """Mass and centre of mass of a shape that is filled evenly.

    Args:
        shape: Bounded shape.
        mass: kg; or
        density: kg/m^3.

    Returns:
        The given mass, or density times volume, about the centroid of the volume.

    Raises:
        ArgumentError: Not exactly one of mass and density is given, it is not positive, or the
            shape is a half-space.
        MeshError: The mesh file is missing, unreadable or encloses no volume.

    Warns:
        GrasplessPinWarning: See `volume_and_centroid`.
    """
    if (mass is None) == (density is None):
        found = "neither" if mass is None else "both"
        raise ArgumentError("mass", f"needs either a mass in kg or a density, found {found}")
    name, value, unit = ("mass", mass, "kg") if density is None else ("density", density, "kg/m^3")
    if value is None or not (math.isfinite(value) and value > 0.0):
        raise ArgumentError(name, f"needs a positive number of {unit}, got {value!r}")
    volume, centroid = volume_and_centroid(shape)
    return MassProperties(value if density is None else density * volume, centroid)


def volume_and_centroid(shape: Shape) -> tuple[float, FloatArray]:
    """Volume (m^3) and centroid (3,) (m, in the shape's frame, read-only) of a shape.

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
        case Sphere(radius):
            volume = 4.0 / 3.0 * math.pi * radius**3
        case Cylinder(radius, length):
            volume = math.pi * radius**2 * length
        case Capsule(radius, length):
            volume = math.pi * radius**2 * (length + 4.0 / 3.0 * radius)
        case Cone(radius, length):
            volume = math.pi * radius**2 * length / 3.0
            centroid[2] = -0.25 * length
        case HalfSpace():
            raise ArgumentError("shape", "a half-space has no mass; use a bounded shape")
        case MeshShape():
            volume, centroid = _of_mesh(shape)
    centroid.setflags(write=False)
    return volume, centroid


def _of_mesh(shape: MeshShape) -> tuple[float, FloatArray]:
    hull = trimesh.convex.convex_hull(hull_points(shape.path, shape.scale))
    mesh = scaled_mesh(shape.path, shape.scale)
    if mesh.is_watertight and mesh.is_winding_consistent and mesh.volume != 0.0:
        # Turned inside out, a mesh has a negative volume but the same centroid.
        volume, centroid = abs(float(mesh.volume)), np.array(mesh.center_mass, dtype=float)
        if volume <= float(hull.volume) * (1.0 + 1e-9):
            return volume, centroid
        problem = "has parts that lie in each other"
    else:
        problem = "is not watertight"
    warnings.warn(
        f"mesh '{shape.path}' {problem}: volume and centre of mass are those of its convex hull; "
        "repair the mesh, or give mass and centre of mass",
        GrasplessPinWarning,
        stacklevel=4,
    )
    return float(hull.volume), np.array(hull.center_mass, dtype=float)
