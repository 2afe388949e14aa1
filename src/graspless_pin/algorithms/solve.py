"""From a problem, an objective and rules to a `TorqueSolution`, by any of the searches."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.algorithms.branch_and_bound import search_modes
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.options import DEFAULT_OPTIONS, Limits, SolveOptions
from graspless_pin.algorithms.search import (
    ModeSearch,
    SearchResult,
    SearchState,
    in_mode,
    threshold_optima,
)
from graspless_pin.caching import Derived
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.kinematics import Requirement, requirements_of
from graspless_pin.modes.rules import (
    Rules,
    SignRule,
    SlidingMode,
    candidate_contacts,
)
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import read_only
from graspless_pin.programs.forces import force_reach
from graspless_pin.programs.objectives import Objective
from graspless_pin.solution import Certificate, Evidence, Status, TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.holding.small_motions import RestModel


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
        options: How.
        mode: Solve this (B, S) only.
        rest: What is known of rest beside the problem; None: nothing.

    Raises:
        ArgumentError: If an argument is none of its kind, or the mode not one of the problem; if
            the rule ``direction`` does not take the objective or a mode, or ``stability="strong"``
            a mode.
    """
    checked_problem(problem)
    if not isinstance(objective, Objective):
        raise ArgumentError("objective", f"is {objective!r:.80}; it must be an Objective")
    limits = Limits.of(options)
    if mode is not None:
        what = "the argument mode is about forces that may balance in it"
        options.need_weak(what, "ask `stability` of its torques")
    return as_stable(_best_case(problem, objective, options, limits, mode), options, limits, rest)


def as_stable(
    best: TorqueSolution, options: SolveOptions, limits: Limits, rest: RestModel | None
) -> TorqueSolution:
    """Return the best case, or the best torques found whose rest is as stable as is asked for.

    Args:
        best: The best case, found or not.
        options: What is asked for.
        limits: Of the whole call.
        rest: What is known of rest beside the problem; None: nothing.
    """
    if not options.strong:
        return best
    # Loaded here: the best case needs no verdict, and goes without its search and solver.
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
    """Return the optimum over all forces that statics leave open."""
    gap = 0.0
    if options.rules.by_direction:
        if mode is not None:
            options.rules.need_signs("the argument mode")
        if not problem.cone_model.is_coulomb:
            raise ArgumentError(
                "sign_rule",
                f"'direction' is about Coulomb's law, and the problem has the cone "
                f"'{problem.cone}'; use another sign_rule",
            )
        problem, gap = _with_round_cones(problem), options.direction_gap
    search: ModeSearch = partial(search_modes, options=options, limits=limits)
    if mode is not None:
        requirements = _checked_mode(problem, options.rules, mode)
        search = partial(in_mode, mode=mode, requirements=requirements)
    result = search(SearchState(formulate(problem, objective), options.rules, options.solver))
    optima = threshold_optima(result, search, gap)
    return solution_of(result, options.rules, given_mode=mode, optima=optima)


@Derived
def _with_round_cones(problem: QuasistaticProblem) -> QuasistaticProblem:
    """Return the problem with round cones; a copy even so, as what is derived may not be itself."""
    return problem.with_changes(cone="round")


def _checked_mode(
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
            f"'{rules.sign}' allows {allowed} zero",
        )
    candidates = candidate_contacts(problem, rules)
    stray = mode.selection & ~candidates
    missing = candidates & problem.is_sliding & ~mode.selection
    if stray.any() or missing.any():
        index = int(np.argmax(stray | missing))
        what = "selects" if stray[index] else "does not select"
        kind = "slides" if problem.is_sliding[index] else "is frictionless"
        raise ArgumentError(
            "mode",
            f"{what} contact {index}, which {kind}, under sliding_rule='{rules.sliding}'",
        )
    return list(requirements_of(mode))


def solution_of(
    result: SearchResult,
    rules: Rules,
    *,
    given_mode: SlidingMode | None = None,
    optima: tuple[float, float] | None = None,
) -> TorqueSolution:
    """Return how a search ended as a solution.

    Args:
        result: How it ended.
        rules: The reading of the virtual-sliding constraint.
        given_mode: The mode that alone was asked for.
        optima: What `threshold_optima` found.
    """
    state = result.state
    formulation = state.formulation
    best = state.best
    certificate = Certificate(
        primal_residual=np.inf if best is None else best.residual,
        duality_gap=np.inf if best is None else best.gap,
        bound=state.bound * formulation.unit,
        gap=np.inf if best is None else (best.value - state.bound) * abs(formulation.unit),
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
    status, strict = result.status, formulation.coordinates.strictness
    if status is Status.UNVERIFIED and strict is not None and not strict.can_be_kept:
        status = Status.LOAD_TOO_LARGE
    return TorqueSolution(
        status=status,
        objective=formulation.objective,
        rules=rules,
        certificate=certificate,
        problem=formulation.problem,
        given_mode=given_mode,
        _forces=forces,
        _mode=state.mode,
        evidence=_evidence(state),
    )


def _evidence(state: SearchState) -> Evidence:
    """Return what a search leaves of the proof of its answer."""
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
