"""Second-order programs: Clarabel's own, and any solver of linear programs by tangent cuts.

Cuts where the last answer left the cones are Kelley's cutting planes (J. SIAM 8(4), 1960). Programs
too large to be full matrices are given to Clarabel block by block; their answers are a solver's
word: who asks checks them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import lru_cache
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
"""Scaled: what a point of a semidefinite program may miss."""
_CONE_TOLERANCE = 1e-9
"""Cuts end where forces are no farther outside their cones, in scaled units."""


def least_within(program: Program, inequalities: Sequence[MatrixInequality]) -> FloatArray | None:
    """Return (n,) what Clarabel says is the optimum of a semidefinite program.

    None where it misses a row by more than 1e-6. Neither the inequalities nor the value are
    checked: it is a guess.

    Args:
        program: The program.
        inequalities: Of its first columns.
    """
    x = by_clarabel(without_far_limits(program), inequalities)[0]
    if not np.isfinite(x).all() or program.residual(x) > _GUESS_TOLERANCE:
        return None
    return x


def by_clarabel(program: Program, inequalities: Sequence[MatrixInequality] = ()) -> Multipliers:
    """Clarabel's own interface: equalities, sides and bounds as cones of its, then second-order.

    Args:
        program: The program.
        inequalities: Further ones, of its first columns; nothing tells their multipliers.
    """
    low, high = program.sides
    m, n = len(program.b), len(program.c)
    ends = np.concatenate([high, -low, program.ub, -program.lb])
    form = _form_of(
        program.pattern,
        (m, len(low) - m, n, program.cone_count),
        np.isfinite(ends).tobytes(),
        ((program.lb == 0.0) & (program.ub == 0.0)).tobytes(),
    )
    matrix = copy(form.matrix)
    matrix.data = form.signs * np.append(program.rows.T.ravel(), 1.0)[form.places]
    curved = form.unit if program.is_linear else scipy.sparse.diags_array(program.P[form.kept])
    sides, cones = ends[form.sides], form.cones
    if inequalities:
        rows = [_semidefinite(one, n, form.kept) for one in inequalities]
        matrix = scipy.sparse.csc_array(scipy.sparse.vstack([matrix, *(row for row, _ in rows)]))
        sides = np.concatenate([sides, *(side for _, side in rows)])
        cones = cones + [clarabel.PSDTriangleConeT(len(one.constant)) for one in inequalities]
    solver = clarabel.DefaultSolver(
        curved.tocsc(), program.c[form.kept], matrix, sides, cones, _SETTINGS
    )
    solution = solver.solve()
    x, z = np.zeros(n), np.array(solution.z)
    x[form.kept] = solution.x
    weights: Any = np.bincount(form.rows, form.row_signs * z[form.of_rows], len(low))
    return np.minimum(np.maximum(x, program.lb), program.ub), weights[:m], weights[m:]


def _semidefinite(
    inequality: MatrixInequality, count: int, kept: NDArray[np.int_]
) -> tuple[Any, FloatArray]:
    """Return rows and sides of one inequality: the upper triangle, column by column, times sqrt 2.

    Args:
        inequality: The inequality.
        count: Columns of the program.
        kept: Those that Clarabel gets.
    """
    lower = np.tril_indices(len(inequality.constant))  # of a symmetric matrix: the same entries
    weights = np.where(lower[0] == lower[1], 1.0, np.sqrt(2.0))
    rows = np.zeros((len(weights), count))
    rows[:, : len(inequality.coefficients)] = -(inequality.coefficients[:, *lower] * weights).T
    return scipy.sparse.csc_array(rows[:, kept]), inequality.constant[lower] * weights


class _Form(NamedTuple):
    """Programs of one structure as Clarabel takes them: matrix x + s = sides, s in its cones.

    Attributes:
        kept: Columns that are not fixed at zero.
        matrix: (r, k) in compressed columns; its data are of no program.
        places: Where its data stand among the columns of all rows, and a one.
        signs: What they are multiplied by.
        sides: (r,) places of its sides among upper and minus lower sides, then bounds.
        cones: Clarabel's.
        of_rows: Which of its rows are of the program's.
        rows: Rows of the program that these stand for.
        row_signs: 1 on upper sides, -1 on lower ones.
        unit: (k, k) without entries.
    """

    kept: NDArray[np.int_]
    matrix: Any
    places: NDArray[np.int_]
    signs: FloatArray
    sides: NDArray[np.int_]
    cones: list[Any]
    of_rows: NDArray[np.int_]
    rows: NDArray[np.int_]
    row_signs: FloatArray
    unit: Any


@lru_cache(maxsize=32)
def _form_of(pattern: bytes, sizes: tuple[int, int, int, int], ends: bytes, fixed: bytes) -> _Form:
    """Return the form of programs of one structure.

    Args:
        pattern: See `Program.pattern`.
        sizes: Equalities, other rows, columns and second-order cones.
        ends: Which upper sides, lower sides, upper bounds and lower bounds there are.
        fixed: Which columns are fixed at zero.
    """
    m, k, n, cones = sizes
    count, flat = m + k, m + k - 3 * cones
    bits = np.unpackbits(np.frombuffer(pattern, dtype=np.uint8), count=count * n)
    filled = bits.reshape(count, n).astype(bool)
    there = np.frombuffer(ends, dtype=bool).copy()
    kept = np.flatnonzero(~np.frombuffer(fixed, dtype=bool))
    # Upper sides first (equalities have no other), then lower ones, bounds, and the cones' rows.
    there[count : count + m] = False
    conic = count + np.arange(flat, count)
    there[flat:count] = there[conic] = False
    free = np.flatnonzero(np.frombuffer(fixed, dtype=bool))
    there[2 * count + free] = there[2 * count + n + free] = False
    sides = np.concatenate([np.flatnonzero(there), conic])
    # Of each row of the matrix: the entries' places and signs.
    above = sides < count
    lower = ~above & (sides < 2 * count)
    entries = np.zeros((len(sides), n), dtype=bool)
    source = np.full((len(sides), n), count * n)
    columns = count * np.arange(n)
    of_rows = np.flatnonzero(above | lower)
    rows = sides[of_rows] % count
    entries[of_rows], source[of_rows] = filled[rows], columns + rows[:, None]
    of_bounds = np.flatnonzero(sides >= 2 * count)
    entries[of_bounds, (sides[of_bounds] - 2 * count) % n] = True
    sign = np.where(above | ((sides >= 2 * count) & (sides < 2 * count + n)), 1.0, -1.0)
    order = entries[:, kept].T
    owner = np.nonzero(order)[1]
    starts = np.concatenate([[0], np.cumsum(order.sum(axis=1))])
    matrix = scipy.sparse.csc_array((np.ones(len(owner)), owner, starts), shape=order.T.shape)
    kinds: list[Any] = [clarabel.ZeroConeT(m)]
    kinds += [clarabel.NonnegativeConeT(len(sides) - m - 3 * cones)]
    kinds += [clarabel.SecondOrderConeT(3)] * cones
    return _Form(
        kept, matrix, source[:, kept].T[order], sign[owner], sides, kinds, of_rows, rows,
        sign[of_rows], scipy.sparse.csc_array((len(kept), len(kept))),
    )  # fmt: skip


def _settings(tolerance: float, *, refined: bool = False) -> Any:
    settings = clarabel.DefaultSettings()
    # Programs are scaled, and every answer is checked.
    settings.verbose = settings.presolve_enable = False
    settings.iterative_refinement_enable = refined
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings


_SETTINGS = _settings(SOLVER_TOLERANCE)


def by_cuts(solver: Backend) -> Backend:
    """Return a backend that asks one of linear programs, with the cones cut by tangent planes.

    Each round adds the planes that touch the cones where the last answer left them. A plane's
    multiplier times its normal is a multiplier of the cone, so any round's may be a proof.
    """

    def backend(program: Program) -> Multipliers | None:
        flat = program.flat_count
        cones, apex = program.G[flat:].reshape(-1, 3, len(program.c)), program.l[flat:]
        apex = apex.reshape(-1, 3)
        owner = np.repeat(np.arange(len(cones)), _FIRST_CUTS)
        first = _planes(2.0 * np.pi * np.arange(_FIRST_CUTS) / _FIRST_CUTS)
        planes = np.tile(first, (len(cones), 1))
        for _ in range(_CUT_ROUNDS):
            rows = np.einsum("pi,pin->pn", planes, cones[owner])
            sides = np.einsum("pi,pi->p", planes, apex[owner])
            found = call_solver(solver, _cut(program, rows, sides))
            if found is None:
                return None
            x, y, z = found
            weights = np.zeros_like(apex)
            np.add.at(weights, owner, z[flat:, None] * planes)
            z = np.concatenate([z[:flat], weights.ravel()])
            inside = cones @ x - apex
            outside = np.flatnonzero(np.hypot(*inside[:, 1:].T) - inside[:, 0] > _CONE_TOLERANCE)
            if not len(outside) or program.dual_bound(y, z) > program.cutoff:
                return x, y, z
            touching = _planes(np.arctan2(inside[outside, 2], inside[outside, 1]))
            planes, owner = np.vstack([planes, touching]), np.append(owner, outside)
        return None

    return backend


def _planes(angles: FloatArray) -> FloatArray:
    """(p, 3) inward normals of planes that touch the cone along directions at given angles, rad."""
    return np.column_stack([np.ones_like(angles), -np.cos(angles), -np.sin(angles)])


def _cut(program: Program, rows: FloatArray, sides: FloatArray) -> Program:
    """Return a program with planes, as lower sides, in place of its cones."""
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
"""Of Clarabel; with other words it is asked once more, to refine its steps."""


class Entries(NamedTuple):
    """Entries of a matrix that are not zero.

    Attributes:
        rows: (k,) their rows.
        columns: (k,) their columns.
        values: (k,).
    """

    rows: NDArray[np.int_]
    columns: NDArray[np.int_]
    values: FloatArray

    @classmethod
    def of(cls, matrix: FloatArray) -> Entries:
        """Return those of a full matrix."""
        rows, columns = np.nonzero(matrix)
        return cls(rows, columns, matrix[rows, columns])

    def at(self, first: int, *, times: float = 1.0) -> Entries:
        """Return them with columns from ``first`` on, times a factor."""
        return Entries(self.rows, first + self.columns, self.values * times)


def diagonal(columns: NDArray[np.int_], values: ArrayLike = 1.0) -> Entries:
    """Return one entry in each row."""
    count = len(columns)
    return Entries(np.arange(count), columns, np.broadcast_to(np.asarray(values, float), count))


class _Part:
    """Rows of one kind: entries and sides."""

    def __init__(self) -> None:
        self.entries: list[Entries] = []
        self.sides: list[FloatArray] = []
        self.count = 0

    def add(self, entries: list[Entries], sides: FloatArray, step: int, offset: int) -> None:
        """Add entries whose rows are counted by steps, from an offset on."""
        first = self.count + offset
        self.entries += [one._replace(rows=first + step * one.rows) for one in entries]
        self.sides.append(sides)


class SparseConic:
    """Minimise c.x with A x = b, rows G x <= h and cones |B x| <= h - g x, block by block."""

    def __init__(self) -> None:
        """Begin without columns and rows."""
        self._equal, self._below, self._cones = _Part(), _Part(), _Part()
        self._sizes: list[int] = []
        self._costs: list[tuple[int, float]] = []
        self.width = 0

    def columns(self, count: int, cost: float = 0.0) -> NDArray[np.int_]:
        """Add free columns, and return their numbers; the cost is that of each."""
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
        """Add rows G x <= h; returns what `solve` has their multipliers under."""
        self._below.add(entries, sides, 1, 0)
        self._below.count += len(sides)
        return np.arange(self._below.count - len(sides), self._below.count)

    def cones(self, entries: list[Entries], sides: FloatArray, inside: list[Entries]) -> None:
        """Add a cone for each row: the length of d products is at most h - g x.

        Args:
            entries: Of g, a row for each cone.
            sides: (k,) h.
            inside: d times the entries of B, a row for each cone.
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
        """Return x with the multipliers of rows, or None where Clarabel has none.

        Args:
            time_limit: Seconds that Clarabel may take; None: any.
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
            settings = _settings(_SPARSE_TOLERANCE, refined=refined)
            if deadline is not None:
                settings.time_limit = max(deadline - time.monotonic(), 0.0)
            found = clarabel.DefaultSolver(curved, cost, matrix, sides, kinds, settings).solve()
            status = str(found.status)
            if status in _ANSWER_STATUSES:
                return np.array(found.x), np.array(found.z)[firsts[1] : firsts[2]]
            if status in _INFEASIBLE_STATUSES:
                break
        return None
