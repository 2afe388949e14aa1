"""Signed distances between bodies, as coal measures them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np

from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.broad_phase import box_centers, solids_of
from graspless_pin.geometry.contact.convex_sets import (
    DISTANCE_REQUEST,
    Plane,
    Polytope,
    Revolved,
    convex_set,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import LinkGeometry
from graspless_pin.geometry.poses import transformed
from graspless_pin.problem.checks import FloatArray


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


def bounded_set(item: LinkGeometry) -> Polytope | Revolved:
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
        joints: (K) Pinocchio joint that carries each shape.
        shapes: (K) geometries with their poses, `LinkGeometry`.
    """

    def __init__(self, hand: Hand, links: Collection[str], pieces: Sequence[CollisionBody]) -> None:
        """Take the shapes of ``links`` in ``hand``, to be measured against a body's pieces."""
        self.shapes = tuple(item for item in hand.tree.geometries if item.link in links)
        self.links = tuple(item.link for item in self.shapes)
        self.joints = [item.joint for item in self.shapes]
        self._tree = hand.tree
        self._pieces = [(piece.geometry, _transform(piece.T_world_geometry)) for piece in pieces]
        placed = PlacedBodies.of(pieces)
        solids = solids_of(placed.shapes)
        self._centers, self._radii = box_centers(placed, solids), solids.reaches

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
