"""Which joints of a hand move in a simulation, and what their motors do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.geometry.hand.jointed_bodies import JointedBody
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem import ControlMode
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import SceneContacts


class Axis(NamedTuple):
    """A joint that moves.

    Attributes:
        name: Of the joint; of a hybrid finger, ``FINGER.normal_force``.
        linear: Whether it slides.
        direction: (3,) unit vector, world axes.
        hybrid: Whether it stands for a hybrid finger, which follows along its contact's normal.
    """

    name: str
    linear: bool
    direction: FloatArray
    hybrid: bool


@dataclass(frozen=True, eq=False)
class DrivenJoints:
    """What moves in a hand of n joints.

    Attributes:
        axes: Joint by the index of the body that it moves.
        motors: Names of the joints that have a motor.
        commands: (k,) what each motor does, N m or N.
        idle: (k,) the same while nothing is touched: what carries the hand's own weight.
        carried: (n,) whether a body's weight is borne by a hybrid finger's position control.
    """

    axes: Mapping[int, Axis]
    motors: tuple[str, ...]
    commands: FloatArray
    idle: FloatArray
    carried: NDArray[np.bool_]


NOTHING_DRIVEN = DrivenJoints({}, (), np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool))
"""Without a hand."""


def driven_joints(
    hand: Hand,
    bodies: Sequence[JointedBody],
    contacts: SceneContacts,
    torques: FloatArray,
    gravity_torques: FloatArray,
) -> DrivenJoints:
    """Find what moves: force-controlled joints that move a touching link, and hybrid fingers.

    Joints on common tendons move together.

    Args:
        hand: The hand.
        bodies: Its n bodies.
        contacts: The scene's contacts.
        torques: (L,) the motors' torques: actuators, then commands of hybrid fingers.
        gravity_torques: (L,) the part of them that carries the hand's own weight.
    """
    tree, coupling = hand.tree, hand.tree.coupling
    count = len(hand.actuated_joint_names)
    touching = contacts.arrays.bodies[: contacts.arrays.hand_count]
    moves = tree.supports[[tree.link_joints[link] for link in touching]].any(axis=0)
    forced = np.array([mode is ControlMode.FORCE for mode in hand.control.joints.values()])
    free = forced & (coupling.S[moves] != 0.0).any(axis=0)
    acts = hand.actuation.from_independent != 0.0
    free |= acts[:, acts[free].any(axis=0)].any(axis=1)
    axes = {
        index: Axis(bodies[index].joint, bodies[index].linear, bodies[index].axis, hybrid=False)
        for index in np.flatnonzero((coupling.S[:, free] != 0.0).any(axis=1)).tolist()
    }
    motors = [bodies[index].joint for index in np.array(coupling.leaders)[free].tolist()]
    carried = np.zeros(len(bodies), dtype=bool)
    for index, axis in _hybrid(hand, contacts):
        axes[index] = axis
        motors.append(axis.name)
        carried |= tree.supports[1:, index]
    # The one set of joint torques that the actuators' efforts stand for, see `Actuation`.
    of_efforts = np.linalg.pinv(hand.actuation.from_independent.T)[free]
    commands, idle = (
        np.concatenate([of_efforts @ efforts[:count], efforts[count:]])
        for efforts in (torques, gravity_torques)
    )
    return DrivenJoints(axes, tuple(motors), commands, idle, carried)


def _hybrid(hand: Hand, contacts: SceneContacts) -> Iterator[tuple[int, Axis]]:
    """Yield the first body and the joint of each hybrid finger that touches, as columns of J."""
    touching, tree = contacts.arrays, hand.tree
    for link, normal in zip(touching.bodies[: touching.hand_count], touching.normals, strict=False):
        finger = hand.finger_of(link)
        if finger in hand.control.hybrid_fingers:
            own = [tree.joint_index[joint] for joint in hand.fingers[finger].joints]
            first = min(index for index in own if tree.supports[tree.link_joints[link], index])
            yield first, Axis(f"{finger}.normal_force", linear=True, direction=normal, hybrid=True)
