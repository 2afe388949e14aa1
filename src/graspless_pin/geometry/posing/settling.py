"""Settling an object on its supports, its resting orientation, and base poses beside it."""

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
from graspless_pin.geometry.poses import rigid, translated
from graspless_pin.geometry.posing.finger_joints import Arm
from graspless_pin.problem.checks import FloatArray, unit_vector

SETTLING_TOLERANCE = 1e-4
"""Largest overlap with a support across the direction of settling that is accepted, m."""

_TOUCHING_GAP = 1e-7  # m
_PASSING_APPROACH = 1e-3
"""Approach per travel, about 0.06 degrees, up to which bodies only pass along each other."""
_MOST_STEPS = 100


def settle_object(
    target: ManipulatedObject,
    supports: Sequence[Support],
    direction: ArrayLike = (0.0, 0.0, -1.0),
) -> ManipulatedObject:
    """Move an object along a direction until it touches the first support in its way.

    The remaining gap or overlap is at most about a micrometre.

    An object that overlaps a support in its way is moved back until it only touches; one that is
    more than half through it moves on to the far side. A support that the object moves along, as
    along a wall on its way down, does not stop it; so an object is put into a corner by settling it
    twice, in two directions. The object only translates: it does not rotate, slide or tip over. It
    may touch with a single vertex, and need not be stable there.

    Args:
        target: The object.
        supports: The supports on which it may settle.
        direction: (3,) direction of motion, world axes, of any length; gravity, for example.

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
    all_travels = [
        _travel_to_contact(piece, body, axis)
        for other in others
        for body in other
        for piece in pieces
    ]
    travels = [path for path in all_travels if path is not None]
    if not travels:
        names = ", ".join(f"'{support.name}'" for support in supports) or "there is none"
        raise SceneError(
            f"object '{target.name}' meets no support in the direction {axis.round(6).tolist()} "
            f"({names}); turn the direction or move the object"
        )
    settled = target.with_pose(translated(target.T_world_object, min(travels) * axis))
    for support, other in zip(supports, others, strict=True):
        overlap = -nearest_separation(other, settled.placed_bodies).distance
        if overlap > SETTLING_TOLERANCE:
            raise SceneError(
                f"object '{target.name}' overlaps support '{support.name}' by "
                f"{overlap * 1e3:.2f} mm where it settles in the direction "
                f"{axis.round(6).tolist()}; move it aside or settle it off that support first"
            )
    return settled


def _travel_to_contact(body: CollisionBody, other: CollisionBody, axis: FloatArray) -> float | None:
    """Return the travel of one convex piece until it touches another, negative out of an overlap.

    The signed distance of convex bodies is a convex function of the travel. Newton's method
    therefore converges to its root from the side of the gap without passing it; from an overlap it
    first steps back to that side.

    Returns:
        The travel, m; None if the pieces never meet or only pass along each other.
    """
    travel = 0.0
    for _ in range(_MOST_STEPS):
        T = translated(body.T_world_geometry, travel * axis)
        current = separation(other, CollisionBody(body.name, body.geometry, T))
        approach = -float(current.normal @ axis)
        if approach <= _PASSING_APPROACH:
            return None
        if abs(current.distance) <= _TOUCHING_GAP:
            break
        travel += current.distance / approach
    return travel


_DOWN = np.array([0.0, 0.0, -1.0])
_COPLANAR = 1e-3  # rad
_STEADY_MARGIN = 0.02
"""Least distance of the centre of mass inside a face's edges, as a share of the hull's width."""
_BASE_CLEARANCE = 0.05  # m
_ALL_POSES = 6  # joints
_BENT_REACH, _LEAST_AWAY, _HIGHEST_SHOULDER = 0.6, 0.4, 0.65
"""Distances from shoulder to object as shares of the arm's reach: total, along the support, up."""


def lying_object(target: ManipulatedObject, support: Support) -> ManipulatedObject:
    """Place an object at rest on a half-space, its centre of mass above the origin of its frame.

    A mesh rests on the stable face nearest to its own underside, for gravity along the half-space's
    normal. Primitives stand with their axes along those of the support, except a capsule, which
    lies.

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
    center = (
        origin + 2.0 * _radius_about(target.placed_bodies, target.center_of_mass_world) * normal
    )
    above = target.with_pose(rigid(center - R @ target.center_of_mass, R))
    return settle_object(above, [support], -normal)


def clear_base(hand: Hand, target: ManipulatedObject, normal: FloatArray) -> FloatArray:
    """Return a (3,) position of a hand's base, m, from which no link reaches an object.

    Args:
        hand: The hand, with its base in the final orientation.
        target: The object.
        normal: (3,) unit vector from the object to the hand.
    """
    base, center = hand.T_world_base[:3, 3], target.center_of_mass_world
    frames = [hand.pose_of(link)[:3, 3] for link in hand.link_names]
    link_reach = max(float(np.linalg.norm(origin - base)) for origin in frames)
    reach = max(link_reach, _radius_about(hand.placed_bodies, base)) + _radius_about(
        target.placed_bodies, center
    )
    return center + (reach + _BASE_CLEARANCE) * normal


def base_beside(
    hand: Hand, arm: Arm, target: ManipulatedObject, support: Support
) -> FloatArray | None:
    """Return a (3,) position of an arm's base, m, from which the arm reaches an object.

    No link is below the surface of the support, and the object is in the direction of the support's
    x axis: ahead of the robot, as in REP 103 of ROS.

    Args:
        hand: The hand on the arm, with its base in the final orientation.
        arm: The arm.
        target: The object.
        support: The half-space that both stand on.

    Returns:
        The position; None: the arm has fewer than six joints, the shoulder is too high, a link
        would be too near to the object, or no link has a shape.
    """
    ahead, normal = support.T_world_support[:3, [0, 2]].T
    if len(arm.columns) < _ALL_POSES or not len(hand.placed_bodies):
        return None
    chain = 1 + np.flatnonzero(hand.tree.supports[arm.joint])
    joints = hand.tree.kinematics(hand.positions).T_world_joint[chain, :3, 3]
    reach = float(np.linalg.norm(np.diff(joints, axis=0), axis=1).sum())
    lift = -nearest_separation(support.placed_bodies, hand.placed_bodies).distance
    to_shoulder = joints[0] - target.center_of_mass_world
    height = float(normal @ to_shoulder) + lift
    if abs(height) >= _HIGHEST_SHOULDER * reach:  # also if all joints coincide
        return None
    distance = reach * math.sqrt(max(_BENT_REACH**2 - (height / reach) ** 2, _LEAST_AWAY**2))
    shift = height * normal - distance * ahead - to_shoulder
    moved = displaced_hand(hand, translated(np.eye(4), shift))
    gap = nearest_separation(target.placed_bodies, moved.placed_bodies).distance
    return moved.T_world_base[:3, 3] if gap > _BASE_CLEARANCE else None


def _radius_about(bodies: PlacedBodies, point: FloatArray) -> float:
    """Return the radius of a sphere about a (3,) point that encloses all bodies, m."""
    if not len(bodies):
        return 0.0
    distances = np.linalg.norm(box_centers(bodies) - point, axis=1)
    return float((distances + solids_of(bodies.shapes).reaches).max())


def _resting_rotation(target: ManipulatedObject) -> FloatArray:
    """Return the (3, 3) rotation from the object's axes to those of a plane with normal z."""
    if isinstance(target.shape, Capsule):
        return Rotation.from_euler("x", 0.5 * np.pi).as_matrix()
    if not isinstance(target.shape, MeshShape):
        return np.eye(3)
    points = hull_points(target.shape.path, target.shape.scale)
    down = _resting_face_normal(points, target.center_of_mass)
    axis = np.cross(down, _DOWN)
    angle = np.arctan2(np.linalg.norm(axis), down @ _DOWN)
    if angle > np.pi - _COPLANAR:
        axis = np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(angle * axis / (np.linalg.norm(axis) or 1.0)).as_matrix()


def _resting_face_normal(points: FloatArray, center: FloatArray) -> FloatArray:
    """Return the (3,) outward normal of the face on which a hull rests.

    A face is stable if the foot of the centre of mass on it is inside its edges. The most
    downward face that is stable by a margin is taken, else the most stable one.
    """
    hull = hull_polytope(points)
    normals, offsets = hull.face_normals, hull.face_offsets
    margin = _STEADY_MARGIN * float(np.ptp(points, axis=0).max())
    best = -np.inf, _DOWN
    for face in np.argsort(-(normals @ _DOWN), kind="stable"):
        foot = center - (normals[face] @ center - offsets[face]) * normals[face]
        cosines = normals @ normals[face]
        is_other = cosines < np.cos(_COPLANAR)
        sines = np.sqrt(np.maximum(1.0 - cosines[is_other] ** 2, 1e-12))
        face_margin = float(((offsets - normals @ foot)[is_other] / sines).min())
        if face_margin >= margin:
            return normals[face]
        best = max(best, (face_margin, normals[face]), key=lambda candidate: candidate[0])
    return best[1]
