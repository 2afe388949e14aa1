"""The form in which hands, objects and supports hand their geometry to contact detection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError


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
    T_world_geometry: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Copy the pose.

        Raises:
            ArgumentError: The pose is not a (4, 4) array.
        """
        pose = np.array(self.T_world_geometry, dtype=float)
        if pose.shape != (4, 4):
            raise ArgumentError("T_world_geometry", f"needs shape (4, 4), got {pose.shape}")
        pose.setflags(write=False)
        object.__setattr__(self, "T_world_geometry", pose)
