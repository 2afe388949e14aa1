"""Postures in which the fingers of a hand oppose each other, and their open postures."""

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
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.geometry.poses import unit_vector
from graspless_pin.geometry.posing.finger_joints import (
    chosen_fingers,
    driving_columns,
    flexion_rates,
    groups_of_fingers,
    search_ranges,
    tip_shapes,
)
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Record

_MOST_ROUNDS = 3  # most tries over the count of postures, while fewer than a fourth are good
_GOOD_FRACTION = 4
_START_WEIGHT = 0.01  # m of tip error per half-range from the start
_OVERLAP_WEIGHT = 3.0  # weight of overlapping tips over that of separate ones
_MOST_EVALUATIONS = 40
_INSIDE = 1e-6  # of a joint's range
_SLOWEST = 0.05  # of the quickest joint's rate
_SAME_PLACE = 1e-9  # m
_AJAR = 0.4  # share of the way to the open ends at which fingers should not overlap
_OVERLAP = 1e-3  # m: tolerated overlap, since collision shapes may be too wide
_BESIDE_COSINE = 0.5  # cosine between closing directions above which fingers are side by side
_NEARLY_CLOSED = 0.05  # share of the way to the open ends


@dataclass(frozen=True, eq=False)
class OpposingPosture(Record):
    """A posture in which fingertips are as near each other as possible, and its open posture.

    Points are in the world frame, for the hand's current bases. Vectors (a,) are of the
    independent joints.

    Attributes:
        closed: (a,) positions in which the tips meet, or one tip and the palm, rad or m.
        opened: (a,) positions with the joints that flex the fingers at their open ends.
        palm: (3,) mean position of the first joints of the fingers that meet, m.
        meeting: (3,) mean position of their tips at ``closed``, m.
        closing: (3,) unit vector along which most of them close, of either sign.
        opposition: Smallest cosine between the closing directions of two tips; -1: head on.
        overlap: Largest overlap of the hand with itself with the fingers partly open, m.
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
        """(3,) unit vector from the palm to the meeting point: the approach direction."""
        return unit_vector(self.meeting - self.palm, _SAME_PLACE)

    def closing_rates(self, opened: FloatArray) -> FloatArray:
        """Return (a,) rates that lead from an open posture through the closed one.

        Args:
            opened: (a,) positions between ``closed`` and ``opened``.
        """
        travel, full_travel = self.closed - opened, self.closed - self.opened
        largest = float(np.abs(travel).max(initial=_SAME_PLACE))
        is_slow = (full_travel != 0.0) & (np.abs(travel) < _SLOWEST * largest)
        return np.where(is_slow, np.copysign(_SLOWEST, full_travel), travel / largest)


def fingers_that_close(hand: Hand, fingers: Sequence[str] | None) -> tuple[str, ...]:
    """Return the fingers, of the named ones or all, with a movable joint and a collision shape.

    Raises:
        ArgumentError: If the hand has no fingers, a finger is unknown, or none of them has both.
    """
    names = chosen_fingers(hand, fingers)
    if not names:
        raise ArgumentError("fingers", "is empty; name at least one, or leave it out for all")
    driven = tuple(name for name in names if driving_columns(hand, name) and tip_shapes(hand, name))
    if not driven:
        raise ArgumentError(
            "fingers", f"none of {', '.join(names)} has both a joint and a collision shape"
        )
    tree = hand.tree
    drivers = {name: [tree.leader_names[k] for k in driving_columns(hand, name)] for name in driven}
    movable = tuple(name for name in driven if not tree.locked.issuperset(drivers[name]))
    if not movable:
        fixed = ", ".join(dict.fromkeys(joint for name in driven for joint in drivers[name]))
        raise ArgumentError(
            "fingers",
            f"none of {', '.join(driven)} moves: the lower and the upper limit of {fixed} are the "
            "same; correct <limit lower upper> in the robot's file",
        )
    return movable


def opposing_postures(
    hand: Hand, fingers: tuple[str, ...], count: int, rng: np.random.Generator
) -> tuple[OpposingPosture, ...]:
    """Find postures in which fingertips meet, in which a hand is meant to hold objects.

    Some of the fingers are chosen at random, and their tips are brought as near to their mean
    position as possible without overlap, from random joint positions. The other fingers are fully
    flexed, with their other joints near zero. Joints that move none of the fingers do not move. A
    single finger closes on the link that carries it, like a jaw on a fixed one.

    Args:
        hand: The hand.
        fingers: Fingers with joints and shapes: see `fingers_that_close`.
        count: Number of postures to try; up to three times as many if few are good.
        rng: Random generator of fingers and starts.

    Returns:
        The postures in which the fingers do not overlap and oppose each other, the most opposed
        first; only the best one if there are none.
    """
    start = hand.tree.coupling.independent(hand.positions)
    lower, upper = search_ranges(hand.tree, start, np.pi)
    first, *others = fingers
    carrier = () if others or not is_fixed_jaw(hand, first) else carrier_links(hand, first)
    if carrier:
        return (_fixed_jaw_posture(hand, first, carrier, (lower, upper)),)
    postures, good = [], []
    for tried in range(_MOST_ROUNDS * count):
        if tried >= count and len(good) >= count // _GOOD_FRACTION:
            break
        size = int(rng.integers(min(2, len(fingers)), len(fingers) + 1))
        chosen = rng.permutation(len(fingers))[:size].tolist()
        members = tuple([fingers[index] for index in sorted(chosen)])
        posture = _meeting_posture(hand, fingers, members, (lower, upper), rng)
        postures.append(posture)
        good += (
            [posture] if posture.overlap <= _OVERLAP and posture.opposition < _BESIDE_COSINE else []
        )
    postures, good = (
        sorted(
            group, key=lambda posture: (max(posture.overlap - _OVERLAP, 0.0), posture.opposition)
        )
        for group in (postures, good)
    )
    return tuple(good or postures[:1])


def carrier_of(hand: Hand, finger: str) -> int:
    """Return the Pinocchio index of the joint that carries a finger's base body, 0: the base."""
    tree = hand.tree
    first = min(tree.joint_index[joint] for joint in hand.fingers[finger].joints)
    return int(tree.pinocchio_model.parents[1 + first])


def carrier_links(hand: Hand, finger: str) -> tuple[str, ...]:
    """Return the links with shapes of the body that carries a finger, such as a fixed jaw."""
    tree, carrier = hand.tree, carrier_of(hand, finger)
    mount = tree.mount_of[hand.fingers[finger].joints[0]]
    carried = [item.link for item in tree.geometries if item.joint == carrier]
    own_links = [link for link in carried if tree.mount_of[link] == mount]
    return tuple(dict.fromkeys(own_links))


def is_fixed_jaw(hand: Hand, finger: str) -> bool:
    """Return whether a palm carries a finger; a single finger then closes on that palm."""
    return any(hand.tree.link_joints[palm] == carrier_of(hand, finger) for palm in hand.palms)


class _FingertipCenters:
    """Centres of fingertips at any posture."""

    def __init__(self, hand: Hand, fingers: Sequence[str]) -> None:
        self._tree = hand.tree
        shapes = [tip_shapes(hand, name) for name in fingers]
        counts = [len(own) for own in shapes]
        flat = [item for own in shapes for item in own]
        self._joints = [item.joint for item in flat]
        self._own_centers = np.array(
            [item.T_joint_geometry @ [*bounded_set(item).center, 1.0] for item in flat]
        )
        self._shares = np.repeat(np.eye(len(fingers)) / counts, counts, axis=1)
        self._first_joints = [
            1 + min(hand.tree.joint_index[joint] for joint in hand.fingers[name].joints)
            for name in fingers
        ]
        thickness = [max(bounded_set(item).half_extents.min() for item in own) for own in shapes]
        self._pairs = np.triu_indices(len(fingers), 1)
        self._least_gaps = np.array(thickness)[np.array(self._pairs)].sum(axis=0)

    def centers_at(self, independent: FloatArray) -> FloatArray:
        """Return the (F, 3) centres of the fingertips, m."""
        return self._centers(self._kinematics(independent))

    def palm(self, independent: FloatArray) -> FloatArray:
        """Return the (3,) mean position of the fingers' first joints, m."""
        return self._kinematics(independent).T_world_joint[self._first_joints, :3, 3].mean(axis=0)

    def meeting_residuals(self, independent: FloatArray) -> FloatArray:
        """Return the tips' offsets from their mean position, and their weighted overlaps, m."""
        points = self.centers_at(independent)
        gaps = np.linalg.norm(points[self._pairs[0]] - points[self._pairs[1]], axis=1)
        overlaps = _OVERLAP_WEIGHT * np.maximum(self._least_gaps - gaps, 0.0)
        return np.concatenate([(points - points.mean(axis=0)).ravel(), overlaps])

    def meeting_rates(self, independent: FloatArray) -> FloatArray:
        """Return the derivatives of `meeting_residuals` by the (a,) positions."""
        kinematics = self._kinematics(independent)
        points, ends = self._centers(kinematics), self._shape_centers(kinematics)
        rates = self._tree.point_jacobians(kinematics.J, self._joints, ends)
        rates = np.tensordot(self._shares, rates @ self._tree.coupling.S, axes=1)
        apart, apart_rates = (
            item[self._pairs[0]] - item[self._pairs[1]] for item in (points, rates)
        )
        gaps = np.linalg.norm(apart, axis=1)
        ways = apart * np.where(gaps < self._least_gaps, -_OVERLAP_WEIGHT, 0.0)[:, None]
        ways /= np.maximum(gaps, _SAME_PLACE)[:, None]
        offsets = (rates - rates.mean(axis=0)).reshape(points.size, -1)
        return np.concatenate([offsets, (ways[:, None] @ apart_rates)[:, 0]])

    def _centers(self, kinematics: Kinematics) -> FloatArray:
        return self._shares @ self._shape_centers(kinematics)

    def _shape_centers(self, kinematics: Kinematics) -> FloatArray:
        poses = kinematics.T_world_joint[self._joints, :3]
        return (poses @ self._own_centers[:, :, None])[:, :, 0]

    def _kinematics(self, independent: FloatArray) -> Kinematics:
        return self._tree.kinematics(self._tree.coupling.all_positions(independent))


def _meeting_posture(
    hand: Hand,
    fingers: tuple[str, ...],
    members: tuple[str, ...],
    ends: tuple[FloatArray, FloatArray],
    rng: np.random.Generator,
) -> OpposingPosture:
    """Return a posture in which the tips of given fingers meet."""
    tips = _FingertipCenters(hand, members)
    closed = _meeting_positions(hand, fingers, members, tips, ends, rng)
    palm, meeting = tips.palm(closed), tips.centers_at(closed).mean(axis=0)
    opened = closed.copy()
    for group in groups_of_fingers(hand, fingers):
        straight, flexed = _flexion_ends(hand, group, closed, ends, (palm, meeting))
        columns = np.flatnonzero(straight != flexed)
        opened[columns] = straight[columns]
        if not set(group) & set(members):
            closed[columns] = flexed[columns]
    half_open = hand.with_configuration(closed + _AJAR * (opened - closed))
    directions = tips.centers_at(closed) - tips.centers_at(
        closed + _NEARLY_CLOSED * (opened - closed)
    )
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), _SAME_PLACE)
    overlap = max((pair.depth for pair in unwanted_overlaps(half_open)), default=0.0)
    closing = np.linalg.svd(directions)[2][0]
    opposition = float((directions @ directions.T).min())
    return OpposingPosture(closed, opened, palm, meeting, closing, opposition, overlap)


def _fixed_jaw_posture(
    hand: Hand, finger: str, jaw_links: Sequence[str], ends: tuple[FloatArray, FloatArray]
) -> OpposingPosture:
    """Return the posture in which the far end of a finger is nearest to its carrier."""
    palm_of = _FingertipCenters(hand, [finger]).palm
    ends_of_joints = [hand.tree.coupling.independent(hand.positions) for _ in range(2)]
    for column, rate in flexion_rates(hand, finger).items():
        for sense, positions in zip((1.0, -1.0), ends_of_joints, strict=True):
            positions[column] = ends[int(sense * rate > 0.0)][column]
    tip_links = {item.link for item in tip_shapes(hand, finger)}

    def far_end(positions: FloatArray) -> tuple[FloatArray, Separation]:
        """Return the tip's point farthest from the first joint, and its separation from the jaw."""
        bodies = hand.with_configuration(positions).placed_bodies
        surfaces = [
            shape_of(body.geometry).surface().moved(body.T_world_geometry)
            for body in bodies
            if body.name in tip_links
        ]
        corners = np.vstack([surface.vertices for surface in surfaces])
        tip = corners[np.argmax(np.linalg.norm(corners - palm_of(positions), axis=1))]
        return tip, nearest_separation(
            [point_body(tip)], [body for body in bodies if body.name in jaw_links]
        )

    closed, opened = sorted(ends_of_joints, key=lambda positions: far_end(positions)[1].distance)
    half_open = closed + _AJAR * (opened - closed)
    tip, to_jaw = far_end(half_open)
    direction = unit_vector(far_end(closed)[0] - tip, _SAME_PLACE)
    overlap = max(
        (pair.depth for pair in unwanted_overlaps(hand.with_configuration(half_open))), default=0.0
    )
    return OpposingPosture(
        closed=closed,
        opened=opened,
        palm=palm_of(closed),
        meeting=tip + 0.5 * to_jaw.distance * to_jaw.normal,
        closing=unit_vector(direction + to_jaw.normal, _SAME_PLACE),
        opposition=-float(direction @ to_jaw.normal),
        overlap=overlap,
    )


def _meeting_positions(
    hand: Hand,
    fingers: Sequence[str],
    members: Sequence[str],
    tips: _FingertipCenters,
    ends: tuple[FloatArray, FloatArray],
    rng: np.random.Generator,
) -> FloatArray:
    """Return (a,) positions in which the tips of given fingers are near each other."""
    lower, upper = ends
    closed = hand.tree.coupling.independent(hand.positions)
    for finger in fingers:
        columns = driving_columns(hand, finger)
        closed[columns] = np.clip(0.0, lower[columns], upper[columns])
    moving = sorted({column for name in members for column in driving_columns(hand, name)})
    moving = [column for column in moving if upper[column] > lower[column]]
    if not moving:
        return closed
    half = 0.5 * (upper - lower)[moving]
    drawn = rng.uniform(lower[moving] + _INSIDE * half, upper[moving] - _INSIDE * half)
    straight = np.clip(
        closed[moving], lower[moving] + _INSIDE * half, upper[moving] - _INSIDE * half
    )
    start = straight + rng.random() * (drawn - straight)  # fingers far from straight may cross

    def at(values: FloatArray) -> FloatArray:
        positions = closed.copy()
        positions[moving] = values
        return positions

    def residuals(values: FloatArray) -> FloatArray:
        back = _START_WEIGHT * (values - start) / half
        return np.concatenate([tips.meeting_residuals(at(values)), back])

    def rates(values: FloatArray) -> FloatArray:
        back = np.diag(_START_WEIGHT / half)
        return np.concatenate([tips.meeting_rates(at(values))[:, moving], back])

    closed[moving] = least_squares(
        residuals,
        start,
        jac=rates,  # pyright: ignore[reportArgumentType] - a function will do
        bounds=(lower[moving], upper[moving]),
        max_nfev=_MOST_EVALUATIONS,
    ).x
    return closed


def _flexion_ends(
    hand: Hand,
    group: Sequence[str],
    closed: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    line: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return (a,) positions with the fingers' flexion at the end far from a line, and at the other.

    Args:
        hand: The hand.
        group: Fingers that move together.
        closed: (a,) positions of all joints that do not flex them.
        ends: (a,) lower and upper limits.
        line: Two points of the line, from the palm to the meeting point.
    """
    flexion: dict[int, float] = {}
    for finger in group:
        flexion = flexion_rates(hand.with_configuration(closed), finger) | flexion
    tips, axis = _FingertipCenters(hand, group), unit_vector(line[1] - line[0], _SAME_PLACE)
    choices = []
    for sense in (1.0, -1.0):
        positions = closed.copy()
        for column, rate in flexion.items():
            positions[column] = ends[int(sense * rate > 0.0)][column]
        offsets = tips.centers_at(positions) - line[0]
        offsets_across = offsets - np.outer(offsets @ axis, axis)
        choices.append((float(np.linalg.norm(offsets_across, axis=1).sum()), positions))
    flexed, straight = sorted(choices, key=lambda choice: choice[0])
    return straight[1], flexed[1]
