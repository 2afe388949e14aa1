"""What a document is not asked to prove, line by line."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify.bounds import own_box
from graspless_pin.report.verify.figures import Problem
from graspless_pin.report.verify.outcome import Check, given
from graspless_pin.report.verify.values import entry, short_text


def taken_as_given(problem: Problem, document: dict[str, Any]) -> list[Check]:
    """Return a line for each part of a document that all checks start from."""
    return [
        given(
            "the problem",
            "contact points, normals, tangents, sliding, friction, Jacobian, external wrench, "
            "limits, options and rules; poses, masses and names",
        ),
        *_of_objective(problem, document),
        given(
            "how it was found",
            "counters of the search, solver, versions, hashes, words, and the optima with "
            "another threshold of motions",
        ),
    ]


def _of_objective(problem: Problem, document: dict[str, Any]) -> list[Check]:
    """Return what is taken as it stands of an objective that is none of the paper's."""
    own = problem.own
    if own is None:
        return []
    stated = document["objective"]
    where = f"of {stated['name'][:60]!r}"
    names = [short_text(entry(one, "name", "a column"), "a name") for one in stated["columns"]]
    lines = [
        given(f"costs {where}", "what is minimised, in which unit"),
        given(f"columns {where}", f"{_listed(names)}, with their bounds"),
        given(
            f"rows {where}",
            f"{_listed([one[0] for one in own.rows.blocks])}, and the margins in cones and limits "
            "of normal forces",
        ),
    ]
    low, high, unbounded = own_box(problem, own, np.inf)
    if unbounded.any():
        shown = [f"{low[i]:.3g} to {high[i]:.3g}" for i in np.flatnonzero(unbounded)[:10]]
        detail = f"{', '.join(shown)}: {unbounded.sum()} columns that no row bounds on both sides"
        lines.append(given(f"boxes {where}", detail))
    return lines


def _listed(names: list[str]) -> str:
    """Return names as they may be printed, whatever they hold."""
    shown = ", ".join(repr(name[:40]) for name in names[:10])
    return f"{shown} and {len(names) - 10} more" if len(names) > 10 else shown or "none"
