"""What moves the joints of an MJCF: motors, tendons and equations, as limits and couplings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.coupling import groups_that_share
from graspless_pin.geometry.hand.mjcf_source import MjcfSource
from graspless_pin.geometry.hand.robot_model import DrawnTendon
from graspless_pin.problem.checks import FloatArray

_PLAY = 0.2
"""Of a tendon's travel: one that may change by less couples its joints."""

Mimic = tuple[dict[int, float], float]
"""Multipliers by leader, and offset, of a coupled joint."""


def motor_joints(source: MjcfSource) -> list[int]:
    """Return the joints that motors move."""
    return [joint for actuator in range(source.model.nu) for joint in _pull(source, actuator)]


def _pull(source: MjcfSource, actuator: int) -> dict[int, float]:
    """Return the gear ratio (m for tendons) of an actuator at each joint that it moves."""
    model, kinds = source.model, source.mujoco.mjtTrn
    gear, target = float(model.actuator_gear[actuator, 0]), int(model.actuator_trnid[actuator, 0])
    way = kinds(int(model.actuator_trntype[actuator]))
    if way in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
        return {target: gear}
    if way == kinds.mjTRN_TENDON:
        return {joint: gear * arm for joint, arm in _arms(source, target).items()}
    return {}


def _arms(source: MjcfSource, tendon: int) -> dict[int, float]:
    """Return the moment arms of a fixed tendon by joint; none for one that winds in space."""
    model = source.model
    first, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    span = range(first, first + count)
    if any(model.wrap_type[k] != source.mujoco.mjtWrap.mjWRAP_JOINT for k in span):
        return {}
    return {int(model.wrap_objid[k]): float(model.wrap_prm[k]) for k in span if model.wrap_prm[k]}


def _led(pull: Mapping[int, float], mimics: Mapping[int, Mimic]) -> dict[int, float]:
    """Return an actuator's gear ratio at each joint that leads those that it moves."""
    leaders: dict[int, float] = {}
    for joint, ratio in pull.items():
        follows, _ = mimics.get(joint, ({joint: 1.0}, 0.0))
        others = {other: mimics[other] for other in mimics if other != joint}
        deeper = {leader: ratio * factor for leader, factor in follows.items()}
        for leader, part in (_led(deeper, others) if joint in mimics else deeper).items():
            leaders[leader] = leaders.get(leader, 0.0) + part
    return {leader: ratio for leader, ratio in leaders.items() if ratio}


def motors(
    source: MjcfSource, mimics: Mapping[int, Mimic], inside: NDArray[np.bool_]
) -> tuple[dict[int, float], dict[str, DrawnTendon]]:
    """Return what motors bear both ways, by joint, where it is limited, and tendons by name.

    Args:
        source: The file.
        mimics: The coupled joints; a leader's torque counts theirs, too.
        inside: Bodies of the robot.

    Warns:
        GrasplessPinWarning: A motor is left out: what it does at its joints is not known.
    """
    model = source.model
    pulls = {actuator: _pull(source, actuator) for actuator in range(model.nu)}
    led = {actuator: _led(pull, mimics) for actuator, pull in pulls.items()}
    tendons = _driven_tendons(source, pulls, led, inside)
    limits: dict[int, float] = {}
    for actuator, leaders in led.items():
        for leader, ratio in leaders.items():
            limit = np.inf
            if len(leaders) == 1:
                limit = abs(ratio) * _both_ways(_bounds(source, actuator))
            limits[leader] = limits.get(leader, 0.0) + limit
    for joint in map(int, np.flatnonzero(model.jnt_actfrclimited)):
        limits[joint] = min(limits.get(joint, np.inf), _both_ways(model.jnt_actfrcrange[joint]))
    return {joint: limit for joint, limit in limits.items() if limit < np.inf}, tendons


def _driven_tendons(
    source: MjcfSource,
    pulls: Mapping[int, dict[int, float]],
    led: Mapping[int, dict[int, float]],
    inside: NDArray[np.bool_],
) -> dict[str, DrawnTendon]:
    """Return the motors of several leaders each; say which of them cannot be told apart."""
    model = source.model
    taken = {model.joint(joint).name for joint in range(model.njnt)}
    found: dict[str, DrawnTendon] = {}
    for group in groups_that_share({str(one): set(own) for one, own in led.items() if own}):
        members = [int(one) for one in group]
        joints = sorted({joint for one in members for joint in led[one]})
        R = np.array([[led[one].get(joint, 0.0) for joint in joints] for one in members])
        shared = [one for one in members if len(led[one]) > 1]
        told_apart = len(shared) == len(members) and np.linalg.matrix_rank(R) == len(members)
        for one in shared:
            name = model.actuator(one).name or f"actuator_{one}"
            if told_apart:
                own = f"{name}_tendon" if name in taken else name
                pulled = {source.joint(joint): arm for joint, arm in pulls[one].items()}
                found[own] = DrawnTendon(pulled, *_bounds(source, one))
                continue
            why = "other motors that pull the same way"
            if len(shared) < len(members):
                why = "motors of single joints among them"
            arms = ", ".join(f"{source.joint(joint)}: {arm:g}" for joint, arm in pulls[one].items())
            _leave_out(
                source, name, f"pulls a tendon over several joints ({arms} m); {why} cannot be "
                "told apart from it, so no limit of theirs is known"
            )  # fmt: skip
    for one in (one for one in pulls if not pulls[one] and _is_of_robot(source, one, inside)):
        _leave_out(
            source, model.actuator(one).name or f"actuator_{one}",
            "acts through no joint and no fixed tendon: what it does depends on the pose",
        )  # fmt: skip
    return found


def _is_of_robot(source: MjcfSource, actuator: int, inside: NDArray[np.bool_]) -> bool:
    """Return whether an actuator without joints may act on the robot; of tendons nothing tells."""
    model, kinds = source.model, source.mujoco.mjtTrn
    target = int(model.actuator_trnid[actuator, 0])
    way = kinds(int(model.actuator_trntype[actuator]))
    if way in (kinds.mjTRN_SITE, kinds.mjTRN_SLIDERCRANK):
        return bool(inside[model.site_bodyid[target]])
    return bool(inside[target]) if way == kinds.mjTRN_BODY else True


def _leave_out(source: MjcfSource, name: str, why: str) -> None:
    emit(
        Finding(
            FindingCode.SHARED_TENDON, name, f"{source.path}: actuator {name!r} {why}",
            "give its joints' limits, or declare it under tendons in a robot file",
        )
    )  # fmt: skip


def _bounds(source: MjcfSource, actuator: int) -> tuple[float, float]:
    """Return the lowest and highest force of an actuator, infinite where it is not limited."""
    model = source.model
    low, high = -np.inf, np.inf
    if model.actuator_forcelimited[actuator]:
        low, high = map(float, model.actuator_forcerange[actuator])
    if model.actuator_ctrllimited[actuator] and not model.actuator_biasprm[actuator].any():
        ends = float(model.actuator_gainprm[actuator, 0]) * model.actuator_ctrlrange[actuator]
        low, high = max(low, float(ends.min())), min(high, float(ends.max()))
    return low, high


def couplings(source: MjcfSource, inside: NDArray[np.bool_]) -> dict[int, Mimic]:
    """Return multipliers and offset of each joint that equations or tendons couple.

    Args:
        source: The file.
        inside: Bodies of the robot.

    Raises:
        RobotError: If bodies of the robot form a loop, or a coupling is not linear or one too many.
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
            found[first] = {second: float(data[1])}, float(offset)
        elif kind == kinds.mjEQ_TENDON and _is_of(source, where, first, inside):
            _couple(source, where, *_held_tendon(source, where, int(index)), found)
    for tendon in map(int, np.flatnonzero(model.tendon_limited)):
        low, high = model.tendon_range[tendon]
        arms = _arms(source, tendon)
        travel = [
            abs(arm) * np.ptp(model.jnt_range[joint]) if model.jnt_limited[joint] else np.inf
            for joint, arm in arms.items()
        ]
        where = f"{source.path}: the tendon {model.tendon(tendon).name!r}"
        is_held = len(arms) > 1 and high - low <= _PLAY * min(travel)
        if is_held and _is_of(source, where, tendon, inside):
            _couple(source, where, arms, 0.5 * float(low + high), found)
    return found


def _held_tendon(source: MjcfSource, where: str, index: int) -> tuple[dict[int, float], float]:
    """Return the moment arms and the length of a tendon's equality, or of two tendons'."""
    model, data = source.model, source.model.eq_data[index]
    first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
    arms, length = _arms(source, first), float(model.tendon_length0[first] + data[0])
    linear = bool(arms)
    if second >= 0:
        others = _arms(source, second)
        linear = linear and bool(others) and not data[2:5].any()
        arms = {joint: arms.get(joint, 0.0) - data[1] * others.get(joint, 0.0)
                for joint in {**arms, **others}}  # fmt: skip
        length -= float(data[1] * model.tendon_length0[second])
    arms = {joint: float(arm) for joint, arm in arms.items() if arm}
    if not linear or len(arms) < 2:
        raise RobotError(f"{where} is not linear in two or more joints")
    return arms, length


def _is_of(source: MjcfSource, where: str, tendon: int, inside: NDArray[np.bool_]) -> bool:
    """Return whether a tendon moves joints of the robot; one that winds in space may."""
    joints = list(_arms(source, tendon))
    own = inside[source.model.jnt_bodyid[joints]]
    if own.any() and not own.all():
        raise RobotError(f"{where} joins joints of the hand to others; leave it out")
    return not joints or bool(own.all())


def _couple(
    source: MjcfSource, where: str, arms: dict[int, float], length: float, found: dict[int, Mimic]
) -> None:
    """Couple the joints of a tendon of known length; one that nothing drives yet follows."""
    driven = motor_joints(source)
    follower = min(arms, key=lambda joint: (joint in found, joint in driven, -joint))
    if follower in found:
        raise RobotError(f"{where} couples joints that all follow others; leave one coupling out")
    arm = arms[follower]
    leaders = {joint: -other / arm for joint, other in arms.items() if joint != follower}
    found[follower] = leaders, length / arm


def _bodies(source: MjcfSource, index: int, first: int, second: int) -> tuple[int, int]:
    """Return the bodies that an equality joins, which may name sites."""
    model = source.model
    if model.eq_objtype[index] == source.mujoco.mjtObj.mjOBJ_SITE:
        return int(model.site_bodyid[first]), int(model.site_bodyid[second])
    return first, second


def _both_ways(bounds: Sequence[float] | FloatArray) -> float:
    """Return what is borne both ways; infinite where one way is not limited or not possible."""
    low, high = map(float, bounds)
    return min(-low, high) if low < 0.0 < high else np.inf
