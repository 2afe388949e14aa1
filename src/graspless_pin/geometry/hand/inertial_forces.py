"""Inertial forces of a hand that moves: what its links need beside what carries their weight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from graspless_pin.geometry.hand.configuration import independent_rates
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray, read_only


class RigidMotion(NamedTuple):
    """How a frame moves at one moment, both about the world's origin, in world axes.

    Attributes:
        velocity: (6,) spatial velocity [v; omega], m/s and rad/s.
        acceleration: (6,) spatial acceleration, the rate of change of the velocity as the moving
            frame has it, m/s^2 and rad/s^2.
    """

    velocity: FloatArray
    acceleration: FloatArray

    def acceleration_of(self, point: FloatArray) -> FloatArray:
        """Return (3,) the acceleration of a point (3,) of the frame, m/s^2."""
        (v, w), (a, alpha) = np.split(self.velocity, 2), np.split(self.acceleration, 2)
        return a + np.cross(alpha, point) + np.cross(w, v + np.cross(w, point))


STILL = RigidMotion(np.zeros(6), np.zeros(6))


class HandMotions(NamedTuple):
    """How what a hand's joints carry moves.

    Attributes:
        joints: n + 1 motions of what Pinocchio's joints carry, the base first.
        wrenches: (n + 1, 6) [force; moment] about the world's origin that move it so, N and N m,
            beside what carries its weight.
        rotors: (n,) torques that turn the motors' rotors so, N m or N.
    """

    joints: tuple[RigidMotion, ...]
    wrenches: FloatArray
    rotors: FloatArray

    def inertial_wrenches(self, hand: Hand) -> FloatArray:
        """Return (n + 1, 6) the opposite wrenches about the centre of mass of what moves.

        World axes, N and N m: what bears on it in the frame that moves along.
        """
        (masses, centers), T = hand.tree.masses, hand.tree.kinematics(hand.positions).T_world_joint
        own = np.where(masses[:, None] > 0.0, centers, 0.0)
        at = np.einsum("ijk,ik->ij", T[:, :3, :3], own) + T[:, :3, 3]
        force, moment = -self.wrenches[:, :3], -self.wrenches[:, 3:]
        return np.hstack([force, moment - np.cross(at, force)])

    def joint_torques(self, hand: Hand) -> FloatArray:
        """Return (n,) the torques of all joints that move the links so, N m or N."""
        J = hand.tree.kinematics(hand.positions).J
        return np.einsum("ij,kj,ik->j", hand.tree.moves, J, self.wrenches) + self.rotors

    def torques(self, hand: Hand) -> FloatArray:
        """Return (L,) the efforts of the actuators that move the links so, N m or N."""
        return self.joint_torques(hand) @ hand.actuation.from_joints


def hand_motions(
    hand: Hand,
    base: RigidMotion,
    velocities: Mapping[str, float],
    accelerations: Mapping[str, float],
) -> HandMotions:
    """Return how a hand's links move, and what that takes: Newton's and Euler's equations.

    Args:
        hand: The hand at its configuration.
        base: Motion of all bases as one rigid body.
        velocities: Rates of independent joints by name, rad/s or m/s; the others stand still.
            Joints that follow them do so.
        accelerations: Likewise, rad/s^2 or m/s^2.

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
    model = tree.pinocchio_model
    data = model.createData()
    pin.forwardKinematics(model, data, tree.configuration(hand.positions), rates, changes)
    v_base, a_base = pin.Motion(base.velocity), pin.Motion(base.acceleration)
    joints, wrenches = [base], [np.zeros(6)]
    for joint in range(1, model.njoints):
        T, inertia = data.oMi[joint], model.inertias[joint]
        carried = T.actInv(v_base)
        velocity = carried + data.v[joint]
        # The base's acceleration is seen from a joint that turns against it.
        acceleration = T.actInv(a_base) + data.a[joint] + carried.cross(data.v[joint])
        wrench = inertia * acceleration + velocity.cross(inertia * velocity)
        joints.append(RigidMotion(T.act(velocity).vector, T.act(acceleration).vector))
        wrenches.append(T.act(wrench).vector)
    rotors = read_only(tree.armature * changes)
    return HandMotions(tuple(joints), read_only(np.array(wrenches)), rotors)
