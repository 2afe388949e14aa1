"""A convex program as plain arrays, and what any answer to it proves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from graspless_pin.problem.checks import FloatArray


@dataclass(frozen=True, eq=False)
class Program:
    """Minimise 1/2 x^T diag(P) x + c^T x subject to A x = b, l <= G x <= u, lb <= x <= ub.

    Every variable is scaled to order one and has finite bounds that any feasible point obeys, so
    that a dual vector of whatever quality still proves a bound.

    Attributes:
        P: (n,) diagonal of the quadratic term, >= 0.
        c: (n,) linear term.
        A: (m, n) equality rows.
        b: (m,) right-hand side.
        G: (k, n) inequality rows.
        l: (k,) lower sides, -inf where there is none.
        u: (k,) upper sides, inf where there is none.
        lb: (n,) lower bounds to be imposed, -inf where there is none.
        ub: (n,) upper bounds to be imposed, inf where there is none.
        box: (2, n) finite bounds that are implied by the constraints: for proofs, not imposed.
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

    def bounded(self, lb: FloatArray, ub: FloatArray) -> Program:
        """Return the same program with other bounds; matrices and what is known of them shared."""
        if "worst" not in self.__dict__:
            _ = self.hessian, self.is_linear, self.sides, self.worst
        program = object.__new__(Program)
        program.__dict__.update(self.__dict__, lb=lb, ub=ub)
        program.__dict__.pop("reach", None)
        return program

    @cached_property
    def hessian(self) -> FloatArray:
        """(n, n) diag(P)."""
        return np.asfortranarray(np.diag(self.P))

    @cached_property
    def is_linear(self) -> bool:
        """Whether P is zero."""
        return not self.P.any()

    @cached_property
    def sides(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """(has upper, upper or 0, has lower, lower or 0) of the rows of G, all (k,)."""
        up, down = np.isfinite(self.u), np.isfinite(self.l)
        return (
            up.astype(np.float64),
            np.where(up, self.u, 0.0),
            down.astype(np.float64),
            np.where(down, self.l, 0.0),
        )

    @cached_property
    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of every variable, imposed and implied."""
        return np.maximum(self.box[0], self.lb), np.minimum(self.box[1], self.ub)

    @cached_property
    def worst(self) -> float:
        """The largest objective value inside the box: no bound of a feasible program exceeds it."""
        reach = np.where(self.c >= 0.0, self.box[1], self.box[0])
        return float(self.c @ reach + 0.5 * self.P @ np.abs(self.box).max(axis=0) ** 2)

    def value(self, x: FloatArray) -> float:
        """Return the objective at x."""
        return float((0.5 * self.P * x + self.c) @ x)

    def residual(self, x: FloatArray) -> float:
        """Return the largest violation of any constraint at x, in scaled units."""
        rows = self.G @ x
        worst = max((self.lb - x).max(), (x - self.ub).max(), 0.0)
        if len(rows):
            worst = max(worst, (rows - self.u).max(), (self.l - rows).max())
        if len(self.b):
            balance = self.A @ x - self.b
            worst = max(worst, balance.max(), -balance.min())
        return float(worst)

    def dual_bound(self, y: FloatArray, z: FloatArray) -> float:
        """Return a lower bound on the optimum that the multipliers prove, whatever their quality.

        The Lagrangian is minimised exactly over the bounds, imposed and implied, variable by
        variable, so no stationarity needs to hold.

        Args:
            y: (m,) multipliers of A x = b.
            z: (k,) multipliers of the rows of G; positive: the upper side, negative: the lower.
        """
        slope, constant = self._lagrangian(y, z)
        return self._smallest(self.c + slope, self.P, linear=self.is_linear) + constant

    def infeasibility_bound(self, y: FloatArray, z: FloatArray) -> float:
        """Return a lower bound on the smallest common violation of all rows within the bounds.

        Positive: the multipliers are a Farkas certificate that no feasible point exists.
        """
        size = float(np.abs(y).sum() + np.abs(z).sum())
        if not (np.isfinite(size) and size > 0.0):
            return -np.inf
        slope, constant = self._lagrangian(y / size, z / size)
        return self._smallest(slope, self.P, linear=True) + constant

    def _lagrangian(self, y: FloatArray, z: FloatArray) -> tuple[FloatArray, float]:
        """Slope and constant of y^T (A x - b) + up^T (G x - u) + down^T (l - G x)."""
        has_upper, upper, has_lower, lower = self.sides
        up = np.maximum(z, 0.0) * has_upper
        down = np.maximum(-z, 0.0) * has_lower
        slope = y @ self.A + (up - down) @ self.G
        return slope, float(down @ lower - up @ upper - y @ self.b)

    def _smallest(self, slope: FloatArray, curvature: FloatArray, *, linear: bool) -> float:
        """Smallest value of 1/2 x^T diag(P) x + slope^T x over the bounds, imposed and implied."""
        low, high = self.reach
        at = np.where(slope >= 0.0, low, high)
        if linear:
            return float(slope @ at)
        curved = curvature > 0.0
        turning = np.where(curved, -slope / np.where(curved, curvature, 1.0), at)
        at = np.where(curved, np.clip(turning, low, high), at)
        return float((0.5 * curvature * at + slope) @ at)


def elastic(program: Program) -> Program:
    """Return the program that finds the smallest common violation of all rows.

    One variable s >= 0 is added: -s <= A x - b <= s, l - s <= G x <= u + s, bounds kept, s
    minimised. It always has a solution; a positive proven bound on s proves that the original
    program has none.
    """
    m, n = program.A.shape
    k = len(program.G)
    one = np.ones((m, 1))
    finite_u, finite_l = np.isfinite(program.u), np.isfinite(program.l)
    rows = np.vstack(
        [
            np.hstack([program.A, -one]),
            np.hstack([-program.A, -one]),
            np.hstack([program.G, -np.ones((k, 1))])[finite_u],
            np.hstack([-program.G, -np.ones((k, 1))])[finite_l],
        ]
    )
    sides = np.concatenate([program.b, -program.b, program.u[finite_u], -program.l[finite_l]])
    low, high = program.reach
    reach = np.maximum(np.abs(low), np.abs(high))
    worst = float((np.abs(rows[:, :n]) @ reach + np.abs(sides)).max(initial=0.0)) + 1.0
    return Program(
        P=np.zeros(n + 1),
        c=np.append(np.zeros(n), 1.0),
        A=np.zeros((0, n + 1)),
        b=np.zeros(0),
        G=rows,
        l=np.full(len(rows), -np.inf),
        u=sides,
        lb=np.append(low, 0.0),
        ub=np.append(high, worst),
        box=np.vstack([np.append(low, 0.0), np.append(high, worst)]),
    )
