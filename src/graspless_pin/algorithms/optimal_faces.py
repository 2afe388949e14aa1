"""Optimal forces and multipliers in SI units, and which of them an optimum leaves open.

An interior-point answer lies inside the faces of all optimal forces and of all optimal multipliers.
There every constraint either is active with a positive multiplier or has slack with none
(Goldman and Tucker), so the larger of the two tells which. Optimal forces may then change along
the null space of the active constraints, optimal multipliers along the linear dependences between
them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.optimize import linprog

from graspless_pin.algorithms.formulation import Formulation, Objective, formulate
from graspless_pin.algorithms.friction_modes import NO_FRICTION
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.force_programs import ShareRows, share_rows
from graspless_pin.solution import Algorithm, TorqueSolution

_HELD = 1e-7
"""Reduced costs above this hold a variable at its bound."""
_RANK = 1e-7
"""Geometry is exact to some 1e-9: constraints closer to dependent than this are."""
_FARTHEST = 1e6
_SAMPLES = 2


@dataclass(frozen=True, eq=False)
class Marginals:
    """Optimal forces and multipliers, in SI units; multipliers are those of a minimisation.

    Attributes:
        forces: (M, 3) contact forces f, N.
        level: t of Algorithm 2, N m or a share of the limits; -e of Algorithm 1, N.
        wrench: (6,) y of the balance W f + w_ext = 0.
        faces: (M, r) of the cones' side faces, zero where there is no cone.
        normal_upper: (M,) of n^T f + e <= f_n,max.
        normal_lower: (M,) of e <= n^T f where there is no cone.
        upper: (L,) of the upper limits.
        lower: (L,) of the lower limits.
        share_upper: (L,) of J^T f + g <= t, or t times the upper limit.
        share_lower: (L,) of -(J^T f + g) <= t, or t times minus the lower limit.
    """

    forces: FloatArray
    level: float
    wrench: FloatArray
    faces: FloatArray
    normal_upper: FloatArray
    normal_lower: FloatArray
    upper: FloatArray
    lower: FloatArray
    share_upper: FloatArray
    share_lower: FloatArray

    @property
    def torque(self) -> FloatArray:
        """(L,) kappa, the multiplier of each joint's torque."""
        return self.upper - self.lower + self.share_upper - self.share_lower


class _Point(NamedTuple):
    """Variables, multipliers of A and G, and reduced costs of a program, scaled."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    reduced: FloatArray


class Optimum:
    """The optimum behind a solution.

    Attributes:
        solution: A solution that was found, without regularisation.
    """

    def __init__(self, solution: TorqueSolution) -> None:
        """Read the program's variables and multipliers from the solution."""
        proof = solution.multipliers
        self.solution = solution
        self._objective = Objective(
            solution.algorithm, solution.required_margin, proof.by_limits, regularization=0.0
        )
        self._formulation: Formulation = formulate(solution.problem, self._objective)
        program = self._formulation.program
        # The search's own multipliers: friction that happens to vanish is not held at zero in them.
        y, z = proof.mode
        reduced = program.c + y @ program.A + z @ program.G
        self._own = _Point(self._variables(), y, z, reduced)

    def marginals(self) -> Marginals:
        """Return the solution's own forces and multipliers."""
        return self._in_units(self._own)

    def alternatives(self) -> tuple[Marginals, ...]:
        """Return other points of the affine hulls of all optimal forces and all multipliers.

        What is linear in both and the same there is the same for all of them: the points are
        random.
        """
        x, y, z, reduced = self._own
        forces = self._open_forces
        balance, rows, bounds = self._open_multipliers()
        random = np.random.default_rng(0)
        others = []
        for _ in range(_SAMPLES):
            a = random.uniform(0.5, 1.0, len(forces))
            b = random.uniform(0.5, 1.0, len(balance))
            point = _Point(x + a @ forces, y + b @ balance, z + b @ rows, reduced + b @ bounds)
            others.append(self._in_units(point))
        return tuple(others)

    @cached_property
    def mode_edges(self) -> NDArray[np.bool_]:
        """(M, 2) friction components that vanish in all optima though the mode gives them a sign.

        Where some optimal forces have friction of that sign, the sign costs nothing.
        """
        contacts = np.array(self._formulation.cone_contacts, dtype=int)
        columns = self._formulation.cone_columns[0]
        edges = np.zeros((self.solution.problem.contact_count, 2), dtype=bool)
        if self.solution.rules.static_friction is StaticFriction.COULOMB:
            return edges
        signs = -self.solution.mode.signs[contacts]
        vanishes = np.abs(self._own.x[columns]) <= NO_FRICTION
        held = np.abs(self._own.reduced[columns]) > _HELD
        weak = vanishes & ~held & (signs != 0)
        change = signs[weak][:, None] * self._open_forces[:, columns[weak]].T
        weak[weak] = ~_positive_together(change)
        edges[contacts] = weak
        return edges

    def _variables(self) -> FloatArray:
        """The program's variables at the solution, scaled."""
        solution, coordinates = self.solution, self._formulation.coordinates
        basis, force = coordinates.basis, coordinates.force_scale
        scaled = basis.T @ solution.contact_forces.ravel() / ((basis**2).sum(axis=0) * force)
        if solution.algorithm is Algorithm.MARGIN:
            return np.append(scaled, solution.margin / force)
        unit = self._formulation.unit
        if not self._objective.by_limits:
            return np.append(scaled, solution.max_torque / unit)
        torques, problem = solution.torques, solution.problem
        above, below = (side.counts for side in self._shares)
        up = torques[above] / problem.upper_torque[above]
        down = torques[below] / problem.lower_torque[below]
        return np.append(scaled, np.concatenate([up, down, [0.0]]).max() / unit)

    @cached_property
    def _shares(self) -> tuple[ShareRows, ShareRows]:
        """The rows of the torques that count upwards and downwards in Algorithm 2."""
        coordinates = self._formulation.coordinates
        return share_rows(self.solution.problem, coordinates, by_limits=self._objective.by_limits)

    @cached_property
    def _active(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Rows of G and bounds that have a multiplier."""
        program, (x, _, z, reduced) = self._formulation.program, self._own
        values = program.G @ x
        slack = np.where(z > 0.0, program.u - values, values - program.l)
        return np.flatnonzero(np.abs(z) > slack), np.flatnonzero(np.abs(reduced) > _HELD)

    @cached_property
    def _open_forces(self) -> FloatArray:
        """(d, n) directions in which x stays optimal."""
        program, (rows, bounds) = self._formulation.program, self._active
        fixed = np.vstack([program.A, program.G[rows], np.eye(len(program.c))[bounds]])
        return null_space(fixed, rcond=_RANK).T

    def _open_multipliers(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Directions in which y, z and the reduced costs together stay optimal.

        A sign of the mode that friction is about to change has a multiplier of its own.
        """
        program, (rows, bounds) = self._formulation.program, self._active
        contacts = list(self._formulation.cone_contacts)
        edges = self._formulation.cone_columns[0][self.mode_edges[contacts]]
        bounds = np.concatenate([bounds, edges])
        first, size = len(program.A), len(program.c)
        dual = null_space(
            np.vstack([program.A, program.G[rows], np.eye(size)[bounds]]).T, rcond=_RANK
        ).T
        of_rows, of_costs = np.zeros((len(dual), len(program.G))), np.zeros((len(dual), size))
        of_rows[:, rows] = dual[:, first : first + len(rows)]
        # A reduced cost is what the rows add up to; a bound's own multiplier is minus that.
        of_costs[:, bounds] = -dual[:, first + len(rows) :]
        return dual[:, :first], of_rows, of_costs

    def _in_units(self, point: _Point) -> Marginals:
        """Forces and multipliers in SI units; the solution's own signs tell the rows' sides."""
        x, y, z, reduced = point
        problem, coordinates = self.solution.problem, self._formulation.coordinates
        force = coordinates.force_scale
        count, joints, edges = problem.contact_count, problem.joint_count, problem.cone_edges
        cone, bare = problem.has_cone, ~problem.has_cone
        up, down = np.where(self._own.z > 0.0, z, 0.0), np.where(self._own.z < 0.0, -z, 0.0)
        faces, rest = np.split(up, [int(cone.sum()) * edges])
        by_contact = np.zeros((count, edges))
        by_contact[cone] = faces.reshape(-1, edges)
        normal_upper, normal_lower = np.zeros(count), np.zeros(count)
        share_upper, share_lower = np.zeros(joints), np.zeros(joints)
        if self._objective.algorithm is Algorithm.MARGIN:
            unit, level = force, -force * float(x[-1])
            normal_upper = rest[:count]
            normal_lower[bare] = rest[count : count + int(bare.sum())]
        else:
            unit = self._formulation.unit
            level = unit * float(x[-1])
            # Here the limits of the normal forces are bounds.
            own = self._own.reduced[coordinates.normal]
            costs = reduced[coordinates.normal]
            normal_upper = np.where(own < 0.0, -costs, 0.0)
            normal_lower[bare] = np.where(own > 0.0, costs, 0.0)[bare]
            above, below = self._shares
            first, second = int(above.counts.sum()), int(below.counts.sum())
            share_upper[above.counts] = above.weight * rest[:first]
            share_lower[below.counts] = below.weight * rest[first : first + second]
        weight = np.repeat([1.0, 1.0 / coordinates.length_scale], 3)
        per_force, per_torque = unit / force, unit / coordinates.joint_scale
        return Marginals(
            forces=coordinates.forces(x),
            level=level,
            wrench=per_force * weight * y,
            faces=per_force * by_contact,
            normal_upper=per_force * normal_upper,
            normal_lower=per_force * normal_lower,
            upper=per_torque * up[len(z) - joints :],
            lower=per_torque * down[len(z) - joints :],
            share_upper=share_upper,
            share_lower=share_lower,
        )


def _positive_together(rows: FloatArray) -> NDArray[np.bool_]:
    """(k,) which rows some combination of the columns can make positive, none being negative."""
    count, size = rows.shape
    if count == 0 or size == 0:
        return np.zeros(count, dtype=bool)
    # Any number of positive rows can be made to reach 1: the largest sum has all of them.
    answer = linprog(
        np.concatenate([np.zeros(size), -np.ones(count)]),
        A_ub=np.hstack([-rows, np.eye(count)]),
        b_ub=np.zeros(count),
        bounds=[(-_FARTHEST, _FARTHEST)] * size + [(0.0, 1.0)] * count,
        method="highs",
    )
    if answer.status != 0 or not np.isfinite(answer.x).all():
        return np.zeros(count, dtype=bool)
    # What is said to be positive must be so, and nothing may be negative.
    reached = rows @ answer.x[:size]
    return (reached > 0.5) & (reached.min() > -0.5)
