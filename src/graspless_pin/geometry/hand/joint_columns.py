"""A hand's joints in numpy alone: their spatial columns, how these change, and the bodies on them.

That is what gradients and stiffness are worked out of, and what another program needs to move it.

Besides, the inertial forces of a hand that moves: what its links need beside what carries their
weight. There, arrays may have axes in front, for many configurations or motions at once.
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
    """The spatial columns of all joints of a hand and how each moves the others.

    Attributes:
        linear: (n, 3) v_j about the world's origin.
        angular: (n, 3) omega_j.
        supports: (n + 1, n) whether joint j moves what is on Pinocchio joint i.
    """

    def __init__(self, hand: Hand) -> None:
        """Work out the columns at the hand's configuration."""
        kinematics = hand.tree.kinematics(hand.positions)
        self.linear: FloatArray = kinematics.J[:3].T
        self.angular: FloatArray = kinematics.J[3:].T
        self.T_world_joint = kinematics.T_world_joint
        self.supports = hand.tree.supports
        # [k, j]: does joint k carry joint j along?
        carried = self.supports[1:].T[:, :, None]
        v, w = self.linear, self.angular
        self._turned: FloatArray = carried * np.cross(w[:, None], w[None])
        self._shifted: FloatArray = carried * (
            np.cross(w[:, None], v[None]) + np.cross(v[:, None], w[None])
        )

    def velocity(self, link: int, point: FloatArray) -> FloatArray:
        """Return (3, n) the velocities of a point of a link per joint rate."""
        arms = self.linear + np.cross(self.angular, point)
        return (arms * self.supports[link][:, None]).T

    def rotation(self, link: int) -> FloatArray:
        """Return (3, n) the angular velocities of a link per joint rate."""
        return (self.angular * self.supports[link][:, None]).T

    def change_of_columns(self, link: int, point: FloatArray, move: FloatArray) -> FloatArray:
        """Return how the Jacobian of a point changes, its columns those of all joints.

        Args:
            link: Pinocchio joint that carries the point.
            point: (3,) p, world, m.
            move: (3, k) how the point moves in k motions, at least n: the first n are those of the
                joints, and in the others they stand still.

        Returns:
            (3, n, k) entry [:, a, b] is how the velocity per rate of joint a changes in motion b.
        """
        mask = self.supports[link][:, None]
        change = np.cross(self.angular[:, None], move.T[None])
        change[:, : len(mask)] += (self._shifted + np.cross(self._turned, point)).swapaxes(0, 1)
        return (mask[:, None] * change).transpose(2, 0, 1)

    def change_of_velocities(
        self, link: int, point: FloatArray, move: FloatArray, rates: FloatArray
    ) -> FloatArray:
        """Return how the velocities of a point change along motions: d_b (J(p) rates_a).

        Args:
            link: Pinocchio joint that carries the point.
            point: (3,) p, world, m.
            move: (3, d) how it moves in each motion, m.
            rates: (n, d) joint rates of each motion.

        Returns:
            (3, d, d): entry [:, a, b] is that of the velocity in motion a along motion b.
        """
        own = rates * self.supports[link][:, None]
        carried = self._shifted + np.cross(self._turned, point)
        turning = own.T @ self.angular
        return np.einsum("kji,ja,kb->iab", carried, own, rates) + np.cross(
            turning[:, None], move.T[None]
        ).transpose(2, 0, 1)

    def change_of_rotations(self, link: int, rates: FloatArray) -> FloatArray:
        """Return how a link's angular velocities change along motions: (3, d, d).

        Args:
            link: Pinocchio joint that carries it.
            rates: (n, d) joint rates of each motion.
        """
        own = rates * self.supports[link][:, None]
        return np.einsum("kji,ja,kb->iab", self._turned, own, rates)


@dataclass(frozen=True, eq=False)
class JointedBody(Record):
    """A movable joint and all that is fixed to its far side, up to the next joints.

    Attributes:
        joint: Name of the joint.
        parent: Index of the body that the joint hangs on among the hand's n; None: the world.
        linear: Whether the joint slides.
        axis: (3,) unit vector of the joint, world axes; it passes through the body's origin.
        T_world_body: (4, 4) pose of the body's frame, m.
        mass: kg.
        center_of_mass: (3,) in the body's frame, m.
        inertia: (3, 3) about the centre of mass, axes of the body's frame, kg m^2.
        rotor_inertia: What the motor adds behind its gear, kg m^2, or kg of a joint that slides.
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
        carried = model.inertias[index + 1]
        parent = int(model.parents[index + 1]) - 1
        linear = kind == "prismatic"
        bodies.append(
            JointedBody(
                name,
                parent if parent >= 0 else None,
                linear,
                placed.J[:3, index] if linear else placed.J[3:, index],
                placed.T_world_joint[index + 1],
                float(carried.mass),
                read_only(np.array(carried.lever)),
                read_only(np.array(carried.inertia)),
                float(model.armature[index]),
            )
        )
    return tuple(bodies)


class PlacedLink(NamedTuple):
    """A link where it is while all joints of a hand stand at zero.

    Attributes:
        name: Of the link.
        parent: The link that it hangs on; None: the world.
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
    """How a frame moves at one moment, both about the world's origin, in world axes.

    Attributes:
        velocity: (..., 6) spatial velocity [v; omega], m/s and rad/s.
        acceleration: (..., 6) spatial acceleration, the rate of change of the velocity as the
            moving frame has it, m/s^2 and rad/s^2.
    """

    velocity: FloatArray
    acceleration: FloatArray

    def acceleration_of(self, point: FloatArray) -> FloatArray:
        """Return (..., 3) the acceleration of points (..., 3) of the frame, m/s^2."""
        (v, w), (a, alpha) = np.split(self.velocity, 2, -1), np.split(self.acceleration, 2, -1)
        return a + np.cross(alpha, point) + np.cross(w, v + np.cross(w, point))


STILL = RigidMotion(np.zeros(6), np.zeros(6))


class HandMotions(NamedTuple):
    """How what a hand's joints carry moves.

    Attributes:
        kinematics: Where it is.
        carried: (..., n + 1) motions of what Pinocchio's joints carry, the base first.
        wrenches: (..., n + 1, 6) [force; moment] about the world's origin that move it so, N and
            N m, beside what carries its weight; zeros for the base.
        rotors: (..., n) torques that turn the motors' rotors so, N m or N.
    """

    kinematics: Kinematics
    carried: RigidMotion
    wrenches: FloatArray
    rotors: FloatArray

    def of(self, joint: int) -> RigidMotion:
        """Return the motion of what one of Pinocchio's joints carries."""
        velocity, acceleration = self.carried
        return RigidMotion(velocity[..., joint, :], acceleration[..., joint, :])

    def inertial_wrenches(self, hand: Hand) -> FloatArray:
        """Return (..., n + 1, 6) the opposite wrenches about the centre of mass of what moves.

        World axes, N and N m: what bears on it in the frame that moves along.
        """
        force, moment = np.split(-self.wrenches, 2, -1)
        at = _centers(hand, self.kinematics)
        return np.concatenate([force, moment - np.cross(at, force)], axis=-1)

    def joint_torques(self, hand: Hand) -> FloatArray:
        """Return (..., n) the torques of all joints that move the links so, N m or N."""
        carried = hand.tree.moves.T @ self.wrenches
        return np.einsum("...ij,...ji->...j", self.kinematics.J, carried) + self.rotors

    def torques(self, hand: Hand) -> FloatArray:
        """Return (..., L) the efforts of the actuators that move the links so, N m or N."""
        return self.joint_torques(hand) @ hand.actuation.from_joints


def hand_motions(
    hand: Hand,
    base: RigidMotion,
    velocities: Mapping[str, float],
    accelerations: Mapping[str, float],
    kinematics: Kinematics | None = None,
) -> HandMotions:
    """Return how a hand's links move, and what that takes: Newton's and Euler's equations.

    Args:
        hand: The hand.
        base: Motion of all bases as one rigid body.
        velocities: Rates of independent joints by name, rad/s or m/s; the others stand still.
            Joints that follow them do so.
        accelerations: Likewise, rad/s^2 or m/s^2.
        kinematics: Where it is; None: at its configuration.

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
    """Return how a hand's links move: see `hand_motions`.

    Args:
        hand: The hand.
        at: Where it is.
        base: Motion of all bases as one rigid body.
        rates: (..., n) of all joints, rad/s or m/s.
        changes: (..., n) their rates, rad/s^2 or m/s^2.
    """
    tree, columns = hand.tree, np.swapaxes(at.J, -1, -2)
    own = columns * rates[..., None]
    velocity = base.velocity[..., None, :] + tree.moves @ own
    (v, w), (along, about) = (np.split(part, 2, -1) for part in (velocity[..., 1:, :], own))
    # The columns move with what their joints carry.
    turned = np.cross(w, along) + np.cross(v, about), np.cross(w, about)
    bends = columns * changes[..., None] + np.concatenate(turned, axis=-1)
    carried = RigidMotion(velocity, base.acceleration[..., None, :] + tree.moves @ bends)
    center, (masses, _) = _centers(hand, at), tree.masses
    force = masses[:, None] * carried.acceleration_of(center)
    R = at.T_world_joint[..., :3, :3]
    inertia = R @ tree.rotational_inertias @ np.swapaxes(R, -1, -2)
    w, alpha = velocity[..., 3:], carried.acceleration[..., 3:]
    turning, spin = ((inertia @ one[..., None])[..., 0] for one in (alpha, w))
    moment = turning + np.cross(w, spin) + np.cross(center, force)
    wrenches = np.concatenate([force, moment], axis=-1)
    wrenches[..., 0, :] = 0.0
    return HandMotions(at, carried, wrenches, tree.armature * changes)


def _centers(hand: Hand, at: Kinematics) -> FloatArray:
    """Return (..., n + 1, 3) centres of mass of what joints carry; without mass the joint."""
    masses, centers = hand.tree.masses
    own = np.where(masses[:, None] > 0.0, centers, 0.0)
    T = at.T_world_joint
    return (T[..., :3, :3] @ own[..., None])[..., 0] + T[..., :3, 3]
