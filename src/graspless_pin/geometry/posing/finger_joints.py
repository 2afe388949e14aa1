"""Which independent joints move a finger or a palm, how far they go, and hands moved so.

Which joints flex a finger; arms that bring a palm to a pose, or as near as they come, while their
bases stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.hand.coupling import groups_that_share
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import KinematicTree, LinkGeometry
from graspless_pin.problem.checks import FloatArray, check_known
from graspless_pin.records import Record

AT_LIMIT = 1e-4
"""Share of a joint's range within which it stands at one of its ends."""

_COS_PARALLEL = math.cos(math.radians(30.0))


def chosen_fingers(hand: Hand, fingers: Sequence[str] | None) -> tuple[str, ...]:
    """Return the named fingers, or all of them.

    Raises:
        ArgumentError: If a finger is unknown, ``fingers`` is one string, or the hand has none.
    """
    if isinstance(fingers, str):
        raise ArgumentError("fingers", f"needs a list of names, got the text {fingers!r}")
    if not hand.fingers:
        raise ArgumentError(
            "hand",
            "has no fingers; name their joints in the robot file or in the scene, or give links "
            "that lack collision shapes some: graspless-pin inspect names them",
        )
    check_known("fingers", "finger", fingers or (), hand.fingers)
    return tuple(hand.fingers) if fingers is None else tuple(dict.fromkeys(fingers))


def driving_columns(hand: Hand, finger: str) -> list[int]:
    """Return which independent joints (columns of the coupling) drive a finger's joints."""
    index = hand.tree.joint_index
    return hand.tree.coupling.drivers(index[joint] for joint in hand.fingers[finger].joints)


def searched_ranges(tree: KinematicTree, start: FloatArray, most: float) -> tuple[FloatArray, ...]:
    """Return the (a,) lowest and highest positions of independent joints that are searched.

    Args:
        tree: The kinematic tree.
        start: (a,) where the joints stand.
        most: How far from there a joint goes that has no limit, rad or m.
    """
    ends = zip(tree.ranges, (-most, most), strict=True)
    return tuple(np.where(np.isfinite(end), end, start + beyond) for end, beyond in ends)


def least_misses(
    misses: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: Sequence[FloatArray],
    evaluations: int,
) -> FloatArray:
    """Return the positions within bounds with the least squares of misses, found from a start."""
    lower, upper = bounds
    inside = _INSIDE * (upper - lower)
    return least_squares(
        misses,
        np.clip(start, lower + inside, upper - inside),
        jac=jacobian,  # pyright: ignore[reportArgumentType] - a function will do
        bounds=(lower, upper),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=evaluations,
    ).x


def groups_of_fingers(hand: Hand, fingers: Sequence[str]) -> list[list[str]]:
    """Put fingers that share an independent joint, as the jaws of a gripper do, into one group."""
    return groups_that_share({finger: set(driving_columns(hand, finger)) for finger in fingers})


def tip_shapes(hand: Hand, finger: str) -> list[LinkGeometry]:
    """Return the shapes of the last link of a finger that has some."""
    spec = hand.fingers[finger]
    shaped = {item.link for item in hand.tree.geometries}
    ends = [*spec.links, *(() if spec.tip is None else (spec.tip,))]
    last = [link for link in ends if link in shaped][-1:]
    return [item for item in hand.tree.geometries if item.link in last]


def hand_at(hand: Hand, independent: FloatArray) -> Hand:
    """Return a hand at (a,) positions of its independent joints; what stays is not checked."""
    leaders = hand.tree.coupling.leaders
    return hand.with_configuration(
        {
            hand.joint_names[leader]: float(value)
            for leader, value in zip(leaders, independent, strict=True)
            if value != hand.positions[leader]
        }
    )


def joints_at_limit(hand: Hand, finger: str) -> tuple[str, ...]:
    """Return the independent joints that move a finger and stand at an end of their range."""
    lower, upper = hand.tree.ranges
    independent = hand.tree.coupling.independent(hand.positions)
    named = []
    for column in driving_columns(hand, finger):
        position = independent[column]
        span = upper[column] - lower[column]
        slack = AT_LIMIT * span if np.isfinite(span) else AT_LIMIT
        if span > 0.0 and min(position - lower[column], upper[column] - position) <= slack:
            named.append(hand.tree.leader_names[column])
    return tuple(named)


def flexion_rates(hand: Hand, finger: str) -> dict[int, float]:
    """Return the joints that flex a finger, as +1 or -1 by column, one sense for the finger.

    A finger flexes about the axis of its last joint and of the joints of the same kind whose axes
    are within 30 degrees of it, at the hand's configuration. Spread and opposition are not among
    them.
    """
    tree = hand.tree
    columns = driving_columns(hand, finger)
    if not columns:
        return {}
    J = tree.kinematics(hand.positions).J
    joints = {column: tree.coupling.leaders[column] for column in columns}
    last = max(columns, key=lambda column: int(tree.supports[joints[column] + 1].sum()))
    turns = {column: tree.joint_kinds[joint] != "prismatic" for column, joint in joints.items()}
    axes = {
        column: J[3:, joint] if turns[column] else J[:3, joint] for column, joint in joints.items()
    }
    rates: dict[int, float] = {}
    for column in columns:
        cosine = float(axes[column] @ axes[last])
        if turns[column] == turns[last] and abs(cosine) > _COS_PARALLEL:
            rates[column] = math.copysign(1.0, cosine)
    return rates


def bent_hand(hand: Hand, change: FloatArray) -> Hand:
    """Return the hand with its actuators moved by (L,) rad or m; entries after them are left out.

    Raises:
        SceneError: If a joint would leave its limits.
    """
    columns = hand.actuation.from_independent
    moved = hand.tree.coupling.independent(hand.positions) + columns @ change[: columns.shape[1]]
    try:
        return hand.with_configuration(moved)
    except ArgumentError as error:
        raise SceneError(f"a joint stands at its limit: {error}") from error


_WRIST = 3
_LEVER = 0.1  # m: how far from the palm a radian counts as much as it moves there
_STARTS = 4
_REACHED = 1e-7  # m: no other start is tried
_INSIDE = 1e-6  # share of a joint's range that the solver keeps off its ends at the start


@dataclass(frozen=True, eq=False)
class Arm(Record):
    """The joints between a robot's base and a palm.

    Attributes:
        joint: Pinocchio index of the joint that carries the palm.
        columns: The independent joints that move it.
    """

    joint: int
    columns: tuple[int, ...]

    def moved_links(self, tree: KinematicTree) -> frozenset[str]:
        """Return all links that the arm moves."""
        joints = tree.coupling.S[:, list(self.columns)].any(axis=1)
        return frozenset(
            link for link, own in tree.link_joints.items() if (tree.supports[own] & joints).any()
        )

    def links(self, tree: KinematicTree) -> frozenset[str]:
        """Return the links that the palm carries, its own among them."""
        return frozenset(
            link
            for link, own in tree.link_joints.items()
            if own and tree.supports[own, self.joint - 1]
        )


def arm_above(hand: Hand, carrier: int) -> Arm | None:
    """Return the arm that carries a body; None: its base or a wrist of three joints carries it.

    Args:
        hand: The hand.
        carrier: Pinocchio index of the joint that the palm hangs on, 0 for the base.
    """
    tree = hand.tree
    moving = np.flatnonzero(tree.supports[carrier]) if carrier else np.array([], dtype=int)
    lower, upper = tree.ranges
    columns = [k for k in tree.coupling.drivers(moving.tolist()) if upper[k] > lower[k]]
    return Arm(carrier, tuple(columns)) if len(columns) > _WRIST else None


def brought_palm(
    hand: Hand, arm: Arm, T_world_palm: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Bring a palm to a pose, or as near as its arm gets it: least squares from several starts.

    Args:
        hand: The hand; the first start is where its arm is.
        arm: The arm.
        T_world_palm: (4, 4) wanted pose of the joint that carries the palm.
        rng: Where further starts are drawn from.

    Returns:
        (a,) positions of the independent joints, and the (4, 4) pose that they bring it to.
    """
    tree, columns = hand.tree, list(arm.columns)
    positions = tree.coupling.independent(hand.positions)
    lower, upper = (ends[columns] for ends in searched_ranges(tree, positions, np.pi))
    feet = np.vstack([np.zeros(3), _LEVER * np.eye(3)])  # points of the palm
    wanted = feet @ T_world_palm[:3, :3].T + T_world_palm[:3, 3]
    S = tree.coupling.S[:, columns]

    def at(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        positions[columns] = values
        kinematics = tree.kinematics(tree.coupling.all_positions(positions))
        return kinematics.T_world_joint[arm.joint], kinematics.J * tree.supports[arm.joint]

    def points(values: FloatArray) -> FloatArray:
        T = at(values)[0]
        return feet @ T[:3, :3].T + T[:3, 3]

    def jacobian(values: FloatArray) -> FloatArray:
        J = at(values)[1] @ S
        turns = np.cross(J[3:].T, points(values)[:, None])
        return np.asarray(J[:3] + turns.transpose(0, 2, 1), dtype=np.float64).reshape(
            -1, len(values)
        )

    def misses(values: FloatArray) -> FloatArray:
        return (points(values) - wanted).ravel()

    best, least = positions[columns].copy(), np.inf
    for attempt in range(_STARTS):
        start = best if attempt == 0 else rng.uniform(lower, upper)
        found = least_misses(misses, jacobian, start, (lower, upper), 60)
        miss = float(np.linalg.norm(misses(found)))
        if miss < least:
            best, least = found, miss
        if least <= _REACHED:
            break
    T_there = at(best)[0]
    return positions, T_there
