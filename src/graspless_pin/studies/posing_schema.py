"""What a study file says of the hand of each sample: placed at the object, or closed on it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from graspless_pin.holding.verdict import BRIEF_NODE_LIMIT
from graspless_pin.intake.fields import ByName, Count, Entry, Few, Finite, Name, NotNegative, Whole
from graspless_pin.scene.body_schema import Direction, Vector


def listed(value: Any) -> Any:
    """Let one name stand for a list of one."""
    return [value] if isinstance(value, str) else value


Fingers = Annotated[
    Few[Name] | None,
    BeforeValidator(listed),
    Field(description="that close; default: all"),
]


class PlaceEntry(Entry):
    """How the hand is placed, as `place_hand` does it, and which of its places is computed."""

    rank: Count = Field(default=1, description="of the place that is computed; 1: the best")
    seed: Whole = Field(default=0, description="of all random choices")
    candidates: Count = Field(default=600, description="how many are tried")
    approach: Direction | None = Field(
        default=None, description="[1] direction of the palm, world axes; default: all"
    )
    point: Vector | None = Field(
        default=None, description="[m] that it goes for, world; default: all in the object"
    )
    fingers: Fingers = None
    margin: NotNegative | None = Field(
        default=None, description="[N] smallest margin of a place; default: the scene's, or 0.1"
    )
    aim: Literal["grip", "carry", "press"] = Field(
        default="grip", description="what places are good for"
    )
    together: bool = Field(default=False, description="whether several mounts move as one body")
    move_base: bool = Field(default=False, description="whether the bases of arms move")
    verdict_nodes: Whole = Field(
        default=BRIEF_NODE_LIMIT,
        description="sets of outcomes that each verdict may look at; 0: no verdicts",
    )
    verdicts: Whole | None = Field(
        default=5, description="how many of the best are asked for theirs; null: all"
    )


class CloseEntry(Entry):
    """How fingers close until they touch, from the configuration of the sample's scene."""

    fingers: Fingers = None
    wrap: bool = Field(default=False, description="whether joints beyond a link that touches go on")
    rates: ByName[Finite] = Field(
        default={}, description="[1] by joint, relative to 1 for the others; its sign is the way"
    )


class PosingEntry(Entry):
    """Where the hand of each sample goes before it is computed."""

    place: PlaceEntry | None = Field(
        default=None, description="the hand is placed at the object of each sample"
    )
    close: CloseEntry | None = Field(
        default=None, description="the fingers are closed in each sample"
    )

    @model_validator(mode="after")
    def _one_of_them(self) -> PosingEntry:
        if self.place is not None and self.close is not None:
            raise ValueError("found place and close; placing closes the fingers, leave out 'close'")
        return self
