"""Independent joints that move a finger or a palm: their ranges, flexion, and inverse kinematics.

Also arms that bring a palm to a pose, or as near as possible, with fixed bases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.hand.coupling import groups_sharing_joints
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import KinematicTree, LinkGeometry
from graspless_pin.problem.checks import FloatArray, check_known
from graspless_pin.records import Record

AT_LIMIT = 1e-4
"""Distance from an end of a joint's range within which it is at its limit, as a share of it."""

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
            "has no fingers; name their joints in the robot file or in the scene, or add "
            "collision shapes to links without any, which graspless-pin inspect lists",
        )
    check_known("fingers", "finger", fingers or (), hand.fingers)
    return tuple(hand.fingers) if fingers is None else tuple(dict.fromkeys(fingers))


def driving_columns(hand: Hand, finger: str) -> list[int]:
    """Return the independent joints (columns of the coupling) that drive a finger's joints."""
    index = hand.tree.joint_index
    return hand.tree.coupling.drivers(index[joint] for joint in hand.fingers[finger].joints)


def search_ranges(tree: KinematicTree, start: FloatArray, most: float) -> tuple[FloatArray, ...]:
    """Return the (a,) lower and upper bounds of the independent joints in a search.

    Args:
        tree: The kinematic tree.
        start: (a,) positions of the joints.
        most: Range to each side of ``start`` for a joint without a limit, rad or m.
    """
    ends = zip(tree.ranges, (-most, most), strict=True)
    return tuple(np.where(np.isfinite(limit), limit, start + reach) for limit, reach in ends)


def least_squares_positions(
    residuals: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    bounds: Sequence[FloatArray],
    evaluations: int,
) -> FloatArray:
    """Return the least-squares solution of residuals within bounds, found from a start."""
    lower, upper = bounds
    margin = _START_MARGIN * (upper - lower)
    return least_squares(
        residuals,
        np.clip(start, lower + margin, upper - margin),
        jac=jacobian,  # pyright: ignore[reportArgumentType] - a function will do
        bounds=(lower, upper),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=evaluations,
    ).x


def groups_of_fingers(hand: Hand, fingers: Sequence[str]) -> list[list[str]]:
    """Put fingers that share an independent joint, as the jaws of a gripper do, into one group."""
    return groups_sharing_joints({finger: set(driving_columns(hand, finger)) for finger in fingers})


def tip_shapes(hand: Hand, finger: str) -> list[LinkGeometry]:
    """Return the collision shapes of the last link of a finger that has any."""
    spec = hand.fingers[finger]
    shaped = {item.link for item in hand.tree.geometries}
    ends = [*spec.links, *(() if spec.tip is None else (spec.tip,))]
    last = [link for link in ends if link in shaped][-1:]
    return [item for item in hand.tree.geometries if item.link in last]


def hand_at_positions(hand: Hand, independent: FloatArray) -> Hand:
    """Return a hand at (a,) positions of its independent joints; joints that stay are unchecked."""
    leaders = hand.tree.coupling.leaders
    return hand.with_configuration(
        {
            hand.joint_names[leader]: float(value)
            for leader, value in zip(leaders, independent, strict=True)
            if value != hand.positions[leader]
        }
    )


def joints_at_limit(hand: Hand, finger: str) -> tuple[str, ...]:
    """Return the independent joints that move a finger and are at an end of their range."""
    lower, upper = hand.tree.ranges
    independent = hand.tree.coupling.independent(hand.positions)
    at_limit = []
    for column in driving_columns(hand, finger):
        position = independent[column]
        span = upper[column] - lower[column]
        tolerance = AT_LIMIT * span if np.isfinite(span) else AT_LIMIT
        if span > 0.0 and min(position - lower[column], upper[column] - position) <= tolerance:
            at_limit.append(hand.tree.leader_names[column])
    return tuple(at_limit)


def flexion_rates(hand: Hand, finger: str) -> dict[int, float]:
    """Return the flexion rates of a finger, +1 or -1 by column, of consistent sense.

    A finger flexes about the axis of its last joint and of the joints of the same kind whose axes
    are within 30 degrees of it, at the hand's configuration. Spread and opposition joints are not
    included.
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


def hand_with_moved_actuators(hand: Hand, change: FloatArray) -> Hand:
    """Return the hand with its actuators moved by (L,) rad or m; further entries are ignored.

    Raises:
        SceneError: If a joint would leave its limits.
    """
    columns = hand.actuation.from_independent
    moved = hand.tree.coupling.independent(hand.positions) + columns @ change[: columns.shape[1]]
    try:
        return hand.with_configuration(moved)
    except ArgumentError as error:
        raise SceneError(f"a joint is at its limit: {error}") from error


_WRIST_JOINTS = 3
_LEVER = 0.1  # m: lever arm that weighs rotations of the palm against translations
_START_COUNT = 4
_REACHED_ERROR = 1e-7  # m: residual at which no other start is tried
_START_MARGIN = 1e-6  # margin of the start from the ends of a joint's range, as a share of it


@dataclass(frozen=True, eq=False)
class Arm(Record):
    """The joints between a robot's base and a palm.

    Attributes:
        joint: Pinocchio index of the joint that carries the palm.
        columns: The independent joints that move the palm.
    """

    joint: int
    columns: tuple[int, ...]

    def moved_links(self, tree: KinematicTree) -> frozenset[str]:
        """Return all links that the arm's joints move."""
        joints = tree.coupling.S[:, list(self.columns)].any(axis=1)
        return frozenset(
            link for link, own in tree.link_joints.items() if (tree.supports[own] & joints).any()
        )

    def links(self, tree: KinematicTree) -> frozenset[str]:
        """Return the links that the palm's joint carries, the palm's own among them."""
        return frozenset(
            link
            for link, own in tree.link_joints.items()
            if own and tree.supports[own, self.joint - 1]
        )


def arm_above(hand: Hand, carrier: int) -> Arm | None:
    """Return the arm that carries a body; None: at most three joints (a wrist) move it.

    Args:
        hand: The hand.
        carrier: Pinocchio index of the joint that carries the palm, 0 for the base.
    """
    tree = hand.tree
    moving = np.flatnonzero(tree.supports[carrier]) if carrier else np.array([], dtype=int)
    lower, upper = tree.ranges
    columns = [k for k in tree.coupling.drivers(moving.tolist()) if upper[k] > lower[k]]
    return Arm(carrier, tuple(columns)) if len(columns) > _WRIST_JOINTS else None


def palm_inverse_kinematics(
    hand: Hand, arm: Arm, T_world_palm: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Solve an arm's inverse kinematics for a palm pose, by least squares from several starts.

    Args:
        hand: The hand; the first start is its configuration.
        arm: The arm.
        T_world_palm: (4, 4) desired pose of the joint that carries the palm.
        rng: Random generator of further starts.

    Returns:
        (a,) positions of the independent joints, and the (4, 4) pose at these positions.
    """
    tree, columns = hand.tree, list(arm.columns)
    positions = tree.coupling.independent(hand.positions)
    lower, upper = (ends[columns] for ends in search_ranges(tree, positions, np.pi))
    palm_points = np.vstack([np.zeros(3), _LEVER * np.eye(3)])  # points of the palm
    target_points = palm_points @ T_world_palm[:3, :3].T + T_world_palm[:3, 3]
    S = tree.coupling.S[:, columns]

    def palm_kinematics(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        positions[columns] = values
        kinematics = tree.kinematics(tree.coupling.all_positions(positions))
        return kinematics.T_world_joint[arm.joint], kinematics.J * tree.supports[arm.joint]

    def points_at(values: FloatArray) -> FloatArray:
        T = palm_kinematics(values)[0]
        return palm_points @ T[:3, :3].T + T[:3, 3]

    def jacobian(values: FloatArray) -> FloatArray:
        J = palm_kinematics(values)[1] @ S
        turns = np.cross(J[3:].T, points_at(values)[:, None])
        return np.asarray(J[:3] + turns.transpose(0, 2, 1), dtype=np.float64).reshape(
            -1, len(values)
        )

    def residuals(values: FloatArray) -> FloatArray:
        return (points_at(values) - target_points).ravel()

    best, least_error = positions[columns].copy(), np.inf
    for attempt in range(_START_COUNT):
        start = best if attempt == 0 else rng.uniform(lower, upper)
        solution = least_squares_positions(residuals, jacobian, start, (lower, upper), 60)
        error = float(np.linalg.norm(residuals(solution)))
        if error < least_error:
            best, least_error = solution, error
        if least_error <= _REACHED_ERROR:
            break
    T_reached = palm_kinematics(best)[0]
    return positions, T_reached
