"""From a problem, an objective and rules to a `TorqueSolution`, by any of the searches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.algorithms.branch_and_bound import search_modes
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.mode_oracle import FoundMode
from graspless_pin.algorithms.options import DEFAULT_OPTIONS, SolveOptions
from graspless_pin.algorithms.search_state import SearchState, unsolved_status
from graspless_pin.caching import Derived
from graspless_pin.errors import ArgumentError, UndecidedMotionError
from graspless_pin.modes.kinematics import VirtualKinematics, requirements_of
from graspless_pin.modes.rules import (
    Conflict,
    Requirement,
    Rules,
    SignRule,
    SlidingMode,
    StaticFriction,
    candidate_contacts,
    required_contacts,
)
from graspless_pin.modes.virtual_motions import CLEARLY
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import read_only
from graspless_pin.programs.forces import force_reach
from graspless_pin.programs.objectives import Objective
from graspless_pin.solution import Certificate, Evidence, Status, TorqueSolution
from graspless_pin.solution.certificate import UNDECIDED
from graspless_pin.solvers import Outcome
from graspless_pin.tree_search import Limits

if TYPE_CHECKING:
    from graspless_pin.holding.small_motions import RestModel

THRESHOLD_FACTORS = (0.1, 10.0)
"""Factors on the threshold of virtual motions for which an optimum is compared."""
_SAME_OPTIMUM = 1e-6

ModeSearch = Callable[[SearchState], Status]


def solve_problem(
    problem: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions = DEFAULT_OPTIONS,
    *,
    mode: SlidingMode | None = None,
    rest: RestModel | None = None,
) -> TorqueSolution:
    """Solve a problem for an objective.

    Args:
        problem: Contacts, wrench, joints and limits.
        objective: What is optimised.
        options: How it is solved.
        mode: Solve this (B, S) only.
        rest: Makes the verdicts of ``stability="strong"``; None: `stability` alone.

    Raises:
        ArgumentError: If an argument is none of its kind, or the mode not one of the problem; if
            the rule ``direction`` does not take the objective or a mode, or ``stability="strong"``
            a mode.
    """
    checked_problem(problem)
    if not isinstance(objective, Objective):
        raise ArgumentError("objective", f"is {objective!r:.80}; it must be an Objective")
    limits = Limits.from_options(options)
    if mode is not None:
        what = "the argument mode restricts contact forces to one mode, which a verdict does not"
        options.need_weak(what, "leave it out, and call `stability` with the torques found")
    return as_stable(_best_case(problem, objective, options, limits, mode), options, limits, rest)


def as_stable(
    best: TorqueSolution, options: SolveOptions, limits: Limits, rest: RestModel | None
) -> TorqueSolution:
    """Return the best case, or under ``stability="strong"`` the best guaranteed torques found.

    Args:
        best: The best case, found or not.
        options: The options of the solve.
        limits: Limits of the whole call.
        rest: See `solve_problem`.
    """
    if not options.strong:
        return best
    # Loaded here: the best case needs no verdict, and so neither its search nor its solver.
    from graspless_pin.algorithms.guaranteed_torques import guaranteed

    def optimum(problem: QuasistaticProblem, objective: Objective) -> TorqueSolution:
        return _best_case(problem, objective, options, limits)

    return guaranteed(best, optimum, options, limits, rest)


def _best_case(
    problem: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions,
    limits: Limits,
    mode: SlidingMode | None = None,
) -> TorqueSolution:
    """Return the optimum over all admissible contact forces."""
    gap = 0.0
    if options.rules.by_direction:
        if mode is not None:
            options.rules.need_signs("the argument mode")
        if not problem.cone_model.is_coulomb:
            raise ArgumentError(
                "sign_rule",
                f"is 'direction', which requires Coulomb's law, but the problem has the cone "
                f"'{problem.cone}'; use another sign_rule",
            )
        problem, gap = _with_round_cones(problem), options.direction_gap
    search: ModeSearch = search_modes
    if mode is not None:
        requirements = _checked_requirements(problem, options.rules, mode)
        search = partial(_search_in_mode, mode=mode, requirements=requirements)
    state = SearchState(formulate(problem, objective), options, limits)
    status = search(state)
    return solution_of(status, state, given_mode=mode, optima=threshold_optima(state, search, gap))


@Derived
def _with_round_cones(problem: QuasistaticProblem) -> QuasistaticProblem:
    """Return the problem with round cones, always as a copy: a derived value may not be its key."""
    return problem.with_changes(cone="round")


def _checked_requirements(
    problem: QuasistaticProblem, rules: Rules, mode: SlidingMode
) -> list[Requirement]:
    if not isinstance(mode, SlidingMode):
        raise ArgumentError("mode", f"is {mode!r:.80}; it must be a SlidingMode")
    if len(mode.selection) != problem.contact_count:
        raise ArgumentError(
            "mode", f"has {len(mode.selection)} contacts; the problem has {problem.contact_count}"
        )
    zeros = (mode.signs == 0).sum(axis=1)[mode.selection]
    allowed = 1 if rules.sign is SignRule.EXACT else 0
    if (zeros > allowed).any():
        index = int(np.flatnonzero(mode.selection)[np.argmax(zeros > allowed)])
        raise ArgumentError(
            "mode",
            f"has signs {mode.signs[index].tolist()} at selected contact {index}; the rule "
            f"'{rules.sign}' allows {'one' if allowed else 'no'} zero component",
        )
    stray = mode.selection > candidate_contacts(problem, rules)
    missing = mode.selection < required_contacts(problem, rules)
    if stray.any() or missing.any():
        index = int(np.argmax(stray | missing))
        what = "selects" if stray[index] else "does not select"
        kind = "slides" if problem.is_sliding[index] else "is frictionless"
        raise ArgumentError(
            "mode",
            f"{what} contact {index}, which {kind}; sliding_rule='{rules.sliding}' does not allow "
            "that",
        )
    return list(requirements_of(mode))


def _search_in_mode(
    state: SearchState, mode: SlidingMode, requirements: list[Requirement]
) -> Status:
    """Solve one given mode only."""
    state.nodes = state.modes_examined = state.oracle.kinematic_programs = 1
    kinematics = state.formulation.kinematics
    try:
        verdict = kinematics.solve(requirements, state.rules.sign)
    except UndecidedMotionError:
        return state.undecided_status()
    if isinstance(verdict, Conflict):
        return Status.INFEASIBLE_MODE
    state.found = FoundMode(mode, kinematics.scaled_motion(verdict.coordinates))
    answer = state.solve(*state.formulation.bounds_of(mode))
    state.bound = answer.bound
    if answer.outcome is Outcome.SOLVED:
        state.best = answer
        return Status.OPTIMAL_IN_MODE
    state.relaxation, state.infeasibility = answer, answer.proof
    return unsolved_status(answer, Status.INFEASIBLE_IN_MODE)


def threshold_optima(
    state: SearchState, search: ModeSearch, gap: float = 0.0
) -> tuple[float, float] | None:
    """Return the optima for a tenth and for ten times the threshold, if they differ.

    Nothing is solved where the motion of the mode is clearly fast enough and the search refused no
    motion that a tenth of the threshold would admit: then all three optima are the same.

    Args:
        state: The search that has ended.
        search: Repeats it from a state whose formulation has another threshold.
        gap: Gap of each of the two optima, over the load or the optimum.

    Returns:
        Two optima, NaN where nothing is feasible; None where neither differs by more than 1e-6 of
        the load, or of the optimum where that is larger, and two gaps, or where a limit or a
        program that no solver answered ended one of the searches.
    """
    formulation, kinematics = state.formulation, state.formulation.kinematics
    if state.rules.static_friction is StaticFriction.COULOMB:
        return None
    if not (kinematics.undecided_near or _is_slow(state)):
        return None
    values = []
    for factor in THRESHOLD_FACTORS:
        rescaled = VirtualKinematics(formulation.problem, factor * kinematics.threshold)
        again = SearchState(replace(formulation, kinematics=rescaled), state.options, state.limits)
        if search(again) in (Status.LIMIT_REACHED, *UNDECIDED):
            return None
        values.append(again.best_value)
    own = state.best_value
    same = (_SAME_OPTIMUM + 2.0 * gap) * (max(1.0, abs(own)) if np.isfinite(own) else 1.0)
    if all(value == own or abs(value - own) <= same for value in values):
        return None
    unit = formulation.signed_unit
    slow, fast = (unit * value if np.isfinite(value) else np.nan for value in values)
    return slow, fast


def _is_slow(state: SearchState) -> bool:
    """Return whether the best mode has no motion as fast as ten times the threshold."""
    if state.best is None or state.found is None or state.found.is_clear:
        return False
    if state.rules.by_direction:
        return True  # the search has looked for such a motion itself
    kinematics = state.formulation.kinematics
    try:
        slowest = kinematics.slowest(requirements_of(state.found.mode), state.rules.sign)
    except UndecidedMotionError:
        return True
    return slowest < CLEARLY * kinematics.threshold


def solution_of(
    status: Status,
    state: SearchState,
    *,
    given_mode: SlidingMode | None = None,
    optima: tuple[float, float] | None = None,
) -> TorqueSolution:
    """Return the solution of a search that has ended.

    Args:
        status: Its status.
        state: Its final state.
        given_mode: The mode that it was restricted to; None: all modes.
        optima: The result of `threshold_optima`.
    """
    formulation, best = state.formulation, state.best
    certificate = Certificate(
        primal_residual=np.inf if best is None else best.residual,
        duality_gap=np.inf if best is None else best.gap,
        bound=state.bound * formulation.signed_unit,
        gap=np.inf if best is None else (best.value - state.bound) * abs(formulation.signed_unit),
        infeasibility=state.infeasibility,
        force_reach=force_reach(formulation.problem, formulation.coordinates),
        threshold_optima=optima,
        modes_examined=state.modes_examined,
        nodes=state.nodes,
        force_programs=state.force_programs,
        kinematic_programs=state.oracle.kinematic_programs,
        solver="" if best is None else best.solver,
    )
    forces = None if best is None else read_only(formulation.coordinates.forces(best.x))
    strict = formulation.coordinates.strictness
    if status is Status.UNVERIFIED and strict is not None and not strict.can_be_kept:
        status = Status.LOAD_TOO_LARGE
    return TorqueSolution(
        status=status,
        objective=formulation.objective,
        rules=state.rules,
        certificate=certificate,
        problem=formulation.problem,
        given_mode=given_mode,
        _forces=forces,
        _mode=state.mode,
        evidence=_evidence(state),
    )


def _evidence(state: SearchState) -> Evidence:
    """Return the multipliers, forces and motion of a search that prove its answer."""
    first, best, coordinates = state.relaxation, state.best, state.formulation.coordinates
    relaxation = in_mode = added = forces = motion = None
    if first is not None and len(first.y):
        relaxation = first.y, first.z
    if best is not None:
        in_mode, added = (best.y, best.z), best.x[coordinates.layout.size :].copy()
    elif first is not None and len(first.x):
        forces, added = coordinates.forces(first.x), first.x[coordinates.layout.size :].copy()
    if state.found is not None and state.found.motion is not None:
        motion = state.formulation.kinematics.scale * state.found.motion
    return Evidence(relaxation, in_mode, added, forces, motion)
