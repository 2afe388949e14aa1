"""The assumptions of a document, line by line: what it is not asked to prove."""

from __future__ import annotations

import numpy as np

from graspless_pin.report.verify.bounds import own_box
from graspless_pin.report.verify.fields import Part
from graspless_pin.report.verify.outcome import Check, given
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.reading import stated_mass


def taken_as_given(problem: Problem, stated: Part) -> list[Check]:
    """Return a line for each assumption of a document."""
    return [
        given(
            "the problem",
            "contact points, normals, tangents, sliding, friction, Jacobian, external wrench, "
            "limits, options and rules; poses, masses, gravity and names",
        ),
        *_coordinate_lines(problem),
        given("units", _units_text(problem, stated)),
        given("load", _load_text(problem, stated)),
        given("limits", _limits_text(problem)),
        *_cone_lines(problem, stated),
        *_objective_lines(problem, stated),
        given(
            "how it was found",
            "counters of the search, solver, versions, hashes, findings, sentences, and the optima "
            "with other thresholds of virtual motion",
        ),
    ]


def _coordinate_lines(problem: Problem) -> list[Check]:
    """Return the line on a stated map of passive coordinates; none for one free object."""
    if problem.stated_map is None:
        return []
    count, turning = len(problem.w), int(problem.is_moment.sum())
    detail = (
        f"{count} coordinates, {count - turning} in N, {turning} in N m, and their wrench_matrix: "
        "the effect of contact forces on them does not follow from the contact points"
    )
    return [given("passive coordinates", detail)]


def _cone_lines(problem: Problem, stated: Part) -> list[Check]:
    """Return the line on friction cones that are not known by name; none for those that are."""
    if problem.corners is None:
        return []
    detail = f"their {problem.edges} corners, and the kinetic friction of sliding contacts"
    if problem.coulombs_law:
        detail += ", and that they represent Coulomb's law"
    return [given(f"cones {stated['cone'][:60]!r}", detail)]


def _units_text(problem: Problem, stated: Part) -> str:
    """Return the units of all figures, and which joints are revolute and which prismatic."""
    names = [joint["name"] for joint in stated["joints"]]
    shown = ["SI, world axes"]
    for unit in ("N m", "N"):
        own = [name for name, one in zip(names, problem.units, strict=True) if one == unit]
        shown += [f"{unit}: {_quoted(own)}"] if own else []
    return "; ".join(shown)


def _load_text(problem: Problem, stated: Part) -> str:
    """Return the external load, with the weight of the object where the document states it."""
    parts = problem.w[~problem.is_moment], problem.w[problem.is_moment]
    force, moment = (float(np.linalg.norm(one)) for one in parts)
    shown, mass = f"force {force:.6g} N, moment {moment:.6g} N m", stated_mass(stated)
    if mass is not None and stated.get("gravity") is not None:
        shown += f"; the object weighs {mass * float(np.linalg.norm(stated['gravity'])):.6g} N"
    return shown


def _limits_text(problem: Problem) -> str:
    """Return the ranges of the limits, and how many joints have none."""
    least, most = float(problem.limit.min()), float(problem.limit.max())
    shown = [f"normal forces {_range_text(least, most)} N"]
    for unit in ("N m", "N"):
        own = np.array([one == unit for one in problem.units], dtype=bool)
        if own.any():
            ends = np.concatenate([problem.lower[own], problem.upper[own]])
            finite = np.abs(ends[np.isfinite(ends)])
            span = _range_text(float(finite.min()), float(finite.max())) if finite.size else "none"
            free = int((np.isinf(problem.lower[own]) | np.isinf(problem.upper[own])).sum())
            span += f" {unit}" if finite.size else ""
            shown.append(
                f"joints {span}"
                + (f" ({free} with an infinite limit)" if free and finite.size else "")
            )
    return "; ".join(shown)


def _range_text(least: float, most: float) -> str:
    return f"{most:.6g}" if least == most else f"{least:.6g} to {most:.6g}"


def _objective_lines(problem: Problem, stated: Part) -> list[Check]:
    """Return the lines on an objective that is neither of the paper's; none for these."""
    own = problem.own
    if own is None:
        return []
    where = f"of {stated['objective']['name'][:60]!r}"
    names = [name for name, _ in own.groups]
    lines = [
        given(f"costs {where}", f"what is minimised, in units of {own.unit:.3g}"),
        given(
            f"columns {where}",
            f"{_quoted(names)}, with their bounds{_unit_range_text(own.column_unit)}",
        ),
        given(
            f"rows {where}",
            f"{_quoted([one[0] for one in own.rows.blocks])}, and the margins in cones and limits "
            f"of normal forces{_unit_range_text(own.rows.unit)}",
        ),
    ]
    low, high, unbounded = own_box(problem, own, np.inf)
    if unbounded.any():
        shown = [f"{low[i] + 0.0:.3g} to {high[i]:.3g}" for i in np.flatnonzero(unbounded)[:10]]
        detail = f"{unbounded.sum()} columns that no row bounds on both sides: {', '.join(shown)}"
        lines.append(given(f"boxes {where}", detail))
    return lines


def _unit_range_text(units: np.ndarray) -> str:
    """Return the range of the units of columns or rows: they hold to a millionth of these."""
    if not units.size:
        return ""
    return f"; in units of {_range_text(float(units.min()), float(units.max()))}"


def _quoted(names: list[str]) -> str:
    """Return names quoted and shortened for print."""
    shown = ", ".join(repr(name[:40]) for name in names[:10])
    return f"{shown} and {len(names) - 10} more" if len(names) > 10 else shown or "none"
