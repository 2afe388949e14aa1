"""Bounds of an objective's own columns that follow from its constraints, worked out here.

What a document says of them is used where nothing follows.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.figures import Problem
from graspless_pin.report.verify.own_objective import OwnObjective

_PASSES = 3


def implied_box(
    problem: Problem, own: OwnObjective, low: np.ndarray, high: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return bounds of the columns.

    Each row bounds each of its columns by what forces and other columns may be at most.

    Args:
        problem: The problem.
        own: Its objective.
        low: (M, 3) smallest forces along n, t1, t2.
        high: (M, 3) largest forces.
        reach: The largest normal forces that are looked at, N.

    Returns:
        (k,) lower and upper bounds, and (k,) whether one of them is the document's word.
    """
    C, least, most = _rows(problem, own, low, high)
    first, last = own.bounds.copy()
    for _ in range(_PASSES):
        # C y <= most and C y >= least, for y between first and last.
        for sides, sign in ((most, 1.0), (-least, -1.0)):
            ends = np.where(sign * C > 0.0, first, last)
            with np.errstate(invalid="ignore"):
                parts = np.where(C == 0.0, 0.0, sign * C * ends)
            open_, known = np.isinf(parts), np.where(np.isinf(parts), 0.0, parts)
            size = np.abs(known).sum(axis=1, keepdims=True) + np.abs(sides)[:, None]
            others = known.sum(axis=1, keepdims=True) - known - tolerances.SAME * size
            room = np.where(
                open_.sum(axis=1, keepdims=True) > open_, np.inf, sides[:, None] - others
            )
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = np.where((C == 0.0) | np.isinf(room), np.nan, room / (sign * C))
            up = sign * C > 0.0
            last = np.fmin(
                last, np.fmin.reduce(np.where(up, bound, np.nan), axis=0, initial=np.inf)
            )
            down = np.where(up, np.nan, bound)
            first = np.fmax(first, np.fmax.reduce(down, axis=0, initial=-np.inf))
    low, high = own.boxes[0 if np.isfinite(reach) else 1]
    unbounded = np.isinf(first) | np.isinf(last)
    low = np.where(np.isinf(first), np.minimum(low, last), first)
    return low, np.where(np.isinf(last), np.maximum(high, low), last), unbounded


def _rows(
    problem: Problem, own: OwnObjective, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return all rows with columns: (r, k) coefficients, and (r,) between what C y must lie."""
    frames = problem.frames.copy()
    frames[~problem.cone, 0] = problem.directions[~problem.cone]
    wrench = np.concatenate([frames, np.cross(problem.p[:, None], frames)], axis=2).transpose(
        2, 0, 1
    )
    forces = np.concatenate([own.rows.forces, wrench])
    ends = forces * low, forces * high
    smallest, largest = np.minimum(*ends).sum(axis=(1, 2)), np.maximum(*ends).sum(axis=(1, 2))
    absent, outward = np.full(problem.count, np.inf), np.full(problem.count, -np.inf)
    for c in np.flatnonzero(problem.cone).tolist():
        # A face: h^T f is at least this inside the box.
        faces = problem.faces(c)
        outward[c] = np.minimum(faces * low[c], faces * high[c]).sum(axis=1).max()
    most = [problem.limit - low[:, 0], np.where(problem.cone, absent, high[:, 0])]
    most += [np.concatenate([own.rows.high, -problem.w]) - smallest, -own.margins - outward]
    least = [-absent, -absent, np.concatenate([own.rows.low, -problem.w]) - largest, -absent]
    C = np.concatenate(
        [own.normal_upper, own.normal_lower, own.rows.columns, own.balance, own.faces]
    )
    kept = C.any(axis=1)
    return C[kept], np.concatenate(least)[kept], np.concatenate(most)[kept]
