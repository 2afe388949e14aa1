"""Building the Pinocchio model of robots joint by joint, and a work space for its algorithms.

The work space yields poses, Jacobians, gravity torques and inertias.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from graspless_pin.geometry.hand.robot_model import RobotJoint, RobotLink, RobotModel
from graspless_pin.problem.checks import FloatArray, read_only

_REAL = np.dtype(np.float64).itemsize
_POSE = 12 * _REAL
"""Bytes of a pose in C++: the columns of R, then the translation."""


class Kinematics(NamedTuple):
    """Joint poses and Jacobian columns at one configuration.

    Attributes:
        T_world_joint: (n + 1, 4, 4) pose of every Pinocchio joint, the base first.
        J: (6, n) spatial joint columns [v; omega] about the world's origin, world axes.
    """

    T_world_joint: FloatArray
    J: FloatArray


class WorkSpace:
    """One ``pinocchio.Data`` shared by all configurations of a model and all threads."""

    def __init__(self, model: Any) -> None:
        """Allocate the data of a ``pinocchio.Model``."""
        self._model = model
        self._weighed = model.copy()  # its gravity is set on demand
        self._gravity = b""
        self._data = model.createData()
        self._lock = threading.Lock()
        self._columns = _pose_columns(self._data)
        self._frame = np.zeros((model.njoints, 4, 4))
        self._frame[:, 3, 3] = 1.0

    def kinematics(self, q: FloatArray) -> Kinematics:
        """Return joint poses and Jacobian columns at a configuration vector (nq,)."""
        with self._lock:
            pin.computeJointJacobians(self._model, self._data, q)
            poses = self._frame.copy()
            if self._columns is None:
                poses[:, :3] = [pose.homogeneous[:3] for pose in self._data.oMi]
            else:
                poses[:, :3] = self._columns
            J = np.array(self._data.J)
        J = J.reshape(6, -1)  # the binding drops the dimension of one joint
        return Kinematics(read_only(poses), read_only(J))

    def gravity_torques(self, q: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return the (n,) torques that compensate the weight at a configuration vector (nq,).

        Args:
            q: Pinocchio's configuration vector.
            gravity: (3,) gravitational acceleration, world axes, m/s^2.
        """
        return self._gravity_result(pin.computeGeneralizedGravity, q, gravity).reshape(-1)

    def gravity_rates(self, q: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return the (n, n) derivatives of `gravity_torques` by the joint positions."""
        rates = self._gravity_result(pin.computeGeneralizedGravityDerivatives, q, gravity)
        return rates.reshape(self._model.nv, self._model.nv)

    def _gravity_result(self, function: Any, q: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return the result of one of Pinocchio's gravity functions."""
        given = gravity.tobytes()
        with self._lock:
            if given != self._gravity:
                self._weighed.gravity.linear = gravity
                self._gravity = given
            return np.array(function(self._weighed, self._data, q))

    def joint_inertia(self, q: FloatArray) -> FloatArray:
        """Return the (n, n) joint-space inertia at a configuration vector (nq,)."""
        with self._lock:
            inertia = np.array(pin.crba(self._model, self._data, q))
        return inertia.reshape(self._model.nv, self._model.nv)


def joint_motions(tree: Any) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """Return each joint's parent, its pose in the parent's frame, and its unit twist.

    Args:
        tree: `KinematicTree`, whose n movable joints have one degree of freedom each.

    Returns:
        (n + 1,) joints; (n + 1, 4, 4) poses in their parents' frames at position zero; and (n, 6)
        unit twists [v; omega] of the movable joints in their own frames: either half is zero.
    """
    model = tree.pinocchio_model
    q, axes = pin.neutral(model), np.zeros((model.njoints - 1, 6))
    for joint, axis in zip(model.joints.tolist()[1:], axes, strict=True):
        data = joint.createData()
        joint.calc(data, q)
        axis[:] = np.ravel(data.S)
    placements = [placement.homogeneous for placement in model.jointPlacements.tolist()]
    return np.array(model.parents, dtype=np.intp), np.array(placements), axes


def _pose_columns(data: Any) -> FloatArray | None:
    """Return all poses of ``data.oMi`` as one (n + 1, 3, 4) view into Pinocchio's memory.

    Access to single poses goes through Python objects, which takes five times as long as the
    kinematics itself. None if the poses are not contiguous in the expected layout.
    """
    poses = data.oMi.tolist()
    start = poses[0].rotation.__array_interface__["data"][0]
    for index, pose in enumerate(poses):
        R, t = pose.rotation, pose.translation
        here = start + index * _POSE
        if not (
            R.__array_interface__["data"][0] == here
            and t.__array_interface__["data"][0] == here + 9 * _REAL
            and R.strides == (_REAL, 3 * _REAL)
            and R.dtype == t.dtype == np.float64
        ):
            return None
    strides = (_POSE, _REAL, 3 * _REAL)
    return as_strided(poses[0].rotation, (len(poses), 3, 4), strides, writeable=False)


_ALIGNED = {
    "revolute": (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ),
    "continuous": (pin.JointModelRUBX, pin.JointModelRUBY, pin.JointModelRUBZ),
    "prismatic": (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ),
}
_UNALIGNED = {
    "revolute": pin.JointModelRevoluteUnaligned,
    "prismatic": pin.JointModelPrismaticUnaligned,
}
_COSINE_LIMIT = 1.01
"""Pinocchio's limits of a cosine and a sine that do not limit the angle."""


class _PendingFrame(NamedTuple):
    """A frame to be added to the model.

    Attributes:
        joint: Pinocchio index of the joint that carries it.
        key: Type and name of the frame.
        placement: Pose in the joint's frame.
        above: Key of the parent frame; None: the universe.
    """

    joint: int
    key: tuple[Any, str]
    placement: Any
    above: tuple[Any, str] | None


def pinocchio_model(
    robots: Sequence[tuple[RobotModel, FloatArray]],
) -> tuple[Any, tuple[tuple[frozenset[str], Any], ...]]:
    """Return one ``pinocchio.Model`` of robots that are fixed to the world.

    Links, joints and frames are in the order of Pinocchio's own URDF reader: depth first, the
    joints of one link by name; then frames by the joint that carries them, as `appendModel` sorts
    them. Frames of joints are called ``joint NAME``: a joint and a link may share a name.

    Args:
        robots: Each robot with its (4, 4) ``T_world_base``; their names must differ.

    Returns:
        The model, with rotor inertias as armature; and of each robot the names of its joints and
        frames, and the inertia of its fixed links, in world axes.
    """
    model = pin.Model()
    bases = tuple(
        _ModelBuilder(model, robot, pin.SE3(np.array(T_world_base))).add_robot()
        for robot, T_world_base in robots
    )
    rotors = {joint.name: joint.rotor_inertia for robot, _ in robots for joint in robot.joints}
    model.armature = np.array([rotors[name] for name in tuple(model.names)[1:]])
    return model, bases


class _ModelBuilder:
    """Adds the links, joints and frames of one robot to a Pinocchio model."""

    def __init__(self, model: Any, robot: RobotModel, T_world_base: Any) -> None:
        self._model, self._robot, self._base = model, robot, T_world_base
        self._links = {link.name: link for link in robot.links}
        self._below: dict[str, list[RobotJoint]] = {}
        for joint in sorted(robot.joints, key=lambda item: item.name):
            self._below.setdefault(joint.parent, []).append(joint)
        self._frames: list[_PendingFrame] = []
        self._fixed = pin.Inertia.Zero()

    def add_robot(self) -> tuple[frozenset[str], Any]:
        """Add the robot; return its names and the inertia of its fixed links."""
        self._add_subtree(self._links[self._robot.root], 0, pin.SE3.Identity(), None)
        frame_indices: dict[tuple[Any, str], int] = {}
        for frame in sorted(self._frames, key=lambda item: item.joint):
            above = 0 if frame.above is None else frame_indices[frame.above]
            placement = frame.placement if frame.joint else self._base * frame.placement
            kind, name = frame.key
            frame_indices[frame.key] = self._model.addFrame(
                pin.Frame(name, frame.joint, above, placement, kind)
            )
        fixed = self._base.act(self._fixed)
        self._model.inertias[0] = self._model.inertias[0] + fixed
        joints = [item.name for item in self._robot.joints if item.is_movable]
        return frozenset([*joints, *(name for _, name in frame_indices)]), fixed

    def _add_subtree(
        self, link: RobotLink, joint: int, placement: Any, above: tuple[Any, str] | None
    ) -> None:
        """Add a link at a placement in the frame of a joint, and its subtree."""
        body = (pin.FrameType.BODY, link.name)
        self._frames.append(_PendingFrame(joint, body, placement, above))
        if link.mass or link.inertia.any():
            # Set by attribute: the constructor refuses inertias that no rigid body can have.
            inertia = pin.Inertia.Zero()
            inertia.mass, inertia.lever = link.mass, np.array(link.center_of_mass)
            inertia.inertia = np.array(link.inertia)
            if joint:
                self._model.appendBodyToJoint(joint, inertia, placement)
            else:
                self._fixed = self._fixed + placement.act(inertia)
        for item in self._below.get(link.name, ()):
            T, child = placement * pin.SE3(np.array(item.T_parent_joint)), self._links[item.child]
            kind = pin.FrameType.JOINT if item.is_movable else pin.FrameType.FIXED_JOINT
            frame = (kind, f"joint {item.name}")
            if item.is_movable:
                carrier = self._add_joint(item, joint, T if joint else self._base * T)
                T = pin.SE3.Identity()
            else:
                carrier = joint
            self._frames.append(_PendingFrame(carrier, frame, T, body))
            self._add_subtree(child, carrier, T, frame)

    def _add_joint(self, item: RobotJoint, parent: int, placement: Any) -> int:
        ends = np.array([item.lower]), np.array([item.upper])
        if item.kind == "continuous":
            ends = -_COSINE_LIMIT * np.ones(2), _COSINE_LIMIT * np.ones(2)
        return self._model.addJoint(
            parent, _joint_model(item), placement, item.name,
            np.array([item.effort]), np.array([item.velocity]), *ends,
        )  # fmt: skip


def _joint_model(item: RobotJoint) -> Any:
    for axis, kind in zip(np.eye(3), _ALIGNED[item.kind], strict=True):
        if (item.axis == axis).all():
            return kind()
    axis = item.axis / np.abs(item.axis).max()  # so that its squares do not overflow
    axis = axis / np.linalg.norm(axis)
    return _continuous_joint(axis) if item.kind == "continuous" else _UNALIGNED[item.kind](axis)


def _continuous_joint(axis: FloatArray) -> Any:
    """Return a continuous joint about a unit vector (3,).

    The bindings cannot set its axis, so that it is made by Pinocchio's URDF reader.
    """
    axis_text = " ".join(repr(float(component)) for component in axis)
    return pin.buildModelFromXML(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        f'<parent link="a"/><child link="b"/><axis xyz="{axis_text}"/></joint></robot>'
    ).joints[1]
