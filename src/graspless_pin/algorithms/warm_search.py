"""Searches that begin with the result of an earlier, similar problem.

The first node of every search is the relaxation. The earlier active constraints are mostly active
again: then no solver is needed. Where no mode admits its friction, the earlier mode's own program
comes next: in a neighbouring state it is mostly as good, and then two programs are enough.
Otherwise its value is a first cutoff for branch and bound, so the optimum never depends on the
start; only the forces may, where several are optimal.

Warm starts apply to states with the same contacts, and are stored by contacts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from graspless_pin.algorithms.batch_optimum import (
    MOST_STARTS,
    WarmOptimum,
    WarmStart,
    solution_of_optimum,
    warm_optimum,
)
from graspless_pin.algorithms.batch_programs import structure_of
from graspless_pin.algorithms.branch_and_bound import search_modes
from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.algorithms.mode_oracle import FoundMode
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search_state import SearchState, optimality_tolerance
from graspless_pin.algorithms.solve import (
    as_stable,
    solution_of,
    solve_problem,
    threshold_optima,
)
from graspless_pin.caching import Bounded
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.rules import SlidingMode, candidate_contacts, required_contacts
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, real_number
from graspless_pin.programs.active_set import ActiveSet, active_set_of, optimum_on_active_set
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.solution import UNDECIDED, Status, TorqueSolution
from graspless_pin.solvers import Answer, Outcome
from graspless_pin.tree_search import Limits

if TYPE_CHECKING:
    from graspless_pin.holding.small_motions import RestModel

COLD_START = WarmStart()


def solve_from(
    problem: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions,
    start: WarmStart = COLD_START,
    rest: RestModel | None = None,
) -> tuple[TorqueSolution, WarmStart]:
    """Solve a problem as `solve_problem` does, beginning with a warm start.

    Args:
        problem: Contacts, wrench, joints and limits.
        objective: What is optimised.
        options: How the problem is solved.
        start: Warm start of a similar problem with the same contacts.
        rest: See `solve_problem`.

    Returns:
        The solution, and the warm start for the next problem.
    """
    if options.rules.by_direction:
        return solve_problem(problem, objective, options, rest=rest), start
    limits = Limits.from_options(options)
    state = _WarmState(formulate(problem, objective), options, limits, start=start)
    try:
        status = _search_from_start(state)
    except UndecidedMotionError:
        status = state.undecided_status()
    best = solution_of(status, state, optima=threshold_optima(state, search_modes))
    return as_stable(best, options, limits, rest), state.next_start()


def reaches_margin(
    problem: QuasistaticProblem,
    margin: float,
    options: SolveOptions,
    start: WarmStart = COLD_START,
    rest: RestModel | None = None,
) -> tuple[bool | None, WarmStart]:
    """Decide whether any feasible mode reaches a margin, with the first proof either way.

    A relaxation whose bound is below the margin proves that none does. A mode that reaches it is
    looked for in the relaxation's friction, then in the earlier mode, and then by branch and bound
    on Algorithm 1 with e <= margin: there the first mode that reaches it is optimal.

    Args:
        problem: Contacts, wrench, joints and limits.
        margin: The margin to reach, N.
        options: How the problem is solved.
        start: Warm start of a similar problem with the same contacts.
        rest: See `solve_problem`.

    Returns:
        Whether it is reached, None if a limit ended the search before a proof; and the warm start
        for the next problem, with the mode that reaches it, if any.

    Raises:
        ArgumentError: If the margin is negative.
    """
    required = real_number("margin", margin, 0.0)
    if options.rules.by_direction or options.strong:
        best = solve_problem(problem, Margin(), options, rest=rest)
        if best.found and best.margin >= required:
            return True, start
        is_open = best.status in UNDECIDED or (best.found and best.certificate.bound >= required)
        return (None if is_open else False), start
    full = formulate(problem, Margin())
    goal = required / full.coordinates.force_scale
    state = _WarmState(
        replace(full, cutoff=-goal), options, Limits.from_options(options), start=start
    )
    try:
        return _decide_margin(state, full, goal)
    except UndecidedMotionError:
        return None, state.next_start()


def _decide_margin(
    state: _WarmState, full: Formulation, goal: float
) -> tuple[bool | None, WarmStart]:
    """Decide whether a scaled margin is reached; see `reaches_margin`."""
    relaxation = state.solve_relaxation()
    if relaxation.outcome is Outcome.INFEASIBLE:
        return False, state.next_start()
    if relaxation.outcome is Outcome.SOLVED:
        for attempt in (_keep_relaxation_if_admitted, _keep_optimum_of_start_mode):
            attempt(state)
            if state.best_value <= optimality_tolerance(goal) - goal:
                return True, state.next_start()
    capped = replace(full.capped("margin", goal), cutoff=-goal)
    search = SearchState(capped, state.options, state.limits)
    status = search_modes(search)
    if search.best is not None:
        return True, replace(state.next_start(), mode=search.mode, in_mode=None)
    return None if status in UNDECIDED else False, state.next_start()


@dataclass
class _WarmState(SearchState):
    """A search with a warm start.

    Attributes:
        start: Warm start of a similar problem.
        without_mode: Active set at the optimum of the relaxation, once it was solved.
        in_mode: Active set at that of the earlier mode's program, once it was solved.
    """

    start: WarmStart = COLD_START
    without_mode: ActiveSet | None = None
    in_mode: ActiveSet | None = None

    def __post_init__(self) -> None:
        """Make the oracle, and begin near the earlier motion."""
        super().__post_init__()
        self.near = self.start.motion

    def solve_relaxation(self) -> Answer:
        """Return the relaxation's answer, by the earlier active set where that is optimal."""
        program = self.formulation.program
        answer, self.without_mode = self.solve_near(program.lb, program.ub, self.start.relaxation)
        return self.store_relaxation(answer)

    def solve_near(
        self, lb: FloatArray, ub: FloatArray, active: ActiveSet | None
    ) -> tuple[Answer, ActiveSet | None]:
        """Solve the program under bounds by an active set; where that fails, by a solver.

        Args:
            lb: (n,) lower bounds.
            ub: (n,) upper bounds.
            active: Active set at the optimum of a similar program; None: none is known.
        """
        cutoff = min(self.best_value, self.formulation.cutoff)
        program = self.formulation.program.with_bounds(lb, ub, cutoff)
        solved = None if active is None else optimum_on_active_set(program, active, cutoff)
        if solved is not None:
            self.force_programs += 1
            return solved
        answer = self.solve(lb, ub)
        return answer, active_set_of(program, answer) if answer.outcome is Outcome.SOLVED else None

    def next_start(self) -> WarmStart:
        """Return the warm start for the next search; parts that were not reached are kept."""
        start, problem = self.start, self.formulation.problem
        mode = start.mode if self.mode is None else self.mode
        loops_apply = mode is not None and self.in_mode is None and mode.own_signs.all()
        return WarmStart(
            mode,
            self.without_mode or start.relaxation,
            self.in_mode or (start.in_mode if mode is start.mode else None),
            self.near,
            structure_of(problem) if problem.cone_model.regular and loops_apply else None,
            self.cover,
        )


def _search_from_start(state: _WarmState) -> Status:
    relaxation = state.solve_relaxation()
    if state.start.mode is not None and relaxation.outcome is Outcome.SOLVED:
        for attempt in (_keep_relaxation_if_admitted, _keep_optimum_of_start_mode):
            attempt(state)
            if state.is_closed(relaxation.bound):
                state.modes_examined = 1
                return state.final_status()
    return search_modes(state)


def _keep_relaxation_if_admitted(state: _WarmState) -> None:
    """Keep the relaxation's own optimum, if a feasible mode admits its friction."""
    relaxation, before, motion = state.relaxation, state.start.mode, state.start.motion
    if relaxation is None:
        return
    if before is not None and motion is not None and _is_mode_of_problem(state, before):
        again = state.oracle.mode_still_admitting(relaxation.x, before, motion)
        if again is not None:
            state.offer(relaxation, *again)
            return
    found = state.oracle.mode_for(relaxation.x, motion)
    if isinstance(found, FoundMode):
        state.offer(relaxation, found)


def _keep_optimum_of_start_mode(state: _WarmState) -> None:
    """Keep the optimum of the earlier mode, if it is a feasible mode of the problem."""
    mode = state.start.mode
    if mode is None or not _is_mode_of_problem(state, mode):
        return
    found = state.oracle.feasible_mode(mode, state.near)
    if found is None:
        return
    bounds = state.formulation.bounds_of(found.mode)
    answer, state.in_mode = state.solve_near(*bounds, state.start.in_mode)
    if answer.outcome is Outcome.SOLVED and answer.value < state.best_value:
        state.keep(answer, found)


def _is_mode_of_problem(state: SearchState, mode: SlidingMode) -> bool:
    """Return whether a mode has the problem's contacts, with those that it must and may select."""
    problem, selection = state.formulation.problem, mode.selection
    if len(selection) != problem.contact_count:
        return False
    stray = selection > candidate_contacts(problem, state.rules)
    missing = selection < required_contacts(problem, state.rules)
    return not np.count_nonzero(stray | missing)


_MOST_CONTACT_SETS = 256
_MOST_MISSES = 8


class ContactStarts:
    """Warm starts for the same contacts, tried in the order of their success.

    Attributes:
        compiled_starts: The starts in compiled form, the one that served last first.
        misses: Number of successive states that the loops did not find, or were not tried on since.
    """

    def __init__(self) -> None:
        """Begin with nothing learned."""
        self.compiled_starts: list[Any] = []
        self.misses = 0
        self._starts: tuple[WarmStart, ...] = ()
        self._learned: WarmStart | None = None
        self._last: WarmStart | None = None

    @property
    def best(self) -> WarmStart:
        """The start that served last, or was learned since."""
        return self._starts[0] if self._starts else COLD_START

    def optimum(
        self, problem: QuasistaticProblem, objective: Objective, options: SolveOptions
    ) -> WarmOptimum | None:
        """Return the optimum that one of the starts leads to; None: none does.

        Args:
            problem: The problem.
            objective: What is optimised.
            options: How it is solved.
        """
        starts = self._starts
        found = warm_optimum(problem, objective, options, starts)
        if found is None:
            return None
        optimum, place = found
        self._starts = (starts[place], *starts[:place], *starts[place + 1 :])
        return optimum

    def search(
        self,
        problem: QuasistaticProblem,
        objective: Objective,
        options: SolveOptions,
        rest: RestModel | None = None,
    ) -> TorqueSolution:
        """Solve a problem by a search from the best start, and store its warm start.

        Args:
            problem: See `optimum`.
            objective: See `optimum`.
            options: See `optimum`.
            rest: See `solve_problem`.
        """
        solution, learned = solve_from(problem, objective, options, self.best, rest)
        self.learn(learned)
        return solution

    def solve(
        self,
        problem: QuasistaticProblem,
        objective: Objective,
        options: SolveOptions,
        rest: RestModel | None = None,
    ) -> TorqueSolution:
        """Return the solution: by a warm start if one leads to it, else by a search.

        The arguments are those of `search`.
        """
        found = self.optimum(problem, objective, options)
        if found is None:
            return self.search(problem, objective, options, rest)
        return solution_of_optimum(problem, objective, options.rules, found)

    def learn(self, learned: WarmStart) -> None:
        """Store the warm start that a search has left."""
        others = [start for start in self._starts if start.structure is not None]
        self._learned = learned
        self._starts = (learned, *others[: MOST_STARTS - 1])

    def new_start(self) -> WarmStart | None:
        """Return the warm start learned since the last call; None: none."""
        new = None if self._learned is self._last else self._learned
        self._last = self._learned
        return new

    def is_worth_trying(self) -> bool:
        """Return whether to try the loops; for contacts that they often miss, only now and then."""
        if self.misses < _MOST_MISSES or self.misses % _MOST_MISSES == 0:
            return True
        self.misses += 1
        return False

    def record_found(self, found: int) -> None:
        """Record how many states the loops found before the first miss."""
        self.misses = 0 if found else self.misses + 1


class StartsByContacts:
    """Warm starts by contacts. Threads may share them."""

    def __init__(self) -> None:
        """Begin with nothing learned."""
        self._starts_by_contacts: dict[tuple[Any, ...], ContactStarts] = Bounded(_MOST_CONTACT_SETS)

    def for_contacts(
        self, bodies: tuple[Any, ...], problem: QuasistaticProblem, objective: Objective
    ) -> ContactStarts:
        """Return the warm starts for the contacts of a problem.

        Args:
            bodies: The bodies that the object touches.
            problem: The problem; contacts that slide are told apart, too.
            objective: What is optimised.
        """
        key = objective.algorithm or objective, bodies, problem.is_sliding.tobytes()
        starts = self._starts_by_contacts.get(key)
        if starts is None:
            starts = self._starts_by_contacts[key] = ContactStarts()
        return starts
