"""The way of a finger to the object: which way it closes, how far it may step, where it stops."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.contact.distances import LinkDistances, bounded_set
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.finger_joints import (
    driving_columns,
    flexion_rates,
)
from graspless_pin.problem.checks import FloatArray

DEEPEST_START = 1e-3
"""Overlap up to which a finger counts as touching before it closes, m."""

_SHORTEST_MARCH = 1e-4  # m that a link moves at least per step: what a step may jump over
_SAMPLES = 12  # postures tried in each sense to find out which one closes
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
        start = hand.positions[list(tree.coupling.leaders)]
        lower, upper = tree.ranges
        self._lower = np.where(np.isinf(lower), start - _UNLIMITED, lower)
        self._upper = np.where(np.isinf(upper), start + _UNLIMITED, upper)
        links = {link for finger in fingers for link in hand.fingers[finger].links}
        self._distances = LinkDistances(hand, links, target.collision_bodies())
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
        postures = [self._gone(independent, rates, s) for s in np.linspace(0.0, path, _SAMPLES)]
        nearest = np.min([self._at(posture) for posture in postures], axis=0)
        return float(np.maximum(nearest, 0.0).sum())

    def _columns_moving(self, shapes: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which independent joints move any of the shapes, (a,)."""
        joints = (self._reach[shapes] > 0.0).any(axis=0)
        return (self._coupling.S[joints] != 0.0).any(axis=0)

    def _at(self, independent: FloatArray) -> FloatArray:
        return self._distances.at(self._coupling.S @ independent + self._coupling.offset)


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
