"""What makes a solution doubtful, from its own figures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.solution.certificate import Certificate
from graspless_pin.solution.status import Status

_NOTHING = 1e-6  # of the load


class HasFindings(Protocol):
    """What a problem came from: a scene, or a document."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong with it."""
        ...


def solution_doubts(
    status: Status, certificate: Certificate, problem: QuasistaticProblem, margin: float | None
) -> Iterator[Finding]:
    """Find what an answer hangs on.

    Args:
        status: How the search ended.
        certificate: What it has proven.
        problem: The problem.
        margin: The largest margin, N; None: another figure was optimised, or nothing was found.
    """
    if status is Status.LIMIT_REACHED:
        yield Finding(
            FindingCode.NOT_OPTIMAL,
            "solution",
            f"the search ended before its proof: a better answer may exist (gap "
            f"{certificate.gap:.3g})",
            "raise node_limit and time_limit",
        )
    if certificate.threshold_optima is not None:
        yield Finding(
            FindingCode.THRESHOLD,
            "solution",
            "this answer hangs on what counts as a virtual motion",
            "look at the certificate's threshold_optima, and at tangents that are not exact",
        )
    if margin is not None and margin <= _NOTHING * problem.scales.force:
        yield Finding(
            FindingCode.NO_RESERVE,
            "solution",
            "the largest margin is zero: the least disturbance makes a contact slip or open",
            "raise torque limits or friction, or add a contact",
        )
