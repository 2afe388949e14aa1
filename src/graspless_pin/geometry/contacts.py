"""Where an object touches a hand and its supports: points, normals into the object, gaps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.collision import CollisionBody
from graspless_pin.geometry.contact_patches import PatchLimits, find_patch
from graspless_pin.geometry.convex_sets import Plane, Polytope, Revolved, convex_set
from graspless_pin.geometry.polygons import first_corner
from graspless_pin.geometry.poses import invert

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
            array = np.array(getattr(self, field), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, field, array)


def find_contacts(
    object_body: CollisionBody,
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
    in it.

    Args:
        object_body: The manipulated object; not a half-space.
        hand_bodies: Hand links.
        support_bodies: Supports.
        tolerance: Points closer than this are in contact, m.
        max_penetration: Deepest overlap that passes for contact, m.
        merge_distance: Points of one pair of bodies closer together than this become one, m.
        max_points: Largest number of points for one pair of bodies, at least 3.

    Returns:
        Contacts in the order of ``hand_bodies``, then of ``support_bodies``. Those of one body
        share their normal and run counterclockwise about it, from the point that comes first by x,
        then y, then z in the object's geometry frame.

    Raises:
        ArgumentError: A limit is out of range.
        SceneError: Bodies overlap by more than ``max_penetration``, or a geometry is of a kind
            that cannot be used.
    """
    for name, value in (
        ("tolerance", tolerance),
        ("max_penetration", max_penetration),
        ("merge_distance", merge_distance),
    ):
        if not (np.isfinite(value) and value > 0.0):
            raise ArgumentError(name, f"needs a positive length in metres, got {value!r}")
    if max_points < 3:
        raise ArgumentError("max_points", f"needs at least 3, got {max_points!r}")
    own = convex_set(object_body.name, object_body.geometry)
    if isinstance(own, Plane):
        raise SceneError(
            f"object '{object_body.name}' is a half-space; only a support can be one: "
            "give the object a box, sphere, cylinder, capsule, cone or mesh"
        )
    limits = PatchLimits(tolerance, max_penetration, merge_distance, max_points)
    bodies = [(body, BodyKind.HAND) for body in hand_bodies]
    bodies += [(body, BodyKind.SUPPORT) for body in support_bodies]
    contacts: list[ContactPoint] = []
    for body, kind in _near(object_body, own, bodies, tolerance):
        found = _contacts_of_pair(object_body, body, kind, limits)
        depth = -min((contact.distance for contact in found), default=0.0)
        if depth > max_penetration:
            raise SceneError(
                f"{'hand link' if kind is BodyKind.HAND else 'support'} '{body.name}' and object "
                f"'{object_body.name}' overlap by {depth * 1e3:.2f} mm, more than the "
                f"{max_penetration * 1e3:.2f} mm that pass for contact; move one until they touch"
            )
        contacts += found
    return tuple(contacts)


def _near(
    object_body: CollisionBody,
    own: Polytope | Revolved,
    bodies: list[tuple[CollisionBody, BodyKind]],
    tolerance: float,
) -> Iterator[tuple[CollisionBody, BodyKind]]:
    """Bodies whose bounding sphere comes near the object's, half-spaces always."""
    if not bodies:
        return
    sets = [convex_set(body.name, body.geometry) for body, _ in bodies]
    poses = np.array([body.T_world_geometry for body, _ in bodies])
    centers = np.array([(0.0, 0.0, 0.0) if isinstance(s, Plane) else s.center for s in sets])
    radii = np.array([np.inf if isinstance(s, Plane) else s.radius for s in sets])
    T = object_body.T_world_geometry
    centers = np.einsum("kij,kj->ki", poses[:, :3, :3], centers) + poses[:, :3, 3]
    distances = np.linalg.norm(centers - (T[:3, :3] @ own.center + T[:3, 3]), axis=1)
    for k in np.flatnonzero(distances <= radii + own.radius + tolerance).tolist():
        yield bodies[k]


def _contacts_of_pair(
    object_body: CollisionBody, body: CollisionBody, kind: BodyKind, limits: PatchLimits
) -> list[ContactPoint]:
    # Whichever of the two is the object, the pair is computed in the same order, so that swapping
    # them changes nothing but the normal's sign.
    object_first = _rank(object_body) < _rank(body)
    first, second = (object_body, body) if object_first else (body, object_body)
    patch = find_patch(first, second, limits)
    if patch is None:
        return []
    T_world_first = first.T_world_geometry
    R = T_world_first[:3, :3]
    points = patch.points @ R.T + T_world_first[:3, 3]
    normal = R @ patch.normal
    gaps = patch.gaps
    if object_first:
        normal, points, gaps = -normal, points[::-1], gaps[::-1]
    T_object_world = invert(object_body.T_world_geometry)
    keys = (points @ T_object_world[:3, :3].T + T_object_world[:3, 3]).tolist()
    start = first_corner(keys)
    order = [*range(start, len(keys)), *range(start)]
    return [ContactPoint(body.name, kind, points[k], normal, float(gaps[k])) for k in order]


def _rank(body: CollisionBody) -> tuple[int, float, str]:
    """Half-spaces before polytopes before curved shapes, large before small, then by name."""
    match convex_set(body.name, body.geometry):
        case Plane():
            return 0, 0.0, body.name
        case Polytope(radius=radius):
            return 1, -radius, body.name
        case Revolved() as curved:
            return 2, -curved.radius, body.name
