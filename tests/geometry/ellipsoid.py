"""Ellipsoids, a kind of surface that the package does not have: one module, as CONTRIBUTING says.

Tests use it from here, and put it into a copy of the package.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from pydantic import Field

from graspless_pin.geometry.bodies.convex_sets import BoundedSet
from graspless_pin.geometry.bodies.meshes import MOST_FACES, Triangles, unit_surface
from graspless_pin.geometry.bodies.shape import Filling, Lengths, Shape


@dataclass(frozen=True)
class Ellipsoid(Shape):
    """An ellipsoid with its half axes along x, y, z.

    Attributes:
        radii: Half axes, m.
    """

    kind = "ellipsoid"
    rolls = True
    coal_type = coal.Ellipsoid
    radii: Annotated[Lengths, Field(description="[m] half axes along x, y, z")]

    @classmethod
    def set_of(cls, geometry: Any) -> BoundedSet:
        """Return the set for contacts."""
        return EllipsoidSet(np.array(geometry.radii))

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass."""
        return Filling.symmetric(
            4.0 / 3.0 * math.pi * math.prod(self.radii), np.square(self.radii) / 5.0
        )

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surface."""
        return unit_surface("icosphere", self.radii, 3)

    def mjcf_geom(self) -> dict[str, Any]:
        """Return the attributes of MJCF."""
        return {"type": "ellipsoid", "size": list(self.radii)}


@dataclass(frozen=True, eq=False)
class EllipsoidSet(BoundedSet):
    """The points with |x / radii| <= 1.

    Attributes:
        radii: (3,) half axes, m.
    """

    radii: np.ndarray

    def support_values(self, directions: np.ndarray) -> np.ndarray:
        """Return the largest d . x for each direction."""
        return np.linalg.norm(directions * self.radii, axis=1)

    def feature(self, direction: np.ndarray) -> np.ndarray:
        """Return the point that lies farthest."""
        scaled = self.radii * direction
        return (self.radii * scaled / np.linalg.norm(scaled))[None]

    def faces_at(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the tangent plane where the ray from the centre to a point leaves the set."""
        gradient = point / self.radii**2 if point.any() else np.array([1.0, 0.0, 0.0])
        normals = (gradient / np.linalg.norm(gradient))[None]
        return normals, normals @ point - self.support_values(normals)

    def radii_of_curvature(
        self, point: np.ndarray, outward: np.ndarray, tangents: np.ndarray
    ) -> np.ndarray:
        """Return the second derivatives of the support function."""
        scaled, height = self.radii * outward, np.linalg.norm(self.radii * outward)
        turned = (self.radii * scaled) @ tangents
        squares = tangents.T @ (self.radii[:, None] ** 2 * tangents)
        return squares / height - np.outer(turned, turned) / height**3
