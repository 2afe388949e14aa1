"""Least squares whose solvers may fail: they return None, or finite numbers of the right shape.

Callers check the numbers themselves by the residuals that they compute from them.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.problem.checks import FloatArray


def nonnegative_squares(matrix: FloatArray, target: FloatArray) -> FloatArray | None:
    """Return the x >= 0 that minimises |matrix x - target|; None where the method fails.

    Args:
        matrix: (k, n).
        target: (k,).
    """
    from scipy.optimize import nnls

    try:
        x = nnls(matrix, target)[0]
    except (RuntimeError, ValueError):
        return None
    return np.maximum(x, 0.0) if _is_answer(x, matrix) else None


def least_squares(matrix: FloatArray, target: FloatArray, rank: float) -> FloatArray | None:
    """Return the shortest x that minimises |matrix x - target|; None where the method fails.

    Args:
        matrix: (k, n).
        target: (k,).
        rank: Singular values below this share of the largest count as zero.
    """
    try:
        x = np.asarray(np.linalg.lstsq(matrix, target, rcond=rank)[0], dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return x if _is_answer(x, matrix) else None


def _is_answer(x: FloatArray, matrix: FloatArray) -> bool:
    return x.shape == matrix.shape[1:] and bool(np.isfinite(x).all())
