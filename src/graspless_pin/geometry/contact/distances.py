"""Signed distances between bodies, as coal measures them, and which of many bodies may touch.

The latter by the boxes around their convex sets, all at once.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import NDArray

from graspless_pin.caching import Derived
from graspless_pin.compiled import core
from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.collision import BodyShapes, CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.convex_sets import (
    BoundedSet,
    ConvexSet,
    Plane,
    SolidOfRevolution,
)
from graspless_pin.geometry.bodies.polytopes import Polytope
from graspless_pin.geometry.contact.patches import DISTANCE_REQUEST, convex_set
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import LinkGeometry
from graspless_pin.geometry.poses import rigid, transformed
from graspless_pin.problem.checks import FloatArray

POINT_RADIUS = 1e-6
"""m, of the sphere that stands for a point in coal."""


@dataclass(frozen=True, eq=False)
class Solids:
    """K convex sets in the frames of their geometries.

    Attributes:
        names: K names of the bodies that they are pieces of.
        sets: K sets.
        ranks: Which of two bodies comes first: half-spaces before polytopes before curved shapes,
            large before small, then by the kind of geometry; names decide between like shapes.
        centers: (K, 3) centres of boxes around them, m.
        half_extents: (K, 3) half the edge lengths of these boxes, m.
        reaches: (K,) radii of spheres around them about these centres, m.
    """

    names: tuple[str, ...]
    sets: tuple[ConvexSet, ...]
    ranks: tuple[tuple[int, float, str, str], ...]
    centers: FloatArray
    half_extents: FloatArray
    reaches: FloatArray

    @cached_property
    def for_loops(self) -> Any:
        """The same sets as the compiled loops take them."""
        faces = [
            np.column_stack([one.face_normals, one.face_offsets])
            if isinstance(one, Polytope)
            else np.empty((0, 4))
            for one in self.sets
        ]
        planes = [
            [*one.normal, one.offset] if isinstance(one, Plane) else [0.0] * 4 for one in self.sets
        ]
        kinds = [
            core.PLANE
            if isinstance(one, Plane)
            else core.POLYTOPE
            if isinstance(one, Polytope)
            else core.BALL
            if one.is_sphere
            else core.REVOLVED
            if isinstance(one, SolidOfRevolution)
            else core.OTHER
            for one in self.sets
        ]
        return core.ConvexSets(
            kinds=kinds,
            bodies=[self.names.index(name) for name in self.names],
            centers=self.centers,
            half_extents=self.half_extents,
            reaches=self.reaches,
            planes=np.reshape(planes, (-1, 4)),
            starts=np.cumsum([0, *map(len, faces)]),
            faces=np.concatenate([np.empty((0, 4)), *faces]),
        )


@partial(Derived, most=math.inf)
def solids_of(shapes: BodyShapes) -> Solids:
    """Return the sets of some shapes, remembered for as long as the shapes live.

    Raises:
        SceneError: A geometry is of a kind that contacts cannot be found for.
        MeshError: The points of a hull all lie in one plane.
    """
    sets = tuple(
        convex_set(name, geometry)
        for name, geometry in zip(shapes.names, shapes.geometries, strict=True)
    )
    return Solids(
        shapes.names,
        sets,
        tuple(
            (
                0 if isinstance(one, Plane) else 2 if one.is_curved else 1,
                -one.radius,
                type(geometry).__name__,
                name,
            )
            for name, geometry, one in zip(shapes.names, shapes.geometries, sets, strict=True)
        ),
        np.array([one.center for one in sets]).reshape(-1, 3),
        np.array([one.half_extents for one in sets]).reshape(-1, 3),
        np.array([one.radius for one in sets]),
    )


def near_pairs(
    first: Sequence[CollisionBody], second: Sequence[CollisionBody], tolerance: float
) -> list[tuple[int, int]]:
    """Pairs whose gap may be within the tolerance; half-spaces are always near.

    A pair is far if a side of the first body's box, along that body's own axes, parts it from the
    sphere around the second, or if a side of one of the boxes along the bodies' own axes parts the
    two boxes.

    Args:
        first: P bodies, no half-spaces.
        second: K bodies.
        tolerance: m.

    Returns:
        Indices into ``first`` and ``second``, ordered by the second, then by the first.

    Raises:
        SceneError: A geometry is of a kind that contacts cannot be found for.
    """
    gaps = least_gaps(PlacedBodies.of(first), PlacedBodies.of(second))
    k, p = np.nonzero(gaps <= tolerance)
    return list(zip(p.tolist(), k.tolist(), strict=True))


def deep_pairs(
    one: PlacedBodies, two: PlacedBodies, pairs: NDArray[np.intp], depth: float
) -> NDArray[np.intp]:
    """Return those of some pairs whose bodies may overlap by more than a depth.

    The sphere around the first is compared with the sphere and the box around the second, or with
    the half-space that it is.

    Args:
        one: Bodies, no half-spaces.
        two: Bodies.
        pairs: (P, 2) indices into both.
        depth: m, not negative.
    """
    solids, others = solids_of(one.shapes), solids_of(two.shapes)
    first, second = pairs.T
    centers = box_centers(one)[first]
    offsets = centers - box_centers(two)[second]
    local = (offsets[:, None] @ two.poses[second, :3, :3])[:, 0]
    beyond = np.linalg.norm(np.maximum(np.abs(local) - others.half_extents[second], 0.0), axis=1)
    gaps = np.linalg.norm(offsets, axis=1) - others.reaches[second]
    # How deep a centre is inside the box is not known.
    gaps = np.maximum(gaps, np.where(beyond > 0.0, beyond, -np.inf))
    for index, solid in enumerate(others.sets):
        if isinstance(solid, Plane):
            T, on_it = two.poses[index], second == index
            normal = T[:3, :3] @ solid.normal
            gaps[on_it] = (centers[on_it] - T[:3, 3]) @ normal - solid.offset
    return pairs[gaps - solids.reaches[first] < -depth]


def least_gaps(one: PlacedBodies, two: PlacedBodies) -> FloatArray:
    """Return (K, P) lower bounds on the signed distances of K other bodies and P bodies, m."""
    solids, others, R = solids_of(one.shapes), solids_of(two.shapes), one.poses[:, :3, :3]
    # For each of the second's bodies and each of the first's, in the frame of the latter.
    axes = R.transpose(0, 2, 1) @ two.poses[:, None, :3, :3]
    offsets = box_centers(two)[:, None] - box_centers(one)
    local = (offsets[..., None, :] @ R)[..., 0, :]
    size = np.abs(axes)
    reach = np.minimum(
        (size @ others.half_extents[:, None, :, None])[..., 0], others.reaches[:, None, None]
    )
    along = np.abs(local) - solids.half_extents - reach
    across = np.abs((local[..., None, :] @ axes)[..., 0, :]) - others.half_extents[:, None]
    across -= (solids.half_extents[:, None] @ size)[..., 0, :]
    return np.maximum(along, across).max(axis=2)


def box_centers(bodies: PlacedBodies) -> FloatArray:
    """(K, 3) centres of the boxes around bodies, world frame, m."""
    rotated = bodies.poses[:, :3, :3] @ solids_of(bodies.shapes).centers[..., None]
    return rotated[..., 0] + bodies.poses[:, :3, 3]


@dataclass(frozen=True, eq=False)
class Separation:
    """How far two bodies are apart.

    Attributes:
        distance: Gap, negative where they overlap, m.
        normal: (3,) unit vector from the first body to the second, world axes: where the second
            moves with velocity v, the distance grows by ``normal @ v``.
    """

    distance: float
    normal: FloatArray


def separation(first: CollisionBody, second: CollisionBody) -> Separation:
    """Measure the signed distance of two bodies and the direction in which it grows."""
    result = coal.DistanceResult()
    distance = coal.distance(
        first.geometry,
        _transform(first.T_world_geometry),
        second.geometry,
        _transform(second.T_world_geometry),
        DISTANCE_REQUEST,
        result,
    )
    return Separation(float(distance), np.array(result.normal))


def point_body(point: FloatArray) -> CollisionBody:
    """Return a body about a point (3,), world, m, as coal takes it: `POINT_RADIUS` wide."""
    return CollisionBody("point", coal.Sphere(POINT_RADIUS), rigid(point))


def distances_to_point(bodies: Sequence[CollisionBody], point: FloatArray) -> FloatArray:
    """Return the (K,) signed distances of K bodies to a point (3,), world, m: negative inside."""
    there = point_body(point)
    return np.array([separation(there, body).distance + POINT_RADIUS for body in bodies])


def nearest_separation(
    first: Sequence[CollisionBody], second: Sequence[CollisionBody]
) -> Separation:
    """Measure the pair of pieces, one of each of two bodies, with the smallest signed distance.

    That is the bodies' distance where they are apart. Where they overlap, at least one of them must
    move by its amount.

    Args:
        first: The pieces of the first body, at least one.
        second: Those of the second.
    """
    pairs = (separation(one, other) for one in first for other in second)
    return min(pairs, key=lambda found: found.distance)


def bounded_set(item: LinkGeometry) -> BoundedSet:
    """Return the set that a link's shape fills, in the shape's own frame.

    Raises:
        SceneError: If the shape is a half-space or of a kind that contacts cannot be found for.
    """
    solid = convex_set(item.link, item.shape)
    if isinstance(solid, Plane):
        raise SceneError(f"hand link '{item.link}' is a half-space; give it a bounded shape")
    return solid


class LinkDistances:
    """Signed distances of the shapes of some links to a fixed body, at any configuration.

    The distance to a body of several convex pieces is that to the nearest, or deepest, of them.

    It costs a fraction of making a new `Hand` for each configuration.

    Attributes:
        links: (K) link of each shape, in model order; a link with several shapes comes up again.
        shapes: (K) geometries with their poses, `LinkGeometry`.
    """

    def __init__(self, hand: Hand, links: Collection[str], pieces: PlacedBodies) -> None:
        """Take the shapes of ``links`` in ``hand``, to be measured against a body's pieces."""
        self.shapes = tuple(item for item in hand.tree.geometries if item.link in links)
        self.links = tuple(item.link for item in self.shapes)
        self._tree = hand.tree
        self._pieces = [(piece.geometry, _transform(piece.T_world_geometry)) for piece in pieces]
        self._centers, self._radii = box_centers(pieces), solids_of(pieces.shapes).reaches

    def at(self, positions: FloatArray) -> FloatArray:
        """Return the (K,) signed distances with all joints at (n,) ``positions``, m."""
        T_world_joint = self._tree.kinematics(positions).T_world_joint
        poses = [T_world_joint[item.joint] @ item.T_joint_geometry for item in self.shapes]
        return np.array([self._nearest(*one) for one in zip(self.shapes, poses, strict=True)])

    def _nearest(self, item: LinkGeometry, T: FloatArray) -> float:
        """Return the signed distance of a shape at a pose to the nearest piece."""
        there = _transform(T)
        order, least = [0], [-np.inf]
        if len(self._pieces) > 1:
            solid = bounded_set(item)
            offsets = self._centers - transformed(T, solid.center)
            gaps = np.linalg.norm(offsets, axis=1) - self._radii - solid.radius
            order, least = np.argsort(gaps).tolist(), gaps.tolist()
        nearest = np.inf
        for index in order:
            if least[index] >= nearest:
                break
            geometry, T_world_piece = self._pieces[index]
            distance = coal.distance(
                item.shape, there, geometry, T_world_piece, DISTANCE_REQUEST, coal.DistanceResult()
            )
            nearest = min(nearest, float(distance))
        return nearest


def _transform(T: FloatArray) -> Any:
    return coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3]))
