"""Closing fingers on an object until they touch it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from graspless_pin.brief import Brief
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.contact.distances import LinkDistances
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import unknown_name
from graspless_pin.geometry.posing.finger_joints import (
    chosen_fingers,
    driving_columns,
    groups_of_fingers,
    hand_at,
)
from graspless_pin.geometry.posing.marching import March


@dataclass(frozen=True)
class FingerClosing:
    """How one finger ended.

    Attributes:
        finger: Its name.
        touching: Links that touch the object, in model order.
        at_limit: Joints that closed until their limit.
        distance: From the nearest of its links to the object, m; infinite if it has no shape.
    """

    finger: str
    touching: tuple[str, ...]
    at_limit: tuple[str, ...]
    distance: float


@dataclass(frozen=True, eq=False, repr=False)
class ClosingResult(Brief):
    """A hand whose fingers have been closed. See the example of `close_hand`.

    Attributes:
        hand: The hand at its new configuration.
        fingers: What became of each finger that was closed, in the order they were named.
    """

    hand: Hand
    fingers: tuple[FingerClosing, ...]

    @property
    def touching(self) -> tuple[str, ...]:
        """All links of the closed fingers that touch the object."""
        return tuple(link for finger in self.fingers for link in finger.touching)

    @property
    def all_touch(self) -> bool:
        """Whether every closed finger touches the object."""
        return all(finger.touching for finger in self.fingers)

    def __str__(self) -> str:
        """One line a finger."""
        lines = []
        for finger in self.fingers:
            if finger.touching:
                line = f"{finger.finger}: touches with {', '.join(finger.touching)}"
            else:
                line = f"{finger.finger}: touches nothing, {finger.distance * 1e3:.1f} mm away"
            if finger.at_limit:
                line += f"; at their limit: {', '.join(finger.at_limit)}"
            lines.append(line)
        return "\n".join(lines)


def close_hand(
    hand: Hand,
    target: ManipulatedObject,
    *,
    fingers: Sequence[str] | None = None,
    wrap: bool = False,
    rates: Mapping[str, float] | None = None,
    gap: float = 1e-5,
) -> ClosingResult:
    """Close fingers on an object at rest until they touch it or reach their limits.

    A finger closes with its last joint and the joints about parallel to it, at equal rates, in the
    sense that brings its links nearer to the object; spread and opposition stay as they are. Each
    finger closes by itself; fingers that share a motor close together. Supports and other fingers
    do not stop a finger: ask `unwanted_overlaps` afterwards.

    Args:
        hand: The hand, with its fingers open.
        target: The object.
        fingers: Fingers to close; None closes all.
        wrap: False stops a finger at the first touch. True stops only the joints that move the
            touching link and goes on with those beyond it.
        rates: Rate by joint, relative to 1 for the others, rad or m: the sign is the direction,
            zero holds the joint. It replaces the rule above for the joints that it names.
        gap: Largest distance that counts as touching, m. Fingers stop between zero and this.

    Returns:
        The hand with closed fingers, and what touched and what stopped at a limit.

    Raises:
        ArgumentError: If a finger or joint is unknown, or a number out of range.
        SceneError: If a finger overlaps the object by more than `marching.DEEPEST_START` before it
            closes.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.geometry import close_hand
        >>> scene = load_scene("examples/allegro_box_on_slope.yaml")
        >>> print(close_hand(scene.hand, scene.object, fingers=["index"]))
        index: touches with link_3.0_tip
    """
    names = chosen_fingers(hand, fingers)
    if not (math.isfinite(gap) and gap > 0.0):
        raise ArgumentError("gap", f"needs a positive length in metres, got {gap!r}")
    given = _given_rates(hand, names, rates or {})
    at_limit: set[int] = set()
    independent = hand.positions[list(hand.tree.coupling.leaders)].copy()
    for group in groups_of_fingers(hand, names):
        march = March(hand, target, group, gap)
        march.refuse_overlap(independent)
        independent, stopped = march.close(independent, march.rates(independent, given), wrap=wrap)
        at_limit |= stopped
    closed = hand_at(hand, independent)
    return ClosingResult(
        closed, tuple(_report(closed, target, name, at_limit, gap) for name in names)
    )


def _given_rates(
    hand: Hand, fingers: Sequence[str], rates: Mapping[str, float]
) -> dict[int, float]:
    """Return the given rates by column, checked."""
    leaders = [hand.joint_names[index] for index in hand.tree.coupling.leaders]
    columns = sorted({column for finger in fingers for column in driving_columns(hand, finger)})
    known = [leaders[column] for column in columns]
    given: dict[int, float] = {}
    for name, rate in rates.items():
        if name not in known:
            raise unknown_name("rates", "joint of the closing fingers", name, known)
        if not np.isfinite(rate):
            raise ArgumentError(f"rates[{name!r}]", f"needs a finite number, got {rate!r}")
        given[leaders.index(name)] = float(rate)
    return given


def _report(
    hand: Hand, target: ManipulatedObject, finger: str, at_limit: set[int], gap: float
) -> FingerClosing:
    """Measure where a finger ended."""
    probe = LinkDistances(hand, hand.fingers[finger].links, target.collision_bodies())
    distances = probe.at(hand.positions)
    leaders = hand.tree.coupling.leaders
    return FingerClosing(
        finger=finger,
        touching=tuple(
            dict.fromkeys(
                link
                for link, distance in zip(probe.links, distances, strict=True)
                if distance <= gap
            )
        ),
        at_limit=tuple(
            hand.joint_names[leaders[column]]
            for column in driving_columns(hand, finger)
            if column in at_limit
        ),
        distance=float(distances.min()) if len(distances) else math.inf,
    )
