"""Pinocchio's work space for one model, and what is read out of it: poses, Jacobians, inertia."""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray, read_only

_REAL = np.dtype(np.float64).itemsize
_POSE = 12 * _REAL
"""Bytes of a pose in C++: the columns of R, then the translation."""


class Kinematics(NamedTuple):
    """Where everything is at one configuration.

    Attributes:
        T_world_joint: (n + 1, 4, 4) pose of every Pinocchio joint, the base first.
        J: (6, n) spatial joint columns [v; omega] about the world's origin, world axes.
    """

    T_world_joint: FloatArray
    J: FloatArray


class WorkSpace:
    """One ``pinocchio.Data`` that serves all configurations of a model, and all threads."""

    def __init__(self, model: Any) -> None:
        """Make room for a ``pinocchio.Model``."""
        self._model = model
        self._weighed = model.copy()  # its gravity is set when another one is asked for
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
        """Return the (n,) torques that carry the links' weight at a configuration vector (nq,).

        Args:
            q: Pinocchio's configuration vector.
            gravity: (3,) gravitational acceleration, world axes, m/s^2.
        """
        return self._of_weight(pin.computeGeneralizedGravity, q, gravity).reshape(-1)

    def gravity_rates(self, q: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return (n, n) how `gravity_torques` change with the joints' positions."""
        rates = self._of_weight(pin.computeGeneralizedGravityDerivatives, q, gravity)
        return rates.reshape(self._model.nv, self._model.nv)

    def _of_weight(self, function: Any, q: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return what one of Pinocchio's functions of weight returns."""
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
    """Return each joint's parent, its pose there, and the direction that it moves in.

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
    """All poses of ``data.oMi`` as one (n + 1, 3, 4) view into Pinocchio's memory.

    A look at each pose alone goes through Python objects, which takes five times as long as the
    kinematics themselves. None if the poses do not lie one after the other as they are known to.
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
