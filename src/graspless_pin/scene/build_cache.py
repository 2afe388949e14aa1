"""What scenes of one folder share: robots, hands, and whatever was built of the same content.

A scene is built in stages. Each depends on parts of the file and on what earlier stages made; where
these are as they were in the scene before, so is what it makes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from graspless_pin.caching import Latest
from graspless_pin.findings import Finding, capture, emit
from graspless_pin.geometry.hand.assembly import AssembledMounts
from graspless_pin.geometry.robots.description import RobotDescription
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.scene.validation_errors import validated, with_known
from graspless_pin.scene.yaml_source import YamlSource

_MOST_HANDS = 16


class Last(NamedTuple):
    """The scene that was built last.

    Attributes:
        entry: What its file holds.
        bodies: What was built of its bodies.
        scene: The scene.
    """

    entry: SceneEntry
    bodies: Any
    scene: Any


@dataclass(eq=False)
class Stage:
    """A step from a file to a scene.

    Attributes:
        made: What it made; None: it is to be made now.
        findings: What looks wrong with it.
    """

    made: Any = None
    findings: tuple[Finding, ...] = ()


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

    @contextmanager
    def stage(self, name: str, *sources: Any) -> Iterator[Stage]:
        """Run a stage, and tell what looks wrong with what it makes each time.

        Args:
            name: Its name.
            sources: All that it depends on.

        Yields:
            The stage. What it made of the same sources is there; else it is to be made now.
        """
        stage = self.latest.get(name, sources)
        if stage is None:
            stage = Stage()
            with capture() as found:
                yield stage
            stage.findings = (*found,)
            self.latest.put(name, sources, stage)
        else:
            yield stage
        emit(*stage.findings)

    def keep_hand(self, key: str, hand: AssembledMounts) -> None:
        """Keep a hand, or that it was used again: the one that was used first is forgotten."""
        self.hands[key] = hand
        self.hands.move_to_end(key)
        while len(self.hands) > _MOST_HANDS:
            self.hands.popitem(last=False)
