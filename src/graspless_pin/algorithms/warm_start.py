"""Searches that begin with the mode of an earlier, similar problem.

The first node of every search is the relaxation. Where its friction has no motion behind it, the
earlier mode's own program comes next: in a neighbouring state it is mostly as good, and then two
programs are all. Otherwise its value is what branch and bound has to beat, so that the answer
never depends on the mode that the search began with.
"""

from __future__ import annotations

from dataclasses import replace

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.explanation import explain
from graspless_pin.algorithms.formulation import Objective, formulate
from graspless_pin.algorithms.search import CLOSED, SearchResult, SearchState, finished
from graspless_pin.algorithms.solve import solution_of
from graspless_pin.algorithms.torque import margin_objective
from graspless_pin.modes.enumeration import requirements_of
from graspless_pin.modes.rules import Rules, SlidingMode, candidate_contacts
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import real_number
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.solvers import Answer, Outcome


def solve_from(
    problem: QuasistaticProblem,
    objective: Objective,
    rules: Rules,
    start: SlidingMode | None,
    *,
    solver: str = "piqp",
    node_limit: int | None = None,
    time_limit: float | None = None,
) -> TorqueSolution:
    """Solve a problem as `solve_problem` does, trying an earlier mode first.

    Args:
        problem: Contacts, wrench, joints and limits.
        objective: Algorithm 1 or 2 with its figures.
        rules: The reading of the virtual-sliding constraint.
        start: Mode of a similar problem with the same contacts; None: none is known.
        solver: The solver to ask first.
        node_limit: Limit of branch and bound.
        time_limit: Limit of branch and bound, s.
    """
    state = _WarmState(formulate(problem, objective), rules, solver)
    result = _search(state, start, node_limit=node_limit, time_limit=time_limit)
    return solution_of(result, objective, rules, explain)


def reaches_margin(
    problem: QuasistaticProblem,
    margin: float,
    rules: Rules,
    start: SlidingMode | None,
    *,
    solver: str = "piqp",
    node_limit: int | None = None,
    time_limit: float | None = None,
) -> tuple[bool | None, SlidingMode | None]:
    """Decide whether any feasible mode reaches a margin, with the first proof either way.

    A relaxation whose bound is below the margin proves that none does. A mode that reaches it is
    looked for in the relaxation's friction, then in the earlier mode, and then by branch and bound
    on Algorithm 1 with e <= margin: there the first mode that reaches it is optimal.

    Args:
        problem: Contacts, wrench, joints and limits.
        margin: The margin to reach, N.
        rules: The reading of the virtual-sliding constraint.
        start: Mode of a similar problem with the same contacts; None: none is known.
        solver: The solver to ask first.
        node_limit: Limit of branch and bound.
        time_limit: Limit of branch and bound, s.

    Returns:
        Whether it is reached, None if a limit ended the search before a proof; and the mode that
        reaches it.

    Raises:
        ArgumentError: If the margin is negative.
    """
    required = real_number("margin", margin, 0.0)
    full = formulate(problem, margin_objective())
    goal = required / full.coordinates.force_scale
    state = _WarmState(replace(full, cutoff=-goal), rules, solver)
    relaxation = state.relax()
    if relaxation.outcome is Outcome.INFEASIBLE:
        return False, None
    if relaxation.outcome is Outcome.SOLVED:
        for attempt in (_read_mode, _try_mode):
            attempt(state, start)
            if state.best_value <= CLOSED - goal:
                return True, state.mode
    ub = full.program.ub.copy()
    ub[-1] = goal
    capped = replace(full, program=full.program.bounded(full.program.lb, ub), cutoff=-goal)
    result = branch_and_bound(
        SearchState(capped, rules, solver), node_limit=node_limit, time_limit=time_limit
    )
    if result.state.best is not None:
        return True, result.state.mode
    undecided = result.status in (Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED)
    return (None if undecided else False), None


class _WarmState(SearchState):
    """A search whose relaxation may have been solved before branch and bound begins."""

    def relax(self) -> Answer:
        """Return the relaxation's answer, solved once."""
        return super().relax() if self.relaxation is None else self.relaxation


def _search(
    state: _WarmState,
    start: SlidingMode | None,
    *,
    node_limit: int | None,
    time_limit: float | None,
) -> SearchResult:
    relaxation = state.relax()
    if start is not None and relaxation.outcome is Outcome.SOLVED:
        for attempt in (_read_mode, _try_mode):
            attempt(state, start)
            if state.closed(relaxation.bound):
                state.nodes = state.modes_examined = 1
                return finished(state)
    return branch_and_bound(state, node_limit=node_limit, time_limit=time_limit)


def _read_mode(state: SearchState, _start: SlidingMode | None) -> None:
    """Keep the relaxation's own optimum, if a feasible mode admits its friction."""
    relaxation = state.relaxation
    if relaxation is not None:
        verdict = state.reader.read(relaxation.x, {})
        if isinstance(verdict, SlidingMode):
            state.accept(relaxation, verdict)


def _try_mode(state: SearchState, start: SlidingMode | None) -> None:
    """Keep the optimum of the earlier mode, if the problem has it and a motion stands behind it."""
    if start is None:
        return
    problem = state.formulation.problem
    stray = start.selection & ~candidate_contacts(problem, state.rules)
    if len(start.selection) != problem.contact_count or stray.any():
        return
    state.reader.kinematic_programs += 1
    if not state.formulation.kinematics.feasible(requirements_of(start), state.rules.sign):
        return
    answer = state.solve(*state.formulation.bounds_of(start))
    if answer.outcome is Outcome.SOLVED and answer.value < state.best_value:
        state.best, state.mode = answer, start
