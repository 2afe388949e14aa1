"""Documents of many kinds of solutions, at many scales, as they come back from a file."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from tests.core.scenes import random_arguments, scene, structured_arguments

from graspless_pin import (
    QuasistaticProblem,
    SlidingMode,
    TorqueSolution,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

Document = dict[str, Any]

SCALES = ((1.0, 1.0), (1e-9, 1.0), (1e9, 1.0), (1.0, 1e-9), (1.0, 1e9), (1e-9, 1e9))
"""Factors on all forces and on all lengths."""


def documented(solution: TorqueSolution) -> Document:
    """Its document as it comes back from a file.

    No check is about what would help instead, and far limits make the search for it long.
    """
    vars(solution).setdefault("explanation", "Not explained.")
    return json.loads(json.dumps(solution_document(solution), allow_nan=False))


def changed(document: Document, *path: str | int, to: Any) -> Document:
    """A copy with one value replaced."""
    copied = copy.deepcopy(document)
    place: Any = copied
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = to
    return copied


def refused(document: Document) -> bool:
    """Whether a document is refused: a claim is false, or it is none at all."""
    try:
        return not verify_document(document).passed
    except ValueError:
        return True


def failed(document: Document) -> list[str]:
    """Names of the checks that do not hold."""
    return [check.name for check in verify_document(document).checks if check.passed is False]


def places(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The ways to all values of a document."""
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*path, key)
        if isinstance(item, dict | list):
            yield from places(item, (*path, key))


def slab(seed: int = 3, contacts: int = 7, **options: Any) -> QuasistaticProblem:
    """A finger presses onto supports in one plane."""
    return QuasistaticProblem(**structured_arguments(seed, "slab", contacts, **options))


def _standing() -> QuasistaticProblem:
    """A block on three points without friction, and without any joint."""
    points = [[0.1, 0.0, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]]
    return QuasistaticProblem(points, [[0.0, 0.0, 1.0]] * 3, [0, 0, -5.0, 0, 0, 0], friction=0.0)


def _in_mode(**options: Any) -> TorqueSolution:
    problem = scene("rest")
    return minimize_torque(problem, 0.1, mode=minimize_torque(problem, 0.1).mode, **options)


def _apart() -> SlidingMode:
    signs = [[0, 0], [1, 1], [1, -1], [0, 0], [0, 0], [0, 0]]
    return SlidingMode([False, True, True, False, False, False], signs)


def _none() -> SlidingMode:
    return SlidingMode(np.zeros(6, dtype=bool), np.zeros((6, 2)))


SOLUTIONS = {
    "margin": lambda: maximize_margin(scene("up")),
    "torque": lambda: minimize_torque(scene("sphere"), 0.1),
    "tree": lambda: minimize_torque(scene("rest"), 0.1),
    "shares": lambda: minimize_torque(scene("rest"), 0.1, scale="limits"),
    "exact tree": lambda: minimize_torque(
        QuasistaticProblem(**structured_arguments(4, "planar", 7)), 1.0,
        sign_rule="exact", sliding_rule="constrained",
    ),
    "nonzero": lambda: maximize_margin(slab(), sign_rule="nonzero"),
    "coulomb": lambda: minimize_torque(scene("rest"), 0.1, static_friction="coulomb"),
    "regularized": lambda: minimize_torque(scene("rest"), 0.1, regularization=1e-2),
    "regularized shares": lambda: minimize_torque(
        scene("rest"), 0.1, scale="limits", regularization=1e-3
    ),
    "regularized margin": lambda: maximize_margin(scene("down"), regularization=1e-3),
    "one-sided joints": lambda: minimize_torque(
        QuasistaticProblem(**random_arguments(1, 4, slides=1)), 0.1, scale="limits"
    ),
    "no motion needed": lambda: maximize_margin(_standing()),
    "in a mode": _in_mode,
    "limit": lambda: minimize_torque(scene("rest"), 0.1, node_limit=3),
    "infeasible forces": lambda: minimize_torque(scene("rest"), 40.0),
    "infeasible margin": lambda: maximize_margin(scene("rest").with_changes(max_normal_force=1.0)),
    "infeasible shares": lambda: minimize_torque(scene("rest"), 40.0, scale="limits"),
    "infeasible modes": lambda: maximize_margin(scene("up"), sliding_rule="constrained"),
    "infeasible modes torque": lambda: minimize_torque(
        scene("down"), 0.1, sliding_rule="constrained"
    ),
    "infeasible in a mode": lambda: minimize_torque(scene("rest"), 0.1, mode=_none()),
    "round margin": lambda: maximize_margin(scene("up").with_changes(cone="round")),
    "round tree": lambda: minimize_torque(scene("rest").with_changes(cone="round"), 0.1),
    "round shares": lambda: minimize_torque(
        scene("rest").with_changes(cone="round"), 0.1, scale="limits", regularization=1e-3
    ),
    "round infeasible forces": lambda: minimize_torque(
        scene("rest").with_changes(cone="round"), 40.0
    ),
    "infeasible mode": lambda: minimize_torque(scene("rest"), 0.1, mode=_apart()),
}  # fmt: skip
"""A solution of each kind."""
