"""Search by one mixed-integer program given to HiGHS: an independent cross-check."""

from __future__ import annotations

import numpy as np

from graspless_pin.algorithms.search import SearchResult, SearchState, finished
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.enumeration import requirements_of
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.programs.mode_program import mode_program
from graspless_pin.solution import Status
from graspless_pin.solvers import Outcome, solve_mixed_integer


def search_mixed_integer(state: SearchState, *, time_limit: float | None = None) -> SearchResult:
    """Find the optimum over all feasible modes with HiGHS' MILP, then certify its mode.

    The MILP's forces are not believed: its mode is checked for a virtual motion and solved again
    as a program of its own. The bound over all modes is HiGHS' word.

    Raises:
        ArgumentError: With a regularisation: the program must be linear.
    """
    formulation = state.formulation
    if not formulation.program.is_linear:
        raise ArgumentError("search", "'milp' takes no regularization; use 'auto' or 'enumerate'")
    answer = state.relax()
    state.nodes = 1
    if answer.outcome is not Outcome.SOLVED:
        failed = answer.outcome is Outcome.FAILED
        return SearchResult(Status.UNVERIFIED if failed else Status.INFEASIBLE_FORCES, state)
    if state.rules.static_friction is StaticFriction.COULOMB:
        state.best, state.mode = answer, state.reader.describe(answer.x)
        return finished(state)
    program = mode_program(
        formulation.problem,
        formulation.coordinates,
        formulation.program,
        formulation.kinematics.rows,
        state.rules,
    )
    x, bound, completed = solve_mixed_integer(program, time_limit)
    state.modes_examined = 1
    if x is None:
        return finished(state, interrupted=not completed)
    mode = program.mode(x)
    state.reader.kinematic_programs += 1
    if not formulation.kinematics.feasible(requirements_of(mode), state.rules.sign):
        return SearchResult(Status.UNVERIFIED, state)
    certified = state.solve(*formulation.bounds_of(mode))
    if certified.outcome is Outcome.SOLVED:
        state.best, state.mode = certified, mode
    if np.isfinite(bound):
        state.raise_bound(bound)
    return finished(state, interrupted=not completed)
