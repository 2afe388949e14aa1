"""One vector of torques for all members of a set: the robust counterpart of Algorithms 1 and 2.

By vertex enumeration, one scenario for each corner of the set: see Ben-Tal, El Ghaoui and
Nemirovski, Robust Optimization, 2009. Contact forces and modes are adjustable: they may differ from
member to member. Sets with balls, or too many corners, use affine policies. Moved contacts are
sampled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.affine_policy import best_policy
from graspless_pin.algorithms.force_policy import (
    Unknowns,
    extreme_members,
    unknowns_of,
)
from graspless_pin.algorithms.joined_optimum import (
    AS_GOOD,
    COMMON_NODES,
    NODES,
    best_torques,
    common_mode,
    far_members,
    member_margins,
    minimal_conflict,
    mode_of_all,
    mode_of_member,
    node_limited,
    torques_bound,
    under_limits,
    without_forces,
)
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution, Samples
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.uncertain_members import (
    Weight,
    known_weight,
    members_of,
    nominal_member,
    part_of_corners,
)
from graspless_pin.algorithms.uncertainty import Uncertainty, each_of
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.controller import Controller, gain_shares
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, JointUnit, finite_array, real_number
from graspless_pin.problem.members import Member, feedback_torques, join_members
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.tree_search import Limits

_EXTREMES = 16
"""Number of members far from each other that give bound and conflict where there is no policy."""
_CRITICAL = 3
"""Number of most critical members, joined by as many far from each other, that bound a policy."""
_SHARING = 6
"""Number of members for which a common mode is looked for."""


def torques_by_policy(
    corners: Sequence[Member],
    unknowns: Unknowns,
    objective: Objective,
    options: SolveOptions,
    limits: Limits,
    *,
    directions: FloatArray | None = None,
    mode: SlidingMode | None = None,
) -> RobustSolution:
    """Return torques that affine forces prove for a whole set, with a bound.

    Args:
        corners: K members, with the nominal one first if commands are fed back.
        unknowns: Figures of the set that its corners leave out.
        objective: What is optimised.
        options: How problems are solved.
        limits: When to stop.
        directions: (L, d) what feedback may add to commands, see `feedback_torques`.
        mode: The one mode for all members.

    Raises:
        ArgumentError: If affine forces do not serve such an objective or rule.
    """
    if not isinstance(objective, Margin | Torque) or objective.regularization > 0.0:
        raise ArgumentError(
            "uncertainty",
            "has balls, or too many corners, which require the objective margin or torque without "
            "a regularization",
        )
    coulomb = options.rules.static_friction is StaticFriction.COULOMB
    if not coulomb:
        options.rules.need_signs("an uncertainty with balls, or too many corners,")
    modes = [mode]
    if mode is None and not coulomb:
        modes = _common_modes(corners, unknowns, objective, options, limits, directions)
    policy, free = best_policy(
        corners, unknowns, objective, directions=directions, modes=modes, limits=limits
    )
    names = corners[0].problem.joint_names
    if policy is not None:
        chosen = policy.critical(_CRITICAL)
        if directions is not None or not chosen:  # feedback counts from the nominal one
            chosen.insert(0, corners[0])
        together, how = (
            join_members(chosen, directions),
            node_limited(limits.with_time_left(options), NODES),
        )
        every = None if mode is None else mode_of_all(mode, len(chosen))
        bounding = solve_problem(together, objective, how, mode=every)
        return RobustSolution(
            bounding, Coverage.WHOLE_SET, bounding.certificate.bound, (*corners, *chosen), names,
            policy=policy,
        )  # fmt: skip
    if free:
        extremes = extreme_members(corners[:1], unknowns, free[:1])
    else:
        extremes = _far_extremes(corners, unknowns, _EXTREMES)
    how = limits.with_time_left(options)
    solution, coverage = best_torques(extremes, objective, how, directions, mode)
    bound = torques_bound(solution, extremes, objective, how, mode)
    conflict = minimal_conflict(solution, extremes, objective, options, limits, directions)
    if limits.is_time_over and solution.status is not Status.INFEASIBLE_FORCES:
        solution = without_forces(solution, Status.NOT_FOUND_IN_LIMIT)
    elif solution.found:  # for these members alone
        solution = without_forces(solution, Status.UNVERIFIED)
    return RobustSolution(solution, coverage, bound, tuple(extremes), names, conflict)


def _common_modes(
    corners: Sequence[Member],
    unknowns: Unknowns,
    objective: Objective,
    options: SolveOptions,
    limits: Limits,
    directions: FloatArray | None,
) -> list[SlidingMode | None]:
    """Return modes in which affine forces are looked for: common to extremes, and to corners."""
    found: dict[bytes, SlidingMode | None] = {}
    for some in (_far_extremes(corners, unknowns, _SHARING), far_members(corners, _SHARING)[0]):
        how = node_limited(limits.with_time_left(options), COMMON_NODES)
        mode = common_mode(join_members(some, directions), some, objective, how)
        if mode is not None:
            found[mode.selection.tobytes() + mode.signs.tobytes()] = mode
    return list(found.values())


def _far_extremes(corners: Sequence[Member], unknowns: Unknowns, count: int) -> list[Member]:
    """Return members far from each other: corners, and their extreme members."""
    some = far_members(corners, count)[0]
    return far_members([*corners, *extreme_members(some, unknowns)], count)[0]


_AT_ONCE, _MORE = 4, 4
"""Number of members of the first joined problem, and number that join it at a time."""
_SEED = 0
_SOLVED = 50
"""Number of members with moved contacts that are solved for."""
_SAMPLES = 200
"""Number of such members that are then tested."""


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
    slopes: FloatArray | None = None,
) -> RobustSolution:
    """Find torques that serve all members of a set.

    Under plain Coulomb friction, or in one mode, the set of loads that torques balance is convex,
    and the corners of an uncertain set prove all of it. Under other rules the best common mode of
    all corners is looked for first; if there is none, modes differ and the answer is for the
    corners alone. For balls, and for errors and pushes with too many corners, forces are affine in
    the unknowns. Members with moved contacts are drawn at random: those that torques do not serve
    join the problem, and further ones show the share that is served in the end.

    Args:
        problem: The nominal one.
        objective: What is optimised, over the torques and forces of all members together.
        uncertainty: The set.
        options: How problems are solved; without a limit the search over common modes ends after
            400 nodes, and that over modes of each corner after 12.
        weight: See `members_of`.
        feedback: Joint stiffness that adds to the torques, one or (L,), N m/rad (N/m), or a
            controller whose stiffness does; None: none.
        fingers: The finger of each joint that belongs to one, for a controller that names them.
        mode: The one mode for all members.
        slopes: See `moved_members`; None: not known.

    Raises:
        ArgumentError: If an argument is none of its kind, or the set has too many corners.
    """
    if not isinstance(uncertainty, Uncertainty):
        raise ArgumentError("uncertainty", f"is {uncertainty!r:.80}; it must be an Uncertainty")
    options.need_weak(
        "arrays do not state the inertia of each member",
        "use a scene: scene.solve(uncertainty=..., stability='strong')",
    )
    limits = Limits.from_options(options)
    radii = contact_radii(problem, uncertainty, slopes)
    weight = known_weight(problem, uncertainty, weight)
    of_corners = part_of_corners(problem, uncertainty)
    stiffness = joint_stiffness(problem, feedback, fingers)
    members, directions = corners_of(problem, of_corners, weight, stiffness)
    unknowns = unknowns_of(problem, uncertainty, of_corners, weight, members)
    has_margin = isinstance(objective, Margin | Torque)
    if radii.any() and (unknowns.count or not has_margin):
        beside = "a set with balls or too many corners" if unknowns.count else "such an objective"
        raise ArgumentError(
            "contact_position",
            f"is not supported together with {beside}; leave it out, or use boxes instead of "
            "balls, fewer uncertain figures, and the objective margin or torque",
        )
    corners = members if feedback is None or len(members) == 1 else members[1:]
    rng = np.random.default_rng(_SEED)
    drawn = partial(moved_members, corners, radii, slopes, rng, stiffness=stiffness)
    if unknowns.count:
        found = torques_by_policy(
            members, unknowns, objective, options, limits, directions=directions, mode=mode
        )
    else:
        found = torques_for_members(
            members, objective, options, limits, directions=directions, mode=mode,
            further=drawn(_SOLVED, far=True) if radii.any() else (),
        )  # fmt: skip
    found = replace(found, feedback=stiffness, uncertainty=uncertainty, weight=weight)
    if not radii.any() or not found.found:
        return found
    tried, covered = drawn(_SAMPLES), found.coverage
    found = replace(found, coverage=Coverage.SAMPLED)
    deficits = _margin_deficits(
        found.solution, objective, options, found.members, tried, directions, limits
    )
    if limits.is_time_over:
        return replace(found, solution=without_forces(found.solution, Status.NOT_FOUND_IN_LIMIT))
    return replace(
        found, samples=Samples(len(tried), int((deficits == 0.0).sum()), _SOLVED, covered)
    )


def torques_for_members(
    members: Sequence[Member],
    objective: Objective,
    options: SolveOptions,
    limits: Limits,
    *,
    directions: FloatArray | None = None,
    mode: SlidingMode | None = None,
    begin: Sequence[int] = (),
    further: Sequence[Member] = (),
) -> RobustSolution:
    """Find torques that serve some members.

    Args:
        members: K of them; with feedback the nominal one first.
        objective: What is optimised, over the torques and forces of all of them together.
        options: How problems are solved.
        limits: When to stop.
        directions: (L, d) what feedback may add to commands, see `feedback_torques`.
        mode: The one mode for all of them.
        begin: Numbers of members to begin with; empty: some that are far from each other.
        further: Members that join only where torques for the others do not serve them.
    """
    at_once = _AT_ONCE
    if not isinstance(objective, Margin | Torque):
        at_once = len(members)  # margins do not tell whether other objectives serve a member
    chosen, others = far_members(members, at_once)
    if begin and others:
        chosen = [members[number] for number in begin]
        others = [member for number, member in enumerate(members) if number not in set(begin)]
    others += further
    while True:
        solution, coverage = best_torques(
            chosen, objective, limits.with_time_left(options), directions, mode
        )
        deficits = np.zeros(len(others))
        if solution.found:
            deficits = _margin_deficits(
                solution, objective, options, chosen, others, directions, limits
            )
        unserved = np.flatnonzero(deficits)
        if limits.is_time_over and others and solution.found:
            solution = without_forces(solution, Status.NOT_FOUND_IN_LIMIT)
            break
        if not len(unserved):
            break
        worst = np.sort(deficits[unserved])[-_MORE:].min()
        joining = {number for number in unserved if deficits[number] >= worst}  # and equal ones
        served = [member for number, member in enumerate(others) if number not in joining]
        candidates = [*chosen, *(others[number] for number in sorted(joining))]
        kept_count = len(chosen)
        chosen, others = far_members(candidates, kept_count + _MORE, held=kept_count)
        others += served
    bound = torques_bound(solution, chosen, objective, limits.with_time_left(options), mode)
    conflict = minimal_conflict(solution, chosen, objective, options, limits, directions)
    names = members[0].problem.joint_names
    return RobustSolution(solution, coverage, bound, (*chosen, *others), names, conflict)


def corners_of(
    problem: QuasistaticProblem,
    uncertainty: Uncertainty,
    weight: Weight,
    stiffness: FloatArray | None,
) -> tuple[tuple[Member, ...], FloatArray | None]:
    """Return the corners of a set, and what feedback may add to their commands.

    Args:
        problem: The nominal one; with feedback it is the first of the corners.
        uncertainty: The set.
        weight: Which part of its load is weight.
        stiffness: (L,) stiffness of the joints, N m/rad (N/m); None: no feedback.
    """
    members = members_of(problem, uncertainty, weight)
    if stiffness is None:
        return members, None
    return (nominal_member(problem), *members), feedback_torques(problem, stiffness)


def joint_stiffness(
    problem: QuasistaticProblem, feedback: Feedback | None, fingers: Mapping[str, str]
) -> FloatArray | None:
    """Return (L,) the stiffness of each joint, or None; the arguments are those of `solve_robust`.

    Raises:
        ArgumentError: If it is negative, no number, of another number of joints, or not stated.
    """
    if feedback is None:
        return None
    if isinstance(feedback, Controller) or np.ndim(feedback) == 0:
        if not isinstance(feedback, Controller):
            feedback = real_number("feedback", feedback, 0.0)
        controller = Controller.parse("feedback", feedback)
        if not controller.is_given or controller.holds_joints:
            raise ArgumentError("feedback", "does not state a stiffness; give one, N m/rad")
        controller.check(problem.joint_names, (*set(fingers.values()),))
        shares = gain_shares([unit is JointUnit.FORCE for unit in problem.joint_units])
        return controller.gains(problem.joint_names, shares, fingers)[0]
    given = finite_array("feedback", feedback, (problem.joint_count,))
    if (given < 0.0).any():
        raise ArgumentError("feedback", f"is {given.min():.4g}; it must not be negative")
    return given


def _margin_deficits(
    solution: TorqueSolution,
    objective: Objective,
    options: SolveOptions,
    chosen: Sequence[Member],
    others: Sequence[Member],
    directions: FloatArray | None,
    limits: Limits,
) -> FloatArray:
    """Return (K,) by how much margins of other members miss the required one, N; 0: served."""
    needed = solution.margin if objective.maximizes else objective.required_margin
    problem = chosen[0].problem
    forces = solution.contact_forces[: problem.contact_count]
    deficits = needed - member_margins(
        others, chosen[0].commanded(problem.J.T @ forces.ravel()), options, limits,
        directions=directions, torque_limits=_limits_for_feedback(problem, solution, objective),
        mode=mode_of_member(solution.given_mode, chosen[0]),  # a proof in one mode needs that mode
        enough=needed,
    )  # fmt: skip
    return np.where(deficits > 0.5 * AS_GOOD * problem.scales.force, deficits, 0.0)


def _limits_for_feedback(
    problem: QuasistaticProblem, solution: TorqueSolution, objective: Objective
) -> tuple[FloatArray, FloatArray]:
    """Return torque limits for commands with feedback, no wider than the solution's value."""
    most, low, high = 1.0 + AS_GOOD, problem.lower_torque, problem.upper_torque
    if isinstance(objective, TorqueShare):
        share = most * solution.value
        low, high = share * low, share * high
    # The reported largest torque is that of all members, whatever is optimised.
    largest = most * solution.max_torque
    return np.maximum(low, -largest), np.minimum(high, largest)


def further_forces(robust: RobustSolution) -> FloatArray | None:
    """Return contact forces of the corners that were not in the joined problem.

    Args:
        robust: A solution with torques.

    Returns:
        (K - J, M, 3) N, of `RobustSolution.members` from the solution's J on; None: corners may
        need modes of their own.

    Raises:
        NoSolutionError: If nothing was found, or there are no such forces.
    """
    solution, first = robust.solution, robust.members[0]
    others = robust.members[len(robust.contact_forces) :]
    mode = mode_of_member(solution.given_mode, first)
    if others and mode is None and solution.rules.static_friction is not StaticFriction.COULOMB:
        return None
    directions = feedback_torques(first.problem, robust.feedback)
    most = _limits_for_feedback(first.problem, solution, solution.objective)
    under = (under_limits(one, robust.torques, directions, most) for one in others)
    options = SolveOptions(rules=solution.rules)
    found = [solve_problem(one, Margin(), options, mode=mode).contact_forces for one in under]
    return np.array(found).reshape(-1, *first.problem.positions.shape)


def contact_radii(
    problem: QuasistaticProblem, uncertainty: Uncertainty, slopes: FloatArray | None
) -> FloatArray:
    """Return (M,) radii, m, within which each contact may be moved in its tangent plane.

    Args:
        problem: The nominal one.
        uncertainty: The set.
        slopes: See `moved_members`.

    Raises:
        ArgumentError: If there are figures for another number of contacts or by name, or the effect
            of moved contacts on the load or on joints is not known.
    """
    radii = each_of(
        "contact_position", uncertainty.contact_position, problem.contact_count, "contacts"
    )
    moved = radii > 0.0
    if moved.any() and problem.wrench_matrix is not None:
        raise ArgumentError(
            "contact_position", "requires one free object, but the problem has a wrench_matrix"
        )
    if slopes is None and problem.jacobian.reshape(len(radii), -1)[moved].any():
        raise ArgumentError(
            "contact_position",
            "moves contacts of joints, but arrays do not state how their Jacobian changes; use a "
            "scene, or give 0 for these contacts",
        )
    return radii


def moved_members(
    members: Sequence[Member],
    radii: FloatArray,
    slopes: FloatArray | None,
    rng: np.random.Generator,
    count: int,
    *,
    stiffness: FloatArray | None = None,
    far: bool = False,
) -> list[Member]:
    """Return members, drawn at random, with all contacts moved at random.

    Normals and sliding velocities stay.

    Args:
        members: Members to draw from, with contacts at their nominal positions.
        radii: (M,) m, radius of each contact in its tangent plane.
        slopes: (3, 3M, L) change of the Jacobian per m of motion of the contacts along each world
            axis; None: none.
        rng: Random number generator.
        count: Number of members.
        stiffness: (L,) stiffness of joints with feedback, N m/rad (N/m); None: no feedback.
        far: Whether contacts are moved by their full radii; else uniformly within them.
    """
    drawn = []
    for number in rng.integers(len(members), size=count).tolist():
        member = members[number]
        problem = member.problem
        angles = rng.uniform(0.0, 2.0 * np.pi, len(radii))
        off = radii * (1.0 if far else np.sqrt(rng.uniform(size=len(radii))))
        within = off[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        moved = np.einsum("lij,lj->li", problem.tangents, within)
        jacobian = problem.jacobian
        if slopes is not None:
            jacobian = jacobian + np.einsum("kal,ak->al", slopes, np.repeat(moved, 3, axis=0))
        elsewhere = problem.with_changes(positions=problem.positions + moved, jacobian=jacobian)
        change = f"contacts moved by up to {1000.0 * off.max():.3g} mm"
        words = change if member.words == "nominal" else f"{member.words}, {change}"
        own = feedback_torques(elsewhere, stiffness)
        drawn.append(replace(member, problem=elsewhere, words=words, moved=moved, directions=own))
    return drawn
