"""Algorithms 1 and 2 of the paper: which joint torques, and how robust."""

from __future__ import annotations

from enum import StrEnum

from graspless_pin.algorithms.explanation import explain
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.modes.rules import Rules, SlidingMode, choice
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.objectives import Margin, Torque, TorqueShare
from graspless_pin.solution import TorqueSolution


class TorqueScale(StrEnum):
    """What Algorithm 2 minimises."""

    ABSOLUTE = "absolute"
    """The largest |torque|."""
    LIMITS = "limits"
    """The largest share of any joint's own limit."""


def torque_objective(margin: float, scale: str = "absolute", regularization: float = 0.0) -> Torque:
    """Return what Algorithm 2 optimises; see `minimize_torque`.

    Raises:
        ArgumentError: If a figure is negative or the scale is not known.
    """
    by_limits = choice(TorqueScale, "scale", scale) is TorqueScale.LIMITS
    return (TorqueShare if by_limits else Torque)(margin, regularization)


def maximize_margin(
    problem: QuasistaticProblem,
    *,
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    static_friction: str = "virtual_sliding",
    solver: str = "piqp",
    regularization: float = 0.0,
    search: str = "auto",
    mode: SlidingMode | None = None,
    node_limit: int | None = None,
    time_limit: float | None = None,
) -> TorqueSolution:
    """Algorithm 1 (44): the joint torques with the largest margin e over all feasible (B, S).

    Several sets of torques may have it; `minimize_torque` at that margin returns the smallest.

    Args:
        problem: Contacts, wrench, joints and limits.
        sign_rule: ``strict``, ``exact`` or ``nonzero``: see `SignRule`.
        sliding_rule: ``exempt`` or ``constrained``: see `SlidingRule`.
        static_friction: ``virtual_sliding``, or ``coulomb`` to drop (22), (27) and (31).
        solver: Any solver of `available_solvers`; another one is asked where its answer fails
            the check.
        regularization: Epsilon >= 0 of the QP that minimises -e/F + (epsilon/2) |f/F|^2 with F the
            load: the external force, or the moment over the contacts' size.
        search: ``auto`` (branch and bound) or ``enumerate`` (all maximal modes).
        mode: Solve this (B, S) only.
        node_limit: Stop ``auto`` after so many nodes and return the best found with its gap.
        time_limit: Likewise after so many seconds.

    Returns:
        A solution; ``found`` is False where nothing is feasible.

    Raises:
        ArgumentError: If an option is not known.
        SolverUnavailableError: If the solver is not installed.
    """
    objective = Margin(regularization)
    rules = Rules.parse(sign_rule, sliding_rule, static_friction)
    return solve_problem(
        problem,
        objective,
        rules,
        solver=solver,
        search=search,
        mode=mode,
        node_limit=node_limit,
        time_limit=time_limit,
        explain=explain,
    )


def minimize_torque(
    problem: QuasistaticProblem,
    margin: float = 0.1,
    *,
    scale: str = "absolute",
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    static_friction: str = "virtual_sliding",
    solver: str = "piqp",
    regularization: float = 0.0,
    search: str = "auto",
    mode: SlidingMode | None = None,
    node_limit: int | None = None,
    time_limit: float | None = None,
) -> TorqueSolution:
    """Algorithm 2 (45): the smallest largest torque for a margin e_0 over all feasible (B, S).

    Unlike (45) as printed, the problem's own torque limits hold too: a torque that no motor can
    make is no answer.

    Args:
        problem: Contacts, wrench, joints and limits.
        margin: Required margin e_0 >= 0, N.
        scale: ``absolute`` minimises max |torque|; ``limits`` the largest share of any joint's
            own limit.
        sign_rule: See `maximize_margin`, as for all other options.
        sliding_rule: See `maximize_margin`.
        static_friction: See `maximize_margin`.
        solver: See `maximize_margin`.
        regularization: Epsilon >= 0 of the QP that minimises t + (epsilon/2) |f/F|^2, t the largest
            torque over what the load makes on the longest lever (or the largest share over that
            torque's, at most 1).
        search: See `maximize_margin`.
        mode: See `maximize_margin`.
        node_limit: See `maximize_margin`.
        time_limit: See `maximize_margin`.

    Returns:
        A solution; ``found`` is False where nothing is feasible.

    Raises:
        ArgumentError: If an option is not known or the margin is negative.
        SolverUnavailableError: If the solver is not installed.
    """
    objective = torque_objective(margin, scale, regularization)
    rules = Rules.parse(sign_rule, sliding_rule, static_friction)
    return solve_problem(
        problem,
        objective,
        rules,
        solver=solver,
        search=search,
        mode=mode,
        node_limit=node_limit,
        time_limit=time_limit,
        explain=explain,
    )
