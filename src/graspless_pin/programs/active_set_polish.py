"""Solution polishing: a solver's answer refined to rounding by the KKT system of its active set.

Interior-point solvers end some 1e-10 away from optimality. If a limit is far above the load, that
slack times the limit exceeds the gap that a proof may leave. The KKT conditions on the active set,
E x = e and P x + c + E^T w = 0, are linear: their solution nearest to the answer is exact up to
rounding. OSQP calls this polishing (Stellato et al., Math. Prog. Comp. 12, 2020, Sec. 5.2).

Multipliers are refined further if a proof needs it: with large limits, the last digit of a large
multiplier times the limit may be more than a bound may lose.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import Program

_RANK_TOLERANCE = 1e-11
_RESIDUAL_CORRECTIONS = 2
_MOST_SIGN_ROUNDS = 4
PrimalDual = tuple[FloatArray, FloatArray, FloatArray]


def polished_answer(program: Program, answer: PrimalDual) -> PrimalDual | None:
    """Return the solution of the KKT system of an answer's active set, nearest to the answer.

    Args:
        program: The program.
        answer: x, y and z as a solver returned them.

    Returns:
        x, y and z, to be checked like a solver's; None if the active constraints contradict each
        other, or there are cones.
    """
    x, weights = answer[0], np.concatenate(answer[1:])
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
        solution = _active_set_solution(program, x, weights, active, at_bound, side, bound)
        if solution is None:
            return None
        x_polished, multipliers = solution
        # Constraints whose multiplier changes sign are not active.
        wrong = active & (multipliers * weights < 0.0)
        wrong[:count] = False
        if not wrong.any():
            return x_polished, multipliers[:count], multipliers[count:]
        active &= ~wrong
        weights = np.where(wrong, 0.0, weights)
    return None


def without_cancelling(
    A: FloatArray, y: FloatArray, slope: FloatArray, held: NDArray[np.bool_]
) -> FloatArray:
    """(m,) multipliers of A x = b, less the part that cancels between dependent rows.

    Such rows may contradict each other by rounding, which the bound multiplies by the part that
    cancels. The slope of variables that are not held stays, and that of held ones keeps its sign.
    """
    independent, sizes, _ = np.linalg.svd(A[:, ~held], full_matrices=False)
    independent = independent[:, sizes > _RANK_TOLERANCE * sizes.max(initial=0.0)]
    step = independent @ (independent.T @ y) - y
    change = (step @ A)[held]
    turning = change * slope[held] < 0.0
    step_lengths = -slope[held][turning] / change[turning]
    return y + min(1.0, step_lengths.min(initial=1.0)) * step


def _active_set_solution(
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
    # Residuals in extended precision: the remaining error is then the rounding of the result.
    long = np.longdouble
    matrix, c, P = rows.astype(long), program.c.astype(long), program.P[free].astype(long)
    target, x_long, w_long = side[active].astype(long), x.astype(long), w.astype(long)
    for _ in range(_RESIDUAL_CORRECTIONS):
        residual = np.concatenate([
            -(P * x_long[free] + c[free] + w_long @ matrix[:, free]), target - matrix @ x_long,
        ]).astype(np.float64)  # fmt: skip
        step = inverse @ residual
        x_long[free] += step[:n]
        w_long += step[n:]
    multipliers = np.zeros(len(weights))
    multipliers[active] = w_long.astype(np.float64)
    return x_long.astype(np.float64), multipliers


_LEAST_MULTIPLIER = 1e-12
"""Relative to the sum of the multipliers' sizes: smaller multipliers are set to zero."""
_SLOPE_NOISE = 1e-9
"""Relative to the size of a slope's terms: a smaller slope is rounding."""
_LEAST_LOSS = 1e-9
"""Rounding that lowers a bound by less than this is ignored."""
_MOST_BOUND_ROUNDING = 1e-2
"""Largest error of a bound by rounding, scaled units."""
_SLOPE_REFINEMENTS = 3
_LONG = np.longdouble
_EPSILON = float(np.finfo(float).eps)


def refined_multipliers(
    program: Program, y: FloatArray, z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return multipliers near the given ones with the highest dual bound.

    The bound is computed in extended precision, less its rounding error. Two changes are tried:
    components that cancel between dependent rows are removed, and reduced costs that are zero up to
    rounding are given the sign whose box bound is zero.

    Args:
        program: The program.
        y: Multipliers of the equalities.
        z: Multipliers of the rows of G.

    Returns:
        The given ones if rounding does not matter, or if no others are better.
    """
    count, weights = len(y), np.concatenate((y, z))
    lowest, highest = program.reach
    largest, total = np.maximum(np.abs(lowest), np.abs(highest)), float(np.abs(weights).sum())
    rounding_loss = _EPSILON * float((np.abs(weights) @ np.abs(program.rows)) @ largest)
    if not program.is_polyhedral or not np.isfinite(rounding_loss) or rounding_loss < _LEAST_LOSS:
        return y, z
    low, high = program.sides
    weights = np.where(np.isfinite(np.where(weights > 0.0, high, low)), weights, 0.0)
    weights[np.abs(weights) <= _LEAST_MULTIPLIER * total] = 0.0
    slope = program.c + weights @ program.rows
    at_bound = np.abs(slope) > _SLOPE_NOISE * (np.abs(weights) @ np.abs(program.rows))
    reduced = weights.copy()
    # Rows whose sides coincide are equalities, too: fixed torques cancel against the balance.
    fixed = low == high
    reduced[fixed] = without_cancelling(program.rows[fixed], weights[fixed], slope, at_bound)
    candidates = [np.concatenate((y, z))]
    for multipliers in (weights, reduced):
        candidates += _with_signed_reduced_costs(program, multipliers)
    best = max(candidates, key=lambda candidate: _safe_bound(program, candidate))
    # An optimum at the end of its box, such as zero torques, needs no multipliers. If zeros improve
    # the bound by more than rounding, the multipliers belong to forces in another box.
    zeros = np.zeros_like(weights)
    if 0.0 < _safe_bound(program, zeros) - _safe_bound(program, best) < _MOST_BOUND_ROUNDING:
        best = zeros
    return best[:count], best[count:]


def certain_bound(program: Program, y: FloatArray, z: FloatArray) -> float:
    """Return the bound that multipliers prove, less its rounding error, as in documents.

    Args:
        program: The program.
        y: Multipliers of the equalities.
        z: Multipliers of the rows of G.
    """
    if not program.is_polyhedral:
        return program.dual_bound(y, z)
    return _safe_bound(program, np.concatenate((y, z)))


def _with_signed_reduced_costs(program: Program, weights: FloatArray) -> list[FloatArray]:
    """Return given and refined multipliers; refined reduced costs have no sign by rounding."""
    (lowest, highest), refinements = program.reach, [weights]
    active = weights != 0.0
    low, high = program.sides
    active |= low == high
    rows = program.rows[active]
    sign = np.where(lowest == 0.0, 1.0, np.where(highest == 0.0, -1.0, 0.0))
    for _ in range(_SLOPE_REFINEMENTS):
        weights = weights.copy()
        slope, size = _slope_and_size(program, weights)
        noise = (np.abs(slope) < _SLOPE_NOISE * size) & (lowest < highest)
        wanted = (4.0 * _EPSILON * size * sign - slope)[noise]
        weights[active] += np.linalg.lstsq(rows[:, noise].T, wanted, rcond=_RANK_TOLERANCE)[0]
        refinements.append(weights)
    return refinements


def _slope_and_size(program: Program, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) gradient of the Lagrangian, and (n,) sums of the sizes of its terms."""
    slope = program.c + weights.astype(_LONG) @ program.rows.astype(_LONG)
    return slope.astype(float), np.abs(weights) @ np.abs(program.rows) + np.abs(program.c)


def _safe_bound(program: Program, weights: FloatArray) -> float:
    """Return the proven dual bound, less its rounding error in extended precision."""
    low, high = program.sides
    side = np.where(weights > 0.0, high, low)
    is_finite = np.isfinite(side)
    finite_weights, side = np.where(is_finite, weights, 0.0), np.where(is_finite, side, 0.0)
    slope = program.c + finite_weights.astype(_LONG) @ program.rows.astype(_LONG)
    lowest, highest = program.reach
    bound = slope @ np.where(slope >= 0.0, lowest, highest) - finite_weights.astype(_LONG) @ side
    largest = np.maximum(np.abs(lowest), np.abs(highest))
    size = _slope_and_size(program, finite_weights)[1] @ largest + np.abs(finite_weights) @ np.abs(
        side
    )
    return float(bound - 4.0 * np.finfo(_LONG).eps * size)
