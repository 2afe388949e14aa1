"""Linear programs with second-order cones of any size, sparse, by Clarabel.

For programs too large to be full matrices. Their answers are a solver's word: who asks checks them.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import clarabel as compiled_clarabel
import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from graspless_pin.problem.checks import FloatArray

clarabel: Any = compiled_clarabel
_TOLERANCE = 1e-8
_ANSWERS, _NOTHING = ("Solved", "AlmostSolved"), ("PrimalInfeasible", "DualInfeasible")
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

    def cones(
        self, entries: list[Entries], sides: FloatArray, inside: list[Entries]
    ) -> NDArray[np.int_]:
        """Add a cone for each row: the length of d products is at most h - g x.

        Args:
            entries: Of g, a row for each cone.
            sides: (k,) h.
            inside: d times the entries of B, a row for each cone.

        Returns:
            What `solve` has the multipliers of h - g x under, negative.
        """
        size, count, part = 1 + len(inside), len(sides), self._cones
        spread = np.zeros((count, size))
        spread[:, 0] = sides
        part.add(entries, spread.ravel(), size, 0)
        for number, one in enumerate(inside, 1):
            part.add([one], np.zeros(0), size, number)
        first = part.count
        part.count += count * size
        self._sizes += [size] * count
        return -1 - (first + size * np.arange(count))

    def solve(
        self, time_limit: float | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Return x with the multipliers of rows and of cones, or None where Clarabel has none.

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
            settings = clarabel.DefaultSettings()
            settings.verbose = settings.presolve_enable = False
            settings.iterative_refinement_enable = refined
            if deadline is not None:
                settings.time_limit = max(deadline - time.monotonic(), 0.0)
            settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
            found = clarabel.DefaultSolver(curved, cost, matrix, sides, kinds, settings).solve()
            status = str(found.status)
            if status in _ANSWERS:
                x, z = np.array(found.x), np.array(found.z)
                return x, z[firsts[1] : firsts[2]], z[firsts[2] :]
            if status in _NOTHING:
                break
        return None
