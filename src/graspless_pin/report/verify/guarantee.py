"""Check what a document says of torques that had to have rest for their only outcome."""

from __future__ import annotations

from typing import Any

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.figures import FOUND_STATES, UNGUARANTEED, Problem
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.reading import read_forces
from graspless_pin.report.verify.values import entry, number, text


def guarantee_checks(document: dict[str, Any], problem: Problem, status: str) -> list[Check]:
    """Return the checks of ``guarantee``; none where there is none. The verdict has its own.

    Args:
        document: The document.
        problem: What it says of contacts and joints.
        status: Of the solution.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    stated, verdict = document.get("guarantee"), document.get("stability")
    if stated is None and status not in ("strong", *UNGUARANTEED):
        return []
    says = None if verdict is None else text(entry(verdict, "status", "stability"), "status")
    if status in FOUND_STATES:
        sure = holds("the torques are guaranteed", says == "strong", f"verdict: {says}")
        return [sure, *_cost(document, entry(document, "guarantee", "the document"), problem)]
    checks = [given("the best case", "of torques that are not stated")]
    if status == "infeasible_strong":
        # Without joints there is one set of torques alone.
        none = not problem.units and says in ("weak", "none")
        detail = f"verdict: {says}, {len(problem.units)} joints"
        checks.append(holds("no torques are guaranteed", none, detail))
    elif status == "strong_not_found":
        why = "no torques were found, and no proof that there are none"
        checks.append(Check("whether there are guaranteed torques", None, why))
    return checks


def unit_of(problem: Problem) -> str:
    """Return the unit of the objective's value."""
    if problem.own is not None or problem.by_limits:
        return ""
    return "N" if problem.is_margin else "N m, N"


def _cost(document: dict[str, Any], stated: Any, problem: Problem) -> list[Check]:
    """Return the checks of the best case, which its bound proves, and of the gap to it."""
    best, gap = (number(entry(stated, key, "guarantee"), key) for key in ("best_case", "gap"))
    certificate = entry(document, "certificate", "the document")
    bound = number(entry(certificate, "bound", "certificate"), "bound")
    rows = [entry(one, "force", "a contact") for one in document["contacts"]]
    columns = None if problem.own is None else problem.own.values
    value = problem.objective(read_forces(rows, problem, "the forces", columns))
    sign, unit = (-1.0 if problem.maximizes else 1.0), unit_of(problem)
    worse, met = value - sign * best, tolerances.objective(problem, best, bound)
    return [
        within("the best case is within its bound", sign * (bound - best), met, unit),
        within("the best case is no worse", -worse, met, unit),
        agrees("gap to the best case as stated", gap, max(worse, 0.0), met, unit),
    ]
