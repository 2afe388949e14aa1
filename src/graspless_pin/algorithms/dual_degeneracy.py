"""Optimal forces and multipliers in SI units, and the directions in which they are not unique.

Every constraint either has a multiplier in some optimum and is active in all of them, or has slack
in some optimum and a multiplier in none (Goldman and Tucker). An interior-point answer lies in the
relative interior of the faces of optimal forces and of optimal multipliers, so the larger of slack
and multiplier decides. At a vertex, as of the simplex method, both may be zero: then a linear
program decides which of these constraints can have slack. Optimal forces may change along the null
space of the active constraints, optimal multipliers along their linear dependences.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.builder import Marginals, marginals
from graspless_pin.records import Record
from graspless_pin.solution import TorqueSolution

_HELD_COST = 1e-7
"""Reduced costs above this hold a variable at its bound; smaller slacks or multipliers are zero."""
_RANK_TOLERANCE = 1e-7
"""Constraints closer to dependence than this are dependent; geometry is exact to some 1e-9."""
_SAME_DERIVATIVE = 1e-6
DERIVATIVE_ROUNDING = 1e-9
_ROUNDING = 1e-14
_LARGEST_STEP = 1e6
_OTHER_POINTS = 2


@dataclass(frozen=True, eq=False)
class OptimalPoint(Record):
    """Optimal forces and multipliers of a minimisation, in the problem's units.

    Attributes:
        forces: (M, 3) contact forces f, N.
        value: Value of the objective.
        multipliers: By the names of their blocks, see `programs.objectives`.
    """

    forces: FloatArray
    value: float
    multipliers: Marginals

    def of_contacts(self, name: str) -> FloatArray:
        """(M,) multipliers, zero where the program has no such block."""
        return self.multipliers.get(name, np.zeros(len(self.forces)))

    def of_joints(self, name: str) -> FloatArray:
        """(L,) multipliers, zero where the program has no such block."""
        return self.multipliers.get(name, np.zeros_like(self.multipliers["torque_upper"]))

    @property
    def torque(self) -> FloatArray:
        """(L,) kappa, the multiplier of each joint's torque."""
        limits = self.multipliers["torque_upper"] - self.multipliers["torque_lower"]
        return limits + self.of_joints("share_upper") - self.of_joints("share_lower")


class _Point(NamedTuple):
    """Variables, multipliers of A and G, and reduced costs of a program, scaled."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    reduced: FloatArray


class _ActiveConstraints(NamedTuple):
    """The active constraints at an optimum.

    Attributes:
        held: (p, k) combinations of the rows of G that have the same value for all optimal forces.
        given: (d, k) combinations of the rows of G that may have a multiplier.
        bounds: Columns at a bound that may have a multiplier.
    """

    held: FloatArray
    given: FloatArray
    bounds: NDArray[np.int_]


class OptimalSet:
    """All optimal forces and multipliers of the program of a solution.

    Attributes:
        solution: A solution that was found, without regularisation.
    """

    def __init__(self, solution: TorqueSolution) -> None:
        """Read the program's variables and multipliers from the solution."""
        self.solution = solution
        self._formulation: Formulation = formulate(solution.problem, solution.objective)
        program = self._formulation.program
        # The multipliers of the search: they do not hold friction that happens to vanish at zero.
        y, z = solution.scaled_multipliers
        reduced = program.c + y @ program.A + z @ program.G
        own = self._formulation.coordinates.scaled(solution.contact_forces)
        x = np.concatenate([own, solution.added_columns])
        self._own_point = _Point(x, y, z, reduced)

    def point(self) -> OptimalPoint:
        """Return the solution's own forces and multipliers."""
        return self._si_point(self._own_point)

    def alternatives(self) -> tuple[OptimalPoint, ...]:
        """Return random points of the affine hulls of all optimal forces and all multipliers.

        A function that is linear in both and has the same value at these points is constant on the
        hulls. The points are as far from the solution's own point as that is from zero: multipliers
        may be unbounded, and nearer points would seem to agree with a far one.
        """
        x, y, z, reduced = self._own_point
        forces = self._force_directions
        balance, rows, bounds = self._multiplier_directions()
        random = np.random.default_rng(0)
        others = []
        for _ in range(_OTHER_POINTS):
            a = _largest_entry(x) * random.uniform(0.5, 1.0, len(forces))
            b = _largest_entry(y, z, reduced) * random.uniform(0.5, 1.0, len(balance))
            point = _Point(x + a @ forces, y + b @ balance, z + b @ rows, reduced + b @ bounds)
            others.append(self._si_point(point))
        return tuple(others)

    @cached_property
    def _strictly_active(self) -> _ActiveConstraints:
        """Constraints that have a multiplier at the solution's own point, or are equalities."""
        program, (x, _, z, reduced) = self._formulation.program, self._own_point
        values, flat, k = program.G @ x, program.flat_count, len(program.G)
        slack = np.where(z > 0.0, program.u - values, values - program.l)[:flat]
        strict = (np.abs(z[:flat]) > slack) & (np.abs(z[:flat]) > _HELD_COST)
        rows = np.flatnonzero(strict | (program.u[:flat] - program.l[:flat] <= _HELD_COST))
        active, given = [np.eye(k)[rows]], [np.eye(k)[rows]]
        for first in range(flat, k, 3):
            at = slice(first, first + 3)
            planes = _active_planes(values[at] - program.l[at], -z[at])
            for parts, own in zip((active, given), planes, strict=True):
                spread = np.zeros((len(own), k))
                spread[:, at] = own
                parts.append(spread)
        return _ActiveConstraints(
            np.vstack(active), np.vstack(given), np.flatnonzero(np.abs(reduced) > _HELD_COST)
        )

    @cached_property
    def _inward_directions(self) -> tuple[FloatArray, FloatArray]:
        """(k,) and (n,) inward signs 1 or -1 of weakly active rows of G and columns; else 0.

        These are at one of their bounds, those of the mode included, without a multiplier.
        """
        program, (x, _, z, reduced) = self._formulation.program, self._own_point
        coulomb = self.solution.rules.static_friction is StaticFriction.COULOMB
        lb, ub = self._formulation.bounds_of(None if coulomb else self.solution.mode)
        rows = _inward_signs(program.G @ x, program.l, program.u, z)
        rows[program.flat_count :] = 0.0
        return rows, _inward_signs(x, lb, ub, reduced)

    @cached_property
    def _weakly_active(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Rows of G and columns that are weakly active here and have no slack in any optimum."""
        inward_rows, inward_columns = self._inward_directions
        rows, columns = np.flatnonzero(inward_rows), np.flatnonzero(inward_columns)
        changes = self._preserving_directions(self._strictly_active).T
        slack = _jointly_positive(
            np.vstack([
                inward_rows[rows, None] * (self._formulation.program.G[rows] @ changes),
                inward_columns[columns, None] * changes[columns],
            ])
        )  # fmt: skip
        return rows[~slack[: len(rows)]], columns[~slack[len(rows) :]]

    @cached_property
    def _active_in_all(self) -> _ActiveConstraints:
        """The constraints that are active in all optima."""
        active, given, bounds = self._strictly_active
        rows, columns = self._weakly_active
        more = np.eye(len(self._formulation.program.G))[rows]
        return _ActiveConstraints(
            np.vstack([active, more]), np.vstack([given, more]), np.concatenate([bounds, columns])
        )

    def _preserving_directions(self, active: _ActiveConstraints) -> FloatArray:
        """Return (d, n) directions of x that leave the active constraints active."""
        program, (rows, _, bounds) = self._formulation.program, active
        fixed = np.vstack([program.A, rows @ program.G, np.eye(len(program.c))[bounds]])
        return null_space(fixed, rcond=_RANK_TOLERANCE).T

    @cached_property
    def _force_directions(self) -> FloatArray:
        """(d, n) directions in which x stays optimal, without regard to inactive constraints."""
        return self._preserving_directions(self._active_in_all)

    def _multiplier_directions(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return directions in which y, z and the reduced costs together stay optimal."""
        program, (_, given, bounds) = self._formulation.program, self._active_in_all
        first, size = len(program.A), len(program.c)
        dual = null_space(
            np.vstack([program.A, given @ program.G, np.eye(size)[bounds]]).T, rcond=_RANK_TOLERANCE
        ).T
        of_costs = np.zeros((len(dual), size))
        of_rows = dual[:, first : first + len(given)] @ given
        # A reduced cost is the sum of the rows' parts; a bound's own multiplier is minus that.
        of_costs[:, bounds] = -dual[:, first + len(given) :]
        return dual[:, :first], of_rows, of_costs

    def torque_points(self) -> tuple[tuple[OptimalPoint, ...], ...]:
        """Return points whose multipliers turn the gradient of an optimum into that of a torque.

        Where the active constraints determine the optimal forces, a torque is a linear function of
        them: its derivative is that of a Lagrangian whose multipliers cancel the torque's own row.

        Returns:
            L points for the L torques, then L points each for other forces and multipliers of that
            kind: entries that differ there are not unique. NaN where the torque is not unique.
        """
        formulation, program = self._formulation, self._formulation.program
        coordinates, problem = formulation.coordinates, self.solution.problem
        active, _, bounds = self._active_in_all
        rows = np.vstack([program.A, active @ program.G, np.eye(len(program.c))[bounds]])
        effects = np.zeros((problem.joint_count, len(program.c)))
        first = coordinates.force_scale * problem.J.T @ coordinates.basis
        effects[:, : first.shape[1]] = first
        weights = -np.linalg.lstsq(rows.T, effects.T, rcond=_RANK_TOLERANCE)[0].T
        sizes = np.linalg.norm(effects, axis=1)
        open_ = np.linalg.norm(weights @ rows + effects, axis=1) > _HELD_COST * sizes
        spare, forces = null_space(rows.T, rcond=_RANK_TOLERANCE).T, self._force_directions
        random = np.random.default_rng(0)
        sets = []
        for sample in range(1 + _OTHER_POINTS):
            x, duals = self._own_point.x, weights
            if sample:
                x = x + random.uniform(0.5, 1.0, len(forces)) @ forces
                duals = duals + random.uniform(0.5, 1.0, (len(duals), len(spare))) @ spare
                duals = np.where(open_[:, None], np.nan, duals)
            sets.append(
                tuple(
                    [
                        self._torque_point(j, x, *pair)
                        for j, pair in enumerate(zip(duals, effects, strict=True))
                    ]
                )
            )
        return tuple(sets)

    def _torque_point(
        self, joint: int, x: FloatArray, multipliers: FloatArray, effect: FloatArray
    ) -> OptimalPoint:
        """Return the point of one torque: see `torque_points`."""
        program, (active, _, _) = self._formulation.program, self._active_in_all
        y = multipliers[: len(program.A)]
        z = multipliers[len(program.A) : len(program.A) + len(active)] @ active
        point = self._si_point(_Point(x, y, z, effect + y @ program.A + z @ program.G), unit=1.0)
        own = np.zeros(self.solution.problem.joint_count)
        own[joint] = 1.0
        named = dict(point.multipliers)
        named["torque_upper"] = named["torque_upper"] + own
        sign = self._formulation.objective.sign
        return replace(point, multipliers={name: sign * one for name, one in named.items()})

    def _si_point(self, point: _Point, unit: float | None = None) -> OptimalPoint:
        """Return a point in SI units; the solution's own signs decide the active sides of rows.

        Args:
            point: The point.
            unit: Unit of the scaled function that the multipliers belong to; None: that of the
                objective.
        """
        formulation, (x, y, z, reduced) = self._formulation, point
        rows, columns = self._inward_directions
        sides = self._own_point.z - rows
        sides[sides == 0.0] = 1.0  # of equal limits
        own = np.concatenate([self._own_point.y, sides]), self._own_point.reduced + columns
        program = formulation.program
        multipliers = marginals(
            (program.blocks, program.bounded_blocks),
            (np.concatenate([y, z]), reduced),
            abs(formulation.signed_unit) if unit is None else unit,
            own,
        )
        return OptimalPoint(
            forces=formulation.coordinates.forces(x),
            value=formulation.signed_unit * formulation.program.value(x),
            multipliers=multipliers,
        )


def agreeing_entries(values: FloatArray, *others: FloatArray) -> NDArray[np.bool_]:
    """Return a mask of the entries that are the same in arrays of one quantity, read-only.

    Entries that differ may be arbitrarily large and do not count in the scale of the others.
    """
    stack = np.stack([values, *others])
    spread, sizes = np.abs(stack - values).max(axis=0), np.abs(stack).max(axis=0)
    rounding = DERIVATIVE_ROUNDING + _ROUNDING * sizes.max(initial=0.0)
    same = np.ones(spread.shape, dtype=bool)
    while True:
        agreed = spread <= _SAME_DERIVATIVE * sizes[same].max(initial=0.0) + rounding
        if (agreed == same).all():
            return read_only(agreed)
        same = agreed


def _largest_entry(*parts: FloatArray) -> float:
    """Return the largest absolute entry of some arrays, 1 at least."""
    return max(1.0, *(float(np.abs(one).max(initial=0.0)) for one in parts))


def _active_planes(inside: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the active planes of an entry of a second-order cone, and those with multipliers.

    On the cone's surface the entry may only change along its own ray, and its multiplier along the
    ray of the normal there; at the apex neither has a direction.

    Args:
        inside: (3,) the entry, in the cone.
        weights: (3,) its multiplier, in the cone, too.

    Returns:
        (p, 3) and (d, 3) combinations of the cone's three rows.
    """
    tangential, pull = math.hypot(*inside[1:]), math.hypot(*weights[1:])
    if weights[0] <= inside[0] - tangential:
        return np.zeros((0, 3)), np.zeros((0, 3))
    if tangential <= weights[0] - pull:
        return np.eye(3), np.eye(3)
    x, y = inside[1:] / tangential
    planes = np.array([[1.0, -x, -y], [0.0, -y, x]])
    return planes, planes[:1]


def _inward_signs(
    values: FloatArray, low: FloatArray, high: FloatArray, multipliers: FloatArray
) -> FloatArray:
    """(k,) 1 at the lower bound, -1 at the upper one, both without a multiplier; else 0."""
    at_low, at_high = values - low <= _HELD_COST, high - values <= _HELD_COST
    return (at_low.astype(float) - at_high) * (np.abs(multipliers) <= _HELD_COST)


def _jointly_positive(rows: FloatArray) -> NDArray[np.bool_]:
    """(k,) mask of rows that a combination of the columns makes positive, with none negative."""
    count, size = rows.shape
    if count == 0 or size == 0:
        return np.zeros(count, dtype=bool)
    from scipy.optimize import linprog

    # Positive rows can be scaled to reach 1: the largest sum has all of them.
    answer = linprog(
        np.concatenate([np.zeros(size), -np.ones(count)]),
        A_ub=np.hstack([-rows, np.eye(count)]),
        b_ub=np.zeros(count),
        bounds=[(-_LARGEST_STEP, _LARGEST_STEP)] * size + [(0.0, 1.0)] * count,
        method="highs",
    )
    if answer.status != 0 or not np.isfinite(answer.x).all():
        return np.zeros(count, dtype=bool)
    # Check of the solver's answer.
    reached = rows @ answer.x[:size]
    return (reached > 0.5) & (reached.min() > -0.5)
