"""Exchange of paths: CSV tables of waypoints, and joint trajectories in the form of messages."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from itertools import starmap
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.planning.path import PathProfile, Waypoint
from graspless_pin.planning.path_timing import PathTiming
from graspless_pin.problem.checks import FloatArray
from graspless_pin.suggestions import nearest_name

_TIME = "time_s"
_POSE = (
    "object_x_m", "object_y_m", "object_z_m", "object_qx", "object_qy", "object_qz", "object_qw",
)  # fmt: skip
_JOINT = "position_"
_UNITS = ("_rad", "_m")
_SEPARATORS = {";": "semicolons", "\t": "tabs"}
_STATED_UNIT = re.compile(r"\s*[\[(]\s*(deg|degrees|°|rad|m|cm|mm|s|ms)\s*[\])]\s*$")
_LIKE_COLUMN = 0.8
"""Similarity to the name of a missing column from which a misspelling is suspected."""
_NORM_ERROR = 1e-3
"""Largest deviation of the norm of a rounded quaternion from 1."""


def read_path_csv(path: str | Path) -> tuple[Waypoint, ...]:
    """Read the waypoints of a table, written by `write_path_csv` or by another program.

    The first row names the columns. Those that are read are ``time_s``, the object's pose
    ``object_x_m``, ``object_y_m``, ``object_z_m``, ``object_qx``, ``object_qy``, ``object_qz``,
    ``object_qw``, and ``position_<joint>_rad`` or ``position_<joint>_m`` of joints; all others are
    ignored. Time, pose and joints may each be left out: the defaults are those of `Waypoint`.

    Args:
        path: The file.

    Returns:
        A waypoint for each further row.

    Raises:
        ArgumentError: If the file cannot be read, has no row or none of these columns, only some of
            the pose's, one that is nearly one of them or has its unit in brackets, or a cell that
            is no number.

    Examples:
        >>> from graspless_pin import Evaluator, Waypoint, evaluate_path, load_scene
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.planning import read_path_csv, write_path_csv
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> with TemporaryDirectory() as folder:
        ...     write_path_csv(profile, f"{folder}/path.csv")
        ...     waypoints = read_path_csv(f"{folder}/path.csv")
        >>> waypoints[1].time, len(waypoints[1].q)
        (1.0, 9)
    """
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            header, *rows = csv.reader(file, strict=True)
    except OSError as error:
        raise ArgumentError("path", f"cannot read '{path}': {error.strerror}") from error
    except (ValueError, csv.Error) as error:
        raise ArgumentError("path", f"'{path}' is not a table of comma-separated values") from error
    names = [name.strip() for name in header]
    for separator, word in _SEPARATORS.items():
        if len(names) == 1 and separator in header[0]:
            raise ArgumentError(
                "path", f"'{path}' has {word} between its columns; separate columns by commas, and "
                "write decimal points (0.5)"
            )  # fmt: skip
    _check_columns(path, names)
    joints = _joint_columns(path, names)
    wanted = [name for name in (_TIME, *_POSE, *joints) if name in names]
    if not wanted:
        raise ArgumentError(
            "path",
            f"'{path}' has the columns {', '.join(names)}; it must have {_TIME}, the seven columns "
            f"of the pose ({', '.join(_POSE)}), or {_JOINT}<joint>_rad",
        )
    has_pose = any(name in names for name in _POSE)
    if has_pose and (missing := [name for name in _POSE if name not in names]):
        raise ArgumentError(
            "path", f"'{path}' has no column {', '.join(missing)}; give all seven of the pose"
        )
    cells = [
        {name: _cell_number(path, line, name, names, row) for name in wanted}
        for line, row in enumerate(rows, 2)
        if row
    ]
    if not cells:
        raise ArgumentError("path", f"'{path}' has no row below its header; give at least one")
    poses = _object_poses(path, cells) if has_pose else [None] * len(cells)

    def waypoint(row: Mapping[str, float], T_world_object: FloatArray | None) -> Waypoint:
        q = {joint: row[name] for name, joint in joints.items()}
        return Waypoint(q or None, T_world_object, row.get(_TIME))

    return tuple(starmap(waypoint, zip(cells, poses, strict=True)))


def _check_columns(path: str | Path, names: Sequence[str]) -> None:
    """Refuse duplicates, columns with units in brackets, and misspelled names of known columns."""
    missing = [name for name in (_TIME, *_POSE) if name not in names]
    for index, name in enumerate(names):
        if name and name in names[:index]:
            raise ArgumentError("path", f"'{path}' has two columns {name!r}; keep one")
        stated = _STATED_UNIT.search(name)
        plain = "_".join(name[: stated.start()].split()) if stated else name
        similar = nearest_name(f"{plain}_{stated[1]}" if stated else plain, missing, _LIKE_COLUMN)
        if stated is not None:
            of_joint = f"{_JOINT}{plain.removeprefix(_JOINT)}"
            ending = "_m" if stated[1] in ("m", "cm", "mm") else "_rad"
            raise ArgumentError(
                "path",
                f"'{path}': column {name!r} has its unit in brackets; name it "
                f"{similar or of_joint + ending!r} and give SI (s, m, rad), or leave it out",
            )
        start, _, rest = name.partition("_")
        if f"{start}_" != _JOINT and name.endswith(_UNITS):
            similar = similar or (nearest_name(start, [_JOINT], _LIKE_COLUMN) and f"{_JOINT}{rest}")
        if similar is not None and name not in (_TIME, *_POSE):
            raise ArgumentError("path", f"'{path}': column {name!r}: did you mean {similar!r}?")


def _joint_columns(path: str | Path, names: Sequence[str]) -> dict[str, str]:
    """Return the joints by the names of their columns."""
    joints = {}
    for name in names:
        unit = next((unit for unit in _UNITS if name.endswith(unit)), None)
        if name.startswith(_JOINT) and unit is None:
            known = " or ".join(_UNITS)
            raise ArgumentError(
                "path", f"'{path}': column {name!r} has no unit; its name must end in {known}"
            )
        if name.startswith(_JOINT) and unit is not None:
            joints[name] = name.removeprefix(_JOINT).removesuffix(unit)
    return joints


def _cell_number(
    path: str | Path, line: int, name: str, names: Sequence[str], row: Sequence[str]
) -> float:
    if len(row) != len(names):
        advice = ""
        if len(row) == 2 * len(names):
            advice = "; if it has decimal commas, write decimal points (0.5)"
        raise ArgumentError(
            "path",
            f"'{path}', row {line} has {len(row)} cells, but the header has {len(names)}{advice}",
        )
    cell = row[names.index(name)]
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        advice = " with a decimal point (0.5)" if "," in cell else ""
        raise ArgumentError(
            "path",
            f"'{path}', row {line}, column {name}: found {cell!r}; must be a finite number{advice}",
        )
    return number


def _object_poses(path: str | Path, cells: Sequence[Mapping[str, float]]) -> list[FloatArray]:
    table = np.array([[row[name] for name in _POSE] for row in cells])
    lengths = np.linalg.norm(table[:, 3:], axis=1)
    off = np.abs(lengths - 1.0) > _NORM_ERROR
    if off.any():
        row = int(np.argmax(off))
        raise ArgumentError(
            "path",
            f"'{path}', waypoint {row}: the quaternion (x, y, z, w) has the norm "
            f"{lengths[row]:.6g}; it must be 1",
        )
    poses = np.tile(np.eye(4), (len(table), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(table[:, 3:]).as_matrix()
    poses[:, :3, 3] = table[:, :3]
    return [*poses]


_NANOSECONDS = 1_000_000_000


def write_path_csv(profile: PathProfile, path: str | Path) -> None:
    """Write a profile as a table with a row for each waypoint and units in the column names.

    The columns are time, status, margin, margin in the motion that ends there, whether the contacts
    differ from the row before, the touching bodies (a name for each contact, separated by blanks),
    the object's position and quaternion (x, y, z, w), and position and torque of each joint.
    Numbers are written with all their digits; where there are no torques the cells are empty. An
    existing file is replaced.

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
    tree = None if profile.hand is None else profile.hand.tree
    kinds = {} if tree is None else dict(zip(tree.joint_names, tree.joint_kinds, strict=True))
    positions = [
        f"{_JOINT}{name}_{'m' if kinds.get(name) == 'prismatic' else 'rad'}"
        for name in profile.position_names
    ]
    torques = [
        f"torque_{name}_{unit.replace(' ', '_')}"
        for name, unit in zip(profile.torque_names, profile.torque_units, strict=True)
    ]
    summaries = ("status", "margin_N", "arrival_margin_N", "contacts_change", "contacts")
    header = [_TIME, *summaries, *_POSE, *positions, *torques]
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
                        *_number_cells([profile.margins[k], profile.arrival_margins[k]]),
                        int(k in changing),
                        " ".join(bodies),
                        *_number_cells(profile.object_poses[k, :3, 3]),
                        *_number_cells(quaternions[k]),
                        *_number_cells(profile.positions[k]),
                        *_number_cells(profile.torques[k]),
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
            raise NoSolutionError(f"there is no timing to export ({profile.reason})")
        names, no_columns = profile.joint_names, np.empty((len(profile.times), 0))
        columns = profile.positions, profile.velocities, profile.accelerations, no_columns
    else:
        if not profile.found:
            first = profile.failures[0]
            raise NoSolutionError(
                f"waypoint {first} has no torques to export ({profile.failure_reason(first)}); "
                "check .found first"
            )
        names, no_columns = profile.position_names, np.empty((len(profile.times), 0))
        torques = dict(zip(profile.torque_names, np.nan_to_num(profile.torques).T, strict=True))
        zeros = np.zeros(len(profile.times))
        efforts = np.column_stack([no_columns, *(torques.get(name, zeros) for name in names)])
        columns = profile.positions, no_columns, no_columns, efforts
    keys = "positions", "velocities", "accelerations", "effort"
    points: list[dict[str, Any]] = []
    for time, *row in zip(profile.times - profile.times[0], *columns, strict=True):
        seconds, nanoseconds = divmod(round(float(time) * _NANOSECONDS), _NANOSECONDS)
        point = {key: values.tolist() for key, values in zip(keys, row, strict=True)}
        points.append(point | {"time_from_start": {"sec": seconds, "nanosec": nanoseconds}})
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(names),
        "points": points,
    }


def _number_cells(values: Any) -> list[str]:
    """Return numbers as text with all their digits; empty where they are not finite."""
    return [repr(float(value)) if np.isfinite(value) else "" for value in values]
