"""What a document proves of forces that do not exist: by how much all of them break constraints."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.bounds import proven_bound, violation
from graspless_pin.report.verify.multipliers import stated_multipliers
from graspless_pin.report.verify.problem import IN_MODE, INFEASIBLE, Problem
from graspless_pin.report.verify.reading import read_mode, read_problem
from graspless_pin.report.verify.states import State
from graspless_pin.report.verify.values import entry


def root_of(
    problem: Problem, status: str, mode: tuple[np.ndarray, np.ndarray] | None = None
) -> State:
    """Return the part of all modes that the proof of an answer speaks of.

    Args:
        problem: The problem.
        status: Of the answer.
        mode: What it selects with which signs, where it is of one mode.
    """
    if status in IN_MODE and mode is not None:
        return State.one_mode(problem, *mode)
    return State.every_mode(problem, free=problem.coulomb or status == "infeasible_forces")


def proven_violation(document: dict[str, Any]) -> float:
    """Return the smallest common violation that a document may state: its multipliers prove it.

    Args:
        document: The document, with its proof.

    Returns:
        In scaled units; 0 where the proof has more than one leaf, or is none.
    """
    try:
        return max(_of_only_leaf(document), 0.0)
    except ValueError:
        return 0.0  # what cannot be checked proves nothing


def _of_only_leaf(document: dict[str, Any]) -> float:
    status, nodes = document["status"], entry(document["proof"], "nodes", "proof")
    if status not in INFEASIBLE or len(nodes) != 1 or nodes[0]["kind"] != "bound":
        return 0.0
    problem = read_problem(document)
    mode = read_mode(document, problem) if status in IN_MODE else None
    free = root_of(problem, status, mode).friction
    m = stated_multipliers(nodes[0]["multipliers"], problem, "node 0")
    bound = proven_bound(problem, m, free, np.inf, objective=False, rounding=tolerances.STATED)
    return violation(problem, m, bound)
