"""Joining mounted robots to one hand: its tree, fingers, tendons, actuators and rotor inertias.

Joint positions and the final effort limits are set later.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.findings import Finding, capture, emit
from graspless_pin.geometry.bodies.decomposition import Cut
from graspless_pin.geometry.hand.actuation import (
    Actuation,
    EffortLimit,
    entry_by_joint,
    expand_overrides,
    is_placeholder,
    plan_actuation,
    resolve_effort_limits,
    urdf_efforts,
)
from graspless_pin.geometry.hand.fingers import (
    ControlPlan,
    check_fingers,
    discover_hands,
    driving_joints,
    plan_control,
)
from graspless_pin.geometry.hand.reading import read_robot, refuse_incomplete
from graspless_pin.geometry.hand.robot_model import LinkMesh, RobotModel
from graspless_pin.geometry.hand.tree import KinematicTree, build_tree
from graspless_pin.geometry.poses import as_pose, invert
from graspless_pin.geometry.robots.description import (
    FingerSpec,
    JointCoupling,
    LinkMeshes,
    RobotDescription,
)
from graspless_pin.geometry.robots.files import find_robot
from graspless_pin.problem import ControlMode
from graspless_pin.problem.checks import (
    FloatArray,
    check_known,
    read_only,
    real_number,
    unknown_name,
)
from graspless_pin.records import Brief, changed


@dataclass(frozen=True, eq=False, repr=False)
class Mount(Brief):
    """A robot mounted in the world.

    Attributes:
        source: A path to a URDF or robot file, the name of a robot file or example-robot-data
            model, or a description.
        T_world_base: (4, 4) pose of the robot's root link; None is the world's origin.
        prefix: Prefix for the names of its joints, links and fingers.
        fingers: Its fingers, without the prefix; None takes those of the robot file, or finds them.
        package_dirs: For the ``package://`` addresses of a URDF given by path.
        meshes: How its collision meshes are made convex; None takes the robot file's way.
        root_link: The link that is mounted, with its subtree; None takes the robot file's, or the
            URDF's root.
        srdf: Its SRDF; None takes the robot file's, or the one beside the URDF.
    """

    source: RobotDescription | str | Path
    T_world_base: ArrayLike | None = None
    prefix: str = ""
    fingers: Mapping[str, FingerSpec] | None = None
    package_dirs: Sequence[str | Path] = ()
    meshes: LinkMeshes | None = None
    root_link: str | None = None
    srdf: str | Path | None = None

    def robot(self) -> RobotDescription:
        """Return the description of the robot.

        Raises:
            RobotError: If there is none.
            ArgumentError: If ``package_dirs`` is given for anything but a URDF.
        """
        robot = find_robot(self.source, self.package_dirs)
        if self.root_link is not None:
            robot = replace(robot, root_link=self.root_link)
        return robot if self.srdf is None else replace(robot, srdf=Path(self.srdf))


@dataclass(frozen=True, eq=False)
class JoinedMounts:
    """Several mounted robots as one tree, with prefixed names throughout.

    Attributes:
        tree: Their common tree.
        mounts: The mounts, each with the description of its robot and a (4, 4) pose.
        palms: The links that carry fingers.
        fingers: All fingers, checked.
        arms: The joints that carry a palm, by the name ``arm`` with the mount's prefix.
        held_joints: Joints of no finger that are not below a palm (arms, legs, necks), of robots
            with a palm: position-controlled by default.
        outer_joints: Likewise for all robots; of one without a palm, all joints of no finger.
        tendons: Moment arm by joint, m, by tendon.
        tensions: Lowest and highest tension by tendon, N, if an MJCF states them.
        effort_limits: (lower, upper) by joint or tendon, if the robot files state them.
        effort_unknown: Note by joint or tendon whose limit a robot file declares unknown.
    """

    tree: KinematicTree
    mounts: tuple[Mount, ...]
    palms: tuple[str, ...]
    fingers: dict[str, FingerSpec]
    arms: dict[str, tuple[str, ...]]
    held_joints: tuple[str, ...]
    outer_joints: tuple[str, ...]
    tendons: dict[str, dict[str, float]]
    tensions: dict[str, tuple[float, float]]
    effort_limits: dict[str, tuple[float, float]]
    effort_unknown: dict[str, str]


def join_mounts(mounts: Sequence[Mount], *, with_shapes: bool = True) -> JoinedMounts:
    """Find, read and join robots to one tree.

    Args:
        mounts: The robots.
        with_shapes: Whether to read their meshes and keep their collision shapes.

    Raises:
        ArgumentError: If there is no mount, two share a prefix, a pose is not rigid, or fingers or
            links given with a mount do not match.
        RobotError: If a robot cannot be found or loaded, or its robot file does not match its URDF.
        MeshError: If a mesh is missing or unusable.
    """
    if not mounts:
        raise ArgumentError("mounts", "a hand needs at least one robot")
    prefixes = [mount.prefix for mount in mounts]
    if len(set(prefixes)) < len(prefixes):
        raise ArgumentError("mounts", f"prefixes must differ, got {prefixes}")
    robots = [mount.robot() for mount in mounts]
    poses = [
        as_pose("T_world_base", np.eye(4) if mount.T_world_base is None else mount.T_world_base)
        for mount in mounts
    ]
    placed_mounts = tuple(
        replace(mount, source=robot, T_world_base=T, package_dirs=(), root_link=None, srdf=None)
        for mount, robot, T in zip(mounts, robots, poses, strict=True)
    )
    models: list[RobotModel] = []
    couplings: list[JointCoupling] = []
    cuts: dict[str, Cut] = {}
    for mount, robot in zip(mounts, robots, strict=True):
        model = read_robot(robot, mount.prefix, with_shapes=with_shapes)
        models.append(model)
        couplings += _prefixed_couplings(robot, model, mount.prefix)
        if with_shapes:
            cuts |= _mesh_cuts(mount, robot, model)
    tree = build_tree(
        list(zip(models, poses, strict=True)), couplings, with_shapes=with_shapes, cuts=cuts
    )
    joined = JoinedMounts(tree, placed_mounts, (), {}, {}, (), (), {}, {}, {}, {})
    for mount, robot, model in zip(mounts, robots, models, strict=True):
        joined = _with_robot(joined, mount, robot, model)
    return joined


def _prefixed_couplings(
    robot: RobotDescription, model: RobotModel, prefix: str
) -> list[JointCoupling]:
    """Return the couplings of a robot file, prefixed and checked."""
    couplings = [coupling.prefixed(prefix) for coupling in robot.couplings]
    for coupling in couplings:
        for joint in (coupling.joint, *coupling.follows):
            if joint not in model.movable_joints:
                error = unknown_name("couplings", "joint", joint, model.movable_joints)
                raise RobotError(f"{robot.label}: {error}") from error
    return couplings


def _mesh_cuts(mount: Mount, robot: RobotDescription, model: RobotModel) -> dict[str, Cut]:
    """Return the settings of the decomposition by link, of the links that are decomposed."""
    links = tuple(
        link.name
        for link in model.links
        if any(isinstance(one.shape, LinkMesh) for one in link.collisions)
    )
    if mount.meshes is not None:
        return mount.meshes.cuts(links, mount.prefix)
    try:
        return robot.meshes.cuts(links, mount.prefix)
    except ArgumentError as error:
        raise RobotError(f"{robot.label}: {error}") from error


def _with_robot(
    joined: JoinedMounts, mount: Mount, robot: RobotDescription, model: RobotModel
) -> JoinedMounts:
    """Return the joined mounts with the fingers, tendons and limits of one robot added."""
    tree, prefix = joined.tree, mount.prefix
    tendons = {
        prefix + name: {prefix + joint: arm for joint, arm in arms.items()}
        for name, arms in robot.tendons.items()
    }
    declared = {joint for arms in tendons.values() for joint in arms}
    drawn = {
        name: tendon for name, tendon in model.tendons.items() if declared.isdisjoint(tendon.arms)
    }
    tendons |= {name: dict(tendon.arms) for name, tendon in drawn.items()}
    tensions = {name: (tendon.lower, tendon.upper) for name, tendon in drawn.items()}
    try:
        palms = [prefix + palm for palm in robot.palms]
        structure = discover_hands(tree, model.root, palms, prefix)
        fingers = structure.fingers
        if robot.fingers:
            fingers = check_fingers(tree, _prefixed_fingers(prefix, robot.fingers))
        for arms in tendons.values():
            check_known("tendons", "joint", arms, tree.joint_index)
        limits = {prefix + name: limit for name, limit in robot.effort_limits.items()}
        expanded = expand_overrides(tree, fingers, limits, tendons, tensions)
        notes = {prefix + name: note for name, note in robot.effort_unknown.items()}
        unknown = {
            target: notes[name]
            for target, name in entry_by_joint(tree, fingers, notes, tendons).items()
        }
    except ArgumentError as error:
        raise RobotError(f"{robot.label}: {error}") from error
    if mount.fingers is not None:
        fingers = check_fingers(tree, _prefixed_fingers(prefix, mount.fingers))
    arm = structure.arm_joints
    in_fingers = {joint for spec in fingers.values() for joint in driving_joints(tree, spec)}
    outer = tuple(joint for joint in structure.outer_joints if joint not in in_fingers)
    return replace(
        joined,
        palms=(*joined.palms, *structure.palms),
        fingers=joined.fingers | fingers,
        arms=joined.arms | ({f"{prefix}arm": arm} if arm else {}),
        held_joints=(*joined.held_joints, *(outer if structure.palms else ())),
        outer_joints=(*joined.outer_joints, *outer),
        tendons=joined.tendons | tendons,
        tensions=joined.tensions | tensions,
        effort_limits=joined.effort_limits | expanded,
        effort_unknown=joined.effort_unknown | unknown,
    )


def _prefixed_fingers(prefix: str, fingers: Mapping[str, FingerSpec]) -> dict[str, FingerSpec]:
    """Return fingers with ``prefix`` before their names, joints and links."""
    return {
        prefix + finger: FingerSpec(
            joints=tuple(prefix + joint for joint in spec.joints),
            links=tuple(prefix + link for link in spec.links),
            tip=None if spec.tip is None else prefix + spec.tip,
        )
        for finger, spec in fingers.items()
    }


@dataclass(frozen=True)
class EffortRecord:
    """The effort limit of a joint or tendon.

    Attributes:
        lower: Lower limit, N m (N for prismatic joints and tendons).
        upper: Upper limit, in the same unit.
        known: Whether it is stated with a source, rather than taken from the URDF.
        source: Its source, or a note on it.
    """

    lower: float
    upper: float
    known: bool
    source: str


def describe_efforts(robot: RobotDescription, joined: JoinedMounts) -> dict[str, EffortRecord]:
    """Return the effort limit of every joint with a motor and every tendon of one robot."""
    tree, tendons = joined.tree, joined.tendons
    stated = entry_by_joint(tree, joined.fingers, robot.effort_sources, tendons)
    pulled = {joint for arms in tendons.values() for joint in arms}
    lower, upper = urdf_efforts(tree)
    efforts: dict[str, EffortRecord] = {}
    for index in tree.coupling.leaders:
        name = tree.joint_names[index]
        if name in pulled or name in tree.locked:
            continue
        note = joined.effort_unknown.get(name)
        if note is None and is_placeholder(float(upper[index]), on_arm=name in joined.outer_joints):
            note = "the URDF or MJCF, whose limit looks like a placeholder"
        source = note or "the URDF or MJCF"
        efforts[name] = EffortRecord(
            float(lower[index]), float(upper[index]), known=False, source=source
        )
    for name in tendons:
        stated_by = "the MJCF" if name in joined.tensions else "not stated in any file"
        ends = joined.tensions.get(name, (0.0, float("inf")))
        source = joined.effort_unknown.get(name, stated_by)
        efforts[name] = EffortRecord(*ends, known=False, source=source)
    for name, (low, high) in joined.effort_limits.items():
        source = " ".join(robot.effort_sources[stated[name]].split())
        efforts[name] = EffortRecord(low, high, known=True, source=source)
    return efforts


def joint_armatures(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    armature: float | Mapping[str, float],
) -> dict[int, float]:
    """Return given rotor inertias by the index of the joint.

    Args:
        tree: The kinematic tree.
        fingers: The checked fingers.
        armature: Rotor inertia of every independent joint, or by finger or joint; that of a joint
            takes precedence over that of its finger.

    Raises:
        ArgumentError: If a name is unknown or a mimic joint's, or a value negative or not finite.
    """
    if not isinstance(armature, Mapping):
        return dict.fromkeys(tree.coupling.leaders, real_number("armature", armature, 0.0))
    values = {name: real_number(f"armature[{name!r}]", one, 0.0) for name, one in armature.items()}
    spread = entry_by_joint(
        tree,
        fingers,
        values,
        argument="armature",
        instead="give the armature of the joint it follows",
    )
    return {tree.joint_index[joint]: values[name] for joint, name in spread.items()}


ControlModes = ControlMode | str | Mapping[str, ControlMode | str]
"""One mode for all joints, or modes by finger, arm or joint name."""


@dataclass(frozen=True, eq=False)
class AssembledMounts:
    """A hand without joint positions and final effort limits.

    Attributes:
        joined: The mounted robots as one tree.
        plan: Control modes of the independent joints, and the hybrid fingers.
        actuation: The L actuators.
        findings: The findings of the assembly.
    """

    joined: JoinedMounts
    plan: ControlPlan
    actuation: Actuation
    findings: tuple[Finding, ...]

    def effort_limits(
        self, given: Mapping[str, EffortLimit]
    ) -> tuple[tuple[FloatArray, FloatArray], tuple[Finding, ...]]:
        """Return the (lower, upper) limits of the L actuators, and findings on them.

        Args:
            given: Limits by finger, joint or tendon that replace those of robot files and URDFs.
        """
        joined = self.joined
        stated = expand_overrides(
            joined.tree, joined.fingers, given, joined.tendons, joined.tensions
        )
        with capture() as findings:
            limits = resolve_effort_limits(
                joined.tree,
                self.actuation,
                joined.effort_limits | stated,
                joined.effort_unknown,
                joined.outer_joints,
                joined.tensions,
            )
        emit(*findings)
        return limits, tuple(findings)

    def at_bases(self, poses: Sequence[ArrayLike]) -> AssembledMounts:
        """Return the assembly with the mounts' root links at other (4, 4) poses, world axes.

        Raises:
            ArgumentError: If a pose is not rigid.
        """
        mounts, now = self.joined.mounts, [as_pose("T_world_base", T) for T in poses]
        before = base_poses(mounts).values()
        displacements = [T @ invert(T_before) for T, T_before in zip(now, before, strict=True)]
        tree = displaced_tree(self.joined.tree, displacements)
        return replace(
            self, joined=replace(self.joined, tree=tree, mounts=mounts_at_poses(mounts, now))
        )


def base_poses(mounts: Sequence[Mount]) -> dict[str, FloatArray]:
    """Return the (4, 4) ``T_world_base`` by prefix of placed mounts."""
    return {mount.prefix: read_only(np.asarray(mount.T_world_base)) for mount in mounts}


def mounts_at_poses(mounts: Sequence[Mount], poses: Iterable[FloatArray]) -> tuple[Mount, ...]:
    """Return mounts at given (4, 4) poses, in the order of the mounts."""
    return tuple(replace(mount, T_world_base=T) for mount, T in zip(mounts, poses, strict=True))


def assembled_mounts(
    mounts: Sequence[Mount],
    control: ControlModes | None = None,
    armature: float | Mapping[str, float] | None = None,
) -> AssembledMounts:
    """Assemble robots as `Hand.assemble` does; findings are emitted.

    Args:
        mounts: The robots.
        control: See `Hand.assemble`.
        armature: See `Hand.assemble`.
    """
    with capture() as findings:
        joined = join_mounts(mounts)
        tree = joined.tree
        # The name of an SRDF group denotes its joints, like that of an arm.
        arms, held = {**tree.groups, **joined.arms}, joined.held_joints
        if isinstance(control, Mapping):
            names = [name for name in control if name not in (*joined.fingers, *joined.arms)]
            refuse_incomplete("control", names, tree.missing)
        plan = plan_control(tree, joined.fingers, control, arms=arms, held=held)
        actuation = plan_actuation(tree, plan, joined.tendons)
        for joint, value in joint_armatures(tree, joined.fingers, armature or {}).items():
            tree.pinocchio_model.armature[joint] = value
    emit(*findings)
    return AssembledMounts(joined, plan, actuation, tuple(findings))


_SAME_AT_ALL_BASES = (
    "joint_index",
    "mount_of",
    "leader_names",
    "joint_kinds",
    "tolerated_limits",
    "ranges",
    "locked",
    "link_joints",
    "parent_links",
    "supports",
    "shapes",
    "_q_starts",
    "moves",
)
"""Cached properties of the tree that do not depend on the poses of the bases."""


def displaced_tree(tree: KinematicTree, displacements: Sequence[FloatArray]) -> KinematicTree:
    """Return the tree with each robot's base displaced.

    Args:
        tree: The tree.
        displacements: (4, 4) by mounted robot, world axes: ``T_world_base`` becomes
            ``displacement @ T_world_base``.
    """
    model, shifts = tree.pinocchio_model.copy(), [pin.SE3(np.array(T)) for T in displacements]
    mount_of = tree.mount_of
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            shift = shifts[mount_of[model.names[joint]]]
            model.jointPlacements[joint] = shift * model.jointPlacements[joint]
    for index in range(1, model.nframes):
        frame = model.frames[index]
        if frame.parentJoint == 0:
            frame.placement = shifts[mount_of[frame.name]] * frame.placement
    bases = tuple(
        (names, shift.act(inertia))
        for shift, (names, inertia) in zip(shifts, tree.bases, strict=True)
    )
    model.inertias[0] = sum((inertia for _, inertia in bases), pin.Inertia.Zero())
    geometries = tuple(
        item
        if item.joint
        else replace(
            item, T_joint_geometry=displacements[mount_of[item.link]] @ item.T_joint_geometry
        )
        for item in tree.geometries
    )
    moved = replace(tree, pinocchio_model=model, geometries=geometries, bases=bases)
    # Evaluated on the original tree, so that they are computed once for all displaced trees.
    return changed(moved, **{name: getattr(tree, name) for name in _SAME_AT_ALL_BASES})
