"""Merging the contacts of two bodies of several convex pieces, as if each were one piece.

Where two pieces meet, the border of one may appear as a contact although the surface continues in
the other; such patches are dropped. Coplanar patches are joined, and of patches at one location
only the one with the smallest gap is kept.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.convex_sets import PARALLEL_ANGLE, SAME_SURFACE, Plane
from graspless_pin.geometry.bodies.polytopes import is_hull
from graspless_pin.geometry.contact.patches import placed_set
from graspless_pin.geometry.contact.polygons import hull_order
from graspless_pin.problem.checks import FloatArray

_COS_FLAT = math.cos(math.radians(45.0))  # steeper surfaces form a step or groove, not a seam
_INTO_COSINE = -0.1  # cosine below which a direction goes into a surface
_STEP_SHARE = 0.1  # share of a piece's size by which it protrudes past another's face at a step
_ON_SURFACE = 5e-6  # m: largest distance of a mean of vertices from a surface
_STRAIGHT_OFFSET = 2e-5  # m: vertices that protrude by less are due to slightly rotated pieces
_SHARES = np.linspace(0.0, 1.0, 9)[1:-1]  # of a segment, where it is sampled
_SAME_GAP = 1e-6  # m: gaps that differ by less are the same


@dataclass(frozen=True, eq=False)
class Touch:
    """A patch in the world frame, with the pieces that make it.

    Attributes:
        object_piece: Piece of the object.
        other_piece: Piece of the other body.
        object_first: Whether the object's piece is the patch's first body.
        normal: (3,) from the first to the second, world axes.
        points: (K, 3) midway between the bodies, counterclockwise about the normal, world, m.
        gaps: K signed gaps, m.
        parts: The coplanar patches that are joined in it; empty: it is a patch of one pair.
    """

    object_piece: CollisionBody
    other_piece: CollisionBody
    object_first: bool
    normal: FloatArray
    points: FloatArray
    gaps: list[float]
    parts: tuple[Touch, ...] = ()

    @property
    def into_object(self) -> FloatArray:
        """(3,) unit normal into the object."""
        return -self.normal if self.object_first else self.normal


def merge_touches(
    touches: Sequence[Touch],
    object_pieces: Sequence[CollisionBody],
    other_pieces: Sequence[CollisionBody],
    merge_distance: float,
) -> list[Touch]:
    """Merge the patches that the pieces of two bodies yield.

    Args:
        touches: All patches between the two bodies.
        object_pieces: All pieces of the object.
        other_pieces: All pieces of the other body.
        merge_distance: Distance below which points are merged, m.

    Returns:
        The remaining patches, with extreme points only.
    """
    without_seams = [t for t in touches if not _is_seam(t, object_pieces, other_pieces)]
    merged = [
        group[0] if len(group) == 1 else _joined_patch(group, merge_distance)
        for group in _coplanar_groups(without_seams or touches)
    ]
    kept: list[Touch] = []
    for touch in sorted(merged, key=lambda t: min(t.gaps)):
        if not any(
            _is_duplicate(touch, kept_touch, merge_distance)
            or (
                touch.other_piece is kept_touch.other_piece
                and _continues_to(touch, kept_touch, object_pieces, 0.5)
            )
            or (
                touch.object_piece is kept_touch.object_piece
                and _continues_to(touch, kept_touch, other_pieces, -0.5)
            )
            for kept_touch in kept
        ):
            kept.append(touch)
    return [touch for touch in merged if touch in kept]


def midsurface_points(
    touch: Touch, points: FloatArray, gaps: Sequence[float]
) -> tuple[FloatArray, list[float]]:
    """Move points between two bodies to the middle between their surfaces.

    Only hulls may have surfaces that are not flat where they touch.

    Args:
        touch: The touch.
        points: (K, 3) inside its patch, world, m.
        gaps: K gaps of flat surfaces at these points, m.

    Returns:
        The points (K, 3) and their gaps.
    """
    into_object, half = touch.into_object, 0.5 * np.array(gaps)
    sides = []
    for piece, direction in ((touch.other_piece, into_object), (touch.object_piece, -into_object)):
        solid, R, t = placed_set(piece)
        if is_hull(solid):
            sides.append(solid.heights_from((points - t) @ R, direction @ R))
        else:
            sides.append(-half)
    low, high = sides[0], -sides[1]
    return points + (0.5 * (low + high))[:, None] * into_object, (high - low).tolist()


def is_midway(touch: Touch, point: FloatArray, gap: float) -> bool:
    """Return whether a point (3,) of a joined patch is midway between the bodies' surfaces."""
    half = 0.5 * gap * touch.into_object
    sides = (
        ({part.object_piece for part in touch.parts}, point + half),
        ({part.other_piece for part in touch.parts}, point - half),
    )
    return all(
        abs(min(_height_over(piece, midpoint) for piece in pieces)) <= _ON_SURFACE
        for pieces, midpoint in sides
    )


def _is_seam(
    touch: Touch, object_pieces: Sequence[CollisionBody], other_pieces: Sequence[CollisionBody]
) -> bool:
    """Return whether another piece of either body continues its surface at the patch."""
    middle, half = touch.points.mean(axis=0), 0.5 * math.fsum(touch.gaps) / len(touch.gaps)
    inward = touch.into_object
    return any(
        _rules_out_contact(piece, touch.object_piece, middle + half * inward, -inward)
        for piece in object_pieces
        if piece is not touch.object_piece
    ) or any(
        _rules_out_contact(piece, touch.other_piece, middle - half * inward, inward)
        for piece in other_pieces
        if piece is not touch.other_piece
    )


def _rules_out_contact(
    piece: CollisionBody, own: CollisionBody, point: FloatArray, outward: FloatArray
) -> bool:
    """Return whether another piece of a body rules out a point of one piece as a contact point.

    It does if the point lies inside the other piece, if the direction leads into that piece, or if
    the piece's surface passes through the point and rises along the direction: then the bodies are
    nearer elsewhere. At a step or groove between the pieces, both have contacts of their own.

    Args:
        piece: The other piece.
        own: The piece that the point belongs to.
        point: (3,) world frame, m.
        outward: (3,) unit vector out of the body, world axes.
    """
    solid, R, t = placed_set(piece)
    local, direction = (point - t) @ R, outward @ R
    normals, heights = solid.faces_at(local)
    highest = float(heights.max())
    if highest > SAME_SURFACE:
        return False
    if highest < -SAME_SURFACE:
        return True
    near_normals = normals[heights >= -SAME_SURFACE]
    cosines = near_normals @ direction
    k = int(cosines.argmax())
    if cosines[k] < _INTO_COSINE:
        return True
    if not solid.has_higher_points(local, direction):
        return False
    return cosines[k] >= _COS_FLAT or not _protrudes_through(own, point, R @ near_normals[k])


def _protrudes_through(piece: CollisionBody, point: FloatArray, normal: FloatArray) -> bool:
    """Return whether a piece protrudes through a plane, and so forms a step with what is behind."""
    solid, R, t = placed_set(piece)
    if isinstance(solid, Plane):
        return True
    protrusion = float(solid.support_values((normal @ R)[None])[0] - normal @ (point - t))
    return protrusion > _STEP_SHARE * solid.radius


def _coplanar_groups(touches: Sequence[Touch]) -> list[list[Touch]]:
    """Group patches by plane, in their order; the first of each group has the smallest gap."""
    groups: list[list[Touch]] = []
    order = {id(touch): k for k, touch in enumerate(touches)}
    for touch in sorted(touches, key=lambda t: min(t.gaps)):
        for group in groups:
            if _is_coplanar(touch, group[0]):
                group.append(touch)
                break
        else:
            groups.append([touch])
    return sorted(groups, key=lambda group: min(order[id(touch)] for touch in group))


def _is_coplanar(touch: Touch, seed: Touch) -> bool:
    if touch.into_object @ seed.into_object < math.cos(2.0 * PARALLEL_ANGLE):
        return False
    arms = touch.points - seed.points.mean(axis=0)
    reach = SAME_SURFACE + 2.0 * PARALLEL_ANGLE * float(np.linalg.norm(arms, axis=1).max())
    return bool((np.abs(arms @ seed.normal) <= reach).all())


def _joined_patch(group: Sequence[Touch], merge_distance: float) -> Touch:
    """Join coplanar patches, without the points at which the bodies diverge.

    There the gap grows by more than `PARALLEL_ANGLE` from every nearer point. A patch of one point
    is dropped if there is a nearer point within the merge distance.
    """
    seed = group[0]
    points = np.concatenate([touch.points for touch in group])
    gaps = np.concatenate([touch.gaps for touch in group])
    is_single = np.array([len(touch.points) == 1 for touch in group for _ in touch.points])
    kept = np.zeros(len(points), dtype=bool)
    for k in np.argsort(gaps, kind="stable").tolist():
        distances = np.linalg.norm(points[kept] - points[k], axis=1)
        rises = gaps[k] - gaps[kept] - PARALLEL_ANGLE * distances
        least_distance = merge_distance if is_single[k] else 0.0
        kept[k] = not kept.any() or (rises.min() <= _SAME_GAP and distances.min() >= least_distance)
    points, gaps = points[kept], gaps[kept]
    order = hull_order(points, seed.normal, _STRAIGHT_OFFSET)
    return replace(seed, points=points[order], gaps=gaps[order].tolist(), parts=tuple(group))


def _is_duplicate(touch: Touch, other: Touch, merge_distance: float) -> bool:
    """Return whether all points of a patch are points of another with about the same normal."""
    if touch.into_object @ other.into_object < _COS_FLAT:
        return False
    distances = np.linalg.norm(touch.points[:, None] - other.points, axis=2)
    return bool((distances.min(axis=1) < merge_distance).all())


def _continues_to(
    touch: Touch, nearer: Touch, pieces: Sequence[CollisionBody], side: float
) -> bool:
    """Return whether a body continues from a single point to a nearer touch of the same piece.

    The distance from a convex piece is convex along a straight line, so that the point is not a
    minimum of it: it is at the border of a piece where the body's surface continues.

    Args:
        touch: The touch of a single point.
        nearer: A touch with a smaller gap.
        pieces: All pieces of the body.
        side: Location of its surface, in gaps from the middle into the object.
    """
    if len(touch.points) > 1:
        return False
    arms = nearer.points - touch.points[0]
    lengths = np.linalg.norm(arms, axis=1)
    k = int(lengths.argmin())
    if touch.gaps[0] - nearer.gaps[k] <= PARALLEL_ANGLE * lengths[k]:
        return False
    start = touch.points[0] + side * touch.gaps[0] * touch.into_object
    end = nearer.points[k] + side * nearer.gaps[k] * nearer.into_object
    return all(
        any(_height_over(piece, start + share * (end - start)) <= SAME_SURFACE for piece in pieces)
        for share in _SHARES
    )


def _height_over(piece: CollisionBody, point: FloatArray) -> float:
    """Return the height (at most the distance) of a point over a piece, negative inside, m."""
    solid, R, t = placed_set(piece)
    return float(solid.faces_at((point - t) @ R)[1].max())
