"""Postures in which the fingers of a hand oppose each other, and how they open from there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.shapes import shape_of
from graspless_pin.geometry.contact.distances import (
    Separation,
    bounded_set,
    nearest_separation,
    point_body,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import unit_vector
from graspless_pin.geometry.posing.finger_joints import (
    chosen_fingers,
    driving_columns,
    flexion_rates,
    groups_of_fingers,
    searched_ranges,
    tip_shapes,
)
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Record

_MOST_ROUNDS = 3  # times the count of postures, while fewer than a fourth of it are good
_GOOD_FRACTION = 4
_START_WEIGHT = 0.01  # m a half-range: how far off a tip may stay for a posture near the start
_OVERLAP_WEIGHT = 3.0  # how much more tips that overlap count than tips that are apart
_MOST_EVALUATIONS = 40
_INSIDE = 1e-6  # of a joint's range
_SLOWEST = 0.05  # of the quickest joint's rate
_SAME_PLACE = 1e-9  # m
_AJAR = 0.4  # of the way to the open ends, where fingers should not be in each other
_OVERLAP = 1e-3  # m that collision shapes may be too wide
_BESIDE_COSINE = 0.5  # cosine between ways of closing, above which fingers stand beside each other
_NEARLY_CLOSED = 0.05  # of the way to the open ends


@dataclass(frozen=True, eq=False)
class OpposingPosture(Record):
    """A posture in which fingertips are as near each other as they come, and how to leave it.

    Points are in the world, with the hand's bases where they are. Vectors (a,) are of the
    independent joints.

    Attributes:
        closed: (a,) positions in which the tips meet, or one tip and the palm, rad or m.
        opened: (a,) positions with the joints that flex the fingers at their open ends.
        palm: (3,) middle of the first joints of the fingers that meet, m.
        meeting: (3,) middle of their tips at ``closed``, m.
        closing: (3,) unit vector along which most of them close, of either sense.
        opposition: Smallest cosine between the ways in which two of the tips close; -1: head on.
        overlap: Deepest overlap of the hand in itself with the fingers ajar, m.
    """

    closed: FloatArray
    opened: FloatArray
    palm: FloatArray
    meeting: FloatArray
    closing: FloatArray
    opposition: float
    overlap: float

    @property
    def axis(self) -> FloatArray:
        """(3,) unit vector from the palm to where the tips meet: the way the hand approaches."""
        return unit_vector(self.meeting - self.palm, _SAME_PLACE)

    def closing_rates(self, opened: FloatArray) -> FloatArray:
        """Return (a,) rates that lead from an opened posture through the closed one.

        Args:
            opened: (a,) positions between ``closed`` and ``opened``.
        """
        travel, full_travel = self.closed - opened, self.closed - self.opened
        quickest = float(np.abs(travel).max(initial=_SAME_PLACE))
        slow = (full_travel != 0.0) & (np.abs(travel) < _SLOWEST * quickest)
        return np.where(slow, np.copysign(_SLOWEST, full_travel), travel / quickest)


def fingers_that_close(hand: Hand, fingers: Sequence[str] | None) -> tuple[str, ...]:
    """Return those of the named fingers, or of all, that have a joint that moves and a shape.

    Raises:
        ArgumentError: If the hand has no fingers, a finger is unknown, or none of them has both.
    """
    names = chosen_fingers(hand, fingers)
    if not names:
        raise ArgumentError("fingers", "is empty; name at least one, or leave it out for all")
    able = tuple(name for name in names if driving_columns(hand, name) and tip_shapes(hand, name))
    if not able:
        raise ArgumentError(
            "fingers", f"none of {', '.join(names)} has both a joint and a collision shape"
        )
    tree = hand.tree
    drivers = {name: [tree.leader_names[k] for k in driving_columns(hand, name)] for name in able}
    moved = tuple(name for name in able if not tree.locked.issuperset(drivers[name]))
    if not moved:
        still = ", ".join(dict.fromkeys(joint for name in able for joint in drivers[name]))
        raise ArgumentError(
            "fingers",
            f"none of {', '.join(able)} moves: the lower and the upper limit of {still} are the "
            "same; correct <limit lower upper> in the robot's file",
        )
    return moved


def opposing_postures(
    hand: Hand, fingers: tuple[str, ...], count: int, rng: np.random.Generator
) -> tuple[OpposingPosture, ...]:
    """Find postures in which fingertips meet: there a hand is meant to hold things.

    Some of the fingers are chosen at random, and their tips brought as near to their middle as they
    come without overlap, from random positions of their joints. The other fingers close straight.
    Joints that do not move these fingers stay. A finger that is alone closes on the link that
    carries it, as a jaw does on a fixed one.

    Args:
        hand: The hand.
        fingers: Fingers with joints and shapes: see `fingers_that_close`.
        count: How many postures to try; three times as many where next to none is good.
        rng: Where fingers and starts are drawn from.

    Returns:
        The postures in which the fingers are clear of each other and oppose each other, those first
        that do so most; the best one if none does.
    """
    start = hand.tree.coupling.independent(hand.positions)
    lower, upper = searched_ranges(hand.tree, start, np.pi)
    first, *more = fingers
    fixed = () if more or not is_fixed_jaw(hand, first) else carrier_links(hand, first)
    if fixed:
        return (_on_fixed_jaw(hand, first, fixed, (lower, upper)),)
    found, good = [], []
    for tried in range(_MOST_ROUNDS * count):
        if tried >= count and len(good) >= count // _GOOD_FRACTION:
            break
        size = int(rng.integers(min(2, len(fingers)), len(fingers) + 1))
        chosen = rng.permutation(len(fingers))[:size].tolist()
        members = tuple([fingers[index] for index in sorted(chosen)])
        one = _posture(hand, fingers, members, (lower, upper), rng)
        found.append(one)
        good += [one] if one.overlap <= _OVERLAP and one.opposition < _BESIDE_COSINE else []
    found, good = (
        sorted(some, key=lambda one: (max(one.overlap - _OVERLAP, 0.0), one.opposition))
        for some in (found, good)
    )
    return tuple(good or found[:1])


def carrier_of(hand: Hand, finger: str) -> int:
    """Return the Pinocchio index of the joint that carries what a finger hangs on, 0: the base."""
    tree = hand.tree
    first = min(tree.joint_index[joint] for joint in hand.fingers[finger].joints)
    return int(tree.pinocchio_model.parents[1 + first])


def carrier_links(hand: Hand, finger: str) -> tuple[str, ...]:
    """Return the links with shapes of the body that a finger hangs on, such as a fixed jaw."""
    tree, carrier = hand.tree, carrier_of(hand, finger)
    mount = tree.mount_of[hand.fingers[finger].joints[0]]
    carried = [item.link for item in tree.geometries if item.joint == carrier]
    own = [link for link in carried if tree.mount_of[link] == mount]
    return tuple(dict.fromkeys(own))


def is_fixed_jaw(hand: Hand, finger: str) -> bool:
    """Return whether a finger hangs on a palm, which it closes on where it is alone."""
    return any(hand.tree.link_joints[palm] == carrier_of(hand, finger) for palm in hand.palms)


class _Tips:
    """The middles of some fingertips, at any posture."""

    def __init__(self, hand: Hand, fingers: Sequence[str]) -> None:
        self._tree = hand.tree
        self._shapes = [
            [(item, np.append(bounded_set(item).center, 1.0)) for item in tip_shapes(hand, name)]
            for name in fingers
        ]
        self._first = [
            1 + min(hand.tree.joint_index[joint] for joint in hand.fingers[name].joints)
            for name in fingers
        ]
        thickness = [
            max(bounded_set(item).half_extents.min() for item, _ in own) for own in self._shapes
        ]
        self._pairs = np.triu_indices(len(fingers), 1)
        self._least = np.array(thickness)[np.array(self._pairs)].sum(axis=0)

    def at(self, independent: FloatArray) -> FloatArray:
        """Return (F, 3) the middles, m."""
        T = self._joint_poses(independent)
        middles = [
            np.mean([T[item.joint] @ item.T_joint_geometry @ own for item, own in shapes], axis=0)
            for shapes in self._shapes
        ]
        return np.array(middles)[:, :3]

    def palm(self, independent: FloatArray) -> FloatArray:
        """Return (3,) the middle of the fingers' first joints, m."""
        return self._joint_poses(independent)[self._first, :3, 3].mean(axis=0)

    def misses(self, independent: FloatArray) -> FloatArray:
        """Return how far the tips are from their middle, and what they overlap by, m."""
        points = self.at(independent)
        gaps = np.linalg.norm(points[self._pairs[0]] - points[self._pairs[1]], axis=1)
        overlaps = _OVERLAP_WEIGHT * np.maximum(self._least - gaps, 0.0)
        return np.concatenate([(points - points.mean(axis=0)).ravel(), overlaps])

    def _joint_poses(self, independent: FloatArray) -> FloatArray:
        return self._tree.kinematics(self._tree.coupling.all_positions(independent)).T_world_joint


def _posture(
    hand: Hand,
    fingers: tuple[str, ...],
    members: tuple[str, ...],
    ends: tuple[FloatArray, FloatArray],
    rng: np.random.Generator,
) -> OpposingPosture:
    """Return a posture in which some fingers meet."""
    tips = _Tips(hand, members)
    closed = _met(hand, fingers, members, tips, ends, rng)
    palm, meeting = tips.palm(closed), tips.at(closed).mean(axis=0)
    opened = closed.copy()
    for group in groups_of_fingers(hand, fingers):
        straight, bent = _ends_of_flexion(hand, group, closed, ends, (palm, meeting))
        columns = np.flatnonzero(straight != bent)
        opened[columns] = straight[columns]
        if not set(group) & set(members):
            closed[columns] = bent[columns]
    ajar = hand.with_configuration(closed + _AJAR * (opened - closed))
    directions = tips.at(closed) - tips.at(closed + _NEARLY_CLOSED * (opened - closed))
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), _SAME_PLACE)
    overlap = max((one.depth for one in unwanted_overlaps(ajar)), default=0.0)
    closing = np.linalg.svd(directions)[2][0]
    opposition = float((directions @ directions.T).min())
    return OpposingPosture(closed, opened, palm, meeting, closing, opposition, overlap)


def _on_fixed_jaw(
    hand: Hand, finger: str, fixed: Sequence[str], ends: tuple[FloatArray, FloatArray]
) -> OpposingPosture:
    """Return the posture in which the far end of a finger is nearest to its carrier."""
    palm_of = _Tips(hand, [finger]).palm
    ends_of_joints = [hand.tree.coupling.independent(hand.positions) for _ in range(2)]
    for column, rate in flexion_rates(hand, finger).items():
        for sense, there in zip((1.0, -1.0), ends_of_joints, strict=True):
            there[column] = ends[int(sense * rate > 0.0)][column]
    shapes = {item.link for item in tip_shapes(hand, finger)}

    def far_end(there: FloatArray) -> tuple[FloatArray, Separation]:
        """Return the point of the tip that is farthest from its first joint, and its gap."""
        bodies = hand.with_configuration(there).placed_bodies
        surfaces = [
            shape_of(one.geometry).surface().moved(one.T_world_geometry)
            for one in bodies
            if one.name in shapes
        ]
        corners = np.vstack([one.vertices for one in surfaces])
        tip = corners[np.argmax(np.linalg.norm(corners - palm_of(there), axis=1))]
        return tip, nearest_separation(
            [point_body(tip)], [one for one in bodies if one.name in fixed]
        )

    closed, opened = sorted(ends_of_joints, key=lambda there: far_end(there)[1].distance)
    half = closed + _AJAR * (opened - closed)
    tip, between = far_end(half)
    direction = unit_vector(far_end(closed)[0] - tip, _SAME_PLACE)
    overlap = max(
        (one.depth for one in unwanted_overlaps(hand.with_configuration(half))), default=0.0
    )
    return OpposingPosture(
        closed=closed,
        opened=opened,
        palm=palm_of(closed),
        meeting=tip + 0.5 * between.distance * between.normal,
        closing=unit_vector(direction + between.normal, _SAME_PLACE),
        opposition=-float(direction @ between.normal),
        overlap=overlap,
    )


def _met(
    hand: Hand,
    fingers: Sequence[str],
    members: Sequence[str],
    tips: _Tips,
    ends: tuple[FloatArray, FloatArray],
    rng: np.random.Generator,
) -> FloatArray:
    """Return (a,) positions in which the tips of some fingers are near each other."""
    lower, upper = ends
    closed = hand.tree.coupling.independent(hand.positions)
    for finger in fingers:
        own = driving_columns(hand, finger)
        closed[own] = np.clip(0.0, lower[own], upper[own])
    moving = sorted({column for name in members for column in driving_columns(hand, name)})
    moving = [column for column in moving if upper[column] > lower[column]]
    if not moving:
        return closed
    half = 0.5 * (upper - lower)[moving]
    drawn = rng.uniform(lower[moving] + _INSIDE * half, upper[moving] - _INSIDE * half)
    straight = np.clip(
        closed[moving], lower[moving] + _INSIDE * half, upper[moving] - _INSIDE * half
    )
    start = straight + rng.random() * (drawn - straight)  # far from straight fingers cross

    def misses(values: FloatArray) -> FloatArray:
        there = closed.copy()
        there[moving] = values
        return np.concatenate([tips.misses(there), _START_WEIGHT * (values - start) / half])

    bounds = lower[moving], upper[moving]
    closed[moving] = least_squares(misses, start, bounds=bounds, max_nfev=_MOST_EVALUATIONS).x
    return closed


def _ends_of_flexion(
    hand: Hand,
    group: Sequence[str],
    closed: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    line: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return (a,) positions with fingers at the end that is far from a line, and at the other.

    Args:
        hand: The hand.
        group: Fingers that move together.
        closed: (a,) positions of all joints that do not flex them.
        ends: (a,) lowest and highest positions.
        line: Two points of the line, from the palm to where tips meet.
    """
    flexion: dict[int, float] = {}
    for finger in group:
        flexion = flexion_rates(hand.with_configuration(closed), finger) | flexion
    tips, axis = _Tips(hand, group), unit_vector(line[1] - line[0], _SAME_PLACE)
    choices = []
    for sense in (1.0, -1.0):
        there = closed.copy()
        for column, rate in flexion.items():
            there[column] = ends[int(sense * rate > 0.0)][column]
        offsets = tips.at(there) - line[0]
        aside = offsets - np.outer(offsets @ axis, axis)
        choices.append((float(np.linalg.norm(aside, axis=1).sum()), there))
    bent, straight = sorted(choices, key=lambda one: one[0])
    return straight[1], bent[1]
