"""What moves the joints of an MJCF: motors, tendons and equations, as limits and couplings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import RobotError
from graspless_pin.findings import Finding, FindingCode, tell
from graspless_pin.geometry.hand.mjcf_source import MjcfSource
from graspless_pin.problem.checks import FloatArray

_PLAY = 0.2
"""Of a tendon's travel: one that may change by less couples its joints."""

Mimic = tuple[int, float, float]
"""Leader, multiplier and offset of a coupled joint."""


def motor_joints(source: MjcfSource) -> list[int]:
    """Return the joints that motors move."""
    return [joint for actuator in range(source.model.nu) for joint in _pull(source, actuator)]


def _pull(source: MjcfSource, actuator: int) -> dict[int, float]:
    """Return the gear ratio (m for tendons) of an actuator at each joint that it moves."""
    model, kinds = source.model, source.mujoco.mjtTrn
    gear, target = float(model.actuator_gear[actuator, 0]), int(model.actuator_trnid[actuator, 0])
    if model.actuator_trntype[actuator] == kinds.mjTRN_JOINT:
        return {target: gear}
    if model.actuator_trntype[actuator] == kinds.mjTRN_TENDON:
        return {joint: gear * arm for joint, arm in _arms(source, target).items()}
    return {}


def _arms(source: MjcfSource, tendon: int) -> dict[int, float]:
    """Return the moment arms of a fixed tendon by joint; none for one that winds in space."""
    model = source.model
    first, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    span = range(first, first + count)
    if any(model.wrap_type[k] != source.mujoco.mjtWrap.mjWRAP_JOINT for k in span):
        return {}
    return {int(model.wrap_objid[k]): float(model.wrap_prm[k]) for k in span}


def efforts(source: MjcfSource, mimics: Mapping[int, Mimic]) -> dict[int, float]:
    """Return the torque (force) that motors bear both ways, by joint, where it is limited.

    Args:
        source: The file.
        mimics: The coupled joints; a leader's torque counts theirs, too.

    Warns:
        GrasplessPinWarning: A motor pulls joints that are not coupled: its limit is none of theirs.
    """
    model = source.model
    limits: dict[int, float] = {}
    for actuator in range(model.nu):
        pull = _pull(source, actuator)
        leaders: dict[int, float] = {}
        for joint, ratio in pull.items():
            leader, multiplier, _ = mimics.get(joint, (joint, 1.0, 0.0))
            leaders[leader] = leaders.get(leader, 0.0) + multiplier * ratio
        for leader, ratio in leaders.items():
            limit = abs(ratio) * _force(source, actuator) if len(leaders) == 1 else np.inf
            limits[leader] = limits.get(leader, 0.0) + limit
        if len(leaders) > 1:
            arms = ", ".join(f"{source.joint(joint)}: {arm:g}" for joint, arm in pull.items())
            name = model.actuator(actuator).name
            tell(
                Finding(
                    FindingCode.SHARED_TENDON, name,
                    f"{source.path}: actuator {name!r} pulls a tendon over several joints "
                    f"({arms} m), so no limit of theirs is known",
                    "declare it under tendons in a robot file",
                )
            )  # fmt: skip
    for joint in map(int, np.flatnonzero(model.jnt_actfrclimited)):
        limits[joint] = min(limits.get(joint, np.inf), _both_ways(model.jnt_actfrcrange[joint]))
    return {joint: limit for joint, limit in limits.items() if limit < np.inf}


def _force(source: MjcfSource, actuator: int) -> float:
    """Return the force of an actuator that it has both ways, infinite if it is not limited."""
    model = source.model
    bound = np.inf
    if model.actuator_forcelimited[actuator]:
        bound = _both_ways(model.actuator_forcerange[actuator])
    is_plain = not model.actuator_biasprm[actuator].any()
    if model.actuator_ctrllimited[actuator] and is_plain:
        gain = abs(float(model.actuator_gainprm[actuator, 0]))
        bound = min(bound, gain * _both_ways(model.actuator_ctrlrange[actuator]))
    return bound


def couplings(source: MjcfSource, inside: NDArray[np.bool_]) -> dict[int, Mimic]:
    """Return leader, multiplier and offset of each joint that equations or tendons couple.

    Args:
        source: The file.
        inside: Bodies of the robot.

    Raises:
        RobotError: If bodies of the robot form a loop, or a coupling is not linear in two joints.
    """
    model, kinds = source.model, source.mujoco.mjtEq
    found: dict[int, Mimic] = {}
    for index in np.flatnonzero(model.eq_active0):
        kind, data = kinds(model.eq_type[index]), model.eq_data[index]
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        name = model.equality(index).name or f"no. {index + 1}"
        where = f"{source.path}: the equality {name!r}"
        if kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            ends = _bodies(source, int(index), first, second)
            if all(inside[end] for end in ends):
                names = " and ".join(repr(model.body(end).name) for end in ends)
                raise RobotError(
                    f"{where} closes a loop between {names}; joints have to form a tree: "
                    "leave it out and couple the joints instead"
                )
        elif kind == kinds.mjEQ_JOINT and inside[model.jnt_bodyid[first]]:
            if second < 0 or data[2:5].any():
                raise RobotError(
                    f"{where} of joint {source.joint(first)!r} is not linear in one other joint"
                )
            start = model.qpos0[model.jnt_qposadr[[first, second]]]
            offset = data[0] + start[0] - data[1] * start[1]
            found[first] = second, float(data[1]), float(offset)
        elif kind == kinds.mjEQ_TENDON and _is_of(source, first, inside):
            if second >= 0 or len(_arms(source, first)) != 2:
                raise RobotError(f"{where} is not one of a tendon over two joints")
            _couple(source, first, float(model.tendon_length0[first] + data[0]), found)
    for tendon in np.flatnonzero(model.tendon_limited):
        low, high = model.tendon_range[tendon]
        arms = _arms(source, int(tendon))
        travel = [abs(arm) * np.ptp(model.jnt_range[joint]) for joint, arm in arms.items()]
        if len(arms) == 2 and high - low <= _PLAY * min(travel):
            _couple(source, int(tendon), 0.5 * float(low + high), found)
    return found


def _is_of(source: MjcfSource, tendon: int, inside: NDArray[np.bool_]) -> bool:
    """Return whether a tendon may move joints of the robot: all but those over others' alone."""
    joints = list(_arms(source, tendon))
    return not joints or bool(inside[source.model.jnt_bodyid[joints]].any())


def _couple(source: MjcfSource, tendon: int, length: float, found: dict[int, Mimic]) -> None:
    """Couple the two joints of a fixed tendon of known length; the driven one leads."""
    arms = _arms(source, tendon)
    driven = motor_joints(source)
    follower, leader = sorted(arms, key=lambda joint: (joint in driven, -joint))
    factor, offset = -arms[leader] / arms[follower], length / arms[follower]
    found[follower] = leader, factor, offset


def _bodies(source: MjcfSource, index: int, first: int, second: int) -> tuple[int, int]:
    """Return the bodies that an equality joins, which may name sites."""
    model = source.model
    if model.eq_objtype[index] == source.mujoco.mjtObj.mjOBJ_SITE:
        return int(model.site_bodyid[first]), int(model.site_bodyid[second])
    return first, second


def _both_ways(bounds: FloatArray) -> float:
    """Return what is borne both ways; infinite where one way is not limited or not possible."""
    low, high = float(bounds[0]), float(bounds[1])
    return min(-low, high) if low < 0.0 < high else np.inf
