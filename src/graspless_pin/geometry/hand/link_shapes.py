"""The collision shapes of a model's links: primitives stay, a mesh becomes convex."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import MeshError
from graspless_pin.findings import emit
from graspless_pin.geometry.bodies.decomposition import (
    Cut,
    convex_pieces,
)
from graspless_pin.geometry.bodies.dense_hulls import DENSE_MESH, hull_corners
from graspless_pin.geometry.bodies.meshes import scaled_mesh, warn_of_scale
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.hand.urdf_links import LinkMesh
from graspless_pin.geometry.pickling import Record

if TYPE_CHECKING:
    import trimesh

FLATNESS = 1e-7
"""Thickness over length below which a mesh (single-precision vertices) has no volume."""


@dataclass(frozen=True, eq=False)
class LinkGeometry(Record):
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


def link_geometries(
    model: Any,
    item: Any,
    cuts: Mapping[str, Cut] = MappingProxyType({}),
    mesh: tuple[LinkMesh, str] | None = None,
    *,
    is_capsule: bool = False,
) -> tuple[LinkGeometry, ...]:
    """Take one of Pinocchio's geometry objects over.

    Args:
        model: ``pinocchio.Model``.
        item: ``pinocchio.GeometryObject``.
        cuts: How the meshes of some links are cut into convex pieces; others become hulls.
        mesh: The mesh that the object stands for, and the URDF's name for messages; None: it is
            a primitive.
        is_capsule: Whether the object, a cylinder, stands for a capsule.

    Returns:
        A primitive or a convex hull, or the pieces.

    Raises:
        MeshError: If a mesh cannot be read, has no volume or cannot be cut.

    Warns:
        GrasplessPinWarning: A mesh is larger than 5 m or smaller than 1 mm.
            A mesh that is cut is not watertight, or its pieces cannot be kept.
    """
    link = model.frames[item.parentFrame].name
    shapes = [item.geometry]
    if is_capsule:
        shapes = [coal.Capsule(item.geometry.radius, 2.0 * item.geometry.halfLength)]
    if mesh is not None:
        what = f"the collision mesh {mesh[0].file} of link {link!r}"
        cut = cuts.get(link)
        surface = load_link_mesh(mesh[0], mesh[1])
        points = [np.array(surface.vertices, dtype=np.float64)]
        if is_flat(points[0]):
            raise MeshError(f"{what} has no volume; give it a thickness or use a box")
        warn_of_scale(what, points[0], 'needs scale="0.001 0.001 0.001" in the URDF')
        if cut is not None:
            points = convex_pieces(surface, what, cut)
        elif len(points[0]) > DENSE_MESH:
            points[0], found = hull_corners(points[0], what)
            emit(*found)
        shapes = [convex_geometry(corners, what) for corners in points]
    joint, T = int(item.parentJoint), np.array(item.placement.homogeneous)
    return tuple(LinkGeometry(link, joint, shape, T) for shape in shapes)


def load_link_mesh(mesh: LinkMesh, label: str) -> trimesh.Trimesh:
    """Read a link's collision mesh in metres; do not change what is returned.

    Args:
        mesh: The mesh.
        label: The URDF, for the message.

    Raises:
        MeshError: If it cannot be read.
    """
    try:
        return scaled_mesh(mesh.file, mesh.scale, upright=False)
    except MeshError as error:
        raise MeshError(
            f"{label}: the collision mesh {mesh.file} of link {mesh.link!r}: {error}"
        ) from error


def is_flat(vertices: NDArray[np.float64]) -> bool:
    """Return whether (V, 3) vertices lie in one plane; coal would crash on their hull."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return len(extents) < 3 or bool(extents[2] <= FLATNESS * extents[0])
