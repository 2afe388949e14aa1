"""A linear program whose rows change, and that is solved again from its last basis.

Small ones are solved by a compiled dictionary, with a few microseconds per pivot. HiGHS solves the
larger ones, those on which rounding makes that fail, and all if nothing is compiled.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled import core
from graspless_pin.problem.checks import FloatArray

_OPTIONS: dict[str, bool | int | float | str] = {
    "output_flag": False,
    "presolve": "off",
    "solver": "simplex",
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
    "threads": 1,
}
_MOST_DENSE_VARIABLES = 300
"""Largest number of variables at which a dense dictionary is the faster one."""


class SimplexOutcome(StrEnum):
    """The outcome of the simplex method on a linear program, without a proof."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    UNBOUNDED = "unbounded"
    FAILED = "failed"


_OUTCOMES = tuple(SimplexOutcome)
_FAILED = 3


@dataclass(frozen=True, eq=False)
class SimplexAnswer:
    """An answer of the simplex method.

    Attributes:
        outcome: The outcome.
        x: (n,) variables.
        rows: (m,) marginals of the rows: derivatives of the least cost by the active side of each.
    """

    outcome: SimplexOutcome
    x: FloatArray
    rows: FloatArray

    @cached_property
    def is_optimal(self) -> bool:
        """Whether the outcome is optimal, with finite numbers; the caller checks optimality."""
        return (
            self.outcome is SimplexOutcome.OPTIMAL
            and bool(np.isfinite(self.x).all())
            and bool(np.isfinite(self.rows).all())
        )


class _Engine(Protocol):
    """A simplex solver; it returns an index of `_OUTCOMES`, x and the rows' marginals."""

    def solve(self) -> tuple[int, FloatArray, FloatArray]: ...


class Simplex:
    """Minimise c.x over lb <= x <= ub and low <= R x <= high, repeatedly.

    Rows are added at the end and removed, bounds and costs change in place; each solve starts from
    the last basis.
    """

    def __init__(self, cost: FloatArray, lb: FloatArray, ub: FloatArray) -> None:
        """Start without rows.

        Args:
            cost: (n,) c.
            lb: (n,), -inf where there is no bound.
            ub: (n,).
        """
        make = _Highs if core is None or len(cost) > _MOST_DENSE_VARIABLES else core.DenseSimplex
        self._engine = make(cost, lb, ub)
        self._size, self.row_count = len(cost), 0
        self.solves = 0

    def add_rows(self, rows: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Add (k, n) rows with their sides."""
        self._engine.add_rows(rows, low, high)
        self.row_count += len(rows)

    def drop_rows(self, first: int, after: int) -> None:
        """Remove the rows from ``first`` up to, but without, ``after``."""
        if after > first:
            self._engine.drop_rows(first, after)
            self.row_count -= after - first

    def set_sides(self, rows: NDArray[np.int32], low: FloatArray, high: FloatArray) -> None:
        """Set the sides of some rows."""
        self._engine.set_sides(rows, low, high)

    def set_bounds(self, lb: FloatArray, ub: FloatArray) -> None:
        """Set the bounds of all variables."""
        self._engine.set_bounds(lb, ub)

    def set_cost(self, cost: FloatArray) -> None:
        """Set the cost of all variables."""
        self._engine.set_cost(cost)

    def solve(self) -> SimplexAnswer:
        """Solve from the last basis; if that fails, by HiGHS from no basis."""
        self.solves += 1
        answer = self._engine_answer(self._engine)
        if answer.outcome is SimplexOutcome.FAILED and not isinstance(self._engine, _Highs):
            matrix, low, high, cost = self._engine.program()
            size = len(cost)
            highs = _Highs(cost, low[:size], high[:size])
            highs.add_rows(matrix, low[size:], high[size:])
            answer = self._engine_answer(highs)
        return answer

    def _engine_answer(self, engine: _Engine) -> SimplexAnswer:
        """Return an engine's answer; FAILED if it raises, or if sizes or numbers are wrong."""
        try:
            outcome, x, rows = engine.solve()
        except (ArithmeticError, RuntimeError, ValueError):
            return SimplexAnswer(SimplexOutcome.FAILED, np.zeros(0), np.zeros(0))
        answer = SimplexAnswer(_OUTCOMES[outcome], x, rows)
        if answer.outcome is not SimplexOutcome.OPTIMAL or (
            answer.is_optimal and (len(x), len(rows)) == (self._size, self.row_count)
        ):
            return answer
        return SimplexAnswer(SimplexOutcome.FAILED, x, rows)


class _Highs:
    """HiGHS as an `_Engine`; it returns an index of `_OUTCOMES`, x and the rows' marginals."""

    def __init__(self, cost: FloatArray, lb: FloatArray, ub: FloatArray) -> None:
        import highspy

        status = highspy.HighsModelStatus
        self._outcome_indices = {status.kOptimal: 0, status.kInfeasible: 1, status.kUnbounded: 2}
        self._error = highspy.HighsStatus.kError
        self._highs = highspy.Highs()
        for name, value in _OPTIONS.items():
            self._highs.setOptionValue(name, value)
        self._size = len(cost)
        self._all = np.arange(self._size, dtype=np.int32)
        empty = np.zeros(0, dtype=np.int32)
        self._highs.addCols(self._size, cost, lb, ub, 0, empty, empty, np.zeros(0))
        self._is_whole = True

    def add_rows(self, rows: FloatArray, low: FloatArray, high: FloatArray) -> None:
        where = rows != 0.0
        starts = np.concatenate([[0], np.cumsum(where.sum(axis=1))[:-1]]).astype(np.int32)
        columns = np.nonzero(where)[1].astype(np.int32)
        values = rows[where]
        added = self._highs.addRows(len(rows), low, high, len(values), starts, columns, values)
        self._is_whole &= added != self._error

    def drop_rows(self, first: int, after: int) -> None:
        self._highs.deleteRows(after - first, np.arange(first, after, dtype=np.int32))

    def set_sides(self, rows: NDArray[np.int32], low: FloatArray, high: FloatArray) -> None:
        # The stubs of highspy do not know it.
        self._highs.changeRowsBounds(len(rows), rows, low, high)  # pyright: ignore[reportAttributeAccessIssue]

    def set_bounds(self, lb: FloatArray, ub: FloatArray) -> None:
        self._highs.changeColsBounds(self._size, self._all, lb, ub)

    def set_cost(self, cost: FloatArray) -> None:
        self._highs.changeColsCost(self._size, self._all, cost)

    def solve(self) -> tuple[int, FloatArray, FloatArray]:
        if not self._is_whole:
            raise ArithmeticError("HiGHS leaves out rows with numbers above 1e15")
        answer = self._run_highs()
        if answer[0] == _FAILED:
            self._highs.clearSolver()
            answer = self._run_highs()
        return answer

    def _run_highs(self) -> tuple[int, FloatArray, FloatArray]:
        self._highs.run()
        solution = self._highs.getSolution()
        return (
            self._outcome_indices.get(self._highs.getModelStatus(), _FAILED),
            np.array(solution.col_value, dtype=np.float64),
            np.array(solution.row_dual, dtype=np.float64),
        )
