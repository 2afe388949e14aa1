"""Torques of which rest is the only outcome: those that need little friction at the supports.

The best case may rest on a squeeze between supports that nothing guarantees. Torques that balance
the load with less of the supports' friction rely on the fingers, whose loads the torques make: the
first guesses are optima with that friction reduced. Only the verdict guarantees.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from graspless_pin.algorithms.limits import Limits
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.holding.stability import stability, undecided_verdict
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.analysis_objectives import at_torques
from graspless_pin.programs.objectives import Objective
from graspless_pin.solution import Evidence, Guarantee, Status, TorqueSolution

_SHARES = (0.75, 0.5, 0.25, 0.0)
"""Of the supports' friction, tried one after the other."""

Optimum = Callable[[QuasistaticProblem, Objective], TorqueSolution]
"""Finds the best case of a problem for an objective."""


def guaranteed(
    best: TorqueSolution, optimum: Optimum, options: SolveOptions, limits: Limits, unknown: str = ""
) -> TorqueSolution:
    """Return the best torques found of which rest is the only outcome.

    Args:
        best: The best case, found or not.
        optimum: Finds that of another problem, for another objective.
        options: How the verdicts are asked for.
        limits: Of the whole call.
        unknown: Why no verdict can be had; empty: one can.

    Returns:
        The best case where nothing is found or where its own torques are guaranteed; else a
        solution with status STRONG, or one that says that none was found.
    """
    if not best.found:
        return best
    problem, first, tried = best.problem, None, 0
    for candidate in _candidates(best, optimum):
        if unknown:
            verdict = undecided_verdict(problem, candidate.torques, unknown)
        else:
            verdict = stability(
                problem, candidate.torques,
                node_limit=options.verdict_nodes, time_limit=limits.within(options).time_limit,
            )  # fmt: skip
        tried += 1
        if verdict.status is Stability.STRONG:
            return _certified(best, candidate, verdict, tried)
        first = first or verdict
        if unknown or limits.passed:
            break
    return _none_found(best, first, tried)


def _candidates(best: TorqueSolution, optimum: Optimum) -> Iterator[TorqueSolution]:
    """Yield the best case, then optima with less friction at contacts that no joint moves.

    Each is the optimum of the problem itself with the torques held.
    """
    yield best
    problem, objective = best.problem, best.objective
    rows = problem.jacobian.reshape(problem.contact_count, 3 * problem.joint_count)
    supports = ~rows.any(axis=1) & ~problem.is_sliding
    for share in _SHARES if problem.joint_count else ():
        friction = np.where(supports, share, 1.0) * problem.friction
        less = optimum(problem.with_changes(friction=friction), objective)
        if less.found:
            held = optimum(problem, at_torques(objective, less.torques))
            if held.found:
                yield replace(held, objective=objective)


def _certified(
    best: TorqueSolution, found: TorqueSolution, verdict: StabilityVerdict, tried: int
) -> TorqueSolution:
    sign = 1.0 if best.objective.maximizes else -1.0
    gap = max(sign * (best.value - found.value), 0.0)
    guarantee = Guarantee(verdict, best.value, gap, tried)
    if found is best:
        return replace(best, guarantee=guarantee)
    bound = best.certificate.bound
    certificate = replace(
        best.certificate,
        primal_residual=found.certificate.primal_residual,
        duality_gap=np.inf,
        gap=sign * (bound - found.value),
    )
    evidence = Evidence(
        relaxation=best.evidence.relaxation,
        added=found.evidence.added,
        motion=found.evidence.motion,
    )
    return replace(
        found, status=Status.STRONG, certificate=certificate, evidence=evidence, guarantee=guarantee
    )


def _none_found(
    best: TorqueSolution, verdict: StabilityVerdict | None, tried: int
) -> TorqueSolution:
    """Return that no torques were found, and that there are none where there is no choice."""
    moves = verdict is not None and verdict.status in (Stability.WEAK, Stability.NONE)
    proven = moves and not best.problem.joint_count
    said = "" if verdict is None else f"Verdict on the best case's torques: {verdict.message}."
    return replace(
        best,
        status=Status.INFEASIBLE_STRONG if proven else Status.STRONG_NOT_FOUND,
        guarantee=Guarantee(verdict, best.value, np.nan, tried),
        _forces=None,
        _mode=None,
        _explanation=said,
    )
