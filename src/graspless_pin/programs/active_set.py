"""The optimum of one program, as a warm start for another of slightly different numbers.

A warm start by the active set: where the same constraints are active in both, the second optimum
follows from the first by the KKT conditions, two linear systems with one matrix: the active rows
E x = e, and E^T w = -c for their multipliers. Of
all solutions those nearest to the first optimum are taken, so that forces which are not unique
change as little as they can. Nothing is presumed: what comes out is an answer like a solver's, to
be checked like one, and where other constraints have become active it fails that check.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from graspless_pin.problem.checks import FloatArray, all_finite
from graspless_pin.programs.answers import Answer, Outcome, proven
from graspless_pin.programs.program import Program

# Stands in for ranks: relative to the rows' squares, far above their rounding. What it falsifies
# the corrections take back, and the check judges the rest.
DAMPING = 1e-13
CORRECTIONS = 2
# Linear systems are solved to rounding: an answer that is worse, though it would pass, met
# constraints that contradict each other by a hair, and a solver should say what that means.
EXACT = 1e-9

_potrf, _potrs = get_lapack_funcs(("potrf", "potrs"))


class ActiveSet(NamedTuple):
    """An optimum and the constraints that are active there.

    Attributes:
        x: (n,) the solution.
        sizes: Numbers of rows of A and G.
        rows: (r,) the active rows among those of A and G.
        at_bounds: (h,) variables at a bound that is imposed.
        unit: (h, n) rows that pick them.
        upper: (r + h,) whether it is the upper side, or bound, that is active.
        weights: (r + h,) multipliers, positive at upper sides and bounds.
        solver: The solver that it comes from.
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
    """Return a solved answer with what is active, None for a program that is not linear.

    A constraint is active if its multiplier exceeds what is left to its side: interior points end
    with one of them near zero.
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


def solved_on(program: Program, near: ActiveSet, cutoff: float) -> tuple[Answer, ActiveSet] | None:
    """Return what is optimal in a program if the same constraints are active as in another.

    Args:
        program: The program.
        near: An optimum of a similar one.
        cutoff: As in `checked_answer`.

    Returns:
        A checked answer, solved or above the cutoff, and the optimum to carry on from; None if
        other constraints are active, or the programs differ in size.
    """
    n, sizes = len(program.c), (len(program.b), len(program.l))
    if not program.is_polyhedral or len(near.x) != n or near.sizes != sizes:
        return None
    found = _refined(program, near)
    if found is None:
        return None
    x, weights, multipliers = found
    split = multipliers[: sizes[0]], multipliers[sizes[0] :]
    answer = proven(program, (x, *split), near.solver, cutoff)
    if answer.outcome is Outcome.FAILED:
        return None
    exact = EXACT * max(1.0, abs(answer.value))
    if answer.outcome is Outcome.SOLVED and max(answer.residual, abs(answer.gap)) > exact:
        return None
    return answer, ActiveSet(
        x, sizes, near.rows, near.at_bounds, near.unit, near.upper, weights, near.solver
    )


def _refined(program: Program, kept: ActiveSet) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Solve the two linear systems: x, multipliers of what is active, and of all rows.

    None if they cannot be solved.
    """
    E, sides = _active(program, kept)
    wide = len(E) <= len(program.c)
    gram = E @ E.T if wide else E.T @ E
    diagonal = gram.reshape(-1)[:: len(gram) + 1]
    diagonal += DAMPING * float(np.add.reduce(diagonal))
    factor, failed = _potrf(gram, lower=1)
    if failed or not all_finite((sides,)):
        return None
    x, weights = kept.x, kept.weights
    for _ in range(CORRECTIONS):
        beyond, slope = sides - E.dot(x), program.c + weights.dot(E)
        if wide:
            x = x + _potrs(factor, beyond, lower=1)[0].dot(E)
            weights = weights - _potrs(factor, E.dot(slope), lower=1)[0]
        else:
            x = x + _potrs(factor, beyond.dot(E), lower=1)[0]
            weights = weights - E.dot(_potrs(factor, slope, lower=1)[0])
    count = len(kept.rows)
    x[kept.at_bounds] = sides[count:]
    multipliers = np.zeros(sum(kept.sizes))
    multipliers[kept.rows] = weights[:count]
    return x, weights, multipliers


def _active(program: Program, kept: ActiveSet) -> tuple[FloatArray, FloatArray]:
    """Return the (r + h, n) rows that were active and the sides that they were at."""
    rows, at_bounds = kept.rows, kept.at_bounds
    low, high = program.sides
    upper = kept.upper
    sides = np.where(upper[: len(rows)], high[rows], low[rows])
    if not len(at_bounds):
        return program.rows[rows], sides
    bounds = np.where(upper[len(rows) :], program.ub[at_bounds], program.lb[at_bounds])
    return np.concatenate((program.rows[rows], kept.unit)), np.concatenate((sides, bounds))
