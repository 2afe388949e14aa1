"""The manipulated object and what supports it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.collision import CollisionBody
from graspless_pin.geometry.poses import as_pose
from graspless_pin.geometry.shapes import HalfSpace, Shape, coal_geometry


@dataclass(frozen=True, eq=False)
class ManipulatedObject:
    """A rigid object with its mass.

    Attributes:
        name: What messages and tables call it.
        shape: Bounded shape.
        mass: kg.
        center_of_mass: (3,) read-only, in the object's frame, m.
        T_world_object: (4, 4) read-only pose, m.
    """

    name: str
    shape: Shape
    mass: float
    center_of_mass: NDArray[np.float64]
    T_world_object: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check all fields and copy the arrays.

        Raises:
            ArgumentError: The name is empty, the shape is a half-space, the mass is not positive,
                the centre of mass is not three finite numbers, or the pose is not rigid.
        """
        _check_name(self.name)
        if isinstance(self.shape, HalfSpace):
            raise ArgumentError("shape", f"object '{self.name}' cannot be a half-space")
        if not (math.isfinite(self.mass) and self.mass > 0.0):
            raise ArgumentError(
                "mass", f"object '{self.name}' needs a positive mass in kg, got {self.mass!r}"
            )
        object.__setattr__(self, "center_of_mass", _vector("center_of_mass", self.center_of_mass))
        object.__setattr__(self, "T_world_object", as_pose("T_world_object", self.T_world_object))

    @property
    def center_of_mass_world(self) -> NDArray[np.float64]:
        """(3,) centre of mass in the world frame, m."""
        T = self.T_world_object
        return T[:3, :3] @ self.center_of_mass + T[:3, 3]

    @cached_property
    def geometry(self) -> Any:
        """The coal geometry of the shape, made at first use.

        Raises:
            MeshError: See `coal_geometry`.
        """
        return coal_geometry(self.shape)

    def collision_body(self) -> CollisionBody:
        """The object as contact detection takes it.

        Raises:
            MeshError: See `coal_geometry`.
        """
        return CollisionBody(self.name, self.geometry, self.T_world_object)


@dataclass(frozen=True, eq=False)
class Support:
    """Something fixed that the object may touch: a table, a slope, a wall.

    Attributes:
        name: What messages and tables call it.
        shape: Any shape; for a table or a slope a half-space is exact and fastest.
        T_world_support: (4, 4) read-only pose, m.
        friction: Coefficient of friction against the object; None for the scene's.
    """

    name: str
    shape: Shape
    T_world_support: NDArray[np.float64]
    friction: float | None = None

    def __post_init__(self) -> None:
        """Check all fields and copy the pose.

        Raises:
            ArgumentError: The name is empty, the pose is not rigid, or the friction is negative.
        """
        _check_name(self.name)
        object.__setattr__(
            self, "T_world_support", as_pose("T_world_support", self.T_world_support)
        )
        if self.friction is not None and not (math.isfinite(self.friction) and self.friction >= 0):
            raise ArgumentError(
                "friction",
                f"support '{self.name}' needs a coefficient of zero or more, got {self.friction!r}",
            )

    @cached_property
    def geometry(self) -> Any:
        """The coal geometry of the shape, made at first use.

        Raises:
            MeshError: See `coal_geometry`.
        """
        return coal_geometry(self.shape)

    def collision_body(self) -> CollisionBody:
        """The support as contact detection takes it.

        Raises:
            MeshError: See `coal_geometry`.
        """
        return CollisionBody(self.name, self.geometry, self.T_world_support)


def _check_name(name: str) -> None:
    if not isinstance(name, str) or not name.strip():
        raise ArgumentError("name", f"needs a name that messages can use, got {name!r}")


def _vector(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ArgumentError(name, f"needs three numbers, got {values!r}") from error
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ArgumentError(name, f"needs three finite numbers, got {vector.tolist()}")
    vector.setflags(write=False)
    return vector
