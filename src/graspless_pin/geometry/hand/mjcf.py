"""The record of a robot from an MJCF.

MuJoCo reads the file: defaults, included files and inferred inertias are its own. What a tree of
rigid links has no word for is refused by name, or left out where forces at rest do not depend on
it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from graspless_pin.errors import RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.mjcf_motors import Mimic, couplings, motor_joints, motors
from graspless_pin.geometry.hand.mjcf_source import (
    MjcfSource,
    geom_shape,
    is_known,
    pose,
    read_mjcf,
)
from graspless_pin.geometry.hand.robot_model import (
    LinkShape,
    RobotJoint,
    RobotLink,
    RobotModel,
    check_link_count,
    limit_of,
    root_of_tree,
)
from graspless_pin.geometry.poses import rigid
from graspless_pin.geometry.robots.description import JointCoupling
from graspless_pin.problem.checks import FloatArray


def robot_of_mjcf(
    path: Path, *, visuals_collide: bool = False, with_shapes: bool = True
) -> RobotModel:
    """Read an MJCF.

    The robot is the tree of bodies that has motors; with a free joint to the world, or none, it is
    where the hand is mounted, else it hangs on a link called ``world``, as several trees do, and
    ``root_link`` chooses. What hangs on the world without motors is no part of the hand. A body
    with several joints gets a link after each but the last, ``BODY_after_JOINT``. Limits of motors
    that pull one way only are left open.

    Args:
        path: The file; files that it includes and meshes are found as MuJoCo does.
        visuals_collide: Whether links without collision shapes collide with their visual ones.
        with_shapes: Whether the shapes of the links are read.

    Raises:
        RobotError: If MuJoCo is not installed or refuses the file, or it has ball joints, closed
            loops, couplings that are not linear or collision shapes that no link can have.

    Warns:
        GrasplessPinWarning: Springs are left out, or motors that cannot be told apart.
    """
    return robot_of_source(
        read_mjcf(path), visuals_collide=visuals_collide, with_shapes=with_shapes
    )


def robot_of_source(
    source: MjcfSource, *, visuals_collide: bool = False, with_shapes: bool = True
) -> RobotModel:
    """Return the robot of what MuJoCo has read: see `robot_of_mjcf`."""
    reader = _Reader(source, visuals_collide=visuals_collide, with_shapes=with_shapes)
    robot = reader.robot()
    robot.check()
    return robot


def tree_roots(model: Any) -> NDArray[np.intp]:
    """Return by body the one that it hangs on and that hangs on the world; the world's is 0."""
    roots = np.arange(model.nbody)
    for body in range(1, model.nbody):
        parent = model.body_parentid[body]
        roots[body] = body if parent == 0 else roots[parent]
    return roots


def robot_bodies(source: MjcfSource) -> tuple[int, NDArray[np.bool_]]:
    """Return the robot's root and its bodies: the trees with motors, or with joints at all."""
    model = source.model
    tree = tree_roots(model)
    moved = tree[model.jnt_bodyid[motor_joints(source)]]
    roots = np.unique(moved if len(moved) else tree[model.jnt_bodyid])
    inside = np.isin(tree, roots)
    first = model.body_jntadr[roots[0]] if len(roots) == 1 else -1
    free = source.mujoco.mjtJoint.mjJNT_FREE
    if len(roots) == 1 and (first < 0 or model.jnt_type[first] == free):
        return int(roots[0]), inside
    inside[0] = True
    return 0, inside


class _Reader:
    """Reads one compiled model."""

    def __init__(self, source: MjcfSource, *, visuals_collide: bool, with_shapes: bool) -> None:
        self._source, self._model = source, source.model
        self._kinds = source.mujoco.mjtJoint
        self._visuals_collide, self._with_shapes = visuals_collide, with_shapes
        self._links: list[RobotLink] = []
        self._joints: list[RobotJoint] = []
        self._mimics: dict[int, Mimic] = {}
        self._efforts: dict[int, float] = {}

    def robot(self) -> RobotModel:
        """Return the robot."""
        model = self._model
        top, inside = robot_bodies(self._source)
        check_link_count(str(self._source.path), int(inside.sum()))
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
        label, joints = str(self._source.path), self._joints
        root = root_of_tree(
            label,
            [link.name for link in self._links],
            [joint.name for joint in joints],
            [(joint.parent, joint.child) for joint in joints],
        )
        names = {joint.name for joint in joints}
        own = {name: one for name, one in tendons.items() if names >= set(one.arms)}
        return RobotModel(label, root, tuple(self._links), tuple(joints), own)

    def _add_joints(self, body: int) -> None:
        """Add the joints that lead to a body, and links between them."""
        model, source = self._model, self._source
        T = pose(model.body_quat[body], model.body_pos[body])
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        name, parent = source.body(body), source.body(int(model.body_parentid[body]))
        at = np.zeros(3)  # of the last joint, in the body's frame
        for joint in joints:
            here, axis = model.jnt_pos[joint], np.array(model.jnt_axis[joint])
            is_last = joint == joints[-1] and not here.any()
            child = name if is_last else f"{name}_after_{source.joint(joint)}"
            start = float(model.qpos0[model.jnt_qposadr[joint]])
            step = rigid(here - at)
            if model.jnt_type[joint] == self._kinds.mjJNT_SLIDE:
                step = step @ rigid(-start * axis)
            else:
                step[:3, :3] = Rotation.from_rotvec(-start * axis).as_matrix()
            self._joints.append(self._joint(joint, parent, child, T @ step, axis))
            if not is_last:
                self._links.append(RobotLink(child))
            parent, at, T = child, here, np.eye(4)
        if parent != name:
            self._joints.append(RobotJoint(f"{name}_fixed", "fixed", parent, name, T @ rigid(-at)))

    def _joint(
        self, joint: int, parent: str, child: str, T: FloatArray, axis: FloatArray
    ) -> RobotJoint:
        model, kinds, name = self._model, self._kinds, self._source.joint(joint)
        kind = model.jnt_type[joint]
        if kind == kinds.mjJNT_BALL:
            raise RobotError(
                f"{self._source.path}: joint {name!r} is a ball joint; use three hinge joints"
            )
        if kind == kinds.mjJNT_FREE:
            return RobotJoint(name, "floating", parent, child, T)
        limited = bool(model.jnt_limited[joint])
        word = "prismatic"
        if kind == kinds.mjJNT_HINGE:
            word = "revolute" if limited else "continuous"
        low, high = map(float, model.jnt_range[joint]) if limited else (-np.inf, np.inf)
        coupling = None
        if joint in self._mimics:
            leaders, offset = self._mimics[joint]
            follows = {self._source.joint(leader): one for leader, one in leaders.items()}
            coupling = JointCoupling(name, follows, offset)
        effort = limit_of(self._efforts.get(joint, np.inf))
        return RobotJoint(
            name, word, parent, child, T, axis, limit_of(low), limit_of(high), effort,
            rotor_inertia=float(model.dof_armature[model.jnt_dofadr[joint]]), coupling=coupling,
        )  # fmt: skip

    def _add_link(self, body: int) -> None:
        model, name = self._model, self._source.body(body)
        T = pose(model.body_iquat[body], model.body_ipos[body])
        mass, inertia = float(model.body_mass[body]), np.zeros((3, 3))
        if mass > 0.0:
            inertia = T[:3, :3] @ np.diag(model.body_inertia[body]) @ T[:3, :3].T
        first, plane = model.body_geomadr[body], self._source.mujoco.mjtGeom.mjGEOM_PLANE
        # What stands still in the world is no part of the hand.
        count = model.body_geomnum[body] if body and self._with_shapes else 0
        geoms = [geom for geom in range(first, first + count) if model.geom_type[geom] != plane]
        touching = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
        seen = [geom for geom in geoms if geom not in touching] or touching
        seen = [geom for geom in seen if is_known(self._source, geom)]
        if self._visuals_collide and not touching:
            touching = seen
        self._links.append(
            RobotLink(
                name, mass, T[:3, 3].copy(), inertia,
                tuple(geom_shape(self._source, geom) for geom in touching), self._visuals(seen),
            )
        )  # fmt: skip

    def _visuals(self, geoms: list[int]) -> tuple[LinkShape, ...]:
        """Return how a link looks; nothing fails that is drawn only."""
        try:
            return tuple(geom_shape(self._source, geom) for geom in geoms)
        except RobotError:
            return ()
