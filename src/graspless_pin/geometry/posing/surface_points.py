"""Where fingertips are asked to go: points on an object's surface with normals into it."""

from __future__ import annotations

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.records import ManipulatedObject
from graspless_pin.geometry.contact.distances import separation
from graspless_pin.geometry.poses import pose_matrix

Array = NDArray[np.float64]

SURFACE_TOLERANCE = 1e-3
"""How far off the object's surface a given point may lie, m."""

_POINT_RADIUS = 1e-6  # m, a point as coal knows it


def checked_goal(
    target: ManipulatedObject, finger: str, goal: tuple[ArrayLike, ArrayLike]
) -> tuple[Array, Array]:
    """Check where a fingertip is to go.

    Args:
        target: The object.
        finger: Whose goal it is, for the message.
        goal: (3,) point on the object's surface and (3,) normal there into the object, world.

    Returns:
        The point and the unit normal.

    Raises:
        ArgumentError: If one is not three finite numbers, the point is more than
            `SURFACE_TOLERANCE` off the surface, or the normal is zero or points out of the object.
    """
    argument = f"goals[{finger!r}]"
    try:
        point, normal = (np.array(part, dtype=np.float64) for part in goal)
    except (TypeError, ValueError) as error:
        raise ArgumentError(argument, f"needs (point, normal), got {goal!r}") from error
    for what, vector in (("point", point), ("normal", normal)):
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise ArgumentError(
                argument, f"the {what} needs three finite numbers, got {vector.tolist()}"
            )
    if not np.any(normal):
        raise ArgumentError(argument, "the normal must not be zero")
    normal /= np.linalg.norm(normal)
    off, outward = _off_surface(target, point)
    if abs(off) > SURFACE_TOLERANCE:
        side = "outside" if off > 0.0 else "inside"
        nearest = (point - off * outward).round(6).tolist()
        raise ArgumentError(
            argument,
            f"the point {point.tolist()} is {abs(off) * 1e3:.1f} mm {side} the surface of object "
            f"'{target.name}'; the nearest point of it is {nearest}",
        )
    ahead, _ = _off_surface(target, point + SURFACE_TOLERANCE * normal)
    if ahead > off + 0.5 * SURFACE_TOLERANCE:
        raise ArgumentError(
            argument,
            f"the normal {normal.round(6).tolist()} points out of object '{target.name}'; normals "
            "point into it",
        )
    return point, normal


def _off_surface(target: ManipulatedObject, point: Array) -> tuple[float, Array]:
    """Return a point's signed distance from the object's surface and the direction outwards."""
    tiny = CollisionBody("point", coal.Sphere(_POINT_RADIUS), pose_matrix(point))
    apart = separation(target.collision_body(), tiny)
    return apart.distance + _POINT_RADIUS, apart.normal
