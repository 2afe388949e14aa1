"""One vector of torques for all members of a set: the robust counterpart of Algorithms 1 and 2.

With one scenario for each corner of the set, see Ben-Tal, El Ghaoui and Nemirovski, Robust
Optimization, 2009. Contact forces and modes differ from member to member as they like.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.common_mode import common_mode, tiled
from graspless_pin.algorithms.member_margins import member_margins
from graspless_pin.algorithms.options import Limits, SolveKeywords, SolveOptions
from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.uncertainty import (
    Uncertainty,
    Weight,
    known_weight,
    members_of,
    nominal_member,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.controller import Controller, gain_shares
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, real_number
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.problem.members import Member, feedback_torques, joined, under_commands
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
from graspless_pin.records import changed
from graspless_pin.solution import Status, TorqueSolution

_AT_ONCE, _MORE = 6, 4
"""Members of the first joined problem, and how many join it at a time."""
_COMMON_NODES, _NODES = 400, 12
"""Of the searches over modes that members have in common, and over modes of each, unless another
limit is given."""
_AS_GOOD = 1e-6
"""Of an optimum, or of the load: values that differ by less are one."""
_SHARE = 1e-3


Feedback = float | ArrayLike | Controller
"""Joint stiffness that adds to torques: one or (L,), N m/rad (N/m), or a controller's."""


def solve_robust(
    problem: QuasistaticProblem,
    objective: Objective,
    uncertainty: Uncertainty,
    options: SolveOptions,
    *,
    weight: Weight | None = None,
    feedback: Feedback | None = None,
    fingers: Mapping[str, str] = MappingProxyType({}),
    mode: SlidingMode | None = None,
) -> RobustSolution:
    """Find torques that serve all members of a set.

    Under plain Coulomb friction, or in one mode, the loads that torques bear are convex, and the
    corners of a set prove all of it. Under other rules the best mode that all corners have in
    common is looked for first; where there is none, modes that differ, for the corners alone.

    Args:
        problem: The nominal one.
        objective: What is optimised, over the torques and forces of all members together.
        uncertainty: The set.
        options: How; without a limit the search over common modes ends after 400 nodes, and that
            over modes of each corner after 12.
        weight: See `members_of`.
        feedback: Joint stiffness that adds to the torques, one or (L,), N m/rad (N/m), or a
            controller whose stiffness does; None: none.
        fingers: The finger of each joint that belongs to one, for a controller that names them.
        mode: The one mode for all members.

    Raises:
        ArgumentError: If an argument is none of its kind, or the set has too many corners.
    """
    if not isinstance(uncertainty, Uncertainty):
        raise ArgumentError("uncertainty", f"is {uncertainty!r:.80}; it must be an Uncertainty")
    options.need_weak(
        "an uncertainty is about forces that may balance",
        "leave it out, and ask `Scene.stability_of_members` of the answer",
    )
    limits = Limits.of(options)
    weight = known_weight(problem, uncertainty, weight)
    members = members_of(problem, uncertainty, weight)
    directions = stiffness = None
    if feedback is not None:
        stiffness = joint_stiffness(problem, feedback, fingers)
        directions = feedback_torques(problem, stiffness)
        members = (nominal_member(problem), *members)
    at_once = _AT_ONCE
    if not isinstance(objective, Margin | Torque | TorqueShare):
        at_once = len(members)  # of others it is not known when further members fit
    chosen, others = _spread(members, at_once)
    while True:
        together = joined(chosen, directions)
        solution, coverage = _best(together, objective, limits.within(options), chosen, mode)
        lacking = (
            []
            if not solution.found
            else _lacking(solution, objective, options, chosen, others, directions, limits)
        )
        if limits.passed and others and solution.found:
            # What was not looked at may be without forces under these torques.
            solution = changed(solution, status=Status.NOT_FOUND_IN_LIMIT, _forces=None, _mode=None)
            break
        if not lacking:
            break
        chosen += [others[number] for number in lacking]
        others = [one for number, one in enumerate(others) if number not in lacking]
    bound = solution.certificate.bound
    if mode is None and solution.given_mode is not None and solution.found:
        bound = _bound(together, objective, limits.within(options), chosen, solution)
    if not solution.found and solution.status is not Status.NOT_FOUND_IN_LIMIT:
        bound = math.nan
    conflict: tuple[int, ...] = ()
    if solution.status is Status.INFEASIBLE_FORCES:
        conflict = _conflict(chosen, objective, options, directions)
    return RobustSolution(
        solution, coverage, bound, (*chosen, *others), problem.joint_names, conflict, stiffness,
        uncertainty, weight,
    )  # fmt: skip


def joint_stiffness(
    problem: QuasistaticProblem, feedback: Feedback, fingers: Mapping[str, str]
) -> FloatArray:
    """Return (L,) the stiffness of each joint; the arguments are those of `solve_robust`.

    Raises:
        ArgumentError: If it is negative, no number, of another number of joints, or not stated.
    """
    if isinstance(feedback, Controller) or np.ndim(feedback) == 0:
        if not isinstance(feedback, Controller):
            feedback = real_number("feedback", feedback, 0.0)
        controller = Controller.of("feedback", feedback)
        if not controller.is_stated or controller.holds_joints:
            raise ArgumentError("feedback", "states no stiffness; give one, N m/rad")
        controller.check(problem.joint_names, (*set(fingers.values()),))
        shares = gain_shares([unit is JointUnit.FORCE for unit in problem.joint_units])
        return controller.gains(problem.joint_names, shares, fingers)[0]
    given = finite_array("feedback", feedback, (problem.joint_count,))
    if (given < 0.0).any():
        raise ArgumentError("feedback", f"is {given.min():.4g}; stiffness is not negative")
    return given


def _best(
    together: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions,
    members: Sequence[Member],
    mode: SlidingMode | None,
) -> tuple[TorqueSolution, Coverage]:
    """Return the best torques for some members, and whom they serve."""
    convex = len(members) == 1 or options.rules.static_friction is StaticFriction.COULOMB
    if mode is None and not convex:
        if not options.rules.by_direction:
            limited = _limited(options, _COMMON_NODES)
            mode = common_mode(together, members, objective, limited)
        if mode is None:
            solution = solve_problem(together, objective, _limited(options, _NODES))
            return solution, Coverage.CORNERS
    every = None if mode is None else tiled(mode, len(members))
    return solve_problem(together, objective, options, mode=every), Coverage.WHOLE_SET


def _limited(options: SolveOptions, nodes: int) -> SolveOptions:
    return options if options.node_limit else replace(options, node_limit=nodes)


def _bound(
    together: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions,
    members: Sequence[Member],
    solution: TorqueSolution,
) -> float:
    """Return what no torques for all members are better than, whatever their modes.

    That is the optimum under plain Coulomb friction, or of a member alone where that is worse.
    """
    rules = replace(options.rules, static_friction=StaticFriction.COULOMB)
    best = max if not objective.maximizes else min
    bound = solve_problem(together, objective, replace(options, rules=rules)).certificate.bound
    for member in members:
        if _reaches(solution, bound):
            break
        alone = solve_problem(joined([member]), objective, options)
        bound = best(bound, alone.certificate.bound)
    return bound


def _reaches(solution: TorqueSolution, bound: float) -> bool:
    return abs(solution.value - bound) <= _AS_GOOD * max(abs(bound), abs(solution.value))


def _spread(members: Sequence[Member], most: int) -> tuple[list[Member], list[Member]]:
    """Return members to begin with, each as far from those before it as can be, and the others."""
    if len(members) <= most:
        return list(members), []
    problem = members[0].problem
    force, length, joints = problem.scales
    sizes = np.concatenate([np.where(problem.passive_turns, force * length, force), joints])
    points = np.array(
        [
            np.concatenate([one.problem.external_wrench, one.commanded(np.zeros_like(joints))])
            / sizes
            for one in members
        ]
    )
    distances = np.linalg.norm(points - points.mean(axis=0), axis=1)
    chosen = [0]  # the nominal one, where feedback is from there
    distances = np.minimum(distances, np.linalg.norm(points - points[0], axis=1))
    for _ in range(most - 1):
        chosen.append(int(distances.argmax()))
        distances = np.minimum(distances, np.linalg.norm(points - points[chosen[-1]], axis=1))
        distances[chosen] = -1.0
    rest = [one for number, one in enumerate(members) if number not in set(chosen)]
    return [members[number] for number in chosen], rest


def _lacking(
    solution: TorqueSolution,
    objective: Objective,
    options: SolveOptions,
    chosen: Sequence[Member],
    others: Sequence[Member],
    directions: FloatArray | None,
    limits: Limits,
) -> list[int]:
    """Return which other members the torques do not serve, the worst few."""
    needed = solution.margin if objective.maximizes else objective.required_margin
    force = chosen[0].problem.scales.force
    commanded = chosen[0].commanded(
        chosen[0].problem.J.T @ solution.contact_forces[: chosen[0].problem.contact_count].ravel()
    )
    mode = None
    if solution.given_mode is not None:  # what is proven in one mode has to hold in that one
        size = chosen[0].problem.contact_count
        given = solution.given_mode
        mode = SlidingMode(given.selection[:size], given.signs[:size])
    margins = member_margins(
        others,
        commanded,
        options,
        limits,
        directions=directions,
        torque_limits=_found_limits(chosen[0].problem, solution, objective),
        mode=mode,
        enough=needed,
    )
    lacking = np.flatnonzero(margins < needed - 0.5 * _AS_GOOD * force)
    return lacking[np.argsort(margins[lacking])][:_MORE].tolist()


def _found_limits(
    problem: QuasistaticProblem, solution: TorqueSolution, objective: Objective
) -> tuple[FloatArray, FloatArray]:
    """Return limits of torques, no larger than was found to be enough, for what feedback adds."""
    most = (1.0 + _AS_GOOD) * solution.value
    low, high = problem.lower_torque, problem.upper_torque
    if isinstance(objective, TorqueShare):
        return most * low, most * high
    if isinstance(objective, Torque):
        return np.maximum(low, -most), np.minimum(high, most)
    return low, high


def further_forces(robust: RobustSolution) -> FloatArray | None:
    """Return contact forces of the corners that were served without being solved for.

    Args:
        robust: Torques that were found.

    Returns:
        (K - J, M, 3) N, of `RobustSolution.members` from the solution's J on; None: corners may
        need modes of their own.

    Raises:
        NoSolutionError: If nothing was found, or there are no such forces.
    """
    solution, first = robust.solution, robust.members[0]
    others = robust.members[len(robust.contact_forces) :]
    mode, coulomb = solution.given_mode, solution.rules.static_friction is StaticFriction.COULOMB
    if others and mode is None and not coulomb:
        return None
    directions = None
    if robust.feedback is not None:
        directions = feedback_torques(first.problem, robust.feedback)
    if mode is not None:
        size = first.problem.contact_count
        mode = SlidingMode(mode.selection[:size], mode.signs[:size])
    most = _found_limits(first.problem, solution, solution.objective)
    found = []
    for member in others:
        problem = under_commands(member, robust.torques, directions)
        if directions is not None:
            problem = problem.with_changes(torque_limits=most)
        options = SolveOptions(rules=solution.rules)
        found.append(solve_problem(problem, Margin(), options, mode=mode).contact_forces)
    return np.array(found).reshape(-1, *first.problem.positions.shape)


def _conflict(
    members: Sequence[Member],
    objective: Objective,
    options: SolveOptions,
    directions: FloatArray | None,
) -> tuple[int, ...]:
    """Return members that no forces serve together, none of which can be left out.

    A deletion filter (Chinneck): under Coulomb's law at most rank(J) + 1 are left, by Helly.
    """
    coulomb = replace(options, rules=replace(options.rules, static_friction=StaticFriction.COULOMB))
    kept = list(range(len(members)))
    for number in range(len(members)):
        fewer = [one for one in kept if one != number]
        if not fewer:
            break
        together = joined([members[one] for one in fewer], directions)
        if solve_problem(together, objective, coulomb).status is Status.INFEASIBLE_FORCES:
            kept = fewer
    return tuple(kept)


def served_share(
    problem: QuasistaticProblem,
    objective: Objective,
    uncertainty: Uncertainty,
    *,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> float:
    """Return the largest share of a set's figures, about the same middle, that torques serve.

    By bisection over nested sets, to a thousandth.

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
    return largest_share(
        lambda share: solve_robust(
            problem, objective, uncertainty.scaled(share), how, feedback=feedback
        )
    )


def largest_share(solved: Callable[[float], RobustSolution]) -> float:
    """Return the largest share of a set that is served, see `served_share`.

    Args:
        solved: Returns what is found for the set with its figures times a share.
    """
    if solved(1.0).found:
        return 1.0
    if not solved(0.0).found:
        return math.nan
    low, high = 0.0, 1.0
    while high - low > _SHARE:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if solved(middle).found else (low, middle)
    return low
