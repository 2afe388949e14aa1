"""Virtual motions: whether one counts for a mode, and proofs that none does.

u holds the velocities of the object relative to the other bodies at all contacts along n, t1, t2. A
motion counts where selected contacts stay touching and slide with their signs, each at least theta
times |u| fast. Where v with v^T u >= theta |u| for all such u has a projection on the possible u
that is shorter than theta, there is no such motion.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.outcome import Check, holds
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.states import State
from graspless_pin.report.verify.values import items, number, whole


def velocities(problem: Problem, twist: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """(M, 3) of the object relative to the other body along n, t1, t2, m/s."""
    at = problem.passive @ twist - problem.J @ rates
    return np.einsum("lij,lj->li", problem.frames, at)


def motion_check(problem: Problem, u: np.ndarray, selected: np.ndarray, signs: np.ndarray) -> Check:
    """Check that a virtual motion counts for a mode.

    Args:
        problem: The problem.
        u: (M, 3) its velocities, see `velocities`.
        selected: (M,) contacts that the mode selects.
        signs: (M, 2) their signs.
    """
    name = "the mode has a virtual motion (22)"
    if not selected.any():
        return holds(name, passed=True, detail="no contact slides virtually: no motion is needed")
    size = float(np.linalg.norm(u))
    if not (np.isfinite(size) and size > 0.0):
        return holds(name, passed=False, detail="the motion is none")
    leaving = float(np.abs(u[selected, 0]).max()) / size
    along = (signs * u[:, 1:])[selected] / size
    if problem.sign_rule == "nonzero":
        slowest = float(along.sum(axis=1).min())
        backward = float(max(0.0, -along.min()))
    else:
        zero = signs[selected] == 0
        slowest = float(along[~zero].min(initial=np.inf))
        backward = float(np.abs(u[selected, 1:] / size)[zero].max(initial=0.0))
    good = (
        slowest >= tolerances.SLOWEST
        and leaving <= tolerances.STILL
        and backward <= tolerances.STILL
    )
    detail = f"slowest sliding {slowest:.1e}, parting {leaving:.1e} of all velocities"
    return holds(name, good, detail)


class Projection:
    """The orthogonal projection on all possible u."""

    def __init__(self, problem: Problem) -> None:
        """Find an orthonormal basis of the velocities of all virtual motions."""
        columns = problem.frames @ np.concatenate([problem.passive, problem.J], axis=2)
        matrix = columns.reshape(3 * problem.count, -1)
        sizes = np.linalg.norm(matrix, axis=0)
        matrix = matrix / np.where(sizes > 0.0, sizes, 1.0)
        left, values, _ = np.linalg.svd(matrix, full_matrices=False)
        self._basis = left[:, values > tolerances.RANK * max(1.0, float(values.max()))]

    def length(self, v: np.ndarray) -> float:
        """Return |P v| of a combination (M, 3), with what rounding may hide."""
        flat = v.ravel()
        return float(
            np.linalg.norm(self._basis.T @ flat) + tolerances.PROJECTED * np.linalg.norm(flat)
        )


def read_combination(given: object, problem: Problem, where: str) -> np.ndarray:
    """(M, 3) a combination that stands in a document as [contact, axis, value] entries."""
    v = np.zeros((problem.count, 3))
    for triple in items(given, where, 0, v.size):
        contact, axis, value = items(triple, where, 3, 3)
        v[whole(contact, where, 0, problem.count - 1), whole(axis, where, 0, 2)] = number(
            value, where
        )
    return v


def excludes(problem: Problem, projection: Projection, state: State, v: np.ndarray) -> bool:
    """Return whether a combination proves that no motion counts for any mode of a state.

    Args:
        problem: The problem.
        projection: Of the problem.
        state: Which contacts are selected, and the signs that are left to them.
        v: (M, 3) the combination.
    """
    chosen = state.selected
    signs = np.where(chosen[:, None], state.known_signs, 0)
    zeros = chosen[:, None] & state.known_zeros
    along = signs * v[:, 1:]
    allowed = np.zeros(v.shape, dtype=bool)
    allowed[:, 0] = chosen
    allowed[:, 1:] = (signs != 0) | zeros
    if (v[~allowed] != 0.0).any() or (along < 0.0).any():
        return False
    if problem.sign_rule == "nonzero":
        weight = float(np.where((signs != 0).all(axis=1), along.min(axis=1), 0.0).sum())
    else:
        weight = float(along.sum())
    return weight > 0.0 and projection.length(v) < tolerances.SLOWEST * weight
