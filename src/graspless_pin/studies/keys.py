"""Variables of a study: scene keys by dotted path, or displacements of bodies, and values."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, GrasplessPinError, StudyError
from graspless_pin.geometry.poses import invert, pose_matrix, rigid, transformed
from graspless_pin.intake.yaml_source import Location, is_whole_number, unknown_key
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.body_building import rotation_form_and_value
from graspless_pin.scene.keys import Tree, place_key, with_value_at
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.scene.units import ANY, SI_UNITS, UNITS, Unit, kinds_of, offset_key
from graspless_pin.studies.study_schema import MoveEntry, PosingEntry, TurnEntry, VariableEntry
from graspless_pin.suggestions import names_in_words

Sample = tuple[Any, ...]
"""The value of every variable."""
VECTORS = ("gravity", "tangent_axes", "motion", "loads", "acceleration")
MOVABLE = ("object", "supports", "hand", *VECTORS)
"""Top-level keys of a scene that `displace` reads and changes."""


def displace(tree: Tree, entry: MoveEntry | TurnEntry, amount: float) -> None:
    """Move bodies by a distance (m), or turn bodies and directions by an angle (rad).

    The direction, or the axis, is in the world or in a body's frame.
    """
    frame = np.eye(4) if entry.frame is None else _pose_of(next(_pose_entries(tree, [entry.frame])))
    if isinstance(entry, MoveEntry):
        direction = np.asarray(entry.along, dtype=float) / np.linalg.norm(entry.along)
        T = rigid(frame[:3, :3] @ direction * amount)
    else:
        axis = np.asarray(entry.axis, dtype=float) / np.linalg.norm(entry.axis)
        R = Rotation.from_rotvec(amount * axis).as_matrix()
        T_world_axis = frame @ rigid(entry.point)
        T = T_world_axis @ rigid(np.zeros(3), R) @ invert(T_world_axis)
        for vectors, index in _vector_entries(tree, entry.what):
            vectors[index] = (T[:3, :3] @ np.asarray(vectors[index], dtype=float)).tolist()
        accelerated = tree.get("acceleration") or {}
        if "acceleration" in entry.what and accelerated.get("at"):
            accelerated["at"] = transformed(T, np.asarray(accelerated["at"], dtype=float)).tolist()
    for pose in _pose_entries(tree, entry.what):
        moved = T @ _pose_of(pose)
        pose.clear()
        pose.update(position=moved[:3, 3].tolist(), matrix=moved[:3, :3].tolist())


def check_bodies(tree: Tree, what: Sequence[str], frame: str | None, *, turns: bool) -> None:
    """Refuse unknown names in a move or turn, and scenes with stated contacts.

    Raises:
        StudyError: Naming the known names.
    """
    known = [*_pose_locations(tree), "all", *(VECTORS if turns else ())]
    for name in what:
        if name not in known:
            words = names_in_words(name, known)
            raise StudyError(f"what: no body of the scene is named {name!r}; {words}")
    if frame is not None and frame not in _pose_locations(tree):
        raise StudyError(
            f"frame: no body of the scene is named {frame!r}; "
            f"{names_in_words(frame, _pose_locations(tree))}"
        )
    if tree.get("contacts") is not None:
        raise StudyError(
            "the scene states its contacts, which would not move with the bodies; vary their "
            "positions, or leave 'contacts' out of the scene to have them found from the shapes"
        )


def _pose_locations(tree: Tree) -> dict[str, list[Location]]:
    """Return the locations of the poses of each body or group of bodies, by name."""
    target = tree["object"]
    bodies: dict[str, list[Location]] = {"object": [("object", "pose")]}
    bodies[target.get("name", "object")] = [("object", "pose")]
    for index, support in enumerate(tree.get("supports") or []):
        bodies[support["name"]] = [("supports", index, "pose")]
    hand = tree.get("hand")
    if hand is not None:
        mounts = hand.get("mounts") or []
        mount_poses = [("hand", "mounts", i, "base_pose") for i in range(len(mounts))]
        bodies["hand"] = [*mount_poses] or [("hand", "base_pose")]
        for mount, location in zip(mounts, mount_poses, strict=True):
            bodies[mount["prefix"].rstrip("/")] = [location]
    return bodies


def _pose_entries(tree: Tree, what: Sequence[str]) -> Iterator[Tree]:
    """Yield the pose entries of bodies, each once; an omitted one is added to the tree as empty."""
    bodies = _pose_locations(tree)
    names = bodies if "all" in what else [name for name in what if name in bodies]
    for location in dict.fromkeys(location for name in names for location in bodies[name]):
        parent: Any = tree
        for part in location[:-1]:
            parent = parent[part]
        if parent.get(location[-1]) is None:
            parent[location[-1]] = {}
        yield parent[location[-1]]


def _vector_entries(tree: Tree, what: Sequence[str]) -> Iterator[tuple[Any, Any]]:
    """Yield the vectors in world axes that a turn rotates: container, and key or index in it."""
    all_bodies = "all" in what
    if "gravity" in what:
        tree.setdefault("gravity", [0.0, 0.0, -9.81])
        yield tree, "gravity"
    if all_bodies or "tangent_axes" in what:
        axes = tree.get("tangent_axes") or []
        yield from ((axes, index) for index in range(len(axes)))
    if "loads" in what:
        for load in tree.get("loads") or []:
            names = ("field",) if load.get("axes") == "object" else ("force", "moment", "field")
            yield from ((load, name) for name in names if name in load)
    if "acceleration" in what:
        acceleration = tree.get("acceleration") or {}
        names = ("linear", "angular", "angular_velocity")
        yield from ((acceleration, name) for name in names if name in acceleration)
    motion = tree.get("motion") or {}
    twists = []
    if all_bodies or "motion" in what:
        twists += [motion.get("object_twist"), (motion.get("hand") or {}).get("base_twist")]
    for support in tree.get("supports") or []:
        if all_bodies or support["name"] in what:
            twists.append(support.get("velocity"))
    for twist in filter(None, twists):
        yield from ((twist, part) for part in ("linear", "angular") if part in twist)


def _pose_of(entry: Tree) -> FloatArray:
    return pose_matrix(entry.get("position", (0.0, 0.0, 0.0)), rotation_form_and_value(entry)[1])


@dataclass(frozen=True, eq=False)
class Variable:
    """A variable of a study.

    Attributes:
        name: Its name in the study.
        entry: Its entry in the study file.
        unit: Unit of its values.
        targets: Scene keys that it sets, each with a factor and an offset (SI).
        is_whole: Whether its values are whole numbers because one of the keys needs them.
    """

    name: str
    entry: VariableEntry
    unit: Unit
    targets: tuple[tuple[Location, float, float], ...]
    is_whole: bool = False

    @property
    def column(self) -> str:
        """Name of its column in the results: the name and the unit."""
        return self.name + self.unit.suffix

    @property
    def is_choice(self) -> bool:
        """Whether it has listed values rather than a range."""
        return self.entry.values is not None

    @property
    def grid_size(self) -> int:
        """Number of its values on a grid."""
        return (self.entry.steps or 1) if self.entry.values is None else len(self.entry.values)

    def grid_values(self) -> list[Any]:
        """Return the values on a grid: those listed, or evenly spaced over the range."""
        if self.entry.values is not None:
            return list(self.entry.values)
        if self.is_whole:
            return [round(value) for value in np.linspace(*self._ends(), self.grid_size).tolist()]
        return [self.value_at(u) for u in np.linspace(0.0, 1.0, self.grid_size).tolist()]

    def value_at(self, share: float) -> Any:
        """Return the value at a share in [0, 1] of the range, or of the list."""
        if self.entry.values is not None:
            values = list(self.entry.values)
            return values[min(int(share * len(values)), len(values) - 1)]
        low, high = self._ends()
        if share in (0.0, 1.0):
            return high if share else low
        # A whole number stands for the range from it up to the next one.
        top = high + 1 if self.is_whole else high
        value = low + share * (top - low)
        if self.entry.scale == "log":
            value = low * (top / low) ** share
        return min(int(value), high) if self.is_whole else float(value)

    def extremes(self) -> list[Any]:
        """Return the values to check: all listed ones, or the ends of the range."""
        return self.grid_values() if self.is_choice else list(dict.fromkeys(self._ends()))

    def with_value(self, tree: Tree, value: Any) -> Tree:
        """Return a scene's tree with the variable's keys set."""
        if isinstance(self.entry.values, dict):
            value = self.entry.values[value]
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        for location, factor, offset in self.targets:
            as_it_is = self.unit.factor == factor == 1.0 and offset == 0.0
            scaled = is_number and not as_it_is
            number = factor * (value * self.unit.factor) + offset if scaled else value
            tree = with_value_at(tree, location, number)
        return tree

    def _ends(self) -> tuple[float, float]:
        assert self.entry.start is not None and self.entry.to is not None  # noqa: S101 - schema
        if self.is_whole:
            return int(self.entry.start), int(self.entry.to)
        return self.entry.start, self.entry.to


def make_variable(
    name: str,
    entry: VariableEntry,
    tree: Tree,
    defaults: Tree,
    fail: Callable[..., GrasplessPinError],
) -> Variable:
    """Make a variable: resolve its scene keys and its unit.

    Args:
        name: Its name.
        entry: Its entry.
        tree: The scene; omitted parents of the variable's keys are added to it.
        defaults: The scene with all defaults filled in.
        fail: Makes the error for a part of the entry.

    Raises:
        StudyError: If a key leads nowhere, a body is unknown or a unit does not fit.
    """
    for part in ("move", "turn"):
        displacement = getattr(entry, part)
        if displacement is not None:
            _check_numbers(entry, part, fail)
            try:
                check_bodies(tree, displacement.what, displacement.frame, turns=part == "turn")
            except StudyError as error:
                raise fail(part, str(error)) from None
            kind = "length" if part == "move" else "angle"
            return Variable(name, entry, _unit_of_values(entry, (kind,), fail), ())
    sets = entry.set or []
    keys = [(item.key, item.factor, item.offset) for item in sets] or [
        (entry.key or name, 1.0, 0.0)
    ]
    targets = []
    for key, factor, offset in keys:
        try:
            targets.append((place_key(tree, defaults, key), factor, offset))
        except ArgumentError as error:
            raise fail("set" if sets else "key", str(error)) from None
    if any((factor, offset) != (1.0, 0.0) for _, factor, offset in keys):
        _check_numbers(entry, "set", fail)
        return Variable(name, entry, _unit_of_values(entry, (), fail), tuple(targets))
    kinds = [kinds_of(location) for location, _, _ in targets]
    shared = tuple(kind for kind in kinds[0] if all(kind in each for each in kinds))
    if not shared:
        named = [f"{item[0]} ({' or '.join(own)})" for item, own in zip(keys, kinds, strict=True)]
        listed = ", ".join(named)
        raise fail("set", f"its keys have different units: {listed}; give each a factor")
    if entry.unit is not None and shared == (ANY,):
        for (key, *_), (location, *_) in zip(keys, targets, strict=True):
            if unknown := unknown_key(tree, _schema_of(location), location):
                raise fail("set" if sets else "key", f"{key}: {unknown}")
    offsets = [offset_key(location, UNITS.get(entry.unit or "")) for location, _, _ in targets]
    advice = next((f"; for {entry.unit} use uncertainty.{key}" for key in offsets if key), "")
    unit, is_whole = _unit_of_values(entry, shared, fail, advice), entry.values is None
    is_whole = is_whole and any(
        is_whole_number(tree, _schema_of(location), location) for location, _, _ in targets
    )
    if is_whole:
        _check_whole_range(entry, fail)
    return Variable(name, entry, unit, tuple(targets), is_whole)


def _schema_of(location: Location) -> type[BaseModel]:
    """Return the schema that a key belongs to."""
    return PosingEntry if location[0] in PosingEntry.model_fields else SceneEntry


def _check_whole_range(entry: VariableEntry, fail: Callable[..., GrasplessPinError]) -> None:
    """Refuse ends or steps of a range that are not whole numbers."""
    start, to = entry.start or 0.0, entry.to or 0.0
    for part, value in (("from", start), ("to", to)):
        if value != int(value):
            raise fail(part, f"found {value:g}; the key needs whole numbers")
    steps = entry.steps or 2
    if (to - start) % (steps - 1 or 1):
        raise fail(
            "steps",
            f"{steps} values from {start:g} to {to:g} are not all whole numbers, as the key "
            f"requires; use {to - start + 1:g} steps for all whole numbers, or list values",
        )
    if entry.scale == "log" and entry.steps is not None:
        raise fail("scale", "log does not give whole numbers, as the key requires; list values")


def _has_numbers(entry: VariableEntry) -> bool:
    """Return whether all values of a variable are numbers."""
    listed = entry.values or []
    return not (isinstance(listed, dict) or any(isinstance(one, bool | str) for one in listed))


def _check_numbers(entry: VariableEntry, part: str, fail: Callable[..., GrasplessPinError]) -> None:
    if not _has_numbers(entry):
        raise fail("values", f"'{part}' needs numbers")


def _unit_of_values(
    entry: VariableEntry,
    kinds: tuple[str, ...],
    fail: Callable[..., GrasplessPinError],
    advice: str = "",
) -> Unit:
    """Return the unit of the values: the stated one, else the SI unit of the only kind."""
    if entry.unit is None:
        return SI_UNITS[kinds[0] if len(kinds) == 1 and _has_numbers(entry) else ANY]
    if not _has_numbers(entry):
        raise fail("unit", "requires numbers, and some of the values are not numbers")
    fitting = [unit.name for unit in UNITS.values() if not kinds or unit.kind in kinds]
    if entry.unit not in fitting:
        kind_names = " or ".join(kind or "plain numbers" for kind in kinds)
        kind = f"unit of {kind_names}" if kind_names else "known unit"
        raise fail("unit", f"{entry.unit!r} is not a {kind}; use {' or '.join(fitting)}{advice}")
    return UNITS[entry.unit]
