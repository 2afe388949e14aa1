"""Optima of states whose contacts stay: in one loop, each proven like any other."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from graspless_pin.algorithms.carried import (
    LOOPS_LOCK,
    WarmStart,
    carrier_arguments,
    may_begin,
    prepared_starts,
)
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.compiled import core
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.programs.assembly import Likeness, likeness_of
from graspless_pin.programs.objectives import Objective

_MOST_STARTS = 8
_MOST_COLD = 24
"""Coordinates of forces; with more, a kept solver with sparse factors is faster than the loops."""


class LoadedOptima:
    """Optima of states with the same contacts under other loads, friction and limits, in order.

    What has led to one is tried first for the next.
    """

    def __init__(
        self, problem: QuasistaticProblem, objective: Objective, options: SolveOptions
    ) -> None:
        """Begin with nothing learned.

        Args:
            problem: One of their problems; its cones are pyramids.
            objective: What is optimised; `are_for` tells whether loops do.
            options: How.
        """
        likeness = likeness_of(problem, problem.has_cone.astype(np.float64))
        self._loops = _states(likeness, objective, problem.joint_units)
        self._may_begin = may_begin(problem, options) and self._loops.n <= _MOST_COLD
        self._last: WarmStart | None = None
        self._pool: list[Any] = []

    def learn(self, problem: QuasistaticProblem, start: WarmStart) -> None:
        """Take what led to the answer of a state that was solved by itself.

        Args:
            problem: The state's.
            start: What served, or was left behind.
        """
        if start is not self._last:
            self._last = start
            near = [
                one for one in prepared_starts(self._loops, problem, [start]) if one is not None
            ]
            self._pool = [*near, *self._pool][:_MOST_STARTS]

    def carry_on(
        self,
        problem: QuasistaticProblem,
        loads: FloatArray,
        begin: int,
        figures: FloatArray,
        torques: FloatArray,
    ) -> int:
        """Find optima until one is not found, and return the number of that state, or K.

        Args:
            problem: Whose contacts and Jacobian count.
            loads: See `core.LoadedStates.optima`.
            begin: The first state.
            figures: (K, 6), see there.
            torques: (K, L), see there.
        """
        told = loads, begin, self._pool, self._may_begin, figures, torques
        with LOOPS_LOCK:
            return self._loops.optima(problem, *told)


@lru_cache(maxsize=64)
def _states(likeness: Likeness, objective: Objective, units: tuple[JointUnit, ...]) -> Any:
    return core.LoadedStates(**carrier_arguments(likeness, objective, units))
