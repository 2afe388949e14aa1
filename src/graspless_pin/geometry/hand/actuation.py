"""From independent joints to actuators: motors, tendons and what an underactuated hand leaves free.

A tendon with the moment arms r (m) on its joints makes the torques r t at the tension t. k tendons
(rows of R) on g joints hold ``tau = R^T t``. With ``A = R^T (R R^T)^-1`` and an orthonormal basis N
of the null space of R that is ``A^T tau = t`` and ``N^T tau = 0``. So every tendon is a column of
the contact Jacobian, and every motion that no tendon resists is a column with the limits 0 and 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.coupling import groups_that_share
from graspless_pin.geometry.hand.fingers import ControlPlan
from graspless_pin.geometry.hand.tree import KinematicTree, unknown_name
from graspless_pin.geometry.pickling import Record
from graspless_pin.problem import ControlMode
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.records import Brief


@dataclass(frozen=True, eq=False, repr=False)
class Actuation(Brief, Record):
    """The L actuators: the columns of the contact Jacobian.

    Attributes:
        names: Motors by the name of their joint, then tendons, then passive motions.
        tendons: Names of the tendons among them.
        passive: Names of the passive motions among them.
        units: Units of their efforts: N of linear joints, tendons, and what moves such joints.
        from_independent: (a, L) the actuators feel ``from_independent^T tau_a`` when the
            independent joints feel tau_a.
        from_joints: (n, L) the same from all movable joints, couplings included.
    """

    names: tuple[str, ...]
    tendons: tuple[str, ...]
    passive: tuple[str, ...]
    units: tuple[JointUnit, ...]
    from_independent: NDArray[np.float64]
    from_joints: NDArray[np.float64]

    @cached_property
    def every_joint_alone(self) -> bool:
        """Whether all movable joints have a motor each, in their order."""
        rows, columns = self.from_joints.shape
        return rows == columns and bool((self.from_joints == np.eye(rows)).all())


def plan_actuation(
    tree: KinematicTree, control: ControlPlan, tendons: Mapping[str, Mapping[str, float]]
) -> Actuation:
    """Find the actuators of the force-controlled joints.

    Args:
        tree: The kinematic tree.
        control: The joints' control modes.
        tendons: Moment arm by joint, m, by tendon: torque per newton of tension.

    Raises:
        ArgumentError: If a tendon's joint is unknown, a tendon has a joint's name or no moment
            arm, tendons on the same joints are redundant, or a tendon's joints are not under one
            control mode.
    """
    count = len(tree.coupling.leaders)
    arms = {name: _moment_arms(tree, name, joints) for name, joints in tendons.items()}
    modes = list(control.joints.values())
    driven: set[int] = set()
    columns: list[NDArray[np.float64]] = []
    tendon_names: list[str] = []
    passive: list[str] = []
    zeros: list[NDArray[np.float64]] = []
    pulled = {name: set(np.flatnonzero(row).tolist()) for name, row in arms.items()}
    for group in groups_that_share(pulled):
        R = np.array([arms[name] for name in group])
        joints = np.flatnonzero(np.any(R != 0.0, axis=0))
        driven |= set(joints.tolist())
        if not _is_force_controlled(group, {modes[joint] for joint in joints}):
            continue
        R = R[:, joints]
        if np.linalg.matrix_rank(R) < len(group):
            raise ArgumentError(
                "tendons",
                f"{', '.join(group)} pull the same joints in the same way; tensions of redundant "
                "tendons cannot be told apart, keep as many as there are joints",
            )
        columns += _embed(R.T @ np.linalg.inv(R @ R.T), joints, count)
        tendon_names += group
        free = _embed(null_space(R), joints, count)
        zeros += free
        passive += [f"{group[0]}.passive_{number}" for number in range(1, len(free) + 1)]
    motors = [
        column
        for column, mode in enumerate(modes)
        if mode is ControlMode.FORCE and column not in driven
    ]
    rows = [*np.eye(count)[motors], *columns, *zeros]
    matrix = np.array(rows).reshape(len(rows), count).T
    names = (*(list(control.joints)[column] for column in motors), *tendon_names, *passive)
    return Actuation(
        names=names,
        tendons=tuple(tendon_names),
        passive=tuple(passive),
        units=_units(tree, names, tendon_names, matrix),
        from_independent=matrix,
        from_joints=tree.coupling.S @ matrix,
    )


def _units(
    tree: KinematicTree,
    names: Sequence[str],
    tendons: Sequence[str],
    from_independent: NDArray[np.float64],
) -> tuple[JointUnit, ...]:
    """Return the units of the L actuators with some names, see `Actuation`."""
    linear = np.array([kind == "prismatic" for kind in tree.joint_kinds], dtype=bool)
    leaders = linear[list(tree.coupling.leaders)]
    moves_linear = (from_independent[leaders] != 0.0).any(axis=0)
    return tuple(
        JointUnit.FORCE if name in tendons or slides else JointUnit.TORQUE
        for name, slides in zip(names, moves_linear.tolist(), strict=True)
    )


def _moment_arms(
    tree: KinematicTree, name: str, joints: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return a tendon's (a,) moment arms at the independent joints, couplings included."""
    argument = f"tendons[{name!r}]"
    if name in tree.joint_index:
        raise ArgumentError(argument, "has the name of a joint; choose another one")
    row = np.zeros(len(tree.joint_names))
    for joint, arm in joints.items():
        if joint not in tree.joint_index:
            raise unknown_name(argument, "joint", joint, tree.joint_names)
        row[tree.joint_index[joint]] = arm
    independent = row @ tree.coupling.S
    independent[[tree.joint_names[index] in tree.locked for index in tree.coupling.leaders]] = 0.0
    if not np.isfinite(independent).all() or not independent.any():
        raise ArgumentError(argument, f"needs a moment arm where a joint moves, got {dict(joints)}")
    return independent


def _is_force_controlled(group: list[str], modes: set[ControlMode]) -> bool:
    """Return whether the joints of a group of tendons are all under force control."""
    if len(modes) > 1:
        raise ArgumentError(
            "control",
            f"the joints of tendon {', '.join(group)} have different control modes; give them one",
        )
    return modes == {ControlMode.FORCE}


def _embed(
    columns: NDArray[np.float64], rows: NDArray[np.intp], count: int
) -> list[NDArray[np.float64]]:
    """Return (g, k) columns over some joints as k vectors over all ``count`` joints."""
    vectors = np.zeros((columns.shape[1], count))
    vectors[:, rows] = columns.T
    return list(vectors)
