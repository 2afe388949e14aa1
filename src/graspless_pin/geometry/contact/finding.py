"""Where an object touches a hand and its supports: points, normals into the object, gaps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from graspless_pin.errors import ArgumentError, SceneError, StateError, StateFault
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.convex_sets import Plane
from graspless_pin.geometry.bodies.polytopes import Polytope
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactArrays
from graspless_pin.geometry.contact.distances import near_pairs, solids_of
from graspless_pin.geometry.contact.merging import Touch, is_on_both, merge_touches, on_surfaces
from graspless_pin.geometry.contact.patches import find_patch
from graspless_pin.geometry.contact.polygons import corner_groups, group_means, hull_order
from graspless_pin.problem.checks import FloatArray

_ORIGIN = np.eye(4)
_MOST_FACES = 1024  # that are kept; a fine mesh that rolls about has more


@dataclass(frozen=True)
class ContactLimits:
    """What counts as contact.

    Attributes:
        tolerance: Points closer than this are in contact, m.
        max_penetration: Deepest overlap that passes for contact, m.
        max_points: Largest number of points of one patch, at least 3.
        merge_distance: Points of one pair of bodies closer together than this become one, m; not
            more than the tolerance.
    """

    tolerance: float = 1e-3
    max_penetration: float = 5e-3
    max_points: int = 8
    merge_distance: float = 1e-3

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ArgumentError: One is out of range.
        """
        for name in ("tolerance", "max_penetration", "merge_distance"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ArgumentError(name, f"needs a positive length in metres, got {value!r}")
        if self.max_points < 3:
            raise ArgumentError("max_points", f"needs at least 3, got {self.max_points!r}")
        object.__setattr__(self, "merge_distance", min(self.merge_distance, self.tolerance))


class PatchContacts(NamedTuple):
    """The contacts that stand for one patch.

    Attributes:
        place: The place of its pair among all near pairs.
        positions: (K, 3) world, m.
        normal: (3,) unit, into the object, world axes.
        gaps: K, m.
    """

    place: int
    positions: FloatArray
    normal: FloatArray
    gaps: list[float]


class _Face(NamedTuple):
    """A face of a polytope and the points that stand for it where it lies on a plane.

    Attributes:
        corners: (V, 4) [x, y, z, 1] of all its corners, geometry frame, m.
        points: (G, 4) of the contact points, counterclockwise seen from inside the polytope.
    """

    corners: FloatArray
    points: FloatArray


def near_and_closed_form(
    pieces: PlacedBodies, bodies: PlacedBodies, limits: ContactLimits
) -> tuple[Sequence[tuple[int, int]], list[PatchContacts], list[int]]:
    """Find the pairs that may touch, and the contacts of faces on half-spaces.

    Args:
        pieces: The object's pieces.
        bodies: Hand links or supports.
        limits: What counts as contact.

    Returns:
        The pairs, indices of a piece and a body; the contacts; and the places of the pairs that are
        left to the general search.
    """
    if not bodies.shapes.names:
        return [], [], []
    pairs = near_pairs(pieces, bodies, limits.tolerance)
    solids, others = solids_of(pieces.shapes).sets, solids_of(bodies.shapes).sets
    names = [bodies.shapes.names[k] for _, k in pairs]
    found, remaining = [], []
    for place, (p, k) in enumerate(pairs):
        solid, plane, rows = solids[p], others[k], None
        if (
            isinstance(plane, Plane)
            and isinstance(solid, Polytope)
            and names.count(names[place]) == 1
        ):
            T, T_plane = pieces.poses[p], bodies.poses[k]
            normal = T_plane[:3, :3] @ plane.normal
            offset = float(normal @ T_plane[:3, 3]) + plane.offset
            face = _face(solid, solid.farthest_vertices(-normal @ T[:3, :3]), limits)
            rows = None if face is None else _on_plane(face, T, normal, offset, place, limits)
        if rows is None:
            remaining.append(place)
        else:
            found.append(rows)
    return pairs, found, remaining


def _on_plane(
    face: _Face, T: FloatArray, normal: FloatArray, offset: float, place: int, limits: ContactLimits
) -> PatchContacts | None:
    """Contacts of a face at a pose T (4, 4) with a half-space; None if not all of it is near."""
    gaps = (face.corners @ T[:3].T @ normal - offset).tolist()
    if not -limits.max_penetration <= min(gaps) <= max(gaps) <= limits.tolerance:
        return None
    points = face.points @ T[:3].T
    heights = points @ normal - offset
    points -= 0.5 * np.outer(heights, normal)
    return PatchContacts(place, points, normal, heights.tolist())


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
    return _Face(_homogeneous(around), _homogeneous(points))


def _homogeneous(points: FloatArray) -> FloatArray:
    """Rows [x, y, z, 1] of points (K, 3)."""
    return np.column_stack([points, np.ones(len(points))])


def contact_arrays(
    object_bodies: Sequence[CollisionBody],
    others: Sequence[CollisionBody],
    kind: BodyKind,
    limits: ContactLimits = ContactLimits(),
) -> ContactArrays:
    """Find all points at which hand links, or supports, touch the object.

    A face on a face gives the corners of the common part, a line its two ends, a curved or pointed
    touch one point; a circular rim counts as the regular polygon of `RIM_POINTS` points inscribed
    in it. Bodies of one name are the pieces of one body: what they share in one plane gives the
    extreme points of all of it, and the seams between them give nothing.

    Args:
        object_bodies: The manipulated object's convex pieces.
        others: Hand links or supports.
        kind: Which of them.
        limits: What counts as contact.

    Returns:
        Contacts in the order of ``others``. Those of one patch share their normal and run
        counterclockwise about it, from the point that comes first by x, then y, then z in the
        object's geometry frame. A face that lies on a half-space has the points that it has
        without any gap or tilt, so that they do not change as it moves.

    Raises:
        ArgumentError: The object has no pieces.
        SceneError: Bodies overlap by more than ``max_penetration``, the object is a half-space, or
            a geometry is of a kind that cannot be used.
    """
    pieces, bodies = PlacedBodies.of(object_bodies), PlacedBodies.of(others)
    if not pieces.shapes.names:
        raise ArgumentError("object_bodies", "needs at least one piece")
    if any(isinstance(one, Plane) for one in solids_of(pieces.shapes).sets):
        raise SceneError(
            f"object '{pieces.shapes.names[0]}' is a half-space; only a support can be one: "
            "give the object a box, sphere, cylinder, capsule, cone or mesh"
        )
    pairs, found, remaining = near_and_closed_form(pieces, bodies, limits)
    if remaining:
        touches = _touches(pieces, bodies, pairs, remaining, limits)
        found += _rows_of(touches, pieces, bodies, kind, limits)
    found.sort(key=lambda patch: patch.place)
    names, places = bodies.shapes.names, [patch.place for patch in found for _ in patch.gaps]
    return ContactArrays(
        tuple([names[pairs[place][1]] for place in places]),
        (kind,) * len(places),
        np.concatenate([np.empty((0, 3)), *(patch.positions for patch in found)]),
        np.array([patch.normal for patch in found for _ in patch.gaps]).reshape(-1, 3),
        tuple([gap for patch in found for gap in patch.gaps]),
    )


def _touches(
    pieces: PlacedBodies,
    bodies: PlacedBodies,
    pairs: Sequence[tuple[int, int]],
    places: Sequence[int],
    limits: ContactLimits,
) -> dict[str, list[tuple[int, Touch]]]:
    """Where the pairs at some places touch, by the body's name, with their places."""
    touches: dict[str, list[tuple[int, Touch]]] = {}
    ranks, others = solids_of(pieces.shapes).ranks, solids_of(bodies.shapes).ranks
    for place in places:
        p, k = pairs[place]
        piece, body = pieces[p], bodies[k]
        # Whichever of the two is the object, the pair is computed in the same order, so that
        # swapping them changes nothing but the normal's sign.
        object_first = ranks[p] < others[k]
        pair = (piece, body) if object_first else (body, piece)
        patch = find_patch(*pair, limits.tolerance, limits.max_penetration)
        if patch is not None:
            touch = Touch(piece, body, object_first, patch.normal, patch.points, patch.gaps)
            touches.setdefault(body.name, []).append((place, touch))
    return touches


def _rows_of(
    touches: Mapping[str, Sequence[tuple[int, Touch]]],
    pieces: PlacedBodies,
    bodies: PlacedBodies,
    kind: BodyKind,
    limits: ContactLimits,
) -> list[PatchContacts]:
    """Return the contacts that stand for what was found, all of a body at the place of its first.

    Raises:
        StateError: Bodies overlap too deeply.
    """
    found: list[PatchContacts] = []
    for name, placed in touches.items():
        merged = [touch for _, touch in placed]
        if len(merged) > 1:
            own = [bodies[k] for k, other in enumerate(bodies.shapes.names) if other == name]
            merged = merge_touches(merged, pieces, own, limits.merge_distance)
        depth = -min(min(touch.gaps) for touch in merged)
        if depth > limits.max_penetration:
            raise StateError(
                StateFault.OVERLAP,
                f"{'hand link' if kind is BodyKind.HAND else 'support'} '{name}' and object "
                f"'{pieces.shapes.names[0]}' overlap by {depth * 1e3:.2f} mm, more than the "
                f"{limits.max_penetration * 1e3:.2f} mm that pass for contact; move one until they "
                "touch",
            )
        for touch in merged:
            points, gaps = _contacts_of(touch, limits)
            found.append(PatchContacts(placed[0][0], points, touch.into_object, gaps))
    return found


def _contacts_of(touch: Touch, limits: ContactLimits) -> tuple[FloatArray, list[float]]:
    """Return the contact points (K, 3) that stand for one patch, and their gaps."""
    points, gaps = touch.points, touch.gaps
    if len(points) == 1:
        return points, gaps
    second = touch.other_piece if touch.object_first else touch.object_piece
    groups = corner_groups(
        points,
        touch.normal,
        object_first=touch.object_first,
        T_second=second.T_world_geometry,
        T_object=touch.object_piece.T_world_geometry,
        merge_distance=limits.merge_distance,
        max_points=limits.max_points,
    )
    means = [math.fsum(gaps[k] for k in group) / len(group) for group in groups]
    middles = group_means(points, groups)
    if len(groups) == len(points):
        return middles, means
    if not touch.parts:
        return on_surfaces(touch, middles, means)
    for k, group in enumerate(groups):  # between pieces there may be a step or a slit
        if len(group) > 1 and not is_on_both(touch, middles[k], means[k]):
            away = np.linalg.norm(points[group] - middles[k], axis=1)
            corner = group[int(away.round(9).argmin())]
            middles[k], means[k] = points[corner], gaps[corner]
    return middles, means
