"""Robots fixed to the world, and how several of them become one tree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.geometry.bodies.decomposition import Cut
from graspless_pin.geometry.hand.actuation import expand_overrides, spread_names
from graspless_pin.geometry.hand.fingers import check_fingers, discover_hands, driving_joints
from graspless_pin.geometry.hand.reading import read_robot
from graspless_pin.geometry.hand.robot_model import RobotModel
from graspless_pin.geometry.hand.tree import KinematicTree, build_tree
from graspless_pin.geometry.poses import as_pose
from graspless_pin.geometry.robots.description import (
    FingerSpec,
    JointCoupling,
    LinkMeshes,
    RobotDescription,
)
from graspless_pin.geometry.robots.files import find_robot
from graspless_pin.problem.checks import unknown_name
from graspless_pin.records import Brief


@dataclass(frozen=True, eq=False, repr=False)
class Mount(Brief):
    """A robot fixed to the world.

    Attributes:
        source: A path to a URDF or robot file, the name of a robot file or example-robot-data
            model, or a description.
        T_world_base: (4, 4) pose of the robot's root link; None is the world's origin.
        prefix: Put before the names of its joints, links and fingers.
        fingers: Its fingers, without the prefix; None takes the robot file's, or finds them.
        package_dirs: For the ``package://`` addresses of a URDF given by path.
        meshes: How its collision meshes are made convex; None takes the robot file's way.
        root_link: The link that is mounted, with all that hangs on it; None takes the robot file's,
            or the URDF's root.
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
        """Find the robot.

        Raises:
            RobotError: If there is none.
            ArgumentError: If ``package_dirs`` is given for anything but a URDF.
        """
        found = find_robot(self.source, self.package_dirs)
        if self.root_link is not None:
            found = replace(found, root_link=self.root_link)
        return found if self.srdf is None else replace(found, srdf=Path(self.srdf))


@dataclass(frozen=True, eq=False)
class JoinedMounts:
    """Several mounted robots as one tree, with prefixed names throughout.

    Attributes:
        tree: Their common tree.
        base_poses: (4, 4) ``T_world_base`` by prefix, in mounting order.
        palms: The links that carry fingers.
        fingers: All fingers, checked.
        arms: The joints that carry a palm, by the name ``arm`` with the mount's prefix.
        held_joints: Joints that neither a finger has nor a palm carries, where there is a palm.
        outer_joints: The same, where there is no palm, too.
        tendons: Moment arm by joint, m, by tendon.
        tensions: Lowest and highest tension by tendon, N, as far as an MJCF states them.
        effort_limits: (lower, upper) by joint or tendon, as far as the robot files state them.
        effort_unknown: What is known by joint or tendon whose limit a robot file calls unknown.
    """

    tree: KinematicTree
    base_poses: dict[str, NDArray[np.float64]]
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
    """Find, read and join robots.

    Args:
        mounts: The robots.
        with_shapes: Whether to read their meshes and keep their collision shapes.

    Raises:
        ArgumentError: If there is no mount, two share a prefix, a pose is not rigid, or fingers or
            links given with a mount do not fit.
        RobotError: If a robot cannot be found or loaded, or its robot file does not fit its URDF.
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
    models = [
        read_model(robot, prefix, with_shapes=with_shapes)
        for robot, prefix in zip(robots, prefixes, strict=True)
    ]
    couplings = [
        coupling
        for robot, model, prefix in zip(robots, models, prefixes, strict=True)
        for coupling in _couplings(robot, model, prefix)
    ]
    cuts: dict[str, Cut] = {}
    for mount, robot, model in zip(mounts, robots, models, strict=True):
        cuts |= _cuts(mount, robot, model) if with_shapes else {}
    tree = build_tree(
        list(zip(models, poses, strict=True)), couplings, with_shapes=with_shapes, cuts=cuts
    )
    joined = JoinedMounts(
        tree, dict(zip(prefixes, poses, strict=True)), (), {}, {}, (), (), {}, {}, {}, {}
    )
    for mount, robot, model in zip(mounts, robots, models, strict=True):
        joined = _add(joined, mount, robot, model)
    return joined


def read_model(
    robot: RobotDescription, prefix: str = "", *, with_shapes: bool = True
) -> RobotModel:
    """Read a robot, or take it as it is: see `read_robot`."""
    if robot.read is not None:
        model = robot.read if robot.root_link is None else robot.read.below(robot.root_link)
        return model.with_fixed_base().prefixed(prefix)
    return read_robot(
        robot.urdf_path,
        prefix=prefix,
        package_dirs=robot.package_dirs,
        root_link=robot.root_link,
        xacro_args=robot.xacro_args,
        visuals_collide=robot.visuals_collide,
        with_shapes=with_shapes,
        srdf=robot.srdf,
    )


def _couplings(robot: RobotDescription, model: RobotModel, prefix: str) -> list[JointCoupling]:
    """Return the couplings of a robot file, prefixed and checked."""
    couplings = [coupling.prefixed(prefix) for coupling in robot.couplings]
    for coupling in couplings:
        for joint in (coupling.joint, *coupling.follows):
            if joint not in model.movable_joints:
                error = unknown_name("couplings", "joint", joint, model.movable_joints)
                raise RobotError(f"robot {robot.name!r}: {error}") from error
    return couplings


def _cuts(mount: Mount, robot: RobotDescription, model: RobotModel) -> dict[str, Cut]:
    """Return how the meshes of some links of one robot are cut."""
    links = model.links_with_meshes
    if mount.meshes is not None:
        return mount.meshes.cuts(links, mount.prefix)
    try:
        return robot.meshes.cuts(links, mount.prefix)
    except ArgumentError as error:
        raise RobotError(f"robot {robot.name!r}: {error}") from error


def _add(
    joined: JoinedMounts, mount: Mount, robot: RobotDescription, model: RobotModel
) -> JoinedMounts:
    """Add what one robot and its file say about its fingers, tendons and limits."""
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
    try:
        palms = [prefix + palm for palm in robot.palms]
        structure = discover_hands(tree, model.root, palms, prefix)
        fingers = structure.fingers
        if robot.fingers:
            fingers = check_fingers(tree, _prefix_fingers(prefix, robot.fingers))
        for arms in tendons.values():
            for joint in arms:
                if joint not in tree.joint_index:
                    raise unknown_name("tendons", "joint", joint, tree.joint_names)
        limits = {prefix + name: limit for name, limit in robot.effort_limits.items()}
        expanded = expand_overrides(tree, fingers, limits, tendons)
        notes = {prefix + name: note for name, note in robot.effort_unknown.items()}
        unknown = {
            target: notes[name]
            for target, name in spread_names(tree, fingers, notes, tendons).items()
        }
    except ArgumentError as error:
        raise RobotError(f"robot {robot.name!r}: {error}") from error
    if mount.fingers is not None:
        fingers = check_fingers(tree, _prefix_fingers(prefix, mount.fingers))
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
        tensions=joined.tensions | {name: (one.lower, one.upper) for name, one in drawn.items()},
        effort_limits=joined.effort_limits | expanded,
        effort_unknown=joined.effort_unknown | unknown,
    )


def _prefix_fingers(prefix: str, fingers: Mapping[str, FingerSpec]) -> dict[str, FingerSpec]:
    """Put ``prefix`` before the names of fingers, their joints and their links."""
    return {
        prefix + finger: FingerSpec(
            joints=tuple(prefix + joint for joint in spec.joints),
            links=tuple(prefix + link for link in spec.links),
            tip=None if spec.tip is None else prefix + spec.tip,
        )
        for finger, spec in fingers.items()
    }
