"""How surfaces curve where they touch, and how the nearest points of two bodies move as they do.

Montana, The kinematics of contact and grasp, Int. J. Robotics Research 7(3), 1988. A surface is
described by the matrix of its radii of curvature in the tangent plane, the inverse of its shape
operator: zero across an edge and at a corner, where the contact point stays on the body while the
normal turns, and `FLAT` along what is flat. So corners, edges, faces and curved surfaces are one
case, and a surface that is swept by a sphere has that sphere's radius more in all directions.

Where edges or corners meet, a small shift of the bodies turns the normal at once: `normal_jumps`.

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
"""A surface is fitted to the vertices of a hull at least so far from the contact, m."""
_EDGES_AROUND = 2.0
"""A surface is fitted at least so many edges far around."""
_SAME_SURFACE = math.tan(math.radians(15.0))
"""Depth over distance of vertices whose normals differ by up to 30 degrees from the contact's."""
_LEAST_VERTICES = 6
_MOST_STEPS = 20
_SETTLED = 1e-14  # m
_SAME_NORMAL = math.cos(0.1)
_SAME_GAP = 1e-5  # m
_LEAST_RADIUS = 1e-7
"""m: where both surfaces and the gap are more pointed, the normal has no derivative."""


class Rolling(NamedTuple):
    """How M contact points move on the surfaces of object and touching bodies as these turn.

    With w the angular velocity of the object relative to the body, n the normal, R_o and R_b the
    radii of curvature, the point moves by R_o (R_o + R_b)^-1 R_b (w x n) on both surfaces where it
    sticks.

    Attributes:
        object_radii: (M, 2, 2) R_o along the contact's tangents, m.
        body_radii: (M, 2, 2) R_b, m.
    """

    object_radii: FloatArray
    body_radii: FloatArray

    @property
    def shares(self) -> FloatArray:
        """(M, 2, 2) (R_o + R_b)^-1, 1/m; its pseudoinverse where both are corners."""
        both = self.object_radii + self.body_radii
        return np.asarray(np.linalg.pinv(both, hermitian=True), dtype=np.float64)

    @property
    def moves(self) -> FloatArray:
        """(M, 2, 2) R_o (R_o + R_b)^-1 R_b, m."""
        found = self.object_radii @ self.shares @ self.body_radii
        return 0.5 * (found + found.transpose(0, 2, 1))


def radii_of_curvature(
    pieces: Sequence[CollisionBody],
    point: FloatArray,
    outward: FloatArray,
    tangents: FloatArray,
    *,
    fitted: bool = False,
) -> FloatArray:
    """Return the radii of curvature of a body's surface at a point of it.

    Args:
        pieces: The convex pieces of the body.
        point: (3,) world, m.
        outward: (3,) unit normal out of the body, world axes.
        tangents: (3, 2) along which they are asked for, world axes.
        fitted: Whether convex hulls of meshes stand for smooth surfaces: their radii are those of a
            quadric through the vertices around, where there are enough of them.

    Returns:
        (2, 2) symmetric, m.
    """
    piece = min(pieces, key=lambda one: _distance(one, point, outward))
    solid, R, t = placed_set(piece)
    local = (point - t) @ R, outward @ R, R.T @ tangents
    smooth = _of_fitted_surface(solid, *local) if fitted and is_hull(solid) else None
    return solid.radii_of_curvature(*local) if smooth is None else smooth


def is_surface_of(
    pieces: Sequence[CollisionBody], point: FloatArray, outward: FloatArray, tolerance: float
) -> bool:
    """Return whether a point with its normal is one of a body's surface, as far as a tolerance.

    Args:
        pieces: The convex pieces of the body; there may be none.
        point: (3,) world, m.
        outward: (3,) unit normal out of the body, world axes.
        tolerance: m.
    """
    return any(_distance(piece, point, outward) <= tolerance for piece in pieces)


def has_mesh(pieces: Sequence[CollisionBody]) -> bool:
    """Return whether a body has a piece that is the hull of a mesh."""
    return any(is_hull(placed_set(piece)[0]) for piece in pieces)


def _distance(piece: CollisionBody, point: FloatArray, outward: FloatArray) -> float:
    """Return how far a point is from the part of a piece that lies farthest along a direction."""
    solid, R, t = placed_set(piece)
    local, direction = (point - t) @ R, outward @ R
    if isinstance(solid, Plane):
        return abs(float(solid.faces_at(local)[1][0]))
    below = float(solid.support_values(direction[None])[0] - direction @ local)
    return max(abs(below), float(solid.faces_at(local)[1].max()))


def _of_fitted_surface(
    solid: Polytope, point: FloatArray, outward: FloatArray, tangents: FloatArray
) -> FloatArray | None:
    """Return the radii of a quadric through the vertices around; None: there are too few."""
    arms = solid.vertices - point
    nearest = int(np.einsum("vi,vi->v", arms, arms).argmin())
    around = [length for _, length in solid.edges[nearest]]
    # A vertex within a flat face has no edges.
    reach = max(FITTED_RADIUS, _EDGES_AROUND * float(np.mean(around)) if around else 0.0)
    u, depth = arms @ tangents, -arms @ outward
    beside = np.hypot(u[:, 0], u[:, 1])
    kept = (beside <= reach) & (depth <= _SAME_SURFACE * beside + AT_BORDER)
    if int(kept.sum()) < _LEAST_VERTICES:
        return None
    x, y = (u[kept] / reach).T
    terms = np.column_stack([0.5 * x * x, x * y, 0.5 * y * y, x, y, np.ones_like(x)])
    found, _, rank, _ = np.linalg.lstsq(terms, depth[kept], rcond=1e-9)
    if rank < terms.shape[1]:
        return None
    a, b, c = found[:3] / reach**2
    values, axes = np.linalg.eigh([[a, b], [b, c]])
    return axes / np.maximum(values, 1.0 / FLAT) @ axes.T


def normal_jumps(
    pieces: Sequence[CollisionBody],
    others: Sequence[CollisionBody],
    touching: ContactArrays,
    near: float,
) -> list[float]:
    """Return by how much each contact's normal turns where an edge leaves another edge.

    Where a face or a curved surface touches, the normal is its own and stays. Where edges or
    corners meet, a shift makes a face touch: the normal jumps to that of the nearest face.

    Args:
        pieces: The object's pieces.
        others: Hand links and supports.
        touching: M contacts.
        near: Faces this near to a contact's point meet there, m.

    Returns:
        M angles, rad; zero where nothing jumps.
    """
    own, theirs = PlacedBodies.of(pieces), PlacedBodies.of(others)
    by_name: dict[str, list[int]] = {}
    for index, name in enumerate(theirs.shapes.names):
        by_name.setdefault(name, []).append(index)
    jumps = []
    for one in touching:
        reach = near + abs(one.distance)
        angle = min(
            _nearest_face(own, range(len(own)), one.position, -one.normal, reach),
            _nearest_face(theirs, by_name[one.body], one.position, one.normal, reach),
        )
        jumps.append(angle if np.isfinite(angle) else 0.0)
    return jumps


def _nearest_face(
    bodies: PlacedBodies, rows: Sequence[int], point: FloatArray, outward: FloatArray, reach: float
) -> float:
    """Return the angle to the outward normal of the nearest face at a point, inf without a face."""
    sets, least = solids_of(bodies.shapes).sets, np.inf
    for row in rows:
        T = bodies.poses[row]
        local, direction = T[:3, :3].T @ (point - T[:3, 3]), T[:3, :3].T @ outward
        one = sets[row]
        if one.is_curved:
            if (np.abs(local - one.center) <= one.half_extents + 2.0 * reach).all():
                return 0.0
            continue
        normals, heights = one.faces_at(local)
        if heights.max() <= 2.0 * reach:
            cosines = np.clip(normals[heights > -2.0 * reach] @ direction, -1.0, 1.0)
            least = min(least, float(np.arccos(cosines.max(initial=-1.0))))
    return least


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
    sets = placed_set(one)[0], placed_set(other)[0]
    if isinstance(sets[1], Plane):
        if isinstance(sets[0], Plane):
            raise SceneError(f"'{one.name}' and '{other.name}' are both flat without an end")
        patch = find_patch(other, one, math.inf, math.inf)
        found = None if patch is None else patch._replace(normal=-patch.normal)
    else:
        found = find_patch(one, other, math.inf, math.inf)
    assert found is not None  # noqa: S101 - no gap is too wide
    is_rough = any(
        not isinstance(one, Plane) and one.is_curved and one.half_extents[0] > one.swept_radius
        for one in sets
    )
    return _settled(one, other, found) if is_rough and len(found.gaps) == 1 else found


def _settled(one: CollisionBody, other: CollisionBody, patch: Patch) -> Patch:
    """Return a patch of one point by Newton's method: on rims coal stops at some 1e-5 of a turn."""
    n = patch.normal
    for _ in range(_MOST_STEPS):
        features = _farthest(one, n), _farthest(other, -n)
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


def _farthest(body: CollisionBody, direction: FloatArray) -> FloatArray:
    """(K, 3) ends of what lies farthest along a direction, world, m."""
    solid, R, t = placed_set(body)
    if isinstance(solid, Plane):
        return np.zeros((3, 3))
    return solid.feature(direction @ R) @ R.T + t


def _nearest_of(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the nearest points of two points, or of a point and a segment."""
    if len(first) > 1:
        return foot_on_segment(second[0], *first), second[0]
    return first[0], second[0] if len(second) == 1 else foot_on_segment(first[0], *second)


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
        solid, T = placed_set(piece)[0], np.linalg.inv(T_world_body) @ piece.T_world_geometry
        normals, offsets = solid.flat_faces()
        for normal, offset in zip(normals @ T[:3, :3].T, offsets, strict=True):
            if normal @ along > best:
                best, found = float(normal @ along), (normal, float(offset + normal @ T[:3, 3]))
    if best < math.cos(PARALLEL_ANGLE):
        axis = found[0].round(3).tolist() if best > -1.0 else "none"
        raise ArgumentError(
            name, f"is {direction.tolist()}; no face looks that way, the nearest looks along {axis}"
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
