"""Rigid transforms as plain (4, 4) arrays, named destination first (``T_world_link``)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError

RIGIDITY_TOLERANCE = 1e-6
"""Largest entry of ``R^T R - I`` that still counts as a rotation: typed-in poses are rounded."""

_IDENTITY = np.eye(3)


def pose_matrix(position: ArrayLike, rotation: ArrayLike | None = None) -> NDArray[np.float64]:
    """Build a (4, 4) transform from a position and a rotation in any of the usual forms.

    Args:
        position: (3,) origin of the source frame in the destination frame, in metres.
        rotation: One of: None for no rotation; (3,) roll, pitch, yaw in radians with
            ``R = Rz(yaw) Ry(pitch) Rx(roll)`` as in URDF; (4,) quaternion x, y, z, w of any length
            but zero; (3, 3) rotation matrix.

    Returns:
        (4, 4) read-only transform.

    Raises:
        ArgumentError: If a shape is wrong, a value is not finite, the quaternion is zero or the
            matrix is not a rotation.
    """
    origin = _finite("position", position)
    if origin.shape != (3,):
        raise ArgumentError("position", f"needs 3 numbers (x, y, z in metres), got {origin.shape}")
    T = np.eye(4)
    T[:3, 3] = origin
    if rotation is not None:
        T[:3, :3] = _rotation_matrix(_finite("rotation", rotation))
    return as_pose("rotation", T)


def invert(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (4, 4) inverse of a rigid transform, exact up to rounding."""
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse


def turning_velocities(
    omega: NDArray[np.float64], arms: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return omega x r for each of some arms; for a handful, numpy's own product takes far longer.

    Args:
        omega: (3,) angular velocity, rad/s.
        arms: (M, 3) r, m, in the same axes.

    Returns:
        (M, 3) m/s.
    """
    x, y, z = omega.tolist()
    return arms @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def as_pose(name: str, T: ArrayLike) -> NDArray[np.float64]:
    """Check that ``T`` is a rigid transform and return it as a read-only copy.

    Args:
        name: What the caller calls this transform, for the message.
        T: (4, 4) homogeneous matrix.

    Returns:
        (4, 4) read-only float array.

    Raises:
        ArgumentError: If the shape is wrong, a value is not finite, the last row is not
            (0, 0, 0, 1), the rotation is not orthonormal or it mirrors.
    """
    pose = _finite(name, T)
    if pose.shape != (4, 4):
        raise ArgumentError(name, f"a pose is a (4, 4) matrix, got an array of shape {pose.shape}")
    x, y, z, last = pose.tolist()
    if last != [0.0, 0.0, 0.0, 1.0]:
        raise ArgumentError(name, f"the last row of a pose is 0 0 0 1, got {last}")
    R = pose[:3, :3]
    error = float(np.abs(R.T @ R - _IDENTITY).max())
    if error > RIGIDITY_TOLERANCE:
        raise ArgumentError(
            name, f"the rotation part is not orthonormal (R^T R is off by {error:.3g})"
        )
    if (
        x[0] * (y[1] * z[2] - y[2] * z[1])
        + x[1] * (y[2] * z[0] - y[0] * z[2])
        + x[2] * (y[0] * z[1] - y[1] * z[0])
    ) < 0.0:
        raise ArgumentError(name, "the rotation part mirrors (determinant -1); flip one axis")
    pose.setflags(write=False)
    return pose


def _finite(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return a float copy of ``values``, which must be finite numbers."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(name, f"needs numbers, got {values!r}") from error
    if not np.isfinite(array).all():
        raise ArgumentError(name, f"needs finite numbers, got {array.tolist()}")
    return array


def _rotation_matrix(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) matrix of roll-pitch-yaw angles, a quaternion or a matrix."""
    if rotation.shape == (3, 3):
        return rotation
    if rotation.shape == (3,):
        (cr, cp, cy), (sr, sp, sy) = np.cos(rotation), np.sin(rotation)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
    if rotation.shape == (4,):
        length = float(np.linalg.norm(rotation))
        if length == 0.0:
            raise ArgumentError("rotation", "a quaternion x, y, z, w must not be zero")
        x, y, z, w = rotation / length
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
    raise ArgumentError(
        "rotation",
        "give 3 numbers (roll, pitch, yaw in radians), 4 (quaternion x, y, z, w) or a 3 by 3 "
        f"matrix, got an array of shape {rotation.shape}",
    )
