"""What the scenes of a study's samples leave for the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from graspless_pin.scene.messages import is_alike
from graspless_pin.scene.stages import SceneParts
from graspless_pin.studies.keys import Tree, copied, movable_part, with_part
from graspless_pin.studies.variables import Variable

Sample = tuple[Any, ...]
"""The value of every variable."""


@dataclass(eq=False)
class SampleParts(SceneParts):
    """What the scenes of one study's samples leave for the next; it never changes a scene.

    Two samples share all of their trees that no variable has changed from one to the other. That is
    how the stages of the next scene are known to be the same.
    """

    _placed: tuple[Sample, Tree] | None = None
    _moved: tuple[Tree, Sample, Tree] | None = None

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
        part, values = movable_part(placed), tuple([value for _, value in ways])
        last = self._moved
        if last is None or not is_alike(part, last[0]) or not is_alike([*values], [*last[1]]):
            there = copied(part)
            for variable, value in ways:
                variable.displace(there, value)
            last = self._moved = part, values, there
        return with_part(placed, last[2])
