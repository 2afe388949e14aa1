"""Objectives by name: scenes, studies, evaluators and the command line ask for them so.

Their keys, choices and help are made of the list below. The figures of an objective are the
arguments of what makes it; ``required_margin`` is asked for as ``margin``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import Any, NamedTuple, get_type_hints

from graspless_pin.algorithms.options import SolveKeywords, SolveOptions, refuse_unknown
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import choice, one_of
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare, key_of


class TorqueScale(StrEnum):
    """What Algorithm 2 minimises."""

    ABSOLUTE = "absolute"
    """The largest |torque|."""
    LIMITS = "limits"
    """The largest share of any joint's own limit."""


def torque_objective(
    margin: float = 0.1, scale: str = "absolute", regularization: float = 0.0
) -> Torque:
    """Return what Algorithm 2 optimises; see `minimize_torque`.

    Raises:
        ArgumentError: If a figure is negative or the scale is not known.
    """
    by_limits = choice(TorqueScale, "scale", scale) is TorqueScale.LIMITS
    return (TorqueShare if by_limits else Torque)(margin, regularization)


class NamedObjective(NamedTuple):
    """An objective that has a name.

    Attributes:
        make: Its class, or a function that returns it.
        aim: What it looks for, in a few words.
    """

    make: Callable[..., Objective]
    aim: str


OBJECTIVES = {
    "margin": NamedObjective(Margin, "Algorithm 1, largest margin"),
    "torque": NamedObjective(torque_objective, "Algorithm 2, least torque"),
}
"""All of them by name: a new one is added to this list."""

AIMS = "; ".join(f"{name}: {one.aim}" for name, one in OBJECTIVES.items())
"""What each looks for."""

_FIGURES = {
    name: {
        key_of(argument.name): argument
        for argument in inspect.signature(one.make).parameters.values()
    }
    for name, one in OBJECTIVES.items()
}
"""By name of an objective the argument of each of its keys."""


def figure_types() -> dict[str, Any]:
    """Return the type of each figure of any objective by its key, as it is annotated."""
    hints = {
        name: get_type_hints(one.make, include_extras=True) for name, one in OBJECTIVES.items()
    }
    return {
        key: hints[name][argument.name]
        for name, figures in _FIGURES.items()
        for key, argument in figures.items()
    }


def objective_named(name: str, figures: Mapping[str, Any]) -> Objective:
    """Return an objective.

    Args:
        name: Its name.
        figures: By key; None, and those that it does not have, count as not given.

    Raises:
        ArgumentError: If there is none of that name, or a figure does not do or is missing.
    """
    one_of(OBJECTIVES, "algorithm", name)
    given = {}
    for key, argument in _FIGURES[name].items():
        if figures.get(key) is not None:
            given[argument.name] = figures[key]
        elif argument.default is argument.empty:
            raise ArgumentError(key, f"is missing; the algorithm {name!r} needs it")
    return OBJECTIVES[name].make(**given)


def objective_and_options(
    *, algorithm: str = "margin", **chosen: Any
) -> tuple[Objective, SolveOptions]:
    """Return what a scene, a study or an evaluator asks for.

    Args:
        algorithm: Name of the objective.
        chosen: Figures of objectives by key, and options of `SolveOptions.parse`.

    Raises:
        ArgumentError: See `objective_named` and `SolveOptions.parse`.
    """
    figures = list(dict.fromkeys(key for own in _FIGURES.values() for key in own))
    objective = objective_named(algorithm, chosen)
    refuse_unknown(chosen, [*figures, *SolveKeywords.__annotations__])
    return objective, SolveOptions.parse(
        **{key: value for key, value in chosen.items() if key not in figures}
    )


def refuse_useless(keys: Iterable[str], algorithm: str) -> None:
    """Refuse keys that change nothing under an algorithm.

    Raises:
        ArgumentError: See `useless`.
    """
    for key in keys:
        if why := useless(key, algorithm):
            raise ArgumentError(key, why)


def useless(key: str, algorithm: str) -> str:
    """Return why a key changes nothing under an algorithm: it is others'; empty if it does."""
    others = users_of(key, algorithm)
    if not others:
        return ""
    return (
        f"is no option of the algorithm {algorithm!r} and would change nothing here; ask for "
        f"algorithm {' or '.join(map(repr, others))}, or leave it out"
    )


def users_of(key: str, algorithm: str) -> list[str]:
    """Return which other algorithms a figure is of that changes nothing under one; empty: none."""
    users = [name for name, figures in _FIGURES.items() if key in figures]
    return [] if algorithm in users else users


def asked_by(objective: Objective) -> tuple[str, dict[str, Any]] | None:
    """Return by which name and figures a class of the list is asked for; None: by none."""
    for name, one in OBJECTIVES.items():
        if type(objective) is one.make:
            figures = _FIGURES[name].items()
            return name, {key: getattr(objective, figure.name) for key, figure in figures}
    return None
