"""The `RobotModel` of an MJCF.

MuJoCo reads the file and applies defaults, included files and inferred inertias. Elements that a
tree of rigid links cannot represent are refused by name, or left out if static forces do not depend
on them. Motors, tendons and equalities become limits and couplings.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from graspless_pin.errors import RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.coupling import groups_sharing_joints
from graspless_pin.geometry.hand.mjcf_source import (
    MjcfSource,
    geom_shape,
    is_supported_geom,
    mj_pose,
)
from graspless_pin.geometry.hand.robot_model import (
    DrawnTendon,
    RobotJoint,
    RobotLink,
    RobotModel,
    parsed_limit,
    root_of_tree,
)
from graspless_pin.geometry.poses import rigid
from graspless_pin.geometry.robots.description import JointCoupling
from graspless_pin.problem.checks import FloatArray

_LOCKED_SHARE = 0.2
"""A tendon whose range is below this share of its travel couples its joints."""

Mimic = tuple[dict[int, float], float]
"""Multipliers by leader, and offset, of a coupled joint."""


def motor_joints(source: MjcfSource) -> list[int]:
    """Return the joints that motors move."""
    return [joint for actuator in range(source.model.nu) for joint in _gear_map(source, actuator)]


def _gear_map(source: MjcfSource, actuator: int) -> dict[int, float]:
    """Return the gear ratio (m for tendons) of an actuator at each joint that it moves."""
    model, kinds = source.model, source.mujoco.mjtTrn
    gear, target = float(model.actuator_gear[actuator, 0]), int(model.actuator_trnid[actuator, 0])
    transmission = kinds(int(model.actuator_trntype[actuator]))
    if transmission in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
        return {target: gear}
    if transmission == kinds.mjTRN_TENDON:
        return {joint: gear * arm for joint, arm in _tendon_arms(source, target).items()}
    return {}


def _tendon_arms(source: MjcfSource, tendon: int) -> dict[int, float]:
    """Return the moment arms of a fixed tendon by joint, m; empty for a spatial tendon."""
    model = source.model
    first, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    span = range(first, first + count)
    if any(model.wrap_type[k] != source.mujoco.mjtWrap.mjWRAP_JOINT for k in span):
        return {}
    return {int(model.wrap_objid[k]): float(model.wrap_prm[k]) for k in span if model.wrap_prm[k]}


def _leader_gears(pull: Mapping[int, float], mimics: Mapping[int, Mimic]) -> dict[int, float]:
    """Return an actuator's gear ratio at the leaders of the joints that it moves."""
    leaders: dict[int, float] = {}
    for joint, ratio in pull.items():
        follows, _ = mimics.get(joint, ({joint: 1.0}, 0.0))
        others = {other: mimics[other] for other in mimics if other != joint}
        deeper = {leader: ratio * factor for leader, factor in follows.items()}
        for leader, part in (_leader_gears(deeper, others) if joint in mimics else deeper).items():
            leaders[leader] = leaders.get(leader, 0.0) + part
    return {leader: ratio for leader, ratio in leaders.items() if ratio}


def motor_limits(
    source: MjcfSource, mimics: Mapping[int, Mimic], inside: NDArray[np.bool_]
) -> tuple[dict[int, float], dict[str, DrawnTendon]]:
    """Return the symmetric effort limits by joint, if limited, and the driven tendons by name.

    Args:
        source: The model that MuJoCo has read.
        mimics: The coupled joints; a leader's torque includes theirs.
        inside: Mask of the bodies of the robot.

    Warns:
        GrasplessPinWarning: A motor is left out: its effect at the joints is unknown.
    """
    model = source.model
    pulls = {actuator: _gear_map(source, actuator) for actuator in range(model.nu)}
    leaders_of = {actuator: _leader_gears(pull, mimics) for actuator, pull in pulls.items()}
    tendons = _driven_tendons(source, pulls, leaders_of, inside)
    joint_limits = {
        int(joint): _symmetric_limit(model.jnt_actfrcrange[joint])
        for joint in np.flatnonzero(model.jnt_actfrclimited)
    }
    totals: dict[int, float] = defaultdict(float)
    joint_torques: dict[int, float] = defaultdict(float)
    opposing_torques: dict[int, float] = defaultdict(float)
    for actuator, leaders in leaders_of.items():
        pull, is_single = pulls[actuator], len(leaders) == 1
        parts = [part for one in pull for part in _leader_gears({one: pull[one]}, mimics).values()]
        opposes = is_single and min(parts) < 0.0 < max(parts)  # its joints act against each other
        ends = _tension_span(source, actuator, pulls) if opposes else _force_span(source, actuator)
        force = _symmetric_limit(ends) if is_single else np.inf
        for leader, ratio in leaders.items():
            totals[leader] += abs(ratio) * force if opposes else 0.0
        for joint, ratio in pull.items():
            if leaders and ratio and (not opposes or force < np.inf):
                (opposing_torques if opposes else joint_torques)[joint] += abs(ratio) * force
    # MuJoCo limits the total torque of all motors at a joint, also at a coupled one.
    for joint, torque in joint_torques.items():
        torque_limit = min(torque, joint_limits.get(joint, np.inf) - opposing_torques[joint])
        for leader, ratio in _leader_gears({joint: 1.0}, mimics).items():
            totals[leader] += abs(ratio) * torque_limit
    limits = joint_limits | totals
    return {joint: limit for joint, limit in limits.items() if limit < np.inf}, tendons


def _driven_tendons(
    source: MjcfSource,
    pulls: Mapping[int, dict[int, float]],
    led: Mapping[int, dict[int, float]],
    inside: NDArray[np.bool_],
) -> dict[str, DrawnTendon]:
    """Return the motors of several leaders each; emit findings on those that are redundant."""
    model = source.model
    joint_names = {model.joint(joint).name for joint in range(model.njnt)}
    driven: dict[str, DrawnTendon] = {}
    for group in groups_sharing_joints({str(one): set(own) for one, own in led.items() if own}):
        members = [int(one) for one in group]
        joints = sorted({joint for one in members for joint in led[one]})
        R = np.array([[led[one].get(joint, 0.0) for joint in joints] for one in members])
        shared = [one for one in members if len(led[one]) > 1]
        independent = len(shared) == len(members) and np.linalg.matrix_rank(R) == len(members)
        for one in shared:
            name = model.actuator(one).name or f"actuator_{one}"
            if independent:
                own = f"{name}_tendon" if name in joint_names else name
                arms_by_name = {source.joint(joint): arm for joint, arm in pulls[one].items()}
                driven[own] = DrawnTendon(arms_by_name, *_tension_span(source, one, pulls))
                continue
            reason = "other motors that pull the same way"
            if len(shared) < len(members):
                reason = "motors of some of these joints"
            arms = ", ".join(f"{source.joint(joint)}: {arm:g}" for joint, arm in pulls[one].items())
            _emit_left_out(
                source, name, f"pulls a tendon over several joints ({arms} m); {reason} cannot be "
                "distinguished from it, so their limits are unknown"
            )  # fmt: skip
    for one in (one for one in pulls if not pulls[one] and _acts_on_robot(source, one, inside)):
        _emit_left_out(
            source, model.actuator(one).name or f"actuator_{one}",
            "acts through no joint and no fixed tendon, so its effect depends on the pose",
        )  # fmt: skip
    return driven


def _tension_span(
    source: MjcfSource, actuator: int, pulls: Mapping[int, dict[int, float]]
) -> tuple[float, float]:
    """Return the force range of a tendon's motor within the force ranges of its joints."""
    low, high = _force_span(source, actuator)
    for joint, ratio in pulls[actuator].items():
        if source.model.jnt_actfrclimited[joint]:
            # MuJoCo clamps the total of all motors at a joint; here each has an equal share.
            count = sum(joint in pull for pull in pulls.values())
            ends = np.sort(source.model.jnt_actfrcrange[joint] / (count * ratio))
            low, high = max(low, float(ends[0])), min(high, float(ends[1]))
    return low, high


def _acts_on_robot(source: MjcfSource, actuator: int, inside: NDArray[np.bool_]) -> bool:
    """Return whether an actuator without joints may act on the robot; of a tendon, always."""
    model, kinds = source.model, source.mujoco.mjtTrn
    target = int(model.actuator_trnid[actuator, 0])
    transmission = kinds(int(model.actuator_trntype[actuator]))
    if transmission in (kinds.mjTRN_SITE, kinds.mjTRN_SLIDERCRANK):
        return bool(inside[model.site_bodyid[target]])
    return bool(inside[target]) if transmission == kinds.mjTRN_BODY else True


def _emit_left_out(source: MjcfSource, name: str, why: str) -> None:
    emit(
        Finding(
            FindingCode.SHARED_TENDON, name, f"{source.path}: actuator {name!r} {why}",
            "give its joints' limits, or declare it under tendons in a robot file",
        )
    )  # fmt: skip


def _force_span(source: MjcfSource, actuator: int) -> tuple[float, float]:
    """Return the lowest and highest force of an actuator, infinite if it is not limited."""
    model = source.model
    low, high = -np.inf, np.inf
    if model.actuator_forcelimited[actuator]:
        low, high = map(float, model.actuator_forcerange[actuator])
    integrates = model.actuator_dyntype[actuator] == source.mujoco.mjtDyn.mjDYN_INTEGRATOR
    for limited, ends in (
        (model.actuator_ctrllimited[actuator] and not integrates, model.actuator_ctrlrange),
        (model.actuator_actlimited[actuator], model.actuator_actrange),
    ):
        if limited and not model.actuator_biasprm[actuator].any():
            forces = float(model.actuator_gainprm[actuator, 0]) * ends[actuator]
            low, high = max(low, float(forces.min())), min(high, float(forces.max()))
    tendons = np.where(
        model.actuator_trntype == source.mujoco.mjtTrn.mjTRN_TENDON, model.actuator_trnid[:, 0], -1
    )
    tendon = tendons[actuator]
    if tendon >= 0 and model.tendon_actfrclimited[tendon]:
        # MuJoCo limits the sum of a tendon's motors without gears; here each has an equal share.
        ends = model.tendon_actfrcrange[tendon] / np.count_nonzero(tendons == tendon)
        low, high = max(low, float(ends[0])), min(high, float(ends[1]))
    return low, high


def joint_couplings(source: MjcfSource, inside: NDArray[np.bool_]) -> dict[int, Mimic]:
    """Return multipliers and offset of each joint that equalities or tendons couple.

    Args:
        source: The model that MuJoCo has read.
        inside: Mask of the bodies of the robot.

    Raises:
        RobotError: If bodies of the robot form a loop, or a coupling is not linear or redundant.
    """
    model, kinds = source.model, source.mujoco.mjtEq
    mimics: dict[int, Mimic] = {}
    for index in np.flatnonzero(model.eq_active0):
        kind, data = kinds(model.eq_type[index]), model.eq_data[index]
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        name = model.equality(index).name or f"no. {index + 1}"
        where = f"{source.path}: the equality {name!r}"
        if kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            ends = np.array([first, second])
            if model.eq_objtype[index] == source.mujoco.mjtObj.mjOBJ_SITE:
                ends = model.site_bodyid[ends]
            if inside[ends].all():
                names = " and ".join(repr(model.body(end).name) for end in ends)
                raise RobotError(
                    f"{where} closes a loop between {names}; joints must form a tree: "
                    "remove it and couple the joints instead"
                )
        elif kind == kinds.mjEQ_JOINT and inside[model.jnt_bodyid[first]]:
            follows = {second: float(data[1])} if second >= 0 else {}
            if follows and data[2:5].any():
                raise RobotError(
                    f"{where} of joint {source.joint(first)!r} is not linear in one other joint"
                )
            start = {joint: model.qpos0[model.jnt_qposadr[joint]] for joint in (first, *follows)}
            leader_position = sum(factor * start[leader] for leader, factor in follows.items())
            mimics[first] = follows, float(data[0] + start[first] - leader_position)
        elif kind == kinds.mjEQ_TENDON and _moves_robot(source, where, first, inside):
            _couple_joints(source, where, *_tendon_equation(source, where, int(index)), mimics)
    for tendon in map(int, np.flatnonzero(model.tendon_limited)):
        low, high = model.tendon_range[tendon]
        arms = _tendon_arms(source, tendon)
        travel = [
            abs(arm) * np.ptp(model.jnt_range[joint]) if model.jnt_limited[joint] else np.inf
            for joint, arm in arms.items()
        ]
        where = f"{source.path}: the tendon {model.tendon(tendon).name!r}"
        is_locked = len(arms) > 1 and high - low <= _LOCKED_SHARE * min(travel)
        if is_locked and _moves_robot(source, where, tendon, inside):
            _couple_joints(source, where, arms, 0.5 * float(low + high), mimics)
    return mimics


def _tendon_equation(source: MjcfSource, where: str, index: int) -> tuple[dict[int, float], float]:
    """Return the moment arms and the length in an equality of one tendon or two."""
    model, data = source.model, source.model.eq_data[index]
    first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
    arms, length = _tendon_arms(source, first), float(model.tendon_length0[first] + data[0])
    linear = bool(arms)
    if second >= 0:
        others = _tendon_arms(source, second)
        linear = linear and bool(others) and not data[2:5].any()
        arms = {joint: arms.get(joint, 0.0) - data[1] * others.get(joint, 0.0)
                for joint in {**arms, **others}}  # fmt: skip
        length -= float(data[1] * model.tendon_length0[second])
    arms = {joint: float(arm) for joint, arm in arms.items() if arm}
    if not linear or len(arms) < 2:
        raise RobotError(f"{where} is not linear in two or more joints")
    return arms, length


def _moves_robot(source: MjcfSource, where: str, tendon: int, inside: NDArray[np.bool_]) -> bool:
    """Return whether a tendon moves joints of the robot; True for a spatial tendon."""
    joints = list(_tendon_arms(source, tendon))
    own = inside[source.model.jnt_bodyid[joints]]
    if own.any() and not own.all():
        raise RobotError(f"{where} couples joints of the hand to other joints; remove it")
    return not joints or bool(own.all())


def _couple_joints(
    source: MjcfSource, where: str, arms: dict[int, float], length: float, mimics: dict[int, Mimic]
) -> None:
    """Couple the joints of a tendon of known length; preferably one without a motor follows."""
    driven = motor_joints(source)
    follower = min(arms, key=lambda joint: (joint in mimics, joint in driven, -joint))
    if follower in mimics:
        raise RobotError(f"{where} couples joints that all follow others; remove one coupling")
    arm = arms[follower]
    leaders = {joint: -other / arm for joint, other in arms.items() if joint != follower}
    mimics[follower] = leaders, length / arm


def _symmetric_limit(bounds: Sequence[float] | FloatArray) -> float:
    """Return the symmetric limit of a range; infinite unless the range contains zero inside."""
    low, high = map(float, bounds)
    return min(-low, high) if low < 0.0 < high else np.inf


def robot_of_source(
    source: MjcfSource, *, visuals_collide: bool = False, with_shapes: bool = True
) -> RobotModel:
    """Return the robot of an MJCF that MuJoCo has read.

    The robot is the tree of bodies that has motors. If its root has a free joint or no joint, the
    root is the mounted link; otherwise the tree, or several trees, are children of a link called
    ``world``, and ``root_link`` selects one. Trees without motors are not part of the hand. A body
    with several joints gets a link after each but the last, ``BODY_after_JOINT``. Limits of motors
    that act in one direction only are left open.

    Args:
        source: The model that MuJoCo has read.
        visuals_collide: Whether links without collision shapes collide with their visual ones.
        with_shapes: Whether the shapes of the links are read.

    Raises:
        RobotError: If it has ball joints, closed loops, nonlinear couplings or unsupported
            collision shapes.

    Warns:
        GrasplessPinWarning: Springs are left out, or redundant motors.
    """
    robot = _RobotReader(source, visuals_collide=visuals_collide, with_shapes=with_shapes).robot()
    robot.check()
    return robot


def tree_roots(model: Any) -> NDArray[np.intp]:
    """Return for each body its ancestor that is a child of the world; 0 for the world."""
    roots = np.arange(model.nbody)
    for body in range(1, model.nbody):
        parent = model.body_parentid[body]
        roots[body] = body if parent == 0 else roots[parent]
    return roots


def robot_bodies(source: MjcfSource) -> tuple[int, NDArray[np.bool_]]:
    """Return the robot's root body and a mask of its bodies.

    These are the trees with motors, or else with joints, and those coupled to them by equalities.
    """
    model = source.model
    tree = tree_roots(model)
    roots = np.unique(tree[model.jnt_bodyid[motor_joints(source) or np.arange(model.njnt)]])
    ties = (model.eq_type == source.mujoco.mjtEq.mjEQ_JOINT) & (model.eq_obj2id >= 0)
    ends = np.stack([model.eq_obj1id, model.eq_obj2id])[:, ties & (model.eq_active0 == 1)]
    pairs = tree[model.jnt_bodyid[ends]].T
    for _ in pairs:  # at worst, one root is added per pass
        roots = np.union1d(roots, pairs[np.isin(pairs, roots).any(axis=1)])
    inside = np.isin(tree, roots)
    first = model.body_jntadr[roots[0]] if len(roots) == 1 else -1
    free = source.mujoco.mjtJoint.mjJNT_FREE
    if len(roots) == 1 and (first < 0 or model.jnt_type[first] == free):
        return int(roots[0]), inside
    inside[0] = True
    return 0, inside


class _RobotReader:
    """Builds the `RobotModel` of a compiled MuJoCo model."""

    def __init__(self, source: MjcfSource, *, visuals_collide: bool, with_shapes: bool) -> None:
        self._source, self._model = source, source.model
        self._kinds = source.mujoco.mjtJoint
        self._visuals_collide, self._with_shapes = visuals_collide, with_shapes
        self._links: list[RobotLink] = []
        self._joints: list[RobotJoint] = []
        self._mimics: dict[int, Mimic] = {}
        self._efforts: dict[int, float] = {}

    def robot(self) -> RobotModel:
        """Return the `RobotModel`."""
        model = self._model
        top, inside = robot_bodies(self._source)
        if np.any(model.jnt_stiffness[inside[model.jnt_bodyid]] > 0.0):
            emit(
                Finding(
                    FindingCode.LEFT_OUT_SPRINGS, self._source.path.name,
                    f"{self._source.path}: has joints with springs; their torques are left out",
                    "add the springs' torques to those of the motors",
                )
            )  # fmt: skip
        self._mimics = joint_couplings(self._source, inside)
        self._efforts, tendons = motor_limits(self._source, self._mimics, inside)
        for body in map(int, np.flatnonzero(inside)):
            if body != top:
                self._add_joints(body)
            self._add_link(body)
        label, joints = str(self._source.path), self._joints
        root = root_of_tree(
            label,
            [link.name for link in self._links],
            [joint.name for joint in joints],
            [(joint.parent, joint.child) for joint in joints],
        )
        names = {joint.name for joint in joints}
        own = {name: tendon for name, tendon in tendons.items() if names >= set(tendon.arms)}
        return RobotModel(label, root, tuple(self._links), tuple(joints), own)

    def _add_joints(self, body: int) -> None:
        """Add the joints that lead to a body, and the links between them."""
        model, source = self._model, self._source
        T = mj_pose(model.body_quat[body], model.body_pos[body])
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        name, parent = source.body(body), source.body(int(model.body_parentid[body]))
        at = np.zeros(3)  # of the last joint, in the body's frame
        for joint in joints:
            here, axis = model.jnt_pos[joint], np.array(model.jnt_axis[joint])
            is_last = joint == joints[-1] and not here.any()
            child = name if is_last else f"{name}_after_{source.joint(joint)}"
            start = float(model.qpos0[model.jnt_qposadr[joint]])
            step = rigid(here - at)
            if model.jnt_type[joint] == self._kinds.mjJNT_SLIDE:
                step = step @ rigid(-start * axis)
            else:
                step[:3, :3] = Rotation.from_rotvec(-start * axis).as_matrix()
            self._joints.append(self._robot_joint(joint, parent, child, T @ step, axis))
            if not is_last:
                self._links.append(RobotLink(child))
            parent, at, T = child, here, np.eye(4)
        if parent != name:
            self._joints.append(RobotJoint(f"{name}_fixed", "fixed", parent, name, T @ rigid(-at)))

    def _robot_joint(
        self, joint: int, parent: str, child: str, T: FloatArray, axis: FloatArray
    ) -> RobotJoint:
        model, kinds, name = self._model, self._kinds, self._source.joint(joint)
        kind = model.jnt_type[joint]
        if kind == kinds.mjJNT_BALL:
            raise RobotError(
                f"{self._source.path}: joint {name!r} is a ball joint; use three hinge joints"
            )
        if kind == kinds.mjJNT_FREE:
            return RobotJoint(name, "floating", parent, child, T)
        limited = bool(model.jnt_limited[joint])
        word = "prismatic"
        if kind == kinds.mjJNT_HINGE:
            word = "revolute" if limited else "continuous"
        low, high = map(float, model.jnt_range[joint]) if limited else (-np.inf, np.inf)
        coupling = None
        if joint in self._mimics:
            leaders, offset = self._mimics[joint]
            follows = {self._source.joint(leader): one for leader, one in leaders.items()}
            coupling = JointCoupling(name, follows, offset)
        effort = parsed_limit(self._efforts.get(joint, np.inf))
        return RobotJoint(
            name, word, parent, child, T, axis, parsed_limit(low), parsed_limit(high), effort,
            rotor_inertia=float(model.dof_armature[model.jnt_dofadr[joint]]), coupling=coupling,
        )  # fmt: skip

    def _add_link(self, body: int) -> None:
        model, name = self._model, self._source.body(body)
        T = mj_pose(model.body_iquat[body], model.body_ipos[body])
        mass, inertia = float(model.body_mass[body]), np.zeros((3, 3))
        if mass > 0.0:
            inertia = T[:3, :3] @ np.diag(model.body_inertia[body]) @ T[:3, :3].T
        first, plane = model.body_geomadr[body], self._source.mujoco.mjtGeom.mjGEOM_PLANE
        # Geoms fixed to the world are not part of the hand.
        count = model.body_geomnum[body] if body and self._with_shapes else 0
        geoms = [geom for geom in range(first, first + count) if model.geom_type[geom] != plane]
        touching = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
        seen = [geom for geom in geoms if geom not in touching] or touching
        seen = [geom for geom in seen if is_supported_geom(self._source, geom)]
        if self._visuals_collide and not touching:
            touching = seen
        try:  # faults of visual shapes are no errors
            visuals = tuple(geom_shape(self._source, geom) for geom in seen)
        except RobotError:
            visuals = ()
        self._links.append(
            RobotLink(
                name, mass, T[:3, 3].copy(), inertia,
                tuple(geom_shape(self._source, geom) for geom in touching), visuals,
                gravcomp=float(model.body_gravcomp[body]),
            )
        )  # fmt: skip
