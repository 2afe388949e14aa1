"""Where an object touches a hand and its supports: points, normals into the object, gaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.contact.broad_phase import near_pairs
from graspless_pin.geometry.contact.convex_sets import Plane, Polytope, convex_set
from graspless_pin.geometry.contact.merging import Touch, merge_touches
from graspless_pin.geometry.contact.patches import find_patch, plane_basis
from graspless_pin.geometry.contact.polygons import first_corner, reduce_polygon

Array = NDArray[np.float64]


class BodyKind(Enum):
    """What touches the object."""

    HAND = "hand"
    SUPPORT = "support"


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One point at which something touches the object.

    Attributes:
        body: Name of the hand link or support.
        kind: Which of the two it is.
        position: (3,) read-only point midway between the two surfaces, world frame, m.
        normal: (3,) read-only unit vector into the object, world axes.
        distance: Gap between the surfaces along the normal, negative where they overlap, m.
    """

    body: str
    kind: BodyKind
    position: Array
    normal: Array
    distance: float

    def __post_init__(self) -> None:
        """Make the arrays read-only copies."""
        for field in ("position", "normal"):
            array = getattr(self, field)
            if not isinstance(array, np.ndarray) or array.flags.writeable:
                array = np.array(array, dtype=float)
                array.setflags(write=False)
                object.__setattr__(self, field, array)


def find_contacts(
    object_body: CollisionBody | Sequence[CollisionBody],
    hand_bodies: Sequence[CollisionBody],
    support_bodies: Sequence[CollisionBody],
    *,
    tolerance: float = 1e-3,
    max_penetration: float = 5e-3,
    merge_distance: float = 1e-3,
    max_points: int = 8,
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
    for name, value in (
        ("tolerance", tolerance),
        ("max_penetration", max_penetration),
        ("merge_distance", merge_distance),
    ):
        if not (math.isfinite(value) and value > 0.0):
            raise ArgumentError(name, f"needs a positive length in metres, got {value!r}")
    if max_points < 3:
        raise ArgumentError("max_points", f"needs at least 3, got {max_points!r}")
    pieces = [object_body] if isinstance(object_body, CollisionBody) else list(object_body)
    if not pieces:
        raise ArgumentError("object_body", "needs at least one piece")
    for piece in pieces:
        if isinstance(convex_set(piece.name, piece.geometry), Plane):
            raise SceneError(
                f"object '{piece.name}' is a half-space; only a support can be one: "
                "give the object a box, sphere, cylinder, capsule, cone or mesh"
            )
    others = [*hand_bodies, *support_bodies]
    touches: dict[tuple[BodyKind, str], list[Touch]] = {}
    for p, k in near_pairs(pieces, others, tolerance):
        touch = _touch(pieces[p], others[k], tolerance, max_penetration)
        if touch is not None:
            kind = BodyKind.HAND if k < len(hand_bodies) else BodyKind.SUPPORT
            touches.setdefault((kind, others[k].name), []).append(touch)
    contacts: list[ContactPoint] = []
    for (kind, name), found in touches.items():
        bodies = hand_bodies if kind is BodyKind.HAND else support_bodies
        merged = found
        if len(found) > 1:
            own = [body for body in bodies if body.name == name]
            merged = merge_touches(found, pieces, own, merge_distance)
        depth = -min([min(touch.gaps.tolist()) for touch in merged])
        if depth > max_penetration:
            raise SceneError(
                f"{'hand link' if kind is BodyKind.HAND else 'support'} '{name}' and object "
                f"'{pieces[0].name}' overlap by {depth * 1e3:.2f} mm, more than the "
                f"{max_penetration * 1e3:.2f} mm that pass for contact; move one until they touch"
            )
        for touch in merged:
            contacts += _contacts_of(touch, kind, merge_distance, max_points)
    return tuple(contacts)


def _touch(
    object_piece: CollisionBody,
    other_piece: CollisionBody,
    tolerance: float,
    max_penetration: float,
) -> Touch | None:
    # Whichever of the two is the object, the pair is computed in the same order, so that swapping
    # them changes nothing but the normal's sign.
    object_first = _rank(object_piece) < _rank(other_piece)
    first, second = (object_piece, other_piece) if object_first else (other_piece, object_piece)
    T_first, T_second = first.T_world_geometry, second.T_world_geometry
    R, t = T_first[:3, :3], T_first[:3, 3]
    patch = find_patch(
        first,
        second,
        R.T @ T_second[:3, :3],
        (T_second[:3, 3] - t) @ R,
        tolerance,
        max_penetration,
    )
    if patch is None:
        return None
    points = patch.points @ R.T + t
    return Touch(object_piece, other_piece, object_first, R @ patch.normal, points, patch.gaps)


def _contacts_of(
    touch: Touch, kind: BodyKind, merge_distance: float, max_points: int
) -> list[ContactPoint]:
    """The contact points that stand for one patch."""
    points, gaps, order = touch.points, touch.gaps, [0]
    if len(points) > 1:
        second = touch.other_piece if touch.object_first else touch.object_piece
        around = _from_first_corner(points, second)
        flat = (points[around] @ plane_basis(touch.normal).T).tolist()
        groups = [
            [around[k] for k in group]
            for group in reduce_polygon([(u, v) for u, v in flat], merge_distance, max_points)
        ]
        if len(groups) < len(points):
            points = np.array([points[group].mean(axis=0) for group in groups])
            gaps = np.array([gaps[group].mean() for group in groups])
        else:
            points, gaps = points[around], gaps[around]
        if touch.object_first:
            points, gaps = points[::-1], gaps[::-1]
        order = list(range(len(points)))
        if touch.object_first or len(groups) < len(around):
            order = _from_first_corner(points, touch.object_piece)
    normal = touch.into_object
    points = np.array(points)
    for array in (normal, points):
        array.setflags(write=False)
    name, heights = touch.other_piece.name, gaps.tolist()
    return [ContactPoint(name, kind, points[k], normal, heights[k]) for k in order]


def _from_first_corner(points: Array, body: CollisionBody) -> list[int]:
    """Order of world points (K, 3) from the one that comes first in a body's geometry frame."""
    T = body.T_world_geometry
    start = first_corner(((points - T[:3, 3]) @ T[:3, :3]).tolist())
    return [*range(start, len(points)), *range(start)]


def _rank(body: CollisionBody) -> tuple[int, float, str]:
    """Half-spaces before polytopes before curved shapes, large before small, then by name."""
    solid = convex_set(body.name, body.geometry)
    if isinstance(solid, Plane):
        return 0, 0.0, body.name
    return (1 if isinstance(solid, Polytope) else 2), -solid.radius, body.name
