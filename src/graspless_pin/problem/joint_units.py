"""Units of generalised forces: not every column of J is a turning joint's, nor every row of W."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError


class JointUnit(StrEnum):
    """What the generalised force of a joint, or of a passive coordinate, is measured in.

    See the example of `assemble_joint_space`.
    """

    TORQUE = "N m"
    """Of a turning joint."""
    FORCE = "N"
    """Of a linear joint, a tendon, or a hybrid finger's normal force."""


FREE_BODY = (JointUnit.FORCE,) * 3 + (JointUnit.TORQUE,) * 3
"""Units of the wrench on one free body."""


def turning(units: Sequence[JointUnit]) -> NDArray[np.bool_]:
    """Return which coordinates turn: a mask of those whose generalised forces are in N m."""
    return np.array([unit is JointUnit.TORQUE for unit in units], dtype=bool)


def checked_units(units: Sequence[str] | None, count: int) -> tuple[JointUnit, ...]:
    """Return the units of ``count`` joints; None: all turn.

    Raises:
        ArgumentError: Naming the index and the value that is wrong.
    """
    if units is None:
        return (JointUnit.TORQUE,) * count
    return _checked("joint_units", units, count, "the jacobian has {} columns")


def checked_passive_units(units: Sequence[str] | None, count: int) -> tuple[JointUnit, ...]:
    """Return the units of ``count`` passive coordinates; None: those of free bodies.

    Raises:
        ArgumentError: Naming the index and the value that is wrong.
    """
    if units is not None:
        return _checked("passive_units", units, count, "the wrench_matrix has {} rows")
    bodies, rest = divmod(count, len(FREE_BODY))
    if rest:
        raise ArgumentError(
            "passive_units",
            f"is missing for a wrench_matrix of {count} rows; left out, it is three 'N' and three "
            f"'N m' for each free body, and the rows must be a multiple of {len(FREE_BODY)}",
        )
    return FREE_BODY * bodies


def _checked(name: str, units: Sequence[str], count: int, rule: str) -> tuple[JointUnit, ...]:
    if isinstance(units, str) or not isinstance(units, Sequence):
        raise ArgumentError(name, f"is {units!r}; it must be a sequence of units")
    if len(units) != count:
        raise ArgumentError(name, f"has {len(units)} units; {rule.format(count)}")
    known = ", ".join(repr(str(unit)) for unit in JointUnit)
    for index, unit in enumerate(units):
        if unit not in list(JointUnit):
            raise ArgumentError(name, f"is {unit!r} at index {index}; it must be one of {known}")
    return tuple(JointUnit(unit) for unit in units)


def units_text(units: Sequence[JointUnit]) -> str:
    """Return the unit of some joints in words: one for all of them, or which is which."""
    if JointUnit.FORCE not in units:
        return JointUnit.TORQUE.value
    if JointUnit.TORQUE not in units:
        return JointUnit.FORCE.value
    return "N m; N for linear and hybrid joints"
