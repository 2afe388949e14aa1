"""Waypoints from a CSV table: a written profile read back, or the plan of another program."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from itertools import starmap
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError
from graspless_pin.planning.path import Waypoint
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
_ALIKE = 0.8
"""Of a column that is read: one that is not there, and was probably meant."""
_UNIT_LENGTH = 1e-3
"""By how much the norm of a rounded quaternion may differ from 1."""


def read_path_csv(path: str | Path) -> tuple[Waypoint, ...]:
    """Read the waypoints of a table: one that `write_path_csv` has written, or of another program.

    The first row names the columns. Those that are read are ``time_s``, the object's pose
    ``object_x_m``, ``object_y_m``, ``object_z_m``, ``object_qx``, ``object_qy``, ``object_qz``,
    ``object_qw``, and ``position_<joint>_rad`` or ``position_<joint>_m`` of joints; all others are
    passed over. Time, pose and joints may each be left out: they are then as in `Waypoint`.

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
        raise ArgumentError("path", f"'{path}' is no table of comma-separated text") from error
    names = [name.strip() for name in header]
    for separator, word in _SEPARATORS.items():
        if len(names) == 1 and separator in header[0]:
            raise ArgumentError(
                "path", f"'{path}' has {word} between its columns; write commas, and points in "
                "numbers (0.5)"
            )  # fmt: skip
    _check_names(path, names)
    joints = _joints(path, names)
    wanted = [name for name in (_TIME, *_POSE, *joints) if name in names]
    if not wanted:
        raise ArgumentError(
            "path",
            f"'{path}' has the columns {', '.join(names)}; needs {_TIME}, {_POSE[0]} and the other "
            f"six of the pose, or {_JOINT}<joint>_rad",
        )
    has_pose = any(name in names for name in _POSE)
    if has_pose and (missing := [name for name in _POSE if name not in names]):
        raise ArgumentError("path", f"'{path}' has no column {', '.join(missing)} of the pose")
    cells = [
        {name: _number(path, line, name, names, row) for name in wanted}
        for line, row in enumerate(rows, 2)
        if row
    ]
    if not cells:
        raise ArgumentError("path", f"'{path}' has no row below its header; needs one at least")
    poses = _poses(path, cells) if has_pose else [None] * len(cells)

    def waypoint(row: Mapping[str, float], T_world_object: FloatArray | None) -> Waypoint:
        q = {joint: row[name] for name, joint in joints.items()}
        return Waypoint(q or None, T_world_object, row.get(_TIME))

    return tuple(starmap(waypoint, zip(cells, poses, strict=True)))


def _check_names(path: str | Path, names: Sequence[str]) -> None:
    """Refuse columns with units in brackets, and those that are nearly one that is read."""
    missing = [name for name in (_TIME, *_POSE) if name not in names]
    for name in names:
        stated = _STATED_UNIT.search(name)
        plain = "_".join(name[: stated.start()].split()) if stated else name
        near = nearest_name(f"{plain}_{stated[1]}" if stated else plain, missing, _ALIKE)
        if stated is not None:
            of_joint = f"{_JOINT}{plain.removeprefix(_JOINT)}"
            ending = "_m" if stated[1] in ("m", "cm", "mm") else "_rad"
            raise ArgumentError(
                "path",
                f"'{path}': column {name!r} has its unit in brackets; name it "
                f"{near or of_joint + ending!r} and give SI (s, m, rad), or leave it out",
            )
        start, _, rest = name.partition("_")
        if f"{start}_" != _JOINT and name.endswith(_UNITS):
            near = near or (nearest_name(start, [_JOINT], _ALIKE) and f"{_JOINT}{rest}")
        if near is not None and name not in (_TIME, *_POSE):
            raise ArgumentError("path", f"'{path}': column {name!r}: did you mean {near!r}?")


def _joints(path: str | Path, names: Sequence[str]) -> dict[str, str]:
    """Return the joints by the names of their columns."""
    joints = {}
    for name in names:
        unit = next((unit for unit in _UNITS if name.endswith(unit)), None)
        if name.startswith(_JOINT) and unit is None:
            known = " or ".join(_UNITS)
            raise ArgumentError("path", f"'{path}': column {name!r} has no unit; end it in {known}")
        if name.startswith(_JOINT) and unit is not None:
            joints[name] = name.removeprefix(_JOINT).removesuffix(unit)
    return joints


def _number(
    path: str | Path, line: int, name: str, names: Sequence[str], row: Sequence[str]
) -> float:
    if len(row) != len(names):
        advice = ""
        if len(row) == 2 * len(names):
            advice = "; if commas are decimal ones, write points in numbers (0.5)"
        raise ArgumentError(
            "path",
            f"'{path}', row {line} has {len(row)} cells, and the header {len(names)}{advice}",
        )
    cell = row[names.index(name)]
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        advice = " with a point (0.5)" if "," in cell else ""
        raise ArgumentError(
            "path",
            f"'{path}', row {line}, column {name}: found {cell!r}; needs a finite number{advice}",
        )
    return number


def _poses(path: str | Path, cells: Sequence[Mapping[str, float]]) -> list[FloatArray]:
    table = np.array([[row[name] for name in _POSE] for row in cells])
    lengths = np.linalg.norm(table[:, 3:], axis=1)
    off = np.abs(lengths - 1.0) > _UNIT_LENGTH
    if off.any():
        row = int(np.argmax(off))
        raise ArgumentError(
            "path",
            f"'{path}', waypoint {row}: the quaternion (x, y, z, w) has the norm "
            f"{lengths[row]:.6g}; needs 1",
        )
    poses = np.tile(np.eye(4), (len(table), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(table[:, 3:]).as_matrix()
    poses[:, :3, 3] = table[:, :3]
    return [*poses]
