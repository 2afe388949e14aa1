"""Signed distances between bodies, measured by coal, and the pairs of bodies that may touch.

Such pairs are found from the bounding boxes of the bodies' convex sets, in one vectorized pass.
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
"""Radius of the sphere that represents a point in coal, m."""


@dataclass(frozen=True, eq=False)
class Solids:
    """K convex sets in the frames of their geometries.

    Attributes:
        names: K names of the bodies that the sets are pieces of.
        sets: K sets.
        ranks: Sort keys that decide which of two bodies comes first: half-spaces before polytopes
            before curved shapes, large before small, then by the kind of geometry and by name.
        centers: (K, 3) centres of the bounding boxes, m.
        half_extents: (K, 3) half the edge lengths of the bounding boxes, m.
        reaches: (K,) radii of bounding spheres about these centres, m.
    """

    names: tuple[str, ...]
    sets: tuple[ConvexSet, ...]
    ranks: tuple[tuple[int, float, str, str], ...]
    centers: FloatArray
    half_extents: FloatArray
    reaches: FloatArray

    @cached_property
    def compiled_sets(self) -> Any:
        """The same sets as `compiled.core.ConvexSets`."""
        faces = [
            np.column_stack([solid.face_normals, solid.face_offsets])
            if isinstance(solid, Polytope)
            else np.empty((0, 4))
            for solid in self.sets
        ]
        planes = [
            [*solid.normal, solid.offset] if isinstance(solid, Plane) else [0.0] * 4
            for solid in self.sets
        ]
        kinds = [
            core.PLANE
            if isinstance(solid, Plane)
            else core.POLYTOPE
            if isinstance(solid, Polytope)
            else core.BALL
            if solid.is_sphere
            else core.REVOLVED
            if isinstance(solid, SolidOfRevolution)
            else core.OTHER
            for solid in self.sets
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
    """Return the convex sets of shapes, cached while the shapes live.

    Raises:
        SceneError: A geometry is of a kind that contact detection does not support.
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
                0 if isinstance(solid, Plane) else 2 if solid.is_curved else 1,
                -solid.radius,
                type(geometry).__name__,
                name,
            )
            for name, geometry, solid in zip(shapes.names, shapes.geometries, sets, strict=True)
        ),
        np.array([solid.center for solid in sets]).reshape(-1, 3),
        np.array([solid.half_extents for solid in sets]).reshape(-1, 3),
        np.array([solid.radius for solid in sets]),
    )


def near_pairs(
    first: Sequence[CollisionBody], second: Sequence[CollisionBody], tolerance: float
) -> list[tuple[int, int]]:
    """Return the pairs whose gap may be within the tolerance; half-spaces are always near.

    A pair is far if a face of the first body's box, aligned with that body's axes, separates it
    from the second's bounding sphere, or if a face of either box separates the two boxes.

    Args:
        first: P bodies, no half-spaces.
        second: K bodies.
        tolerance: m.

    Returns:
        Indices into ``first`` and ``second``, sorted by the second, then by the first.

    Raises:
        SceneError: A geometry is of a kind that contact detection does not support.
    """
    gaps = gap_lower_bounds(PlacedBodies.of(first), PlacedBodies.of(second))
    k, p = np.nonzero(gaps <= tolerance)
    return list(zip(p.tolist(), k.tolist(), strict=True))


def deep_pairs(
    bodies: PlacedBodies, others: PlacedBodies, pairs: NDArray[np.intp], depth: float
) -> NDArray[np.intp]:
    """Return the pairs, out of given ones, whose bodies may overlap by more than a depth.

    The bounding sphere of the first body is compared with the bounding sphere and box of the
    second, or with the second itself if it is a half-space.

    Args:
        bodies: Bodies, no half-spaces.
        others: Bodies.
        pairs: (P, 2) indices into both.
        depth: m, not negative.
    """
    solids, other_solids = solids_of(bodies.shapes), solids_of(others.shapes)
    first, second = pairs.T
    centers = box_centers(bodies)[first]
    offsets = centers - box_centers(others)[second]
    local = (offsets[:, None] @ others.poses[second, :3, :3])[:, 0]
    beyond = np.linalg.norm(
        np.maximum(np.abs(local) - other_solids.half_extents[second], 0.0), axis=1
    )
    gaps = np.linalg.norm(offsets, axis=1) - other_solids.reaches[second]
    # Inside the box, the depth of the centre is not known.
    gaps = np.maximum(gaps, np.where(beyond > 0.0, beyond, -np.inf))
    for index, solid in enumerate(other_solids.sets):
        if isinstance(solid, Plane):
            T, is_of_plane = others.poses[index], second == index
            normal = T[:3, :3] @ solid.normal
            gaps[is_of_plane] = (centers[is_of_plane] - T[:3, 3]) @ normal - solid.offset
    return pairs[gaps - solids.reaches[first] < -depth]


def gap_lower_bounds(first: PlacedBodies, second: PlacedBodies) -> FloatArray:
    """Return (K, P) lower bounds on the signed distances of K other bodies and P bodies, m."""
    solids, others, R = solids_of(first.shapes), solids_of(second.shapes), first.poses[:, :3, :3]
    # (K, P, ...) arrays for bodies k of the second and p of the first, in the frame of body p.
    axes = R.transpose(0, 2, 1) @ second.poses[:, None, :3, :3]
    offsets = box_centers(second)[:, None] - box_centers(first)
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
    """Return the (K, 3) centres of the bounding boxes of bodies, world frame, m."""
    rotated = bodies.poses[:, :3, :3] @ solids_of(bodies.shapes).centers[..., None]
    return rotated[..., 0] + bodies.poses[:, :3, 3]


@dataclass(frozen=True, eq=False)
class Separation:
    """The signed distance of two bodies.

    Attributes:
        distance: Gap, negative where they overlap, m.
        normal: (3,) unit vector from the first body to the second, world axes: if the second
            moves with velocity v, the distance grows at the rate ``normal @ v``.
    """

    distance: float
    normal: FloatArray


def separation(first: CollisionBody, second: CollisionBody) -> Separation:
    """Return the signed distance of two bodies and the direction in which it grows."""
    result = coal.DistanceResult()
    distance = coal.distance(
        first.geometry,
        _coal_pose(first.T_world_geometry),
        second.geometry,
        _coal_pose(second.T_world_geometry),
        DISTANCE_REQUEST,
        result,
    )
    return Separation(float(distance), np.array(result.normal))


def point_body(point: FloatArray) -> CollisionBody:
    """Return a sphere of radius `POINT_RADIUS` that represents a point (3,), world, m, in coal."""
    return CollisionBody("point", coal.Sphere(POINT_RADIUS), rigid(point))


def distances_to_point(bodies: Sequence[CollisionBody], point: FloatArray) -> FloatArray:
    """Return the (K,) signed distances of K bodies to a point (3,), world, m: negative inside."""
    point_sphere = point_body(point)
    return np.array([separation(point_sphere, body).distance + POINT_RADIUS for body in bodies])


def nearest_separation(
    first: Sequence[CollisionBody], second: Sequence[CollisionBody]
) -> Separation:
    """Return the separation of the two pieces, one of each body, with the least signed distance.

    It is the distance of the bodies if they are apart. If they overlap, its amount is a lower bound
    on the motion that separates them.

    Args:
        first: The pieces of the first body, at least one.
        second: The pieces of the second body.
    """
    pairs = (separation(piece, other) for piece in first for other in second)
    return min(pairs, key=lambda pair: pair.distance)


def bounded_set(item: LinkGeometry) -> BoundedSet:
    """Return the set that a link's collision shape fills, in the shape's own frame.

    Raises:
        SceneError: If the shape is a half-space or of a kind without contact detection.
    """
    solid = convex_set(item.link, item.shape)
    if isinstance(solid, Plane):
        raise SceneError(f"hand link '{item.link}' is a half-space; give it a bounded shape")
    return solid


class LinkDistances:
    """Signed distances of the collision shapes of links to a fixed body, at any configuration.

    The distance to a body of several convex pieces is that to the nearest, or deepest, of them.

    This is much cheaper than making a new `Hand` for each configuration.

    Attributes:
        links: (K) link of each shape, in model order; a link with several shapes is repeated.
        shapes: (K) collision shapes with their poses.
    """

    def __init__(self, hand: Hand, links: Collection[str], pieces: PlacedBodies) -> None:
        """Prepare the shapes of ``links`` of ``hand`` and the pieces of the fixed body."""
        self.shapes = tuple(item for item in hand.tree.geometries if item.link in links)
        self.links = tuple(item.link for item in self.shapes)
        self._tree = hand.tree
        self._pieces = [(piece.geometry, _coal_pose(piece.T_world_geometry)) for piece in pieces]
        self._centers, self._radii = box_centers(pieces), solids_of(pieces.shapes).reaches

    def at(self, positions: FloatArray) -> FloatArray:
        """Return the (K,) signed distances with all joints at (n,) ``positions``, m."""
        T_world_joint = self._tree.kinematics(positions).T_world_joint
        poses = [T_world_joint[item.joint] @ item.T_joint_geometry for item in self.shapes]
        return np.array(
            [self._nearest_distance(*one) for one in zip(self.shapes, poses, strict=True)]
        )

    def _nearest_distance(self, item: LinkGeometry, T: FloatArray) -> float:
        """Return the signed distance, m, of a shape at a pose to the nearest piece."""
        pose = _coal_pose(T)
        order, bounds = [0], [-np.inf]
        if len(self._pieces) > 1:
            solid = bounded_set(item)
            offsets = self._centers - transformed(T, solid.center)
            gaps = np.linalg.norm(offsets, axis=1) - self._radii - solid.radius
            order, bounds = np.argsort(gaps).tolist(), gaps.tolist()
        nearest = np.inf
        for index in order:
            if bounds[index] >= nearest:
                break
            geometry, T_world_piece = self._pieces[index]
            distance = coal.distance(
                item.shape, pose, geometry, T_world_piece, DISTANCE_REQUEST, coal.DistanceResult()
            )
            nearest = min(nearest, float(distance))
        return nearest


def _coal_pose(T: FloatArray) -> Any:
    return coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3]))
