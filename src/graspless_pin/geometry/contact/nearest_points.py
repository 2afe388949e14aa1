"""The nearest points of two bodies at any gap, and how they move as the bodies do.

With n the normal from the first body to the second, g the gap, R_1 and R_2 the matrices of the
radii of curvature, and v and w the velocities of the bodies at their own nearest points, the normal
turns so that the points stay opposite each other (Montana, see `curvature`):

    (R_1 + R_2 + g) dn = v_2 - v_1 + R_1 (w_1 x n) + R_2 (w_2 x n)    in the tangent plane,

and the gap grows by n . (v_2 - v_1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import coal  # pyright: ignore[reportMissingImports]
import numpy as np

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.collision import PARALLEL_ANGLE, CollisionBody, Polytope
from graspless_pin.geometry.contact.convex_sets import (
    ConvexSet,
    Patch,
    Plane,
    Revolved,
    convex_set,
    find_patch,
)
from graspless_pin.geometry.contact.curvature import radii_of_curvature
from graspless_pin.geometry.contact.polygons import plane_basis
from graspless_pin.problem.checks import FloatArray

_MOST_STEPS = 20
_SETTLED = 1e-14  # m
_SAME_NORMAL = math.cos(0.1)
_SAME_GAP = 1e-5  # m
_LEAST_RADIUS = 1e-7
"""m: where both surfaces and the gap are more pointed, the normal has no derivative."""


class Velocities(NamedTuple):
    """How a body moves in each of k motions.

    Attributes:
        linear: (3, k) velocity of one of its points, world axes.
        angular: (3, k) angular velocity.
    """

    linear: FloatArray
    angular: FloatArray


class Rates(NamedTuple):
    """How two nearest points move in each of k motions.

    Attributes:
        gap: (k,) of the gap.
        normal: (3, k) of the normal from the first body to the second.
        middle: (3, k) of the point midway.
        smooth: Whether these are derivatives: the bodies are not both pointed there.
    """

    gap: FloatArray
    normal: FloatArray
    middle: FloatArray
    smooth: bool


def nearest_patch(first: Sequence[CollisionBody], second: Sequence[CollisionBody]) -> Patch:
    """Find where two bodies, of one convex piece or more each, are nearest or deepest.

    Returns:
        The normal from the first body to the second, and the points midway: several where faces or
        edges are parallel.

    Raises:
        SceneError: If both are half-spaces, or a shape cannot be used.
    """
    patches = [_of_pieces(one, other) for one in first for other in second]
    return min(patches, key=lambda patch: min(patch.gaps))


def _of_pieces(one: CollisionBody, other: CollisionBody) -> Patch:
    sets = convex_set(one.name, one.geometry), convex_set(other.name, other.geometry)
    if isinstance(sets[1], Plane):
        if isinstance(sets[0], Plane):
            raise SceneError(f"'{one.name}' and '{other.name}' are both flat without an end")
        patch = find_patch(other, sets[1], one, sets[0], math.inf, math.inf)
        found = None if patch is None else patch._replace(normal=-patch.normal)
    else:
        found = find_patch(one, sets[0], other, sets[1], math.inf, math.inf)
    assert found is not None  # noqa: S101 - no gap is too wide
    curved = any(
        isinstance(one, Revolved) and one.half_extents[0] > one.swept_radius for one in sets
    )
    return _settled(one, other, sets, found) if curved and len(found.gaps) == 1 else found


def _settled(
    one: CollisionBody, other: CollisionBody, sets: tuple[ConvexSet, ConvexSet], patch: Patch
) -> Patch:
    """Return a patch of one point by Newton's method: on rims coal stops at some 1e-5 of a turn."""
    n = patch.normal
    for _ in range(_MOST_STEPS):
        features = _farthest(sets[0], one, n), _farthest(sets[1], other, -n)
        if max(map(len, features)) > 2 or min(map(len, features)) > 1:
            return patch  # of a face, or of two edges that cross, the normal is known
        for feature in features:
            if len(feature) > 1:
                along = feature[1] - feature[0]
                n = n - (n @ along) / (along @ along) * along
        n = n / np.linalg.norm(n)
        first, second = _nearest_of(*features)
        gap, tangents = float(n @ (second - first)), plane_basis(n).T
        off = tangents.T @ (second - first)
        if np.abs(off).max() < _SETTLED:
            same = n @ patch.normal > _SAME_NORMAL and abs(gap - patch.gaps[0]) < _SAME_GAP
            return Patch(n, 0.5 * (first + second)[None], [gap]) if same else patch
        bent = radii_of_curvature([one], first, n, tangents) + radii_of_curvature(
            [other], second, -n, tangents
        )
        n = n + tangents @ _solved(bent + gap * np.eye(2), off)
        n = n / np.linalg.norm(n)
    return patch


def _farthest(solid: ConvexSet, body: CollisionBody, direction: FloatArray) -> FloatArray:
    """(K, 3) ends of what lies farthest along a direction, world, m."""
    R, t = body.T_world_geometry[:3, :3], body.T_world_geometry[:3, 3]
    if isinstance(solid, Plane):
        return np.zeros((3, 3))
    return solid.feature(direction @ R) @ R.T + t


def _nearest_of(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the nearest points of two points, or of a point and a segment."""
    if len(first) > 1:
        other, own = _nearest_of(second, first)
        return own, other
    point, foot = first[0], second[0]
    if len(second) > 1:
        along = second[1] - second[0]
        share = float(np.clip((point - foot) @ along / (along @ along), 0.0, 1.0))
        foot = foot + share * along
    return point, foot


def face_along(
    name: str, pieces: Sequence[CollisionBody], T_world_body: FloatArray, direction: FloatArray
) -> tuple[FloatArray, float]:
    """Return the plane of the face of a body that looks along a direction.

    Args:
        name: What messages call the direction.
        pieces: The body's pieces.
        T_world_body: (4, 4) the body's pose.
        direction: (3,) out of the body, its own axes.

    Returns:
        (3,) outward normal and offset along it, m, in the body's own frame.

    Raises:
        ArgumentError: If no face looks that way.
    """
    along = direction / np.linalg.norm(direction)
    best, found = -1.0, (along, 0.0)
    for piece in pieces:
        solid = convex_set(piece.name, piece.geometry)
        T = np.linalg.inv(T_world_body) @ piece.T_world_geometry
        if isinstance(solid, Plane):
            normals, offsets = solid.normal[None], np.array([solid.offset])
        elif isinstance(solid, Polytope):
            normals, offsets = solid.face_normals, solid.face_offsets
        else:
            normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
            wide = np.array([solid.top_radius, solid.bottom_radius]) > 0.0
            normals, offsets = normals[wide], solid.support_values(normals)[wide]
        for normal, offset in zip(normals @ T[:3, :3].T, offsets, strict=True):
            if normal @ along > best:
                best, found = float(normal @ along), (normal, float(offset + normal @ T[:3, 3]))
    if best < math.cos(PARALLEL_ANGLE):
        near = found[0].round(3).tolist() if best > -1.0 else "none"
        raise ArgumentError(
            name, f"is {direction.tolist()}; no face looks that way, the nearest looks along {near}"
        )
    return found


def half_space(name: str, normal: FloatArray, offset: float, T: FloatArray) -> CollisionBody:
    """Return the half-space below a plane that is given in the frame of a body at a pose (4, 4)."""
    return CollisionBody(name, coal.Halfspace(np.array(normal), float(offset)), T)


def nearest_rates(
    first: Sequence[CollisionBody],
    second: Sequence[CollisionBody],
    patch: Patch,
    velocities: tuple[Velocities, Velocities],
) -> Rates:
    """Return how the nearest points of two bodies move, a single point of the patch.

    Args:
        first: The pieces of the first body.
        second: Those of the second.
        patch: Where they are near.
        velocities: Of both bodies, each at its own nearest point.
    """
    n, gap = patch.normal, min(patch.gaps)
    middle = patch.points[int(np.argmin(patch.gaps))]
    one, other = velocities
    tangents = plane_basis(n).T
    radii = (
        radii_of_curvature(first, middle - 0.5 * gap * n, n, tangents),
        radii_of_curvature(second, middle + 0.5 * gap * n, -n, tangents),
    )
    turns = [tangents.T @ np.cross(body.angular.T, n).T for body in velocities]
    apart = other.linear - one.linear
    bent = radii[0] + radii[1] + gap * np.eye(2)
    smooth = len(patch.gaps) == 1 and float(np.linalg.eigvalsh(bent)[0]) > _LEAST_RADIUS
    pulls = tangents.T @ apart + radii[0] @ turns[0] + radii[1] @ turns[1]
    turning = _solved(bent, pulls)
    on_first = one.linear + tangents @ (radii[0] @ (turning - turns[0]))
    on_second = other.linear - tangents @ (radii[1] @ (turning - turns[1]))
    return Rates(n @ apart, tangents @ turning, 0.5 * (on_first + on_second), smooth)


def _solved(bent: FloatArray, pulls: FloatArray) -> FloatArray:
    """Return how a normal turns; the pseudoinverse is not exact enough beside `FLAT`."""
    try:
        return np.asarray(np.linalg.solve(bent, pulls), dtype=np.float64)
    except np.linalg.LinAlgError:  # two corners that touch
        return np.zeros_like(pulls)


def rates_over_face(normal: FloatArray, gap: float, point: Velocities, plane: Velocities) -> Rates:
    """Return how a point of one body and its foot on a plane of another one move.

    Args:
        normal: (3,) unit, from the point to the plane.
        gap: Between the point and its foot, m.
        point: The velocity of the point.
        plane: The velocity of the other body, at the foot.
    """
    turning = np.cross(plane.angular.T, normal).T
    opening = normal @ (plane.linear - point.linear)
    across = np.outer(normal, opening) + gap * turning
    return Rates(opening, turning, point.linear + 0.5 * across, smooth=True)
