"""Screw motions: from one pose to another with one twist, which turns and slides along an axis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.problem.checks import FloatArray

_AT_REST = 1e-9
"""Steps shorter than this, m and rad, are rounding."""
_SMALL_TURN = 1e-4


class ScrewMotion(NamedTuple):
    """The screw motion of a body between two poses, in one second.

    Attributes:
        T_from: (4, 4) pose at the start, m.
        T_to: (4, 4) pose at the end.
        center_of_mass: (3,) in the body's frame, m.
        start_twist: (6,) [v; omega] at the start, see `segment_twist`.
    """

    T_from: FloatArray
    T_to: FloatArray
    center_of_mass: FloatArray
    start_twist: FloatArray

    @classmethod
    def between(
        cls, T_from: FloatArray, T_to: FloatArray, center_of_mass: FloatArray
    ) -> ScrewMotion:
        """Return the motion between two poses, see `segment_twist`."""
        twist = segment_twist(T_from, T_to, 1.0, center_of_mass)
        return cls(T_from, T_to, center_of_mass, twist)

    @property
    def lengths(self) -> tuple[float, float]:
        """How far the centre of mass goes, m, and how far the body turns, rad."""
        velocity, turn = np.split(self.start_twist, 2)
        return float(np.linalg.norm(velocity)), float(np.linalg.norm(turn))

    def at(self, fraction: float) -> tuple[FloatArray, FloatArray]:
        """Return the (4, 4) pose and the (6,) twist at a fraction of the way.

        Args:
            fraction: 0 at the start, 1 at the end.
        """
        velocity, turn = np.split(self.start_twist, 2)
        step = _carried(fraction * turn, fraction * velocity)
        twist = np.concatenate([velocity + np.cross(turn, step), turn])
        if fraction in (0.0, 1.0):
            return (self.T_to if fraction else self.T_from), twist
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(fraction * turn).as_matrix() @ self.T_from[:3, :3]
        center = self.T_from[:3, :3] @ self.center_of_mass + self.T_from[:3, 3] + step
        pose[:3, 3] = center - pose[:3, :3] @ self.center_of_mass
        return pose, twist


def _carried(turn: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return how far a point gets that moves with a velocity which turns by a rotation vector."""
    angle = float(np.linalg.norm(turn))
    first, second = 0.5, 1.0 / 6.0
    if angle > _SMALL_TURN:
        first = (1.0 - np.cos(angle)) / angle**2
        second = (angle - np.sin(angle)) / angle**3
    across = np.cross(turn, velocity)
    return velocity + first * across + second * np.cross(turn, across)


def segment_twist(
    T_from: FloatArray, T_to: FloatArray, duration: float, center_of_mass: FloatArray
) -> FloatArray:
    """Return the twist at the start of the screw motion from one pose to another.

    Poses on one turn about a fixed axis, such as an edge, give exactly that turn.

    Args:
        T_from: (4, 4) pose at the start, m.
        T_to: (4, 4) pose at the end; turned by less than half a turn.
        duration: s, > 0.
        center_of_mass: (3,) in the body's frame, m.

    Returns:
        (6,) [v; omega] about the centre of mass where it is at the start, world axes, m/s and
        rad/s; zeros if the body stays where it is.
    """
    R = T_to[:3, :3] @ T_from[:3, :3].T
    center = T_from[:3, :3] @ center_of_mass + T_from[:3, 3]
    # Displacement of the centre of mass: the screw seen from there.
    step = T_to[:3, :3] @ center_of_mass + T_to[:3, 3] - center
    turn = Rotation.from_matrix(R).as_rotvec()
    if max(np.linalg.norm(step), np.linalg.norm(turn)) <= _AT_REST:
        return np.zeros(6)
    angle = float(np.linalg.norm(turn))
    factor = 1.0 / 12.0
    if angle > _SMALL_TURN:
        factor = (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2
    # The inverse of the left Jacobian of SO(3).
    across = np.cross(turn, step)
    velocity = step - 0.5 * across + factor * np.cross(turn, across)
    return np.concatenate([velocity, turn]) / duration
