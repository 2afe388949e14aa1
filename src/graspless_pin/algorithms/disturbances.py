"""How large a disturbance the contacts still balance, direction by direction in wrench space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm, qmc

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.formulation import Formulation, shared_parts
from graspless_pin.algorithms.search import SearchState
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.rules import Rules
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only
from graspless_pin.programs.analysis_programs import disturbance_program
from graspless_pin.programs.force_programs import force_rows
from graspless_pin.solution import Status
from graspless_pin.solvers import check_solver

_SAMPLES = 64


@dataclass(frozen=True, eq=False)
class DisturbanceMargin:
    """The largest balanced disturbance in each direction.

    Attributes:
        status: OPTIMAL, or why not even the undisturbed object is balanced.
        directions: (K, 6) unit directions [force; moment / characteristic length].
        magnitudes: (K,) largest balanced multiple, N: along direction d the wrench
            magnitude * [d_f; characteristic_length * d_m] is balanced and no larger one. Directions
            outside the search (status not OPTIMAL) are NaN.
        characteristic_length: m; what makes a moment comparable to a force.
        problem: The problem.
    """

    status: Status
    directions: FloatArray
    magnitudes: FloatArray
    characteristic_length: float
    problem: QuasistaticProblem

    @property
    def found(self) -> bool:
        """Whether the undisturbed object is balanced."""
        return self.status is Status.OPTIMAL

    @property
    def worst(self) -> int:
        """Index of the direction with the smallest magnitude."""
        return int(np.argmin(self.magnitudes))

    @property
    def worst_wrench(self) -> FloatArray:
        """(6,) the smallest disturbance looked at that is just balanced, [N; N m]."""
        d = self.directions[self.worst]
        return self.magnitudes[self.worst] * np.concatenate(
            [d[:3], self.characteristic_length * d[3:]]
        )

    def __str__(self) -> str:
        """Return one line: the worst direction."""
        if not self.found:
            return f"not found: {self.status.message}"
        force, moment = self.worst_wrench[:3], self.worst_wrench[3:]
        return (
            f"smallest of {len(self.magnitudes)} balanced disturbances: "
            f"{self.magnitudes[self.worst]:.4g} N (force {np.round(force, 4).tolist()} N, moment "
            f"{np.round(moment, 5).tolist()} N m)"
        )


def disturbance_margin(
    problem: QuasistaticProblem,
    torques: ArrayLike | None = None,
    directions: ArrayLike | None = None,
    *,
    characteristic_length: float | None = None,
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    static_friction: str = "virtual_sliding",
    solver: str = "piqp",
) -> DisturbanceMargin:
    """Find the largest disturbance that the contacts can still balance in each direction.

    The robustness test of Maeda and Makita's *A quantitative test for the robustness of graspless
    manipulation*: contact forces inside cones and normal-force limits, over all feasible modes.

    Args:
        problem: Contacts, wrench, joints and limits.
        torques: (L,) motor torques that stay as they are; None: any within the limits.
        directions: (K, 6) [force; moment / characteristic_length] of any length; None: both ways
            along all six axes and 64 quasi-uniform directions (a Sobol sequence, the same every
            time).
        characteristic_length: m; None: the largest distance of a contact from the reference point.
        sign_rule: See `maximize_margin`, as for the other options.
        sliding_rule: See `maximize_margin`.
        static_friction: See `maximize_margin`.
        solver: See `maximize_margin`.

    Raises:
        ArgumentError: If a shape is wrong, a direction is zero or the length is not positive.
    """
    coordinates, kinematics = shared_parts(problem)
    rows = force_rows(problem, coordinates)
    rules = Rules.parse(sign_rule, sliding_rule, static_friction)
    check_solver(solver)
    length = coordinates.length_scale if characteristic_length is None else characteristic_length
    if not (np.isfinite(length) and length > 0.0):
        raise ArgumentError("characteristic_length", f"is {length}; it must be positive")
    held = None
    if torques is not None:
        given = finite_array("torques", torques, (problem.joint_count,))
        held = (given - problem.gravity_torques) / coordinates.torque_scale
    units = _unit_directions(directions)
    scale = np.repeat([1.0, length], 3)
    magnitudes = np.full(len(units), np.nan)
    status = Status.OPTIMAL
    for index, unit in enumerate(units):
        program = disturbance_program(rows, coordinates, scale * unit, held)
        formulation = Formulation(problem, coordinates, program, kinematics)
        result = branch_and_bound(SearchState(formulation, rules, solver))
        if result.state.best is None:
            status = result.status
            break
        magnitudes[index] = -coordinates.force_scale * result.state.best.value
    return DisturbanceMargin(status, units, read_only(magnitudes), float(length), problem)


def _unit_directions(directions: ArrayLike | None) -> FloatArray:
    if directions is None:
        axes = np.vstack([np.eye(6), -np.eye(6)])
        points = qmc.Sobol(6, scramble=False).random(2 * _SAMPLES)[_SAMPLES:]
        spread = norm.ppf(points)
        return read_only(np.vstack([axes, spread / np.linalg.norm(spread, axis=1, keepdims=True)]))
    given = finite_array("directions", directions, (None, 6))
    lengths = np.linalg.norm(given, axis=1)
    if (lengths == 0.0).any():
        index = int(np.argmin(lengths))
        raise ArgumentError("directions", f"is zero at index {index}; each needs a length")
    return read_only(given / lengths[:, None])
