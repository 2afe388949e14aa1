"""The joints of a scene's hand as columns of J: force-controlled joints, then hybrid fingers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from graspless_pin.errors import StateError, StateFault
from graspless_pin.geometry.contact.contact_points import ContactArrays
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.joint_units import JointUnit


class ControlledJoints(NamedTuple):
    """L joints.

    Attributes:
        jacobian: (3M, L) J of eq. (12), world axes.
        limits: (lower, upper), each (L,), N m or N.
        gravity_torques: (L,) g(q).
        names: L names.
        units: L units of their torques.
    """

    jacobian: FloatArray
    limits: tuple[FloatArray, FloatArray]
    gravity_torques: FloatArray
    names: tuple[str, ...]
    units: tuple[JointUnit, ...]


def joint_columns(
    hand: Hand | None, touching: ContactArrays, gravity: FloatArray | None, limit: float
) -> ControlledJoints:
    """Return the force-controlled joints, then the hybrid fingers.

    Args:
        hand: At its configuration; None: there is no column.
        touching: M contacts, hand first.
        gravity: (3,) m/s^2, world axes; None: the links weigh nothing.
        limit: Largest commanded force of a hybrid finger, N.

    Raises:
        StateError: If a hybrid finger touches at several points.
    """
    if hand is None:
        none = np.zeros(0)
        return ControlledJoints(np.zeros((3 * len(touching), 0)), (none, none), none, (), ())
    count = touching.hand_count
    names = hand.actuated_joint_names
    jacobian = np.zeros((3 * len(touching), len(names)))
    jacobian[: 3 * count] = hand.contact_jacobian(
        touching.bodies[:count], touching.positions[:count]
    )
    if gravity is not None and names:
        weights = hand.gravity_torques(gravity)
    else:
        weights = np.zeros(len(names))
    joints = ControlledJoints(jacobian, hand.effort_limits, weights, names, hand.effort_units)
    if not hand.control.hybrid_fingers:
        return joints
    return _with_hybrid_fingers(joints, hand, touching, limit)


def with_limits_of(hand: Hand, joints: ControlledJoints) -> ControlledJoints:
    """Return columns with the effort limits of a hand, which is otherwise the one they are of."""
    if joints.limits is hand.effort_limits:
        return joints
    lower, upper = hand.effort_limits
    own, (low, high) = len(lower), joints.limits
    if own < len(low):
        lower, upper = np.concatenate((lower, low[own:])), np.concatenate((upper, high[own:]))
    return joints._replace(limits=(lower, upper))


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


def _with_hybrid_fingers(
    joints: ControlledJoints, hand: Hand, touching: ContactArrays, limit: float
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
    lower, upper = joints.limits
    none = np.zeros(len(hybrid))
    return ControlledJoints(
        np.hstack([joints.jacobian, columns]),
        (np.concatenate([lower, none]), np.concatenate([upper, none + limit])),
        np.concatenate([joints.gravity_torques, none]),
        tuple(names),
        (*joints.units, *(JointUnit.FORCE for _ in hybrid)),
    )


def _column_of(finger: str | None) -> str:
    """Return the name of a hybrid finger's column."""
    return f"{finger}.normal_force"
