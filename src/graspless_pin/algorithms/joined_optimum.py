"""The best torques for some members together, their bound, and members in conflict.

Members may have one mode of virtual sliding in common. Then all sets of forces have that mode: the
search over modes of one member bounds the program of all, and takes about as many nodes as for one
member.

Given torques serve a member if its largest margin under them is large enough. Members mostly differ
in their loads alone: then their programs differ in right-hand sides, and the simplex method goes on
from one to the next with a few pivots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from graspless_pin.algorithms.branch_and_bound import search_modes
from graspless_pin.algorithms.force_policy import far_apart
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.robust_solution import Coverage
from graspless_pin.algorithms.search_state import SearchState
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.modes.kinematics import THRESHOLD, VirtualKinematics
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member, join_members, loads_under_commands, under_commands
from graspless_pin.problem.scales import coordinate_units
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.records import changed
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.solvers import PRIMAL_TOLERANCE
from graspless_pin.solvers.simplex import Simplex, SimplexOutcome
from graspless_pin.tree_search import Limits

_CLEAR = 1.001
"""Factor on the threshold: slower motions may be refused for all members together."""


def common_mode(
    together: QuasistaticProblem,
    members: Sequence[Member],
    objective: Objective,
    options: SolveOptions,
) -> SlidingMode | None:
    """Return the mode in which all members together have the best optimum.

    Args:
        together: Their joined problem.
        members: They differ in loads, coefficients of friction and the motors' response to
            commands, and so have the same virtual motions.
        objective: What is optimised.
        options: How the modes are searched; a sign rule other than ``direction``.

    Returns:
        The best mode, of one member; None: there is none, or it was not found within the limits.
    """
    whole, own = formulate(together, objective), formulate(members[0].problem, objective)
    size, count = own.coordinates.layout.size, len(members)
    layered = replace(
        own,
        kinematics=common_motions(own.problem, count),
        program=whole.program,
        signed_unit=whole.signed_unit,
        layers=tuple(size * number for number in range(count)),
    )
    state = SearchState(layered, options, Limits.from_options(options))
    search_modes(state)
    return state.mode


def common_motions(problem: QuasistaticProblem, count: int) -> VirtualKinematics:
    """Return the virtual motions of a mode that a number of members has in common.

    In a mode of the joined problem all members move at once, which multiplies the length of all
    contact velocities by sqrt(count), and so the threshold.
    """
    return VirtualKinematics(problem, _CLEAR * THRESHOLD * math.sqrt(count))


def mode_of_all(mode: SlidingMode, count: int) -> SlidingMode:
    """Return the mode of the joined problem of a number of members that all have one mode."""
    selection = mode.selection.tolist() * count
    return SlidingMode(selection, mode.signs.tolist() * count)


def mode_of_member(mode: SlidingMode | None, member: Member) -> SlidingMode | None:
    """Return the mode of the first member in a mode of a joined problem; None: there is none.

    Args:
        mode: The mode of a joined problem, or of one member.
        member: One of the members.
    """
    size = member.problem.contact_count
    return None if mode is None else SlidingMode(mode.selection[:size], mode.signs[:size])


COMMON_NODES, NODES = 400, 12
"""Node limits of the searches over common modes, and over modes of each member, unless another
limit is given."""
AS_GOOD = 1e-6
"""Over an optimum, or over the load: values that differ by less are equal."""
_FEW = 2
"""Number of members of the first trial; it doubles from trial to trial."""


def best_torques(
    members: Sequence[Member],
    objective: Objective,
    options: SolveOptions,
    directions: FloatArray | None,
    mode: SlidingMode | None,
) -> tuple[TorqueSolution, Coverage]:
    """Return the best torques for some members, and the set that they serve.

    Args:
        members: The members.
        objective: What is optimised.
        options: How problems are solved.
        directions: What feedback may add to commands, see `feedback_torques`.
        mode: The one mode for all; None: the best common mode, if there is one.
    """
    together = join_members(members, directions)
    convex = len(members) == 1 or options.rules.static_friction is StaticFriction.COULOMB
    if mode is None and not convex:
        if not options.rules.by_direction:
            mode = common_mode(together, members, objective, node_limited(options, COMMON_NODES))
        if mode is None:
            return solve_problem(
                together, objective, node_limited(options, NODES)
            ), Coverage.CORNERS
    every = None if mode is None else mode_of_all(mode, len(members))
    return solve_problem(together, objective, options, mode=every), Coverage.WHOLE_SET


def node_limited(options: SolveOptions, nodes: int) -> SolveOptions:
    """Return options with a node limit, unless they have one."""
    return options if options.node_limit else replace(options, node_limit=nodes)


def torques_bound(
    solution: TorqueSolution,
    members: Sequence[Member],
    objective: Objective,
    options: SolveOptions,
    mode: SlidingMode | None,
) -> float:
    """Return a bound on the objective for all members together, whatever their modes.

    It is the optimum under plain Coulomb friction, or that of a single member if it is worse.

    Args:
        solution: The best solution for all together, in one mode if there is one.
        members: The members.
        objective: What is optimised.
        options: How problems are solved.
        mode: The one mode for all, if it was given: then the bound is that of this mode.

    Returns:
        The bound in the objective's unit; NaN where it is proven that there are no torques.
    """
    if not solution.found:
        open_ = solution.status is Status.NOT_FOUND_IN_LIMIT
        return solution.certificate.bound if open_ else math.nan
    if mode is not None or solution.given_mode is None:
        return solution.certificate.bound
    rules = replace(options.rules, static_friction=StaticFriction.COULOMB)
    best = max if not objective.maximizes else min
    relaxed = replace(options, rules=rules)
    bound = solve_problem(solution.problem, objective, relaxed).certificate.bound
    for member in members:
        if abs(solution.value - bound) <= AS_GOOD * max(abs(bound), abs(solution.value)):
            break
        bound = best(
            bound, solve_problem(join_members([member]), objective, options).certificate.bound
        )
    return bound


def far_members(
    members: Sequence[Member], most: int, *, held: int = 1
) -> tuple[list[Member], list[Member]]:
    """Return members far from each other, by farthest-point sampling, and the remaining ones.

    Args:
        members: K members.
        most: Number of members to choose.
        held: Number of members at the beginning that are chosen anyway; feedback counts from the
            first one.
    """
    if len(members) <= most:
        return list(members), []
    problem = members[0].problem
    sizes = coordinate_units(problem.scales, problem.passive_units)
    still = np.zeros(problem.joint_count)
    points = np.array([
        np.concatenate([member.problem.external_wrench, member.commanded(still)]) / sizes
        for member in members
    ])  # fmt: skip
    from_mean = np.linalg.norm(points - points.mean(axis=0), axis=1)
    chosen = far_apart(points, range(held), most, from_mean)
    others = [member for number, member in enumerate(members) if number not in set(chosen)]
    return [members[number] for number in chosen], others


def without_forces(solution: TorqueSolution, status: Status) -> TorqueSolution:
    """Return a solution without its torques, as they do not serve all members, or may not."""
    return changed(solution, status=status, _forces=None, _mode=None)


def minimal_conflict(
    refuted: TorqueSolution,
    members: Sequence[Member],
    objective: Objective,
    options: SolveOptions,
    limits: Limits,
    directions: FloatArray | None,
) -> tuple[int, ...]:
    """Return an irreducible set of members that no torques serve together; empty: none is proven.

    Members are added in an order that the multipliers of the proof (Farkas) give, until some are
    refuted; a deletion filter (Chinneck) removes those that are not needed. Under Coulomb's law at
    most rank(J) + 1 are left, by Helly.

    Args:
        refuted: The answer to their joined problem.
        members: The members of that problem.
        objective: What is optimised.
        options: How problems are solved.
        limits: When to stop: then the conflict is empty.
        directions: What feedback may add to commands, see `feedback_torques`.
    """
    if refuted.status is not Status.INFEASIBLE_FORCES:
        return ()
    coulomb = replace(options, rules=replace(options.rules, static_friction=StaticFriction.COULOMB))

    # Where contacts are moved, deflections are measured from the nominal member.
    from_nominal = directions is not None and any(one.moved is not None for one in members)
    fixed = {0} if from_nominal else set[int]()

    def are_refuted(numbers: list[int]) -> bool:
        """Return whether it is proven that no torques serve some members together."""
        together = join_members([members[one] for one in numbers], directions)
        found = solve_problem(together, objective, limits.with_time_left(coulomb))
        return found.status is Status.INFEASIBLE_FORCES

    order, count = _conflict_order(refuted, members), _FEW
    order = [*fixed, *(one for one in order if one not in fixed)]
    while count < len(order) and not are_refuted(sorted(order[:count])) and not limits.is_time_over:
        count *= 2
    conflict = sorted(order[:count])
    for number in tuple(conflict):
        fewer = [one for one in conflict if one != number]
        if fewer and number not in fixed and not limits.is_time_over and are_refuted(fewer):
            conflict = fewer
    return () if limits.is_time_over else tuple(conflict)


def _conflict_order(refuted: TorqueSolution, members: Sequence[Member]) -> list[int]:
    """Return members' numbers: the largest multipliers first, then those farthest from them.

    Loads along a motion that no contact resists have multipliers of opposite signs.
    """
    count, passive = len(members), members[0].problem.passive_count
    if refuted.evidence.relaxation is None:
        return [*range(count)]
    y = refuted.evidence.relaxation[0][: count * passive].reshape(count, passive)
    largest = y[np.abs(y).max(axis=1).argmax()]
    first = (y == largest).all(axis=1)
    distances = np.where(first, np.inf, np.linalg.norm(y - largest, axis=1))
    return np.argsort(-distances, kind="stable").tolist()


_NEAR = 0.1 * PRIMAL_TOLERANCE
"""Largest unbalanced load that pivots may leave, over the load."""


def member_margins(
    members: Sequence[Member],
    commanded: FloatArray,
    options: SolveOptions,
    limits: Limits,
    *,
    directions: FloatArray | None = None,
    torque_limits: tuple[FloatArray, FloatArray] | None = None,
    mode: SlidingMode | None = None,
    enough: float = math.inf,
) -> FloatArray:
    """Return the largest margin of each member under commanded torques, N.

    Args:
        members: K members.
        commanded: (L,) commanded torques, N m (N).
        options: How margins are looked for.
        limits: When to stop; members that were not reached have NaN.
        directions: What feedback may add, see `feedback_torques`.
        torque_limits: (lower, upper), each (L,), limits of commands with feedback; None: each
            member's own.
        mode: The one mode of all margins; None: any.
        enough: N; larger margins may be returned as this value.

    Returns:
        (K,) margins, below zero or -inf where no forces in the cones balance.
    """
    margins = np.full(len(members), np.nan)
    open_members = np.ones(len(members), dtype=bool)
    if mode is not None or options.rules.static_friction is StaticFriction.COULOMB:
        for group in _load_groups(members):
            if limits.is_time_over:
                break
            alike = [members[number] for number in group]
            loads = loads_under_commands(alike, commanded, directions)
            carried = np.array([one.commanded(np.zeros_like(commanded)) for one in alike])
            margins[group] = _margins_by_pivots(
                under_limits(alike[0], commanded, directions, torque_limits),
                loads,
                carried,
                limits,
                mode,
                enough,
            )
            open_members[group] = np.isnan(margins[group])
    for number in np.flatnonzero(open_members).tolist():
        if limits.is_time_over:
            break
        under = under_limits(members[number], commanded, directions, torque_limits)
        solution = solve_problem(under, Margin(), options, mode=mode)
        margins[number] = solution.margin if solution.found else -math.inf
    return margins


def under_limits(
    member: Member,
    commanded: FloatArray,
    directions: FloatArray | None,
    torque_limits: tuple[FloatArray, FloatArray] | None,
) -> QuasistaticProblem:
    """Return a member's problem under commanded torques; arguments as of `member_margins`."""
    problem = under_commands(member, commanded, directions)
    if directions is None or torque_limits is None:
        return problem
    return problem.with_changes(torque_limits=torque_limits)


def _load_groups(members: Sequence[Member]) -> list[list[int]]:
    """Return the numbers of members, grouped so that members of a group differ in loads alone."""
    groups: dict[bytes, list[int]] = {}
    for number, one in enumerate(members):
        problem = one.problem
        key = np.concatenate(
            [one.factors, problem.friction, problem.lower_torque, problem.upper_torque]
            + ([] if one.moved is None else [one.moved.ravel()])
        )
        groups.setdefault(key.tobytes(), []).append(number)
    return list(groups.values())


def _margins_by_pivots(
    problem: QuasistaticProblem,
    loads: FloatArray,
    carried: FloatArray,
    limits: Limits,
    mode: SlidingMode | None,
    enough: float,
) -> FloatArray:
    """Return the margins of problems that differ in their loads alone; NaN where that fails.

    Args:
        problem: One of the problems.
        loads: (K, Q) load of each problem.
        carried: (K, L) torques of the motors besides those of contacts, N m (N).
        limits: When to stop.
        mode: See `member_margins`.
        enough: See there.
    """
    margins = np.full(len(loads), np.nan)
    formulation = formulate(problem, Margin())
    program = formulation.program
    if program.cone_count:
        return margins
    unit, margin = formulation.coordinates.force_scale, program.column("margin")
    lb, ub = formulation.bounds_of(mode)
    ub = ub.copy()
    ub[margin] = min(program.box[1, margin], enough / unit)
    lows, highs = (np.tile(side, (len(loads), 1)) for side in program.sides)
    blocks = {block.name: block for block in program.blocks}
    balance, torque = blocks["balance"], blocks["torque"]
    lows[:, balance.at] = highs[:, balance.at] = -loads / balance.unit
    if problem.joint_count:
        lows[:, torque.at] = (problem.lower_torque - carried) / torque.unit
        highs[:, torque.at] = (problem.upper_torque - carried) / torque.unit
    # Torques have the rounding of a solve; dependent rows would then be infeasible.
    tolerance = np.zeros(len(program.rows))
    tolerance[balance.at] = _NEAR
    simplex = Simplex(program.c, lb, ub)
    simplex.add_rows(program.rows, *program.sides)
    every = np.arange(len(program.rows), dtype=np.int32)
    found = np.zeros((len(loads), len(program.c)))
    for number in range(len(loads)):
        if limits.is_time_over:
            break
        simplex.set_sides(every, lows[number] - tolerance, highs[number] + tolerance)
        answer = simplex.solve()
        if answer.is_optimal:
            found[number], margins[number] = answer.x, unit * answer.x[margin]
        elif answer.outcome is SimplexOutcome.INFEASIBLE:
            margins[number] = -math.inf
    # Forces are checked with each member's own constraints, whatever the method reports.
    rows = found @ program.rows.T
    beyond = np.maximum(rows - highs, lows - rows)
    if program.strict is not None:
        beyond *= program.strict
    broken = beyond.max(axis=1, initial=0.0) > PRIMAL_TOLERANCE
    margins[broken & np.isfinite(margins)] = np.nan
    return margins
