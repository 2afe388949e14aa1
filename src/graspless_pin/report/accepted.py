"""An answer as far as its document proves it: what the checker does not accept is not claimed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from graspless_pin.holding.stability import undecided_verdict
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.report.document import solution_document
from graspless_pin.report.verify import Check, verify_document
from graspless_pin.report.verify.outcome import GUARANTEED
from graspless_pin.report.verify.reading import read_problem
from graspless_pin.report.verify.rest import rest_checks
from graspless_pin.scene import Scene
from graspless_pin.solution import Status, TorqueSolution

_CLAIMS = (
    Status.OPTIMAL,
    Status.OPTIMAL_IN_MODE,
    Status.STRONG,
    Status.INFEASIBLE_FORCES,
    Status.INFEASIBLE_MODES,
    Status.INFEASIBLE_IN_MODE,
    Status.INFEASIBLE_MODE,
)
_OF_OPTIMUM = "optimal "
"""How the checks begin of what proves that nothing is better."""


def accepted(
    solution: TorqueSolution, scene: Scene | None = None, verdict: StabilityVerdict | None = None
) -> tuple[TorqueSolution, StabilityVerdict | None]:
    """Return a solution and a verdict of which no more is claimed than their document proves.

    Args:
        solution: A solution of the scene.
        scene: The scene; None: the problem is of arrays, or of several scenes joined.
        verdict: On the solution's torques; None: it was not asked.

    Returns:
        The same, unless a check fails or its proof is not in the document. Then an optimum is the
        best found only, a verdict undecided, and an answer that is none is not verified.
    """
    # No document holds the bounds of directions, nor round cones of an objective of its own.
    own_round = solution.algorithm is None and solution.problem.cone_model.second_order
    if solution.rules.by_direction or own_round:
        return solution, verdict
    document = solution_document(solution, scene, verdict)
    of_rest = rest_checks(document, read_problem(document))
    lost = [one for one in of_rest if one.passed is not True]
    if lost and verdict is not None and verdict.status is not Stability.UNDECIDED:
        why = f"undecided: its proof does not pass the check ({_message(lost)})"
        verdict = undecided_verdict(
            verdict.problem,
            verdict.torques,
            why,
            acceleration_resolution=verdict.acceleration_resolution,
        )
    if solution.status in _CLAIMS:
        checks = verify_document(document).checks
        refused = [one for one in checks if one.passed is not True and one not in of_rest]
        if solution.guarantee is not None and solution.guarantee.verdict is None:
            # Of several members joined: each has a verdict of its own.
            refused = [one for one in refused if one.name != GUARANTEED]
        solution = _without(solution, refused, lost)
    return solution, verdict


def _without(
    solution: TorqueSolution, refused: Sequence[Check], lost: Sequence[Check]
) -> TorqueSolution:
    """Return a solution without what its checks do not prove, those of rest apart."""
    if solution.found and refused and all(one.name.startswith(_OF_OPTIMUM) for one in refused):
        return replace(solution, status=Status.LIMIT_REACHED)
    if not refused and not (lost and solution.status is Status.STRONG):
        return solution
    status = Status.UNVERIFIED if refused else Status.STRONG_NOT_FOUND
    return replace(
        solution,
        status=status,
        _forces=None,
        _mode=None,
        _explanation=f"Its document does not pass the check: {_message([*refused, *lost])}.",
    )


def _message(checks: Sequence[Check]) -> str:
    return "; ".join(f"{one.name}: {one.detail}" for one in checks)
