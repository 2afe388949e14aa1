"""What the scenes of a study's samples leave for the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from graspless_pin.caching import Bounded
from graspless_pin.planning.hand_placement import HandPlacement
from graspless_pin.scene.build_cache import SceneParts
from graspless_pin.scene.keys import Tree, copied
from graspless_pin.scene.load import FIELDS_BY_KEY
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.validation_errors import is_alike
from graspless_pin.studies.keys import MOVABLE, Variable, movable_part, with_part

Sample = tuple[Any, ...]
"""The value of every variable."""
_MOST_FIELDS = 4096
_MOST_PLACEMENTS = 16


@dataclass(eq=False)
class SampleParts(SceneParts):
    """What the scenes of one study's samples leave for the next; it never changes a scene.

    Two samples share all of their trees that no variable has changed from one to the other. That is
    how the stages of the next scene are known to be the same.

    Attributes:
        placements: Places of the hand by all that they depend on; the last few.
    """

    placements: Bounded[str, HandPlacement] = field(
        default_factory=lambda: Bounded(_MOST_PLACEMENTS)
    )
    _last: tuple[Sample, Scene] | None = None
    _fields: dict[tuple[int, str], tuple[str, Any]] = field(default_factory=dict)
    _names: tuple[str, ...] = ()
    _placed: tuple[Sample, Tree] | None = None
    _moved: tuple[Tree, Sample, Tree, Tree] | None = None

    def known(self, sample: Sample) -> Scene | None:
        """Return the scene of a sample whose values that differ from the last one's were seen.

        Args:
            sample: The values of all variables.

        Returns:
            The scene; None if it has to be built, and learned.
        """
        if self._last is None:
            return None
        fields, (before, scene) = {}, self._last
        for place, (value, last) in enumerate(zip(sample, before, strict=True)):
            if not is_alike(value, last):
                found = self._fields.get((place, repr(value)))
                if found is None:
                    return None
                fields[found[0]] = found[1]
        scene = scene._changed(fields)
        self._last = sample, scene
        return scene

    def learn(self, variables: Sequence[Variable], sample: Sample) -> None:
        """Keep the fields of the scene built last that one value alone has made.

        Args:
            variables: What varies.
            sample: The values of that scene.
        """
        if self.last is None:
            return
        entry, built, scene = self.last
        has_findings = scene.load_findings or (scene.hand is not None and scene.hand.findings)
        # What is found is told of each scene, and what is refused has to be looked for in each.
        self._last = None if has_findings or entry.warnings == "error" else (sample, scene)
        if built.names != self._names or len(self._fields) > _MOST_FIELDS:
            self._fields, self._names = {}, built.names
        keys = [{location[0] for location, *_ in one.targets} for one in variables]
        for place, own in enumerate(keys):
            others = set().union(*keys[:place], *keys[place + 1 :])
            key, *more = own or {""}
            name = FIELDS_BY_KEY.get(str(key))
            if name is not None and not more and key not in others:
                self._fields[place, repr(sample[place])] = name, vars(scene)[name]

    def placed(self, base: Tree, variables: Sequence[Variable], sample: Sample) -> Tree:
        """Return the scene file's content with the keys of one sample set, nothing moved yet.

        Args:
            base: The content without any.
            variables: What varies.
            sample: Its values.
        """
        before: Sequence[Any] = (None,) * len(sample)
        tree = base
        if self._placed is not None:
            before, tree = self._placed
        for variable, value, last in zip(variables, sample, before, strict=True):
            if last is None or not is_alike(value, last):
                tree = variable.placed(tree, value)
        self._placed = sample, tree
        return tree

    def moved(self, placed: Tree, variables: Sequence[Variable], sample: Sample) -> Tree:
        """Return the content with bodies moved and turned.

        Args:
            placed: What `placed` returns.
            variables: What varies.
            sample: Its values.
        """
        pairs = zip(variables, sample, strict=True)
        ways = [(variable, value) for variable, value in pairs if variable.displaces]
        if not ways:
            return placed
        values, last = tuple([value for _, value in ways]), self._moved
        if last is not None and not is_alike([*values], [*last[1]]):
            last = None
        there = None if last is None else last[2]
        if last is None or not _are_same(placed, last[0]):
            part = movable_part(placed)
            if last is None or not is_alike(part, movable_part(last[0])):
                last, there = None, copied(part)
                for variable, value in ways:
                    variable.displace(there, value)
        assert there is not None  # noqa: S101 - where nothing is kept it was made now
        same = [name for name in there if last and placed.get(name) is last[0].get(name)]
        new = {name: item for name, item in there.items() if name not in same}
        moved = with_part(placed, new)
        if last is not None:
            moved |= {name: last[3][name] for name in same}
        self._moved = placed, values, there, moved
        return moved


def _are_same(one: Tree, other: Tree) -> bool:
    """Whether two scenes share all parts that could be moved."""
    return all(one.get(name) is other.get(name) for name in MOVABLE)
