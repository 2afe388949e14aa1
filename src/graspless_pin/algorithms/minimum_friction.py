"""The least friction with which a scene is still feasible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

import numpy as np

from graspless_pin.algorithms.formulation import Objective
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.modes.rules import RuleOptions, Rules
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.solution import Algorithm

_LARGEST = 16.0
_SCAN = 48
_RELATIVE = 1e-7


@dataclass(frozen=True)
class MinimumFriction:
    """The smallest common factor on all friction coefficients.

    Attributes:
        factor: Smallest factor with which the scene is feasible (at margin zero); 0 if it needs no
            friction, NaN if no factor up to 16 does.
    """

    factor: float

    @property
    def found(self) -> bool:
        """Whether any factor up to 16 makes the scene feasible."""
        return bool(np.isfinite(self.factor))


def minimum_friction(
    problem: QuasistaticProblem, **options: Unpack[RuleOptions]
) -> MinimumFriction:
    """Find the smallest common factor on all friction coefficients that keeps a scene feasible.

    Without actual sliding the force set grows with the factor, and bisection is exact. Kinetic
    friction turns with its coefficient, so with sliding contacts the factors from 1/16 to 16
    are scanned first (48 steps), and a feasible interval narrower than a step can be missed.

    Args:
        problem: Contacts, wrench, joints and limits.
        options: ``sign_rule``, ``sliding_rule``, ``static_friction`` of `maximize_margin`.
    """
    rules = Rules.parse(**options)
    objective = Objective(Algorithm.MARGIN, 0.0, by_limits=False, regularization=0.0)

    def feasible(factor: float) -> bool:
        scaled = problem.with_changes(friction=factor * problem.friction)
        return solve_problem(scaled, objective, rules).found

    if feasible(0.0):
        return MinimumFriction(0.0)
    tried = [1.0, _LARGEST]
    if problem.is_sliding.any():
        tried = np.geomspace(1.0 / _LARGEST, _LARGEST, _SCAN).tolist()
    low = 0.0
    for top in tried:
        if feasible(top):
            break
        low = top
    else:
        return MinimumFriction(np.nan)
    while top - low > _RELATIVE * top:
        middle = 0.5 * (low + top)
        low, top = (low, middle) if feasible(middle) else (middle, top)
    return MinimumFriction(top)
