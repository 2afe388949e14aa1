"""Mounting rule of the one-joint lever fingers in ``robots/``."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.poses import as_pose


def lever_base_pose(
    point: ArrayLike, normal: ArrayLike, direction: ArrayLike, length: float
) -> NDArray[np.float64]:
    """Return where to mount a lever so that its tip touches ``point``, pressing along ``normal``.

    With r the direction, n the normal and l the length,
    ``T_world_base = [[r, -n, n x r, point - l r], [0, 0, 0, 1]]``. At q = 0 the tip's contact
    Jacobian is then ``J = -l n^T`` as a row (``J = l n^T`` for the mirrored lever), because the
    joint's axis is z = n x r and z x (l r) = -l n.

    Args:
        point: (3,) contact point, world, metres.
        normal: (3,) contact normal into the object, world, of any length.
        direction: (3,) from the joint's axis to the contact, world, of any length; its part along
            the normal is taken off.
        length: Distance from the axis to the contact, metres.

    Returns:
        (4, 4) ``T_world_base``.

    Raises:
        ArgumentError: If the normal is zero or the direction is parallel to it.
    """
    n = np.asarray(normal, dtype=np.float64)
    if not np.linalg.norm(n) > 0.0:
        raise ArgumentError("normal", f"needs a direction, got {n.tolist()}")
    n = n / np.linalg.norm(n)
    along = np.asarray(direction, dtype=np.float64)
    r = along - (along @ n) * n
    if not np.linalg.norm(r) > 1e-9 * np.linalg.norm(along):
        raise ArgumentError(
            "direction", f"must not be parallel to the normal, got {along.tolist()}"
        )
    r = r / np.linalg.norm(r)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([r, -n, np.cross(n, r)])
    T[:3, 3] = np.asarray(point, dtype=np.float64) - length * r
    return as_pose("T_world_base", T)
