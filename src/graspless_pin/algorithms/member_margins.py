"""Which members of a set given torques serve: the largest margin of each under them.

Members mostly differ in their loads alone: then their programs differ in right-hand sides, and the
simplex method goes on from one to the next with a few pivots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.options import Limits, SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member, loads_under_commands, under_commands
from graspless_pin.programs.objectives import Margin
from graspless_pin.solvers import PRIMAL_TOLERANCE
from graspless_pin.solvers.simplex import Simplex, SimplexOutcome

_NEAR = 0.1 * PRIMAL_TOLERANCE
"""Of the load: what pivots may leave unbalanced."""


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
        members: K of them.
        commanded: (L,) N m (N).
        options: How margins are looked for.
        limits: When to stop; the members that were not looked at have NaN.
        directions: What feedback may add, see `feedback_torques`.
        torque_limits: (lower, upper), each (L,), of what may be commanded with feedback; None: each
            member's own.
        mode: The one mode in which they are; None: any.
        enough: N; of larger margins it is only told that they are no smaller.

    Returns:
        (K,) margins, below zero or -inf where no forces in the cones balance.
    """

    def under(number: int) -> QuasistaticProblem:
        problem = under_commands(members[number], commanded, directions)
        if directions is None or torque_limits is None:
            return problem
        return problem.with_changes(torque_limits=torque_limits)

    margins = np.full(len(members), np.nan)
    open_members = np.ones(len(members), dtype=bool)
    if mode is not None or options.rules.static_friction is StaticFriction.COULOMB:
        for group in _alike(members):
            alike = [members[number] for number in group]
            loads = loads_under_commands(alike, commanded, directions)
            carried = np.array([one.commanded(np.zeros_like(commanded)) for one in alike])
            margins[group] = _by_pivots(under(group[0]), loads, carried, limits, mode, enough)
            open_members[group] = np.isnan(margins[group])
    for number in np.flatnonzero(open_members).tolist():
        if limits.passed:
            break
        solution = solve_problem(under(number), Margin(), options, mode=mode)
        margins[number] = solution.margin if solution.found else -math.inf
    return margins


def _alike(members: Sequence[Member]) -> list[list[int]]:
    """Return the numbers of members that differ in their loads alone, group by group."""
    groups: dict[bytes, list[int]] = {}
    for number, one in enumerate(members):
        problem = one.problem
        key = np.concatenate(
            [one.factors, problem.friction, problem.lower_torque, problem.upper_torque]
            + ([] if one.moved is None else [one.moved.ravel()])
        )
        groups.setdefault(key.tobytes(), []).append(number)
    return list(groups.values())


def _by_pivots(
    problem: QuasistaticProblem,
    loads: FloatArray,
    carried: FloatArray,
    limits: Limits,
    mode: SlidingMode | None,
    enough: float,
) -> FloatArray:
    """Return the margins of problems that differ in their loads alone; NaN where that fails.

    Args:
        problem: One of them.
        loads: (K, Q) of each.
        carried: (K, L) what motors bear besides the contacts, N m (N).
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
    lb, ub = (program.lb, program.ub.copy()) if mode is None else formulation.bounds_of(mode)
    ub[margin] = min(program.box[1, margin], enough / unit)
    lows, highs = (np.tile(side, (len(loads), 1)) for side in program.sides)
    blocks = {block.name: block for block in program.blocks}
    balance, torque = blocks["balance"], blocks["torque"]
    lows[:, balance.at] = highs[:, balance.at] = -loads / balance.unit
    if problem.joint_count:
        lows[:, torque.at] = (problem.lower_torque - carried) / torque.unit
        highs[:, torque.at] = (problem.upper_torque - carried) / torque.unit
    # Torques are as exact as a solve left them; where rows depend on each other, none fit exactly.
    near = np.zeros(len(program.rows))
    near[balance.at] = _NEAR
    simplex = Simplex(program.c, lb, ub)
    simplex.add_rows(program.rows, lows[0] - near, highs[0] + near)
    every = np.arange(len(program.rows), dtype=np.int32)
    found = np.zeros((len(loads), len(program.c)))
    for number in range(len(loads)):
        if limits.passed:
            break
        simplex.set_sides(every, lows[number] - near, highs[number] + near)
        answer = simplex.solve()
        if answer.is_optimal:
            found[number], margins[number] = answer.x, unit * answer.x[margin]
        elif answer.outcome is SimplexOutcome.INFEASIBLE:
            margins[number] = -math.inf
    # No word of the method is believed: forces are held against each member's own constraints.
    rows = found @ program.rows.T
    beyond = np.maximum(rows - highs, lows - rows)
    if program.strict is not None:
        beyond *= program.strict
    broken = beyond.max(axis=1, initial=0.0) > PRIMAL_TOLERANCE
    margins[broken & np.isfinite(margins)] = np.nan
    return margins
