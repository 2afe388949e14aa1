"""Contact detection between an object and a hand or supports: points, normals, gaps."""

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
from graspless_pin.geometry.contact.merging import (
    Touch,
    is_midway,
    merge_touches,
    midsurface_points,
)
from graspless_pin.geometry.contact.patches import find_patch
from graspless_pin.geometry.contact.polygons import corner_groups, group_means, hull_order
from graspless_pin.problem.checks import FloatArray

_IDENTITY = np.eye(4)
_MOST_CACHED_FACES = 1024  # cached faces; a fine mesh that rolls has more


@dataclass(frozen=True)
class ContactLimits:
    """Tolerances of contact detection.

    Attributes:
        tolerance: Largest gap of a contact point, m.
        max_penetration: Largest overlap of a contact, m.
        max_points: Largest number of contact points of one patch, at least 3.
        merge_distance: Distance below which points of one pair of bodies are merged, m; not more
            than the tolerance.
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
    """The contact points that represent one patch.

    Attributes:
        place: The index of its pair among all near pairs.
        positions: (K, 3) world, m.
        normal: (3,) unit, into the object, world axes.
        gaps: K, m.
    """

    place: int
    positions: FloatArray
    normal: FloatArray
    gaps: list[float]


class _Face(NamedTuple):
    """A face of a polytope and its contact points when it lies on a plane.

    Attributes:
        corners: (V, 4) [x, y, z, 1] of all its vertices, geometry frame, m.
        points: (G, 4) contact points, counterclockwise seen from inside the polytope.
    """

    corners: FloatArray
    points: FloatArray


def near_and_closed_form(
    pieces: PlacedBodies, bodies: PlacedBodies, limits: ContactLimits
) -> tuple[Sequence[tuple[int, int]], list[PatchContacts], list[int]]:
    """Find the pairs that may touch, and the contacts of flat faces on half-spaces.

    Args:
        pieces: The object's pieces.
        bodies: Hand links or supports.
        limits: The tolerances.

    Returns:
        The pairs, indices of a piece and a body; the contacts; and the indices of the pairs that
        remain for the general search.
    """
    if not bodies.shapes.names:
        return [], [], []
    pairs = near_pairs(pieces, bodies, limits.tolerance)
    object_sets, other_sets = solids_of(pieces.shapes).sets, solids_of(bodies.shapes).sets
    names = [bodies.shapes.names[k] for _, k in pairs]
    contacts, remaining = [], []
    for place, (p, k) in enumerate(pairs):
        solid, plane, patch = object_sets[p], other_sets[k], None
        if (
            isinstance(plane, Plane)
            and isinstance(solid, Polytope)
            and names.count(names[place]) == 1
        ):
            T, T_plane = pieces.poses[p], bodies.poses[k]
            normal = T_plane[:3, :3] @ plane.normal
            offset = float(normal @ T_plane[:3, 3]) + plane.offset
            face = _flat_face(solid, solid.farthest_vertices(-normal @ T[:3, :3]), limits)
            patch = (
                None if face is None else _plane_contacts(face, T, normal, offset, place, limits)
            )
        if patch is None:
            remaining.append(place)
        else:
            contacts.append(patch)
    return pairs, contacts, remaining


def _plane_contacts(
    face: _Face, T: FloatArray, normal: FloatArray, offset: float, place: int, limits: ContactLimits
) -> PatchContacts | None:
    """Return contacts of a face at a pose T (4, 4) with a half-space; None if some of it is far."""
    gaps = (face.corners @ T[:3].T @ normal - offset).tolist()
    if not -limits.max_penetration <= min(gaps) <= max(gaps) <= limits.tolerance:
        return None
    points = face.points @ T[:3].T
    heights = points @ normal - offset
    points -= 0.5 * np.outer(heights, normal)
    return PatchContacts(place, points, normal, heights.tolist())


@lru_cache(maxsize=_MOST_CACHED_FACES)
def _flat_face(solid: Polytope, corners: tuple[int, ...], limits: ContactLimits) -> _Face | None:
    """Return the face with given vertices; None for an edge, a vertex or a rough face."""
    outward = solid.face_normal(corners)
    if outward is None:
        return None
    vertices = solid.vertices[list(corners)]
    order = hull_order(vertices, -outward)
    groups = corner_groups(
        vertices[order],
        -outward,
        object_first=False,
        T_second=_IDENTITY,
        T_object=_IDENTITY,
        merge_distance=limits.merge_distance,
        max_points=limits.max_points,
    )
    points = group_means(vertices[order], groups)
    if len(groups) < len(corners):
        points += solid.heights_from(points, outward)[:, None] * outward
    return _Face(_homogeneous(vertices), _homogeneous(points))


def _homogeneous(points: FloatArray) -> FloatArray:
    """Return rows [x, y, z, 1] of points (K, 3)."""
    return np.column_stack([points, np.ones(len(points))])


def contact_arrays(
    object_bodies: Sequence[CollisionBody],
    others: Sequence[CollisionBody],
    kind: BodyKind,
    limits: ContactLimits = ContactLimits(),
) -> ContactArrays:
    """Find all points at which hand links, or supports, touch the object.

    A face on a face yields the vertices of the common part, a line its two ends, a curved or
    pointed contact one point; a circular rim is replaced by the inscribed regular polygon of
    `RIM_POINTS` points. Bodies of one name are the pieces of one body: coplanar patches of them
    yield the extreme points of their union, and seams between pieces yield no contact.

    Args:
        object_bodies: The manipulated object's convex pieces.
        others: Hand links or supports.
        kind: Whether ``others`` are hand links or supports.
        limits: The tolerances.

    Returns:
        Contacts in the order of ``others``. Those of one patch share their normal and are ordered
        counterclockwise about it, from the point that is first by x, then y, then z in the object's
        geometry frame. A face that lies on a half-space has the points that it has without any gap
        or tilt, so that they do not change as it moves.

    Raises:
        ArgumentError: The object has no pieces.
        SceneError: Bodies overlap by more than ``max_penetration``, the object is a half-space, or
            a geometry is of an unsupported kind.
    """
    pieces, bodies = PlacedBodies.of(object_bodies), PlacedBodies.of(others)
    if not pieces.shapes.names:
        raise ArgumentError("object_bodies", "needs at least one piece")
    if any(isinstance(solid, Plane) for solid in solids_of(pieces.shapes).sets):
        raise SceneError(
            f"object '{pieces.shapes.names[0]}' is a half-space; only a support can be one: "
            "give the object a box, sphere, cylinder, capsule, cone or mesh"
        )
    pairs, contacts, remaining = near_and_closed_form(pieces, bodies, limits)
    if remaining:
        touches = _touches_by_body(pieces, bodies, pairs, remaining, limits)
        contacts += _patch_contacts(touches, pieces, bodies, kind, limits)
    contacts.sort(key=lambda patch: patch.place)
    names, places = bodies.shapes.names, [patch.place for patch in contacts for _ in patch.gaps]
    return ContactArrays(
        tuple([names[pairs[place][1]] for place in places]),
        (kind,) * len(places),
        np.concatenate([np.empty((0, 3)), *(patch.positions for patch in contacts)]),
        np.array([patch.normal for patch in contacts for _ in patch.gaps]).reshape(-1, 3),
        tuple([gap for patch in contacts for gap in patch.gaps]),
    )


def _touches_by_body(
    pieces: PlacedBodies,
    bodies: PlacedBodies,
    pairs: Sequence[tuple[int, int]],
    places: Sequence[int],
    limits: ContactLimits,
) -> dict[str, list[tuple[int, Touch]]]:
    """Return the touches of the pairs at given indices, with the index, by the body's name."""
    touches: dict[str, list[tuple[int, Touch]]] = {}
    object_ranks, other_ranks = solids_of(pieces.shapes).ranks, solids_of(bodies.shapes).ranks
    for place in places:
        p, k = pairs[place]
        piece, body = pieces[p], bodies[k]
        # The order of the pair does not depend on which of the two is the object, so that swapping
        # them changes only the normal's sign.
        object_first = object_ranks[p] < other_ranks[k]
        pair = (piece, body) if object_first else (body, piece)
        patch = find_patch(*pair, limits.tolerance, limits.max_penetration)
        if patch is not None:
            touch = Touch(piece, body, object_first, patch.normal, patch.points, patch.gaps)
            touches.setdefault(body.name, []).append((place, touch))
    return touches


def _patch_contacts(
    touches: Mapping[str, Sequence[tuple[int, Touch]]],
    pieces: PlacedBodies,
    bodies: PlacedBodies,
    kind: BodyKind,
    limits: ContactLimits,
) -> list[PatchContacts]:
    """Return the contacts of all touches, those of one body under the index of its first pair.

    Raises:
        StateError: Bodies overlap too deeply.
    """
    contacts: list[PatchContacts] = []
    for name, body_touches in touches.items():
        merged = [touch for _, touch in body_touches]
        if len(merged) > 1:
            own = [bodies[k] for k, other in enumerate(bodies.shapes.names) if other == name]
            merged = merge_touches(merged, pieces, own, limits.merge_distance)
        depth = -min(min(touch.gaps) for touch in merged)
        if depth > limits.max_penetration:
            raise StateError(
                StateFault.OVERLAP,
                f"{'hand link' if kind is BodyKind.HAND else 'support'} '{name}' and object "
                f"'{pieces.shapes.names[0]}' overlap by {depth * 1e3:.2f} mm, more than "
                f"max_penetration ({limits.max_penetration * 1e3:.2f} mm); move one until they "
                "touch",
            )
        for touch in merged:
            points, gaps = _points_and_gaps(touch, limits)
            contacts.append(PatchContacts(body_touches[0][0], points, touch.into_object, gaps))
    return contacts


def _points_and_gaps(touch: Touch, limits: ContactLimits) -> tuple[FloatArray, list[float]]:
    """Return the contact points (K, 3) that represent one patch, and their gaps."""
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
        return midsurface_points(touch, middles, means)
    for k, group in enumerate(groups):  # there may be a step or a slit between pieces
        if len(group) > 1 and not is_midway(touch, middles[k], means[k]):
            distances = np.linalg.norm(points[group] - middles[k], axis=1)
            nearest = group[int(distances.round(9).argmin())]
            middles[k], means[k] = points[nearest], gaps[nearest]
    return middles, means
