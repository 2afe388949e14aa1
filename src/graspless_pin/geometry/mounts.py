"""Robots fixed to the world, and how several of them become one tree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.geometry.effort_limits import expand_overrides
from graspless_pin.geometry.fingers import FingerSpec, check_fingers
from graspless_pin.geometry.poses import as_pose
from graspless_pin.geometry.robots import RobotDescription, find_robot
from graspless_pin.geometry.tree import KinematicTree, build_tree
from graspless_pin.geometry.urdf import read_urdf


@dataclass(frozen=True, eq=False)
class Mount:
    """A robot fixed to the world.

    Attributes:
        source: A path to a URDF or robot file, the name of a robot file or example-robot-data
            model, or a description.
        T_world_base: (4, 4) pose of the robot's root link; None is the world's origin.
        prefix: Put before the names of its joints, links and fingers.
        fingers: Its fingers, without the prefix; None takes the robot file's.
        package_dirs: For the ``package://`` addresses of a URDF given by path.
    """

    source: RobotDescription | str | Path
    T_world_base: ArrayLike | None = None
    prefix: str = ""
    fingers: Mapping[str, FingerSpec] | None = None
    package_dirs: Sequence[str | Path] = ()


@dataclass(frozen=True, eq=False)
class JoinedMounts:
    """Several mounted robots as one tree, with prefixed names throughout.

    Attributes:
        tree: Their common tree.
        base_poses: (4, 4) ``T_world_base`` by prefix, in mounting order.
        fingers: All fingers, checked.
        effort_limits: (lower, upper) by joint, as far as the robot files state them.
    """

    tree: KinematicTree
    base_poses: dict[str, NDArray[np.float64]]
    fingers: dict[str, FingerSpec]
    effort_limits: dict[str, tuple[float, float]]


def join_mounts(mounts: Sequence[Mount]) -> JoinedMounts:
    """Find, read and join robots.

    Raises:
        ArgumentError: If there is no mount, two share a prefix, a pose is not rigid or fingers
            given with a mount do not fit.
        RobotError: If a robot cannot be found or loaded, or its robot file does not fit its URDF.
        MeshError: If a mesh is missing or unusable.
    """
    if not mounts:
        raise ArgumentError("mounts", "a hand needs at least one robot")
    prefixes = [mount.prefix for mount in mounts]
    if len(set(prefixes)) < len(prefixes):
        raise ArgumentError("mounts", f"prefixes must differ, got {prefixes}")
    robots = [find_robot(mount.source, mount.package_dirs) for mount in mounts]
    poses = [
        as_pose("T_world_base", np.eye(4) if mount.T_world_base is None else mount.T_world_base)
        for mount in mounts
    ]
    documents = [
        read_urdf(robot.urdf_path, prefix=prefix, package_dirs=robot.package_dirs)
        for robot, prefix in zip(robots, prefixes, strict=True)
    ]
    tree = build_tree(list(zip(documents, poses, strict=True)))
    fingers: dict[str, FingerSpec] = {}
    limits: dict[str, tuple[float, float]] = {}
    for mount, robot in zip(mounts, robots, strict=True):
        own_fingers, own_limits = _checked_description(tree, robot, mount.prefix)
        limits |= own_limits
        if mount.fingers is None:
            fingers |= own_fingers
        else:
            fingers |= check_fingers(tree, _prefix_fingers(mount.prefix, mount.fingers))
    return JoinedMounts(tree, dict(zip(prefixes, poses, strict=True)), fingers, limits)


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


def _checked_description(
    tree: KinematicTree, robot: RobotDescription, prefix: str
) -> tuple[dict[str, FingerSpec], dict[str, tuple[float, float]]]:
    """Return a robot's own fingers and effort limits by joint, prefixed and checked."""
    limits = {prefix + name: limit for name, limit in robot.effort_limits.items()}
    if robot.palm is not None and prefix + robot.palm not in tree.link_frames:
        raise RobotError(f"robot {robot.name!r}: the palm {robot.palm!r} is not one of its links")
    try:
        fingers = check_fingers(tree, _prefix_fingers(prefix, robot.fingers))
        return fingers, expand_overrides(tree, fingers, limits)
    except ArgumentError as error:
        raise RobotError(f"robot {robot.name!r}: {error}") from error
