"""From independent joints to actuators: motors, tendons and the passive motions of the hand.

A tendon with the moment arms r (m) on its joints exerts the torques r t at the tension t. k tendons
(rows of R) on g joints exert ``tau = R^T t``. With ``A = R^T (R R^T)^-1`` and an orthonormal basis
N of the null space of R this is ``A^T tau = t`` and ``N^T tau = 0``. So every tendon is a column of
the contact Jacobian, and every motion that no tendon resists is a column with the limits 0 and 0.

Effort limits of the actuators are those of the URDF unless a robot file or scene overrides them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.coupling import groups_sharing_joints
from graspless_pin.geometry.hand.fingers import ControlPlan, driving_joints
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.geometry.poses import as_numbers
from graspless_pin.geometry.robots.description import FingerSpec
from graspless_pin.problem import ControlMode
from graspless_pin.problem.checks import (
    FloatArray,
    JointUnit,
    check_known,
    read_only,
    unknown_name,
)
from graspless_pin.records import Brief, Record


@dataclass(frozen=True, eq=False, repr=False)
class Actuation(Brief, Record):
    """The L actuators: the columns of the contact Jacobian.

    Attributes:
        names: Motors by the name of their joint, then tendons, then passive motions.
        tendons: Names of the tendons among them.
        passive: Names of the passive motions among them.
        units: Units of their efforts: N of prismatic joints, tendons, and passive motions of
            prismatic joints.
        from_independent: (a, L) maps torques tau_a of the independent joints to efforts of the
            actuators: ``from_independent^T tau_a``.
        from_joints: (n, L) the same map for all movable joints, couplings included.
    """

    names: tuple[str, ...]
    tendons: tuple[str, ...]
    passive: tuple[str, ...]
    units: tuple[JointUnit, ...]
    from_independent: FloatArray
    from_joints: FloatArray

    @cached_property
    def is_identity(self) -> bool:
        """Whether every movable joint has a motor of its own, in their order."""
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
            arm, tendons on the same joints are redundant, or a tendon's joints have different
            control modes.
    """
    count = len(tree.coupling.leaders)
    arms = {name: _moment_arms(tree, name, joints) for name, joints in tendons.items()}
    modes = list(control.joints.values())
    driven: set[int] = set()
    columns: list[FloatArray] = []
    tendon_names: list[str] = []
    passive: list[str] = []
    passive_columns: list[FloatArray] = []
    tendon_joints = {name: set(np.flatnonzero(row).tolist()) for name, row in arms.items()}
    for group in groups_sharing_joints(tendon_joints):
        R = np.array([arms[name] for name in group])
        joints = np.flatnonzero(np.any(R != 0.0, axis=0))
        driven |= set(joints.tolist())
        own_modes = {modes[joint] for joint in joints}
        if len(own_modes) > 1:
            raise ArgumentError(
                "control",
                f"the joints of tendon {', '.join(group)} have different control modes; give them "
                "the same mode",
            )
        if own_modes != {ControlMode.FORCE}:
            continue
        R = R[:, joints]
        if np.linalg.matrix_rank(R) < len(group):
            raise ArgumentError(
                "tendons",
                f"{', '.join(group)} are redundant: they pull the same joints, so their tensions "
                "are not unique; keep at most as many tendons as joints",
            )
        columns += _embedded_columns(R.T @ np.linalg.inv(R @ R.T), joints, count)
        tendon_names += group
        # Imported here: robots without tendons do not need it.
        from scipy.linalg import null_space

        null_columns = _embedded_columns(null_space(R), joints, count)
        passive_columns += null_columns
        passive += [f"{group[0]}.passive_{number}" for number in range(1, len(null_columns) + 1)]
    motors = [
        column
        for column, mode in enumerate(modes)
        if mode is ControlMode.FORCE and column not in driven
    ]
    rows = [*np.eye(count)[motors], *columns, *passive_columns]
    matrix = np.array(rows).reshape(len(rows), count).T
    names = (*(list(control.joints)[column] for column in motors), *tendon_names, *passive)
    return Actuation(
        names=names,
        tendons=tuple(tendon_names),
        passive=tuple(passive),
        units=_effort_units(tree, names, tendon_names, matrix),
        from_independent=matrix,
        from_joints=tree.coupling.S @ matrix,
    )


def _effort_units(
    tree: KinematicTree,
    names: Sequence[str],
    tendons: Sequence[str],
    from_independent: FloatArray,
) -> tuple[JointUnit, ...]:
    """Return the effort units of the L actuators with given names, see `Actuation`."""
    linear = np.array([kind == "prismatic" for kind in tree.joint_kinds], dtype=bool)
    leaders = linear[list(tree.coupling.leaders)]
    moves_linear = (from_independent[leaders] != 0.0).any(axis=0)
    return tuple(
        JointUnit.FORCE if name in tendons or slides else JointUnit.TORQUE
        for name, slides in zip(names, moves_linear.tolist(), strict=True)
    )


def _moment_arms(tree: KinematicTree, name: str, joints: Mapping[str, float]) -> FloatArray:
    """Return a tendon's (a,) moment arms at the independent joints, couplings included."""
    argument = f"tendons[{name!r}]"
    if name in tree.joint_index:
        raise ArgumentError(argument, "has the name of a joint; choose another one")
    check_known(argument, "joint", joints, tree.joint_index)
    row = np.zeros(len(tree.joint_names))
    for joint, arm in joints.items():
        row[tree.joint_index[joint]] = arm
    independent = row @ tree.coupling.S
    independent[[name in tree.locked for name in tree.leader_names]] = 0.0
    if not np.isfinite(independent).all() or not independent.any():
        raise ArgumentError(
            argument, f"needs a moment arm at a joint that can move, got {dict(joints)}"
        )
    return independent


def _embedded_columns(columns: FloatArray, rows: NDArray[np.intp], count: int) -> list[FloatArray]:
    """Return the (g, k) columns over given joints as k vectors over all ``count`` joints."""
    vectors = np.zeros((columns.shape[1], count))
    vectors[:, rows] = columns.T
    return list(vectors)


PLACEHOLDER_EFFORT = 100.0
"""Effort (N m or N) from which on a limit of a finger is taken for a placeholder."""

PLACEHOLDER_ARM_EFFORT = 1000.0
"""The same for joints that are not below a palm: arms, legs, lifts."""

EffortLimit = float | tuple[float, float]
"""A symmetric limit, or (lower, upper); N m for a revolute and N for a prismatic joint."""


def is_placeholder(effort: float, *, on_arm: bool = False) -> bool:
    """Return whether a URDF's effort limit looks like a placeholder: 0, infinite or too large.

    Args:
        effort: N m or N.
        on_arm: Whether the joint is not below a palm.
    """
    return effort == 0.0 or effort >= (PLACEHOLDER_ARM_EFFORT if on_arm else PLACEHOLDER_EFFORT)


def expand_overrides(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    overrides: Mapping[str, EffortLimit],
    tendons: Mapping[str, Mapping[str, float]],
    tensions: Mapping[str, tuple[float, float]],
) -> dict[str, tuple[float, float]]:
    """Expand overrides by finger, joint or tendon name to joints and tendons.

    Args:
        tree: The kinematic tree.
        fingers: The checked fingers.
        overrides: Limit by finger, joint or tendon; that of a joint takes precedence over that of
            its finger. One number F means (-F, F), without the sign that a tendon cannot have.
        tendons: The joints that each tendon pulls.
        tensions: (lower, upper) of tendons, N; others only pull.

    Returns:
        (lower, upper) by independent joint or tendon.

    Raises:
        ArgumentError: If a name is unknown or that of a joint without a motor, or a limit is not a
            finite number or pair with lower <= upper.
    """
    pairs = {name: _limit_pair(name, limit) for name, limit in overrides.items()}
    expanded = {
        target: pairs[name]
        for target, name in entry_by_joint(tree, fingers, overrides, tendons).items()
    }
    for name in tendons:
        if name in expanded and np.ndim(overrides[name]) == 0:
            lower, upper = tensions.get(name, (0.0, np.inf))
            low, high = expanded[name]
            expanded[name] = (low if lower < 0.0 else 0.0, high if upper > 0.0 else 0.0)
    return expanded


def entry_by_joint(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    names: Collection[str],
    tendons: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
    *,
    argument: str = "effort_limits",
    instead: str = "give the limit of the joint it follows",
) -> dict[str, str]:
    """Return, for each driven joint and each tendon, the entry of ``names`` that applies to it.

    A joint's own name takes precedence over that of its finger.

    Args:
        tree: The kinematic tree.
        fingers: The checked fingers.
        names: Names of fingers, joints and tendons.
        tendons: The joints that each tendon pulls.
        argument: Name of the argument in errors.
        instead: Advice in errors for a joint that follows another.

    Raises:
        ArgumentError: If a name is unknown or that of a joint without a motor.
    """
    leaders = tree.leader_names
    pulled = {
        joint: tendon
        for tendon, arms in tendons.items()
        for joint in driving_joints(tree, FingerSpec(tuple(arms)))
    }
    spread: dict[str, str] = {}
    for name in names:
        if name in fingers:
            own = [joint for joint in driving_joints(tree, fingers[name]) if joint not in pulled]
            if not own:
                raise ArgumentError(
                    f"{argument}[{name!r}]",
                    "no joint motor moves this finger; give limits of its tendons",
                )
            spread |= dict.fromkeys(own, name)
    for name in names:
        where = f"{argument}[{name!r}]"
        if name in fingers:
            continue
        if name in pulled:
            raise ArgumentError(
                where, f"tendon {pulled[name]!r} pulls this joint; give the limit of the tendon"
            )
        if name not in leaders and name not in tendons:
            if name in tree.joint_index:
                raise ArgumentError(where, f"this joint mimics another one; {instead}")
            known = (*fingers, *leaders, *tendons)
            raise unknown_name(argument, "finger or joint", name, known)
        spread[name] = name
    return spread


def resolve_effort_limits(
    tree: KinematicTree,
    actuation: Actuation,
    overrides: Mapping[str, tuple[float, float]],
    unknown: Mapping[str, str],
    arm_joints: Collection[str],
    tensions: Mapping[str, tuple[float, float]],
) -> tuple[FloatArray, FloatArray]:
    """Return the (lower, upper) effort limits of the actuators.

    Args:
        tree: The kinematic tree, which holds the URDF's limits.
        actuation: The L actuators.
        overrides: (lower, upper) by joint or tendon, instead of the URDF's.
        unknown: Note by joint or tendon whose real limit is declared unknown.
        arm_joints: Joints that are not below a palm.
        tensions: (lower, upper) of tendons, N; others only pull, without a limit.

    Returns:
        Two read-only (L,) arrays in N m (N for prismatic joints and tendons).

    Warns:
        GrasplessPinWarning: If the limit of an actuator without override is declared unknown
            or is the URDF's and 0, infinite or at least 100 (1000 on an arm).
    """
    lower, upper = np.zeros(len(actuation.names)), np.zeros(len(actuation.names))
    urdf_lower, urdf_upper = urdf_efforts(tree)
    doubtful: dict[str, str] = {}
    noted: dict[str, list[str]] = {}
    for row, name in enumerate(actuation.names):
        if name in actuation.passive:
            continue
        if name in overrides:
            lower[row], upper[row] = overrides[name]
            continue
        if name in actuation.tendons:
            lower[row], upper[row] = tensions.get(name, (0.0, np.inf))
        else:
            index = tree.joint_index[name]
            lower[row], upper[row] = urdf_lower[index], urdf_upper[index]
        if name in unknown:
            noted.setdefault(unknown[name], []).append(limit_words(name, upper[row]))
        elif is_placeholder(max(-lower[row], upper[row]), on_arm=name in arm_joints):
            doubtful[name] = limit_words(name, upper[row])
    unknown_words = "; ".join(f"{', '.join(names)}: {note}" for note, names in noted.items())
    declared = [name for name in actuation.names if name in unknown and name not in overrides]
    for code, names, reason, listed in (
        (
            FindingCode.PLACEHOLDER_EFFORT,
            doubtful,
            "look like placeholders",
            ", ".join(doubtful.values()),
        ),
        (
            FindingCode.UNKNOWN_EFFORT,
            declared,
            "the robot file declares to be unknown",
            unknown_words,
        ),
    ):
        if listed:
            emit(
                Finding(
                    code,
                    ", ".join(names),
                    f"effort limits that {reason}: {listed}",
                    "give the motors' real limits in effort_limits (N m, or N for a prismatic "
                    "joint)",
                    ("hand", "effort_limits"),
                )
            )
    return read_only(lower), read_only(upper)


def limit_words(name: str, limit: float) -> str:
    """Return a text with a joint's name and effort limit, for messages."""
    return f"{name!r} ({limit:g})" if np.isfinite(limit) else f"{name!r} (unlimited)"


def urdf_efforts(tree: KinematicTree) -> tuple[FloatArray, FloatArray]:
    """Return the URDF's (lower, upper) effort limits of the n movable joints, infinite if none."""
    model = tree.pinocchio_model
    return np.array(model.lowerEffortLimit), np.array(model.upperEffortLimit)


def _limit_pair(name: str, limit: EffortLimit) -> tuple[float, float]:
    """Return an effort limit as (lower, upper)."""
    argument = f"effort_limits[{name!r}]"
    values = as_numbers(argument, limit, "a number or a pair")
    if values.shape not in ((), (2,)) or not np.isfinite(values).all():
        raise ArgumentError(argument, f"needs a finite number or a pair, got {limit!r}")
    if values.shape == ():
        if values < 0.0:
            raise ArgumentError(argument, f"a symmetric limit must not be negative, got {limit!r}")
        return -float(values), float(values)
    if values[0] > values[1]:
        raise ArgumentError(argument, f"the lower limit is above the upper one: {limit!r}")
    return float(values[0]), float(values[1])
