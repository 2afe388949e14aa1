"""What makes a solution doubtful, from its own figures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.solution.certificate import Certificate, Status
from graspless_pin.solution.tables import figure

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
            f"it is not proven that nothing is better: a better answer may exist (gap "
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
    if status is Status.LOAD_TOO_LARGE:
        yield Finding(
            FindingCode.LOAD_TOO_LARGE,
            "solution",
            overload(problem),
            "look at masses (kg), sizes (m) and gravity (m/s^2), or raise the limits",
        )
    load = problem.scales.force
    if margin is not None and margin <= _NOTHING * load:
        told = figure(margin, load)
        size = "zero" if told == "0" else f"{told} N, next to nothing beside {load:.3g} N"
        yield Finding(
            FindingCode.NO_RESERVE,
            "solution",
            f"the largest margin is {size}: the least disturbance makes a contact slip or open",
            "raise torque limits or friction, or add a contact",
        )


def overload(problem: QuasistaticProblem) -> str:
    """Return the limit that is lost in the load, and how many times as large the load is there."""
    strict, (force, _, joints) = problem.strictness, problem.scales
    if strict is None:
        return "the required margin is far beyond what the limits carry"
    joint = int(strict.torque.argmax()) if problem.joint_count else -1
    if joint < 0 or strict.torque[joint] < strict.normal.max():
        contact = int(strict.normal.argmax())
        limit = float(problem.max_normal_force[contact])
        return (
            f"the load, {force:.3g} N, is {force / limit:.2g} times what contact {contact} bears "
            f"({limit:g} N)"
        )
    limits = problem.lower_torque[joint], problem.upper_torque[joint]
    limit, load = float(np.abs(limits).min()), float(joints[joint])
    times = f"{load / limit:.2g} times" if limit > 0.0 else "far beyond"
    return (
        f"the load makes {load:.3g} {problem.joint_units[joint]} on joint "
        f"'{problem.joint_names[joint]}', {times} its limit ({limit:g})"
    )
