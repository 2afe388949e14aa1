"""Second-order programs: Clarabel's own, and any solver of linear programs by tangent cuts.

Cuts where the last answer left the cones are Kelley's cutting planes (J. SIAM 8(4), 1960). Programs
too large for full matrices are given to Clarabel block by block; these answers are unchecked: the
caller checks them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import clarabel as compiled_clarabel
import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.answers import Backend, Multipliers, call_solver, without_far_limits
from graspless_pin.programs.program import MatrixInequality, Program
from graspless_pin.solvers.piqp_engines import SOLVER_TOLERANCE

clarabel: Any = compiled_clarabel
_FIRST_CUTS = 8
_CUT_ROUNDS = 40
_GUESS_TOLERANCE = 1e-6
"""Largest violation at a point of a semidefinite program, in scaled units."""
_CONE_TOLERANCE = 1e-9
"""Largest distance of forces outside their cones at which cuts end, in scaled units."""


def least_within(program: Program, inequalities: Sequence[MatrixInequality]) -> FloatArray | None:
    """Return (n,) Clarabel's unchecked optimum of a semidefinite program.

    None if it violates a row by more than 1e-6. Neither the inequalities nor the value are
    checked: it is a guess.

    Args:
        program: The program.
        inequalities: Matrix inequalities in its first columns.
    """
    x = by_clarabel(without_far_limits(program), inequalities)[0]
    if not np.isfinite(x).all() or program.residual(x) > _GUESS_TOLERANCE:
        return None
    return x


def by_clarabel(program: Program, inequalities: Sequence[MatrixInequality] = ()) -> Multipliers:
    """Return Clarabel's answer: equalities, sides and bounds as its cones, then second-order cones.

    Args:
        program: The program.
        inequalities: Matrix inequalities in its first columns; their multipliers are not returned.
    """
    low, high = program.sides
    m, count = len(program.b), len(low)
    kept = np.flatnonzero((program.lb != 0.0) | (program.ub != 0.0))
    ends = np.concatenate([high, -low, program.ub[kept], -program.lb[kept]])
    # Upper sides first (equalities have no other), then lower ones, bounds, and the cones' rows.
    conic = np.arange(count - 3 * program.cone_count, count)
    is_finite = np.isfinite(ends)
    is_finite[count : count + m] = is_finite[conic] = is_finite[count + conic] = False
    picked = np.append(np.flatnonzero(is_finite), count + conic)
    matrix = _sparse_rows_and_bounds(program.rows[:, kept], picked)
    semidefinite = [_semidefinite_rows(one, len(program.c)) for one in inequalities]
    if semidefinite:
        matrix = scipy.sparse.vstack([matrix, *(one[:, kept] for one, _ in semidefinite)], "csc")
    cones = [clarabel.ZeroConeT(m), clarabel.NonnegativeConeT(len(picked) - m - len(conic))]
    cones += [clarabel.SecondOrderConeT(3)] * program.cone_count
    cones += [clarabel.PSDTriangleConeT(len(one.constant)) for one in inequalities]
    solution = clarabel.DefaultSolver(
        scipy.sparse.csc_array(np.diag(program.P[kept])),
        program.c[kept],
        matrix,
        np.concatenate([ends[picked], *(side for _, side in semidefinite)]),
        cones,
        _SETTINGS,
    ).solve()
    x, z = np.zeros(len(program.c)), np.zeros(len(ends))
    x[kept], z[picked] = solution.x, solution.z[: len(picked)]
    weights = z[:count] - z[count : 2 * count]
    return np.minimum(np.maximum(x, program.lb), program.ub), weights[:m], weights[m:]


def _sparse_rows_and_bounds(rows: FloatArray, picked: NDArray[np.int_]) -> Any:
    """Return picked rows of [rows; -rows; I; -I], by compressed columns."""
    count, n = rows.shape
    row, column = np.nonzero(rows)
    variables, values = np.arange(n), rows[row, column]
    picked_index = np.full(2 * (count + n), -1)
    picked_index[picked] = np.arange(len(picked))
    where = picked_index[
        np.concatenate([row, count + row, 2 * count + variables, 2 * count + n + variables])
    ]
    columns = np.concatenate([column, column, variables, variables])
    signed = np.concatenate([values, -values, np.ones(n), -np.ones(n)])
    is_picked = where >= 0
    return scipy.sparse.csc_array(
        (signed[is_picked], (where[is_picked], columns[is_picked])), shape=(len(picked), n)
    )


def _semidefinite_rows(inequality: MatrixInequality, count: int) -> tuple[FloatArray, FloatArray]:
    """Return rows and sides of one inequality: the upper triangle, column by column, times sqrt 2.

    Args:
        inequality: The inequality.
        count: Columns of the program.
    """
    lower = np.tril_indices(len(inequality.constant))  # of a symmetric matrix: the same entries
    weights = np.where(lower[0] == lower[1], 1.0, np.sqrt(2.0))
    rows = np.zeros((len(weights), count))
    rows[:, : len(inequality.coefficients)] = -(inequality.coefficients[:, *lower] * weights).T
    return rows, inequality.constant[lower] * weights


def _clarabel_settings(tolerance: float, *, refined: bool = False) -> Any:
    settings = clarabel.DefaultSettings()
    # Programs are scaled, and every answer is checked.
    settings.verbose = settings.presolve_enable = False
    settings.iterative_refinement_enable = refined
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings


_SETTINGS = _clarabel_settings(SOLVER_TOLERANCE)


def by_cuts(solver: Backend) -> Backend:
    """Return a backend for cones from one of linear programs: tangent planes approximate the cones.

    Each round adds the planes that touch the cones where the last answer left them. A plane's
    multiplier times its normal is a multiplier of the cone, so the multipliers of any round may be
    a proof.
    """

    def backend(program: Program) -> Multipliers | None:
        flat = program.flat_count
        cones, apex = program.G[flat:].reshape(-1, 3, len(program.c)), program.l[flat:]
        apex = apex.reshape(-1, 3)
        owner = np.repeat(np.arange(len(cones)), _FIRST_CUTS)
        first_planes = _tangent_planes(2.0 * np.pi * np.arange(_FIRST_CUTS) / _FIRST_CUTS)
        planes = np.tile(first_planes, (len(cones), 1))
        for _ in range(_CUT_ROUNDS):
            rows = np.einsum("pi,pin->pn", planes, cones[owner])
            sides = np.einsum("pi,pi->p", planes, apex[owner])
            answer = call_solver(solver, _with_planes_for_cones(program, rows, sides))
            if answer is None:
                return None
            x, y, z = answer
            weights = np.zeros_like(apex)
            np.add.at(weights, owner, z[flat:, None] * planes)
            z = np.concatenate([z[:flat], weights.ravel()])
            inside = cones @ x - apex
            outside = np.flatnonzero(np.hypot(*inside[:, 1:].T) - inside[:, 0] > _CONE_TOLERANCE)
            if not len(outside) or program.dual_bound(y, z) > program.cutoff:
                return x, y, z
            new_planes = _tangent_planes(np.arctan2(inside[outside, 2], inside[outside, 1]))
            planes, owner = np.vstack([planes, new_planes]), np.append(owner, outside)
        return None

    return backend


def _tangent_planes(angles: FloatArray) -> FloatArray:
    """(p, 3) inward normals of the planes tangent to the cone at given angles, rad."""
    return np.column_stack([np.ones_like(angles), -np.cos(angles), -np.sin(angles)])


def _with_planes_for_cones(program: Program, rows: FloatArray, sides: FloatArray) -> Program:
    """Return a program with planes, rows with lower sides, in place of its cones."""
    flat = program.flat_count
    return replace(
        program,
        G=np.asfortranarray(np.vstack([program.G[:flat], rows])),
        l=np.concatenate([program.l[:flat], sides]),
        u=np.concatenate([program.u[:flat], np.full(len(rows), np.inf)]),
        cone_count=0,
        blocks=(),
    )


_SPARSE_TOLERANCE = 1e-8
_ANSWER_STATUSES, _INFEASIBLE_STATUSES = (
    ("Solved", "AlmostSolved"),
    ("PrimalInfeasible", "DualInfeasible"),
)
"""Clarabel's statuses; with any other it is called again, with iterative refinement."""


class Entries(NamedTuple):
    """The nonzero entries of a matrix.

    Attributes:
        rows: (k,) their rows.
        columns: (k,) their columns.
        values: (k,) their values.
    """

    rows: NDArray[np.int_]
    columns: NDArray[np.int_]
    values: FloatArray

    @classmethod
    def of(cls, matrix: FloatArray) -> Entries:
        """Return the entries of a dense matrix."""
        rows, columns = np.nonzero(matrix)
        return cls(rows, columns, matrix[rows, columns])

    def at(self, first: int, *, times: float = 1.0) -> Entries:
        """Return the entries with columns shifted by ``first``, times a factor."""
        return Entries(self.rows, first + self.columns, self.values * times)


def diagonal(columns: NDArray[np.int_], values: ArrayLike = 1.0) -> Entries:
    """Return one entry per row, in the given column."""
    count = len(columns)
    return Entries(np.arange(count), columns, np.broadcast_to(np.asarray(values, float), count))


class _RowGroup:
    """Rows of one kind of constraint: entries and sides."""

    def __init__(self) -> None:
        self.entries: list[Entries] = []
        self.sides: list[FloatArray] = []
        self.count = 0

    def add(self, entries: list[Entries], sides: FloatArray, step: int, offset: int) -> None:
        """Add entries whose row r becomes row ``offset + step * r`` after the present ones."""
        first = self.count + offset
        self.entries += [one._replace(rows=first + step * one.rows) for one in entries]
        self.sides.append(sides)


class SparseConic:
    """Minimise c.x with A x = b, rows G x <= h and cones |B x| <= h - g x, block by block."""

    def __init__(self) -> None:
        """Start without columns and rows."""
        self._equal, self._below, self._cones = _RowGroup(), _RowGroup(), _RowGroup()
        self._sizes: list[int] = []
        self._costs: list[tuple[int, float]] = []
        self.width = 0

    def columns(self, count: int, cost: float = 0.0) -> NDArray[np.int_]:
        """Add free columns with a cost each, and return their indices."""
        added = np.arange(self.width, self.width + count)
        self.width += count
        if cost:
            self._costs += [(one, cost) for one in added.tolist()]
        return added

    def equal(self, entries: list[Entries], sides: FloatArray) -> None:
        """Add equalities."""
        self._equal.add(entries, sides, 1, 0)
        self._equal.count += len(sides)

    def below(self, entries: list[Entries], sides: FloatArray) -> NDArray[np.int_]:
        """Add rows G x <= h, and return their indices among the multipliers of `solve`."""
        self._below.add(entries, sides, 1, 0)
        self._below.count += len(sides)
        return np.arange(self._below.count - len(sides), self._below.count)

    def cones(self, entries: list[Entries], sides: FloatArray, inside: list[Entries]) -> None:
        """Add cones |B x| <= h - g x, one for each row of g.

        Args:
            entries: Entries of g, a row for each cone.
            sides: (k,) h.
            inside: Entries of the d rows of B; each item has a row for each cone.
        """
        size, count, part = 1 + len(inside), len(sides), self._cones
        spread = np.zeros((count, size))
        spread[:, 0] = sides
        part.add(entries, spread.ravel(), size, 0)
        for number, one in enumerate(inside, 1):
            part.add([one], np.zeros(0), size, number)
        part.count += count * size
        self._sizes += [size] * count

    def solve(self, time_limit: float | None = None) -> tuple[FloatArray, FloatArray] | None:
        """Return x and the multipliers of the rows G x <= h, or None if Clarabel finds no solution.

        Args:
            time_limit: Seconds that Clarabel may take; None: no limit.
        """
        deadline = None if time_limit is None else time.monotonic() + time_limit
        parts = (self._equal, self._below, self._cones)
        firsts = np.cumsum([0, *(one.count for one in parts)])
        entries = [
            one._replace(rows=first + one.rows)
            for first, part in zip(firsts.tolist(), parts, strict=False)
            for one in part.entries
        ]
        rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
        matrix = scipy.sparse.csc_array((values, (rows, columns)), shape=(firsts[-1], self.width))
        cost = np.zeros(self.width)
        for column, one in self._costs:
            cost[column] = one
        sides = np.concatenate([side for part in parts for side in part.sides])
        kinds = [clarabel.ZeroConeT(self._equal.count)]
        kinds += [clarabel.NonnegativeConeT(self._below.count)]
        kinds += [clarabel.SecondOrderConeT(size) for size in self._sizes]
        curved = scipy.sparse.csc_array((self.width, self.width))
        for refined in (False, True):
            settings = _clarabel_settings(_SPARSE_TOLERANCE, refined=refined)
            if deadline is not None:
                settings.time_limit = max(deadline - time.monotonic(), 0.0)
            solution = clarabel.DefaultSolver(curved, cost, matrix, sides, kinds, settings).solve()
            status = str(solution.status)
            if status in _ANSWER_STATUSES:
                return np.array(solution.x), np.array(solution.z)[firsts[1] : firsts[2]]
            if status in _INFEASIBLE_STATUSES:
                break
        return None
