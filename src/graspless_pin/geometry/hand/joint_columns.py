"""A hand's joints in numpy alone: spatial columns, their derivatives, and the bodies on them.

Gradients and stiffness are computed from these, and other programs need them to move the hand.

Also the inertial forces of a moving hand: the wrenches that accelerate its links, in addition to
gravity compensation. There, arrays may have leading axes for many configurations or motions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from graspless_pin.geometry.hand.configuration import independent_rates
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.work_space import Kinematics, joint_motions
from graspless_pin.geometry.poses import invert
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import Record


class JointColumns:
    """The spatial columns of all joints of a hand and their derivatives.

    Attributes:
        linear: (n, 3) v_j about the world's origin.
        angular: (n, 3) omega_j.
        supports: (n + 1, n) whether joint j moves the body of Pinocchio joint i.
    """

    def __init__(self, hand: Hand) -> None:
        """Compute the columns at the hand's configuration."""
        kinematics = hand.tree.kinematics(hand.positions)
        self.linear: FloatArray = kinematics.J[:3].T
        self.angular: FloatArray = kinematics.J[3:].T
        self.T_world_joint = kinematics.T_world_joint
        self.supports = hand.tree.supports
        is_moved = self.supports[1:].T[:, :, None]  # [k, j]: whether joint k moves joint j
        v, w = self.linear, self.angular
        self._turned: FloatArray = is_moved * np.cross(w[:, None], w[None])
        self._shifted: FloatArray = is_moved * (
            np.cross(w[:, None], v[None]) + np.cross(v[:, None], w[None])
        )

    def velocity(self, link: int, point: FloatArray) -> FloatArray:
        """Return the (3, n) velocities of a point of a link per joint rate."""
        arms = self.linear + np.cross(self.angular, point)
        return (arms * self.supports[link][:, None]).T

    def rotation(self, link: int) -> FloatArray:
        """Return the (3, n) angular velocities of a link per joint rate."""
        return (self.angular * self.supports[link][:, None]).T

    def change_of_columns(self, link: int, point: FloatArray, move: FloatArray) -> FloatArray:
        """Return the derivative of the Jacobian of a point, with the columns of all joints.

        Args:
            link: Pinocchio joint that carries the point.
            point: (3,) p, world, m.
            move: (3, k) velocities of the point in k motions, at least n: the first n are those of
                the joints, and in the others the joints do not move.

        Returns:
            (3, n, k) entry [:, a, b] is the rate of the velocity per rate of joint a in motion b.
        """
        mask = self.supports[link][:, None]
        change = np.cross(self.angular[:, None], move.T[None])
        change[:, : len(mask)] += (self._shifted + np.cross(self._turned, point)).swapaxes(0, 1)
        return (mask[:, None] * change).transpose(2, 0, 1)

    def change_of_velocities(
        self, link: int, point: FloatArray, move: FloatArray, rates: FloatArray
    ) -> FloatArray:
        """Return the derivatives of a point's velocities along motions: d_b (J(p) rates_a).

        Args:
            link: Pinocchio joint that carries the point.
            point: (3,) p, world, m.
            move: (3, d) displacement of the point in each motion, m.
            rates: (n, d) joint rates of each motion.

        Returns:
            (3, d, d): entry [:, a, b] is the derivative of the velocity in motion a along motion b.
        """
        own = rates * self.supports[link][:, None]
        column_rates = self._shifted + np.cross(self._turned, point)
        turning = own.T @ self.angular
        return np.einsum("kji,ja,kb->iab", column_rates, own, rates) + np.cross(
            turning[:, None], move.T[None]
        ).transpose(2, 0, 1)

    def change_of_rotations(self, link: int, rates: FloatArray) -> FloatArray:
        """Return the (3, d, d) derivatives of a link's angular velocities along motions.

        Args:
            link: Pinocchio joint that carries it.
            rates: (n, d) joint rates of each motion.
        """
        own = rates * self.supports[link][:, None]
        return np.einsum("kji,ja,kb->iab", self._turned, own, rates)


@dataclass(frozen=True, eq=False)
class JointedBody(Record):
    """A movable joint and the rigid body that it carries, up to the next joints.

    Attributes:
        joint: Name of the joint.
        parent: Index of the joint's parent body among the hand's n; None: the world.
        linear: Whether the joint is prismatic.
        axis: (3,) unit vector of the joint, world axes; it passes through the body's origin.
        T_world_body: (4, 4) pose of the body's frame, m.
        mass: kg.
        center_of_mass: (3,) in the body's frame, m.
        inertia: (3, 3) about the centre of mass, axes of the body's frame, kg m^2.
        rotor_inertia: Reflected inertia of the motor's rotor, kg m^2, or kg for a prismatic joint.
    """

    joint: str
    parent: int | None
    linear: bool
    axis: FloatArray
    T_world_body: FloatArray
    mass: float
    center_of_mass: FloatArray
    inertia: FloatArray
    rotor_inertia: float


def jointed_bodies(hand: Hand) -> tuple[JointedBody, ...]:
    """Return the bodies of a hand at its configuration, one for each of its n movable joints."""
    tree = hand.tree
    model, placed = tree.pinocchio_model, tree.kinematics(hand.positions)
    bodies = []
    for index, (name, kind) in enumerate(zip(tree.joint_names, tree.joint_kinds, strict=True)):
        inertia = model.inertias[index + 1]
        parent = int(model.parents[index + 1]) - 1
        linear = kind == "prismatic"
        bodies.append(
            JointedBody(
                name,
                parent if parent >= 0 else None,
                linear,
                placed.J[:3, index] if linear else placed.J[3:, index],
                placed.T_world_joint[index + 1],
                float(inertia.mass),
                read_only(np.array(inertia.lever)),
                read_only(np.array(inertia.inertia)),
                float(model.armature[index]),
            )
        )
    return tuple(bodies)


class PlacedLink(NamedTuple):
    """A link and its pose with all joints of a hand at zero.

    Attributes:
        name: Name of the link.
        parent: The parent link; None: the world.
        joint: Index of the movable joint between the two among the hand's n; None: it is fixed.
        T_parent_link: (4, 4) pose in the parent's frame, m.
        T_joint_link: (4, 4) pose in the frame of the joint that moves it, m.
    """

    name: str
    parent: str | None
    joint: int | None
    T_parent_link: FloatArray
    T_joint_link: FloatArray


def placed_links(hand: Hand) -> tuple[PlacedLink, ...]:
    """Return the links of a hand, parents before children; a joint's frame is its link's."""
    tree = hand.tree
    parents, steps, _ = joint_motions(tree)
    poses = [np.eye(4)]
    for joint in range(1, len(parents)):
        poses.append(poses[parents[joint]] @ steps[joint])
    frames = tree.pinocchio_model.frames
    placements = {link: frames[k].placement.homogeneous for link, k in tree.link_frames.items()}
    at_zero = {link: poses[tree.link_joints[link]] @ T for link, T in placements.items()}
    links = []
    for link, parent in tree.parent_links.items():
        own, above = tree.link_joints[link], 0 if parent is None else tree.link_joints[parent]
        T = at_zero[link] if parent is None else invert(at_zero[parent]) @ at_zero[link]
        joint = own - 1 if own != above else None
        links.append(PlacedLink(link, parent, joint, T, placements[link]))
    return tuple(links)


class RigidMotion(NamedTuple):
    """Spatial velocity and acceleration of a frame, both about the world's origin, world axes.

    Attributes:
        velocity: (..., 6) spatial velocity [v; omega], m/s and rad/s.
        acceleration: (..., 6) spatial acceleration, the rate of change of the spatial velocity of
            the moving frame, m/s^2 and rad/s^2.
    """

    velocity: FloatArray
    acceleration: FloatArray

    def acceleration_of(self, point: FloatArray) -> FloatArray:
        """Return the (..., 3) accelerations of points (..., 3) of the frame, m/s^2."""
        (v, w), (a, alpha) = np.split(self.velocity, 2, -1), np.split(self.acceleration, 2, -1)
        return a + np.cross(alpha, point) + np.cross(w, v + np.cross(w, point))


STILL = RigidMotion(np.zeros(6), np.zeros(6))


class HandMotions(NamedTuple):
    """Motions of the bodies of a hand's joints, and the wrenches that they take.

    Attributes:
        kinematics: Joint poses and Jacobian columns of the hand.
        carried: (..., n + 1) motions of the bodies of Pinocchio's joints, the base first.
        wrenches: (..., n + 1, 6) [force; moment] about the world's origin that accelerate the
            bodies, N and N m, in addition to gravity compensation; zeros for the base.
        rotors: (..., n) torques that accelerate the motors' rotors, N m or N.
    """

    kinematics: Kinematics
    carried: RigidMotion
    wrenches: FloatArray
    rotors: FloatArray

    def motion_of_joint(self, joint: int) -> RigidMotion:
        """Return the motion of the body of one of Pinocchio's joints."""
        velocity, acceleration = self.carried
        return RigidMotion(velocity[..., joint, :], acceleration[..., joint, :])

    def inertial_wrenches(self, hand: Hand) -> FloatArray:
        """Return (..., n + 1, 6) the inertial wrenches about the bodies' centres of mass.

        World axes, N and N m: the negative ``wrenches``, as they act in the moving frames.
        """
        force, moment = np.split(-self.wrenches, 2, -1)
        centers = _mass_centers(hand, self.kinematics)
        return np.concatenate([force, moment - np.cross(centers, force)], axis=-1)

    def joint_torques(self, hand: Hand) -> FloatArray:
        """Return the (..., n) torques of all joints for these motions, N m or N."""
        joint_wrenches = hand.tree.moves.T @ self.wrenches
        return np.einsum("...ij,...ji->...j", self.kinematics.J, joint_wrenches) + self.rotors

    def torques(self, hand: Hand) -> FloatArray:
        """Return the (..., L) efforts of the actuators for these motions, N m or N."""
        return self.joint_torques(hand) @ hand.actuation.from_joints


def hand_motions(
    hand: Hand,
    base: RigidMotion,
    velocities: Mapping[str, float],
    accelerations: Mapping[str, float],
    kinematics: Kinematics | None = None,
) -> HandMotions:
    """Return the motions of a hand's links and their wrenches by the Newton-Euler equations.

    Args:
        hand: The hand.
        base: Motion of all bases as one rigid body.
        velocities: Rates of independent joints by name, rad/s or m/s, zero if not named. Coupled
            joints follow.
        accelerations: Likewise, rad/s^2 or m/s^2.
        kinematics: Joint poses and Jacobian columns; None: at the hand's configuration.

    Raises:
        ArgumentError: If a name is unknown or a coupled joint's, or a number not finite.
    """
    tree = hand.tree
    rates, changes = (
        tree.coupling.S @ independent_rates(tree, given, argument)
        for argument, given in (
            ("joint_velocities", velocities),
            ("joint_accelerations", accelerations),
        )
    )
    at = tree.kinematics(hand.positions) if kinematics is None else kinematics
    return motions_at(hand, at, base, rates, changes)


def motions_at(
    hand: Hand, at: Kinematics, base: RigidMotion, rates: FloatArray, changes: FloatArray
) -> HandMotions:
    """Return the motions of a hand's links and their wrenches: see `hand_motions`.

    Args:
        hand: The hand.
        at: Joint poses and Jacobian columns.
        base: Motion of all bases as one rigid body.
        rates: (..., n) rates of all joints, rad/s or m/s.
        changes: (..., n) accelerations of all joints, rad/s^2 or m/s^2.
    """
    tree, columns = hand.tree, np.swapaxes(at.J, -1, -2)
    twists = columns * rates[..., None]
    velocity = base.velocity[..., None, :] + tree.moves @ twists
    (v, w), (along, about) = (np.split(part, 2, -1) for part in (velocity[..., 1:, :], twists))
    # The columns move with the bodies of their joints.
    column_rates = np.cross(w, along) + np.cross(v, about), np.cross(w, about)
    twist_rates = columns * changes[..., None] + np.concatenate(column_rates, axis=-1)
    carried = RigidMotion(velocity, base.acceleration[..., None, :] + tree.moves @ twist_rates)
    center, (masses, _) = _mass_centers(hand, at), tree.masses
    force = masses[:, None] * carried.acceleration_of(center)
    R = at.T_world_joint[..., :3, :3]
    inertia = R @ tree.rotational_inertias @ np.swapaxes(R, -1, -2)
    w, alpha = velocity[..., 3:], carried.acceleration[..., 3:]
    turning, spin = ((inertia @ one[..., None])[..., 0] for one in (alpha, w))
    moment = turning + np.cross(w, spin) + np.cross(center, force)
    wrenches = np.concatenate([force, moment], axis=-1)
    wrenches[..., 0, :] = 0.0
    return HandMotions(at, carried, wrenches, tree.armature * changes)


def _mass_centers(hand: Hand, at: Kinematics) -> FloatArray:
    """Return (..., n + 1, 3) centres of mass of the joints' bodies; without mass, the joint."""
    masses, centers = hand.tree.masses
    local_centers = np.where(masses[:, None] > 0.0, centers, 0.0)
    T = at.T_world_joint
    return (T[..., :3, :3] @ local_centers[..., None])[..., 0] + T[..., :3, 3]
