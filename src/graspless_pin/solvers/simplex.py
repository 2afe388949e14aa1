"""A linear program that grows, shrinks and is solved again from its last basis, by HiGHS."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import highspy
import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray

_OPTIONS: dict[str, bool | int | float | str] = {
    "output_flag": False,
    "presolve": "off",
    "solver": "simplex",
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
    "threads": 1,
}
_OUTCOMES = {
    highspy.HighsModelStatus.kOptimal: "optimal",
    highspy.HighsModelStatus.kInfeasible: "infeasible",
    highspy.HighsModelStatus.kUnbounded: "unbounded",
}


class SimplexOutcome(StrEnum):
    """What the simplex method says of a linear program; nothing of it is proven by that."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    UNBOUNDED = "unbounded"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class SimplexAnswer:
    """An answer of the simplex method.

    Attributes:
        outcome: What HiGHS says.
        x: (n,) variables.
        rows: (m,) marginals of the rows: the least cost rises by so much for each unit by which
            the active side of a row rises.
    """

    outcome: SimplexOutcome
    x: FloatArray
    rows: FloatArray


class Simplex:
    """Minimise c.x over lb <= x <= ub and low <= R x <= high, again and again.

    Rows are added at the end and taken away from the end, bounds and costs change in place; each
    solve begins at the basis of the last one.
    """

    def __init__(self, cost: FloatArray, lb: FloatArray, ub: FloatArray) -> None:
        """Begin without rows.

        Args:
            cost: (n,) c.
            lb: (n,), -inf where there is no bound.
            ub: (n,).
        """
        self._highs = highspy.Highs()
        for name, value in _OPTIONS.items():
            self._highs.setOptionValue(name, value)
        self._size = len(cost)
        self._all = np.arange(self._size, dtype=np.int32)
        empty = np.zeros(0, dtype=np.int32)
        self._highs.addCols(self._size, cost, lb, ub, 0, empty, empty, np.zeros(0))
        self._is_whole = True
        self.row_count = 0
        self.solves = 0

    def add_rows(self, rows: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Add (k, n) rows with their sides."""
        where = rows != 0.0
        starts = np.concatenate([[0], np.cumsum(where.sum(axis=1))[:-1]]).astype(np.int32)
        columns = np.nonzero(where)[1].astype(np.int32)
        values = rows[where]
        added = self._highs.addRows(len(rows), low, high, len(values), starts, columns, values)
        self._is_whole &= added != highspy.HighsStatus.kError
        self.row_count += len(rows)

    def drop_rows(self, first: int, after: int) -> None:
        """Take away the rows from ``first`` to before ``after``."""
        gone = np.arange(first, after, dtype=np.int32)
        if len(gone):
            self._highs.deleteRows(len(gone), gone)
            self.row_count -= len(gone)

    def set_sides(self, rows: NDArray[np.int32], low: FloatArray, high: FloatArray) -> None:
        """Set the sides of some rows."""
        # The stubs of highspy do not know it.
        self._highs.changeRowsBounds(len(rows), rows, low, high)  # pyright: ignore[reportAttributeAccessIssue]

    def set_bounds(self, lb: FloatArray, ub: FloatArray) -> None:
        """Set the bounds of all variables."""
        self._highs.changeColsBounds(self._size, self._all, lb, ub)

    def set_cost(self, cost: FloatArray) -> None:
        """Set the cost of all variables."""
        self._highs.changeColsCost(self._size, self._all, cost)

    def solve(self) -> SimplexAnswer:
        """Solve from the last basis; from none where that fails.

        Rows that HiGHS does not take, for numbers above 1e15, leave another program: it fails.
        """
        self.solves += 1
        if not self._is_whole:
            return SimplexAnswer(SimplexOutcome.FAILED, np.zeros(0), np.zeros(0))
        answer = self._run()
        if answer.outcome is SimplexOutcome.FAILED:
            self._highs.clearSolver()
            answer = self._run()
        return answer

    def _run(self) -> SimplexAnswer:
        self._highs.run()
        outcome = SimplexOutcome(_OUTCOMES.get(self._highs.getModelStatus(), "failed"))
        solution = self._highs.getSolution()
        return SimplexAnswer(
            outcome,
            np.array(solution.col_value, dtype=np.float64),
            np.array(solution.row_dual, dtype=np.float64),
        )
