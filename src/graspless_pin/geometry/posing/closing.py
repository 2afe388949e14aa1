"""Closing fingers on an object until they touch it.

For each finger: the closing direction of its joints, the step sizes, and where it stops.
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
    hand_at_positions,
    search_ranges,
)
from graspless_pin.geometry.posing.overlaps import Clearance, smaller_clearance
from graspless_pin.problem.checks import FloatArray, check_known, real_number, truth_values
from graspless_pin.records import Brief

DEEPEST_START = 1e-3
"""Largest overlap of a finger with the object before it closes, m."""

_SHORTEST_MARCH = 1e-4  # m: least travel of a link per step; thinner parts may be jumped over
_SAMPLED_POSTURES = 12  # postures sampled in each direction to decide which one closes
_UNLIMITED = 2.0 * math.pi  # rad or m: range of a joint without limits, one turn
_SMALLEST_STEP = 1e-12


class FingerMarch:
    """The closing motion of one group of fingers towards the object.

    Vectors (a,) are positions or rates of the independent joints.
    """

    def __init__(
        self, hand: Hand, target: ManipulatedObject, fingers: Sequence[str], gap: float
    ) -> None:
        """Prepare one finger, or a group of fingers that share joints."""
        self._hand = hand
        self._target = target
        self._fingers = fingers
        self._gap = gap
        tree = hand.tree
        self._coupling = tree.coupling
        start = tree.coupling.independent(hand.positions)
        self._lower, self._upper = search_ranges(tree, start, _UNLIMITED)
        links = {link for finger in fingers for link in hand.fingers[finger].links}
        self._distances = LinkDistances(hand, links, target.placed_bodies)
        self._speed_bounds = _speed_bounds(self._distances, hand)

    def refuse_overlap(self, independent: FloatArray) -> None:
        """Raise SceneError if a finger overlaps the object before it closes."""
        distances = self._distances_at(independent)
        worst = int(np.argmin(distances)) if len(distances) else -1
        if worst >= 0 and distances[worst] < -DEEPEST_START:
            raise SceneError(
                f"hand link '{self._distances.links[worst]}' overlaps object "
                f"'{self._target.name}' by {-distances[worst] * 1e3:.2f} mm before closing; open "
                "the finger or move the hand"
            )

    def closing_rates(self, independent: FloatArray, given: Mapping[int, float]) -> FloatArray:
        """Return the (a,) closing rates: given ones, else those that flex towards the object."""
        flexion: dict[int, float] = {}
        fixed: dict[int, float] = {}
        for finger in self._fingers:
            flexion = flexion_rates(self._hand, finger) | flexion
            columns = driving_columns(self._hand, finger)
            fixed |= {column: rate for column, rate in given.items() if column in columns}
        choices = []
        for sense in (1.0, -1.0):
            rates = np.zeros(len(independent))
            for column, rate in (flexion | fixed).items():
                rates[column] = fixed.get(column, sense * rate)
            choices.append(rates)
        paths = [self._longest_path(independent, rates) for rates in choices]
        sums = [self._distance_sum(independent, r, s) for r, s in zip(choices, paths, strict=True)]
        if abs(sums[0] - sums[1]) > self._gap:
            return choices[int(np.argmin(sums))]
        return choices[int(np.argmax(paths))]

    def close(
        self, independent: FloatArray, rates: FloatArray, *, wrap: bool
    ) -> tuple[FloatArray, set[int]]:
        """Close the fingers until all joints have stopped.

        Returns:
            The (a,) final positions, and the columns of the joints that stopped at their limits.
        """
        rates = rates.copy()
        at_limit: set[int] = set()
        while True:
            remaining = self._remaining_path(independent, rates)
            has_ended = remaining <= _SMALLEST_STEP
            if has_ended.any():
                ends = np.where(rates > 0.0, self._upper, self._lower)
                independent = np.where(has_ended, ends, independent)
                at_limit.update(np.flatnonzero(has_ended).tolist())
                rates[has_ended] = 0.0
                continue
            speeds = self._speed_bounds @ np.abs(self._coupling.S @ rates)
            moving = speeds > 0.0
            if not moving.any():
                return independent, at_limit
            distances = self._distances_at(independent)
            touching = moving & (distances <= self._gap)
            if touching.any():
                if not wrap:
                    return independent, at_limit
                rates[self._moving_columns(touching)] = 0.0
                continue
            # No link exceeds its speed bound, so none can jump over the object.
            step = max(
                float(np.min(distances[moving] / speeds[moving])),
                _SHORTEST_MARCH / float(speeds.max()),
            )
            step = min(step, float(np.min(remaining)))
            independent = self._advance(independent, rates, step, moving)

    def _advance(
        self, independent: FloatArray, rates: FloatArray, step: float, moving: NDArray[np.bool_]
    ) -> FloatArray:
        """Return the positions after a step, shortened so that moving links stay outside."""
        positions = self._positions_after(independent, rates, step)
        if np.min(self._distances_at(positions)[moving]) >= 0.0:
            return positions
        free, blocked = 0.0, step
        while blocked - free > _SMALLEST_STEP:
            middle = 0.5 * (free + blocked)
            positions = self._positions_after(independent, rates, middle)
            nearest = float(np.min(self._distances_at(positions)[moving]))
            if 0.0 <= nearest <= self._gap:
                return positions
            free, blocked = (middle, blocked) if nearest > 0.0 else (free, middle)
        return self._positions_after(independent, rates, blocked)

    def _positions_after(
        self, independent: FloatArray, rates: FloatArray, step: float
    ) -> FloatArray:
        """Return the positions after a step; joints at rest keep their exact positions."""
        return np.where(
            rates == 0.0, independent, np.clip(independent + step * rates, self._lower, self._upper)
        )

    def _remaining_path(self, independent: FloatArray, rates: FloatArray) -> FloatArray:
        """Return the path (a,) until each joint's limit, infinite for joints at rest."""
        ends = np.where(rates > 0.0, self._upper, self._lower)
        path = np.full(len(rates), np.inf)
        turning = rates != 0.0
        path[turning] = (ends[turning] - independent[turning]) / rates[turning]
        return path

    def _longest_path(self, independent: FloatArray, rates: FloatArray) -> float:
        """Return the path until the last joint reaches its limit."""
        remaining = self._remaining_path(independent, rates)
        return max(float(np.max(remaining, initial=0.0, where=np.isfinite(remaining))), 0.0)

    def _distance_sum(self, independent: FloatArray, rates: FloatArray, path: float) -> float:
        """Return the sum of the links' least distances from the object along a path, m."""
        postures = [
            self._positions_after(independent, rates, s)
            for s in np.linspace(0.0, path, _SAMPLED_POSTURES)
        ]
        least_distances = np.min([self._distances_at(posture) for posture in postures], axis=0)
        return float(np.maximum(least_distances, 0.0).sum())

    def _moving_columns(self, shapes: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the (a,) mask of independent joints that move any of the shapes."""
        joints = (self._speed_bounds[shapes] > 0.0).any(axis=0)
        return (self._coupling.S[joints] != 0.0).any(axis=0)

    def _distances_at(self, independent: FloatArray) -> FloatArray:
        return self._distances.at(self._coupling.all_positions(independent))


def _speed_bounds(distances: LinkDistances, hand: Hand) -> FloatArray:
    """Return (K, n) bounds on the speed of any point of shape k at unit rate of joint i.

    The bound is the length of the chain from the joint to the far side of the shape, in any
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
            slide = _largest_displacement(hand, joint - 1)
            row[joint - 1] = length if slide is None else 1.0
            length += float(np.linalg.norm(model.jointPlacements[joint].translation)) + (slide or 0)
            joint = int(model.parents[joint])
    return reach


def _largest_displacement(hand: Hand, joint: int) -> float | None:
    """Return the largest displacement of a prismatic joint, m; None for a revolute joint."""
    if hand.tree.joint_kinds[joint] != "prismatic":
        return None
    ends = np.abs([hand.tree.lower[joint], hand.tree.upper[joint]])
    return float(ends.max()) if np.isfinite(ends).all() else _UNLIMITED


@dataclass(frozen=True)
class FingerClosing:
    """The result of closing one finger.

    Attributes:
        finger: Name of the finger.
        touching: Links that touch the object, in model order.
        at_limit: Joints that stopped at their limit.
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
        fingers: The result of each finger that was closed, in the order they were named.
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
        """Return one line for each finger."""
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

    A finger closes with its last joint and the joints roughly parallel to it, at equal rates, in
    the direction that brings its links nearer to the object; spread and opposition joints do not
    move. Each finger closes by itself; fingers that share a motor close together. Supports and
    other fingers do not stop a finger: check `unwanted_overlaps` afterwards.

    Args:
        hand: The hand, with its fingers open.
        target: The object.
        fingers: Fingers to close; None closes all.
        wrap: False stops a finger at the first touch. True stops only the joints that move the
            touching link; the joints beyond it continue.
        rates: Rate by joint, relative to 1 for the others, rad or m: the sign is the direction,
            zero holds the joint. It replaces the rule above for the joints that it names.
        gap: Largest distance that counts as touching, m. Fingers stop between zero and this.

    Returns:
        The hand with closed fingers, the touching links and the joints that stopped at a limit.

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
    given = _checked_rates(hand, names, rates or {})
    at_limit: set[int] = set()
    independent = hand.tree.coupling.independent(hand.positions)
    for group in groups_of_fingers(hand, names):
        march = FingerMarch(hand, target, group, gap)
        march.refuse_overlap(independent)
        independent, stopped = march.close(
            independent, march.closing_rates(independent, given), wrap=wrap
        )
        at_limit |= stopped
    closed = hand_at_positions(hand, independent)
    return ClosingResult(
        closed, tuple(_finger_closing(closed, target, name, at_limit, gap) for name in names)
    )


def _checked_rates(
    hand: Hand, fingers: Sequence[str], rates: Mapping[str, float]
) -> dict[int, float]:
    """Return the checked rates by column of the independent joints."""
    leaders = hand.tree.leader_names
    columns = sorted({column for finger in fingers for column in driving_columns(hand, finger)})
    names = [leaders[column] for column in columns]
    check_known("rates", "joint of the closing fingers", rates, names)
    return {
        leaders.index(name): real_number(f"rates[{name!r}]", rate, -np.inf)
        for name, rate in rates.items()
    }


def _finger_closing(
    hand: Hand, target: ManipulatedObject, finger: str, at_limit: set[int], gap: float
) -> FingerClosing:
    """Return the result of one finger in the closed hand."""
    link_distances = LinkDistances(hand, hand.fingers[finger].links, target.placed_bodies)
    distances = link_distances.at(hand.positions)
    return FingerClosing(
        finger=finger,
        touching=tuple(
            dict.fromkeys(
                link
                for link, distance in zip(link_distances.links, distances, strict=True)
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
_OPPOSITE_COSINE = -0.3  # cosine between the directions of two fingers to the object


def shortfall(bodies: PlacedBodies, others: PlacedBodies, clearance: float) -> float:
    """Return by how much bodies violate a clearance from others, zero if they keep it, m."""
    return clearance - smaller_clearance(bodies, others, Clearance(clearance, ())).distance


def moved_bodies(bodies: PlacedBodies, T: FloatArray) -> PlacedBodies:
    """Return bodies displaced by a (4, 4) transform, world axes."""
    return PlacedBodies(bodies.shapes, T @ bodies.poses)


def retraction_distance(
    bodies: PlacedBodies,
    obstacles: Sequence[tuple[PlacedBodies, float]],
    direction: FloatArray,
    farthest: float,
) -> tuple[float | None, int]:
    """Return the distance by which bodies retract until they clear all obstacles.

    Each step equals the largest shortfall: at any shorter distance the bodies are not clear.

    Args:
        bodies: The moving bodies.
        obstacles: Bodies, and the clearance from each, m.
        direction: (3,) unit vector of the approach, world axes; bodies retract against it.
        farthest: Largest distance, m.

    Returns:
        The distance, m, or None if the largest one is not enough; and the index of the obstacle
        that required the last step, -1 without one.
    """
    distance, last = 0.0, -1
    while distance <= farthest:
        moved = moved_bodies(bodies, rigid(-distance * direction))
        shortfalls = [shortfall(moved, others, clearance) for others, clearance in obstacles]
        worst = int(np.argmax(shortfalls))
        if shortfalls[worst] == 0.0:
            return distance, last
        distance, last = distance + max(shortfalls[worst], _LEAST_STEP), worst
    return None, last


def centering_shift(
    hand: Hand, jaws: Sequence[Sequence[str]], target: PlacedBodies
) -> FloatArray | None:
    """Return the shift of a hand that makes two opposite jaws equally distant from the object.

    These are the nearest jaw and the nearest of those opposite to it. A gripper with one motor
    touches an object that is off its centre on one side only.

    Args:
        hand: The hand.
        jaws: Links of each finger that one motor moves, or of one finger and of a fixed jaw.
        target: The object's pieces.

    Returns:
        (3,) m, world axes; None: no jaw is opposite.
    """
    bodies = hand.placed_bodies
    own = [[piece for piece in bodies if piece.name in links] for links in jaws]
    reached = [nearest_separation(pieces, target) for pieces in own if pieces]
    first = min(reached, key=lambda jaw: jaw.distance)
    opposite = [jaw for jaw in reached if float(jaw.normal @ first.normal) < _OPPOSITE_COSINE]
    if not opposite:
        return None
    second = min(opposite, key=lambda jaw: jaw.distance)
    apart = first.normal - second.normal
    return (first.distance - second.distance) * apart / float(apart @ apart)
