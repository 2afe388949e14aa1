"""An MJCF compiled by MuJoCo, and its geoms as shapes."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, RobotError, optional_import
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.bodies.meshes import hull_corners
from graspless_pin.geometry.bodies.shape import Hull
from graspless_pin.geometry.bodies.shapes import Box, Capsule, Cylinder, MeshShape, Shape, Sphere
from graspless_pin.geometry.hand.robot_model import LinkMesh, LinkShape, is_flat
from graspless_pin.geometry.poses import invert, rigid
from graspless_pin.intake.files import FileKind, is_file, note_read, read_bytes
from graspless_pin.problem.checks import FloatArray


@dataclass(frozen=True, eq=False)
class MjcfSource:
    """A model that MuJoCo has read.

    Attributes:
        mujoco: The module.
        path: The file; for a model that is from no file, its name.
        spec: ``mujoco.MjSpec``, which has the files of meshes; None: there are none.
        model: ``mujoco.MjModel``, which has everything else.
    """

    mujoco: Any
    path: Path
    spec: Any
    model: Any

    def joint(self, index: int) -> str:
        """Return a joint's name."""
        return self.model.joint(index).name or f"joint_{index}"

    def body(self, index: int) -> str:
        """Return a body's name."""
        return self.model.body(index).name or f"body_{index}"


def read_mjcf(path: Path, *, keyframes: bool = False) -> MjcfSource:
    """Read an MJCF with MuJoCo.

    Args:
        path: The file.
        keyframes: Whether its keyframes are kept.

    Raises:
        RobotError: If MuJoCo is not installed or refuses the file.

    Warns:
        GrasplessPinWarning: MuJoCo's own warnings, or angles that look like radians.
    """
    mujoco = _load_mujoco(path)
    # By default MuJoCo writes warnings into a log file in the current folder.
    capture = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        with warnings.catch_warnings(record=True, action="always") as remarks:
            spec = mujoco.MjSpec.from_file(str(path))
            _strip_visuals(spec, keyframes=keyframes)
            model = spec.compile()
    except (ValueError, OSError) as error:
        message = " ".join(str(error).split())
        raise RobotError(f"{path}: MuJoCo cannot read this MJCF ({message})") from error
    finally:
        mujoco.set_mju_user_warning(capture)
    for text in dict.fromkeys(str(item.message) for item in remarks):
        emit(
            Finding(
                FindingCode.READER_REMARK,
                path.name,
                f"{path}: MuJoCo says: {text}",
                "check whether this affects kinematics, shapes or limits",
            )
        )
    _note_included(path)
    meshes = [_mesh_file(model, mesh) for mesh in range(model.nmesh)]
    for file in [mesh_file for mesh_file in meshes if is_file(mesh_file)]:
        note_read(file, file.stat())
    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited == 1)
    widest = float(np.rad2deg(np.ptp(model.jnt_range[hinges], axis=1)).max(initial=0.0))
    if spec.compiler.degree and 0.0 < widest <= 2.0 * np.pi:
        emit(
            Finding(
                FindingCode.ANGLE_IN_RADIANS,
                path.name,
                f"{path}: no range of a hinge is larger than {widest:.3g} degrees, the unit of an "
                "MJCF that states none; these ranges look like radians",
                'write <compiler angle="radian"/> into it, or load the model that includes it',
            )
        )
    return MjcfSource(mujoco, path, spec, model)


def _note_included(path: Path) -> None:
    """Read the files that MuJoCo has included or attached, so that `files_read` lists them."""
    pending, noted = [path], {path}
    while pending:
        for name in _INCLUDED.findall(read_bytes(pending.pop(), _MODEL)):
            file = path.parent / name.decode(errors="replace")
            if file not in noted and is_file(file):
                noted.add(file)
                pending.append(file)


_INCLUDED = re.compile(rb"""<(?:include|model)\s[^>]*?\bfile\s*=\s*["']([^"']+)["']""")
_MODEL = FileKind("MuJoCo model", 64, RobotError)


def _load_mujoco(path: Path) -> Any:
    needs = f"{path} is an MJCF, which needs MuJoCo"
    with optional_import(needs, "simulate", RobotError, instead=", or give a URDF"):
        import mujoco
    return mujoco


def source_of_model(model: Any) -> MjcfSource:
    """Return the source of a ``mujoco.MjModel`` that is from no file."""
    name = bytes(model.names).partition(b"\0")[0].decode() or "model"
    path = Path(name)
    return MjcfSource(_load_mujoco(path), path, None, model)


def _strip_visuals(spec: Any, *, keyframes: bool) -> None:
    """Delete visual elements, which may name missing files, and keyframes unless they are kept."""
    for geom in spec.geoms:
        geom.material = ""
    for site in spec.sites:
        site.material = ""
    for tendon in spec.tendons:
        tendon.material = ""
    keys = () if keyframes else spec.keys
    for unseen in (*spec.skins, *spec.materials, *spec.textures, *keys):
        spec.delete(unseen)


def mj_pose(quaternion: FloatArray, position: FloatArray) -> FloatArray:
    """Return the (4, 4) pose of MuJoCo's quaternion [w, x, y, z] and position [x, y, z]."""
    return rigid(position, Rotation.from_quat(quaternion, scalar_first=True).as_matrix())


_ENDINGS = (".stl", ".obj")
"""Endings of mesh files that both MuJoCo and `MeshShape` read."""


def is_supported_geom(source: MjcfSource, geom: int) -> bool:
    """Return whether a geom has a shape that bounded bodies may have."""
    kinds = source.mujoco.mjtGeom
    return kinds(int(source.model.geom_type[geom])) in (
        kinds.mjGEOM_MESH, kinds.mjGEOM_BOX, kinds.mjGEOM_SPHERE, kinds.mjGEOM_CYLINDER,
        kinds.mjGEOM_CAPSULE,
    )  # fmt: skip


def geom_shape(source: MjcfSource, geom: int) -> LinkShape:
    """Return the shape of a geom in the frame of its body.

    A mesh whose vertices are in the MJCF itself becomes their convex hull.

    Raises:
        RobotError: If it is not a shape that a bounded body can have.
    """
    model, kinds = source.model, source.mujoco.mjtGeom
    T = mj_pose(model.geom_quat[geom], model.geom_pos[geom])
    kind, size = kinds(int(model.geom_type[geom])), model.geom_size[geom].tolist()
    body = source.body(int(model.geom_bodyid[geom]))
    if kind == kinds.mjGEOM_MESH:
        shape, T_geom_file = _mesh_shape(source, int(model.geom_dataid[geom]))
        return LinkShape(shape, T @ T_geom_file)
    if not is_supported_geom(source, geom):
        word = kind.name.removeprefix("mjGEOM_").lower()
        raise RobotError(
            f"{source.path}: body {body!r} has the collision shape {word!r}; use boxes, spheres, "
            "cylinders, capsules or meshes"
        )
    try:
        return LinkShape(_primitive(source, kind, *size), T)
    except ArgumentError as error:
        raise RobotError(
            f"{source.path}: body {body!r} has an impossible shape: {error}"
        ) from error


def body_shape(source: MjcfSource, geom: int) -> tuple[Shape, FloatArray]:
    """Return a geom as the shape of an object or support, and its (4, 4) pose in its body.

    Raises:
        RobotError: As of `geom_shape`.
    """
    geom_in_body = geom_shape(source, geom)
    mesh = geom_in_body.shape
    if not isinstance(mesh, LinkMesh):
        return mesh, geom_in_body.T_link_shape
    if mesh.file is not None and mesh.file.suffix.lower() in _ENDINGS and min(mesh.scale) > 0.0:
        return MeshShape(mesh.file, mesh.scale), geom_in_body.T_link_shape
    T = mj_pose(source.model.geom_quat[geom], source.model.geom_pos[geom])
    return _mesh_hull(source, int(source.model.geom_dataid[geom])), T


def _mesh_hull(source: MjcfSource, mesh: int) -> Hull:
    """Return the convex hull of a mesh's vertices, in MuJoCo's frame of the mesh.

    Raises:
        RobotError: If the mesh is flat.
    """
    model = source.model
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
    label = f"{source.path}: the mesh {model.mesh(mesh).name!r}"
    if is_flat(vertices):
        raise RobotError(f"{label} has no volume; give it a thickness or use a box")
    corners, findings = hull_corners(vertices, label)
    emit(*findings)
    return Hull(corners)


def _primitive(source: MjcfSource, kind: Any, x: float, y: float, z: float) -> Shape:
    """Return the primitive of given kind and MuJoCo's half lengths."""
    kinds = source.mujoco.mjtGeom
    if kind == kinds.mjGEOM_BOX:
        return Box((2.0 * x, 2.0 * y, 2.0 * z))
    if kind == kinds.mjGEOM_SPHERE:
        return Sphere(x)
    return (Cylinder if kind == kinds.mjGEOM_CYLINDER else Capsule)(x, 2.0 * y)


def _mesh_shape(source: MjcfSource, mesh: int) -> tuple[LinkMesh | Hull, FloatArray]:
    """Return a mesh, and the pose of its file's frame in MuJoCo's frame of the mesh."""
    model = source.model
    name = model.mesh(mesh).name
    if source.spec is None or not source.spec.mesh(name).file:
        return _mesh_hull(source, mesh), np.eye(4)
    asset = source.spec.mesh(name)
    scale, T_ref = np.array(asset.scale), mj_pose(asset.refquat, asset.refpos)
    if np.ptp(scale) > 0.0 and not np.allclose(T_ref[:3, :3], np.eye(3)):
        raise RobotError(
            f"{source.path}: the mesh {name!r} is rotated and then scaled by {asset.scale}, "
            "which differs along its axes; rotate the mesh in its file instead"
        )
    # MuJoCo's vertex is R_m^T (S R_ref^T (v - p_ref) - p_m) of the file's v.
    T_file = invert(T_ref)
    T_file[:3, 3] *= scale
    file = _mesh_file(model, mesh)
    x, y, z = scale.tolist()
    mesh_pose = mj_pose(model.mesh_quat[mesh], model.mesh_pos[mesh])
    file_found = file if is_file(file) else None
    return LinkMesh(str(file), file_found, (file,), (x, y, z)), invert(mesh_pose) @ T_file


def _mesh_file(model: Any, mesh: int) -> Path:
    """Return the file of a mesh; the current folder for a mesh without a file."""
    # The folder may be that of an attached model; strippath removes the folder of a mesh's name.
    return Path(model.paths[model.mesh_pathadr[mesh] :].partition(b"\0")[0].decode()).resolve()
