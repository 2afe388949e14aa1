"""Contacts in closed form: a sphere on a face, a face on a half-space.

They are the commonest. All spheres near one piece of the object are looked at together, and
what does not change while a face moves about on a plane (which of its corners count, in which
order) is worked out once for each face. Other pairs, such as a body in several pieces or
a face of which only a part is near, are left to the general search.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from graspless_pin.compiled import contact_search
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.bodies.polytopes import Polytope
from graspless_pin.geometry.contact.broad_phase import near_solids
from graspless_pin.geometry.contact.convex_sets import Plane
from graspless_pin.geometry.contact.corners import corner_groups, group_means, hull_order
from graspless_pin.geometry.contact.solids import Solids
from graspless_pin.problem.checks import FloatArray

_ORIGIN = np.eye(4)
_MANY_FACES = 256  # that one polytope's are kept for; a fine mesh that rolls about has more


class ContactLimits(NamedTuple):
    """What counts as contact; see `find_contacts`."""

    tolerance: float
    max_penetration: float
    merge_distance: float
    max_points: int

    def admit(self, gaps: Sequence[float]) -> bool:
        """Return whether all of some gaps are those of contacts."""
        return -self.max_penetration <= min(gaps) and max(gaps) <= self.tolerance


class ContactRows(NamedTuple):
    """Some contacts.

    Attributes:
        places: For each, the place of its pair among all near pairs.
        positions: (M, 3) world, m.
        normals: (M, 3) unit, into the object, world axes.
        gaps: M, m.
    """

    places: list[int]
    positions: FloatArray
    normals: FloatArray
    gaps: list[float]


def joined_rows(found: Sequence[ContactRows]) -> ContactRows:
    """Put contacts into the order of their pairs."""
    if len(found) == 1:
        return found[0]
    if not found:
        return ContactRows([], np.empty((0, 3)), np.empty((0, 3)), [])
    places = [place for rows in found for place in rows.places]
    gaps = [gap for rows in found for gap in rows.gaps]
    order = sorted(range(len(places)), key=places.__getitem__)
    return ContactRows(
        [places[row] for row in order],
        np.concatenate([rows.positions for rows in found])[order],
        np.concatenate([rows.normals for rows in found])[order],
        [gaps[row] for row in order],
    )


class _Face(NamedTuple):
    """A face of a polytope and the points that stand for it where it lies on a plane.

    Attributes:
        corners: (V, 4) [x, y, z, 1] of all its corners, geometry frame, m.
        points: (G, 4) of the contact points, counterclockwise seen from inside the polytope.
        all_count: Whether the points are the corners, in whatever order.
    """

    corners: FloatArray
    points: FloatArray
    all_count: bool


def near_and_closed_form(
    pieces: PlacedBodies,
    solids: Solids,
    bodies: PlacedBodies,
    others: Solids,
    limits: ContactLimits,
) -> tuple[Sequence[tuple[int, int]], list[ContactRows], list[int]]:
    """Find the pairs that may touch, and the contacts known in closed form.

    Args:
        pieces: The object's pieces.
        solids: Their sets.
        bodies: Hand links or supports.
        others: Their sets.
        limits: What counts as contact.

    Returns:
        The pairs, indices of a piece and a body; the contacts; and the places of the pairs that are
        left to the general search, in any order.
    """
    if not bodies:
        return [], [], []
    if contact_search is None:
        pairs = near_solids(pieces, solids, bodies, others, limits.tolerance)
        return pairs, *closed_form_contacts(pieces, solids, bodies, others, pairs, limits)

    def face_of(p: int, direction: FloatArray) -> _Face | None:
        solid = solids.sets[p]
        if not isinstance(solid, Polytope):
            return None
        return _face(solid, solid.farthest(direction), limits)

    places, positions, normals, gaps, pairs, left = contact_search.plain_contacts(
        solids.for_loops,
        pieces.poses,
        others.for_loops,
        bodies.poses,
        limits.tolerance,
        limits.max_penetration,
        face_of,
    )
    return pairs, [ContactRows(places, positions, normals, gaps)], left


def closed_form_contacts(
    pieces: PlacedBodies,
    solids: Solids,
    bodies: PlacedBodies,
    others: Solids,
    pairs: Sequence[tuple[int, int]],
    limits: ContactLimits,
) -> tuple[list[ContactRows], list[int]]:
    """Find the contacts that are known in closed form.

    Args:
        pieces: The object's pieces.
        solids: Their sets.
        bodies: Hand links or supports.
        others: Their sets.
        pairs: Indices of a piece and a body that may touch.
        limits: What counts as contact.

    Returns:
        The contacts, and the places of the pairs that are left to the general search, in any order.
    """
    names = [bodies.shapes.names[k] for _, k in pairs]
    alone = len(set(names)) == len(names)
    found: list[ContactRows] = []
    left: list[int] = []
    balls: dict[int, tuple[Polytope, list[int]]] = {}
    for place, (p, k) in enumerate(pairs):
        solid, other = solids.sets[p], others.sets[k]
        if isinstance(solid, Polytope) and (alone or names.count(names[place]) == 1):
            if others.ball_radii[k] > 0.0:
                balls.setdefault(p, (solid, []))[1].append(place)
                continue
            if isinstance(other, Plane):
                face = _face_on_plane(solid, pieces.poses[p], _half_space(bodies, k, other), limits)
                if face is not None:
                    points, normals, gaps = face
                    found.append(ContactRows([place] * len(gaps), points, normals, gaps))
                    continue
        left.append(place)
    for p, (solid, places) in balls.items():
        rows = [pairs[place][1] for place in places]
        centers = bodies.poses[:, :, 3].take(rows, axis=0)
        radii = [others.ball_radii[k] for k in rows]
        T = pieces.T_body_world(p)
        found.append(_balls_on_faces(solid, T, centers, radii, places, left, limits))
    return found, left


def _balls_on_faces(
    solid: Polytope,
    T_solid_world: FloatArray,
    centers: FloatArray,
    radii: Sequence[float],
    places: Sequence[int],
    left: list[int],
    limits: ContactLimits,
) -> ContactRows:
    """Contacts of spheres over faces.

    Args:
        solid: What they may touch.
        T_solid_world: (4, 4).
        centers: (K, 4) [x, y, z, 1] of the spheres, world, m.
        radii: K radii, m.
        places: K places of their pairs.
        left: Is given the places of those that touch an edge or corner, or are in too deep.
        limits: What counts as contact.
    """
    local = centers.dot(T_solid_world[:3].T).tolist()
    inward: dict[int, list[float]] = {}  # normals by face
    touching: list[int] = []
    positions: list[float] = []
    normals: list[float] = []
    gaps: list[float] = []
    # Plain floats, as in `polygons`: there are few spheres.
    for place, (x, y, z, _), radius, (face, height, on_face) in zip(
        places, centers.tolist(), radii, solid.highest_faces(local), strict=True
    ):
        gap = height - radius
        if gap > limits.tolerance:
            continue
        if gap < -limits.max_penetration or not on_face:
            left.append(place)
            continue
        normal = inward.get(face)
        if normal is None:
            # The transpose of the inverse's rotation is the rotation.
            normal = inward[face] = (-solid.face_normals[face]).dot(T_solid_world[:3, :3]).tolist()
        u, v, w = normal
        half = 0.5 * (height + radius)
        positions += (x + half * u, y + half * v, z + half * w)
        normals += normal
        gaps.append(gap)
        touching.append(place)
    return ContactRows(
        touching, np.array(positions).reshape(-1, 3), np.array(normals).reshape(-1, 3), gaps
    )


class _HalfSpace(NamedTuple):
    """A half-space in the world.

    Attributes:
        normal: (3,) outward unit normal.
        half_normal: (3,) half of it.
        offset: Distance of the plane from the origin along the normal, m.
    """

    normal: FloatArray
    half_normal: FloatArray
    offset: float


def _half_space(bodies: PlacedBodies, k: int, plane: Plane) -> _HalfSpace:
    """Return a body that is a half-space where it is."""
    known = bodies.notes.get(k)
    if known is None:
        T = bodies.poses[k]
        normal = T[:3, :3] @ plane.normal
        offset = float(normal @ T[:3, 3]) + plane.offset
        known = bodies.notes[k] = _HalfSpace(normal, 0.5 * normal, offset)
    return known


def _face_on_plane(
    solid: Polytope, T: FloatArray, plane: _HalfSpace, limits: ContactLimits
) -> tuple[FloatArray, FloatArray, list[float]] | None:
    """Points, normals and gaps of a face all of which is near a half-space; None for others."""
    normal, half_normal, offset = plane
    face = _face(solid, solid.farthest(-normal.dot(T[:3, :3])), limits)
    if face is None:
        return None
    frame = T[:3].T
    points = face.points.dot(frame)
    heights = points.dot(normal[:, None])
    heights -= offset
    gaps = heights.ravel().tolist()
    if not limits.admit(gaps):
        return None
    if not (
        face.all_count or limits.admit((face.corners.dot(frame).dot(normal) - offset).tolist())
    ):
        return None
    points -= heights * half_normal
    normals = np.empty_like(points)
    normals[:] = normal
    return points, normals, gaps


def _face(solid: Polytope, corners: tuple[int, ...], limits: ContactLimits) -> _Face | None:
    """Return the face with some corners as if flat; None for an edge, corner or rough face."""
    key = corners, limits.merge_distance, limits.max_points
    try:
        return solid.notes[key]
    except KeyError:
        face = _laid_flat(solid, corners, limits)
    if len(solid.notes) >= _MANY_FACES:
        solid.notes.clear()
    solid.notes[key] = face
    return face


def _laid_flat(solid: Polytope, corners: tuple[int, ...], limits: ContactLimits) -> _Face | None:
    outward = solid.face_normal(corners)
    if outward is None:
        return None
    around = solid.vertices[list(corners)]
    order = hull_order(around, -outward)
    groups = corner_groups(
        around[order],
        -outward,
        object_first=False,
        T_second=_ORIGIN,
        T_object=_ORIGIN,
        merge_distance=limits.merge_distance,
        max_points=limits.max_points,
    )
    points = group_means(around[order], groups)
    return _Face(_homogeneous(around), _homogeneous(points), len(groups) == len(corners))


def _homogeneous(points: FloatArray) -> FloatArray:
    """Rows [x, y, z, 1] of points (K, 3)."""
    return np.column_stack([points, np.ones(len(points))])
