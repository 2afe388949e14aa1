"""Where fingertips are asked to go: points on an object's surface with normals into it."""

from __future__ import annotations

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.contact.distances import nearest_separation
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.problem.checks import FloatArray

SURFACE_TOLERANCE = 1e-3
"""How far off the object's surface a given point may lie, m."""

_OUTSIDE = 2.0 * SURFACE_TOLERANCE  # how far a point is moved to see whether it gets out
_POINT_RADIUS = 1e-6  # m, a point as coal knows it


def checked_goal(
    target: ManipulatedObject, finger: str, goal: tuple[ArrayLike, ArrayLike]
) -> tuple[FloatArray, FloatArray]:
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
        nearest = point - off * outward
        message = f"the point {point.tolist()} is {abs(off) * 1e3:.1f} mm {side} the surface of "
        message += f"object '{target.name}'"
        if not _is_within(target, nearest, outward):
            message += f"; the nearest point of it is {nearest.round(6).tolist()}"
        raise ArgumentError(argument, message)
    ahead, _ = _off_surface(target, point + SURFACE_TOLERANCE * normal)
    if ahead > off + 0.5 * SURFACE_TOLERANCE:
        raise ArgumentError(
            argument,
            f"the normal {normal.round(6).tolist()} points out of object '{target.name}'; normals "
            "point into it",
        )
    if _is_within(target, point, -normal):
        raise ArgumentError(
            argument,
            f"the point {point.tolist()} lies inside object '{target.name}' where two of its "
            "convex pieces meet: no finger gets there along the normal",
        )
    return point, normal


def _is_within(target: ManipulatedObject, point: FloatArray, outward: FloatArray) -> bool:
    """Return whether the object goes on outwards of a point on the surface of one of its pieces."""
    _, aside, across = np.linalg.svd(outward[None])[2]
    ways = [outward, *(outward + turn for turn in (aside, -aside, across, -across))]
    reached = [point + _OUTSIDE * way / np.linalg.norm(way) for way in ways]
    return max(_off_surface(target, there)[0] for there in reached) < 0.25 * _OUTSIDE


def _off_surface(target: ManipulatedObject, point: FloatArray) -> tuple[float, FloatArray]:
    """Return a point's signed distance from the object's surface and the direction outwards.

    Inside an object of several convex pieces it is the distance from the surface of the piece in
    which the point lies deepest.
    """
    tiny = CollisionBody("point", coal.Sphere(_POINT_RADIUS), pose_matrix(point))
    apart = nearest_separation(target.collision_bodies(), [tiny])
    return apart.distance + _POINT_RADIUS, apart.normal
