"""An object laid on a plane as it would lie there, and a hand that stands clear of it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.bodies.meshes import hull_points
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import Capsule, MeshShape
from graspless_pin.geometry.contact.broad_phase import box_centers, solids_of
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.settling import settle_object
from graspless_pin.problem.checks import FloatArray

_DOWN = np.array([0.0, 0.0, -1.0])
_COPLANAR = 1e-3  # rad
_STEADY = 0.02
"""How far the centre of mass stands inside of a face's edges, as a share of the hull's width."""
_CLEARANCE = 0.05  # m


def lying_object(target: ManipulatedObject, support: Support) -> ManipulatedObject:
    """Lay an object on a half-space, its centre of mass above the origin of the half-space's frame.

    A mesh lies on the face nearest to its own underside on which it does not tip over, for gravity
    along the half-space's normal. Primitives stand as they are, but for a capsule, which lies.

    Args:
        target: The object, at any pose.
        support: The half-space.

    Returns:
        The object, up to a micrometre from touching.

    Raises:
        MeshError: See `Shape.pieces`.
    """
    T = np.array(support.T_world_support)
    normal = T[:3, 2].copy()
    T[:3, :3] = T[:3, :3] @ _resting_rotation(target)
    T[:3, 3] += 2.0 * _reach(target.placed_bodies, target.center_of_mass_world) * normal
    T[:3, 3] -= T[:3, :3] @ target.center_of_mass
    return settle_object(target.with_pose(T), [support], -normal)


def clear_base(hand: Hand, target: ManipulatedObject, normal: FloatArray) -> FloatArray:
    """Return a (3,) position of a hand's base, m, from which no link reaches an object.

    Args:
        hand: The hand, whose base is turned as it will stand.
        target: The object.
        normal: (3,) unit vector from the object to the hand.
    """
    base, center = hand.T_world_base[:3, 3], target.center_of_mass_world
    frames = [hand.link_pose(link)[:3, 3] for link in hand.link_names]
    links = max(float(np.linalg.norm(origin - base)) for origin in frames)
    reach = max(links, _reach(hand.placed_bodies, base)) + _reach(target.placed_bodies, center)
    return center + (reach + _CLEARANCE) * normal


def _reach(bodies: PlacedBodies, point: FloatArray) -> float:
    """Return a radius of a sphere about a (3,) point that holds all bodies, m."""
    if not len(bodies):
        return 0.0
    solids = solids_of(bodies.shapes)
    away = np.linalg.norm(box_centers(bodies, solids) - point, axis=1)
    return float((away + solids.reaches).max())


def _resting_rotation(target: ManipulatedObject) -> FloatArray:
    """Return the (3, 3) rotation from the object's axes to those of a plane with the normal z."""
    if isinstance(target.shape, Capsule):
        return Rotation.from_euler("x", 0.5 * np.pi).as_matrix()
    if not isinstance(target.shape, MeshShape):
        return np.eye(3)
    points = hull_points(target.shape.path, target.shape.scale)
    down = _underside(points, target.center_of_mass)
    axis = np.cross(down, _DOWN)
    angle = np.arctan2(np.linalg.norm(axis), down @ _DOWN)
    if angle > np.pi - _COPLANAR:
        axis = np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(angle * axis / (np.linalg.norm(axis) or 1.0)).as_matrix()


def _underside(points: FloatArray, center: FloatArray) -> FloatArray:
    """Return the (3,) outward normal of the face on which a hull lies.

    A face is steady if the foot of the centre of mass on it stays inside of its edges; one on which
    it does so by a margin comes first.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    steady = _STEADY * float(np.ptp(points, axis=0).max())
    steadiest = -np.inf, _DOWN
    for face in np.argsort(-(normals @ _DOWN), kind="stable"):
        foot = center - (normals[face] @ center + offsets[face]) * normals[face]
        cosines = normals @ normals[face]
        others = cosines < np.cos(_COPLANAR)
        sines = np.sqrt(np.maximum(1.0 - cosines[others] ** 2, 1e-12))
        inside = float((-(normals @ foot + offsets)[others] / sines).min())
        if inside >= steady:
            return normals[face]
        steadiest = max(steadiest, (inside, normals[face]), key=lambda found: found[0])
    return steadiest[1]
