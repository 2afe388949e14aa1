"""The collision shapes of a model's links: primitives stay, a mesh becomes convex."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from graspless_pin.errors import MeshError
from graspless_pin.findings import emit
from graspless_pin.geometry.bodies.decomposition import (
    Cut,
    convex_pieces,
)
from graspless_pin.geometry.bodies.meshes import (
    DENSE_MESH,
    hull_corners,
    scaled_mesh,
    warn_of_scale,
)
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.hand.robot_model import LinkMesh, RobotModel
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Record

if TYPE_CHECKING:
    import trimesh

_MOST_PLACES = 3
"""That a message names, of those where a mesh was looked for."""
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
    T_joint_geometry: FloatArray


def link_geometries(
    model: Any,
    robot: RobotModel,
    link_frames: Mapping[str, int],
    cuts: Mapping[str, Cut] = MappingProxyType({}),
) -> tuple[LinkGeometry, ...]:
    """Return the collision shapes of a robot's links, in the order of their frames.

    Args:
        model: ``pinocchio.Model``.
        robot: The robot.
        link_frames: Index of the model's frames by link.
        cuts: How the meshes of some links are cut into convex pieces; others become hulls.

    Raises:
        MeshError: If a mesh is missing, cannot be read, has no volume or cannot be cut.

    Warns:
        GrasplessPinWarning: A mesh is larger than 5 m or smaller than 1 mm.
            A mesh that is cut is not watertight, or its pieces cannot be kept.
    """
    found = []
    for link in sorted(robot.links, key=lambda one: link_frames[one.name]):
        frame = model.frames[link_frames[link.name]]
        for item in link.collisions:
            T = (frame.placement * pin.SE3(np.array(item.T_link_shape))).homogeneous
            pieces = (
                _mesh_pieces(robot.label, link.name, item.shape, cuts.get(link.name))
                if isinstance(item.shape, LinkMesh)
                else item.shape.pieces()
            )
            found += [
                LinkGeometry(link.name, int(frame.parentJoint), shape, np.array(T))
                for shape in pieces
            ]
    return tuple(found)


def _mesh_pieces(label: str, link: str, mesh: LinkMesh, cut: Cut | None) -> tuple[Any, ...]:
    """Return the hull of a mesh, or its pieces."""
    surface = load_link_mesh(label, link, mesh)
    what = f"the collision mesh {mesh.file} of link {link!r}"
    points = [np.array(surface.vertices, dtype=np.float64)]
    if is_flat(points[0]):
        raise MeshError(f"{what} has no volume; give it a thickness or use a box")
    warn_of_scale(what, points[0], 'needs scale="0.001 0.001 0.001" in the URDF')
    if cut is not None:
        points = convex_pieces(surface, what, cut)
    elif len(points[0]) > DENSE_MESH:
        points[0], found = hull_corners(points[0], what)
        emit(*found)
    return tuple(convex_geometry(corners, what) for corners in points)


def load_link_mesh(label: str, link: str, mesh: LinkMesh) -> trimesh.Trimesh:
    """Read a link's collision mesh in metres; do not change what is returned.

    Args:
        label: The robot's file, for the message.
        link: The link.
        mesh: The mesh.

    Raises:
        MeshError: If it is missing or cannot be read.
    """
    if mesh.file is None:
        package = mesh.written.startswith("package://")
        hint = "; give package_dirs, the folder that holds the package" if package else ""
        raise MeshError(
            f"{label}: link {link!r} needs the collision mesh {mesh.written!r}, which is missing "
            f"(looked for {looked_for(mesh.looked)}){hint}"
        )
    try:
        return scaled_mesh(mesh.file, mesh.scale, upright=False)
    except MeshError as error:
        raise MeshError(
            f"{label}: the collision mesh {mesh.file} of link {link!r}: {error}"
        ) from error


def looked_for(places: Sequence[Path]) -> str:
    """Return where a mesh was looked for, in words: the likeliest places."""
    more = len(places) - _MOST_PLACES
    named = ", ".join(str(file) for file in places[:_MOST_PLACES]) or "nowhere"
    return named if more <= 0 else f"{named} and {more} more places"


def is_flat(vertices: FloatArray) -> bool:
    """Return whether (V, 3) vertices lie in one plane; coal would crash on their hull."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return len(extents) < 3 or bool(extents[2] <= FLATNESS * extents[0])
