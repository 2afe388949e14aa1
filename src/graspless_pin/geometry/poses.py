"""Rigid transforms as plain (4, 4) arrays, named destination first (``T_world_link``)."""

from __future__ import annotations

import math
from typing import NoReturn

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.typing import ArrayLike

from graspless_pin.bounds import LARGEST_LENGTH
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray, as_floats, read_only

RIGIDITY_TOLERANCE = 1e-6
"""Largest entry of ``R^T R - I`` of a rotation: poses in files are rounded."""

_LEAST_PITCH_COSINE = 1e-12
"""Cosine of the pitch below which the pitch counts as 90 degrees."""
_IDENTITY_ROTATION = np.eye(3)


def pose_matrix(position: ArrayLike, rotation: ArrayLike | None = None) -> FloatArray:
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
    origin = finite_numbers("position", position)
    if origin.shape != (3,):
        raise ArgumentError("position", f"needs 3 numbers (x, y, z in metres), got {origin.shape}")
    R = (
        _IDENTITY_ROTATION
        if rotation is None
        else rotation_matrix(finite_numbers("rotation", rotation))
    )
    return as_pose("rotation", rigid(origin, R))


def rigid(position: ArrayLike, R: FloatArray = _IDENTITY_ROTATION) -> FloatArray:
    """Return the (4, 4) transform of a position (3,), m, and a rotation (3, 3), both unchecked."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position
    return T


def translated(T: FloatArray, shift: FloatArray) -> FloatArray:
    """Return a (4, 4) transform translated by (3,), m, in the destination's axes."""
    return rigid(T[:3, 3] + shift, T[:3, :3])


def turned_about(center: FloatArray, R: FloatArray, shift: FloatArray) -> FloatArray:
    """Return the (4, 4) transform that rotates about a point (3,) and then shifts by (3,), m."""
    return rigid(center - R @ center + shift, R)


def roll_pitch_yaw(R: FloatArray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw, rad, of a rotation ``R = Rz(yaw) Ry(pitch) Rx(roll)``, (3, 3).

    At a pitch of 90 degrees roll and yaw are about one axis: the roll is then zero.
    """
    flat = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], flat)
    if flat < _LEAST_PITCH_COSINE:
        return 0.0, pitch, math.atan2(-R[0, 1], R[1, 1])
    return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])


def invert(T: FloatArray) -> FloatArray:
    """Return the (4, 4) inverse of a rigid transform, exact up to rounding."""
    RT = T[:3, :3].T
    return rigid(RT.dot(-T[:3, 3]), RT)


def transformed(T: FloatArray, point: FloatArray) -> FloatArray:
    """Return a point (3,) transformed by a (4, 4) transform."""
    return T[:3, :3].dot(point) + T[:3, 3]


def screw_twist(T: FloatArray) -> FloatArray:
    """Return the (6,) twist [v; omega] that yields a (4, 4) transform in one second, m and rad.

    Its rotation is by less than half a turn.
    """
    return np.array(pin.log6(pin.SE3(T[:3, :3], T[:3, 3])).vector)


def twist_transform(twist: FloatArray) -> FloatArray:
    """Return the (4, 4) transform that a constant twist (6,) [v; omega] yields in one second."""
    return np.array(pin.exp6(twist).homogeneous)


def turning_velocities(omega: FloatArray, arms: FloatArray) -> FloatArray:
    """Return omega x r for given arms r; for a handful, `numpy.cross` takes far longer.

    Args:
        omega: (3,) angular velocity, rad/s.
        arms: (M, 3) r, m, in the same axes.

    Returns:
        (M, 3) m/s.
    """
    x, y, z = omega.tolist()
    return arms @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def as_pose(name: str, T: ArrayLike) -> FloatArray:
    """Check that ``T`` is a rigid transform and return it as a read-only copy.

    Args:
        name: Name of the transform in messages.
        T: (4, 4) homogeneous matrix.

    Returns:
        (4, 4) read-only float array.

    Raises:
        ArgumentError: If the shape is wrong, a value is not finite, the last row is not
            (0, 0, 0, 1), the rotation is not orthonormal or it mirrors.
    """
    pose = as_numbers(name, T)
    if pose.shape != (4, 4) or not _is_rigid(pose):
        _refuse_pose(name, finite_numbers(name, pose))
    return read_only(pose)


def _is_rigid(T: FloatArray) -> bool:
    """Return whether a (4, 4) array is a rigid transform within the tolerances."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), last = T.tolist()
    # Comparisons with NaN are false.
    return (
        abs(a * a + d * d + g * g - 1.0) <= RIGIDITY_TOLERANCE
        and abs(b * b + e * e + h * h - 1.0) <= RIGIDITY_TOLERANCE
        and abs(c * c + f * f + i * i - 1.0) <= RIGIDITY_TOLERANCE
        and abs(a * b + d * e + g * h) <= RIGIDITY_TOLERANCE
        and abs(a * c + d * f + g * i) <= RIGIDITY_TOLERANCE
        and abs(b * c + e * f + h * i) <= RIGIDITY_TOLERANCE
        and a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) > 0.0
        and abs(x) <= LARGEST_LENGTH
        and abs(y) <= LARGEST_LENGTH
        and abs(z) <= LARGEST_LENGTH
        and last == [0.0, 0.0, 0.0, 1.0]
    )


def _refuse_pose(name: str, pose: FloatArray) -> NoReturn:
    """Raise ArgumentError that says why an array is not a pose."""
    if pose.shape != (4, 4):
        raise ArgumentError(name, f"a pose is a (4, 4) matrix, got an array of shape {pose.shape}")
    if pose[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ArgumentError(name, f"the last row of a pose is 0 0 0 1, got {pose[3].tolist()}")
    R = pose[:3, :3]
    error = float(np.abs(R.T @ R - np.eye(3)).max())
    if error > RIGIDITY_TOLERANCE:
        raise ArgumentError(
            name, f"the rotation part is not orthonormal (R^T R is off by {error:.3g})"
        )
    if np.abs(pose[:3, 3]).max() > LARGEST_LENGTH:
        raise ArgumentError(
            name, f"the position is {pose[:3, 3].tolist()}; it must be within ±{LARGEST_LENGTH:g} m"
        )
    raise ArgumentError(name, "the rotation part is a reflection (determinant -1); flip one axis")


def unit_vector(vector: FloatArray, least: float = 0.0) -> FloatArray:
    """Return a vector (n,) scaled to length one; z, (3,), if it is not longer than ``least``."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > least else np.array([0.0, 0.0, 1.0])


def as_numbers(name: str, values: ArrayLike, wanted: str = "numbers") -> FloatArray:
    """Return a float copy of ``values``; ``wanted`` says in messages what they must be.

    Raises:
        ArgumentError: If they are not numbers; with the name.
    """
    array = as_floats(values)
    if array is None:
        raise ArgumentError(name, f"needs {wanted}, got {values!r:.200}")
    return array


def finite_numbers(name: str, values: ArrayLike) -> FloatArray:
    """Return a float copy of ``values``, which must be finite numbers.

    Raises:
        ArgumentError: If one is not finite; with the name.
    """
    array = as_numbers(name, values)
    if not np.isfinite(array).all():
        raise ArgumentError(name, f"needs finite numbers, got {array.tolist()}")
    return array


def rotation_matrix(rotation: FloatArray) -> FloatArray:
    """Return the (3, 3) matrix of finite roll-pitch-yaw angles, a quaternion or a matrix.

    Raises:
        ArgumentError: If the shape is wrong or the quaternion is zero.
    """
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
