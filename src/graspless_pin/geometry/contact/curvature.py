"""How surfaces curve where they touch, and where the contact point goes as bodies roll.

Montana, The kinematics of contact and grasp, Int. J. Robotics Research 7(3), 1988. A surface is
described by the matrix of its radii of curvature in the tangent plane, the inverse of its shape
operator: zero across an edge and at a corner, where the contact point stays on the body while the
normal turns, and `FLAT` along what is flat. So corners, edges, faces and curved surfaces are one
case, and a surface that is swept by a sphere has that sphere's radius more in all directions.

Where edges or corners meet, a small shift of the bodies turns the normal at once: `normal_jumps`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from graspless_pin.geometry.bodies.collision import (
    PARALLEL_ANGLE,
    CollisionBody,
    Cuboid,
    PlacedBodies,
    Polytope,
)
from graspless_pin.geometry.contact.contact_points import ContactArrays
from graspless_pin.geometry.contact.convex_sets import (
    ConvexSet,
    Plane,
    Revolved,
    convex_set,
)
from graspless_pin.geometry.contact.distances import solids_of
from graspless_pin.problem.checks import FloatArray

FLAT = 1e6
"""Radius of curvature of what is flat, m."""
FITTED_RADIUS = 2e-3
"""A surface is fitted to the vertices of a hull at least so far from the contact, m."""
_AT_BORDER = 1e-6
_EDGES_AROUND = 2.0
"""A surface is fitted at least so many edges far around."""
_SAME_SURFACE = math.tan(math.radians(15.0))
"""Depth over distance of vertices whose normals differ by up to 30 degrees from the contact's."""
_LEAST_VERTICES = 6


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
    R, t = piece.T_world_geometry[:3, :3], piece.T_world_geometry[:3, 3]
    solid = convex_set(piece.name, piece.geometry)
    local = (point - t) @ R, outward @ R, R.T @ tangents
    if isinstance(solid, Plane):
        return FLAT * np.eye(2)
    if isinstance(solid, Revolved):
        return _of_revolved(solid, *local)
    smooth = _of_fitted_surface(solid, *local) if fitted and _is_mesh(solid) else None
    return _of_polytope(solid, *local) if smooth is None else smooth


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
    return any(_is_mesh(convex_set(piece.name, piece.geometry)) for piece in pieces)


def _is_mesh(solid: ConvexSet) -> bool:
    return isinstance(solid, Polytope) and not isinstance(solid, Cuboid)


def _distance(piece: CollisionBody, point: FloatArray, outward: FloatArray) -> float:
    """Return how far a point is from the part of a piece that lies farthest along a direction."""
    R, t = piece.T_world_geometry[:3, :3], piece.T_world_geometry[:3, 3]
    solid = convex_set(piece.name, piece.geometry)
    local, direction = (point - t) @ R, outward @ R
    if isinstance(solid, Plane):
        return abs(float(solid.faces_at(local)[1][0]))
    below = float(solid.support_values(direction[None])[0] - direction @ local)
    return max(abs(below), float(solid.faces_at(local)[1].max()))


def _of_revolved(
    solid: Revolved, point: FloatArray, outward: FloatArray, tangents: FloatArray
) -> FloatArray:
    """Return the radii of two discs' hull, and those of the sphere that sweeps it."""
    swept = solid.swept_radius * np.eye(2)
    across = math.hypot(outward[0], outward[1])
    feature = solid.feature(outward)
    if across <= PARALLEL_ANGLE:
        disc = solid.top_radius if outward[2] > 0.0 else solid.bottom_radius
        at_rim = math.hypot(point[0], point[1]) > disc - _AT_BORDER
        return swept if at_rim else swept + FLAT * np.eye(2)
    azimuth = np.array([-outward[1], outward[0], 0.0]) / across @ tangents
    disc = math.hypot(point[0], point[1]) - solid.swept_radius * across
    radii = max(disc, 0.0) / across * np.outer(azimuth, azimuth)
    if len(feature) == 2:
        line = feature[1] - feature[0]
        radii = radii + _along_edge(feature[0], feature[1], point) * _outer(line @ tangents)
    return radii + swept


def _of_polytope(
    solid: Polytope, point: FloatArray, outward: FloatArray, tangents: FloatArray
) -> FloatArray:
    """Return the radii of a face, edge or corner: `FLAT` along what is flat, else zero."""
    corners = solid.farthest(outward)
    if len(corners) == 1:
        return np.zeros((2, 2))
    if len(corners) == 2:
        first, second = solid.vertices[list(corners)]
        return _along_edge(first, second, point) * _outer((second - first) @ tangents)
    # A point on the border of a face may be where a corner or an edge of it rests.
    inside = set(corners)
    for first in corners:
        for second, _ in solid.edges[first]:
            if first < second and second in inside:
                ends = solid.vertices[first], solid.vertices[second]
                if _off_line(*ends, point) < _AT_BORDER:
                    return _along_edge(*ends, point) * _outer((ends[1] - ends[0]) @ tangents)
    return FLAT * np.eye(2)


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
    kept = (beside <= reach) & (depth <= _SAME_SURFACE * beside + _AT_BORDER)
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


def _outer(direction: FloatArray) -> FloatArray:
    return np.outer(direction, direction) / float(direction @ direction)


def _along_edge(first: FloatArray, second: FloatArray, point: FloatArray) -> float:
    """Return the radius along an edge at a point of it: `FLAT`, and zero at its ends."""
    away = min(float(np.linalg.norm(point - first)), float(np.linalg.norm(point - second)))
    return 0.0 if away < _AT_BORDER else FLAT


def _off_line(first: FloatArray, second: FloatArray, point: FloatArray) -> float:
    """Return the distance of a point from a segment, m."""
    line = second - first
    share = float(np.clip((point - first) @ line / (line @ line), 0.0, 1.0))
    return float(np.linalg.norm(first + share * line - point))


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
        angles = [
            _nearest_face(own, range(len(own)), one.position, -one.normal, reach),
            _nearest_face(theirs, by_name[one.body], one.position, one.normal, reach),
        ]
        finite = [angle for angle in angles if np.isfinite(angle)]
        jumps.append(min(finite, default=0.0))
    return jumps


def _nearest_face(
    bodies: PlacedBodies, rows: Sequence[int], point: FloatArray, outward: FloatArray, near: float
) -> float:
    """Return the angle to the outward normal of the nearest face at a point, inf without a face."""
    sets, least = solids_of(bodies.shapes).sets, np.inf
    for row in rows:
        T = bodies.poses[row]
        local, direction = T[:3, :3].T @ (point - T[:3, 3]), T[:3, :3].T @ outward
        one = sets[row]
        if isinstance(one, Revolved):
            if (np.abs(local - one.center) <= one.half_extents + 2.0 * near).all():
                return 0.0
            continue
        normals, heights = one.faces_at(local)
        if heights.max() <= 2.0 * near:
            cosines = np.clip(normals[heights > -2.0 * near] @ direction, -1.0, 1.0)
            least = min(least, float(np.arccos(cosines.max(initial=-1.0))))
    return least
