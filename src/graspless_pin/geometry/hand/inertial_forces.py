"""Inertial forces of a hand that moves: what its links need beside what carries their weight.

Arrays may have axes in front, for many configurations or motions at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from graspless_pin.geometry.hand.configuration import independent_rates
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.problem.checks import FloatArray


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
        borne = hand.tree.moves.T @ self.wrenches
        return np.einsum("...ij,...ji->...j", self.kinematics.J, borne) + self.rotors

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
