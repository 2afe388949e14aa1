"""Multipliers of an optimum whose bound rounding leaves alone, for far limits.

Where limits are far, the last digit of a large multiplier times the limit may be more than a bound
may lose. Smaller multipliers lose less, and slopes that lean a hair to the side of the nearer end
of their box lose nothing.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.active_set_polish import without_cancelling
from graspless_pin.programs.program import Program

_PART = 1e-12
"""Of the largest multiplier: smaller ones take no part."""
_NOISE = 1e-9
"""Of what makes a slope: smaller ones are rounding."""
_MATTERS = 1e-9
"""Rounding that may cost a bound less needs no care."""
_ROUNDED = 1e-2
"""Of a bound, scaled: rounding costs no more than that."""
_RANK = 1e-11
_ROUNDS = 3
_LONG = np.longdouble
_EPSILON = float(np.finfo(float).eps)


def sharpened(program: Program, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the multipliers near some that prove the highest bound in a longer format.

    Args:
        program: The program.
        y: Of the equalities.
        z: Of the rows.

    Returns:
        The given ones where rounding does not matter, or where none are better.
    """
    count, weights = len(y), np.concatenate((y, z))
    first, last = program.reach
    far, total = np.maximum(np.abs(first), np.abs(last)), float(np.abs(weights).sum())
    lost = _EPSILON * float((np.abs(weights) @ np.abs(program.rows)) @ far)
    if not program.is_polyhedral or not np.isfinite(lost) or lost < _MATTERS:
        return y, z
    low, high = program.sides
    weights = np.where(np.isfinite(np.where(weights > 0.0, high, low)), weights, 0.0)
    weights[np.abs(weights) <= _PART * total] = 0.0
    slope = program.c + weights @ program.rows
    held = np.abs(slope) > _NOISE * (np.abs(weights) @ np.abs(program.rows))
    smaller = weights.copy()
    # Rows of one side only are equalities, too: fixed torques cancel against the balance.
    fixed = low == high
    smaller[fixed] = without_cancelling(program.rows[fixed], weights[fixed], slope, held)
    tried = [np.concatenate((y, z))]
    for one in (weights, smaller):
        tried += _leaning(program, one)
    best = max(tried, key=lambda one: _bound(program, one))
    # An optimum at the end of its box, such as torques of zero, needs no multiplier at all. What
    # zeros gain beyond rounding is no gain: then the multipliers are of forces in another box.
    none = np.zeros_like(weights)
    if 0.0 < _bound(program, none) - _bound(program, best) < _ROUNDED:
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


def _leaning(program: Program, weights: FloatArray) -> list[FloatArray]:
    """Return multipliers whose slopes lean to the nearer ends of their boxes, better and better."""
    (first, last), tried = program.reach, [weights]
    part = weights != 0.0
    low, high = program.sides
    part |= low == high
    rows = program.rows[part]
    leaning = np.where(first == 0.0, 1.0, np.where(last == 0.0, -1.0, 0.0))
    for _ in range(_ROUNDS):
        weights = weights.copy()
        slope, size = _slope(program, weights)
        noise = (np.abs(slope) < _NOISE * size) & (first < last)
        wanted = (4.0 * _EPSILON * size * leaning - slope)[noise]
        weights[part] += np.linalg.lstsq(rows[:, noise].T, wanted, rcond=_RANK)[0]
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
    far = np.maximum(np.abs(first), np.abs(last))
    size = _slope(program, kept)[1] @ far + np.abs(kept) @ np.abs(side)
    return float(smallest - 4.0 * np.finfo(_LONG).eps * size)
