"""The least friction with which a scene is still feasible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

import numpy as np

from graspless_pin.algorithms.options import Limits, SolveKeywords, SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.solution import UNDECIDED

_LARGEST = 16.0
_SCAN = 48
_RELATIVE = 1e-7


@dataclass(frozen=True)
class MinimumFriction:
    """The smallest common factor on all friction coefficients.

    See the example of `minimum_friction`.

    Attributes:
        factor: Smallest factor with which the scene is feasible (at margin zero); 0 if it needs no
            friction, NaN if no factor up to 16 does. Where a limit ended a search, the smallest
            that was seen to be enough.
        proven: Whether all searches came to their end, with answers of solvers that were proven.
    """

    factor: float
    proven: bool

    @property
    def found(self) -> bool:
        """Whether any factor up to 16 makes the scene feasible."""
        return bool(np.isfinite(self.factor))


def minimum_friction(
    problem: QuasistaticProblem, **options: Unpack[SolveKeywords]
) -> MinimumFriction:
    """Find the smallest common factor on all friction coefficients that keeps a scene feasible.

    Without actual sliding the force set grows with the factor, and bisection is exact. Kinetic
    friction turns with its coefficient, so with sliding contacts 1 and 48 factors from 1/16 to 16
    are tried first, and a feasible interval between two of them can be missed.

    Args:
        problem: Contacts, wrench, joints and limits.
        options: See `SolveOptions.parse`.

    Raises:
        ArgumentError: If an option is not known, or ``stability="strong"``.

    Examples:
        >>> from graspless_pin import load_scene, minimum_friction
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> print(f"{minimum_friction(problem).factor:.2f} of the friction is needed")
        0.22 of the friction is needed
    """
    checked_problem(problem)
    how = SolveOptions.parse(**options)
    what = "minimum_friction is what can be held with at best"
    how.need_weak(what, "leave it out, and ask for guaranteed torques at a factor")
    factor, proven = smallest_factor(problem, Margin(), how)
    return MinimumFriction(factor, proven)


def smallest_factor(
    problem: QuasistaticProblem, objective: Objective, options: SolveOptions
) -> tuple[float, bool]:
    """Return the smallest common factor on friction with which an objective is feasible, or NaN.

    It also says whether all searches came to their end: one that did not counts as infeasible.

    Args:
        problem: Contacts, wrench, joints and limits.
        objective: What has to be feasible. With a required margin the factor 0 is left out: there
            a contact has no cone to keep a margin in.
        options: How the problems are solved.
    """
    proven, limits = True, Limits.of(options)

    def feasible(factor: float) -> bool:
        nonlocal proven
        if limits.passed:
            proven = False
            return False
        scaled = problem.with_changes(friction=factor * problem.friction)
        solution = solve_problem(scaled, objective, limits.within(options))
        proven = proven and solution.status not in UNDECIDED
        return solution.found

    if objective.required_margin == 0.0 and feasible(0.0):
        return 0.0, proven
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
        return np.nan, proven
    while top - low > _RELATIVE * top:
        middle = 0.5 * (low + top)
        low, top = (low, middle) if feasible(middle) else (middle, top)
    return top, proven
