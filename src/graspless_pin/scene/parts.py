"""What many scenes share: robots that are read once, hands that are assembled once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from graspless_pin.geometry.hand.configuration import joint_positions
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.robots.description import RobotDescription
from graspless_pin.scene.hand_schema import HandEntry

_MOST_HANDS = 16
_NOT_OF_THE_HAND = {"q", "material", "count_own_weight", "hybrid_force_limit"}


@dataclass(eq=False)
class SceneParts:
    """Robots and hands of the scenes of one folder, kept for the next scene.

    A hand at other joint positions is the same kinematics and shapes; what is kept never changes
    what a scene becomes. Of hands, the sixteen that were used last are kept.

    Attributes:
        robots: Robot by name or path.
        hands: Hand by all of its entry but what leaves kinematics, shapes and limits alone.
    """

    robots: dict[tuple[str, ...], RobotDescription] = field(default_factory=dict)
    hands: OrderedDict[str, Hand] = field(default_factory=OrderedDict)

    def robot(
        self, name: tuple[str, ...], read: Callable[[], RobotDescription]
    ) -> RobotDescription:
        """Return a robot, read it if it is new."""
        if name not in self.robots:
            self.robots[name] = read()
        return self.robots[name]

    def hand(self, entry: HandEntry, assemble: Callable[[], Hand]) -> Hand:
        """Return a hand at its entry's configuration, assemble it if it is new."""
        key = entry.model_dump_json(exclude=_NOT_OF_THE_HAND)
        known = self.hands.get(key)
        if known is None:
            hand = assemble()
        else:
            hand = replace(known, positions=joint_positions(known.tree, entry.q))
        self.hands[key] = hand
        self.hands.move_to_end(key)
        while len(self.hands) > _MOST_HANDS:
            self.hands.popitem(last=False)
        return hand
