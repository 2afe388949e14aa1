"""Waypoints of a scene from ROS messages: joint trajectories, and poses of the object.

No ROS package is imported: messages are objects with ROS's attributes, or mappings with its keys,
as ``ros2 topic echo`` prints them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, JointLimitError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.configuration import joint_positions
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.intake.files import FileKind, errors_of_text, read_text
from graspless_pin.intake.text import parse_json
from graspless_pin.intake.yaml_text import parse_yaml
from graspless_pin.planning import Waypoint
from graspless_pin.problem.checks import FloatArray, finite_array
from graspless_pin.scene import Scene
from graspless_pin.scene.entry_findings import MOST_ANGLE
from graspless_pin.suggestions import names_in_words

__all__ = ["pose_from_message", "waypoints_from_trajectory"]

_MESSAGE = FileKind("ROS message", 16, lambda message: ArgumentError("trajectory", message))
_NANO = 1e-9
_SAME_TIME = 1e-6  # s
_NORM_ERROR = 1e-3


def waypoints_from_trajectory(
    scene: Scene,
    trajectory: Any = None,
    object_poses: Any = None,
    *,
    stay: Sequence[str] = (),
) -> list[Waypoint]:
    """Return the waypoints of a ``trajectory_msgs/JointTrajectory``, for `evaluate_path`.

    Of a ``moveit_msgs/RobotTrajectory`` its ``joint_trajectory`` is used, and of the goal of a
    ``FollowJointTrajectory`` its ``trajectory``.

    Only positions are used: velocities, accelerations and efforts are ignored. Joints may be in any
    order, with the prefixes of the hand's mounts. Joints that follow others may be included; then
    their positions have to agree with the coupling.

    Args:
        scene: The scene, whose hand has the joints.
        trajectory: The message: an object with ROS's attributes, a mapping, or the path of a YAML
            or JSON file with one (a YAML file of at most 30 000 entries); None: the hand stays.
        object_poses: Poses of the object's frame in the scene's world: a sequence of
            ``geometry_msgs/Pose`` (see `pose_from_message`), one for each point, or a
            ``trajectory_msgs/MultiDOFJointTrajectory`` with one joint, at the same times; None: the
            object stays.
        stay: Joints that the trajectory does not name and that stay as in the scene.

    Returns:
        The waypoints; times are those from the start, or None for a sequence of poses only.

    Raises:
        ArgumentError: If neither is given, a part is missing or of the wrong length, a joint is
            unknown or not named, a position is not finite, outside its limits or violates a
            coupling, a quaternion is no rotation, or times do not agree.

    Warns:
        GrasplessPinWarning: If angles are more than a turn, and look like degrees.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> from graspless_pin.interfaces.ros import waypoints_from_trajectory
        >>> from graspless_pin.planning import joint_trajectory
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> message = joint_trajectory(profile)
        >>> again = evaluate_path(scene, waypoints_from_trajectory(scene, message))
        >>> bool(abs(again.smallest_margin - profile.smallest_margin) < 1e-9)
        True
    """
    if isinstance(stay, str) or not isinstance(stay, Sequence):
        raise ArgumentError("stay", f"is {stay!r}; give a list of joint names")
    if trajectory is None and object_poses is None:
        raise ArgumentError(
            "trajectory", "is None, and so is object_poses; give at least one of them"
        )
    waypoints: list[Waypoint] = []
    if trajectory is not None:
        waypoints = _joint_waypoints(scene, _joint_trajectory(_read_message(trajectory)), stay)
    if object_poses is None:
        return waypoints
    if isinstance(object_poses, Sequence) and not isinstance(object_poses, str):
        poses = [pose_from_message(one, f"object_poses[{k}]") for k, one in enumerate(object_poses)]
        times = None
    else:
        times, poses = _times_and_poses(_read_message(object_poses))
    if not waypoints:
        stamps = [None] * len(poses) if times is None else times
        return [Waypoint(T_world_object=T, time=t) for t, T in zip(stamps, poses, strict=True)]
    if len(poses) != len(waypoints):
        raise ArgumentError(
            "object_poses",
            f"has {len(poses)} poses, but the trajectory has {len(waypoints)} points; give one "
            "pose for each point",
        )
    for k, (one, time) in enumerate(zip(waypoints, times or (), strict=False)):
        if abs(time - (one.time or 0.0)) > _SAME_TIME:
            raise ArgumentError(
                "object_poses",
                f"point {k} is at {time:g} s, but point {k} of the joints is at {one.time:g} s; "
                "sample both at the same times",
            )
    return [replace(one, T_world_object=T) for one, T in zip(waypoints, poses, strict=True)]


def pose_from_message(message: Any, name: str = "pose") -> FloatArray:
    """Return the (4, 4) pose of a message, m.

    Args:
        message: ``geometry_msgs`` ``Pose``, ``Transform`` or a stamped one: an object or a mapping.
            Its quaternion is x, y, z, w.
        name: Its name in error messages.

    Raises:
        ArgumentError: If a part is missing, a number not finite, or the quaternion not of length 1
            to within 1e-3.

    Examples:
        >>> from graspless_pin.interfaces.ros import pose_from_message
        >>> position = {"x": 0.1, "y": 0.0, "z": 0.2}
        >>> half_turn = {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
        >>> pose_from_message({"position": position, "orientation": half_turn})[:3, 3].tolist()
        [0.1, 0.0, 0.2]
    """
    for inner in ("pose", "transform"):
        if _has(message, inner):
            return pose_from_message(_field(message, inner, name), f"{name}.{inner}")
    keys = ("position", "orientation")
    if _has(message, "translation"):
        keys = ("translation", "rotation")
    parts = []
    for key, axes in zip(keys, ("xyz", "xyzw"), strict=True):
        part = _field(message, key, name)
        values = [_field(part, axis, f"{name}.{key}") for axis in axes]
        parts.append(finite_array(f"{name}.{key}", values, (len(axes),)))
    length = float(np.linalg.norm(parts[1]))
    if abs(length - 1.0) > _NORM_ERROR:
        raise ArgumentError(
            f"{name}.{keys[1]}",
            f"has the norm {length:g}; the quaternion (x, y, z, w) of a rotation must have norm 1",
        )
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(parts[1]).as_matrix()
    T[:3, 3] = parts[0]
    return T


def _joint_trajectory(message: Any) -> Any:
    """Return the JointTrajectory of a RobotTrajectory or of an action's goal."""
    if _has(message, "joint_names"):
        return message
    if _has(message, "joint_trajectory"):
        other = "multi_dof_joint_trajectory"
        if _has(message, other) and len(_field(_field(message, other, ""), "joint_names", other)):
            raise ArgumentError(
                "trajectory", f"has a {other}, too; pass its joint_trajectory, and the {other} "
                "as object_poses if it is that of the object"
            )  # fmt: skip
        return _field(message, "joint_trajectory", "trajectory")
    inner = _field(message, "trajectory", "trajectory") if _has(message, "trajectory") else None
    if isinstance(inner, Sequence) and not isinstance(inner, str):
        raise ArgumentError(
            "trajectory", f"holds {len(inner)} trajectories under 'trajectory'; pass one of them"
        )
    return message if inner is None else _joint_trajectory(inner)


def _joint_waypoints(scene: Scene, message: Any, stay: Sequence[str]) -> list[Waypoint]:
    """Return a waypoint with time and joints for each point."""
    hand = scene.hand
    if hand is None:
        raise ArgumentError("trajectory", f"moves joints, but the scene {scene.name!r} has no hand")
    names = [str(name) for name in _field(message, "joint_names", "trajectory")]
    _check_joint_names(hand, names, stay)
    points = list(_field(message, "points", "trajectory"))
    if not points:
        raise ArgumentError("trajectory.points", "is empty; give at least one point")
    places, table = [f"trajectory.points[{k}]" for k in range(len(points))], []
    for where, point in zip(places, points, strict=True):
        row = list(_field(point, "positions", where))
        if len(row) != len(names):
            raise ArgumentError(
                f"{where}.positions",
                f"has {len(row)} numbers, but joint_names has {len(names)}; give one for each",
            )
        table.append(finite_array(f"{where}.positions", row, (len(names),)))
    in_degrees = _degrees_advice(hand, names, np.array(table))
    waypoints = []
    for where, point, values in zip(places, points, table, strict=True):
        named = dict(zip(names, values.tolist(), strict=True))
        try:
            q = joint_positions(hand.tree, named, hand.positions)
        except (ArgumentError, JointLimitError) as error:
            advice = f"; {in_degrees}" if in_degrees else ""
            raise ArgumentError(f"{where}.positions", f"{error}{advice}") from error
        by_joint = {joint: float(q[hand.tree.joint_index[joint]]) for joint in hand.control.joints}
        waypoints.append(Waypoint(q=by_joint, time=_time_from_start(point, where)))
    if in_degrees:
        message = f"angles of the trajectory exceed a full turn, {MOST_ANGLE:.4g} rad"
        emit(Finding(FindingCode.ANGLE_IN_DEGREES, "trajectory", message, in_degrees))
    return waypoints


def _degrees_advice(hand: Hand, names: list[str], table: FloatArray) -> str:
    """Return advice if (N, J) positions look like degrees; empty if they do not."""
    tree = hand.tree
    joints = [tree.joint_index[name] for name in names]
    turning = np.array([tree.joint_kinds[joint] != "prismatic" for joint in joints])
    joints, angles = np.array(joints)[turning], table[:, turning]
    radians = np.radians(angles)
    inside = (tree.lower[joints] <= radians) & (radians <= tree.upper[joints])
    if not (np.abs(angles) > MOST_ANGLE).any() or not inside.all():
        return ""
    return "all angles look like degrees: give radians, as ROS does (math.radians)"


def _check_joint_names(hand: Hand, names: list[str], stay: Sequence[str]) -> None:
    """Raise an error for joints that the hand does not have, that are repeated or missing."""
    where = "trajectory.joint_names"
    for name in (*names, *stay):
        if name not in hand.joint_names:
            words = names_in_words(name, hand.joint_names)
            raise ArgumentError(
                where if name in names else "stay",
                f"the hand has no joint {name!r}; {words}; leave out joints of other robots",
            )
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ArgumentError(where, f"names {twice[0]!r} twice")
    missing = [name for name in hand.control.joints if name not in (*names, *stay)]
    if missing:
        listed = ", ".join(map(repr, missing))
        raise ArgumentError(
            where, f"does not name {listed}; add them, or list those that do not move in stay=[...]"
        )


def _times_and_poses(message: Any) -> tuple[list[float], list[FloatArray]]:
    """Return the times and poses of a MultiDOFJointTrajectory of one joint."""
    names = list(_field(message, "joint_names", "object_poses"))
    if len(names) != 1:
        raise ArgumentError(
            "object_poses.joint_names",
            f"has {names}; it must have one name, as there is one object",
        )
    times, poses = [], []
    for k, point in enumerate(_field(message, "points", "object_poses")):
        where = f"object_poses.points[{k}]"
        transforms = list(_field(point, "transforms", where))
        if len(transforms) != 1:
            raise ArgumentError(
                f"{where}.transforms", f"has {len(transforms)} transforms; give one"
            )
        poses.append(pose_from_message(transforms[0], f"{where}.transforms[0]"))
        times.append(_time_from_start(point, where))
    return times, poses


def _time_from_start(point: Any, where: str) -> float:
    """Return the time from the start, s, in the format of ROS 2 or ROS 1, or as a number."""
    name = f"{where}.time_from_start"
    stated = _field(point, "time_from_start", where)
    if isinstance(stated, int | float):
        return float(finite_array(name, [stated], (1,))[0])
    keys = ("secs", "nsecs") if _has(stated, "secs") else ("sec", "nanosec")
    values = [_field(stated, key, name) for key in keys]
    seconds, nanoseconds = finite_array(name, values, (2,)).tolist()
    return seconds + _NANO * nanoseconds


def _read_message(message: Any) -> Any:
    """Return the message itself, or that in the file of a path."""
    if not isinstance(message, str | Path):
        return message
    path = Path(message)
    text = read_text(path, _MESSAGE)
    if text.lstrip().startswith("{"):
        with errors_of_text(path, _MESSAGE):
            return parse_json(text)
    # As `ros2 topic echo` ends each message.
    parts = [part for part in text.split("\n---") if part.strip(" -\r\n")]
    if len(parts) > 1:
        raise ArgumentError(
            "trajectory", f"{path} has {len(parts)} messages; keep one (ros2 topic echo --once)"
        )
    with errors_of_text(path, _MESSAGE):
        return parse_yaml(parts[0] if parts else "").data


def _has(message: Any, key: str) -> bool:
    return key in message if isinstance(message, Mapping) else hasattr(message, key)


def _field(message: Any, key: str, where: str) -> Any:
    """Return a field of a message: an attribute, or the value of a key.

    Raises:
        ArgumentError: If there is none.
    """
    if _has(message, key):
        return message[key] if isinstance(message, Mapping) else getattr(message, key)
    found = list(message) if isinstance(message, Mapping) else type(message).__name__
    raise ArgumentError(where, f"has no {key!r} (found {found}); see the message's definition")
