"""Radii of curvature at contacts, and the motion of the nearest points of two moving bodies.

Montana, The kinematics of contact and grasp, Int. J. Robotics Research 7(3), 1988. A surface is
described by the matrix of its radii of curvature in the tangent plane, the inverse of its shape
operator: zero across an edge and at a vertex, where the contact point stays on the body while the
normal turns, and `FLAT` along flat directions. So vertices, edges, faces and curved surfaces are
treated alike, and sweeping a surface by a sphere adds the sphere's radius in all directions.

Where edges or vertices meet, a small shift of the bodies changes the normal by a finite angle:
`normal_jumps`.

With n the normal from the first body to the second, g the gap, R_1 and R_2 the matrices of the
radii of curvature, and v and w the velocities of the bodies at their own nearest points, the normal
turns so that the points stay opposite each other:

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
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.convex_sets import (
    AT_BORDER,
    FLAT,
    PARALLEL_ANGLE,
    Plane,
    foot_on_segment,
)
from graspless_pin.geometry.bodies.polytopes import Polytope, is_hull
from graspless_pin.geometry.contact.contact_points import ContactArrays
from graspless_pin.geometry.contact.distances import solids_of
from graspless_pin.geometry.contact.patches import Patch, find_patch, placed_set
from graspless_pin.geometry.contact.polygons import plane_basis
from graspless_pin.problem.checks import FloatArray

FITTED_RADIUS = 2e-3
"""Least radius around a contact within which a surface is fitted to a hull's vertices, m."""
_EDGES_AROUND = 2.0
"""Radius of that neighbourhood in mean lengths of the edges at the nearest vertex."""
_SAME_SURFACE = math.tan(math.radians(15.0))
"""Largest depth over distance of a vertex whose normal is within 30 degrees of the contact's."""
_LEAST_VERTICES = 6
_MOST_STEPS = 20
_CONVERGED = 1e-14  # m
_SAME_NORMAL = math.cos(0.1)
_SAME_GAP = 1e-5  # m
_LEAST_RADIUS = 1e-7
"""Smallest eigenvalue of R_1 + R_2 + g for which the normal has a derivative, m."""


class Rolling(NamedTuple):
    """Radii of curvature of the object and the touching bodies at M contacts, for rolling.

    With the angular velocity w of the object relative to the body, the normal n and the radii of
    curvature R_o and R_b, a sticking contact point moves with R_o (R_o + R_b)^-1 R_b (w x n) on
    both surfaces.

    Attributes:
        object_radii: (M, 2, 2) R_o along the contact's tangents, m.
        body_radii: (M, 2, 2) R_b, m.
    """

    object_radii: FloatArray
    body_radii: FloatArray

    @property
    def inverse_radii_sum(self) -> FloatArray:
        """(M, 2, 2) (R_o + R_b)^-1, 1/m; the pseudoinverse where both are vertices."""
        both = self.object_radii + self.body_radii
        return np.asarray(np.linalg.pinv(both, hermitian=True), dtype=np.float64)

    @property
    def rolling_matrix(self) -> FloatArray:
        """(M, 2, 2) R_o (R_o + R_b)^-1 R_b, m."""
        found = self.object_radii @ self.inverse_radii_sum @ self.body_radii
        return 0.5 * (found + found.transpose(0, 2, 1))


def radii_of_curvature(
    pieces: Sequence[CollisionBody],
    point: FloatArray,
    outward: FloatArray,
    tangents: FloatArray,
    *,
    fitted: bool = False,
) -> FloatArray:
    """Return the radii of curvature of a body's surface at a surface point.

    Args:
        pieces: The convex pieces of the body.
        point: (3,) world, m.
        outward: (3,) unit normal out of the body, world axes.
        tangents: (3, 2) directions of the rows and columns, world axes.
        fitted: Whether convex hulls of meshes represent smooth surfaces: their radii are then those
            of a quadric through the vertices nearby, if there are enough of them.

    Returns:
        (2, 2) symmetric, m.
    """
    piece = min(pieces, key=lambda candidate: _surface_distance(candidate, point, outward))
    solid, R, t = placed_set(piece)
    local = (point - t) @ R, outward @ R, R.T @ tangents
    fitted_radii = _fitted_quadric_radii(solid, *local) if fitted and is_hull(solid) else None
    return solid.radii_of_curvature(*local) if fitted_radii is None else fitted_radii


def is_surface_of(
    pieces: Sequence[CollisionBody], point: FloatArray, outward: FloatArray, tolerance: float
) -> bool:
    """Return whether a point with its normal lies on a body's surface within a tolerance.

    Args:
        pieces: The convex pieces of the body; there may be none.
        point: (3,) world, m.
        outward: (3,) unit normal out of the body, world axes.
        tolerance: m.
    """
    return any(_surface_distance(piece, point, outward) <= tolerance for piece in pieces)


def has_mesh(pieces: Sequence[CollisionBody]) -> bool:
    """Return whether one of a body's pieces is a hull of points, such as a mesh."""
    return any(is_hull(placed_set(piece)[0]) for piece in pieces)


def _surface_distance(piece: CollisionBody, point: FloatArray, outward: FloatArray) -> float:
    """Return the distance of a point from the feature of a piece farthest along a normal, m."""
    solid, R, t = placed_set(piece)
    local, direction = (point - t) @ R, outward @ R
    if isinstance(solid, Plane):
        return abs(float(solid.faces_at(local)[1][0]))
    below = float(solid.support_values(direction[None])[0] - direction @ local)
    return max(abs(below), float(solid.faces_at(local)[1].max()))


def _fitted_quadric_radii(
    solid: Polytope, point: FloatArray, outward: FloatArray, tangents: FloatArray
) -> FloatArray | None:
    """Return the radii of a quadric through the vertices nearby; None: too few."""
    arms = solid.vertices - point
    nearest = int(np.einsum("vi,vi->v", arms, arms).argmin())
    lengths = [length for _, length in solid.edges[nearest]]
    # A vertex within a flat face has no edges.
    reach = max(FITTED_RADIUS, _EDGES_AROUND * float(np.mean(lengths)) if lengths else 0.0)
    u, depth = arms @ tangents, -arms @ outward
    distances = np.hypot(u[:, 0], u[:, 1])
    is_near = (distances <= reach) & (depth <= _SAME_SURFACE * distances + AT_BORDER)
    if int(is_near.sum()) < _LEAST_VERTICES:
        return None
    x, y = (u[is_near] / reach).T
    terms = np.column_stack([0.5 * x * x, x * y, 0.5 * y * y, x, y, np.ones_like(x)])
    coefficients, _, rank, _ = np.linalg.lstsq(terms, depth[is_near], rcond=1e-9)
    if rank < terms.shape[1]:
        return None
    a, b, c = coefficients[:3] / reach**2
    values, axes = np.linalg.eigh([[a, b], [b, c]])
    return axes / np.maximum(values, 1.0 / FLAT) @ axes.T


def normal_jumps(
    pieces: Sequence[CollisionBody],
    others: Sequence[CollisionBody],
    touching: ContactArrays,
    near: float,
) -> list[float]:
    """Return the angle by which each contact's normal jumps if the bodies shift.

    Where a face or a curved surface touches, the normal is that of the surface and persists. Where
    edges or vertices meet, a shift brings a face into contact: the normal jumps to the face's.

    Args:
        pieces: The object's pieces.
        others: Hand links and supports.
        touching: M contacts.
        near: Distance from a contact point within which faces meet there, m.

    Returns:
        M angles, rad; zero without a jump.
    """
    own, theirs = PlacedBodies.of(pieces), PlacedBodies.of(others)
    by_name: dict[str, list[int]] = {}
    for index, name in enumerate(theirs.shapes.names):
        by_name.setdefault(name, []).append(index)
    jumps = []
    for contact in touching:
        reach = near + abs(contact.distance)
        angle = min(
            _nearest_face_angle(own, range(len(own)), contact.position, -contact.normal, reach),
            _nearest_face_angle(
                theirs, by_name[contact.body], contact.position, contact.normal, reach
            ),
        )
        jumps.append(angle if np.isfinite(angle) else 0.0)
    return jumps


def _nearest_face_angle(
    bodies: PlacedBodies, rows: Sequence[int], point: FloatArray, outward: FloatArray, reach: float
) -> float:
    """Return the least angle from a normal to those of the faces at a point, rad; inf: no face."""
    sets, least_angle = solids_of(bodies.shapes).sets, np.inf
    for row in rows:
        T = bodies.poses[row]
        local, direction = T[:3, :3].T @ (point - T[:3, 3]), T[:3, :3].T @ outward
        solid = sets[row]
        if solid.is_curved:
            if (np.abs(local - solid.center) <= solid.half_extents + 2.0 * reach).all():
                return 0.0
            continue
        normals, heights = solid.faces_at(local)
        if heights.max() <= 2.0 * reach:
            cosines = np.clip(normals[heights > -2.0 * reach] @ direction, -1.0, 1.0)
            least_angle = min(least_angle, float(np.arccos(cosines.max(initial=-1.0))))
    return least_angle


class Velocities(NamedTuple):
    """Velocities of a body in each of k motions.

    Attributes:
        linear: (3, k) velocity of one of its points, world axes.
        angular: (3, k) angular velocity.
    """

    linear: FloatArray
    angular: FloatArray


class Rates(NamedTuple):
    """Rates of change of the nearest points of two bodies in each of k motions.

    Attributes:
        gap: (k,) rate of the gap.
        normal: (3, k) rate of the normal from the first body to the second.
        middle: (3, k) velocity of the point midway.
        smooth: Whether these are derivatives: false where both bodies are pointed.
    """

    gap: FloatArray
    normal: FloatArray
    middle: FloatArray
    smooth: bool


def nearest_patch(first: Sequence[CollisionBody], second: Sequence[CollisionBody]) -> Patch:
    """Return the patch at which two bodies, of one or more convex pieces, are nearest or deepest.

    Returns:
        The normal from the first body to the second, and the points midway: several where faces or
        edges are parallel.

    Raises:
        SceneError: If both are half-spaces, or a shape cannot be used.
    """
    patches = [_patch_of_pieces(piece, other) for piece in first for other in second]
    return min(patches, key=lambda patch: min(patch.gaps))


def _patch_of_pieces(first: CollisionBody, second: CollisionBody) -> Patch:
    solids = placed_set(first)[0], placed_set(second)[0]
    if isinstance(solids[1], Plane):
        if isinstance(solids[0], Plane):
            raise SceneError(f"'{first.name}' and '{second.name}' are both unbounded planes")
        patch = find_patch(second, first, math.inf, math.inf)
        result = None if patch is None else patch._replace(normal=-patch.normal)
    else:
        result = find_patch(first, second, math.inf, math.inf)
    assert result is not None  # noqa: S101 - no gap is too wide
    is_rough = any(
        not isinstance(solid, Plane)
        and solid.is_curved
        and solid.half_extents[0] > solid.swept_radius
        for solid in solids
    )
    return _refined_patch(first, second, result) if is_rough and len(result.gaps) == 1 else result


def _refined_patch(first_body: CollisionBody, second_body: CollisionBody, patch: Patch) -> Patch:
    """Refine a patch of one point by Newton's method: at rims coal errs by some 1e-5 of a turn."""
    n = patch.normal
    for _ in range(_MOST_STEPS):
        features = _farthest_feature(first_body, n), _farthest_feature(second_body, -n)
        if max(map(len, features)) > 2 or min(map(len, features)) > 1:
            return patch  # the normal of a face or of two crossing edges is exact already
        for feature in features:
            if len(feature) > 1:
                edge = feature[1] - feature[0]
                n = n - (n @ edge) / (edge @ edge) * edge
        n = n / np.linalg.norm(n)
        first, second = _nearest_points(*features)
        gap, tangents = float(n @ (second - first)), plane_basis(n).T
        misalignment = tangents.T @ (second - first)
        if np.abs(misalignment).max() < _CONVERGED:
            is_same = n @ patch.normal > _SAME_NORMAL and abs(gap - patch.gaps[0]) < _SAME_GAP
            return Patch(n, 0.5 * (first + second)[None], [gap]) if is_same else patch
        radii_sum = radii_of_curvature([first_body], first, n, tangents) + radii_of_curvature(
            [second_body], second, -n, tangents
        )
        n = n + tangents @ _normal_rates(radii_sum + gap * np.eye(2), misalignment)
        n = n / np.linalg.norm(n)
    return patch


def _farthest_feature(body: CollisionBody, direction: FloatArray) -> FloatArray:
    """Return the (K, 3) vertices of the feature farthest along a direction, world, m."""
    solid, R, t = placed_set(body)
    if isinstance(solid, Plane):
        return np.zeros((3, 3))
    return solid.feature(direction @ R) @ R.T + t


def _nearest_points(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the nearest points of two points, or of a point and a segment, (3,) each."""
    if len(first) > 1:
        return foot_on_segment(second[0], *first), second[0]
    return first[0], second[0] if len(second) == 1 else foot_on_segment(first[0], *second)


def face_along(
    name: str, pieces: Sequence[CollisionBody], T_world_body: FloatArray, direction: FloatArray
) -> tuple[FloatArray, float]:
    """Return the plane of a body's face whose normal is along a direction.

    Args:
        name: Name of the direction in messages.
        pieces: The body's pieces.
        T_world_body: (4, 4) pose of the body.
        direction: (3,) out of the body, its own axes.

    Returns:
        (3,) outward normal and offset along it, m, in the body's own frame.

    Raises:
        ArgumentError: If no face has such a normal.
    """
    along = direction / np.linalg.norm(direction)
    best, plane = -1.0, (along, 0.0)
    for piece in pieces:
        solid, T = placed_set(piece)[0], np.linalg.inv(T_world_body) @ piece.T_world_geometry
        normals, offsets = solid.flat_faces()
        for normal, offset in zip(normals @ T[:3, :3].T, offsets, strict=True):
            if normal @ along > best:
                best, plane = float(normal @ along), (normal, float(offset + normal @ T[:3, 3]))
    if best < math.cos(PARALLEL_ANGLE):
        axis = plane[0].round(3).tolist() if best > -1.0 else "none"
        raise ArgumentError(
            name, f"is {direction.tolist()}; no face has this normal; the nearest is {axis}"
        )
    return plane


def half_space(name: str, normal: FloatArray, offset: float, T: FloatArray) -> CollisionBody:
    """Return the half-space below a plane given in the frame of a body at a pose (4, 4)."""
    return CollisionBody(name, coal.Halfspace(np.array(normal), float(offset)), T)


def nearest_rates(
    first: Sequence[CollisionBody],
    second: Sequence[CollisionBody],
    patch: Patch,
    velocities: tuple[Velocities, Velocities],
) -> Rates:
    """Return the rates of the nearest points of two bodies, at one point of a patch.

    Args:
        first: The pieces of the first body.
        second: The pieces of the second body.
        patch: The patch at which they are nearest; its point of the smallest gap counts.
        velocities: The velocities of both bodies, each at its own nearest point.
    """
    n, gap = patch.normal, min(patch.gaps)
    middle = patch.points[int(np.argmin(patch.gaps))]
    first_velocity, second_velocity = velocities
    tangents = plane_basis(n).T
    radii = (
        radii_of_curvature(first, middle - 0.5 * gap * n, n, tangents),
        radii_of_curvature(second, middle + 0.5 * gap * n, -n, tangents),
    )
    normal_turns = [tangents.T @ np.cross(body.angular.T, n).T for body in velocities]
    relative = second_velocity.linear - first_velocity.linear
    radii_sum = radii[0] + radii[1] + gap * np.eye(2)
    smooth = len(patch.gaps) == 1 and float(np.linalg.eigvalsh(radii_sum)[0]) > _LEAST_RADIUS
    right_side = tangents.T @ relative + radii[0] @ normal_turns[0] + radii[1] @ normal_turns[1]
    normal_rate = _normal_rates(radii_sum, right_side)
    on_first = first_velocity.linear + tangents @ (radii[0] @ (normal_rate - normal_turns[0]))
    on_second = second_velocity.linear - tangents @ (radii[1] @ (normal_rate - normal_turns[1]))
    return Rates(n @ relative, tangents @ normal_rate, 0.5 * (on_first + on_second), smooth)


def _normal_rates(radii_sum: FloatArray, right_side: FloatArray) -> FloatArray:
    """Solve for the rate of a normal; a pseudoinverse is too inexact with entries of `FLAT`."""
    try:
        return np.asarray(np.linalg.solve(radii_sum, right_side), dtype=np.float64)
    except np.linalg.LinAlgError:  # two vertices that touch
        return np.zeros_like(right_side)


def rates_over_face(normal: FloatArray, gap: float, point: Velocities, plane: Velocities) -> Rates:
    """Return the rates of a point of one body and its foot on a plane of another body.

    Args:
        normal: (3,) unit, from the point to the plane.
        gap: Distance between the point and its foot, m.
        point: The velocity of the point.
        plane: The velocity of the other body, at the foot.
    """
    normal_rate = np.cross(plane.angular.T, normal).T
    gap_rate = normal @ (plane.linear - point.linear)
    offset_rate = np.outer(normal, gap_rate) + gap * normal_rate
    return Rates(gap_rate, normal_rate, point.linear + 0.5 * offset_rate, smooth=True)
