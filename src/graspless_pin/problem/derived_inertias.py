"""Inertias of a problem that are computed when they are first read.

Solving needs none, and loops over many states save the time; verdicts need them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import Any, TypeVar

from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import changed

INERTIAS = ("object_inertia", "joint_inertia")
_SOURCES = "_inertia_sources"
_Problem = TypeVar("_Problem")


def derived(name: str) -> Any:
    """Return a cached property that computes an inertia; its value is None without a source."""

    def computed_inertia(problem: object) -> FloatArray | None:
        source = vars(problem).get(_SOURCES, {}).get(name)
        return None if source is None else read_only(source())

    return cached_property(computed_inertia)


def with_derived_inertias(
    problem: _Problem, sources: Mapping[str, Callable[[], FloatArray]]
) -> _Problem:
    """Return a problem with the functions that compute its inertias.

    Args:
        problem: A problem without inertias.
        sources: Functions that return `object_inertia` and `joint_inertia`, by name; their results
            are not checked.
    """
    return changed(problem, **{_SOURCES: sources})


def keep_inertias(problem: Any, other: Any, given: Iterable[str]) -> Any:
    """Return a changed problem with the original's inertias, or the functions that compute them.

    Args:
        problem: The original problem.
        other: The changed problem.
        given: Names of all arguments that were changed, whose inertias are not replaced.
    """
    kept = set(INERTIAS).difference(given)
    if other.joint_count != problem.joint_count:
        kept.discard("joint_inertia")
    if other.passive_count != problem.passive_count:
        kept.discard("object_inertia")
    attributes, sources = vars(problem), vars(problem).get(_SOURCES, {})
    other = changed(other, **{name: attributes[name] for name in kept & attributes.keys()})
    return with_derived_inertias(other, {name: sources[name] for name in kept & sources.keys()})
