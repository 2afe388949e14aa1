"""Contacts in closed form: a sphere on a face, a face on a half-space.

They are the commonest. What does not change while a face moves about on a plane (which of its
corners count, in which order) is worked out once for each face. Other pairs, such as a body in
several pieces or a face of which only a part is near, are left to the general search. So are
spheres where the loops are not compiled: it finds the same of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from graspless_pin.compiled import core
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.bodies.polytopes import Polytope
from graspless_pin.geometry.contact.broad_phase import Solids, near_solids
from graspless_pin.geometry.contact.convex_sets import Plane
from graspless_pin.geometry.contact.corners import corner_groups, group_means, hull_order
from graspless_pin.problem.checks import FloatArray

_ORIGIN = np.eye(4)
_MOST_FACES = 1024  # that are kept; a fine mesh that rolls about has more


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
    if not bodies.shapes.names:
        return [], [], []

    def face_of(p: int, direction: FloatArray) -> _Face | None:
        solid = solids.sets[p]
        if not isinstance(solid, Polytope):
            return None
        return _face(solid, solid.farthest(direction), limits)

    if core is not None:
        places, positions, normals, gaps, pairs, left = core.plain_contacts(
            solids.for_loops,
            pieces.poses,
            others.for_loops,
            bodies.poses,
            limits.tolerance,
            limits.max_penetration,
            face_of,
        )
        return pairs, [ContactRows(places, positions, normals, gaps)], left
    pairs = near_solids(pieces, solids, bodies, others, limits.tolerance)
    names = [bodies.shapes.names[k] for _, k in pairs]
    found, left = [], []
    for place, (p, k) in enumerate(pairs):
        plane, rows = others.sets[k], None
        if isinstance(plane, Plane) and names.count(names[place]) == 1:
            T, T_plane = pieces.poses[p], bodies.poses[k]
            normal = T_plane[:3, :3] @ plane.normal
            offset = float(normal @ T_plane[:3, 3]) + plane.offset
            face = face_of(p, -normal @ T[:3, :3])
            rows = None if face is None else _on_plane(face, T, normal, offset, place, limits)
        if rows is None:
            left.append(place)
        else:
            found.append(rows)
    return pairs, found, left


def _on_plane(
    face: _Face, T: FloatArray, normal: FloatArray, offset: float, place: int, limits: ContactLimits
) -> ContactRows | None:
    """Contacts of a face at a pose T (4, 4) with a half-space; None if not all of it is near."""
    if not limits.admit((face.corners @ T[:3].T @ normal - offset).tolist()):
        return None
    points = face.points @ T[:3].T
    heights = points @ normal - offset
    points -= 0.5 * np.outer(heights, normal)
    return ContactRows(
        [place] * len(points), points, np.tile(normal, (len(points), 1)), heights.tolist()
    )


@lru_cache(maxsize=_MOST_FACES)
def _face(solid: Polytope, corners: tuple[int, ...], limits: ContactLimits) -> _Face | None:
    """Return the face with some corners as if flat; None for an edge, corner or rough face."""
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
    if len(groups) < len(corners):
        points += solid.heights_from(points, outward)[:, None] * outward
    return _Face(_homogeneous(around), _homogeneous(points), len(groups) == len(corners))


def _homogeneous(points: FloatArray) -> FloatArray:
    """Rows [x, y, z, 1] of points (K, 3)."""
    return np.column_stack([points, np.ones(len(points))])
