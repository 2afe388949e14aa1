"""Wrenches on a scene's object and joint torques from loads and accelerations.

Inertial forces follow d'Alembert's principle: in the frame that moves along, a body is at
rest under its weight and -m a. Arrays may have leading axes, for many states at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.hand.joint_columns import (
    STILL,
    HandMotions,
    RigidMotion,
    hand_motions,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.matrices import wrench_map
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.fields import SceneFields, place_of
from graspless_pin.scene.stated import Accelerated, Acceleration, LoadAxes

_SAME_MOTION = 1e-9
"""Tolerance relative to the largest velocity or acceleration, at least one SI unit: links that
differ by less move as one."""


class ActingForce(NamedTuple):
    """A force and moment on the object in addition to its own weight.

    Attributes:
        name: Name of its cause.
        force: (..., 3) N, world axes.
        moment: (..., 3) N m, world axes.
        lever: (..., 3) from the object's centre of mass to its point of attack, world axes, m.
        turns: Whether force and moment turn with the object.
        of_gravity: Whether it is the weight of a payload.
    """

    name: str
    force: FloatArray
    moment: FloatArray
    lever: FloatArray
    turns: bool = False
    of_gravity: bool = False

    @property
    def wrench(self) -> FloatArray:
        """(..., 6) wrench about the object's centre of mass, N and N m."""
        moment = self.moment + np.cross(self.lever, self.force)
        return np.concatenate([np.broadcast_to(self.force, moment.shape), moment], axis=-1)


def acting_forces(
    scene: SceneFields,
    motion: RigidMotion | None = None,
    T_world_object: FloatArray | None = None,
) -> tuple[ActingForce, ...]:
    """Return the forces on a scene's object in addition to its own weight.

    Args:
        scene: The scene.
        motion: Motion of the object; None: by the scene's acceleration.
        T_world_object: (..., 4, 4) poses of the object; None: that of the scene.

    Raises:
        SceneError: See `object_motion`.
    """
    target, acting = scene.object, list[ActingForce]()
    motion = object_motion(scene) if motion is None else motion
    T = target.T_world_object if T_world_object is None else T_world_object
    R, zero = T[..., :3, :3], np.zeros(3)
    masses = [("", target.mass, zero)]
    for load in scene.loads:
        lever = zero if load.at is None else R @ (load.at - target.center_of_mass)
        if load.force.any() or load.moment.any():
            turns = load.axes == LoadAxes.OBJECT
            rotation = R if turns else np.eye(3)
            load_wrench = rotation @ load.force, rotation @ load.moment
            acting.append(ActingForce(load.name, *load_wrench, lever, turns))
        if load.mass:
            masses.append((f" of {load.name}", load.mass, lever))
            weight = load.mass * scene.gravity
            acting.append(ActingForce(load.name, weight, zero, lever, of_gravity=True))
    for load in scene.loads:
        if load.field.any():
            acting += [
                ActingForce(load.name + suffix, mass * load.field, zero, lever)
                for suffix, mass, lever in masses
            ]
    if motion is not STILL:
        omega, alpha = motion.velocity[..., 3:], motion.acceleration[..., 3:]
        center, inertial_moment = R @ target.center_of_mass + T[..., :3, 3], zero
        if omega.any() or alpha.any():
            inertia = R @ target.own_inertia @ np.swapaxes(R, -1, -2)
            moment, spin = ((inertia @ vector[..., None])[..., 0] for vector in (alpha, omega))
            inertial_moment = -(moment + np.cross(omega, spin))
        for suffix, mass, lever in masses:
            force = -mass * motion.acceleration_of(center + lever)
            acting.append(
                ActingForce(f"inertia{suffix}", force, zero if suffix else inertial_moment, lever)
            )
    return tuple(acting)


def object_wrench(
    scene: SceneFields,
    motion: RigidMotion | None = None,
    T_world_object: FloatArray | None = None,
) -> FloatArray:
    """Return the (..., 6) wrench of weight and loads about the centre of mass, N and N m.

    The arguments are those of `acting_forces`.

    Raises:
        SceneError: See `object_motion`.
    """
    mass, gravity = scene.object.mass, scene.gravity
    motion = object_motion(scene) if motion is None else motion
    weight = scene._cache.value(
        "weight", (mass, gravity), lambda: np.concatenate([mass * gravity, np.zeros(3)])
    )
    if motion is STILL and not scene.loads:
        return weight
    return weight + sum(acting.wrench for acting in acting_forces(scene, motion, T_world_object))


def object_inertia(scene: SceneFields) -> FloatArray:
    """Return the (6, 6) inertia of a scene's object with its payloads about its centre of mass.

    Raises:
        MeshError: See `ManipulatedObject.own_inertia`.
    """
    target, inertia = scene.object, scene.object.spatial_inertia()
    for load in scene.loads:
        if load.mass:
            point = target.center_of_mass if load.at is None else load.at
            lever = target.T_world_object[:3, :3] @ (point - target.center_of_mass)
            W = wrench_map(lever[None])
            inertia = inertia + load.mass * W @ W.T
    return inertia


def load_rates(scene: SceneFields, angular: FloatArray) -> FloatArray:
    """Return the rates of the wrench of loads as the object turns.

    The lever of a force turns with the object. Inertial forces are taken as constant.

    Args:
        scene: The scene.
        angular: (3, d) angular velocities.

    Returns:
        (6, d) about the object's centre of mass, world axes.
    """
    total = np.zeros((6, angular.shape[1]))
    for acting in acting_forces(scene):
        force, moment = np.zeros_like(angular), np.cross(angular, acting.lever, axis=0)
        moment = np.cross(moment, acting.force, axis=0)
        if acting.turns:
            force = np.cross(angular, acting.force, axis=0)
            moment = np.cross(angular, acting.wrench[3:], axis=0)
        total += np.concatenate([force, moment])
    return total


def hand_motion(scene: SceneFields) -> HandMotions | None:
    """Return the motions of an accelerating hand's links; None if it does not accelerate.

    Raises:
        SceneError: If the acceleration names an unknown joint.
    """
    acceleration, hand = scene.acceleration, scene.hand
    if acceleration is None or hand is None or acceleration.of == Accelerated.OBJECT:
        return None
    center = scene.object.center_of_mass_world
    sources = (
        acceleration,
        hand.positions,
        hand.tree,
        center.tobytes() if acceleration.at is None else b"",
    )
    return scene._cache.value(
        "hand motion", sources, lambda: _hand_motion(scene, acceleration, hand, center)
    )


def _hand_motion(
    scene: SceneFields,
    acceleration: Acceleration,
    hand: Hand,
    center: FloatArray,
    kinematics: Kinematics | None = None,
) -> HandMotions:
    base = _frame_motion(acceleration, center)
    try:
        return hand_motions(
            hand, base, acceleration.joint_velocities, acceleration.joint_accelerations, kinematics
        )
    except ArgumentError as error:
        place = place_of(scene, "acceleration").removesuffix(": acceleration")
        raise SceneError(f"{place}: acceleration.{error}") from error


def carried_loads(
    scene: SceneFields, hand: Hand, joint: int, kinematics: Kinematics, T_joint_object: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the loads on an object that moves with a joint, and inertial torques of the hand.

    Args:
        scene: The scene, whose acceleration is the same in all states.
        hand: Its hand.
        joint: Index of Pinocchio's joint.
        kinematics: Kinematics of the hand in S states.
        T_joint_object: (4, 4) pose of the object in the joint's frame, m.

    Returns:
        (S, 6) or (6,) wrench as of `object_wrench`; (S, n) or () joint torques that accelerate the
        links, in addition to those against their weight, N m or N: 0 where they do not count.

    Raises:
        SceneError: See `hand_motion`.
    """
    acceleration, nothing = scene.acceleration, np.zeros(())
    if acceleration is None and not scene.loads:
        return object_wrench(scene, STILL), nothing
    T_world_object = kinematics.T_world_joint[:, joint] @ T_joint_object
    if acceleration is None:
        return object_wrench(scene, STILL, T_world_object), nothing
    center = T_world_object[:, :3, :3] @ scene.object.center_of_mass + T_world_object[:, :3, 3]
    if acceleration.of == Accelerated.OBJECT:
        motion = _frame_motion(acceleration, center)
        return object_wrench(scene, motion, T_world_object), nothing
    motions = _hand_motion(scene, acceleration, hand, center, kinematics)
    torques = motions.joint_torques(hand) if scene.count_own_weight else nothing
    return object_wrench(scene, motions.motion_of_joint(joint), T_world_object), torques


def inertial_torques(scene: SceneFields) -> FloatArray:
    """Return (L,) torques that accelerate the links, in addition to those against their weight.

    Raises:
        SceneError: See `hand_motion`.
    """
    motions, hand = hand_motion(scene), scene.hand
    if hand is None or motions is None:
        return np.zeros(0 if hand is None else len(hand.actuated_joint_names))
    return motions.torques(hand)


def object_motion(scene: SceneFields) -> RigidMotion:
    """Return the motion of a scene's object: of the stated frame, or of the links that touch it.

    Raises:
        SceneError: If the acceleration names an unknown joint, no link touches the object or the
            links do not move as one, or the object slides on a support without a declared motion.
    """
    acceleration = scene.acceleration
    if acceleration is None:
        return STILL
    if not (acceleration.joint_velocities or acceleration.joint_accelerations):
        return _frame_motion(acceleration, scene.object.center_of_mass_world)
    place, motions = place_of(scene, "acceleration"), hand_motion(scene)
    if motions is None or scene.hand is None:
        raise SceneError(f"{place}: has joint motions, but the scene has no hand; leave them out")
    touching = contacts_of(scene).arrays
    links = dict.fromkeys(touching.bodies[: touching.hand_count])
    if not links:
        raise SceneError(
            f"{place}: joints move, but no link that could move the object touches it; close "
            "the fingers, or give 'of: object'"
        )
    first, *other_links = links
    carried = [motions.motion_of_joint(scene.hand.tree.link_joints[link]) for link in links]
    for link, motion in zip(other_links, carried[1:], strict=True):
        if not _is_same_motion(motion, carried[0]):
            raise SceneError(
                f"{place}: links {first!r} and {link!r} touch the object but do not move as one "
                "body; give joints that move both, such as those of an arm"
            )
    slides = touching.hand_count < len(touching) and scene.motion is None
    if slides and not np.allclose(
        carried[0].velocity, motions.motion_of_joint(0).velocity, atol=_SAME_MOTION
    ):
        raise SceneError(
            f"{place}: the joints' velocities move the object, which touches "
            f"{touching.bodies[touching.hand_count]!r}; declare how it slides under 'motion', or "
            "give accelerations only"
        )
    return carried[0]


def _frame_motion(acceleration: Acceleration, center: FloatArray) -> RigidMotion:
    """Return the motion of the base, or of the object, that an acceleration states.

    Args:
        acceleration: The acceleration.
        center: (..., 3) the object's centre of mass, world, m: the point unless another is stated.

    The velocity of the point is taken as zero: a constant velocity of all bodies changes no force.
    """
    point = center if acceleration.at is None else acceleration.at
    v, a = (
        np.cross(point, acceleration.angular_velocity),
        acceleration.linear + np.cross(point, acceleration.angular),
    )
    return RigidMotion(
        *(
            np.concatenate([part, np.broadcast_to(turn, part.shape)], axis=-1)
            for part, turn in ((v, acceleration.angular_velocity), (a, acceleration.angular))
        )
    )


def _is_same_motion(motion: RigidMotion, other_motion: RigidMotion) -> bool:
    return all(
        np.allclose(
            first, second, rtol=0.0, atol=_SAME_MOTION * max(1.0, float(np.abs(first).max()))
        )
        for first, second in zip(motion, other_motion, strict=True)
    )
