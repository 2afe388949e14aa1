"""Closing fingers on an object until they touch it.

The way of a finger to the object: which way it closes, how far it may step, where it stops.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.contact.distances import (
    LinkDistances,
    bounded_set,
    nearest_separation,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import rigid
from graspless_pin.geometry.posing.finger_joints import (
    chosen_fingers,
    driving_columns,
    flexion_rates,
    groups_of_fingers,
    hand_at,
    searched_ranges,
)
from graspless_pin.geometry.posing.overlaps import Clearance, lesser_clearance
from graspless_pin.problem.checks import FloatArray, check_known, real_number, truth_values
from graspless_pin.records import Brief

DEEPEST_START = 1e-3
"""Overlap up to which a finger counts as touching before it closes, m."""

_SHORTEST_MARCH = 1e-4  # m that a link moves at least per step: what a step may jump over
_SAMPLED_POSTURES = 12  # postures tried in each sense to find out which one closes
_UNLIMITED = 2.0 * math.pi  # rad or m that a joint without limits may go: once around
_SMALLEST_STEP = 1e-12


class March:
    """One group of fingers on its way to the object.

    Vectors (a,) are positions or rates of the independent joints.
    """

    def __init__(
        self, hand: Hand, target: ManipulatedObject, fingers: Sequence[str], gap: float
    ) -> None:
        """Prepare a group of fingers that share joints, or one finger."""
        self._hand = hand
        self._target = target
        self._fingers = fingers
        self._gap = gap
        tree = hand.tree
        self._coupling = tree.coupling
        start = tree.coupling.independent(hand.positions)
        self._lower, self._upper = searched_ranges(tree, start, _UNLIMITED)
        links = {link for finger in fingers for link in hand.fingers[finger].links}
        self._distances = LinkDistances(hand, links, target.placed_bodies)
        self._reach = _reaches(self._distances, hand)

    def refuse_overlap(self, independent: FloatArray) -> None:
        """Raise SceneError if a finger is in the object before it closes."""
        distances = self._at(independent)
        worst = int(np.argmin(distances)) if len(distances) else -1
        if worst >= 0 and distances[worst] < -DEEPEST_START:
            raise SceneError(
                f"hand link '{self._distances.links[worst]}' overlaps object "
                f"'{self._target.name}' by {-distances[worst] * 1e3:.2f} mm before closing; open "
                "the finger or move the hand"
            )

    def rates(self, independent: FloatArray, given: Mapping[int, float]) -> FloatArray:
        """Return the closing rates: the given ones, flexion towards the object for the others."""
        flexion: dict[int, float] = {}
        fixed: dict[int, float] = {}
        for finger in self._fingers:
            flexion = flexion_rates(self._hand, finger) | flexion
            columns = driving_columns(self._hand, finger)
            fixed |= {column: rate for column, rate in given.items() if column in columns}
        senses = []
        for sense in (1.0, -1.0):
            rates = np.zeros(len(independent))
            for column, rate in (flexion | fixed).items():
                rates[column] = fixed.get(column, sense * rate)
            senses.append(rates)
        paths = [self._longest_path(independent, rates) for rates in senses]
        misses = [self._miss(independent, r, s) for r, s in zip(senses, paths, strict=True)]
        if abs(misses[0] - misses[1]) > self._gap:
            return senses[int(np.argmin(misses))]
        return senses[int(np.argmax(paths))]

    def close(
        self, independent: FloatArray, rates: FloatArray, *, wrap: bool
    ) -> tuple[FloatArray, set[int]]:
        """March until all joints have stopped.

        Returns:
            Where the joints stopped, and the columns of those that stopped at their limits.
        """
        rates = rates.copy()
        at_limit: set[int] = set()
        while True:
            remaining = self._remaining(independent, rates)
            ended = remaining <= _SMALLEST_STEP
            if ended.any():
                ends = np.where(rates > 0.0, self._upper, self._lower)
                independent = np.where(ended, ends, independent)
                at_limit.update(np.flatnonzero(ended).tolist())
                rates[ended] = 0.0
                continue
            speeds = self._reach @ np.abs(self._coupling.S @ rates)
            moving = speeds > 0.0
            if not moving.any():
                return independent, at_limit
            distances = self._at(independent)
            touching = moving & (distances <= self._gap)
            if touching.any():
                if not wrap:
                    return independent, at_limit
                rates[self._columns_moving(touching)] = 0.0
                continue
            # No link moves faster than its speed bound, so that none can jump over the object.
            step = max(
                float(np.min(distances[moving] / speeds[moving])),
                _SHORTEST_MARCH / float(speeds.max()),
            )
            step = min(step, float(np.min(remaining)))
            independent = self._advance(independent, rates, step, moving)

    def _advance(
        self, independent: FloatArray, rates: FloatArray, step: float, moving: NDArray[np.bool_]
    ) -> FloatArray:
        """Go a step, or as much of it as keeps the moving links out of the object."""
        there = self._gone(independent, rates, step)
        if np.min(self._at(there)[moving]) >= 0.0:
            return there
        free, blocked = 0.0, step
        while blocked - free > _SMALLEST_STEP:
            middle = 0.5 * (free + blocked)
            there = self._gone(independent, rates, middle)
            nearest = float(np.min(self._at(there)[moving]))
            if 0.0 <= nearest <= self._gap:
                return there
            free, blocked = (middle, blocked) if nearest > 0.0 else (free, middle)
        return self._gone(independent, rates, blocked)

    def _gone(self, independent: FloatArray, rates: FloatArray, step: float) -> FloatArray:
        """Return the positions after a step; joints at rest stay exactly where they are."""
        return np.where(
            rates == 0.0, independent, np.clip(independent + step * rates, self._lower, self._upper)
        )

    def _remaining(self, independent: FloatArray, rates: FloatArray) -> FloatArray:
        """Path until each joint's limit, (a,), infinite for joints at rest."""
        ends = np.where(rates > 0.0, self._upper, self._lower)
        path = np.full(len(rates), np.inf)
        turning = rates != 0.0
        path[turning] = (ends[turning] - independent[turning]) / rates[turning]
        return path

    def _longest_path(self, independent: FloatArray, rates: FloatArray) -> float:
        """Path until the last joint reaches its limit."""
        remaining = self._remaining(independent, rates)
        return max(float(np.max(remaining, initial=0.0, where=np.isfinite(remaining))), 0.0)

    def _miss(self, independent: FloatArray, rates: FloatArray, path: float) -> float:
        """Sum of how close each link comes to the object on its way, m."""
        postures = [
            self._gone(independent, rates, s) for s in np.linspace(0.0, path, _SAMPLED_POSTURES)
        ]
        nearest = np.min([self._at(posture) for posture in postures], axis=0)
        return float(np.maximum(nearest, 0.0).sum())

    def _columns_moving(self, shapes: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which independent joints move any of the shapes, (a,)."""
        joints = (self._reach[shapes] > 0.0).any(axis=0)
        return (self._coupling.S[joints] != 0.0).any(axis=0)

    def _at(self, independent: FloatArray) -> FloatArray:
        return self._distances.at(self._coupling.all_positions(independent))


def _reaches(distances: LinkDistances, hand: Hand) -> FloatArray:
    """Return (K, n) the largest speed of any point of shape k at unit rate of joint i.

    That is the length of the chain from the joint to the far side of the shape, whatever the
    posture, and 1 for a prismatic joint.
    """
    model = hand.tree.pinocchio_model
    reach = np.zeros((len(distances.shapes), len(hand.joint_names)))
    for row, item in zip(reach, distances.shapes, strict=True):
        solid = bounded_set(item)
        center = item.T_joint_geometry @ [*solid.center, 1.0]
        length = float(np.linalg.norm(center[:3])) + solid.radius
        joint = item.joint
        while joint > 0:
            slide = _longest_slide(hand, joint - 1)
            row[joint - 1] = length if slide is None else 1.0
            length += float(np.linalg.norm(model.jointPlacements[joint].translation)) + (slide or 0)
            joint = int(model.parents[joint])
    return reach


def _longest_slide(hand: Hand, joint: int) -> float | None:
    """Return how far a prismatic joint goes, m; None for a revolute one."""
    if hand.tree.joint_kinds[joint] != "prismatic":
        return None
    ends = np.abs([hand.tree.lower[joint], hand.tree.upper[joint]])
    return float(ends.max()) if np.isfinite(ends).all() else _UNLIMITED


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
        SceneError: If a finger overlaps the object by more than `DEEPEST_START` before it
            closes.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.geometry import close_hand
        >>> scene = load_scene("examples/allegro_box_on_slope.yaml")
        >>> print(close_hand(scene.hand, scene.object, fingers=["index"]))
        index: touches with link_3.0_tip
    """
    truth_values(wrap=wrap)
    names = chosen_fingers(hand, fingers)
    if not real_number("gap", gap, 0.0):
        raise ArgumentError("gap", f"needs a positive length in metres, got {gap!r}")
    given = _given_rates(hand, names, rates or {})
    at_limit: set[int] = set()
    independent = hand.tree.coupling.independent(hand.positions)
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
    leaders = hand.tree.leader_names
    columns = sorted({column for finger in fingers for column in driving_columns(hand, finger)})
    known = [leaders[column] for column in columns]
    check_known("rates", "joint of the closing fingers", rates, known)
    return {
        leaders.index(name): real_number(f"rates[{name!r}]", rate, -np.inf)
        for name, rate in rates.items()
    }


def _report(
    hand: Hand, target: ManipulatedObject, finger: str, at_limit: set[int], gap: float
) -> FingerClosing:
    """Measure where a finger ended."""
    probe = LinkDistances(hand, hand.fingers[finger].links, target.placed_bodies)
    distances = probe.at(hand.positions)
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
            hand.tree.leader_names[column]
            for column in driving_columns(hand, finger)
            if column in at_limit
        ),
        distance=float(distances.min()) if len(distances) else math.inf,
    )


_LEAST_STEP = 5e-4  # m
_OPPOSITE_COSINE = -0.3  # cosine between the ways of two fingers to the object


def shortfall(bodies: PlacedBodies, others: PlacedBodies, clearance: float) -> float:
    """Return by how much bodies miss a clearance from others, zero if they keep it, m."""
    return clearance - lesser_clearance(bodies, others, Clearance(clearance, ())).distance


def moved_bodies(bodies: PlacedBodies, T: FloatArray) -> PlacedBodies:
    """Return bodies moved by a (4, 4) pose, world axes."""
    return PlacedBodies(bodies.shapes, T @ bodies.poses)


def back_until_free(
    bodies: PlacedBodies,
    obstacles: Sequence[tuple[PlacedBodies, float]],
    direction: FloatArray,
    farthest: float,
) -> tuple[float | None, int]:
    """Return how far bodies go back until they keep clear of all obstacles.

    Each step is as long as the deepest overlap: nowhere nearer are they free.

    Args:
        bodies: What moves.
        obstacles: Bodies, and the clearance from each, m.
        direction: (3,) unit vector of the approach, world axes; bodies go against it.
        farthest: How far they may go, m.

    Returns:
        How far they go, m, or None if that is not enough; and the obstacle that was last in the
        way, -1 without one.
    """
    back, last = 0.0, -1
    while back <= farthest:
        there = moved_bodies(bodies, rigid(-back * direction))
        missing = [shortfall(there, others, clearance) for others, clearance in obstacles]
        worst = int(np.argmax(missing))
        if missing[worst] == 0.0:
            return back, last
        back, last = back + max(missing[worst], _LEAST_STEP), worst
    return None, last


def centering_shift(
    hand: Hand, jaws: Sequence[Sequence[str]], target: PlacedBodies
) -> FloatArray | None:
    """Return how to shift a hand whose jaws close together so that two are equally near.

    These are the nearest jaw and the nearest of those opposite to it. A gripper with one motor
    touches an object that is off its middle on one side only.

    Args:
        hand: The hand.
        jaws: Links of each finger that one motor moves, or of one finger and of a fixed jaw.
        target: The object's pieces.

    Returns:
        (3,) m, world axes; None: no jaw is opposite.
    """
    bodies = hand.placed_bodies
    own = [[one for one in bodies if one.name in links] for links in jaws]
    reached = [nearest_separation(pieces, target) for pieces in own if pieces]
    first = min(reached, key=lambda one: one.distance)
    opposite = [one for one in reached if float(one.normal @ first.normal) < _OPPOSITE_COSINE]
    if not opposite:
        return None
    second = min(opposite, key=lambda one: one.distance)
    apart = first.normal - second.normal
    return (first.distance - second.distance) * apart / float(apart @ apart)
