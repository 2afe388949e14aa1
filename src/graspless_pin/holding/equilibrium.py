"""Whether rest is an outcome: linear programs for contact forces that balance the load.

Forces of rest balance the load and the torques inside round friction cones. In most cases inscribed
pyramids suffice; otherwise tangent planes are added where the last answer is outside a cone
(Kelley's cutting planes).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspless_pin.holding.least_squares import nonnegative_squares
from graspless_pin.holding.relaxation import cone_planes, plane_rows, unit_directions
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solvers.simplex import Simplex, SimplexAnswer

_DIRECTIONS = 8
_INSCRIBED = float(np.cos(np.pi / _DIRECTIONS))
"""Factor on the friction for pyramids inscribed in the cones."""
_MOST_ROUNDS = 40
BALANCE_TOLERANCE = 1e-6
"""In loads: forces with a smaller residual are forces of rest."""
_EXACT = 1e-9
"""In loads: with a smaller residual inside the pyramids the search ends."""
_OUTSIDE = 1e-10
"""In loads: violation of a cone up to which no plane is added."""


@dataclass(frozen=True, eq=False)
class Balance:
    """The contact forces with the least residual of the balance, and a proof of a lower bound.

    Attributes:
        residual: The largest entry of G^T f + g in units of the load, computed from the forces.
        outside: Largest violation of the friction cones, in loads.
        forces: (M, 3) in contact frames, in loads.
        proof: (P + L,) z with sum |z| <= 1: no forces have a smaller residual than z.g.
        programs: Linear programs solved.
    """

    residual: float
    outside: float
    forces: FloatArray
    proof: FloatArray
    programs: int

    @property
    def is_rest(self) -> bool:
        """Whether the forces balance the load inside the cones, by their own residuals."""
        return self.residual <= BALANCE_TOLERANCE and self.outside <= BALANCE_TOLERANCE


def least_residual(
    jacobian: FloatArray,
    load: FloatArray,
    friction: FloatArray,
    enough: float,
    friction_limits: FloatArray | None = None,
) -> Balance | None:
    """Find the contact forces with the least residual of the balance.

    Args:
        jacobian: (M, 3, k) G in units of the load.
        load: (k,) g in those units.
        friction: (M,) coefficients.
        enough: The search ends once the residual is proven to be larger; the forces may then be
            outside their cones.
        friction_limits: (M,) largest friction force of each contact, in loads; None: mu f_n.

    Returns:
        The forces; None where the solver has no answer.
    """
    # Most loads balance inside the inscribed pyramids, by one program.
    limits = None if friction_limits is None else _INSCRIBED * friction_limits
    inside = _residual_program(jacobian, load, _INSCRIBED * friction, limits)
    balance = _balance_of_answer(inside.solve(), jacobian, load, friction, 1)
    if balance is not None and balance.residual <= _EXACT:
        return balance
    simplex = _residual_program(jacobian, load, friction, friction_limits)
    best: Balance | None = None
    for _ in range(_MOST_ROUNDS):
        balance = _balance_of_answer(simplex.solve(), jacobian, load, friction, 1 + simplex.solves)
        if balance is None:
            return best
        best, forces = balance, balance.forces
        sides = np.hypot(forces[:, 1], forces[:, 2])
        limit = friction * forces[:, 0] if friction_limits is None else friction_limits
        outside = np.flatnonzero(sides > limit + _OUTSIDE * np.maximum(1.0, forces[:, 0]))
        # Tangent planes enclose the cones: the residual is a lower bound for forces inside.
        if not len(outside) or best.residual > enough:
            return best
        toward = forces[outside, 1:] / sides[outside, None]
        _add_planes(simplex, outside, toward, friction, friction_limits)
    return best


def _residual_program(
    jacobian: FloatArray,
    load: FloatArray,
    friction: FloatArray,
    friction_limits: FloatArray | None = None,
) -> Simplex:
    """Return the program of the least residual, with the first planes of cones or disks."""
    count, size = len(jacobian), 3 * len(jacobian) + 1
    lb, ub = np.full(size, -np.inf), np.full(size, np.inf)
    lb[::3] = 0.0  # normal forces, and the residual
    cost = np.zeros(size)
    cost[-1] = 1.0
    simplex = Simplex(cost, lb, ub)
    balance = np.hstack([jacobian.reshape(3 * count, -1).T, np.ones((len(load), 1))])
    above = np.full(len(load), np.inf)
    simplex.add_rows(balance, -load, above)
    balance[:, -1] = -1.0
    simplex.add_rows(balance, -above, -load)
    contacts = np.repeat(np.arange(count), _DIRECTIONS)
    _add_planes(
        simplex,
        contacts,
        np.tile(unit_directions(_DIRECTIONS), (count, 1)),
        friction,
        friction_limits,
    )
    return simplex


def _balance_of_answer(
    answer: SimplexAnswer,
    jacobian: FloatArray,
    load: FloatArray,
    friction: FloatArray,
    programs: int,
) -> Balance | None:
    """Return the forces of an answer, their residuals and the proof; None without an answer."""
    if not answer.is_optimal:
        return None
    forces, size = answer.x[:-1], len(load)
    residual = forces @ jacobian.reshape(-1, size) + load
    forces = forces.reshape(-1, 3)
    outside = np.maximum(
        np.hypot(forces[:, 1], forces[:, 2]) - friction * forces[:, 0], -forces[:, 0]
    )
    proof = -(answer.rows[:size] + answer.rows[size : 2 * size])
    proof /= max(1.0, float(np.abs(proof).sum()))
    return Balance(float(np.abs(residual).max()), float(outside.max()), forces, proof, programs)


def farthest_forces(
    jacobian: FloatArray,
    load: FloatArray,
    friction: FloatArray,
    cost: FloatArray,
    most: FloatArray,
) -> FloatArray | None:
    """Find the forces of rest inside inscribed pyramids that minimise a linear cost.

    Args:
        jacobian: (M, 3, k) G in units of the load.
        load: (k,) g in those units.
        friction: (M,) coefficients.
        cost: (M, 3) of forces in contact frames.
        most: (M,) largest normal forces, in loads.

    Returns:
        (M, 3) in contact frames, in loads; None where there are none, or the solver has no answer.
    """
    count, size = len(jacobian), float(np.abs(cost).max(initial=0.0))
    if size == 0.0:
        return None
    simplex = _residual_program(jacobian, load, _INSCRIBED * friction)
    sides = friction * most
    largest = np.column_stack([most, sides, sides])
    least = np.column_stack([np.zeros(count), -sides, -sides])
    # The last variable is the residual.
    simplex.set_bounds(np.append(least, 0.0), np.append(largest, _EXACT))
    simplex.set_cost(np.append(cost / size, 0.0))
    answer = simplex.solve()
    return answer.x[:-1].reshape(count, 3) if answer.is_optimal else None


def normal_force_balance(normals: FloatArray, load: FloatArray) -> Balance | None:
    """Find normal forces without friction that balance the load best, by least squares.

    Args:
        normals: (M, k) G along the normals, in units of the load.
        load: (k,) g in those units.

    Returns:
        The forces; None where the method does not converge.
    """
    sizes = nonnegative_squares(normals.T, -load)
    if sizes is None:
        return None
    residual = sizes @ normals + load
    forces = np.column_stack([sizes, np.zeros((len(sizes), 2))])
    proof = residual / max(float(np.abs(residual).sum()), np.finfo(float).tiny)
    return Balance(float(np.abs(residual).max()), 0.0, forces, proof, 1)


def _add_planes(
    simplex: Simplex,
    contacts: NDArray[np.intp],
    directions: FloatArray,
    friction: FloatArray,
    friction_limits: FloatArray | None,
) -> None:
    """Add rows d.f_t <= mu f_n, or d.f_t <= the given limit, for directions d (k, 2)."""
    in_cones = friction_limits is None
    high = np.zeros(len(contacts)) if in_cones else friction_limits[contacts]
    planes = cone_planes(friction[contacts] if in_cones else 0.0, directions)
    rows = plane_rows(contacts, planes, 3 * len(friction) + 1)
    simplex.add_rows(rows, np.full(len(contacts), -np.inf), high)
