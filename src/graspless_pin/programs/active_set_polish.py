"""A solver's answer brought to rounding: the system of what is active at it, solved again.

Interior points end some 1e-10 away from optimality. Where a limit is far above the load, that
slack times the limit is more than a proof may leave. The KKT conditions on the active set,
E x = e and P x + c + E^T w = 0, are linear: their solution nearest to the answer leaves rounding
only. OSQP calls this solution polishing (Stellato et al., Math. Prog. Comp. 12, 2020, Sec. 5.2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import Program

_RANK = 1e-11
_CORRECTIONS = 2
_ROUNDS = 4
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
    held = np.abs(slope) > np.abs(bound - x)
    weights[:count] = without_cancelling(program.A, weights[:count], slope, held)
    for _ in range(_ROUNDS):
        solved = _solved(program, x, weights, active, held, side, bound)
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
    independent = independent[:, sizes > _RANK * sizes.max(initial=0.0)]
    step = independent @ (independent.T @ y) - y
    change = (step @ A)[held]
    turning = change * slope[held] < 0.0
    room = -slope[held][turning] / change[turning]
    return y + min(1.0, room.min(initial=1.0)) * step


def _solved(
    program: Program,
    x: FloatArray,
    weights: FloatArray,
    active: NDArray[np.bool_],
    held: NDArray[np.bool_],
    side: FloatArray,
    bound: FloatArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Solution and (m + k,) multipliers for given active rows and held variables."""
    rows, free = program.rows[active], ~held
    if not (np.isfinite(side[active]).all() and np.isfinite(bound[held]).all()):
        return None
    x, w = np.where(held, bound, x), weights[active]
    E, n = rows[:, free], int(free.sum())
    system = np.zeros((n + len(E), n + len(E)))
    system[:n, :n] = np.diag(program.P[free])
    system[:n, n:], system[n:, :n] = E.T, E
    try:
        inverse = np.linalg.pinv(system, rcond=_RANK, hermitian=True)
    except np.linalg.LinAlgError:
        return None
    # Residuals in a longer format: what is left is then the rounding of the result.
    long = np.longdouble
    matrix, c, P = rows.astype(long), program.c.astype(long), program.P[free].astype(long)
    target, at, by = side[active].astype(long), x.astype(long), w.astype(long)
    for _ in range(_CORRECTIONS):
        off = np.concatenate([
            -(P * at[free] + c[free] + by @ matrix[:, free]), target - matrix @ at,
        ]).astype(np.float64)  # fmt: skip
        step = inverse @ off
        at[free] += step[:n]
        by += step[n:]
    multipliers = np.zeros(len(weights))
    multipliers[active] = by.astype(np.float64)
    return at.astype(np.float64), multipliers
