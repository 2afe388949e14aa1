"""The collision shapes of a model's links: primitives stay, a mesh becomes its convex hull."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import MeshError
from graspless_pin.geometry.hand.coupling import remake

FLATNESS = 1e-7
"""Thickness over length below which a mesh (single-precision vertices) has no volume."""


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """A collision shape that moves with a link.

    Attributes:
        link: Name of the link.
        joint: Pinocchio index of the joint that carries it, 0 for the base.
        shape: coal geometry, a primitive or a convex hull.
        T_joint_geometry: (4, 4) pose in the joint's frame.
    """

    link: str
    joint: int
    shape: Any
    T_joint_geometry: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Make the pose read-only."""
        self.T_joint_geometry.setflags(write=False)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Pickle by the fields."""
        return remake(self)


def link_geometry(model: Any, item: Any) -> LinkGeometry:
    """Take one of Pinocchio's geometry objects over, a mesh as its convex hull.

    Raises:
        MeshError: If the mesh has no volume.
    """
    link = model.frames[item.parentFrame].name
    shape = item.geometry
    if isinstance(shape, coal.BVHModelBase):
        shape = _convex_hull(shape, f"the collision mesh {item.meshPath} of link {link!r}")
    return LinkGeometry(link, int(item.parentJoint), shape, np.array(item.placement.homogeneous))


def load_link_mesh(file: Path, label: str, link: str) -> Any:
    """Read a link's collision mesh in the file's own units.

    Args:
        file: The mesh file.
        label: The URDF, for the message.
        link: The link, for the message.

    Raises:
        MeshError: If it cannot be read.
    """
    try:
        return coal.MeshLoader().load(str(file), np.ones(3))
    except Exception as error:  # coal raises its own C++ exceptions as plain ones
        raise MeshError(
            f"{label}: the collision mesh {file} of link {link!r} cannot be read; "
            "export it again as STL, OBJ or DAE"
        ) from error


def is_flat(vertices: NDArray[np.float64]) -> bool:
    """Return whether (V, 3) vertices lie in one plane; coal would crash on their hull."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return len(extents) < 3 or bool(extents[2] <= FLATNESS * extents[0])


def _convex_hull(mesh: Any, what: str) -> Any:
    """Return the convex hull of a mesh."""
    if is_flat(np.array(mesh.vertices())):
        raise MeshError(f"{what} has no volume; give it a thickness or use a box")
    error: Exception | None = None
    # A flat face of hundreds of corners is one fan of triangles with "Qt", of which coal refuses
    # the hub; joggling ("QJ") splits the face otherwise and leaves the corners where they are.
    for option in ("Qt", "QJ"):
        try:
            mesh.buildConvexHull(True, option)  # noqa: FBT003 - a C++ signature
        except (RuntimeError, ValueError) as failure:
            error = failure
        else:
            return mesh.convex
    raise MeshError(f"{what} has no usable convex hull; simplify it ({error})") from error
