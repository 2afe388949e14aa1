"""Where an object touches a hand and its supports: points, normals into the object, gaps."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, SceneError, StateError, StateFault
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.broad_phase import near_solids
from graspless_pin.geometry.contact.merging import Touch, merge_touches
from graspless_pin.geometry.contact.patches import find_patch, plane_basis
from graspless_pin.geometry.contact.polygons import first_corner, reduce_polygon
from graspless_pin.geometry.contact.records import BodyKind, ContactArrays, ContactPoint
from graspless_pin.geometry.contact.solids import solids_of

Array = NDArray[np.float64]


_TOLERANCE = 1e-3  # m
_MAX_PENETRATION = 5e-3  # m
_MERGE_DISTANCE = 1e-3  # m
_MAX_POINTS = 8


def find_contacts(
    object_body: CollisionBody | Sequence[CollisionBody],
    hand_bodies: Sequence[CollisionBody],
    support_bodies: Sequence[CollisionBody],
    *,
    tolerance: float = _TOLERANCE,
    max_penetration: float = _MAX_PENETRATION,
    merge_distance: float = _MERGE_DISTANCE,
    max_points: int = _MAX_POINTS,
) -> tuple[ContactPoint, ...]:
    """Find all points at which hand and supports touch the object.

    A face on a face gives the corners of the common part, a line its two ends, a curved or pointed
    touch one point; a circular rim counts as the regular polygon of `RIM_POINTS` points inscribed
    in it. Bodies of one name are the pieces of one body: what they share in one plane gives the
    extreme points of all of it, and the seams between them give nothing.

    Args:
        object_body: The manipulated object, or its convex pieces; not a half-space.
        hand_bodies: Hand links.
        support_bodies: Supports.
        tolerance: Points closer than this are in contact, m.
        max_penetration: Deepest overlap that passes for contact, m.
        merge_distance: Points of one pair of bodies closer together than this become one, m.
        max_points: Largest number of points of one patch, at least 3.

    Returns:
        Contacts in the order of ``hand_bodies``, then of ``support_bodies``. Those of one patch
        share their normal and run counterclockwise about it, from the point that comes first by x,
        then y, then z in the object's geometry frame.

    Raises:
        ArgumentError: A limit is out of range, or the object has no pieces.
        SceneError: Bodies overlap by more than ``max_penetration``, or a geometry is of a kind
            that cannot be used.
    """
    pieces = [object_body] if isinstance(object_body, CollisionBody) else object_body
    limits = (tolerance, max_penetration, merge_distance, max_points)
    on_hand = contact_arrays(pieces, hand_bodies, BodyKind.HAND, *limits)
    on_supports = contact_arrays(pieces, support_bodies, BodyKind.SUPPORT, *limits)
    return tuple(on_hand.followed_by(on_supports))


def contact_arrays(
    object_bodies: Sequence[CollisionBody],
    others: Sequence[CollisionBody],
    kind: BodyKind,
    tolerance: float = _TOLERANCE,
    max_penetration: float = _MAX_PENETRATION,
    merge_distance: float = _MERGE_DISTANCE,
    max_points: int = _MAX_POINTS,
) -> ContactArrays:
    """Find where the object touches hand links, or where it touches supports.

    Args:
        object_bodies: The object's convex pieces.
        others: Hand links or supports.
        kind: Which of them.
        tolerance: As in `find_contacts`.
        max_penetration: As in `find_contacts`.
        merge_distance: As in `find_contacts`.
        max_points: As in `find_contacts`.

    Raises:
        ArgumentError: As `find_contacts`.
        SceneError: As `find_contacts`.
    """
    if not (
        0.0 < tolerance < math.inf
        and 0.0 < max_penetration < math.inf
        and 0.0 < merge_distance < math.inf
        and max_points >= 3
    ):
        _refuse_limits(tolerance, max_penetration, merge_distance, max_points)
    if not object_bodies:
        raise ArgumentError("object_body", "needs at least one piece")
    pieces, bodies = PlacedBodies.of(object_bodies), PlacedBodies.of(others)
    solids, others_solids = solids_of(pieces.shapes), solids_of(bodies.shapes)
    if solids.has_plane:
        raise SceneError(
            f"object '{pieces.shapes.names[0]}' is a half-space; only a support can be one: "
            "give the object a box, sphere, cylinder, capsule, cone or mesh"
        )
    touches: dict[str, list[Touch]] = {}
    near = near_solids(pieces, solids, bodies, others_solids, tolerance) if len(bodies) else []
    for p, k in near:
        piece, body = pieces[p], bodies[k]
        mine, other = (piece, solids.sets[p]), (body, others_solids.sets[k])
        # Whichever of the two is the object, the pair is computed in the same order, so that
        # swapping them changes nothing but the normal's sign.
        object_first = solids.ranks[p] < others_solids.ranks[k]
        pair = (*mine, *other) if object_first else (*other, *mine)
        patch = find_patch(*pair, tolerance, max_penetration)
        if patch is not None:
            touch = Touch(piece, body, object_first, patch.normal, patch.points, patch.gaps)
            touches.setdefault(body.name, []).append(touch)
    names: list[str] = []
    positions: list[Array] = []
    normals: list[Array] = []
    distances: list[float] = []
    for name, found in touches.items():
        merged = found
        if len(found) > 1:
            own = [bodies[k] for k, other in enumerate(bodies.shapes.names) if other == name]
            merged = merge_touches(found, pieces, own, merge_distance)
        for touch in merged:
            if min(touch.gaps) < -max_penetration:
                depth = -min(min(one.gaps) for one in merged)
                raise StateError(
                    StateFault.OVERLAP,
                    f"{'hand link' if kind is BodyKind.HAND else 'support'} '{name}' and object "
                    f"'{pieces.shapes.names[0]}' overlap by {depth * 1e3:.2f} mm, more than the "
                    f"{max_penetration * 1e3:.2f} mm that pass for contact; move one until they "
                    "touch",
                )
            points, gaps = _contacts_of(touch, merge_distance, max_points)
            names += [name] * len(gaps)
            positions.append(points)
            normals += [touch.into_object.tolist()] * len(gaps)
            distances += gaps
    return ContactArrays(
        tuple(names),
        (kind,) * len(names),
        np.concatenate(positions) if positions else np.empty((0, 3)),
        np.array(normals).reshape(-1, 3),
        tuple(distances),
    )


def _refuse_limits(
    tolerance: float, max_penetration: float, merge_distance: float, max_points: int
) -> None:
    """Say which limit is out of range."""
    for name, value in (
        ("tolerance", tolerance),
        ("max_penetration", max_penetration),
        ("merge_distance", merge_distance),
    ):
        if not 0.0 < value < math.inf:
            raise ArgumentError(name, f"needs a positive length in metres, got {value!r}")
    raise ArgumentError("max_points", f"needs at least 3, got {max_points!r}")


def _contacts_of(touch: Touch, merge_distance: float, max_points: int) -> tuple[Array, list[float]]:
    """The contact points (K, 3) that stand for one patch, and their gaps."""
    points, heights = touch.points, touch.gaps
    if len(points) == 1:
        return points, heights
    second = touch.other_piece if touch.object_first else touch.object_piece
    around = _from_first_corner(points, second)
    flat = (points[around] @ plane_basis(touch.normal).T).tolist()
    groups = reduce_polygon([(u, v) for u, v in flat], merge_distance, max_points)
    reduced = len(groups) < len(around)
    if reduced:
        members = [[around[k] for k in group] for group in groups]
        points = np.array([points[group].mean(axis=0) for group in members])
        heights = [math.fsum(heights[k] for k in group) / len(group) for group in members]
        around = list(range(len(points)))
    if touch.object_first:
        around.reverse()
    if touch.object_first or reduced:
        turn = _from_first_corner(points[around], touch.object_piece)
        around = [around[k] for k in turn]
    return points[around], [heights[k] for k in around]


def _from_first_corner(points: Array, body: CollisionBody) -> list[int]:
    """Order of world points (K, 3) from the one that comes first in a body's geometry frame."""
    T = body.T_world_geometry
    start = first_corner(((points - T[:3, 3]) @ T[:3, :3]).tolist())
    return [*range(start, len(points)), *range(start)]
