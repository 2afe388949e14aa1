"""How far a small shift of the bodies would turn the normals of their contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.contact_points import ContactArrays
from graspless_pin.geometry.contact.convex_sets import Plane, Polytope, Revolved
from graspless_pin.geometry.contact.distances import solids_of
from graspless_pin.problem.checks import FloatArray


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
        match sets[row]:
            case Revolved() as one:
                if (np.abs(local - one.center) <= one.half_extents + 2.0 * near).all():
                    return 0.0
                continue
            case Plane(normal, offset):
                normals, heights = normal[None], np.array([normal @ local - offset])
            case Polytope() as one:
                normals, heights = one.face_normals, one.face_normals @ local - one.face_offsets
        if heights.max() > 2.0 * near:
            continue
        at_hand = normals[heights > -2.0 * near]
        cosines = np.clip(at_hand @ direction, -1.0, 1.0)
        least = min(least, float(np.arccos(cosines.max(initial=-1.0))))
    return least
