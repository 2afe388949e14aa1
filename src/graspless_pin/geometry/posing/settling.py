"""Putting an object down on its supports, and how it may lie there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.meshes import hull_points
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.polytopes import hull_polytope
from graspless_pin.geometry.bodies.shapes import Capsule, MeshShape
from graspless_pin.geometry.contact.distances import (
    box_centers,
    nearest_separation,
    separation,
    solids_of,
)
from graspless_pin.geometry.hand.model import Hand, displaced_hand
from graspless_pin.geometry.poses import rigid, shifted
from graspless_pin.geometry.posing.finger_joints import Arm
from graspless_pin.problem.checks import FloatArray, unit_vector

SETTLING_TOLERANCE = 1e-4
"""Overlap with a support across the direction of settling that is left as it is, m."""

_TOUCHING_GAP = 1e-7  # m
_PASSING_APPROACH = 1e-3
"""Approach per travel, about 0.06 degrees, up to which bodies pass along each other."""
_MOST_STEPS = 100


def settle_object(
    target: ManipulatedObject,
    supports: Sequence[Support],
    direction: ArrayLike = (0.0, 0.0, -1.0),
) -> ManipulatedObject:
    """Move an object along a direction until it touches the first support in its way.

    The gap that is left is zero up to about a micrometre either way.

    An object that overlaps a support in its way is taken back until it only touches; one that is
    more than half through it goes on to the far side. A support that the object moves along, as
    along a wall on its way down, does not stop it; so an object is put into a corner by settling it
    twice, in two directions. The object only translates: it neither turns nor slides nor tips over,
    touches with as little as one corner if that comes first, and may not stay where it is put.

    Args:
        target: The object.
        supports: What it may come to rest on.
        direction: (3,) where to move, world axes, of any length; gravity, for example.

    Returns:
        The object at its new pose.

    Raises:
        ArgumentError: If ``direction`` is zero or not three finite numbers.
        SceneError: If no support lies in the way, or the object overlaps one across the direction
            by more than `SETTLING_TOLERANCE`.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.geometry import settle_object
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> settle_object(scene.object, scene.supports).T_world_object[2, 3].round(3).item()  # m
        0.05
    """
    axis = unit_vector("direction", direction)
    pieces, others = target.placed_bodies, [support.placed_bodies for support in supports]
    paths = [_path_to(piece, body, axis) for other in others for body in other for piece in pieces]
    ahead = [path for path in paths if path is not None]
    if not ahead:
        known = ", ".join(f"'{support.name}'" for support in supports) or "there is none"
        raise SceneError(
            f"object '{target.name}' meets no support in the direction {axis.round(6).tolist()} "
            f"({known}); turn the direction or move the object"
        )
    settled = target.with_pose(shifted(target.T_world_object, min(ahead) * axis))
    for support, other in zip(supports, others, strict=True):
        overlap = -nearest_separation(other, settled.placed_bodies).distance
        if overlap > SETTLING_TOLERANCE:
            raise SceneError(
                f"object '{target.name}' overlaps support '{support.name}' by "
                f"{overlap * 1e3:.2f} mm where it settles in the direction "
                f"{axis.round(6).tolist()}; move it aside or settle it off that support first"
            )
    return settled


def _path_to(body: CollisionBody, other: CollisionBody, axis: FloatArray) -> float | None:
    """Return how far one convex piece goes until it touches another, negative to come out of it.

    The signed distance of convex bodies is a convex function of the travel. Newton's method
    therefore reaches its root from the side of the gap without passing it, and from an overlap
    falls back to that side first.

    Returns:
        The travel, m; None if the pieces never meet or only pass along each other.
    """
    travel = 0.0
    for _ in range(_MOST_STEPS):
        T = shifted(body.T_world_geometry, travel * axis)
        here = separation(other, CollisionBody(body.name, body.geometry, T))
        approach = -float(here.normal @ axis)
        if approach <= _PASSING_APPROACH:
            return None
        if abs(here.distance) <= _TOUCHING_GAP:
            break
        travel += here.distance / approach
    return travel


_DOWN = np.array([0.0, 0.0, -1.0])
_COPLANAR = 1e-3  # rad
_STEADY_MARGIN = 0.02
"""How far the centre of mass stands inside of a face's edges, as a share of the hull's width."""
_BASE_CLEARANCE = 0.05  # m
_ALL_POSES = 6  # joints
_BENT_REACH, _LEAST_AWAY, _HIGHEST_SHOULDER = 0.6, 0.4, 0.65
"""From shoulder to object, in all, along the support and up, as shares of the stretched arm."""


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
    normal, origin = support.T_world_support[:3, 2:].T
    R = support.T_world_support[:3, :3] @ _resting_rotation(target)
    center = origin + 2.0 * _reach(target.placed_bodies, target.center_of_mass_world) * normal
    above = target.with_pose(rigid(center - R @ target.center_of_mass, R))
    return settle_object(above, [support], -normal)


def clear_base(hand: Hand, target: ManipulatedObject, normal: FloatArray) -> FloatArray:
    """Return a (3,) position of a hand's base, m, from which no link reaches an object.

    Args:
        hand: The hand, whose base is turned as it will stand.
        target: The object.
        normal: (3,) unit vector from the object to the hand.
    """
    base, center = hand.T_world_base[:3, 3], target.center_of_mass_world
    frames = [hand.pose_of(link)[:3, 3] for link in hand.link_names]
    links = max(float(np.linalg.norm(origin - base)) for origin in frames)
    reach = max(links, _reach(hand.placed_bodies, base)) + _reach(target.placed_bodies, center)
    return center + (reach + _BASE_CLEARANCE) * normal


def base_beside(
    hand: Hand, arm: Arm, target: ManipulatedObject, support: Support
) -> FloatArray | None:
    """Return a (3,) position of an arm's base, m, from which the arm reaches an object.

    No link is below the surface of the support, and the object lies in the direction in which the
    support's x axis points: ahead of the robot, as REP 103 of ROS has it.

    Args:
        hand: The hand on the arm, whose base is turned as it will stand.
        arm: The arm.
        target: The object.
        support: The half-space that both stand on.

    Returns:
        The position; None: fewer than six joints bring the palm to few poses, the shoulder is too
        high, a link would be next to the object, or no link has a shape.
    """
    ahead, normal = support.T_world_support[:3, [0, 2]].T
    if len(arm.columns) < _ALL_POSES or not len(hand.placed_bodies):
        return None
    chain = 1 + np.flatnonzero(hand.tree.supports[arm.joint])
    joints = hand.tree.kinematics(hand.positions).T_world_joint[chain, :3, 3]
    reach = float(np.linalg.norm(np.diff(joints, axis=0), axis=1).sum())
    rise = -nearest_separation(support.placed_bodies, hand.placed_bodies).distance
    to_shoulder = joints[0] - target.center_of_mass_world
    height = float(normal @ to_shoulder) + rise
    if abs(height) >= _HIGHEST_SHOULDER * reach:  # also where all joints are in one place
        return None
    away = reach * math.sqrt(max(_BENT_REACH**2 - (height / reach) ** 2, _LEAST_AWAY**2))
    shift = height * normal - away * ahead - to_shoulder
    moved = displaced_hand(hand, shifted(np.eye(4), shift))
    gap = nearest_separation(target.placed_bodies, moved.placed_bodies).distance
    return moved.T_world_base[:3, 3] if gap > _BASE_CLEARANCE else None


def _reach(bodies: PlacedBodies, point: FloatArray) -> float:
    """Return a radius of a sphere about a (3,) point that holds all bodies, m."""
    if not len(bodies):
        return 0.0
    away = np.linalg.norm(box_centers(bodies) - point, axis=1)
    return float((away + solids_of(bodies.shapes).reaches).max())


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
    hull = hull_polytope(points)
    normals, offsets = hull.face_normals, hull.face_offsets
    steady = _STEADY_MARGIN * float(np.ptp(points, axis=0).max())
    most_stable = -np.inf, _DOWN
    for face in np.argsort(-(normals @ _DOWN), kind="stable"):
        foot = center - (normals[face] @ center - offsets[face]) * normals[face]
        cosines = normals @ normals[face]
        others = cosines < np.cos(_COPLANAR)
        sines = np.sqrt(np.maximum(1.0 - cosines[others] ** 2, 1e-12))
        inside = float(((offsets - normals @ foot)[others] / sines).min())
        if inside >= steady:
            return normals[face]
        most_stable = max(most_stable, (inside, normals[face]), key=lambda found: found[0])
    return most_stable[1]
