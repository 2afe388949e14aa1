"""Which independent joints move a finger, how far they go and which flex it; hands moved so."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.hand.coupling import groups_that_share
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import LinkGeometry
from graspless_pin.problem.checks import FloatArray, unknown_name

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
            "hand", "has no fingers; name their joints in the robot file or in the scene"
        )
    for name in fingers or ():
        if name not in hand.fingers:
            raise unknown_name("fingers", "finger", name, tuple(hand.fingers))
    return tuple(hand.fingers) if fingers is None else tuple(dict.fromkeys(fingers))


def driving_columns(hand: Hand, finger: str) -> list[int]:
    """Return which independent joints (columns of the coupling) drive a finger's joints."""
    index = hand.tree.joint_index
    return hand.tree.coupling.drivers(index[joint] for joint in hand.fingers[finger].joints)


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
    leaders = hand.tree.coupling.leaders
    named = []
    for column in driving_columns(hand, finger):
        position = hand.positions[leaders[column]]
        span = upper[column] - lower[column]
        slack = AT_LIMIT * span if np.isfinite(span) else AT_LIMIT
        if span > 0.0 and min(position - lower[column], upper[column] - position) <= slack:
            named.append(hand.joint_names[leaders[column]])
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
