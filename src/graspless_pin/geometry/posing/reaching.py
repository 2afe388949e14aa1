"""Postures of fingers whose tips reach given points, away from the joints' limits if possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.finger_joints import AT_LIMIT, driving_columns
from graspless_pin.geometry.posing.tips import Tip
from graspless_pin.problem.checks import FloatArray

_UNLIMITED = np.pi  # rad or m to each side of where it stands that a joint without limits is tried
_INSIDE = 1e-6  # share of a joint's range that the solver keeps off its ends at the start
_EASY = 0.8  # middle share of a joint's range in which nothing pulls it
_PULL = 1e-3  # m of miss that weigh as much as half a joint's range outside of that share


def reach(
    hand: Hand, tips: Sequence[Tip], independent: FloatArray, *, tolerance: float, starts: int
) -> FloatArray:
    """Find the best posture of fingers that share joints.

    The points come first; among postures that reach them, those whose links are not in the object,
    and among these, those with no joint at a limit. What freedom the points leave takes joints out
    of the outermost tenths of their ranges.

    Args:
        hand: The hand.
        tips: The fingers' tips.
        independent: (a,) positions of all independent joints to start from.
        tolerance: Miss and overlap that pass, m.
        starts: How many postures to start from.

    Returns:
        (a,) positions of the independent joints; those of other fingers as they were.
    """
    search = _Search(hand, tips, independent)
    random = np.random.default_rng(0)
    lower, upper = search.lower, search.upper
    best, least_fault = search.now, (np.inf, np.inf, np.inf)
    for attempt in range(starts if len(best) else 0):
        start = random.uniform(lower, upper)
        if attempt == 0:
            start = search.now
        elif attempt == 1:
            start = 0.5 * (lower + upper)
        found = search.nearest(start)
        fault = search.fault(found, tolerance)
        if fault[0] == 0.0 and search.crowding(found) > _EASY:
            eased = search.eased(found)
            fault_then = search.fault(eased, tolerance)
            if fault_then <= fault and search.crowding(eased) < search.crowding(found):
                found, fault = eased, fault_then
        if fault < least_fault:
            best, least_fault = found, fault
        if not any(fault):
            break
    return search.completed(best)


class _Search:
    """The joints of one group of fingers as a least-squares problem; vectors are theirs only."""

    def __init__(self, hand: Hand, tips: Sequence[Tip], independent: FloatArray) -> None:
        lower, upper = hand.tree.ranges
        driving = {column for tip in tips for column in driving_columns(hand, tip.finger)}
        self._columns = [column for column in sorted(driving) if lower[column] < upper[column]]
        self._tips = tips
        self._coupling = hand.tree.coupling
        self._independent = independent
        self.now = now = independent[self._columns]
        lower, upper = lower[self._columns], upper[self._columns]
        self.lower = np.where(np.isinf(lower), now - _UNLIMITED, lower)
        self.upper = np.where(np.isinf(upper), now + _UNLIMITED, upper)
        self._middle = 0.5 * (self.lower + self.upper)
        self._half = 0.5 * (self.upper - self.lower)

    def completed(self, values: FloatArray) -> FloatArray:
        """Return the positions (a,) of all independent joints."""
        full = self._independent.copy()
        full[self._columns] = values
        return full

    def nearest(self, start: FloatArray) -> FloatArray:
        """Return the posture with the least misses that is found from a start."""
        return self._least(start, self._misses, self._jacobian)

    def eased(self, values: FloatArray) -> FloatArray:
        """Return a posture with about the same misses and joints farther from their limits."""

        def residuals(values: FloatArray) -> FloatArray:
            share = self._share(values)
            outside = share - np.clip(share, -_EASY, _EASY)
            return np.concatenate([self._misses(values), _PULL * outside])

        def jacobian(values: FloatArray) -> FloatArray:
            outside = np.abs(self._share(values)) > _EASY
            return np.vstack([self._jacobian(values), np.diag(_PULL * outside / self._half)])

        inward = self._middle + np.clip(self._share(values), -_EASY, _EASY) * self._half
        return self.nearest(self._least(inward, residuals, jacobian))

    def crowding(self, values: FloatArray) -> float:
        """Return how near to its limits any joint is: 0 half way between them, 1 at one of them."""
        return float(np.abs(self._share(values)).max())

    def fault(self, values: FloatArray, tolerance: float) -> tuple[float, float, float]:
        """Return largest miss, deepest overlap and crowding, each zero where it passes."""
        positions = self._positions(values)
        misses = self._misses(values).reshape(-1, 3)
        miss = float(np.linalg.norm(misses, axis=1).max())
        depths = [depth for tip in self._tips for depth in tip.overlaps(positions).values()]
        overlap, crowding = max(depths, default=0.0), self.crowding(values)
        return (
            miss if miss > tolerance else 0.0,
            overlap if overlap > tolerance else 0.0,
            crowding if crowding > 1.0 - 2.0 * AT_LIMIT else 0.0,
        )

    def _least(
        self,
        start: FloatArray,
        residuals: Callable[[FloatArray], FloatArray],
        jacobian: Callable[[FloatArray], FloatArray],
    ) -> FloatArray:
        inside = _INSIDE * (self.upper - self.lower)
        return least_squares(
            residuals,
            np.clip(start, self.lower + inside, self.upper - inside),
            jac=jacobian,  # pyright: ignore[reportArgumentType] - a function will do
            bounds=(self.lower, self.upper),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=100,
        ).x

    def _share(self, values: FloatArray) -> FloatArray:
        """Positions as shares of the way from the middle of the range to its ends, -1 to 1."""
        return (values - self._middle) / self._half

    def _misses(self, values: FloatArray) -> FloatArray:
        positions = self._positions(values)
        return np.concatenate([tip.touch(positions)[0] - tip.point for tip in self._tips])

    def _jacobian(self, values: FloatArray) -> FloatArray:
        positions = self._positions(values)
        return np.vstack([tip.touch(positions)[1][:, self._columns] for tip in self._tips])

    def _positions(self, values: FloatArray) -> FloatArray:
        return self._coupling.S @ self.completed(values) + self._coupling.offset
