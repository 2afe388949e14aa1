"""Whether rest is an outcome, and with how little friction: one linear program each.

Forces of rest balance the load and the torques inside round cones. The cones are approached by
tangent planes where the last answer left them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspless_pin.holding.cuts import around
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solvers.simplex import Simplex, SimplexOutcome

_DIRECTIONS = 8
_MOST_ROUNDS = 40
BALANCE_TOLERANCE = 1e-6
"""Of the load: forces that leave less of it unbalanced are forces of rest."""
_OUTSIDE = 1e-10
"""Of the load: forces may be so far outside their cones before another plane cuts them off."""


@dataclass(frozen=True, eq=False)
class Balance:
    """The forces that leave least of the load unbalanced, or enough to know that much is left.

    Attributes:
        residual: The largest entry of G^T f + g in units of the load.
        forces: (M, 3) in contact frames, in loads.
        proof: (6 + L,) z with sum |z| <= 1: no forces leave less than z.g unbalanced.
        programs: Linear programs solved.
    """

    residual: float
    forces: FloatArray
    proof: FloatArray
    programs: int


def least_residual(
    jacobian: FloatArray,
    load: FloatArray,
    friction: FloatArray,
    bearable: FloatArray,
    enough: float,
) -> Balance | None:
    """Find the contact forces that leave least of the load unbalanced.

    Args:
        jacobian: (M, 3, k) G in units of the load.
        load: (k,) g in those units.
        friction: (M,) coefficients.
        bearable: (M,) friction that each contact bears at most, in loads; NaN: mu f_n.
        enough: Once at least so much is known to be left, the search ends: the forces are then
            those of cones that are too wide, and the proof stands.

    Returns:
        The forces; None where the solver has no answer.
    """
    count, size = len(jacobian), 3 * len(jacobian) + 1
    lb, ub = np.full(size, -np.inf), np.full(size, np.inf)
    lb[::3] = 0.0  # normal forces, and what is left of the load
    cost = np.zeros(size)
    cost[-1] = 1.0
    simplex = Simplex(cost, lb, ub)
    balance = np.hstack([jacobian.reshape(3 * count, -1).T, np.ones((len(load), 1))])
    above = np.full(len(load), np.inf)
    simplex.add_rows(balance, -load, above)
    balance[:, -1] = -1.0
    simplex.add_rows(balance, -above, -load)
    for contact in range(count):
        contacts = np.full(_DIRECTIONS, contact)
        _add_planes(simplex, contacts, around(_DIRECTIONS), friction, bearable)
    best: Balance | None = None
    for _ in range(_MOST_ROUNDS):
        answer = simplex.solve()
        if answer.outcome is not SimplexOutcome.OPTIMAL:
            return best
        forces = answer.x[:-1].reshape(count, 3)
        marginals = answer.rows
        proof = marginals[: len(load)] + marginals[len(load) : 2 * len(load)]
        best = Balance(float(answer.x[-1]), forces, -proof, simplex.solves)
        sides = np.hypot(forces[:, 1], forces[:, 2])
        most = np.where(np.isnan(bearable), friction * forces[:, 0], bearable)
        outside = np.flatnonzero(sides > most + _OUTSIDE * np.maximum(1.0, forces[:, 0]))
        # Tangent planes lie outside the cones: forces inside leave no less.
        if not len(outside) or best.residual > enough:
            return best
        toward = forces[outside, 1:] / sides[outside, None]
        _add_planes(simplex, outside, toward, friction, bearable)
    return best


def _add_planes(
    simplex: Simplex,
    contacts: NDArray[np.int_],
    directions: FloatArray,
    friction: FloatArray,
    bearable: FloatArray,
) -> None:
    """Add d.f_t <= mu f_n, or d.f_t <= what is bearable."""
    rows = np.zeros((len(contacts), 3 * len(friction) + 1))
    high = np.zeros(len(contacts))
    for row, (contact, direction) in enumerate(zip(contacts, directions, strict=True)):
        rows[row, 3 * contact + 1 : 3 * contact + 3] = direction
        if np.isnan(bearable[contact]):
            rows[row, 3 * contact] = -friction[contact]
        else:
            high[row] = bearable[contact]
    simplex.add_rows(rows, np.full(len(contacts), -np.inf), high)
