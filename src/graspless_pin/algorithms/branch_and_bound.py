"""Best-first branch and bound over parts of all modes, driven by kinematic conflicts.

Branch and bound as of Land and Doig (Econometrica 28(3), 1960). The conflicts play the part of
combinatorial Benders cuts (Codato and Fischetti, Oper. Res. 54(4), 2006): an infeasible set of
kinematic conditions tells which decisions cannot stand together. A node is a part of all modes, and
its program the relaxation with the friction that they allow. If no feasible mode admits the
friction of its optimum, the kinematics name a conflict: items "contact l virtually slides with sign
s along t_m" and "contact l is selected" that exclude each other. At least one of them must give
way, and each child lets another one. A document's proof bounds and splits the same parts
(`solution_proof`).

`search_modes` chooses: branch and bound, the search over directions, or enumeration, which is the
relaxation first and then every maximal mode.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.algorithms.direction_search import search_directions
from graspless_pin.algorithms.mode_oracle import FoundMode
from graspless_pin.algorithms.mode_tree import ModePart, ModeTree
from graspless_pin.algorithms.options import Search
from graspless_pin.algorithms.search_state import (
    Fathomed,
    SearchState,
    Split,
    best_first,
    optimality_tolerance,
    unsolved,
)
from graspless_pin.errors import OverrunError, UndecidedMotionError
from graspless_pin.modes.kinematics import feasible_modes
from graspless_pin.modes.rules import SignRule
from graspless_pin.solution import Status
from graspless_pin.solvers import Answer, Outcome

_GUESS_EVERY = 8
"""A mode is guessed at the first conflict and at each so many after it."""
_GUESSES = 2


def branch_and_bound(state: SearchState) -> Status:
    """Find the optimum over all feasible modes with a proven bound, from the relaxation on."""
    answer = state.relax()
    if answer.outcome is not Outcome.SOLVED:
        return unsolved(answer, Status.INFEASIBLE_FORCES)
    tree = ModeTree(state.formulation, state.rules)

    def expand(part: ModePart, before: float) -> Fathomed | Split[ModePart]:
        state.oracle.kinematic_programs += int(part.selected.any())
        if tree.exclusion(part) is not None:
            return Split(before, [])  # no mode is in it
        answer = state.solve(*tree.bounds(part))
        state.nodes += 1
        if answer.outcome is Outcome.FAILED:
            return Fathomed(max(before, answer.bound))
        return _split(state, tree, part, answer, before)

    every = ModePart.every_mode(state.formulation.problem, state.rules)
    root = _split(state, tree, every, answer, -np.inf)
    status, state.cover = best_first(state, root, expand, state.closed)
    return status


def _guess(state: SearchState, answer: Answer) -> None:
    """Look for a good mode near the friction of an answer: often it is as good as the answer.

    An interior-point optimum has friction everywhere, so where many forces are optimal its own
    friction is rarely the one that a motion stands behind.
    """
    x = answer.x
    for _ in range(_GUESSES):
        found = state.oracle.heuristic_mode(x)
        if found is None or found.mode == state.mode:
            return  # it is the best already
        guess = state.solve(*state.formulation.bounds_of(found.mode))
        if guess.outcome is not Outcome.SOLVED or guess.value >= state.best_value:
            return
        state.keep(guess, found)
        if state.closed(answer.bound):
            return
        x = guess.x


def _split(
    state: SearchState, tree: ModeTree, part: ModePart, answer: Answer, before: float
) -> Fathomed | Split[ModePart]:
    """Keep the optimum of a part if a mode admits it; otherwise split the part."""
    fathomed = Fathomed(answer.bound)
    if answer.outcome is not Outcome.SOLVED or state.closed(answer.bound):
        return fathomed
    x = tree.within(part, answer.x)
    found = state.oracle.mode_for(x, state.near)
    state.modes_examined += 1
    if isinstance(found, FoundMode):
        if state.offer(answer, found):
            return fathomed
        found = None
    elif state.modes_examined % _GUESS_EVERY == 1:
        _guess(state, answer)
        if state.closed(answer.bound):
            return fathomed
    # What else the part knows of its modes may exclude them, where the friction alone does not.
    conflict = state.oracle.conflict_for(x, part) if found is None else found
    split = tree.split(part, x, conflict)
    if split is None:
        # It is one mode, which has a motion behind it, and the answer is its own program's.
        state.offer(answer, FoundMode(part.mode), x)
        return fathomed
    children = split[1]
    if state.rules.sign is SignRule.EXACT:
        # Where a contact may slide along one tangent alone, children that release contacts lead
        # nowhere, one after the other. Those that change a sign are visited before them: the
        # search visits the last child first.
        children = sorted(children, key=lambda child: -np.count_nonzero(child.released))
    # Where a mode is as good as the relaxation, the bounds of all nodes are equal but for rounding,
    # which would lead the search from one to another instead of down to an answer.
    rises = answer.bound > before + 0.5 * optimality_tolerance(before)
    return Split(answer.bound if rises else before, children)


def search_exhaustively(state: SearchState) -> Status:
    """Find the optimum over all feasible modes by solving every maximal one.

    The relaxation's optimum is the answer whenever a feasible mode admits its friction; otherwise
    the maximal modes are solved one by one, since a smaller mode allows no other force. They count
    as nodes.
    """
    answer, limits = state.relax(), state.limits
    if answer.outcome is not Outcome.SOLVED:
        return unsolved(answer, Status.INFEASIBLE_FORCES)
    found = state.oracle.mode_for(answer.x)
    state.modes_examined = 1
    if isinstance(found, FoundMode) and state.offer(answer, found):
        return state.ended()
    smallest = np.inf
    modes = feasible_modes(
        state.formulation.problem, state.formulation.kinematics, state.rules, maximal=True,
        is_over=lambda _: limits.passed,
    )  # fmt: skip
    try:
        for listed in modes:
            if limits.end(state.nodes):
                return state.ended(interrupted=True)
            state.nodes += 1
            state.modes_examined += 1
            answer = state.solve(*state.formulation.bounds_of(listed))
            smallest = min(smallest, answer.bound)
            if answer.outcome is Outcome.SOLVED and answer.value < state.best_value:
                state.keep(answer, FoundMode(listed))
            if state.closed(state.bound):
                return state.ended()
    except OverrunError:  # while modes were listed
        return state.ended(interrupted=True)
    state.raise_bound(smallest)
    return state.ended()


def search_modes(state: SearchState) -> Status:
    """Find the optimum over all feasible modes, to be kept in the state; return how that ended.

    Raises:
        ArgumentError: If the rule of directions does not take the objective or the search.
    """
    try:
        if state.options.search is Search.ENUMERATE:
            state.rules.need_signs("search='enumerate'")
            return search_exhaustively(state)
        return (search_directions if state.rules.by_direction else branch_and_bound)(state)
    except UndecidedMotionError:
        return state.undecided()
