"""A path's profile for other programs: a CSV table, and a message-like joint trajectory."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.planning.path import PathProfile
from graspless_pin.planning.path_timing import PathTiming

_NANOSECONDS = 1_000_000_000


def write_path_csv(profile: PathProfile, path: str | Path) -> None:
    """Write a profile as a table with a row for each waypoint and units in the column names.

    The columns are time, status, margin, margin in the motion that ends there, whether the contacts
    differ from the row before, what touches (a name for each contact, separated by blanks), the
    object's position and quaternion (x, y, z, w), and position and torque of each joint. Numbers
    are written with all their digits; where there are no torques the cells are empty. An existing
    file is replaced.

    Args:
        profile: The profile.
        path: The file.

    Raises:
        ArgumentError: If the file cannot be written.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.planning import write_path_csv
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> with TemporaryDirectory() as folder:
        ...     write_path_csv(profile, f"{folder}/path.csv")
        ...     len(Path(folder, "path.csv").read_text().splitlines())
        3
    """
    hand = profile.hand
    positions = [f"position_{name}_{_position_unit(hand, name)}" for name in profile.position_names]
    torques = [
        f"torque_{name}_{unit.replace(' ', '_')}"
        for name, unit in zip(profile.torque_names, profile.torque_units, strict=True)
    ]
    header = [
        "time_s",
        "status",
        "margin_N",
        "arrival_margin_N",
        "contacts_change",
        "contacts",
        *("object_x_m", "object_y_m", "object_z_m"),
        *("object_qx", "object_qy", "object_qz", "object_qw"),
        *positions,
        *torques,
    ]
    changing = {change.waypoint for change in profile.contact_changes}
    quaternions = Rotation.from_matrix(profile.object_poses[:, :3, :3]).as_quat(canonical=True)
    try:
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            for k, evaluation in enumerate(profile.evaluations):
                bodies = evaluation.contacts.bodies if evaluation.has_contacts else ()
                writer.writerow(
                    [
                        repr(float(profile.times[k])),
                        evaluation.status.name.lower(),
                        *_cells([profile.margins[k], profile.arrival_margins[k]]),
                        int(k in changing),
                        " ".join(bodies),
                        *_cells(profile.object_poses[k, :3, 3]),
                        *_cells(quaternions[k]),
                        *_cells(profile.positions[k]),
                        *_cells(profile.torques[k]),
                    ]
                )
    except OSError as error:
        raise ArgumentError("path", f"cannot write '{path}': {error.strerror}") from error


def joint_trajectory(profile: PathProfile | PathTiming) -> dict[str, Any]:
    """Return a profile or a timing in the form of a ``trajectory_msgs/JointTrajectory``.

    The joints are the hand's independent ones. A timing has velocities and accelerations, and no
    efforts. The effort of a joint is its motor's torque; a
    joint without a motor under force control (position-controlled, or moved by tendons) has the
    effort 0. Times count from the first waypoint.

    Args:
        profile: A profile with torques at every waypoint, or a timing of `fastest_timing`.

    Returns:
        Plain dicts, lists, numbers and strings, as ROS 2 names them and JSON takes them.

    Raises:
        NoSolutionError: If a waypoint has no torques, or there is no timing.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> from graspless_pin.planning import joint_trajectory
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> len(joint_trajectory(profile)["points"])
        2
    """
    if isinstance(profile, PathTiming):
        if not profile.found:
            raise NoSolutionError(f"there is no timing to send ({profile.reason})")
        rows = zip(profile.positions, profile.velocities, profile.accelerations, strict=True)
        points = [
            _point(time, q.tolist(), rate.tolist(), change.tolist(), [])
            for time, (q, rate, change) in zip(profile.times.tolist(), rows, strict=True)
        ]
        return _message(list(profile.joint_names), points)
    if not profile.found:
        first = profile.failures[0]
        raise NoSolutionError(
            f"waypoint {first} has no torques to send ({profile.failure_reason(first)}); "
            "check .found first"
        )
    columns = [
        profile.torque_names.index(name) if name in profile.torque_names else None
        for name in profile.position_names
    ]
    points = []
    for time, positions, torques in zip(
        (profile.times - profile.times[0]).tolist(),
        profile.positions.tolist(),
        np.nan_to_num(profile.torques).tolist(),
        strict=True,
    ):
        effort = [0.0 if column is None else torques[column] for column in columns]
        points.append(_point(time, positions, [], [], effort))
    return _message(list(profile.position_names), points)


def _point(
    time: float,
    positions: list[float],
    velocities: list[float],
    accelerations: list[float],
    effort: list[float],
) -> dict[str, Any]:
    seconds, nanoseconds = divmod(round(time * _NANOSECONDS), _NANOSECONDS)
    return {
        "positions": positions,
        "velocities": velocities,
        "accelerations": accelerations,
        "effort": effort,
        "time_from_start": {"sec": seconds, "nanosec": nanoseconds},
    }


def _message(names: list[str], points: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": names,
        "points": points,
    }


def _cells(values: Any) -> list[str]:
    """Numbers with all their digits, empty where there is none."""
    return [repr(float(value)) if np.isfinite(value) else "" for value in values]


def _position_unit(hand: Hand | None, name: str) -> str:
    return "m" if _is_linear(hand, name) else "rad"


def _is_linear(hand: Hand | None, name: str) -> bool:
    if hand is None or name not in hand.joint_names:
        return False
    return hand.tree.joint_kinds[hand.tree.joint_index[name]] == "prismatic"
