"""How the arrays of a problem change as its contacts and the hand's joints move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from graspless_pin.algorithms.gradients import Gradients
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.joint_columns import JointColumns
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import Scene
from graspless_pin.scene.load_wrenches import load_rates
from graspless_pin.scene.loads import Accelerated


class ContactRates(NamedTuple):
    """How M contacts move in k motions, of which the first n are those of the movable joints.

    Attributes:
        moves: (M, 3, k) of the points, m.
        turns: (M, 3, k) rotation of normal and tangents, rad.
        center: (3, k) of the object's centre of mass, m.
        turning: (3, k) of the object, rad.
    """

    moves: FloatArray
    turns: FloatArray
    center: FloatArray
    turning: FloatArray


@dataclass(frozen=True, eq=False)
class ProblemRates:
    """First derivatives of a problem's data in k motions, by the names that `Gradients` has."""

    positions: FloatArray
    normals: FloatArray
    spins: FloatArray
    external_wrench: FloatArray
    jacobian: FloatArray
    gravity_torques: FloatArray

    def reduced(self, coupling: FloatArray) -> ProblemRates:
        """Return those by the independent joints and the motions after the joints.

        Args:
            coupling: (n, a) see `Coupling`.
        """
        n = len(coupling)
        parts = {
            name: np.concatenate([rates[..., :n] @ coupling, rates[..., n:]], axis=-1)
            for name, rates in vars(self).items()
        }
        return ProblemRates(**parts)

    def of(self, by: Gradients) -> FloatArray:
        """Return (k,) what derivatives by the data come to."""
        return sum(
            (
                np.tensordot(getattr(by, name), rates, rates.ndim - 1)
                for name, rates in vars(self).items()
            ),
            start=np.zeros(self.positions.shape[-1]),
        )


def problem_rates(
    scene: Scene, columns: JointColumns | None, joint_count: int, contacts: ContactRates
) -> ProblemRates:
    """Return how a scene's problem changes.

    Args:
        scene: The scene.
        columns: The joint columns of its hand; None: it has none.
        joint_count: Columns of the problem's Jacobian.
        contacts: How its contacts move.

    Raises:
        ArgumentError: If its acceleration turns or moves joints.
    """
    if scene.acceleration is not None and not scene.acceleration.is_translation:
        raise ArgumentError(
            "evaluation",
            "is of a scene whose acceleration turns or moves joints: inertial forces change with "
            "the joints in ways that are not known; leave it out, or let it be 'linear' alone",
        )
    arrays, hand = scene.contacts.arrays, scene.hand
    normals, (moves, turns, center, turning) = arrays.normals, contacts
    turned = np.cross(turns, normals[:, :, None], axis=1)
    count, k = len(normals), moves.shape[-1]
    jacobian, weights = np.zeros((count, 3, joint_count, k)), np.zeros((joint_count, k))
    if hand is not None and columns is not None:
        to_actuators = hand.actuation.from_joints
        actuators = hybrid = to_actuators.shape[1]
        for row in range(arrays.hand_count):
            link = hand.tree.link_joints[arrays.bodies[row]]
            change = columns.change_of_columns(link, arrays.positions[row], moves[row])
            jacobian[row, :, :actuators] = np.einsum("ijk,jl->ilk", change, to_actuators)
            if hand.is_hybrid(arrays.bodies[row]):
                # The commanded force of a hybrid finger has the normal for its column.
                jacobian[row, :, hybrid] = turned[row]
                hybrid += 1
        if scene.count_own_weight:
            told, pulling = scene.acceleration, scene.gravity
            if told is not None and told.of is Accelerated.BASE:
                pulling = pulling - told.linear
            masses, centers = hand.tree.masses
            of_joints = np.zeros((len(to_actuators), k))
            for link in range(1, len(masses)):
                T = columns.T_world_joint[link]
                place = T[:3, :3] @ centers[link] + T[:3, 3]
                move = np.zeros((3, k))
                move[:, : len(of_joints)] = columns.velocity(link, place)
                change = columns.change_of_columns(link, place, move)
                of_joints -= masses[link] * np.tensordot(pulling, change, 1)
            weights[:actuators] = to_actuators.T @ of_joints
    return ProblemRates(
        moves - center,
        turned,
        np.einsum("mi,mik->mk", normals, turns),
        load_rates(scene, turning),
        jacobian.reshape(3 * count, joint_count, k),
        weights,
    )
