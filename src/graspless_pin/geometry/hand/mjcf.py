"""Write an MJCF as the elements of a URDF, so that one reader, one audit and one tree serve both.

MuJoCo reads the file: defaults, included files and inferred inertias are its own. What a URDF has
no word for is refused by name, or left out where forces at rest do not depend on it.

The shapes of an MJCF's bodies as a URDF has them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from graspless_pin.errors import RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.mjcf_motors import Mimic, couplings, motor_joints, motors
from graspless_pin.geometry.hand.mjcf_source import (
    MjcfSource,
    add_ends,
    add_origin,
    read_mjcf,
    rotation_and_position,
    words,
)
from graspless_pin.geometry.hand.urdf_tendons import write_tendon
from graspless_pin.problem.checks import FloatArray


def add_geom(source: MjcfSource, link: ET.Element, kind: str, geom: int) -> None:
    """Add a geom to a link.

    Args:
        source: The file.
        link: The ``<link>``.
        kind: ``collision`` or ``visual``.
        geom: Its index.

    Raises:
        RobotError: If a collision shape is none that a URDF can have, or a mesh has no file.
    """
    model, kinds = source.model, source.mujoco.mjtGeom
    R, p = rotation_and_position(model.geom_quat[geom], model.geom_pos[geom])
    shape, size = model.geom_type[geom], model.geom_size[geom]
    radius, length = repr(float(size[0])), repr(2.0 * float(size[1]))
    if shape == kinds.mjGEOM_MESH:
        attributes, turned, moved = _mesh(source, int(model.geom_dataid[geom]))
        R, p = R @ turned, p + R @ moved
    elif shape == kinds.mjGEOM_BOX:
        attributes = "box", {"size": words(2.0 * size)}
    elif shape == kinds.mjGEOM_SPHERE:
        attributes = "sphere", {"radius": radius}
    elif shape == kinds.mjGEOM_CYLINDER:
        attributes = "cylinder", {"radius": radius, "length": length}
    elif shape == kinds.mjGEOM_CAPSULE:
        attributes = "capsule", {"radius": radius, "length": length}
    elif kind == "visual":
        return
    else:
        word = kinds(shape).name.removeprefix("mjGEOM_").lower()
        raise RobotError(
            f"{source.path}: body {link.get('name')!r} has the collision shape {word!r}; use "
            "boxes, spheres, cylinders, capsules or meshes"
        )
    element = ET.SubElement(link, kind)
    add_origin(element, R, p)
    ET.SubElement(ET.SubElement(element, "geometry"), attributes[0], attrib=attributes[1])


def _mesh(
    source: MjcfSource, mesh: int
) -> tuple[tuple[str, dict[str, str]], FloatArray, FloatArray]:
    """Return a mesh's element, and the pose of its file's frame in MuJoCo's own for it."""
    model = source.model
    name = model.mesh(mesh).name
    asset = source.spec.mesh(name)
    scale, (about, origin) = (
        np.array(asset.scale),
        rotation_and_position(asset.refquat, asset.refpos),
    )
    if not asset.file:
        raise RobotError(
            f"{source.path}: the mesh {name!r} has no file; write its vertices into one"
        )
    if np.ptp(scale) > 0.0 and not np.allclose(about, np.eye(3)):
        raise RobotError(
            f"{source.path}: the mesh {name!r} is turned and then scaled by {asset.scale}, "
            "different along its axes; turn its file instead"
        )
    # MuJoCo's vertex is R_m^T (S R_ref^T (v - p_ref) - p_m) of the file's v.
    turned, moved = rotation_and_position(model.mesh_quat[mesh], model.mesh_pos[mesh])
    folder = Path(source.spec.modelfiledir or source.path.parent)
    file = folder / source.spec.compiler.meshdir / asset.file
    attributes = {"filename": str(file.resolve()), "scale": words(scale)}
    return (
        ("mesh", attributes),
        turned.T @ about.T,
        -turned.T @ (scale * (about.T @ origin) + moved),
    )


def mjcf_robot(path: Path) -> ET.Element:
    """Read an MJCF and return the ``<robot>`` that says the same.

    The robot is the tree of bodies that has motors; with a free joint to the world, or none, it is
    where the hand is mounted, else it hangs on a link called ``world``, as several trees do, and
    ``root_link`` chooses. What hangs on the world without motors is no part of the hand. A body
    with several joints gets a link after each but the last, ``BODY_after_JOINT``. Limits of motors
    that pull one way only are left open.

    Args:
        path: The file; files that it includes and meshes are found as MuJoCo does.

    Raises:
        RobotError: If MuJoCo is not installed or refuses the file, or it has ball joints, closed
            loops, couplings that are not linear or collision shapes that a URDF cannot have.

    Warns:
        GrasplessPinWarning: Springs are left out, or motors that cannot be told apart.
    """
    return _Writer(read_mjcf(path)).robot()


class _Writer:
    """Writes one compiled model."""

    def __init__(self, source: MjcfSource) -> None:
        self._source, self._model = source, source.model
        self._kinds = source.mujoco.mjtJoint
        self._root = ET.Element("robot", name=source.path.stem)
        self._mimics: dict[int, Mimic] = {}
        self._efforts: dict[int, float] = {}

    def robot(self) -> ET.Element:
        """Return the ``<robot>``."""
        model = self._model
        top, inside = self._robot_bodies()
        if np.any(model.jnt_stiffness[inside[model.jnt_bodyid]] > 0.0):
            emit(
                Finding(
                    FindingCode.LEFT_OUT_SPRINGS, self._source.path.name,
                    f"{self._source.path}: has joints with springs; their torques are left out",
                    "add them to what the motors have to give",
                )
            )  # fmt: skip
        self._mimics = couplings(self._source, inside)
        self._efforts, tendons = motors(self._source, self._mimics, inside)
        for body in map(int, np.flatnonzero(inside)):
            if body != top:
                self._add_joints(body)
            self._add_link(body)
        for name, tendon in tendons.items():
            write_tendon(self._root, name, tendon)
        return self._root

    def _robot_bodies(self) -> tuple[int, NDArray[np.bool_]]:
        """Return the robot's root and its bodies: the trees with motors, or with joints at all."""
        model = self._model
        tree = np.arange(model.nbody)
        for body in range(1, model.nbody):
            parent = model.body_parentid[body]
            tree[body] = body if parent == 0 else tree[parent]
        moved = tree[model.jnt_bodyid[motor_joints(self._source)]]
        roots = np.unique(moved if len(moved) else tree[model.jnt_bodyid])
        inside = np.isin(tree, roots)
        first = model.body_jntadr[roots[0]] if len(roots) == 1 else -1
        if len(roots) == 1 and (first < 0 or model.jnt_type[first] == self._kinds.mjJNT_FREE):
            return int(roots[0]), inside
        inside[0] = True
        return 0, inside

    def _add_joints(self, body: int) -> None:
        """Add the joints that lead to a body, and links between them."""
        model, source = self._model, self._source
        R, p = rotation_and_position(model.body_quat[body], model.body_pos[body])
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        name, parent = source.body(body), source.body(int(model.body_parentid[body]))
        at = np.zeros(3)  # of the last joint, in the body's frame
        for joint in joints:
            here, axis = model.jnt_pos[joint], model.jnt_axis[joint]
            is_last = joint == joints[-1] and not here.any()
            child = name if is_last else f"{name}_after_{source.joint(joint)}"
            element = self._add_joint(joint, parent, child)
            turned, moved = R, p + R @ (here - at)
            start = float(model.qpos0[model.jnt_qposadr[joint]])
            if model.jnt_type[joint] == self._kinds.mjJNT_SLIDE:
                moved = moved - start * R @ axis
            else:
                turned = R @ Rotation.from_rotvec(-start * axis).as_matrix()
            add_origin(element, turned, moved)
            ET.SubElement(element, "axis", xyz=words(axis))
            if not is_last:
                ET.SubElement(self._root, "link", name=child)
            parent, at, R, p = child, here, np.eye(3), np.zeros(3)
        if parent != name:
            fixed = ET.SubElement(self._root, "joint", name=f"{name}_fixed", type="fixed")
            add_ends(fixed, parent, name)
            add_origin(fixed, R, p - R @ at)

    def _add_joint(self, joint: int, parent: str, child: str) -> ET.Element:
        """Add a joint without its pose and axis."""
        model, kinds, name = self._model, self._kinds, self._source.joint(joint)
        kind = model.jnt_type[joint]
        if kind == kinds.mjJNT_BALL:
            raise RobotError(
                f"{self._source.path}: joint {name!r} is a ball joint; use three hinge joints"
            )
        limited = bool(model.jnt_limited[joint])
        word = "floating" if kind == kinds.mjJNT_FREE else "prismatic"
        if kind == kinds.mjJNT_HINGE:
            word = "revolute" if limited else "continuous"
        element = ET.SubElement(self._root, "joint", name=name, type=word)
        add_ends(element, parent, child)
        if kind == kinds.mjJNT_FREE:
            return element
        limit = ET.SubElement(element, "limit")
        low, high = model.jnt_range[joint] if limited else (-np.inf, np.inf)
        if limited or word == "prismatic":
            limit.set("lower", repr(float(low)))
            limit.set("upper", repr(float(high)))
        if joint in self._efforts:
            limit.set("effort", repr(self._efforts[joint]))
        if joint in self._mimics:
            leaders, offset = self._mimics[joint]
            for leader, multiplier in leaders.items():
                words_of = {"joint": self._source.joint(leader), "multiplier": repr(multiplier)}
                ET.SubElement(element, "mimic", words_of, offset=repr(offset))
                offset = 0.0
        rotor = float(model.dof_armature[model.jnt_dofadr[joint]])
        if rotor > 0.0:
            drive = ET.SubElement(self._root, "transmission", name=f"{name}_rotor")
            ET.SubElement(drive, "joint", name=name)
            ET.SubElement(drive, "rotor_inertia", value=repr(rotor))
        return element

    def _add_link(self, body: int) -> None:
        model = self._model
        link = ET.SubElement(self._root, "link", name=self._source.body(body))
        if model.body_mass[body] > 0.0:
            inertial = ET.SubElement(link, "inertial")
            pose = rotation_and_position(model.body_iquat[body], model.body_ipos[body])
            add_origin(inertial, *pose)
            ET.SubElement(inertial, "mass", value=repr(float(model.body_mass[body])))
            values = dict(zip(("ixx", "iyy", "izz"), model.body_inertia[body], strict=True))
            zero = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
            text = {key: repr(float(value)) for key, value in values.items()}
            ET.SubElement(inertial, "inertia", attrib=text | zero)
        first, plane = model.body_geomadr[body], self._source.mujoco.mjtGeom.mjGEOM_PLANE
        if body == 0:
            return  # surroundings are no part of the hand
        geoms = [
            geom
            for geom in range(first, first + model.body_geomnum[body])
            if model.geom_type[geom] != plane
        ]
        touching = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
        seen = [geom for geom in geoms if geom not in touching] or touching
        for kind, chosen in (("collision", touching), ("visual", seen)):
            for geom in chosen:
                add_geom(self._source, link, kind, geom)
