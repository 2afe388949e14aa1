"""Bounds that multipliers prove: the smallest value of the Lagrangian over a box of forces.

For any multipliers, no forces that obey all constraints have an objective below it. The multipliers
need not be stationary: the box bounds the rest. Sums are formed in the longest floating-point
format of the machine, and their rounding error is subtracted. Where no forces are feasible,
multipliers prove the smallest violation of the constraints.

The box of an objective's own columns follows from its constraints; the box that a document states
is used where no constraint implies one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.own_objective import OwnObjective
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.reading import StatedMultipliers

_PASSES = 3


def implied_box(
    problem: Problem, own: OwnObjective, low: np.ndarray, high: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the bounds of an objective's own columns that the rows imply.

    Each row bounds each of its columns by the largest contribution of forces and other columns.

    Args:
        problem: The problem.
        own: Its objective.
        low: (M, 3) smallest forces along n, t1, t2.
        high: (M, 3) largest forces.
        reach: The largest normal forces considered, N.

    Returns:
        (k,) lower and upper bounds, and (k,) whether one of them is only stated in the document.
    """
    C, least, most = _column_rows(problem, own, low, high)
    first, last = own.bounds.copy()
    for _ in range(_PASSES):
        # C y <= most and C y >= least, for y between first and last.
        for sides, sign in ((most, 1.0), (-least, -1.0)):
            ends = np.where(sign * C > 0.0, first, last)
            with np.errstate(invalid="ignore"):
                parts = np.where(C == 0.0, 0.0, sign * C * ends)
            open_, finite = np.isinf(parts), np.where(np.isinf(parts), 0.0, parts)
            size = np.abs(finite).sum(axis=1, keepdims=True) + np.abs(sides)[:, None]
            others = finite.sum(axis=1, keepdims=True) - finite - tolerances.SAME * size
            slack = np.where(
                open_.sum(axis=1, keepdims=True) > open_, np.inf, sides[:, None] - others
            )
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = np.where((C == 0.0) | np.isinf(slack), np.nan, slack / (sign * C))
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


def _column_rows(
    problem: Problem, own: OwnObjective, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows with own columns: (r, k) coefficients C, (r,) lower and upper sides of C y."""
    wrench = (_force_frames(problem) @ problem.passive).transpose(2, 0, 1)
    forces = np.concatenate([own.rows.forces, wrench])
    ends = forces * low, forces * high
    smallest, largest = np.minimum(*ends).sum(axis=(1, 2)), np.maximum(*ends).sum(axis=(1, 2))
    absent, outward = np.full(problem.count, np.inf), np.full(problem.count, -np.inf)
    for c in np.flatnonzero(problem.has_cone).tolist():
        # A face: h^T f is at least this inside the box.
        faces = problem.faces(c)
        outward[c] = np.minimum(faces * low[c], faces * high[c]).sum(axis=1).max()
    most = [problem.limit - low[:, 0], np.where(problem.has_cone, absent, high[:, 0])]
    most += [np.concatenate([own.rows.high, -problem.w]) - smallest, -own.margins - outward]
    least = [-absent, -absent, np.concatenate([own.rows.low, -problem.w]) - largest, -absent]
    C = np.concatenate(
        [own.normal_upper, own.normal_lower, own.rows.columns, own.balance, own.faces]
    )
    kept = C.any(axis=1)
    return C[kept], np.concatenate(least)[kept], np.concatenate(most)[kept]


_LONG = np.longdouble


def proven_bound(
    problem: Problem,
    m: StatedMultipliers,
    free: np.ndarray,
    reach: float,
    *,
    objective: bool = True,
    rounding: float = tolerances.LONG,
) -> float:
    """Return a lower bound on the objective of all forces that obey all constraints.

    Args:
        problem: The problem.
        m: Any multipliers.
        free: (M, 2, 2) whether friction may be negative, positive along t1 and t2.
        reach: The largest normal forces considered, N.
        objective: Whether the objective counts. Without it the objective is 0, and a bound above 0
            proves that there are no such forces.
        rounding: Relative rounding error, of the sum of the sizes of all terms.
    """
    total, size = _constant_term(problem, m)
    of_forces = *_force_slopes(problem, m), problem.curvature * objective
    of_columns = _column_slopes(problem, m, objective=objective)
    boxes = _force_box(problem, reach, free), column_box(problem, reach)
    for (slopes, sizes, q), (low, high) in zip((of_forces, of_columns), boxes, strict=True):
        if (low > high).any():
            return np.inf
        total += _least_quadratic(slopes, low, high, q)
        size += (sizes * np.maximum(np.abs(low), np.abs(high))).sum()
    return float(total - rounding * size)


def violation(problem: Problem, m: StatedMultipliers, bound: float) -> float:
    """Return the proven smallest common violation of all constraints, in scaled units.

    Args:
        problem: The problem.
        m: Any multipliers.
        bound: The bound that they prove without the objective.
    """
    F, joints = problem.force, problem.joint_scale
    up, down = problem.share_torques
    scale = problem.passive_scale
    total = float(np.abs(m.balance) @ scale + (m.torque_upper + m.torque_lower) @ joints)
    parts = m.faces.sum() + np.abs(m.round).sum() + m.normal_upper.sum() + m.normal_lower.sum()
    total += F * float(parts)
    if problem.by_limits:
        up, down = (np.maximum(joints, problem.unit * one) for one in (up, down))
    else:
        up, down = problem.unit * up, problem.unit * down
    total += float(m.share_upper @ up + m.share_lower @ down)
    if problem.own is not None:
        total += float((m.own_upper + m.own_lower) @ problem.own.rows.unit)
    return bound / total if total > 0.0 else -np.inf


def _force_slopes(problem: Problem, m: StatedMultipliers) -> tuple[np.ndarray, np.ndarray]:
    """(M, 3) slope of the Lagrangian by each force component, and the sum of its terms' sizes."""
    frames, J = _force_frames(problem).astype(_LONG), problem.J.astype(_LONG)
    y, kappa, W = m.balance.astype(_LONG), m.torque.astype(_LONG), problem.passive.astype(_LONG)
    along = (W * y).sum(axis=2) + (J * kappa).sum(axis=2)
    slope = (frames * along[:, None]).sum(axis=2)
    rough = (np.abs(W) * np.abs(y)).sum(axis=2) + (np.abs(J) * np.abs(kappa)).sum(axis=2)
    size = (np.abs(frames) * rough[:, None]).sum(axis=2)
    pull = m.round.astype(_LONG) * np.column_stack([-problem.mu, -np.ones((problem.count, 2))])
    slope += pull
    size += np.abs(pull)
    for c in np.flatnonzero(problem.has_cone).tolist():
        faces = problem.faces(c).astype(_LONG)
        slope[c] += (m.faces[c][:, None] * faces).sum(axis=0)
        size[c] += (m.faces[c][:, None] * np.abs(faces)).sum(axis=0)
    normal = m.normal_upper.astype(_LONG) - m.normal_lower
    slope[:, 0] += normal
    size[:, 0] += np.abs(normal)
    if problem.own is not None:
        net, rows = m.own_upper.astype(_LONG) - m.own_lower, problem.own.rows.forces
        slope += np.einsum("q,qmi->mi", net, rows)
        size += np.einsum("q,qmi->mi", np.abs(net), np.abs(rows))
    return slope, size


def _constant_term(problem: Problem, m: StatedMultipliers) -> tuple[Any, Any]:
    """Return the constant term of the Lagrangian, and the sum of its terms' sizes."""
    finite_up = np.where(np.isfinite(problem.upper), problem.upper, 0.0)
    finite_low = np.where(np.isfinite(problem.lower), problem.lower, 0.0)
    terms = np.concatenate([
        m.balance.astype(_LONG) * problem.w,
        m.torque.astype(_LONG) * problem.gravity,
        -m.torque_upper.astype(_LONG) * finite_up,
        m.torque_lower.astype(_LONG) * finite_low,
        -m.normal_upper.astype(_LONG) * problem.limit,
        _margin_slopes(problem, m) * problem.face_margins,
    ])  # fmt: skip
    if problem.own is not None:
        rows = problem.own.rows
        high, low = (np.where(np.isfinite(one), one, 0.0) for one in (rows.high, rows.low))
        terms = np.concatenate([terms, -m.own_upper.astype(_LONG) * high, m.own_lower * low])
    return terms.sum(), np.abs(terms).sum()


def _margin_slopes(problem: Problem, m: StatedMultipliers) -> np.ndarray:
    """(M,) slope of the Lagrangian by the margin at each contact's faces or round cone."""
    widening = np.sqrt(1.0 + problem.mu.astype(_LONG) ** 2)
    return m.faces.astype(_LONG).sum(axis=1) + m.round[:, 0] * widening


def _force_box(
    problem: Problem, reach: float, free: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(M, 3) each: bounds of all forces inside cones and limits, with friction of free signs."""
    free = np.ones((problem.count, 2, 2), dtype=bool) if free is None else free
    low, high = np.zeros((problem.count, 3)), np.zeros((problem.count, 3))
    most = np.minimum(problem.limit, reach)
    least, largest = problem.normal_range
    high[:, 0] = np.minimum(largest, reach)
    low[:, 0] = least
    friction = np.where(problem.has_cone, problem.mu * most, 0.0)[:, None]
    low[:, 1:], high[:, 1:] = -friction * free[:, :, 0], friction * free[:, :, 1]
    return low, high


def _least_quadratic(slope: np.ndarray, low: np.ndarray, high: np.ndarray, q: np.ndarray) -> Any:
    """Return the smallest sum of slope x + q x^2 / 2 over a box."""
    x = np.where(slope >= 0.0, low, high).astype(_LONG)
    is_curved = q > 0.0
    stationary = np.where(is_curved, -slope / np.where(is_curved, q, 1.0), x)
    x = np.where(is_curved, np.clip(stationary, low, high), x)
    return (slope * x + 0.5 * q * x**2).sum()


def _column_slopes(
    problem: Problem, m: StatedMultipliers, *, objective: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(k,) each: slope by the objective's own columns, sum of its terms' sizes, curvature.

    The column of Algorithm 1 is e, that of Algorithm 2 is t.
    """
    faces = _margin_slopes(problem, m)
    if problem.own is not None:
        own = problem.own
        parts = [
            own.cost * objective,
            own.balance.T @ m.balance.astype(_LONG),
            own.faces.T @ faces,
            own.normal_upper.T @ m.normal_upper.astype(_LONG),
            own.normal_lower.T @ m.normal_lower.astype(_LONG),
            own.rows.columns.T @ (m.own_upper.astype(_LONG) - m.own_lower),
        ]
        sizes = [
            np.abs(own.cost),
            np.abs(own.balance).T @ np.abs(m.balance),
            np.abs(own.faces).T @ faces,
            np.abs(own.normal_upper).T @ m.normal_upper,
            np.abs(own.normal_lower).T @ m.normal_lower,
            np.abs(own.rows.columns).T @ (m.own_upper + m.own_lower),
        ]
        return np.sum(parts, axis=0), np.sum(sizes, axis=0), own.curvature * objective
    if problem.is_margin:
        used = faces.sum() + (m.normal_upper.astype(_LONG) + m.normal_lower).sum()
        slope = used - objective
    else:
        up, down = problem.share_torques
        used = (m.share_upper.astype(_LONG) * up + m.share_lower.astype(_LONG) * down).sum()
        slope = objective - used
    return np.array([slope]), np.array([used + 1.0]), np.zeros(1)


def own_box(
    problem: Problem, own: OwnObjective, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what `implied_box` does, for all forces within the reach."""
    return implied_box(problem, own, *_force_box(problem, reach), reach)


def column_box(problem: Problem, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """(k,) each: bounds of the objective's own columns with forces within the reach."""
    if problem.own is not None:
        return own_box(problem, problem.own, reach)[:2]
    if problem.is_margin:
        most = min(float(problem.limit.min()) / 2.0, reach)
    else:
        most = _largest_torque_bound(problem, reach)
    return np.zeros(1), np.array([most])


def _largest_torque_bound(problem: Problem, reach: float) -> float:
    """Return an upper bound on the t of Algorithm 2 over all forces within the box."""
    low, high = _force_box(problem, reach)
    along = np.einsum("lki,lij->lkj", _force_frames(problem), problem.J)
    most = np.einsum("lkj,lk->j", np.abs(along), np.maximum(np.abs(low), np.abs(high)))
    lever = most + np.abs(problem.gravity)
    return problem.largest_share(lever, lever) + problem.unit


def _force_frames(problem: Problem) -> np.ndarray:
    """(M, 3, 3) rows: the unit force of each component, along the kinetic one without a cone."""
    frames = problem.frames.copy()
    frames[~problem.has_cone, 0] = problem.kinetic_directions[~problem.has_cone]
    return frames


def largest_objective(problem: Problem, reach: float) -> float:
    """Return an upper bound on the objective of all forces that obey all constraints."""
    low, high = _force_box(problem, reach)
    total = float((problem.curvature * np.maximum(np.abs(low), np.abs(high)) ** 2).sum()) / 2.0
    if problem.own is not None:
        own = problem.own
        low, high = column_box(problem, reach)
        total += float((own.curvature * np.maximum(np.abs(low), np.abs(high)) ** 2).sum()) / 2.0
        return total + float(np.maximum(own.cost * low, own.cost * high).sum())
    return total + (0.0 if problem.is_margin else _largest_torque_bound(problem, reach))
