"""Search over the modes in the way that the options ask for."""

from __future__ import annotations

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.direction_search import search_directions
from graspless_pin.algorithms.exhaustive import search_exhaustively
from graspless_pin.algorithms.limits import Limits
from graspless_pin.algorithms.options import Search, SolveOptions
from graspless_pin.algorithms.search import SearchResult, SearchState, undecided
from graspless_pin.errors import UndecidedMotionError


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
