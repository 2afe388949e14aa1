"""What scenes of one folder share: robots, hands, and whatever was built of the same content.

A scene is built in stages. Each is a function of the parts of the file that it is given and of what
earlier stages made; where these are as they were in the scene before, so is what it makes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

from graspless_pin.caching import Latest
from graspless_pin.findings import capture, emit
from graspless_pin.geometry.hand.assembly import AssembledMounts
from graspless_pin.geometry.robots.description import RobotDescription
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.scene.validation_errors import validated, with_known
from graspless_pin.scene.yaml_source import YamlSource

_MOST_HANDS = 16
_Made = TypeVar("_Made")


class Last(NamedTuple):
    """The scene that was built last.

    Attributes:
        entry: What its file holds.
        built: What was built of its bodies.
        scene: The scene.
    """

    entry: SceneEntry
    built: Any
    scene: Any


@dataclass(eq=False)
class SceneParts:
    """What the scenes of one folder leave for the next; it never changes what a scene becomes.

    Of hands, the sixteen that were used last are kept; of other stages, what was made last.

    Attributes:
        robots: Robot by name or path.
        hands: Hand by all of its entry that its description, fingers and control depend on.
        latest: What each stage made last.
        last: The scene that was built last; None: there is none.
    """

    robots: dict[tuple[str, ...], RobotDescription] = field(default_factory=dict)
    hands: OrderedDict[str, AssembledMounts] = field(default_factory=OrderedDict)
    latest: Latest = field(default_factory=Latest)
    last: Last | None = None
    _before: tuple[SceneEntry, Any] | None = None

    def validated(self, source: YamlSource) -> SceneEntry:
        """Return the content of a scene file; parts as in the scene before are the same objects.

        Raises:
            SceneError: See `validated`.
        """
        entry = validated(source, SceneEntry)
        if self._before is not None:
            entry = with_known(entry, source.data, *self._before)
        self._before = entry, source.data
        return entry

    def stage(self, name: str, sources: tuple[Any, ...], make: Callable[[], _Made]) -> _Made:
        """Return what a stage makes, and tell what looks wrong with it each time.

        Args:
            name: Its name.
            sources: All that it depends on.
            make: Makes it.
        """

        def listened() -> tuple[_Made, tuple[Any, ...]]:
            with capture() as found:
                made = make()
            return made, tuple(found)

        made, found = self.latest.of(name, sources, listened)
        emit(*found)
        return made

    def hand(self, key: str, make: Callable[[], AssembledMounts]) -> AssembledMounts:
        """Return the hand of a key, and tell what looks wrong with it each time."""
        if key in self.hands:
            emit(*self.hands[key].findings)
        else:
            self.hands[key] = make()
        self.hands.move_to_end(key)
        while len(self.hands) > _MOST_HANDS:
            self.hands.popitem(last=False)
        return self.hands[key]
