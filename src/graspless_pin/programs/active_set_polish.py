"""A solver's answer brought to rounding: the system of what is active at it, solved again.

Interior points end some 1e-10 away from optimality. Where a limit is far above the load, that
slack times the limit is more than a proof may leave. The KKT conditions on the active set,
E x = e and P x + c + E^T w = 0, are linear: their solution nearest to the answer leaves rounding
only. OSQP calls this solution polishing (Stellato et al., Math. Prog. Comp. 12, 2020, Sec. 5.2).

Multipliers are refined further where a proof needs it: where limits are far, the last digit of a
large multiplier times the limit may be more than a bound may lose.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import Program

_RANK_TOLERANCE = 1e-11
_RESIDUAL_CORRECTIONS = 2
_MOST_SIGN_ROUNDS = 4
Found = tuple[FloatArray, FloatArray, FloatArray]


def polished(program: Program, found: Found) -> Found | None:
    """Return the solution and multipliers nearest to an answer that meet what is active exactly.

    Args:
        program: The program.
        found: x, y and z as a solver left them.

    Returns:
        x, y and z; None where the active constraints contradict each other, or there are cones.
        Nothing is presumed: it is an answer to be checked like any other.
    """
    x, weights = found[0], np.concatenate(found[1:])
    if program.cone_count or not (np.isfinite(x).all() and np.isfinite(weights).all()):
        return None
    count, (low, high) = len(program.b), program.sides
    level = program.rows @ x
    side = np.where(weights > 0.0, high, low)
    active = np.abs(weights) > np.abs(side - level)
    active[:count] = True
    slope = program.P * x + program.c + weights @ program.rows
    bound = np.where(slope > 0.0, program.lb, program.ub)
    at_bound = np.abs(slope) > np.abs(bound - x)
    weights[:count] = without_cancelling(program.A, weights[:count], slope, at_bound)
    for _ in range(_MOST_SIGN_ROUNDS):
        solved = _solved(program, x, weights, active, at_bound, side, bound)
        if solved is None:
            return None
        nearer, turned = solved
        # Multipliers of one sign only: those that would need the other have no part.
        wrong = active & (turned * weights < 0.0)
        wrong[:count] = False
        if not wrong.any():
            return nearer, turned[:count], turned[count:]
        active &= ~wrong
        weights = np.where(wrong, 0.0, weights)
    return None


def without_cancelling(
    A: FloatArray, y: FloatArray, slope: FloatArray, held: NDArray[np.bool_]
) -> FloatArray:
    """(m,) multipliers of A x = b with little that cancels between rows which depend on each other.

    Such rows may contradict each other by rounding, and the bound multiplies that by what cancels.
    The slope of variables that are not held stays, and that of held ones keeps its sign.
    """
    independent, sizes, _ = np.linalg.svd(A[:, ~held], full_matrices=False)
    independent = independent[:, sizes > _RANK_TOLERANCE * sizes.max(initial=0.0)]
    step = independent @ (independent.T @ y) - y
    change = (step @ A)[held]
    turning = change * slope[held] < 0.0
    step_lengths = -slope[held][turning] / change[turning]
    return y + min(1.0, step_lengths.min(initial=1.0)) * step


def _solved(
    program: Program,
    x: FloatArray,
    weights: FloatArray,
    active: NDArray[np.bool_],
    at_bound: NDArray[np.bool_],
    side: FloatArray,
    bound: FloatArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Solution and (m + k,) multipliers for given active rows and held variables."""
    rows, free = program.rows[active], ~at_bound
    if not (np.isfinite(side[active]).all() and np.isfinite(bound[at_bound]).all()):
        return None
    x, w = np.where(at_bound, bound, x), weights[active]
    E, n = rows[:, free], int(free.sum())
    system = np.zeros((n + len(E), n + len(E)))
    system[:n, :n] = np.diag(program.P[free])
    system[:n, n:], system[n:, :n] = E.T, E
    try:
        inverse = np.linalg.pinv(system, rcond=_RANK_TOLERANCE, hermitian=True)
    except np.linalg.LinAlgError:
        return None
    # Residuals in a longer format: what is left is then the rounding of the result.
    long = np.longdouble
    matrix, c, P = rows.astype(long), program.c.astype(long), program.P[free].astype(long)
    target, at, by = side[active].astype(long), x.astype(long), w.astype(long)
    for _ in range(_RESIDUAL_CORRECTIONS):
        off = np.concatenate([
            -(P * at[free] + c[free] + by @ matrix[:, free]), target - matrix @ at,
        ]).astype(np.float64)  # fmt: skip
        step = inverse @ off
        at[free] += step[:n]
        by += step[n:]
    multipliers = np.zeros(len(weights))
    multipliers[active] = by.astype(np.float64)
    return at.astype(np.float64), multipliers


_LEAST_MULTIPLIER = 1e-12
"""Of the largest multiplier: smaller ones take no part."""
_SLOPE_NOISE = 1e-9
"""Of what makes a slope: smaller ones are rounding."""
_LEAST_LOSS = 1e-9
"""Rounding that may cost a bound less needs no care."""
_MOST_BOUND_ROUNDING = 1e-2
"""Of a bound, scaled: rounding costs no more than that."""
_SLOPE_REFINEMENTS = 3
_LONG = np.longdouble
_EPSILON = float(np.finfo(float).eps)


def sharpened(program: Program, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return multipliers near the given ones whose dual bound is highest.

    It is worked out in extended precision, less its rounding error. Two changes are tried:
    components that cancel between dependent rows are removed, and reduced costs that are zero up to
    rounding are given the sign whose box bound is zero.

    Args:
        program: The program.
        y: Of the equalities.
        z: Of the rows.

    Returns:
        The given ones where rounding does not matter, or where none are better.
    """
    count, weights = len(y), np.concatenate((y, z))
    first, last = program.reach
    largest, total = np.maximum(np.abs(first), np.abs(last)), float(np.abs(weights).sum())
    lost = _EPSILON * float((np.abs(weights) @ np.abs(program.rows)) @ largest)
    if not program.is_polyhedral or not np.isfinite(lost) or lost < _LEAST_LOSS:
        return y, z
    low, high = program.sides
    weights = np.where(np.isfinite(np.where(weights > 0.0, high, low)), weights, 0.0)
    weights[np.abs(weights) <= _LEAST_MULTIPLIER * total] = 0.0
    slope = program.c + weights @ program.rows
    at_bound = np.abs(slope) > _SLOPE_NOISE * (np.abs(weights) @ np.abs(program.rows))
    smaller = weights.copy()
    # Rows of one side only are equalities, too: fixed torques cancel against the balance.
    fixed = low == high
    smaller[fixed] = without_cancelling(program.rows[fixed], weights[fixed], slope, at_bound)
    tried = [np.concatenate((y, z))]
    for multipliers in (weights, smaller):
        tried += _with_signed_reduced_costs(program, multipliers)
    best = max(tried, key=lambda one: _bound(program, one))
    # An optimum at the end of its box, such as torques of zero, needs no multiplier at all. What
    # zeros gain beyond rounding is no gain: then the multipliers are of forces in another box.
    none = np.zeros_like(weights)
    if 0.0 < _bound(program, none) - _bound(program, best) < _MOST_BOUND_ROUNDING:
        best = none
    return best[:count], best[count:]


def certain_bound(program: Program, y: FloatArray, z: FloatArray) -> float:
    """Return the bound that multipliers prove less what rounding may hide of it, as documents do.

    Args:
        program: The program.
        y: Of the equalities.
        z: Of the rows.
    """
    if not program.is_polyhedral:
        return program.dual_bound(y, z)
    return _bound(program, np.concatenate((y, z)))


def _with_signed_reduced_costs(program: Program, weights: FloatArray) -> list[FloatArray]:
    """Return multipliers whose reduced costs have no sign that rounding gave them, step by step."""
    (first, last), tried = program.reach, [weights]
    part = weights != 0.0
    low, high = program.sides
    part |= low == high
    rows = program.rows[part]
    sign = np.where(first == 0.0, 1.0, np.where(last == 0.0, -1.0, 0.0))
    for _ in range(_SLOPE_REFINEMENTS):
        weights = weights.copy()
        slope, size = _slope(program, weights)
        noise = (np.abs(slope) < _SLOPE_NOISE * size) & (first < last)
        wanted = (4.0 * _EPSILON * size * sign - slope)[noise]
        weights[part] += np.linalg.lstsq(rows[:, noise].T, wanted, rcond=_RANK_TOLERANCE)[0]
        tried.append(weights)
    return tried


def _slope(program: Program, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope of the Lagrangian by each variable, and the size of what makes it."""
    slope = program.c + weights.astype(_LONG) @ program.rows.astype(_LONG)
    return slope.astype(float), np.abs(weights) @ np.abs(program.rows) + np.abs(program.c)


def _bound(program: Program, weights: FloatArray) -> float:
    """Return the proven bound less what rounding may hide of it in the longer format."""
    low, high = program.sides
    side = np.where(weights > 0.0, high, low)
    there = np.isfinite(side)
    kept, side = np.where(there, weights, 0.0), np.where(there, side, 0.0)
    slope = program.c + kept.astype(_LONG) @ program.rows.astype(_LONG)
    first, last = program.reach
    smallest = slope @ np.where(slope >= 0.0, first, last) - kept.astype(_LONG) @ side
    largest = np.maximum(np.abs(first), np.abs(last))
    size = _slope(program, kept)[1] @ largest + np.abs(kept) @ np.abs(side)
    return float(smallest - 4.0 * np.finfo(_LONG).eps * size)
