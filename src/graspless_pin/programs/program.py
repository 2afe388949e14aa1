"""A convex program as plain arrays, and what any answer to it proves."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
        """Return the same program with other bounds; matrices are shared."""
        return replace(self, lb=lb, ub=ub)

    def value(self, x: FloatArray) -> float:
        """Return the objective at x."""
        return float((0.5 * self.P * x + self.c) @ x)

    def residual(self, x: FloatArray) -> float:
        """Return the largest violation of any constraint at x, in scaled units."""
        rows = self.G @ x
        return float(
            max(
                np.abs(self.A @ x - self.b).max(initial=0.0),
                (rows - self.u).max(initial=0.0),
                (self.l - rows).max(initial=0.0),
                (self.lb - x).max(initial=0.0),
                (x - self.ub).max(initial=0.0),
            )
        )

    def dual_bound(self, y: FloatArray, z: FloatArray) -> float:
        """Return a lower bound on the optimum that the multipliers prove, whatever their quality.

        The Lagrangian is minimised exactly over the bounds, imposed and implied, variable by
        variable, so no stationarity needs to hold.

        Args:
            y: (m,) multipliers of A x = b.
            z: (k,) multipliers of the rows of G; positive: the upper side, negative: the lower.
        """
        up = np.where(np.isfinite(self.u), np.maximum(z, 0.0), 0.0)
        down = np.where(np.isfinite(self.l), np.maximum(-z, 0.0), 0.0)
        slope = self.c + y @ self.A + (up - down) @ self.G
        low = np.maximum(self.box[0], self.lb)
        high = np.minimum(self.box[1], self.ub)
        if (low > high).any():
            return np.inf
        curved = self.P > 0.0
        turning = np.where(curved, -slope / np.where(curved, self.P, 1.0), 0.0)
        at = np.where(curved, np.clip(turning, low, high), np.where(slope >= 0.0, low, high))
        smallest = (0.5 * self.P * at + slope) @ at
        upper_side = up @ np.where(np.isfinite(self.u), self.u, 0.0)
        lower_side = down @ np.where(np.isfinite(self.l), self.l, 0.0)
        return float(smallest - y @ self.b - upper_side + lower_side)


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
    low = np.maximum(program.box[0], program.lb)
    high = np.minimum(program.box[1], program.ub)
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
