"""Warm start of a program from the active set of a similar program's optimum.

If the same constraints are active in both programs, the second optimum follows from the first by
the KKT conditions: two linear systems with one matrix, the active rows E x = e, and E^T w = -c for
their multipliers. Among their solutions the nearest to the first optimum is taken, so that forces
that are not unique change as little as possible. The result is checked like a solver's answer, and
fails the check if other constraints have become active.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from graspless_pin.problem.checks import FloatArray, all_finite
from graspless_pin.programs.answers import Answer, Outcome, proven_answer
from graspless_pin.programs.program import Program

# Regularises rank-deficient systems: relative to the trace of the Gram matrix, far above its
# rounding. The corrections remove the error that it causes, and the check detects what remains.
DAMPING = 1e-13
CORRECTIONS = 2
# Linear systems are solved to rounding. A larger error, though it would pass the check, means that
# the constraints contradict each other slightly: that is left to a solver.
EXACT = 1e-9

_potrf, _potrs = get_lapack_funcs(("potrf", "potrs"))


class ActiveSet(NamedTuple):
    """An optimum and the constraints active at it.

    Attributes:
        x: (n,) the solution.
        sizes: Numbers of rows of A and G.
        rows: (r,) indices of the active rows among those of A and G.
        at_bounds: (h,) indices of the variables at an imposed bound.
        unit: (h, n) unit rows that select these variables.
        upper: (r + h,) whether the upper side, or upper bound, is the active one.
        weights: (r + h,) multipliers, positive at upper sides and bounds.
        solver: Name of the solver that gave the optimum.
    """

    x: FloatArray
    sizes: tuple[int, int]
    rows: NDArray[np.int_]
    at_bounds: NDArray[np.int_]
    unit: FloatArray
    upper: NDArray[np.bool_]
    weights: FloatArray
    solver: str


def active_set_of(program: Program, answer: Answer) -> ActiveSet | None:
    """Return a solved answer with its active constraints; None if the program is not linear.

    A constraint is active if its multiplier exceeds its slack: interior-point solvers end with one
    of the two near zero.
    """
    if not program.is_polyhedral:
        return None
    x, (low, high) = answer.x, program.sides
    weights = np.concatenate((answer.y, answer.z))
    level = program.row_values(x)
    active = np.abs(weights) > np.where(weights > 0.0, high - level, level - low)
    active[: len(program.b)] = True
    rows = np.flatnonzero(active)
    slope = -program.c - program.row_slope(weights)
    slack = np.where(slope > 0.0, program.ub - x, x - program.lb)
    at_bounds = np.flatnonzero(np.abs(slope) >= slack)
    unit = np.zeros((len(at_bounds), len(x)))
    unit[np.arange(len(at_bounds)), at_bounds] = 1.0
    weights = np.concatenate((weights[rows], slope[at_bounds]))
    return ActiveSet(
        x=x,
        sizes=(len(answer.y), len(answer.z)),
        rows=rows,
        at_bounds=at_bounds,
        unit=unit,
        upper=weights > 0.0,
        weights=weights,
        solver=answer.solver,
    )


def optimum_on_active_set(
    program: Program, near: ActiveSet, cutoff: float
) -> tuple[Answer, ActiveSet] | None:
    """Return the optimum of a program on the active set of a similar program.

    Args:
        program: The program.
        near: An optimum of the similar program.
        cutoff: As in `checked_answer`.

    Returns:
        A checked answer, solved or above the cutoff, and its active set for the next warm start;
        None if other constraints are active, or the programs differ in size.
    """
    n, sizes = len(program.c), (len(program.b), len(program.l))
    if not program.is_polyhedral or len(near.x) != n or near.sizes != sizes:
        return None
    refined = _kkt_solution(program, near)
    if refined is None:
        return None
    x, weights, multipliers = refined
    duals = multipliers[: sizes[0]], multipliers[sizes[0] :]
    answer = proven_answer(program, (x, *duals), near.solver, cutoff)
    if answer.outcome is Outcome.FAILED:
        return None
    tolerance = EXACT * max(1.0, abs(answer.value))
    if answer.outcome is Outcome.SOLVED and max(answer.residual, abs(answer.gap)) > tolerance:
        return None
    return answer, ActiveSet(
        x, sizes, near.rows, near.at_bounds, near.unit, near.upper, weights, near.solver
    )


def _kkt_solution(
    program: Program, active_set: ActiveSet
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return x, the active constraints' multipliers and those of all rows; None if not solvable.

    They are the solutions of the two linear systems.
    """
    E, sides = _active_rows_and_sides(program, active_set)
    wide = len(E) <= len(program.c)
    gram = E @ E.T if wide else E.T @ E
    diagonal = gram.reshape(-1)[:: len(gram) + 1]
    diagonal += DAMPING * float(np.add.reduce(diagonal))
    factor, failed = _potrf(gram, lower=1)
    if failed or not all_finite((sides,)):
        return None
    x, weights = active_set.x, active_set.weights
    for _ in range(CORRECTIONS):
        residual, slope = sides - E.dot(x), program.c + weights.dot(E)
        if wide:
            x = x + _potrs(factor, residual, lower=1)[0].dot(E)
            weights = weights - _potrs(factor, E.dot(slope), lower=1)[0]
        else:
            x = x + _potrs(factor, residual.dot(E), lower=1)[0]
            weights = weights - E.dot(_potrs(factor, slope, lower=1)[0])
    row_count = len(active_set.rows)
    x[active_set.at_bounds] = sides[row_count:]
    multipliers = np.zeros(sum(active_set.sizes))
    multipliers[active_set.rows] = weights[:row_count]
    return x, weights, multipliers


def _active_rows_and_sides(
    program: Program, active_set: ActiveSet
) -> tuple[FloatArray, FloatArray]:
    """Return the (r + h, n) active rows, bounds included, and their active sides."""
    rows, at_bounds = active_set.rows, active_set.at_bounds
    low, high = program.sides
    upper = active_set.upper
    sides = np.where(upper[: len(rows)], high[rows], low[rows])
    if not len(at_bounds):
        return program.rows[rows], sides
    bounds = np.where(upper[len(rows) :], program.ub[at_bounds], program.lb[at_bounds])
    return np.concatenate((program.rows[rows], active_set.unit)), np.concatenate((sides, bounds))
