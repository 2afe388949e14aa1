"""Geoms of an MJCF as shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.findings import emit
from graspless_pin.geometry.bodies.dense_hulls import hull_corners
from graspless_pin.geometry.bodies.shape import Hull
from graspless_pin.geometry.bodies.shapes import Box, Capsule, Cylinder, MeshShape, Shape, Sphere
from graspless_pin.geometry.hand.link_shapes import is_flat
from graspless_pin.geometry.hand.mjcf_source import MjcfSource, pose
from graspless_pin.geometry.hand.robot_model import LinkMesh, LinkShape
from graspless_pin.geometry.poses import invert
from graspless_pin.intake.files import is_file
from graspless_pin.problem.checks import FloatArray

_MESHES = (".stl", ".obj")
"""Files of meshes that MuJoCo has read and an object or support may name."""


def is_known(source: MjcfSource, geom: int) -> bool:
    """Return whether a bounded body can have the shape of a geom."""
    kinds = source.mujoco.mjtGeom
    return kinds(int(source.model.geom_type[geom])) in (
        kinds.mjGEOM_MESH, kinds.mjGEOM_BOX, kinds.mjGEOM_SPHERE, kinds.mjGEOM_CYLINDER,
        kinds.mjGEOM_CAPSULE,
    )  # fmt: skip


def geom_shape(source: MjcfSource, geom: int) -> LinkShape:
    """Return a geom in the frame of its body.

    A mesh that the file holds itself is the hull of its vertices.

    Raises:
        RobotError: If it is no shape that a bounded body can have.
    """
    model, kinds = source.model, source.mujoco.mjtGeom
    T = pose(model.geom_quat[geom], model.geom_pos[geom])
    kind, size = kinds(int(model.geom_type[geom])), model.geom_size[geom].tolist()
    body = source.body(int(model.geom_bodyid[geom]))
    if kind == kinds.mjGEOM_MESH:
        shape, T_geom_file = _mesh(source, int(model.geom_dataid[geom]))
        return LinkShape(shape, T @ T_geom_file)
    if not is_known(source, geom):
        word = kind.name.removeprefix("mjGEOM_").lower()
        raise RobotError(
            f"{source.path}: body {body!r} has the collision shape {word!r}; use boxes, spheres, "
            "cylinders, capsules or meshes"
        )
    try:
        return LinkShape(_primitive(source, kind, *size), T)
    except ArgumentError as error:
        raise RobotError(
            f"{source.path}: body {body!r} has a shape that cannot be: {error}"
        ) from error


def body_shape(source: MjcfSource, geom: int) -> tuple[Shape, FloatArray]:
    """Return a geom as an object or support has it, and its (4, 4) pose in its body's frame.

    Raises:
        RobotError: As of `geom_shape`.
    """
    found = geom_shape(source, geom)
    mesh = found.shape
    if not isinstance(mesh, LinkMesh):
        return mesh, found.T_link_shape
    if mesh.file is not None and mesh.file.suffix.lower() in _MESHES and min(mesh.scale) > 0.0:
        return MeshShape(mesh.file, mesh.scale), found.T_link_shape
    T = pose(source.model.geom_quat[geom], source.model.geom_pos[geom])
    return _mesh_hull(source, int(source.model.geom_dataid[geom])), T


def _mesh_hull(source: MjcfSource, mesh: int) -> Hull:
    """Return the convex hull of a mesh's vertices, in MuJoCo's own frame of it.

    Raises:
        RobotError: If it is flat.
    """
    model = source.model
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
    what = f"{source.path}: the mesh {model.mesh(mesh).name!r}"
    if is_flat(vertices):
        raise RobotError(f"{what} has no volume; give it a thickness or use a box")
    corners, found = hull_corners(vertices, what)
    emit(*found)
    return Hull(corners)


def _primitive(source: MjcfSource, kind: Any, x: float, y: float, z: float) -> Shape:
    """Return a primitive of MuJoCo's half lengths."""
    kinds = source.mujoco.mjtGeom
    if kind == kinds.mjGEOM_BOX:
        return Box((2.0 * x, 2.0 * y, 2.0 * z))
    if kind == kinds.mjGEOM_SPHERE:
        return Sphere(x)
    return (Cylinder if kind == kinds.mjGEOM_CYLINDER else Capsule)(x, 2.0 * y)


def _mesh(source: MjcfSource, mesh: int) -> tuple[LinkMesh | Hull, FloatArray]:
    """Return a mesh, and the pose of its file's frame in MuJoCo's own for it."""
    model = source.model
    name = model.mesh(mesh).name
    if source.spec is None or not source.spec.mesh(name).file:
        return _mesh_hull(source, mesh), np.eye(4)
    spec, asset = source.spec, source.spec.mesh(name)
    scale, T_ref = np.array(asset.scale), pose(asset.refquat, asset.refpos)
    if np.ptp(scale) > 0.0 and not np.allclose(T_ref[:3, :3], np.eye(3)):
        raise RobotError(
            f"{source.path}: the mesh {name!r} is turned and then scaled by {asset.scale}, "
            "different along its axes; turn its file instead"
        )
    # MuJoCo's vertex is R_m^T (S R_ref^T (v - p_ref) - p_m) of the file's v.
    T_file = invert(T_ref)
    T_file[:3, 3] *= scale
    folder = Path(spec.modelfiledir or source.path.parent)
    file = (folder / spec.compiler.meshdir / asset.file).resolve()
    x, y, z = scale.tolist()
    own = pose(model.mesh_quat[mesh], model.mesh_pos[mesh])
    found = file if is_file(file) else None
    return LinkMesh(str(file), found, (file,), (x, y, z)), invert(own) @ T_file
