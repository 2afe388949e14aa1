"""The spatial columns of a hand's joints, and how they change as other joints move."""

from __future__ import annotations

import numpy as np

from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray


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
