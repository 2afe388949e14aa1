"""A convex program as plain arrays of named blocks, and what any answer to it proves.

Each block of rows knows its meaning, its unit and its signs. The columns of the contact forces come
first, then those that an objective adds. Nothing but a block itself knows at which rows it stands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from graspless_pin.problem.checks import FloatArray, all_finite, all_within
from graspless_pin.problem.scales import MOST_STRICT
from graspless_pin.records import changed, unchecked


class Sign(Enum):
    """Which multipliers the rows of a block may have."""

    ANY = "equalities: of any sign"
    UPPER = "upper sides only: not negative"
    CONE = "second-order cones, three rows each: in the cone themselves"
    EITHER = "lower and upper sides: told apart as NAME_lower and NAME_upper"


class Block(NamedTuple):
    """Rows of a program, or bounds of its columns, with one meaning.

    Attributes:
        name: Its name.
        at: Where it stands: among the rows, or among the columns.
        unit: What one of each scaled row is in the problem's units: a number or (k,).
        sign: The signs of its multipliers.
        shape: Shape of its multipliers when they are given by contact or joint.
        places: (k,) flat places there; None: all, in order.
    """

    name: str
    at: slice | NDArray[np.int_]
    unit: float | FloatArray
    sign: Sign
    shape: tuple[int, ...]
    places: NDArray[np.int_] | None = None

    def spread(self, values: FloatArray) -> FloatArray:
        """Return values of its rows by contact or joint, zero where there is no row."""
        if self.places is None:
            return values.reshape(self.shape)
        full = np.zeros(self.shape)
        full.reshape(-1)[self.places] = values
        return full

    def gathered(self, values: FloatArray) -> FloatArray:
        """Return the values of its rows from those by contact or joint."""
        flat = values.reshape(-1)
        return flat if self.places is None else flat[self.places]


class Columns(NamedTuple):
    """Columns that an objective adds to those of the forces.

    Attributes:
        first: Index of the first among all columns.
        size: How many there are.
    """

    first: int
    size: int

    @property
    def at(self) -> slice:
        """Where they stand."""
        return slice(self.first, self.first + self.size)


Terms = Mapping[Columns, ArrayLike]
"""Coefficients of added columns: a number, one a row (for a single column), or a matrix."""


class MatrixInequality(NamedTuple):
    """constant + sum_k x_k coefficients_k is positive semidefinite.

    Attributes:
        constant: (d, d) symmetric.
        coefficients: (n, d, d) symmetric.
    """

    constant: FloatArray
    coefficients: FloatArray


FARTHEST = 1e8
"""Bounds are proven for variables up to this size: double precision resolves no more."""
LARGEST_FIGURE = 1e15
"""Solvers are given no larger figure: HiGHS takes none in rows, and crashes on sides of 1e20."""
_LARGEST_FOR_BLAS = 8192
"""Entries from which on BLAS spreads a product over threads: on a busy machine their waiting for
each other costs far more than the product."""
_LARGEST_DENSE = 65536
"""Entries from which on a sparse matrix pays, which takes longer to make than to use."""


@dataclass(frozen=True, eq=False)
class Program:
    """Minimise 1/2 x^T diag(P) x + c^T x subject to A x = b, l <= G x <= u, lb <= x <= ub.

    The last rows of G may be second-order cones, three rows each: there G x - l is in the cone, its
    first entry at least the length of the two others.

    Every variable is scaled to order one and has finite bounds that any feasible point obeys, so
    that a dual vector of whatever quality still proves a bound.

    Attributes:
        P: (n,) diagonal of the quadratic term, >= 0.
        c: (n,) linear term.
        A: (m, n) equality rows.
        b: (m,) right-hand side.
        G: (k, n) inequality rows, those of cones last.
        l: (k,) lower sides, -inf where there is none.
        u: (k,) upper sides, inf where there is none; of cones the same as the lower ones.
        lb: (n,) lower bounds to be imposed, -inf where there is none.
        ub: (n,) upper bounds to be imposed, inf where there is none.
        box: (2, n) finite bounds that are implied by the constraints, cut at `FARTHEST`: for
            proofs, not imposed.
        whole_box: (2, n) implied bounds without the cut at `FARTHEST`; None: the same as `box`.
        cone_count: How many second-order cones there are.
        blocks: What its rows mean, in their order; empty: not told.
        bounded_blocks: What its columns with bounds mean.
        boxes_are_stated: Whether somebody stated the boxes of the blocks' columns: an optimum
            that they hide is a mistake of the objective.
        strict: (m + k,) how many times as closely as others each row has to be met, at least 1;
            None: none more closely, and bounds neither.
    """

    P: FloatArray
    c: FloatArray
    A: FloatArray
    b: FloatArray
    G: FloatArray
    l: FloatArray  # noqa: E741 - the letter of the docstring's program
    u: FloatArray
    lb: FloatArray
    ub: FloatArray
    box: FloatArray
    whole_box: FloatArray | None = None
    cone_count: int = 0
    blocks: tuple[Block, ...] = ()
    bounded_blocks: tuple[Block, ...] = ()
    boxes_are_stated: bool = False
    strict: FloatArray | None = None

    @classmethod
    def of_rows(
        cls,
        rows: FloatArray,
        count: int,
        low: FloatArray,
        high: FloatArray,
        *,
        linear: bool,
        **others: Any,
    ) -> Program:
        """Return a program whose A and G are the first ``count`` rows of one array and the rest.

        Args:
            rows: (m + k, n) A above G; kept.
            count: m.
            low: (m + k,) their lower sides: b, then l; kept.
            high: (m + k,) their upper sides: b, then u; kept.
            linear: Whether P is zero.
            others: P, c, lb, ub, box and other attributes.
        """
        return unchecked(
            cls,
            **others,
            A=rows[:count],
            b=low[:count],
            G=rows[count:],
            l=low[count:],
            u=high[count:],
            rows=rows,
            sides=(low, high),
            is_linear=linear,
        )

    def column(self, name: str) -> int:
        """Return the index of an added column by its name."""
        index = next(one.at for one in self.bounded_blocks if one.name == name)
        return int(np.arange(len(self.c))[index].item())

    def bounded(self, lb: FloatArray, ub: FloatArray, cutoff: float = np.inf) -> Program:
        """Return the same program with other bounds; matrices and what is known of them shared.

        Args:
            lb: (n,) lower bounds.
            ub: (n,) upper bounds.
            cutoff: A value above which solutions are of no interest.
        """
        if lb is self.lb and ub is self.ub and cutoff >= self.cutoff:
            return self
        cutoff = min(self.cutoff, cutoff)
        return changed(self, "reach", **self._shared, lb=lb, ub=ub, cutoff=cutoff)

    @cached_property
    def _shared(self) -> dict[str, Any]:
        """What is derived once for all programs that differ in bounds alone.

        Whether a limit is too far away is told by the bounds of the first.
        """
        return {
            "rows": self.rows,
            "_sparse": self._sparse,
            "sides": self.sides,
            "pattern": self.pattern,
            "is_linear": self.is_linear,
            "is_far": self.is_far,
            "farthest": self.farthest,
            "highest": self.highest,
            "has_rows_in_range": self.has_rows_in_range,
        }

    @cached_property
    def farthest(self) -> float:
        """The largest bound of a variable that proofs look at."""
        return float(np.abs(self.box).max(initial=0.0))

    @cached_property
    def is_far(self) -> bool:
        """Whether a limit is too far away for double precision, or a row has none."""
        sides = np.concatenate([self.l, self.u, self.lb, self.ub])
        beyond = (np.abs(sides) > FARTHEST) & np.isfinite(sides)
        return bool(beyond.any() or (np.isinf(self.l) & np.isinf(self.u)).any())

    @cached_property
    def has_rows_in_range(self) -> bool:
        """Whether solvers bear all its figures but sides of G and bounds."""
        return all_within((self.P, self.c, self.b, self.rows.T), LARGEST_FIGURE)

    def has_sides_beyond(self, size: float) -> bool:
        """Return whether any limit or right-hand side is larger than a size."""
        sides = np.concatenate([*self.sides, self.lb, self.ub])
        return bool((np.abs(sides[np.isfinite(sides)]) > size).any())

    @cached_property
    def is_linear(self) -> bool:
        """Whether P is zero."""
        return np.count_nonzero(self.P) == 0

    @property
    def is_polyhedral(self) -> bool:
        """Whether it is a linear program: P is zero and there are no cones."""
        return self.is_linear and not self.cone_count

    @property
    def flat_count(self) -> int:
        """Number of rows of G that are of no cone."""
        return len(self.G) - 3 * self.cone_count

    @cached_property
    def rows(self) -> FloatArray:
        """(m + k, n) all rows, A above G."""
        return np.concatenate([self.A, self.G])

    @cached_property
    def _sparse(self) -> Any:
        """The rows as a sparse matrix; None where they are few."""
        return csr_array(self.rows) if self.rows.size > _LARGEST_DENSE else None

    def row_values(self, x: FloatArray) -> FloatArray:
        """Return (m + k,) what all rows are at x (n,)."""
        if self._sparse is not None:
            return self._sparse.dot(x)
        if self.rows.size > _LARGEST_FOR_BLAS:
            return np.einsum("ij,j->i", self.rows, x)
        return self.rows.dot(x)

    def row_slope(self, weights: FloatArray) -> FloatArray:
        """Return (n,) the slope of all rows with weights (m + k,)."""
        if self._sparse is not None:
            return self._sparse.T.dot(weights)
        if self.rows.size > _LARGEST_FOR_BLAS:
            return np.einsum("ij,i->j", self.rows, weights)
        return weights.dot(self.rows)

    @cached_property
    def pattern(self) -> bytes:
        """Where A and G have entries: the same for programs of the same structure."""
        return np.packbits(self.rows != 0.0).tobytes()

    @cached_property
    def sides(self) -> tuple[FloatArray, FloatArray]:
        """(m + k,) lower and upper sides of all rows, infinite where there is none."""
        return np.concatenate((self.b, self.l)), np.concatenate((self.b, self.u))

    @cached_property
    def is_resolved(self) -> bool:
        """Whether every row can be met as closely as it has to be."""
        return self.strict is None or bool(self.strict.max() <= MOST_STRICT)

    @cached_property
    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of every variable, imposed and implied."""
        return self.within(self.box)

    @property
    def whole_reach(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of every variable of all solutions, the farthest too."""
        return self.reach if self.whole_box is None else self.within(self.whole_box)

    def within(self, box: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a box of the variables as the imposed bounds leave it."""
        return np.maximum(box[0], self.lb), np.minimum(box[1], self.ub)

    @cached_property
    def cutoff(self) -> float:
        """A proven bound above it means infeasible: `highest`, or a cutoff below it."""
        return self.highest

    @cached_property
    def highest(self) -> float:
        """The largest objective value inside the box; no bound of a feasible program exceeds it."""
        box = self.box if self.whole_box is None else self.whole_box
        highest = float(self.c @ np.where(self.c >= 0.0, box[1], box[0]))
        if self.is_linear:
            return highest
        return highest + float(0.5 * self.P @ np.abs(box).max(axis=0) ** 2)

    def value(self, x: FloatArray) -> float:
        """Return the objective at x."""
        if self.is_linear:
            return float(self.c.dot(x))
        return float((0.5 * self.P * x + self.c).dot(x))

    def residual(self, x: FloatArray) -> float:
        """Return the largest violation of any constraint at x, in scaled units.

        That of a row counts as many times as it is strict.
        """
        (low, high), rows = self.sides, self.row_values(x)
        beyond = np.maximum(rows - high, low - rows)
        if self.strict is not None:
            beyond *= self.strict
        if self.cone_count:
            flat = len(rows) - 3 * self.cone_count
            inside = (rows[flat:] - low[flat:]).reshape(-1, 3)
            beyond = np.concatenate((beyond[:flat], _lengths(inside) - inside[:, 0]))
        outside = np.maximum(x - self.ub, self.lb - x)
        return float(np.maximum.reduce(outside, initial=np.maximum.reduce(beyond, initial=0.0)))

    def dual_bound(self, y: FloatArray, z: FloatArray, *, whole: bool = False) -> float:
        """Return a lower bound on the optimum that the multipliers prove, whatever their quality.

        The Lagrangian is minimised exactly over the bounds, imposed and implied, variable by
        variable, so no stationarity needs to hold.

        Args:
            y: (m,) multipliers of A x = b.
            z: (k,) multipliers of the rows of G; positive: the upper side, negative: the lower.
                Minus those of a cone are in the cone, or are taken for the next that are.
            whole: Whether it is to hold of the farthest solutions, too.
        """
        slope, constant = self._lagrangian(self._in_cones(np.concatenate((y, z))))
        slope += self.c
        reach = self.whole_reach if whole else self.reach
        return self._smallest(slope, reach, curved=not self.is_linear) + constant

    def assess(self, x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[float, float, float]:
        """Return `dual_bound`, `value` and `residual` of a solution and its multipliers.

        What is not finite proves nothing.
        """
        if not all_finite((x, y, z)):
            return -np.inf, np.inf, np.inf
        return self.dual_bound(y, z), self.value(x), self.residual(x)

    def infeasibility_bound(self, y: FloatArray, z: FloatArray, *, strictly: bool = False) -> float:
        """Return a lower bound on the smallest common violation of all rows within the bounds.

        Positive: the multipliers are a Farkas certificate that no feasible point exists.

        Args:
            y: (m,) multipliers of A x = b.
            z: (k,) multipliers of the rows of G, see `dual_bound`.
            strictly: Whether a row's violation counts as many times as it is strict.
        """
        weights = self._in_cones(np.concatenate([y, z]))
        sizes = np.abs(weights)
        if strictly and self.strict is not None:
            sizes /= self.strict
        size = float(sizes.sum())
        if not (np.isfinite(size) and size > 0.0):
            return -np.inf
        slope, constant = self._lagrangian(weights / size)
        return self._smallest(slope, self.whole_reach, curved=False) + constant

    def _in_cones(self, weights: FloatArray) -> FloatArray:
        """Return multipliers of all rows, those of cones with first entries that are enough.

        Args:
            weights: (m + k,), which are changed.
        """
        if self.cone_count:
            cones = weights[len(weights) - 3 * self.cone_count :].reshape(-1, 3)
            cones[:, 0] = np.minimum(cones[:, 0], -_lengths(cones))
        return weights

    def _lagrangian(self, weights: FloatArray) -> tuple[FloatArray, float]:
        """Slope and constant of what the multipliers add to the objective.

        That is up^T (rows x - high) + down^T (low - rows x), with the positive weights in up and
        the sizes of the negative ones in down; a weight on a side that is not there counts as 0.
        """
        low, high = self.sides
        side = np.where(weights > 0.0, high, low)
        there = np.isfinite(side)
        weights = np.where(there, weights, 0.0)
        constant = -float(weights.dot(np.where(there, side, 0.0)))
        return self.row_slope(weights), constant

    def _smallest(
        self, slope: FloatArray, reach: tuple[FloatArray, FloatArray], *, curved: bool
    ) -> float:
        """Smallest value of 1/2 x^T diag(P) x + slope^T x over bounds.

        Args:
            slope: (n,) the linear term.
            reach: Bounds of every variable.
            curved: Whether P counts.
        """
        low, high = reach
        at = np.where(slope >= 0.0, low, high)
        if not curved:
            return float(slope.dot(at))
        bent = self.P > 0.0
        turning = np.where(bent, -slope / np.where(bent, self.P, 1.0), at)
        at = np.where(bent, np.clip(turning, low, high), at)
        return float((0.5 * self.P * at + slope) @ at)


def _lengths(triples: FloatArray) -> FloatArray:
    """(q,) lengths of the last two entries of (q, 3) triples."""
    return np.hypot(triples[:, 1], triples[:, 2])
