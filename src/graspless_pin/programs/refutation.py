"""Multipliers that prove that there are no forces, brought to rounding for far limits.

A solver's multipliers leave slopes of some 1e-10 where a proof needs zero, and the box of all
forces multiplies them by its limits.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import Program

_PART = 1e-9
"""Of all multipliers: smaller ones take no part."""
_HARDLY = 1e-6
"""Of what makes a slope: smaller ones are a solver's noise."""
_RANK = 1e-11
_ROUNDS = 4
_ROUNDING = 4.0 * float(np.finfo(float).eps)


def refuting(program: Program, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the multipliers near some that prove the largest smallest common violation.

    Args:
        program: The program.
        y: Of the equalities.
        z: Of the rows.

    Returns:
        y and z, of which nothing is presumed: they may prove no more than the given ones.
    """
    count, weights = len(y), np.concatenate((y, z))
    total = float(np.abs(weights).sum())
    if not (np.isfinite(total) and total > 0.0):
        return y, z
    first, last = program.whole_reach
    best, proven = weights, program.infeasibility_bound(y, z)
    low, high = program.sides
    weights = np.where(np.isfinite(np.where(weights > 0.0, high, low)), weights, 0.0) / total
    part = np.abs(weights) > _PART
    rows, long = program.rows[part], np.longdouble
    held = np.zeros(len(first), dtype=bool)
    for _ in range(_ROUNDS):
        slope = (weights[part].astype(long) @ rows.astype(long)).astype(float)
        size = np.abs(weights[part]) @ np.abs(rows)
        loses = np.minimum(slope * first, slope * last) < 0.0
        held |= loses & (np.abs(slope) < _HARDLY * size)
        # A hair on the side where the nearer bound counts.
        wanted = _ROUNDING * size * np.where(first == 0.0, 1.0, np.where(last == 0.0, -1.0, 0.0))
        off = (wanted - slope)[held]
        step = np.linalg.lstsq(rows[:, held].T, off, rcond=_RANK)[0]
        weights = np.where(part, weights, 0.0)
        weights[part] += step
        found = program.infeasibility_bound(weights[:count], weights[count:])
        if found > proven:
            best, proven = weights.copy(), found
    return best[:count], best[count:]
