"""The largest of nested sets that one vector of torques serves.

A set that is not served comes with members in conflict. The same members of a smaller set are a
small program, which tells how far down they stay in conflict. Only there the whole set is asked
again: it is served, or there are other members in conflict. Mostly two or three whole sets are
solved, and not one for each halving.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np

from graspless_pin.algorithms.options import NO_LIMITS, Limits, SolveKeywords, SolveOptions
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.robust_torques import Feedback, solve_robust
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.uncertain_members import known_weight, member_at
from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.modes.rules import Rules, StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member, feedback_torques, joined
from graspless_pin.programs.objectives import Objective
from graspless_pin.records import Brief
from graspless_pin.solution import Status

_SHARE = 1e-3
_COULOMB = SolveOptions(rules=Rules(static_friction=StaticFriction.COULOMB))


@dataclass(frozen=True, eq=False, repr=False)
class ServedSize(Brief):
    """How large a set may be.

    Attributes:
        served: The largest size that was found to be served.
        failing: The smallest at which no torques were found.
        best: What was found at the one; None: nothing was solved for it.
        conflict: Members of a set of the other that no torques serve together; empty: none are
            known.
    """

    served: float
    failing: float
    best: RobustSolution | None
    conflict: tuple[Member, ...]


def largest_served(
    problem: QuasistaticProblem,
    solved: Callable[[float], RobustSolution],
    failed: RobustSolution,
    sizes: tuple[float, float],
    *,
    near: float,
    relative: float = 0.0,
    limits: Limits,
) -> ServedSize:
    """Return how large a set may be, between two sizes.

    Args:
        problem: The nominal one.
        solved: Returns what is found for the set of a size. Sets are nested, and contain the
            members of larger ones with all that is off times the ratio of the sizes.
        failed: What was found for the larger size: no torques.
        sizes: The smaller one is served, and the larger one is not.
        near: How near the two sizes that are returned have to be, and
        relative: over the larger one.
        limits: When to stop.
    """
    (low, high), of = sizes, sizes[1]
    best: RobustSolution | None = None
    halves = False

    def apart() -> float:
        return max(near, relative * high)

    while high - low > apart() and not limits.passed:
        trial = 0.5 * (low + high)
        if failed.conflict:
            trial = low
            while high - trial > 0.5 * apart():
                middle = 0.5 * (trial + high)
                refuted = _is_refuted(problem, failed, middle / of)
                trial, high = (trial, middle) if refuted else (middle, high)
            if high - low <= apart():
                break
            # Others may be in conflict there, one after the other: every second time by halves.
            trial = 0.5 * (low + trial) if halves and trial > low + apart() else trial
            halves = not halves
        found = solved(trial)
        if found.found:
            low, best = trial, found
        elif found.status is Status.NOT_FOUND_IN_LIMIT and limits.passed:
            break
        else:
            high, of, failed = trial, trial, found
    return ServedSize(low, high, best, tuple(smaller_conflict(problem, failed, high / of)))


def smaller_conflict(
    problem: QuasistaticProblem, failed: RobustSolution, share: float
) -> list[Member]:
    """Return members in conflict as a smaller set has them: with all that is off times a share.

    Args:
        problem: The nominal one.
        failed: What was found for the larger set: no torques.
        share: Of its figures, at most 1.
    """
    weight = known_weight(problem, Uncertainty(), failed.weight)
    uncertainty = failed.uncertainty or Uncertainty()
    tilt, in_kilograms = uncertainty.tilt, uncertainty.mass_offset > 0.0
    kilograms = weight.mass if in_kilograms else math.nan
    found = []
    for one in (failed.members[number] for number in failed.conflict):
        if one.corner is None or share == 1.0:
            found.append(one)
            continue
        corner, own = one.corner, one.problem
        down = corner.down
        if tilt > 0.0:  # to the prism around the smaller circle of tilts
            along = float(down @ weight.down)
            height = 1.0 if along > math.cos(0.5 * tilt) else math.cos(share * tilt)
            across = math.sin(share * tilt) / math.sin(tilt) * (down - along * weight.down)
            down = height * weight.down + across
        figures = {
            name: share * getattr(corner, name)
            for name in ("mass", "center_of_mass", "force", "moment", "kinetic")
        }
        base = problem.with_changes(
            friction=_between(problem.friction, own.friction, share),
            torque_limits=(
                _between(problem.lower_torque, own.lower_torque, share),
                _between(problem.upper_torque, own.upper_torque, share),
            ),
        )
        corner = replace(corner, down=down, **figures)
        off = share * (one.factors - 1.0), share * one.offsets
        found.append(member_at(problem, weight, corner, *off, base=base, kilograms=kilograms))
    return found


def _between(nominal: FloatArray, other: FloatArray, share: float) -> FloatArray:
    # Infinite limits stay so.
    same = nominal == other
    return np.where(same, nominal, nominal + share * np.where(same, 0.0, other - nominal))


def _is_refuted(problem: QuasistaticProblem, failed: RobustSolution, share: float) -> bool:
    """Whether the members in conflict are so, too, with all that is off times a share."""
    directions = None
    if failed.feedback is not None:
        directions = feedback_torques(problem, failed.feedback)
    together = joined(smaller_conflict(problem, failed, share), directions)
    found = solve_problem(together, failed.solution.objective, _COULOMB)
    return found.status is Status.INFEASIBLE_FORCES


def served_share(
    problem: QuasistaticProblem,
    objective: Objective,
    uncertainty: Uncertainty,
    *,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> float:
    """Return the largest share of a set's figures, about the same middle, that torques serve.

    To a thousandth; members in conflict tell which smaller sets are not served either.

    Args:
        problem: The nominal one.
        objective: What is optimised.
        uncertainty: The set.
        feedback: Joint stiffness that adds to the torques, N m/rad (N/m), or a controller.
        options: See `SolveOptions.parse`.

    Returns:
        From 0 to 1; NaN where not even the nominal problem is served.

    Raises:
        ArgumentError: See `minimize_torque`.

    Examples:
        >>> from graspless_pin import Torque, Uncertainty, load_scene, served_share
        >>> problem = load_scene("examples/paper/sphere_on_slope.yaml").problem()
        >>> unknown = Uncertainty(mass=0.2, center_of_mass=0.01)  # m
        >>> share = served_share(problem, Torque(0.1), unknown, static_friction="coulomb")
        >>> print(f"{100.0 * share:.0f} %")
        85 %
    """
    how = SolveOptions.parse(**options)

    def solved(share: float) -> RobustSolution:
        return solve_robust(problem, objective, uncertainty.scaled(share), how, feedback=feedback)

    whole = solved(1.0)
    return 1.0 if whole.found else largest_share(problem, solved, whole).served


def largest_share(
    problem: QuasistaticProblem,
    solved: Callable[[float], RobustSolution],
    whole: RobustSolution,
    limits: Limits = NO_LIMITS,
) -> ServedSize:
    """Return the largest share of a set that is served, see `served_share`.

    Args:
        problem: The nominal one.
        solved: Returns what is found for the set with its figures times a share.
        whole: What was found for the whole set: no torques.
        limits: When to stop.
    """
    found = largest_served(problem, solved, whole, (0.0, 1.0), near=_SHARE, limits=limits)
    if found.served == 0.0 and not limits.passed and not solved(0.0).found:
        return replace(found, served=math.nan)
    return found
