"""Algorithms 1 and 2 of the paper, and any other objective: which joint torques, how robust.

Scenes, studies, evaluators and the command line ask for objectives by name. Their keys, choices and
help are made of the list below. The figures of an objective are the arguments of what makes it;
``required_margin`` is asked for as ``margin``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack, get_type_hints, overload

from graspless_pin.algorithms.options import (
    DEFAULT_OPTIONS,
    SolveKeywords,
    SolveOptions,
    need_uncertainty,
    refuse_unknown,
)
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import choice, one_of
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare, key_of
from graspless_pin.solution import TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.algorithms.robust_solution import RobustSolution
    from graspless_pin.algorithms.robust_torques import Feedback
    from graspless_pin.algorithms.uncertainty import Uncertainty


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


@overload
def maximize_margin(
    problem: QuasistaticProblem,
    *,
    regularization: float = 0.0,
    mode: SlidingMode | None = None,
    uncertainty: None = None,
    **options: Unpack[SolveKeywords],
) -> TorqueSolution: ...


@overload
def maximize_margin(
    problem: QuasistaticProblem,
    *,
    regularization: float = 0.0,
    mode: SlidingMode | None = None,
    uncertainty: Uncertainty,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> RobustSolution: ...


def maximize_margin(
    problem: QuasistaticProblem,
    *,
    regularization: float = 0.0,
    mode: SlidingMode | None = None,
    uncertainty: Uncertainty | None = None,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> TorqueSolution | RobustSolution:
    """Algorithm 1 (44): the joint torques with the largest margin e over all feasible (B, S).

    Several sets of torques may have it; `minimize_torque` at that margin returns the smallest.

    Args:
        problem: Contacts, wrench, joints and limits.
        regularization: Epsilon >= 0 of the QP that minimises -e/F + (epsilon/2) |f/F|^2 with F the
            load: the external force, or the moment over the contacts' size.
        mode: Solve this (B, S) only.
        uncertainty: What is not known exactly: then one vector of torques serves its whole set.
        feedback: Joint stiffness that adds to those torques, N m/rad (N/m), or a controller.
        options: See `SolveOptions.parse`.

    Returns:
        A solution, or a `RobustSolution`; ``found`` is False where nothing is feasible.

    Raises:
        ArgumentError: If an option is not known.
        SolverUnavailableError: If the solver is not installed.

    Examples:
        >>> from graspless_pin import load_scene, maximize_margin
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> solution = maximize_margin(problem)
        >>> print(f"{solution.margin:.4f} N, {solution.torques.round(4)} N m")
        1.6504 N, [-4.835  4.835] N m
    """
    return _solved(problem, Margin(regularization), mode, uncertainty, feedback, options)


@overload
def minimize_torque(
    problem: QuasistaticProblem,
    margin: float,
    *,
    scale: str = "absolute",
    regularization: float = 0.0,
    mode: SlidingMode | None = None,
    uncertainty: None = None,
    **options: Unpack[SolveKeywords],
) -> TorqueSolution: ...


@overload
def minimize_torque(
    problem: QuasistaticProblem,
    margin: float,
    *,
    scale: str = "absolute",
    regularization: float = 0.0,
    mode: SlidingMode | None = None,
    uncertainty: Uncertainty,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> RobustSolution: ...


def minimize_torque(
    problem: QuasistaticProblem,
    margin: float,
    *,
    scale: str = "absolute",
    regularization: float = 0.0,
    mode: SlidingMode | None = None,
    uncertainty: Uncertainty | None = None,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> TorqueSolution | RobustSolution:
    """Algorithm 2 (45): the smallest largest torque for a margin e_0 over all feasible (B, S).

    Unlike (45) as printed, the problem's own torque limits hold too: a torque that no motor can
    make is no answer.

    Args:
        problem: Contacts, wrench, joints and limits.
        margin: Required margin e_0 >= 0, N; at most that of `maximize_margin`. There is no default:
            what is little beside one load is too much beside another.
        scale: ``absolute`` minimises max |torque|; ``limits`` the largest share of any joint's
            own limit.
        regularization: Epsilon >= 0 of the QP that minimises t + (epsilon/2) |f/F|^2, t the largest
            torque over what the load makes on the longest lever (or the largest share over that
            torque's, at most 1).
        mode: Solve this (B, S) only.
        uncertainty: What is not known exactly: then one vector of torques serves its whole set.
        feedback: Joint stiffness that adds to those torques, N m/rad (N/m), or a controller.
        options: See `SolveOptions.parse`.

    Returns:
        A solution, or a `RobustSolution`; ``found`` is False where nothing is feasible.

    Raises:
        ArgumentError: If an option is not known or the margin is negative.
        SolverUnavailableError: If the solver is not installed.

    Examples:
        >>> from graspless_pin import load_scene, minimize_torque
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> solution = minimize_torque(problem, margin=0.1)
        >>> print(f"{solution.max_torque:.4f} N m")
        0.9618 N m
    """
    objective = torque_objective(margin, scale, regularization)
    return _solved(problem, objective, mode, uncertainty, feedback, options)


@overload
def optimize(
    problem: QuasistaticProblem,
    objective: Objective,
    *,
    mode: SlidingMode | None = None,
    uncertainty: None = None,
    **options: Unpack[SolveKeywords],
) -> TorqueSolution: ...


@overload
def optimize(
    problem: QuasistaticProblem,
    objective: Objective,
    *,
    mode: SlidingMode | None = None,
    uncertainty: Uncertainty,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> RobustSolution: ...


def optimize(
    problem: QuasistaticProblem,
    objective: Objective,
    *,
    mode: SlidingMode | None = None,
    uncertainty: Uncertainty | None = None,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> TorqueSolution | RobustSolution:
    """Find the best contact forces for an objective over all feasible (B, S).

    Args:
        problem: Contacts, wrench, joints and limits.
        objective: What is optimised: one of the paper's, or one of your own.
        mode: Solve this (B, S) only.
        uncertainty: What is not known exactly: then one vector of torques serves its whole set.
        feedback: Joint stiffness that adds to those torques, N m/rad (N/m), or a controller.
        options: See `SolveOptions.parse`.

    Returns:
        A solution, or a `RobustSolution`; ``found`` is False where nothing is feasible.

    Raises:
        ArgumentError: If an argument is none of its kind or an option is not known.
        SolverUnavailableError: If the solver is not installed.

    Examples:
        >>> from graspless_pin import Torque, load_scene, optimize
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> print(f"{optimize(problem, Torque(required_margin=0.1)).max_torque:.4f} N m")
        0.9618 N m
    """
    return _solved(problem, objective, mode, uncertainty, feedback, options)


def _solved(
    problem: QuasistaticProblem,
    objective: Objective,
    mode: SlidingMode | None,
    uncertainty: Uncertainty | None,
    feedback: Feedback | None,
    options: SolveKeywords,
) -> TorqueSolution | RobustSolution:
    how = SolveOptions.parse(**options) if options else DEFAULT_OPTIONS
    if uncertainty is None:
        need_uncertainty(feedback)
        return solve_problem(problem, objective, how, mode=mode)
    # Loaded here: what is known exactly goes without.
    from graspless_pin.algorithms.robust_torques import solve_robust

    return solve_robust(problem, objective, uncertainty, how, feedback=feedback, mode=mode)


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
