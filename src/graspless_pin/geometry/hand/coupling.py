"""Coupled joints: mimic joints and linkages as one affine map of the independent joints.

This package resolves couplings itself. yourdfpy also reads ``<mimic>`` in any order, but treats the
middle joint of a chain of mimics as fixed; here chains and several leaders are resolved, and cycles
are refused. The tests compare both on hands without chains.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from graspless_pin.errors import RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.robots.description import JointCoupling
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import Record

LIMIT_TOLERANCE = 1e-6
"""Tolerance of the limits of a named joint (rounded input), rad or m."""

FOLLOWER_TOLERANCE = 1e-3
"""Tolerance for mimic joints, whose limits rarely match multiplier times limit to all digits."""


@dataclass(frozen=True, eq=False)
class Coupling(Record):
    """Coupled joints as an affine map: all n joint positions are ``q = S q_a + offset``.

    Velocities are ``S v_a``, and the torques at the independent joints' motors are ``S^T tau``.

    Attributes:
        leaders: Indices of the a independent joints among the n joints.
        S: (n, a) coupling matrix, the identity without coupled joints.
        offset: (n,) radians or metres.
    """

    leaders: tuple[int, ...]
    S: FloatArray
    offset: FloatArray

    def independent(self, positions: FloatArray) -> FloatArray:
        """Return a copy (a,) of the independent joints' positions out of all (n,), rad or m."""
        return positions[list(self.leaders)]

    def all_positions(self, independent: FloatArray) -> FloatArray:
        """Return the (n,) positions of all joints for (a,) positions of the independent ones."""
        return self.S @ independent + self.offset

    def drivers(self, joints: Iterable[int]) -> list[int]:
        """Return the independent joints (indices among a) that move any of ``joints`` (among n)."""
        return np.flatnonzero(np.any(self.S[list(joints)] != 0.0, axis=0)).tolist()


def resolve_couplings(joint_names: Sequence[str], couplings: Iterable[JointCoupling]) -> Coupling:
    """Resolve coupled joints in any order, chains included.

    Args:
        joint_names: The n movable joints.
        couplings: At most one coupling for each joint.

    Raises:
        RobotError: If joints follow each other in a circle.

    Warns:
        GrasplessPinWarning: If a joint follows one that is not among ``joint_names``.
    """
    follows = {coupling.joint: coupling for coupling in couplings}
    dangling = dangling_couplings(joint_names, follows.values())
    if dangling:
        listed = ", ".join(f"{joint!r} -> {leader!r}" for joint, leader in dangling)
        emit(
            Finding(
                FindingCode.DANGLING_MIMIC,
                ", ".join(joint for joint, _ in dangling),
                f"mimic joints follow joints that do not exist or are fixed: {listed}; they are "
                "treated as independent",
                "correct the names in the URDF or couple them in a robot file",
                ("hand",),
            )
        )
        for joint, _ in dangling:
            follows.pop(joint, None)
    leaders = tuple(index for index, name in enumerate(joint_names) if name not in follows)
    rows: dict[str, tuple[FloatArray, float]] = {
        joint_names[index]: (np.eye(len(leaders))[column], 0.0)
        for column, index in enumerate(leaders)
    }

    def resolve(name: str, chain: tuple[str, ...]) -> tuple[FloatArray, float]:
        if name in chain:
            circle = " -> ".join([*chain[chain.index(name) :], name])
            raise RobotError(
                f"mimic joints follow each other in a circle: {circle}; remove one of them"
            )
        if name not in rows:
            coupling = follows[name]
            row, offset = np.zeros(len(leaders)), coupling.offset
            for leader, factor in coupling.follows.items():
                leader_row, leader_offset = resolve(leader, (*chain, name))
                row = row + factor * leader_row
                offset += factor * leader_offset
            rows[name] = row, offset
        return rows[name]

    resolved = [resolve(name, ()) for name in joint_names]
    S = np.array([row for row, _ in resolved]).reshape(len(joint_names), len(leaders))
    return Coupling(leaders, S, np.array([offset for _, offset in resolved], dtype=np.float64))


def dangling_couplings(
    joint_names: Sequence[str], couplings: Iterable[JointCoupling]
) -> list[tuple[str, str]]:
    """Return (joint, leader) of every leader that is not among the movable joints."""
    return [
        (item.joint, leader)
        for item in couplings
        for leader in item.follows
        if leader not in joint_names
    ]


def independent_ranges(
    coupling: Coupling, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the (a,) lowest and highest positions of the independent joints, rad or m.

    The limits of a joint's followers narrow its range if they are tighter by more than rounding. A
    follower of several joints does not, because the range of each depends on the others.

    Args:
        coupling: Coupled joints.
        lower: (n,) lower limits of all joints, -inf without a limit.
        upper: (n,) upper limits, inf without a limit.
    """
    leaders, S = list(coupling.leaders), coupling.S
    lowest, highest = lower[leaders].copy(), upper[leaders].copy()
    for row, column in zip(*np.nonzero(S), strict=True):
        if leaders[column] == row or np.count_nonzero(S[row]) > 1:
            continue
        ends = np.array([lower[row], upper[row]]) - coupling.offset[row]
        low, high = sorted(ends / S[row, column])
        slack = FOLLOWER_TOLERANCE / abs(S[row, column])
        lowest[column] = low if low - slack > lowest[column] else lowest[column]
        highest[column] = high if high + slack < highest[column] else highest[column]
    return read_only(lowest), read_only(highest)


def consistent_limits(
    joint_names: Sequence[str], coupling: Coupling, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the (n,) lower and upper limits of all joints, without contradicting ones.

    If the limits of a follower leave its leader no travel, or an empty range, they are left out:
    the follower then moves with its leader, as in ROS. A follower without travel locks its leader.

    Args:
        joint_names: The n movable joints.
        coupling: Coupled joints.
        lower: (n,) lower limits, -inf without a limit, rad or m.
        upper: (n,) upper limits, inf without a limit.

    Warns:
        GrasplessPinWarning: Limits are left out.
    """
    consistent, contradicting, leaders = (lower.copy(), upper.copy()), [], list(coupling.leaders)
    has_travel = upper - lower > LIMIT_TOLERANCE
    for row in sorted(set(range(len(lower))).difference(leaders)):
        alone = np.full_like(lower, -np.inf), np.full_like(upper, np.inf)
        for own, limits in zip(alone, consistent, strict=True):
            own[[row, *leaders]] = limits[[row, *leaders]]
        low, high = independent_ranges(coupling, *alone)
        is_stuck = high - low <= LIMIT_TOLERANCE if has_travel[row] else high < low
        if (is_stuck & has_travel[leaders]).any():
            contradicting.append(row)
    for limits, end in zip(consistent, (-np.inf, np.inf), strict=True):
        limits[contradicting] = end
    for row in contradicting:
        name = joint_names[row]
        followed = ", ".join(joint_names[leaders[column]] for column in coupling.drivers([row]))
        emit(
            Finding(
                FindingCode.CONTRADICTING_LIMITS,
                f"joint {name}",
                f"the limits of {name} leave no range to {followed}, which it follows; they are "
                "ignored",
                "correct limits, multiplier or offset in the file, or couple the joint in a robot "
                "file",
                ("hand",),
            )
        )
    return consistent


def groups_sharing_joints(joints: Mapping[str, set[int]]) -> list[list[str]]:
    """Return groups of names that share joints, directly or through other names.

    Args:
        joints: Indices of joints by name of the finger, tendon or motor that moves them.
    """
    groups: list[tuple[set[int], list[str]]] = []
    for name, own_joints in joints.items():
        shared = [group for group in groups if not own_joints.isdisjoint(group[0])]
        apart = [group for group in groups if own_joints.isdisjoint(group[0])]
        joined = own_joints.union(*(moved for moved, _ in shared))
        groups = [*apart, (joined, [*(member for _, names in shared for member in names), name])]
    return [names for _, names in groups]
