"""Signed distances between bodies, as coal measures them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray

from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.contact.convex_sets import Plane, Polytope, Revolved, convex_set
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import LinkGeometry

Array = NDArray[np.float64]

_REQUEST = coal.DistanceRequest()
_REQUEST.gjk_tolerance = 1e-9
_REQUEST.epa_tolerance = 1e-9


@dataclass(frozen=True, eq=False)
class Separation:
    """How far two bodies are apart.

    Attributes:
        distance: Gap, negative where they overlap, m.
        normal: (3,) unit vector from the first body to the second, world axes: where the second
            moves with velocity v, the distance grows by ``normal @ v``.
    """

    distance: float
    normal: Array


def separation(first: CollisionBody, second: CollisionBody) -> Separation:
    """Measure the signed distance of two bodies and the direction in which it grows."""
    result = coal.DistanceResult()
    distance = coal.distance(
        first.geometry,
        _transform(first.T_world_geometry),
        second.geometry,
        _transform(second.T_world_geometry),
        _REQUEST,
        result,
    )
    return Separation(float(distance), np.array(result.normal))


def far_apart(first: CollisionBody, second: CollisionBody) -> bool:
    """Return whether the bounding spheres are apart, which is much cheaper to tell."""
    sets = [convex_set(body.name, body.geometry) for body in (first, second)]
    if any(isinstance(one, Plane) for one in sets):
        return False
    centers = [
        body.T_world_geometry[:3, :3] @ one.center + body.T_world_geometry[:3, 3]
        for body, one in zip((first, second), sets, strict=True)
        if not isinstance(one, Plane)
    ]
    reach = sum(one.radius for one in sets if not isinstance(one, Plane))
    return float(np.linalg.norm(centers[0] - centers[1])) > reach


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
    """Signed distances of the shapes of some links to one fixed body, at any configuration.

    It costs a fraction of making a new `Hand` for each configuration.

    Attributes:
        links: (K) link of each shape, in model order; a link with several shapes comes up again.
        joints: (K) Pinocchio joint that carries each shape.
        shapes: (K) geometries with their poses, `LinkGeometry`.
    """

    def __init__(self, hand: Hand, links: Collection[str], body: CollisionBody) -> None:
        """Take the shapes of ``links`` in ``hand``, to be measured against ``body``."""
        self.shapes = tuple(item for item in hand.tree.geometries if item.link in links)
        self.links = tuple(item.link for item in self.shapes)
        self.joints = [item.joint for item in self.shapes]
        self._tree = hand.tree
        self._data: Any = hand.tree.model.createData()
        self._placements = [pin.SE3(np.array(item.T_joint_geometry)) for item in self.shapes]
        self._body = body.geometry
        self._T_world_body = _transform(body.T_world_geometry)

    def at(self, positions: Array) -> Array:
        """Return the (K,) signed distances with all joints at (n,) ``positions``, m."""
        tree = self._tree
        pin.forwardKinematics(tree.model, self._data, tree.configuration(positions))
        distances = np.empty(len(self.shapes))
        for index, (item, placement) in enumerate(zip(self.shapes, self._placements, strict=True)):
            pose = self._data.oMi[item.joint] * placement
            distances[index] = coal.distance(
                item.shape,
                coal.Transform3s(pose.rotation, pose.translation),
                self._body,
                self._T_world_body,
                _REQUEST,
                coal.DistanceResult(),
            )
        return distances


def _transform(T: Array) -> Any:
    return coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3]))
