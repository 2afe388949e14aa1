"""Units of joint torques: not every column of J is a turning joint's."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

from graspless_pin.errors import ArgumentError


class JointUnit(StrEnum):
    """What the generalised force of a joint is measured in.

    See the example of `assemble_joint_space`.
    """

    TORQUE = "N m"
    """Of a turning joint."""
    FORCE = "N"
    """Of a linear joint, a tendon, or a hybrid finger's normal force."""


def checked_units(units: Sequence[str] | None, count: int) -> tuple[JointUnit, ...]:
    """Return the units of ``count`` joints; None: all turn.

    Raises:
        ArgumentError: Naming the index and the value that is wrong.
    """
    if units is None:
        return (JointUnit.TORQUE,) * count
    if isinstance(units, str) or not isinstance(units, Sequence):
        raise ArgumentError("joint_units", f"is {units!r}; it must be a sequence of units")
    if len(units) != count:
        raise ArgumentError(
            "joint_units", f"has {len(units)} units; the jacobian has {count} columns"
        )
    known = ", ".join(repr(str(unit)) for unit in JointUnit)
    for index, unit in enumerate(units):
        if unit not in list(JointUnit):
            raise ArgumentError(
                "joint_units", f"is {unit!r} at index {index}; it must be one of {known}"
            )
    return tuple(JointUnit(unit) for unit in units)


def units_text(units: Sequence[JointUnit]) -> str:
    """Return the unit of some joints in words: one for all of them, or which is which."""
    if JointUnit.FORCE not in units:
        return JointUnit.TORQUE.value
    if JointUnit.TORQUE not in units:
        return JointUnit.FORCE.value
    return "N m; N for linear and hybrid joints"
