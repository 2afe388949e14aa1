"""Control modes of fingers, and the columns of J from each finger's own Jacobian."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import (
    FloatArray,
    JointUnit,
    array_of_items,
    check_unit_rows,
    checked_units,
    choice,
    finite_array,
    read_only,
    real_number,
    whole_number,
)

DEFAULT_GAIN = "default"
"""Key of the gains of all joints that are not named, in scenes and robot files."""


class ControlMode(StrEnum):
    """How a finger is controlled (Sec. II-A of the paper).

    See the example of `assemble_joint_space`.
    """

    FORCE = "force"
    """Joint torques set the contact force: J^T f = tau."""
    POSITION = "position"
    """Stiff: the finger is part of the environment and has no column in J."""
    HYBRID = "hybrid"
    """A commanded normal force and free tangential forces: one column n, f_com >= 0."""


@dataclass(frozen=True, eq=False)
class FingerContacts:
    """One finger: its control mode, its contacts and its joints' Jacobian and limits.

    Attributes:
        mode: How it is controlled.
        contacts: Indices of its contacts among the M of the problem.
        jacobian: (3 M_i, L_i) for FORCE, rows in the order of `contacts`; unused otherwise.
        torque_limits: (lower, upper), scalar or (L_i,), N m, for FORCE.
        max_force: Largest commanded force, N, for HYBRID.
        joint_names: Names of the L_i joints (one name for HYBRID); None: made from the finger.
        joint_units: ``N m`` or ``N`` for each of the L_i joints for FORCE; None: N m.

    Examples:
        >>> from graspless_pin import FingerContacts, assemble_joint_space
        >>> finger = FingerContacts("force", (0,), [[0.1], [0.0], [0.0]])  # 0.1 N m a newton
        >>> normals = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        >>> assemble_joint_space(normals, [finger]).jacobian.ravel()
        array([0.1, 0. , 0. , 0. , 0. , 0. ])
    """

    mode: ControlMode
    contacts: Sequence[int]
    jacobian: ArrayLike | None = None
    torque_limits: tuple[ArrayLike, ArrayLike] = (-10.0, 10.0)
    max_force: float = np.inf
    joint_names: Sequence[str] | None = None
    joint_units: Sequence[str] | None = None


@dataclass(frozen=True, eq=False)
class JointSpace:
    """The joint side of a problem: pass the fields to `QuasistaticProblem`.

    See the example of `assemble_joint_space`.

    Attributes:
        jacobian: (3M, L), eqs. (12) and (13).
        torque_limits: (lower, upper), each (L,).
        joint_names: L names.
        joint_units: L units of their torques.
    """

    jacobian: FloatArray
    torque_limits: tuple[FloatArray, FloatArray]
    joint_names: tuple[str, ...]
    joint_units: tuple[JointUnit, ...]


def assemble_joint_space(normals: ArrayLike, fingers: Sequence[FingerContacts]) -> JointSpace:
    """Stack the fingers into J = diag(J_1, ..., J_N), eqs. (12) and (13).

    A position-controlled finger adds no column; a hybrid one adds the column n of its one contact
    with 0 <= f_com <= max_force; contacts of no finger belong to the environment.

    Args:
        normals: (M, 3) unit normals into the object.
        fingers: The fingers, in the order of the columns.

    Raises:
        ArgumentError: If a contact index is out of range or used twice, a hybrid finger has not
            exactly one contact, or a Jacobian has the wrong shape.

    Examples:
        >>> from graspless_pin import FingerContacts, assemble_joint_space
        >>> finger = FingerContacts("force", (0,), [[0.1], [0.0], [0.0]])  # 0.1 N m a newton
        >>> normals = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        >>> assemble_joint_space(normals, [finger]).jacobian.ravel()
        array([0.1, 0. , 0. , 0. , 0. , 0. ])
    """
    n = finite_array("normals", normals, (None, 3))
    check_unit_rows("normals", n)
    owner: dict[int, int] = {}
    spaces: list[JointSpace] = []
    for index, finger in enumerate(fingers):
        label = f"fingers[{index}]"
        if not isinstance(finger, FingerContacts):
            raise ArgumentError(label, f"found {reprlib.repr(finger)}; needs a FingerContacts")
        for contact in _contact_indices(label, finger.contacts):
            if not 0 <= contact < len(n):
                raise ArgumentError(
                    f"{label}.contacts", f"names contact {contact}; there are {len(n)} contacts"
                )
            if contact in owner:
                raise ArgumentError(
                    f"{label}.contacts",
                    f"names contact {contact}, which is of finger {owner[contact]}",
                )
            owner[contact] = index
        block, limits = _finger_columns_and_limits(label, finger, n)
        count, names = block.shape[1], finger.joint_names
        if names is None:
            names = [f"finger_{index + 1}_joint_{j + 1}" for j in range(count)]
        if len(names) != count:
            raise ArgumentError(
                f"{label}.joint_names",
                f"has length {len(names)}; the finger's number of joints is {count}",
            )
        spaces.append(
            JointSpace(block, limits, tuple(names), _finger_joint_units(label, finger, count))
        )
    lower, upper = (
        np.concatenate([*(space.torque_limits[side] for space in spaces), []]) for side in (0, 1)
    )
    return JointSpace(
        read_only(np.hstack([np.zeros((3 * len(n), 0)), *(space.jacobian for space in spaces)])),
        (read_only(lower), read_only(upper)),
        tuple(name for space in spaces for name in space.joint_names),
        tuple(unit for space in spaces for unit in space.joint_units),
    )


def _finger_joint_units(label: str, finger: FingerContacts, count: int) -> tuple[JointUnit, ...]:
    if ControlMode(finger.mode) is ControlMode.HYBRID:
        return (JointUnit.FORCE,) * count
    try:
        return checked_units(finger.joint_units, count)
    except ArgumentError as error:
        raise ArgumentError(f"{label}.joint_units", error.args[1]) from error


def _contact_indices(label: str, contacts: Sequence[int]) -> list[int]:
    if not isinstance(contacts, Sequence | np.ndarray) or isinstance(contacts, str):
        raise ArgumentError(f"{label}.contacts", f"is {contacts!r}; it must be a list of indices")
    return [whole_number(f"{label}.contacts", contact) for contact in contacts]


def _finger_columns_and_limits(
    label: str, finger: FingerContacts, normals: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """Return one finger's (3M, L_i) columns of J and its torque limits."""
    size = 3 * len(normals)
    mode = choice(ControlMode, f"{label}.mode", finger.mode)
    if mode is ControlMode.POSITION:
        return np.zeros((size, 0)), (np.zeros(0), np.zeros(0))
    if mode is ControlMode.HYBRID:
        if len(finger.contacts) != 1:
            raise ArgumentError(
                f"{label}.contacts",
                f"has {len(finger.contacts)} contacts; a hybrid finger has exactly one",
            )
        column = np.zeros((size, 1))
        contact = finger.contacts[0]
        column[3 * contact : 3 * contact + 3, 0] = normals[contact]
        limit = real_number(f"{label}.max_force", finger.max_force, 0.0, finite=False)
        return column, (np.zeros(1), np.array([limit]))
    if finger.jacobian is None:
        raise ArgumentError(f"{label}.jacobian", "is missing; a force-controlled finger needs it")
    limits = finger.torque_limits
    if not isinstance(limits, tuple | list) or len(limits) != 2:
        raise ArgumentError(
            f"{label}.torque_limits", f"is {limits!r}; it must be a pair (lower, upper)"
        )
    own = finite_array(f"{label}.jacobian", finger.jacobian, (3 * len(finger.contacts), None))
    block = np.zeros((size, own.shape[1]))
    for row, contact in enumerate(finger.contacts):
        block[3 * contact : 3 * contact + 3] = own[3 * row : 3 * row + 3]
    lower, upper = (
        array_of_items(f"{label}.torque_limits {side}", limit, own.shape[1])
        for side, limit in zip(("lower", "upper"), limits, strict=True)
    )
    return block, (lower, upper)
