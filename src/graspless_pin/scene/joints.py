"""The joints of a scene's hand as columns of J: force-controlled joints, then hybrid fingers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from graspless_pin.errors import StateError, StateFault
from graspless_pin.geometry.contact.contact_points import ContactArrays
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.holding.controller import DAMPING, Controller
from graspless_pin.problem.checks import FloatArray, JointUnit
from graspless_pin.problem.fingers import DEFAULT_GAIN


class ControlledJoints(NamedTuple):
    """L joints.

    Attributes:
        jacobian: (3M, L) J of eq. (12), world axes.
        names: L names.
        units: L units of their torques.
        hybrid_count: How many of them, the last ones, are hybrid fingers.
    """

    jacobian: FloatArray
    names: tuple[str, ...]
    units: tuple[JointUnit, ...]
    hybrid_count: int = 0


def joint_columns(hand: Hand | None, touching: ContactArrays) -> ControlledJoints:
    """Return the force-controlled joints, then the hybrid fingers.

    Args:
        hand: At its configuration; None: there is no column.
        touching: M contacts, hand first.

    Raises:
        StateError: If a hybrid finger touches at several points.
    """
    if hand is None:
        return ControlledJoints(np.zeros((3 * len(touching), 0)), (), ())
    count = touching.hand_count
    links = (*touching.bodies[:count], *(None,) * (len(touching.bodies) - count))
    jacobian = hand.contact_jacobian(links, touching.positions)
    joints = ControlledJoints(jacobian, hand.actuated_joint_names, hand.effort_units)
    return _with_hybrid_fingers(joints, hand, touching) if hand.control.hybrid_fingers else joints


def torque_limits(
    hand: Hand | None, hybrid_count: int, limit: float
) -> tuple[FloatArray, FloatArray]:
    """Return (lower, upper), each (L,), N m or N.

    Args:
        hand: See `joint_columns`.
        hybrid_count: See `ControlledJoints`.
        limit: Largest commanded force of a hybrid finger, N.
    """
    if hand is None:
        return np.zeros(0), np.zeros(0)
    lower, upper = hand.effort_limits
    if not hybrid_count:
        return lower, upper
    none = np.zeros(hybrid_count)
    return np.concatenate([lower, none]), np.concatenate([upper, none + limit])


def weight_torques(hand: Hand | None, hybrid_count: int, gravity: FloatArray | None) -> FloatArray:
    """Return (L,) g(q), the torques that carry the links' weight.

    Args:
        hand: See `joint_columns`.
        hybrid_count: See `ControlledJoints`.
        gravity: (3,) m/s^2, world axes; None: the links weigh nothing.
    """
    count = 0 if hand is None else len(hand.actuated_joint_names)
    if hand is None or gravity is None or not count:
        own = np.zeros(count)
    else:
        own = hand.gravity_torques(gravity)
    return np.concatenate([own, np.zeros(hybrid_count)]) if hybrid_count else own


def possible_columns(hand: Hand | None) -> dict[str, JointUnit]:
    """Return the units by name of all columns that `joint_columns` may have, whatever touches."""
    if hand is None:
        return {}
    forces = dict.fromkeys(map(_column_of, hand.control.hybrid_fingers), JointUnit.FORCE)
    return dict(zip(hand.actuated_joint_names, hand.effort_units, strict=True)) | forces


def inertia_of_columns(hand: Hand | None, count: int) -> FloatArray:
    """Return the (L, L) inertia of the columns of J: zero where a hybrid finger commands a force.

    Args:
        hand: At its configuration; None: there is no column.
        count: L.
    """
    inertia = np.zeros((count, count))
    if hand is not None:
        own = hand.joint_inertia()
        inertia[: len(own), : len(own)] = own
    return inertia


def fingers_of_motors(hand: Hand) -> dict[str, str]:
    """Return the finger of each motor that moves links of one finger alone."""
    moved: dict[str, set[str | None]] = {}
    for link, carrier in hand.tree.link_joints.items():
        own = np.abs(hand.actuation.from_joints[hand.tree.supports[carrier]]).sum(axis=0)
        for column in np.flatnonzero(own):
            moved.setdefault(hand.actuation.names[column], set()).add(hand.finger_of(link))
    return {
        name: finger
        for name, of in moved.items()
        if len(of - {None}) == 1
        for finger in of
        if finger is not None
    }


def _with_hybrid_fingers(
    joints: ControlledJoints, hand: Hand, touching: ContactArrays
) -> ControlledJoints:
    """Append a column n for the one contact of each hybrid finger (Sec. II-A)."""
    names = list(joints.names)
    hybrid = [
        index
        for index, link in enumerate(touching.bodies[: touching.hand_count])
        if hand.is_hybrid(link)
    ]
    columns = np.zeros((len(joints.jacobian), len(hybrid)))
    for column, index in enumerate(hybrid):
        columns[3 * index : 3 * index + 3, column] = touching.normals[index]
        finger = hand.finger_of(touching.bodies[index])
        name = _column_of(finger)
        if name in names:
            raise StateError(
                StateFault.AMBIGUOUS,
                f"hybrid finger {finger!r} touches the object at several points; a hybrid finger "
                "has exactly one contact: give the contacts, or control it by force",
            )
        names.append(name)
    units = (*joints.units, *(JointUnit.FORCE for _ in hybrid))
    jacobian = np.hstack([joints.jacobian, columns])
    return ControlledJoints(jacobian, tuple(names), units, len(hybrid))


def _column_of(finger: str | None) -> str:
    """Return the name of a hybrid finger's column."""
    return f"{finger}.normal_force"


def gains_of_robots(hand: Hand) -> Controller:
    """Return what the robot files of a hand say of the feedback at its joints.

    Gains of one robot's ``default``, or of all its joints, are those of each of its fingers; with
    one robot without a prefix, of all joints. Where no file states any, it is not decided.

    Raises:
        RobotError: If a file states gains of what is no joint or finger.
    """
    robots = [(mount.prefix, mount.robot()) for mount in hand.mounts]
    if all(robot.stiffness is None for _, robot in robots):
        return Controller()
    known = [*hand.actuation.names, *hand.fingers]
    for prefix, robot in robots:
        robot.check_gains([one.removeprefix(prefix) for one in known if one.startswith(prefix)])
    gains: dict[str, dict[str, float]] = {"stiffness": {}, "damping": {}}
    for kind, found in gains.items():
        for prefix, robot in robots:
            stated = getattr(robot, kind)
            own = dict(stated) if isinstance(stated, Mapping) else {DEFAULT_GAIN: stated}
            rest = own.pop(DEFAULT_GAIN, None)
            if rest is not None and not prefix:
                found[DEFAULT_GAIN] = rest
            elif rest is not None:
                found |= {name: rest for name in hand.fingers if name.startswith(prefix)}
            found |= {prefix + name: gain for name, gain in own.items()}
    return Controller(gains["stiffness"], gains["damping"] or DAMPING)
