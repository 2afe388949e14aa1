"""The screw motion between two poses."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.problem.checks import FloatArray

_AT_REST = 1e-9
"""Steps shorter than this, m and rad, are rounding."""
_SMALL = 1e-4


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
    if angle > _SMALL:
        factor = (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2
    # The inverse of the left Jacobian of SO(3).
    across = np.cross(turn, step)
    velocity = step - 0.5 * across + factor * np.cross(turn, across)
    return np.concatenate([velocity, turn]) / duration
