"""Algorithms 1 and 2 of the paper, and any other objective: the optimal joint torques."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack, overload

from graspless_pin.algorithms.options import (
    DEFAULT_OPTIONS,
    SolveKeywords,
    SolveOptions,
    refuse_feedback_alone,
    torque_objective,
)
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.solution import TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.algorithms.robust_solution import RobustSolution
    from graspless_pin.algorithms.robust_torques import Feedback
    from graspless_pin.algorithms.uncertainty import Uncertainty


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
    return _nominal_or_robust(problem, Margin(regularization), mode, uncertainty, feedback, options)


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

    Unlike in (45) as printed, the problem's own torque limits hold, too: torques beyond them are
    not admitted.

    Args:
        problem: Contacts, wrench, joints and limits.
        margin: Required margin e_0 >= 0, N; at most that of `maximize_margin`. There is no default,
            as a suitable value depends on the load.
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
    return _nominal_or_robust(problem, objective, mode, uncertainty, feedback, options)


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
    return _nominal_or_robust(problem, objective, mode, uncertainty, feedback, options)


def _nominal_or_robust(
    problem: QuasistaticProblem,
    objective: Objective,
    mode: SlidingMode | None,
    uncertainty: Uncertainty | None,
    feedback: Feedback | None,
    options: SolveKeywords,
) -> TorqueSolution | RobustSolution:
    how = SolveOptions.parse(**options) if options else DEFAULT_OPTIONS
    if uncertainty is None:
        refuse_feedback_alone(feedback)
        return solve_problem(problem, objective, how, mode=mode)
    # Loaded here: only an uncertainty needs it.
    from graspless_pin.algorithms.robust_torques import solve_robust

    return solve_robust(problem, objective, uncertainty, how, feedback=feedback, mode=mode)
