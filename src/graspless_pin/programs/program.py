"""A convex program as plain arrays of named blocks, and the bounds that multipliers prove on it.

Each block of rows has a name, a unit and the signs of its multipliers. The columns of the contact
forces come first, then those that an objective adds. Only the block itself stores its row indices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.problem.checks import FloatArray, all_finite, all_within
from graspless_pin.problem.scales import MOST_STRICT
from graspless_pin.records import changed, unchecked


class Sign(Enum):
    """The signs that the multipliers of a block's rows may have."""

    ANY = "equalities: of any sign"
    UPPER = "upper sides only: not negative"
    CONE = "second-order cones, three rows each: in the cone themselves"
    EITHER = "lower and upper sides: told apart as NAME_lower and NAME_upper"


class Block(NamedTuple):
    """A named group of rows of a program, or of bounds of its columns.

    Attributes:
        name: Its name.
        at: Its indices among the rows, or among the columns.
        unit: Problem units per scaled unit of each row: a number or (k,).
        sign: The signs of its multipliers.
        shape: Shape of its multipliers when they are given by contact or joint.
        places: (k,) flat indices of its rows in that shape; None: all, in order.
    """

    name: str
    at: slice | NDArray[np.int_]
    unit: float | FloatArray
    sign: Sign
    shape: tuple[int, ...]
    places: NDArray[np.int_] | None = None

    def in_shape(self, values: FloatArray) -> FloatArray:
        """Return values of its rows in `shape`, zero where there is no row."""
        if self.places is None:
            return values.reshape(self.shape)
        full = np.zeros(self.shape)
        full.reshape(-1)[self.places] = values
        return full

    def row_entries(self, values: FloatArray) -> FloatArray:
        """Return the values of its rows from an array in `shape`."""
        flat = values.reshape(-1)
        return flat if self.places is None else flat[self.places]


class Columns(NamedTuple):
    """Columns that an objective adds to those of the contact forces.

    Attributes:
        first: Index of the first among all columns.
        size: Number of columns.
    """

    first: int
    size: int

    @property
    def at(self) -> slice:
        """Their slice among all columns."""
        return slice(self.first, self.first + self.size)


Terms = Mapping[Columns, ArrayLike]
"""Coefficients of added columns: a number, one per row (for a single column), or a matrix."""


class MatrixInequality(NamedTuple):
    """constant + sum_k x_k coefficients_k is positive semidefinite.

    Attributes:
        constant: (d, d) symmetric.
        coefficients: (n, d, d) symmetric.
    """

    constant: FloatArray
    coefficients: FloatArray


FARTHEST = 1e8
"""Bounds are proven for variables up to this size, the limit of double precision."""
LARGEST_FIGURE = 1e15
"""Largest figure given to solvers: HiGHS takes none in rows, and crashes on sides of 1e20."""
_LARGEST_FOR_BLAS = 8192
"""Number of entries above which BLAS uses threads for a product: on a busy machine their waiting
for each other costs far more than the product."""
_LARGEST_DENSE = 65536
"""Number of entries above which a sparse matrix is faster, though building it takes time."""


@dataclass(frozen=True, eq=False)
class Program:
    """Minimise 1/2 x^T diag(P) x + c^T x subject to A x = b, l <= G x <= u, lb <= x <= ub.

    The last rows of G may be second-order cones, three rows each: there G x - l is in the cone, its
    first entry at least the length of the two others.

    Every variable is scaled to order one and has finite bounds that any feasible point obeys, so
    that any dual vector proves a bound.

    Attributes:
        P: (n,) diagonal of the quadratic term, >= 0.
        c: (n,) linear term.
        A: (m, n) equality rows.
        b: (m,) right-hand side.
        G: (k, n) inequality rows, those of cones last.
        l: (k,) lower sides, -inf where there is none.
        u: (k,) upper sides, inf where there is none; for cones the same as the lower ones.
        lb: (n,) imposed lower bounds, -inf where there is none.
        ub: (n,) imposed upper bounds, inf where there is none.
        box: (2, n) finite bounds that are implied by the constraints, cut at `FARTHEST`: for
            proofs, not imposed.
        whole_box: (2, n) implied bounds without the cut at `FARTHEST`; None: the same as `box`.
        cone_count: Number of second-order cones.
        blocks: The blocks of its rows, in their order; empty: unknown.
        bounded_blocks: The blocks of its columns with bounds.
        boxes_are_stated: Whether an objective stated the boxes of its added columns: then an
            optimum outside them is an error of the objective.
        strict: (m + k,) factor, at least 1, by which the tolerance of each row is smaller; None:
            all rows and bounds have the same tolerance.
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
        """Return a program whose A is the first ``count`` rows of an array, and G the other rows.

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
        index = next(block.at for block in self.bounded_blocks if block.name == name)
        return int(np.arange(len(self.c))[index].item())

    def with_bounds(self, lb: FloatArray, ub: FloatArray, cutoff: float = np.inf) -> Program:
        """Return the program with other bounds, which shares the matrices and their properties.

        Args:
            lb: (n,) lower bounds.
            ub: (n,) upper bounds.
            cutoff: A value above which solutions are of no interest.
        """
        if lb is self.lb and ub is self.ub and cutoff >= self.cutoff:
            return self
        cutoff = min(self.cutoff, cutoff)
        return changed(self, "reach", **self._bound_independent, lb=lb, ub=ub, cutoff=cutoff)

    @cached_property
    def _bound_independent(self) -> dict[str, Any]:
        """Properties shared by all programs that differ in bounds only.

        `is_far` is that of the first program's bounds.
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
        """Size of the largest bound in `box`."""
        return float(np.abs(self.box).max(initial=0.0))

    @cached_property
    def is_far(self) -> bool:
        """Whether a limit is too far away for double precision, or a row has no side."""
        sides = np.concatenate([self.l, self.u, self.lb, self.ub])
        beyond = (np.abs(sides) > FARTHEST) & np.isfinite(sides)
        return bool(beyond.any() or (np.isinf(self.l) & np.isinf(self.u)).any())

    @cached_property
    def has_rows_in_range(self) -> bool:
        """Whether P, c, b and the rows are all within `LARGEST_FIGURE`."""
        return all_within((self.P, self.c, self.b, self.rows.T), LARGEST_FIGURE)

    def has_sides_beyond(self, size: float) -> bool:
        """Return whether any finite side or imposed bound is larger than a size."""
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
        """Number of rows of G outside cones."""
        return len(self.G) - 3 * self.cone_count

    @cached_property
    def rows(self) -> FloatArray:
        """(m + k, n) all rows, A above G."""
        return np.concatenate([self.A, self.G])

    @cached_property
    def _sparse(self) -> Any:
        """The rows as a sparse matrix; None if they are small."""
        if self.rows.size <= _LARGEST_DENSE:
            return None
        # Imported here: documents are verified without it.
        from scipy.sparse import csr_array

        return csr_array(self.rows)

    def row_values(self, x: FloatArray) -> FloatArray:
        """Return the (m + k,) values of all rows at x (n,)."""
        if self._sparse is not None:
            return self._sparse.dot(x)
        if self.rows.size > _LARGEST_FOR_BLAS:
            return np.einsum("ij,j->i", self.rows, x)
        return self.rows.dot(x)

    def row_slope(self, weights: FloatArray) -> FloatArray:
        """Return the (n,) sum of all rows with weights (m + k,)."""
        if self._sparse is not None:
            return self._sparse.T.dot(weights)
        if self.rows.size > _LARGEST_FOR_BLAS:
            return np.einsum("ij,i->j", self.rows, weights)
        return weights.dot(self.rows)

    @cached_property
    def pattern(self) -> bytes:
        """Sparsity pattern of A and G, equal for programs of the same structure."""
        return np.packbits(self.rows != 0.0).tobytes()

    @cached_property
    def sides(self) -> tuple[FloatArray, FloatArray]:
        """(m + k,) lower and upper sides of all rows, infinite where there is none."""
        return np.concatenate((self.b, self.l)), np.concatenate((self.b, self.u))

    @cached_property
    def is_resolved(self) -> bool:
        """Whether double precision can meet the strictness of every row."""
        return self.strict is None or bool(self.strict.max() <= MOST_STRICT)

    @cached_property
    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of every variable: the tighter of the imposed and the implied."""
        return self.box_within_bounds(self.box)

    @property
    def whole_reach(self) -> tuple[FloatArray, FloatArray]:
        """`reach` without the cut of the implied bounds at `FARTHEST`."""
        return self.reach if self.whole_box is None else self.box_within_bounds(self.whole_box)

    def box_within_bounds(self, box: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the intersection of a (2, n) box with the imposed bounds."""
        return np.maximum(box[0], self.lb), np.minimum(box[1], self.ub)

    @cached_property
    def cutoff(self) -> float:
        """The program is infeasible if a proven bound exceeds this: at most `highest`."""
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

        The violation of a row is multiplied by its strictness.
        """
        (low, high), rows = self.sides, self.row_values(x)
        violation = np.maximum(rows - high, low - rows)
        if self.strict is not None:
            violation *= self.strict
        if self.cone_count:
            flat = len(rows) - 3 * self.cone_count
            inside = (rows[flat:] - low[flat:]).reshape(-1, 3)
            violation = np.concatenate(
                (violation[:flat], _tangential_lengths(inside) - inside[:, 0])
            )
        outside = np.maximum(x - self.ub, self.lb - x)
        return float(np.maximum.reduce(outside, initial=np.maximum.reduce(violation, initial=0.0)))

    def dual_bound(self, y: FloatArray, z: FloatArray, *, whole: bool = False) -> float:
        """Return the lower bound on the optimum that the multipliers prove, for any multipliers.

        The Lagrangian is minimised exactly over the bounds, imposed and implied, variable by
        variable, so no stationarity needs to hold.

        Args:
            y: (m,) multipliers of A x = b.
            z: (k,) multipliers of the rows of G; positive: the upper side, negative: the lower.
                The negatives of a cone's must be in the cone; else its first entry is changed.
            whole: Whether the bound has to hold for solutions beyond `FARTHEST`, too.
        """
        slope, constant = self._lagrangian_terms(
            self._with_conic_multipliers(np.concatenate((y, z)))
        )
        slope += self.c
        reach = self.whole_reach if whole else self.reach
        return self._minimum_over_bounds(slope, reach, curved=not self.is_linear) + constant

    def assess(self, x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[float, float, float]:
        """Return `dual_bound`, `value` and `residual` of a solution and its multipliers.

        If an entry is not finite: -inf, inf and inf.
        """
        if not all_finite((x, y, z)):
            return -np.inf, np.inf, np.inf
        return self.dual_bound(y, z), self.value(x), self.residual(x)

    def infeasibility_bound(self, y: FloatArray, z: FloatArray, *, strictly: bool = False) -> float:
        """Return a lower bound on the smallest common violation of all rows within the bounds.

        If positive, the multipliers are a Farkas certificate that no feasible point exists.

        Args:
            y: (m,) multipliers of A x = b.
            z: (k,) multipliers of the rows of G, see `dual_bound`.
            strictly: Whether a row's violation is multiplied by its strictness.
        """
        weights = self._with_conic_multipliers(np.concatenate([y, z]))
        sizes = np.abs(weights)
        if strictly and self.strict is not None:
            sizes /= self.strict
        size = float(sizes.sum())
        if not (np.isfinite(size) and size > 0.0):
            return -np.inf
        slope, constant = self._lagrangian_terms(weights / size)
        return self._minimum_over_bounds(slope, self.whole_reach, curved=False) + constant

    def _with_conic_multipliers(self, weights: FloatArray) -> FloatArray:
        """Return multipliers of all rows, with those of cones moved into minus the cone.

        Args:
            weights: (m + k,), changed in place.
        """
        if self.cone_count:
            cones = weights[len(weights) - 3 * self.cone_count :].reshape(-1, 3)
            cones[:, 0] = np.minimum(cones[:, 0], -_tangential_lengths(cones))
        return weights

    def _lagrangian_terms(self, weights: FloatArray) -> tuple[FloatArray, float]:
        """(n,) slope and constant of the Lagrangian's constraint term, which is linear in x.

        The term is up^T (rows x - high) + down^T (low - rows x), with the positive weights in up
        and the sizes of the negative ones in down; a weight on an infinite side counts as 0.
        """
        low, high = self.sides
        side = np.where(weights > 0.0, high, low)
        is_finite = np.isfinite(side)
        weights = np.where(is_finite, weights, 0.0)
        constant = -float(weights.dot(np.where(is_finite, side, 0.0)))
        return self.row_slope(weights), constant

    def _minimum_over_bounds(
        self, slope: FloatArray, reach: tuple[FloatArray, FloatArray], *, curved: bool
    ) -> float:
        """Minimum of 1/2 x^T diag(P) x + slope^T x over bounds.

        Args:
            slope: (n,) the linear term.
            reach: Bounds of every variable.
            curved: Whether to include the quadratic term.
        """
        low, high = reach
        x = np.where(slope >= 0.0, low, high)
        if not curved:
            return float(slope.dot(x))
        is_curved = self.P > 0.0
        stationary = np.where(is_curved, -slope / np.where(is_curved, self.P, 1.0), x)
        x = np.where(is_curved, np.clip(stationary, low, high), x)
        return float((0.5 * self.P * x + slope) @ x)


def _tangential_lengths(triples: FloatArray) -> FloatArray:
    """(q,) lengths of the last two entries of (q, 3) triples."""
    return np.hypot(triples[:, 1], triples[:, 2])
