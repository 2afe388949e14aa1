"""Coupled joints: mimic joints and linkages as one affine map of the independent joints.

The reader is this package's own. yourdfpy reads ``<mimic>`` in any order too, but takes the joint
that a chain of mimics passes through for standing still; here chains, several leaders and circles
are resolved or refused. The tests compare both on hands without chains.
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
"""How far outside its limits a named joint may stand (rounded input), radians or metres."""

FOLLOWER_TOLERANCE = 1e-3
"""The same for mimic joints, whose limits rarely match multiplier times limit to all digits."""


@dataclass(frozen=True, eq=False)
class Coupling(Record):
    """Coupled joints as an affine map: all n joint positions are ``q = S q_a + offset``.

    Velocities follow ``S v_a`` and the independent joints' motors feel ``S^T tau``.

    Attributes:
        leaders: Indices of the a independent joints among the n joints.
        S: (n, a) coupling matrix, the identity if no joint is coupled.
        offset: (n,) radians or metres.
    """

    leaders: tuple[int, ...]
    S: FloatArray
    offset: FloatArray

    def independent(self, positions: FloatArray) -> FloatArray:
        """Return a copy (a,) of the independent joints' positions among all (n,), rad or m."""
        return positions[list(self.leaders)]

    def all_positions(self, independent: FloatArray) -> FloatArray:
        """Return (n,) the positions of all joints at those (a,) of the independent ones."""
        return self.S @ independent + self.offset

    def drivers(self, joints: Iterable[int]) -> list[int]:
        """Return which of the a independent joints move any of ``joints`` (indices among n)."""
        return np.flatnonzero(np.any(self.S[list(joints)] != 0.0, axis=0)).tolist()


def resolve_couplings(joint_names: Sequence[str], couplings: Iterable[JointCoupling]) -> Coupling:
    """Resolve coupled joints in any order, chains included.

    Args:
        joint_names: The n movable joints.
        couplings: At most one for each joint.

    Raises:
        RobotError: If joints follow each other in a circle.

    Warns:
        GrasplessPinWarning: If a joint follows one that is not among ``joint_names``.
    """
    follows = {item.joint: item for item in couplings}
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
                f"mimic joints follow each other in a circle: {circle}; let one of them lead"
            )
        if name not in rows:
            item = follows[name]
            row, offset = np.zeros(len(leaders)), item.offset
            for leader, factor in item.follows.items():
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

    The limits of the joints that follow it narrow a joint's range where they are narrower by more
    than rounding; a joint that follows several does not, because how far one of them may go depends
    on the others.

    Args:
        coupling: Coupled joints.
        lower: (n,) lower limits of all joints, -inf where there is none.
        upper: (n,) upper limits, inf where there is none.
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


def limits_that_agree(
    joint_names: Sequence[str], coupling: Coupling, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the (n,) lower and upper limits of all joints, without those that contradict others.

    Where the limits of one that follows it leave a joint no travel, or no place at all, they are
    left out: it stands where its leader takes it, as in ROS. One without travel locks its leader.

    Args:
        joint_names: The n movable joints.
        coupling: Coupled joints.
        lower: (n,) -inf where there is none, rad or m.
        upper: (n,) inf where there is none.

    Warns:
        GrasplessPinWarning: Limits are left out.
    """
    agreed, contradicting, leaders = (lower.copy(), upper.copy()), [], list(coupling.leaders)
    travels = upper - lower > LIMIT_TOLERANCE
    for row in sorted(set(range(len(lower))).difference(leaders)):
        alone = np.full_like(lower, -np.inf), np.full_like(upper, np.inf)
        for own, limits in zip(alone, agreed, strict=True):
            own[[row, *leaders]] = limits[[row, *leaders]]
        low, high = independent_ranges(coupling, *alone)
        stuck = high - low <= LIMIT_TOLERANCE if travels[row] else high < low
        if (stuck & travels[leaders]).any():
            contradicting.append(row)
    for limits, end in zip(agreed, (-np.inf, np.inf), strict=True):
        limits[contradicting] = end
    for row in contradicting:
        name = joint_names[row]
        followed = ", ".join(joint_names[leaders[column]] for column in coupling.drivers([row]))
        emit(
            Finding(
                FindingCode.CONTRADICTING_LIMITS,
                f"joint {name}",
                f"the limits of {name} leave no travel to {followed}, which it follows: they are "
                "left out",
                "correct limits, multiplier or offset in the file, or couple the joint in a robot "
                "file",
                ("hand",),
            )
        )
    return agreed


def groups_that_share(joints: Mapping[str, set[int]]) -> list[list[str]]:
    """Put what shares a joint, directly or through others, into one group.

    Args:
        joints: Joints by the name of what moves or pulls them.
    """
    groups: list[tuple[set[int], list[str]]] = []
    for name, own in joints.items():
        shared = [group for group in groups if not own.isdisjoint(group[0])]
        apart = [group for group in groups if own.isdisjoint(group[0])]
        together = own.union(*(moved for moved, _ in shared))
        groups = [*apart, (together, [*(other for _, names in shared for other in names), name])]
    return [names for _, names in groups]
