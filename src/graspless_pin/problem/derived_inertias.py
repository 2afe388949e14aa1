"""Inertias of a problem that are worked out when they are first asked for.

Solving needs none, and loops over many states have no time for them; verdicts do.
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
    """Return the attribute of one of the inertias, None where nothing tells it."""

    def derive(problem: object) -> FloatArray | None:
        source = vars(problem).get(_SOURCES, {}).get(name)
        return None if source is None else read_only(source())

    return cached_property(derive)


def with_derived_inertias(
    problem: _Problem, sources: Mapping[str, Callable[[], FloatArray]]
) -> _Problem:
    """Return a problem with what its inertias are made by.

    Args:
        problem: Without inertias.
        sources: What makes `object_inertia` and `joint_inertia`, by name; what they return is not
            checked.
    """
    return changed(problem, **{_SOURCES: sources})


def keep_inertias(problem: Any, other: Any, given: Iterable[str]) -> Any:
    """Return a changed problem with the inertias of the one before, as they are or are made.

    Args:
        problem: The one before.
        other: With those that were given anew.
        given: Their names, and others.
    """
    kept = set(INERTIAS).difference(given)
    if other.joint_count != problem.joint_count:
        kept.discard("joint_inertia")
    if other.passive_count != problem.passive_count:
        kept.discard("object_inertia")
    own, sources = vars(problem), vars(problem).get(_SOURCES, {})
    other = changed(other, **{name: own[name] for name in kept & own.keys()})
    return with_derived_inertias(other, {name: sources[name] for name in kept & sources.keys()})
