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
    friction turns with its coefficient, so with sliding contacts 1 and 48 factors from 1/16 to 16
    are tried first, and a feasible interval between two of them can be missed.

    Args:
        problem: Contacts, wrench, joints and limits.
        options: ``sign_rule``, ``sliding_rule``, ``static_friction`` of `maximize_margin`.
    """
    objective = Objective(Algorithm.MARGIN, 0.0, by_limits=False, regularization=0.0)
    return MinimumFriction(smallest_factor(problem, objective, Rules.parse(**options)))


def smallest_factor(problem: QuasistaticProblem, objective: Objective, rules: Rules) -> float:
    """Return the smallest common factor on friction with which an objective is feasible, or NaN.

    Args:
        problem: Contacts, wrench, joints and limits.
        objective: What has to be feasible. With a required margin the factor 0 is left out: there
            a contact has no cone to keep a margin in.
        rules: The reading of the virtual-sliding constraint.
    """

    def feasible(factor: float) -> bool:
        scaled = problem.with_changes(friction=factor * problem.friction)
        return solve_problem(scaled, objective, rules).found

    if objective.margin == 0.0 and feasible(0.0):
        return 0.0
    tried = [1.0, _LARGEST]
    if problem.is_sliding.any():
        # The factor 1 is among them: what is feasible as it is must not be missed.
        tried = sorted({1.0, *np.geomspace(1.0 / _LARGEST, _LARGEST, _SCAN).tolist()})
    low = 0.0
    for top in tried:
        if feasible(top):
            break
        low = top
    else:
        return np.nan
    while top - low > _RELATIVE * top:
        middle = 0.5 * (low + top)
        low, top = (low, middle) if feasible(middle) else (middle, top)
    return top
