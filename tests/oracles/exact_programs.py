"""Linear programs over the rationals: a basis found in floats, then judged exactly.

HiGHS proposes which rows hold with equality. The basis is built in integers that share one
denominator (each pivot divides exactly, as in Bareiss' elimination), so the signs that decide on
feasibility and optimality are those of the true numbers. Where the proposal is not optimal, exact
steps of the dual and the primal simplex method go on from it and end with an optimum or with a row
that no point can satisfy.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import highspy
import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.object_]
Row = Sequence[Fraction | int]

_GREEDY = 100
"""Steps after which the least index decides, so that none is taken again and again."""


class UnboundedError(Exception):
    """The program has no least value."""


@dataclass(frozen=True)
class Optimum:
    """A least value and where it is reached.

    Attributes:
        value: c^T x.
        x: The point.
        weights: Multipliers of the rows: c + sum of weight * row = 0, not negative for the
            inequalities, zero where a row does not hold with equality.
    """

    value: Fraction
    x: tuple[Fraction, ...]
    weights: tuple[Fraction, ...]


@dataclass(frozen=True)
class Infeasible:
    """A proof that no point meets all rows (Farkas).

    Attributes:
        weights: Multipliers, not negative for the inequalities, with sum of weight * row = 0 and
            sum of weight * side < 0.
    """

    weights: tuple[Fraction, ...]


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows a^T x = b and a^T x <= b in integers, each with a positive factor of its own.

    Attributes:
        table: (m, 1 + n) [b, -a]: the room that each row leaves.
        factors: (m,) what the rational rows were multiplied by.
        equal: (m,) bool, which rows are equations.
    """

    table: Integers
    factors: list[Fraction]
    equal: NDArray[np.bool_]

    @classmethod
    def of(cls, equations: Sequence[tuple[Row, Any]], others: Sequence[tuple[Row, Any]]) -> Rows:
        """Take rational rows (a, b)."""
        both = [*equations, *others]
        pairs = [_whole([Fraction(side), *(-Fraction(entry) for entry in a)]) for a, side in both]
        size = len(pairs[0][0])
        table = np.empty((len(pairs), size), dtype=object)
        for index, (entries, _) in enumerate(pairs):
            table[index] = entries
        equal = np.arange(len(pairs)) < len(equations)
        return cls(table, [factor for _, factor in pairs], equal)

    def joined(self, other: Rows) -> Rows:
        """Return these rows and others below them."""
        return Rows(
            np.concatenate([self.table, other.table]),
            self.factors + other.factors,
            np.concatenate([self.equal, other.equal]),
        )


def solve(rows: Rows, cost: Row) -> Optimum | Infeasible:
    """Minimise cost^T x over all x that meet the rows; x has no other bounds.

    Raises:
        UnboundedError: If no least value exists.
    """
    return _Dictionary(rows, cost).solved(_guess(rows, cost))


def assert_proven(rows: Rows, cost: Row, answer: Optimum | Infeasible) -> None:
    """Check an answer by its own numbers: what it says is then true, whoever found it."""
    sides = [Fraction(entry) / rows.factors[i] for i, entry in enumerate(rows.table[:, 0])]
    matrix = [
        [-Fraction(entry) / rows.factors[i] for entry in row]
        for i, row in enumerate(rows.table[:, 1:])
    ]
    assert all(
        weight >= 0 for weight, equal in zip(answer.weights, rows.equal, strict=True) if not equal
    )
    combined = [
        sum(
            (weight * row[j] for weight, row in zip(answer.weights, matrix, strict=True)),
            Fraction(),
        )
        for j in range(len(cost))
    ]
    reach = sum((w * b for w, b in zip(answer.weights, sides, strict=True)), Fraction())
    if isinstance(answer, Infeasible):
        assert not any(combined) and reach < 0
        return
    for row, side, equal in zip(matrix, sides, rows.equal, strict=True):
        room = side - sum((a * x for a, x in zip(row, answer.x, strict=True)), Fraction())
        assert room == 0 if equal else room >= 0
    assert [Fraction(c) for c in cost] == [-entry for entry in combined]
    assert answer.value == sum((c * x for c, x in zip(cost, answer.x, strict=True)), Fraction())
    assert answer.value == -reach


def _whole(entries: Sequence[Fraction]) -> tuple[list[int], Fraction]:
    """Entries times the least positive factor that makes them whole, and that factor."""
    denominator = math.lcm(*(entry.denominator for entry in entries))
    whole = [entry.numerator * (denominator // entry.denominator) for entry in entries]
    divisor = math.gcd(*whole) or 1
    return [entry // divisor for entry in whole], Fraction(denominator, divisor)


class _Dictionary:
    """Every row's room, and the cost, in terms of the rooms that are zero now.

    Rows are named by their number, x_j by -1 - j. The true entry is ``table / denominator``.
    """

    def __init__(self, rows: Rows, cost: Row) -> None:
        """State the rooms and the cost in terms of x."""
        last, factor = _whole([Fraction(0), *(Fraction(entry) for entry in cost)])
        self.table: Integers = np.concatenate([rows.table, np.array([last], dtype=object)])
        self.denominator = 1
        self.basic: list[int] = list(range(len(rows.equal)))
        self.nonbasic: list[int] = [-1 - j for j in range(rows.table.shape[1] - 1)]
        self._rows, self._cost_factor = rows, factor
        self._equal = rows.equal.tolist()

    def solved(self, active: Sequence[int]) -> Optimum | Infeasible:
        """Solve, with rows that are likely to hold with equality made zero first."""
        for row in [*np.flatnonzero(self._equal).tolist(), *active]:
            self._make_zero(row)
        impossible = self._free_columns()
        return self._simplex() if impossible is None else impossible

    def _make_zero(self, row: int) -> None:
        """Make a row's room zero in the place of some x_j, if any x_j still moves it."""
        place = self.basic.index(row)
        for column, name in enumerate(self.nonbasic, 1):
            if name < 0 and self.table[place, column] != 0:
                self._pivot(place, column)
                return

    def _free_columns(self) -> Infeasible | None:
        """Let no x_j be zero for want of a row, and no equation be left over."""
        for column, name in enumerate(self.nonbasic, 1):
            if name < 0:
                moved = np.flatnonzero(self.table[: len(self.basic), column] != 0)
                chosen = [place for place in moved.tolist() if self.basic[place] >= 0]
                if chosen:
                    self._pivot(chosen[0], column)
                elif self.table[-1, column] != 0:
                    raise UnboundedError
        for place, name in enumerate(self.basic):
            # An equation that no x_j moves is a combination of the others.
            if name >= 0 and self._equal[name] and self.table[place, 0] != 0:
                return self._proof(place, 1 if self.table[place, 0] < 0 else -1)
        return None

    def _pivot(self, place: int, column: int) -> None:
        """Exchange a basic name and a nonbasic one."""
        table, pivot = self.table, self.table[place, column]
        row, moved = table[place].copy(), table[:, column].copy()
        table = (table * pivot - np.multiply.outer(moved, row)) // self.denominator
        table[:, column] = moved
        table[place] = -row
        table[place, column] = self.denominator
        if pivot < 0:
            table, pivot = -table, -pivot
        self.table, self.denominator = table, pivot
        self.basic[place], self.nonbasic[column - 1] = self.nonbasic[column - 1], self.basic[place]

    def _simplex(self) -> Optimum | Infeasible:
        """Make the dictionary feasible by dual steps, or find a proof, then optimal by primal."""
        # Dual steps need costs that are not negative: those that are count as zero at first.
        costs = self.table[-1].copy()
        for column, name in enumerate(self.nonbasic, 1):
            if name < 0 or self._equal[name] or costs[column] < 0:
                costs[column] = 0
        self.table = np.concatenate([self.table, costs[None]])
        for step in itertools.count():
            place = self._leaving(step)
            if place is None:
                break
            column = self._entering(place)
            if column is None:
                return self._proof(place, 1)
            self._pivot(place, column)
        self.table = self.table[:-1]
        for step in itertools.count():
            column = self._improving(step)
            if column is None:
                return self._optimum()
            self._pivot(self._blocking(column), column)
        raise AssertionError

    def _leaving(self, step: int) -> int | None:
        """The row that is missed the most; after many steps the first one, which ends cycles."""
        missed = [
            (self.table[place, 0] if step < _GREEDY else name, place)
            for place, name in enumerate(self.basic)
            if name >= 0 and self.table[place, 0] < 0
        ]
        return min(missed)[1] if missed else None

    def _entering(self, place: int) -> int | None:
        """The column that can raise a row at the least cost."""
        costs, row = self.table[-1], self.table[place]
        ways = [
            (Fraction(costs[column], row[column]), name, column)
            for column, name in enumerate(self.nonbasic, 1)
            if name >= 0 and not self._equal[name] and row[column] > 0
        ]
        return min(ways)[2] if ways else None

    def _improving(self, step: int) -> int | None:
        """The column with the most negative cost; after many steps the first one."""
        ways = [
            (self.table[-1, column] if step < _GREEDY else name, column)
            for column, name in enumerate(self.nonbasic, 1)
            if name >= 0 and not self._equal[name] and self.table[-1, column] < 0
        ]
        return min(ways)[1] if ways else None

    def _blocking(self, column: int) -> int:
        """The row that a column makes zero first."""
        ways = [
            (Fraction(self.table[place, 0], -self.table[place, column]), name, place)
            for place, name in enumerate(self.basic)
            if name >= 0 and self.table[place, column] < 0
        ]
        if not ways:
            raise UnboundedError
        return min(ways)[2]

    def _weights(self, entries: Integers, unit: Fraction) -> list[Fraction]:
        """Multipliers of the rational rows for a combination of rooms that are zero."""
        weights = [Fraction(0)] * len(self._equal)
        for column, name in enumerate(self.nonbasic, 1):
            if name >= 0:
                weights[name] = Fraction(entries[column]) * self._rows.factors[name] * unit
        return weights

    def _optimum(self) -> Optimum:
        unit = 1 / (self._cost_factor * self.denominator)
        x = [Fraction(0)] * (len(self.table[0]) - 1)
        for place, name in enumerate(self.basic):
            if name < 0:
                x[-1 - name] = Fraction(self.table[place, 0], self.denominator)
        weights = self._weights(self.table[-1], unit)
        return Optimum(Fraction(self.table[-1, 0]) * unit, tuple(x), tuple(weights))

    def _proof(self, place: int, sign: int) -> Infeasible:
        """The row's room, which is -sign times something positive, as a combination of rows."""
        unit = Fraction(-sign, self.denominator)
        weights = self._weights(self.table[place], unit)
        weights[self.basic[place]] += Fraction(sign) * self._rows.factors[self.basic[place]]
        return Infeasible(tuple(weights))


def _guess(rows: Rows, cost: Row) -> list[int]:
    """Inequalities that hold with equality at HiGHS' last basis, of rows of unit size."""
    table = rows.table
    largest = np.array([max(1, *map(abs, row[1:])) for row in table], dtype=object)
    matrix = np.array(
        [
            [-float(Fraction(a, big)) for a in row[1:]]
            for row, big in zip(table, largest, strict=True)
        ]
    )
    sides = np.array([float(Fraction(b, big)) for b, big in zip(table[:, 0], largest, strict=True)])
    count, size = matrix.shape
    engine = highspy.Highs()
    engine.setOptionValue("output_flag", False)  # noqa: FBT003
    engine.setOptionValue("threads", 1)
    engine.setOptionValue("presolve", "off")
    engine.setOptionValue("solver", "simplex")
    engine.setOptionValue("primal_feasibility_tolerance", 1e-10)
    engine.setOptionValue("dual_feasibility_tolerance", 1e-10)
    engine.addVars(size, np.full(size, -np.inf), np.full(size, np.inf))
    engine.changeColsCost(size, np.arange(size), np.array([float(entry) for entry in cost]))
    engine.addRows(
        count, np.where(rows.equal, sides, -np.inf), sides, count * size,
        np.arange(0, count * size, size), np.tile(np.arange(size), count), matrix.ravel(),
    )  # fmt: skip
    engine.run()
    states = engine.getBasis().row_status
    return [
        row
        for row, state in enumerate(states)
        if state == highspy.HighsBasisStatus.kUpper and not rows.equal[row]
    ]
