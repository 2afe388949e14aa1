"""What varies: the values of one variable, in which unit, and what they change in the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin.errors import GrasplessPinError, StudyError
from graspless_pin.scene.units import ANY, UNITS, Unit, kinds_of, si_unit
from graspless_pin.scene.yaml_source import Location
from graspless_pin.studies.keys import Tree, check_bodies, move, place_key, put, turn
from graspless_pin.studies.study_schema import VariableEntry
from graspless_pin.suggestions import names_in_words


@dataclass(frozen=True, eq=False)
class Variable:
    """One thing that varies.

    Attributes:
        name: Its name in the study.
        entry: Its entry in the study.
        unit: Unit of its values.
        targets: Scene keys that it sets, each with a factor and an offset (SI).
    """

    name: str
    entry: VariableEntry
    unit: Unit
    targets: tuple[tuple[Location, float, float], ...]

    @property
    def column(self) -> str:
        """Its column in the results: the name and the unit."""
        return self.name + self.unit.suffix

    @property
    def is_choice(self) -> bool:
        """Whether it has listed values rather than a range."""
        return self.entry.values is not None

    @property
    def grid_size(self) -> int:
        """How many values it has on a grid."""
        if self.entry.values is not None:
            return len(self.entry.values)
        low, high = self._range()
        if self.entry.steps is None and low < high:
            raise StudyError("a range on a grid needs 'steps', how many values, ends included")
        return self.entry.steps or 1

    def points(self) -> list[Any]:
        """Return the values on a grid: those listed, or evenly spaced over the range."""
        if self.entry.values is not None:
            return list(self.entry.values)
        return [self.at(u) for u in np.linspace(0.0, 1.0, self.grid_size).tolist()]

    def at(self, share: float) -> Any:
        """Return the value at a share in [0, 1] of the range, or of the list."""
        if self.entry.values is not None:
            values = list(self.entry.values)
            return values[min(int(share * len(values)), len(values) - 1)]
        low, high = self._range()
        if share in (0.0, 1.0):
            return high if share else low
        if self.entry.scale == "log":
            return float(low * (high / low) ** share)
        return float(low + share * (high - low))

    def extremes(self) -> list[Any]:
        """Values that a check should try: all that are listed, or the ends of the range."""
        return self.points() if self.is_choice else list(dict.fromkeys(self._range()))

    @property
    def displaces(self) -> bool:
        """Whether it moves or turns bodies."""
        return self.entry.move is not None or self.entry.turn is not None

    def placed(self, tree: Tree, value: Any) -> Tree:
        """Return a scene with the variable's keys set."""
        if isinstance(self.entry.values, dict):
            value = self.entry.values[value]
        if isinstance(value, bool) or not isinstance(value, int | float):
            for location, _, _ in self.targets:
                tree = put(tree, location, value)
            return tree
        for location, factor, offset in self.targets:
            number = value
            if not (self.unit.factor == factor == 1.0 and offset == 0.0):
                number = factor * (value * self.unit.factor) + offset
            tree = put(tree, location, number)
        return tree

    def displace(self, tree: Tree, value: Any) -> None:
        """Move or turn the variable's bodies in a part of a scene, see `movable_part`."""
        if self.entry.move is not None:
            entry = self.entry.move
            way = (value - entry.as_in_scene) * self.unit.factor
            move(tree, entry.what, entry.along, way, entry.frame)
        if self.entry.turn is not None:
            entry = self.entry.turn
            angle = (value - entry.as_in_scene) * self.unit.factor
            turn(tree, entry.what, entry.axis, angle, entry.point, entry.frame)

    def _range(self) -> tuple[float, float]:
        assert self.entry.start is not None and self.entry.to is not None  # noqa: S101 - schema
        return self.entry.start, self.entry.to


def make_variable(
    name: str,
    entry: VariableEntry,
    tree: Tree,
    defaults: Tree,
    fail: Callable[..., GrasplessPinError],
) -> Variable:
    """Resolve what a variable changes in a scene.

    Args:
        name: Its name.
        entry: Its entry.
        tree: The scene; what is left out above the variable's keys is put there.
        defaults: The scene with every default written out.
        fail: Makes the error for a part of the entry.

    Raises:
        StudyError: If a key leads nowhere, a body is unknown or a unit does not fit.
    """
    for part in ("move", "turn"):
        shift = getattr(entry, part)
        if shift is not None:
            _check_numbers(entry, part, fail)
            try:
                check_bodies(tree, shift.what, shift.frame, turns=part == "turn")
            except StudyError as error:
                raise fail(part, str(error)) from None
            kind = "length" if part == "move" else "angle"
            return Variable(name, entry, _unit(entry, (kind,), fail), ())
    sets = entry.set or []
    keys = [(item.key, item.factor, item.offset) for item in sets] or [
        (entry.key or name, 1.0, 0.0)
    ]
    targets = []
    for key, factor, offset in keys:
        try:
            targets.append((place_key(tree, defaults, key), factor, offset))
        except StudyError as error:
            raise fail("set" if sets else "key", str(error)) from None
    if any((factor, offset) != (1.0, 0.0) for _, factor, offset in keys):
        _check_numbers(entry, "set", fail)
        return Variable(name, entry, _unit(entry, (), fail), tuple(targets))
    kinds = [kinds_of(location) for location, _, _ in targets]
    shared = tuple(kind for kind in kinds[0] if all(kind in other for other in kinds))
    if not shared:
        named = [f"{item[0]} ({' or '.join(k)})" for item, k in zip(keys, kinds, strict=True)]
        listed = ", ".join(named)
        raise fail("set", f"its keys are measured in different units: {listed}; give factors")
    return Variable(name, entry, _unit(entry, shared, fail), tuple(targets))


def _check_numbers(entry: VariableEntry, part: str, fail: Callable[..., GrasplessPinError]) -> None:
    if isinstance(entry.values, dict) or any(
        isinstance(value, bool | str) for value in entry.values or []
    ):
        raise fail("values", f"'{part}' needs numbers")


def _unit(
    entry: VariableEntry, kinds: tuple[str, ...], fail: Callable[..., GrasplessPinError]
) -> Unit:
    """Return the unit of the values: the one that is named, or the only SI unit that fits."""
    numbers = not isinstance(entry.values, dict) and not any(
        isinstance(value, bool | str) for value in entry.values or []
    )
    if entry.unit is None:
        only = kinds[0] if len(kinds) == 1 and numbers else ANY
        return si_unit(only)
    unit = UNITS.get(entry.unit)
    if unit is None:
        raise fail("unit", f"{entry.unit!r} is no known unit; {names_in_words(entry.unit, UNITS)}")
    if not numbers:
        raise fail("unit", "goes with numbers only, and some of the values are none")
    if kinds and unit.kind not in kinds:
        fitting = [known.name for known in UNITS.values() if known.kind in kinds]
        what = " or ".join(kind or "plain numbers" for kind in kinds)
        raise fail("unit", f"{unit.name!r} is no unit of {what}; needs {', '.join(fitting)}")
    return unit
