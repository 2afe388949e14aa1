"""The paper's definition as an oracle: every (B, S), in edge weights k, by scipy's linprog.

Nothing here uses the package but the letters of a problem: (22) for the kinematics of a mode, (44)
and (45) for its forces, all modes one by one.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.optimize import linprog

from graspless_pin import QuasistaticProblem, SlidingMode

Mode = tuple[tuple[int, int] | None, ...]
"""Per contact the signs s_l1, s_l2, or None where b_l = 0."""


def letters_of(mode: SlidingMode) -> Mode:
    """A mode of the package as these letters."""
    return tuple(
        (int(signs[0]), int(signs[1])) if chosen else None
        for chosen, signs in zip(mode.selection, mode.signs, strict=True)
    )


def feasible_modes(problem: QuasistaticProblem, sign_rule: str, sliding_rule: str) -> list[Mode]:
    """All (B, S) behind which a virtual motion exists, found by trying all of them."""
    values = (-1, 0, 1) if sign_rule == "exact" else (-1, 1)
    pairs = [pair for pair in product(values, values) if pair != (0, 0)]
    options: list[list[tuple[int, int] | None]] = []
    for slides, friction in zip(problem.is_sliding, problem.friction, strict=True):
        if slides:
            options.append(list(pairs) if sliding_rule == "constrained" else [None])
        else:
            options.append([None, *pairs] if friction > 0.0 else [None])
    return [mode for mode in product(*options) if virtual_motion_exists(problem, mode, sign_rule)]


def virtual_motion_exists(problem: QuasistaticProblem, mode: Mode, sign_rule: str) -> bool:
    """Whether V, theta_dot and Y_dot satisfy (22) with the signs of S: max t, feasible if t = 1."""
    count, joints = problem.contact_count, problem.joint_count
    motion = np.hstack([problem.W.T, -problem.J])
    selected = np.repeat([signs is not None for signs in mode], 3)
    size = 6 + joints + 2 * count + 1
    equal = np.hstack([motion, -problem.T, np.zeros((3 * count, 1))])[selected]
    below = []
    for contact, signs in enumerate(mode):
        if signs is None:
            continue
        column = 6 + joints + 2 * contact
        both = np.zeros(size)
        for component, sign in enumerate(signs):
            row = np.zeros(size)
            row[column + component] = -sign
            if sign == 0:
                row[column + component] = 1.0
                equal = np.vstack([equal, row])
                continue
            row[-1] = 0.0 if sign_rule == "nonzero" else 1.0
            both += row
            below.append(row)
        if sign_rule == "nonzero":
            both[-1] = 1.0
            below.append(both)
    if not below:
        return True
    bounds = [(None, None)] * (size - 1) + [(0.0, 1.0)]
    result = linprog(
        np.append(np.zeros(size - 1), -1.0),
        A_ub=np.array(below), b_ub=np.zeros(len(below)),
        A_eq=equal, b_eq=np.zeros(len(equal)), bounds=bounds,
    )  # fmt: skip
    assert result.status == 0
    assert result.x[-1] < 0.01 or result.x[-1] > 0.99
    return bool(result.x[-1] > 0.5)


def optimum_in_mode(
    problem: QuasistaticProblem, mode: Mode | None, margin: float | None, *, by_limits: bool = False
) -> float | None:
    """Optimum of (44) (`margin` None) or (45) in one mode; None where it is infeasible.

    Args:
        problem: The problem.
        mode: The mode; None: plain Coulomb friction, without (27) and (31).
        margin: e_0 of (45).
        by_limits: Whether (45) counts each torque as a share of its joint's own limit.
    """
    below, b_ub, equal, b_eq, bounds = constraints_in_mode(
        problem, mode, margin, by_limits=by_limits
    )
    cost = np.zeros(len(bounds))
    cost[-1] = -1.0 if margin is None else 1.0
    result = linprog(cost, below, b_ub, equal, b_eq, bounds)
    assert result.status in (0, 2), result.message
    return None if result.status == 2 else float(result.x[-1])


def constraints_in_mode(
    problem: QuasistaticProblem,
    mode: Mode | None,
    margin: float | None,
    *,
    by_limits: bool = False,
    shares: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, list[tuple[float | None, float | None]]]:
    """A_ub, b_ub, A_eq, b_eq and bounds of (44) or (45) in k, the motors' torques, and e or t.

    ``shares``: (M,) what each contact's margin counts; None: 1 each.
    """
    own = np.ones(problem.contact_count) if shares is None else shares
    m, joints, weights = problem.contact_count, problem.joint_count, problem.C.shape[1]
    force = problem.C
    e_column, e_0 = (1.0, 0.0) if margin is None else (0.0, margin)

    def rows(k=None, tau=None, last=None):
        parts = [(k, weights), (tau, joints), (last, 1)]
        height = next(np.shape(part)[0] for part, _ in parts if part is not None)
        return np.hstack([np.zeros((height, w)) if p is None else p for p, w in parts])

    equal = [rows(problem.W @ force), rows(problem.J.T @ force, -np.eye(joints))]
    b_eq = [-problem.external_wrench, -problem.gravity_torques]
    below, b_ub = [], []
    if mode is not None:
        for contact, signs in enumerate(mode):
            if problem.is_sliding[contact]:
                continue  # (27) never applies to a sliding contact, and B - D strikes it in (31)
            friction = problem.T[:, 2 * contact : 2 * contact + 2].T @ force
            if signs is None:
                equal.append(rows(friction))
                b_eq.append(np.zeros(2))
                continue
            for component, sign in enumerate(signs):
                row = rows(friction[component : component + 1])
                if sign == 0:
                    equal.append(row)
                    b_eq.append(np.zeros(1))
                else:
                    below.append(sign * row)
                    b_ub.append(np.zeros(1))
    normal = problem.N.T @ force
    one = own[:, None]
    below += [rows(-normal, last=e_column * one), rows(normal, last=e_column * one)]
    b_ub += [np.full(m, -e_0), problem.max_normal_force - e_0]
    kept = np.eye(weights) - problem.D_star
    owner = np.abs(force).reshape(m, 3, weights).sum(axis=1).argmax(axis=0)
    of_faces = own[owner][:, None]
    below.append(rows(kept @ problem.H.T @ force, last=e_column * kept @ of_faces))
    b_ub.append(-e_0 * kept.sum(axis=1))
    if margin is not None:
        unit = np.ones((joints, 2))
        if by_limits:
            unit = np.column_stack([problem.upper_torque, -problem.lower_torque])
        for side, sign in enumerate((1.0, -1.0)):
            share = unit[:, side] > 0.0
            below.append(rows(None, sign * np.eye(joints)[share], -unit[share, side, None]))
            b_ub.append(np.zeros(share.sum()))
    bounds = [(0.0, None)] * weights
    bounds += list(zip(problem.lower_torque, problem.upper_torque, strict=True))
    bounds += [(0.0, None)]
    return np.vstack(below), np.concatenate(b_ub), np.vstack(equal), np.concatenate(b_eq), bounds


def best_over(
    problem: QuasistaticProblem, modes: list[Mode], margin: float | None, *, by_limits: bool = False
) -> float | None:
    """The best optimum over modes; None where none is feasible."""
    found = [
        value
        for mode in modes
        if (value := optimum_in_mode(problem, mode, margin, by_limits=by_limits)) is not None
    ]
    if not found:
        return None
    return max(found) if margin is None else min(found)
