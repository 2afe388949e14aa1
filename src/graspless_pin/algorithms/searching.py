"""Search over the modes in the way that the options ask for.

Search by listing: the relaxation first, then every maximal mode.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.direction_search import search_directions
from graspless_pin.algorithms.options import Limits, Search, SolveOptions
from graspless_pin.algorithms.search import (
    SearchResult,
    SearchState,
    finished,
    relaxation,
    undecided,
)
from graspless_pin.errors import OverrunError, UndecidedMotionError
from graspless_pin.modes.kinematics import feasible_modes
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.solvers import Outcome


def search_exhaustively(state: SearchState, limits: Limits) -> SearchResult:
    """Find the optimum over all feasible modes by solving every maximal one.

    The relaxation's optimum is the answer whenever a feasible mode admits its friction; otherwise
    the maximal modes are solved one by one, since a smaller mode allows no other force.

    Args:
        state: The search to run.
        limits: When to stop; modes count as nodes.
    """
    answer = relaxation(state)
    if isinstance(answer, SearchResult):
        return answer
    mode = state.oracle.mode_for(answer.x)
    state.modes_examined = 1
    if isinstance(mode, SlidingMode) and state.accept(answer, mode):
        return finished(state)
    smallest = np.inf
    state.oracle.is_clear = False
    modes = feasible_modes(
        state.formulation.problem, state.formulation.kinematics, state.rules, maximal=True,
        is_over=lambda _: limits.passed,
    )  # fmt: skip
    try:
        for listed in modes:
            if limits.end(state.nodes):
                return finished(state, interrupted=True)
            state.nodes += 1
            state.modes_examined += 1
            answer = state.solve(*state.formulation.bounds_of(listed))
            smallest = min(smallest, answer.bound)
            if answer.outcome is Outcome.SOLVED and answer.value < state.best_value:
                state.keep(answer, listed)
            if state.closed(state.bound):
                return finished(state)
    except OverrunError:  # while modes were listed
        return finished(state, interrupted=True)
    state.raise_bound(smallest)
    return finished(state)


def search_modes(state: SearchState, options: SolveOptions, limits: Limits) -> SearchResult:
    """Find the optimum over all feasible modes.

    Args:
        state: The search to run.
        options: How the modes are searched.
        limits: What is left of the limits.

    Raises:
        ArgumentError: If the rule of directions does not take the objective or the search.
    """
    try:
        if state.rules.by_direction:
            if options.search is Search.ENUMERATE:
                state.rules.need_signs("search='enumerate'")
            return search_directions(state, options.direction_gap, limits)
        if options.search is Search.ENUMERATE:
            return search_exhaustively(state, limits)
        return branch_and_bound(state, limits)
    except UndecidedMotionError:
        return undecided(state)
