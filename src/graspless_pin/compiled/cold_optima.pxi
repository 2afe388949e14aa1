"""Optima of Algorithms 1 and 2 of which nothing is known, found by interior points, then proven.

Mehrotra's predictor-corrector method (SIAM J. Optim. 2(4), 1992) on the dense program: a step
towards complementarity products of zero tells how far they can be taken; a second step corrects it.
"""

from libc.math cimport fabs, isfinite
from libc.string cimport memcpy, memset

cimport numpy as cnp


import numpy as np


cdef int _MOST_STEPS = 40
cdef double _COMPLEMENTARY = 1e-13  # mean of slacks times multipliers, scaled: strict by then
cdef double _TO_BOUNDARY = 0.995  # share of the step to the nearest bound
cdef double _FRICTION = 1e-6  # over the load: the check shows whether less was none
cdef double _RIDGE = 1e-14


cdef class ColdOptima(WarmOptima):
    """Optima without a warm start, too."""

    cdef int guesses
    cdef tuple judged_by
    cdef Py_ssize_t count
    cdef cnp.npy_intp* one_sided
    cdef cnp.npy_intp* chosen
    cdef double* required
    cdef double* slide
    cdef double* guessed
    cdef double* rows
    cdef double* side_bounds
    cdef double* slack
    cdef double* z
    cdef double* ds
    cdef double* dz
    cdef double* primal_residual
    cdef double* target
    cdef double* at
    cdef double* y
    cdef double* dy
    cdef double* dx
    cdef double* q
    cdef double* H
    cdef double* solved_balance
    cdef double* schur

    def __init__(self, int guesses, judged_by, **shared):
        """Take what the problems share.

        Args:
            guesses: How many motions are tried behind the friction of an optimum.
            judged_by: The last four figures that `witness_of` judges by.
            shared: See `WarmOptima`.
        """
        WarmOptima.__init__(self, **shared)
        cdef Py_ssize_t n1 = self.n + 1, N = 6 + 3 * self.L + self.s + n1
        self.guesses, self.judged_by = guesses, judged_by
        self.rows = self.workspace((6 + 3 * self.L) * n1)
        self.slack, self.z = self.workspace(2 * N), self.workspace(2 * N)
        self.side_bounds = self.workspace(2 * N)
        self.ds, self.dz = self.workspace(2 * N), self.workspace(2 * N)
        self.primal_residual, self.target = self.workspace(2 * N), self.workspace(2 * N)
        self.at, self.dx = self.workspace(N), self.workspace(n1)
        self.y, self.dy = self.workspace(6), self.workspace(6)
        self.q, self.H = self.workspace(n1), self.workspace(n1 * n1)
        self.solved_balance, self.schur = self.workspace(6 * n1), self.workspace(36)
        # Sides that there are, two to a row, the upper one first; slacks and multipliers likewise.
        self.count, self.one_sided = 0, self.numbers(no_numbers(2 * N))
        self.chosen, self.required = self.numbers(no_numbers(self.M)), self.workspace(2 * self.M)
        self.slide = self.workspace(2 * self.M)
        self.guessed = self.workspace(witness_workspace(self.M, self.W))

    cdef void row_values_at(self, const double* x, double* level) noexcept:
        """Put the values of all rows, and after them the variables, into a place."""
        cdef Py_ssize_t n1 = self.n + 1, D = 6 + self.p, i, k, e
        for i in range(D):
            level[i] = inner(self.rows + n1 * i, x, n1)
        for i in range(self.s):
            level[D + i] = 0.0
            for e in range(self.row_start[i], self.row_start[i + 1]):
                level[D + i] += self.row_value[e] * x[self.row_column[e]]
        for k in range(self.L):
            level[self.T + k] = inner(self.rows + n1 * (D + k), x, n1)
        memcpy(level + self.R, x, n1 * sizeof(double))

    cdef void add_weighted_rows(self, const double* w, double* slope) noexcept:
        """Add rows, and after them the variables, times weights to a slope."""
        cdef Py_ssize_t n1 = self.n + 1, D = 6 + self.p, i, j, k, e
        for i in range(D + self.L):
            k = i if i < D else self.T + i - D
            if w[k] != 0.0:
                for j in range(n1):
                    slope[j] += w[k] * self.rows[n1 * i + j]
        for i in range(self.s):
            for e in range(self.row_start[i], self.row_start[i + 1]):
                slope[self.row_column[e]] += w[D + i] * self.row_value[e]
        for j in range(n1):
            slope[j] += w[self.R + j]

    cdef bint factor_normal_equations(self) noexcept:
        """Factor the normal equations, A^T (Z/S) A, and the Schur complement of the balance."""
        cdef Py_ssize_t n1 = self.n + 1, D = 6 + self.p, i, j, k, e, f
        cdef double* H = self.H
        cdef const double* row
        cdef double d, trace = 0.0
        memset(H, 0, n1 * n1 * sizeof(double))
        memset(self.at, 0, (self.R + n1) * sizeof(double))
        for i in range(self.count):
            k = self.one_sided[i]
            self.at[k // 2] += self.z[k] / self.slack[k]
        for i in range(6, D + self.L):
            d, row = self.at[i if i < D else self.T + i - D], self.rows + n1 * i
            for j in range(n1):
                if row[j] != 0.0:
                    for e in range(j + 1):
                        H[n1 * j + e] += d * row[j] * row[e]
        for i in range(self.s):
            d = self.at[D + i]
            for e in range(self.row_start[i], self.row_start[i + 1]):
                for f in range(self.row_start[i], e + 1):
                    # Columns of a row rise.
                    H[n1 * self.row_column[e] + self.row_column[f]] += (
                        d * self.row_value[e] * self.row_value[f]
                    )
        for j in range(n1):
            H[n1 * j + j] += self.at[self.R + j]
            trace += H[n1 * j + j]
        for j in range(n1):
            H[n1 * j + j] += _RIDGE * trace
        if not factor(H, n1):
            return False
        trace = 0.0
        for i in range(6):
            memcpy(self.solved_balance + n1 * i, self.rows + n1 * i, n1 * sizeof(double))
            solve_factored(H, n1, self.solved_balance + n1 * i)
        for i in range(6):
            for j in range(i + 1):
                self.schur[6 * i + j] = inner(self.rows + n1 * i, self.solved_balance + n1 * j, n1)
            trace += self.schur[7 * i]
        for i in range(6):
            self.schur[7 * i] += _RIDGE * trace
        return factor(self.schur, 6)

    cdef void step(self) noexcept:
        """Solve the KKT system for the step to the targets of slacks times multipliers."""
        cdef Py_ssize_t n1 = self.n + 1, N = self.R + n1, i, j, k
        cdef double d
        cdef double* w = self.at
        memset(w, 0, N * sizeof(double))
        for i in range(self.count):
            k = self.one_sided[i]
            d = (self.target[k] + self.z[k] * self.primal_residual[k]) / self.slack[k]
            w[k // 2] += -d if k % 2 else d
        memset(self.dx, 0, n1 * sizeof(double))
        self.add_weighted_rows(w, self.dx)
        for j in range(n1):
            self.dx[j] = -self.q[j] - self.dx[j]
        solve_factored(self.H, n1, self.dx)
        for i in range(6):
            self.dy[i] = inner(self.rows + n1 * i, self.dx, n1) + self.primal_residual[2 * i]
        solve_factored(self.schur, 6, self.dy)
        for i in range(6):
            for j in range(n1):
                self.dx[j] -= self.dy[i] * self.solved_balance[n1 * i + j]
        self.row_values_at(self.dx, self.at)
        for i in range(self.count):
            k = self.one_sided[i]
            d = self.at[k // 2]
            self.ds[k] = (d if k % 2 else -d) - self.primal_residual[k]
            self.dz[k] = (self.target[k] - self.z[k] * self.ds[k]) / self.slack[k]

    cdef double step_length(self, const double* values, const double* steps) noexcept:
        """Ratio test: the share of a step that keeps values positive."""
        cdef Py_ssize_t i, k
        cdef double share = 1.0
        for i in range(self.count):
            k = self.one_sided[i]
            if share * steps[k] < -_TO_BOUNDARY * values[k]:
                share = -_TO_BOUNDARY * values[k] / steps[k]
        return share

    cdef void write_rows(self) noexcept:
        """Put the rows that a state may change into a place: balance, largest torque, torques."""
        cdef Py_ssize_t n1 = self.n + 1, W = self.W, D = 6 + self.p, c, i, j
        cdef double factor_of
        memset(self.rows, 0, (D + self.L) * n1 * sizeof(double))
        for i in range(D + self.L):
            j, factor_of = i, 1.0
            if i >= D:
                j = 6 + i - D
            elif i >= 6:
                j, factor_of = 6 + self.joint[i - 6] % self.L, self.share[i - 6]
                self.rows[n1 * i + n1 - 1] = -self.level[i - 6]
            for c in range(n1 - 1):
                self.rows[n1 * i + c] = factor_of * self.B[W * c + j]

    cdef bint solved(self) noexcept:
        """Find an optimum by the predictor-corrector method; whether it converged.

        mu is the mean complementarity product, sigma its share that the corrector aims at.
        """
        cdef Py_ssize_t n1 = self.n + 1, N = self.R + n1, i, j, k, _
        cdef double primal, dual, mu, center, gap, primal_step, dual_step, total
        self.write_rows()
        memset(self.x, 0, n1 * sizeof(double))
        memset(self.y, 0, 6 * sizeof(double))
        self.x[n1 - 1] = -1.0 if self.kind == MARGIN else 1.0
        self.row_values_at(self.x, self.at)
        self.count = 0
        for i in range(N):
            for k in range(2 * i, 2 * i + 2):
                self.side_bounds[k] = self.side(i, k == 2 * i)
                if i >= 6 and isfinite(self.side_bounds[k]):
                    gap = self.side_bounds[k] - self.at[i]
                    if k % 2:
                        gap = -gap
                    self.slack[k] = max(gap, 1.0)
                    self.z[k] = 1.0 / self.slack[k]
                    self.one_sided[self.count] = k
                    self.count += 1
        for _ in range(_MOST_STEPS):
            self.row_values_at(self.x, self.at)
            primal, dual, mu = 0.0, 0.0, 0.0
            memset(self.primal_residual, 0, 12 * sizeof(double))
            for i in range(6):
                self.primal_residual[2 * i] = self.at[i] - self.side_bounds[2 * i]
                primal = max(primal, fabs(self.primal_residual[2 * i]))
                self.at[i] = self.y[i]
            for i in range(self.count):
                k = self.one_sided[i]
                gap = self.at[k // 2] - self.side_bounds[k]
                self.primal_residual[k] = (-gap if k % 2 else gap) + self.slack[k]
                self.target[k] = -self.slack[k] * self.z[k]
                mu -= self.target[k]
                primal = max(primal, fabs(self.primal_residual[k]))
            memset(self.at + 6, 0, (N - 6) * sizeof(double))
            for i in range(self.count):
                k = self.one_sided[i]
                self.at[k // 2] += -self.z[k] if k % 2 else self.z[k]
            mu /= max(self.count, 1)
            memset(self.q, 0, n1 * sizeof(double))
            self.q[n1 - 1] = -1.0 if self.kind == MARGIN else 1.0
            self.add_weighted_rows(self.at, self.q)
            for j in range(n1):
                dual = max(dual, fabs(self.q[j]))
            total = primal + dual + mu
            if not isfinite(total):
                return False
            if mu <= _COMPLEMENTARY:
                # The proof tells whether that will do; further steps only lose digits.
                return primal <= 1e-6 and dual <= 1e-6
            if not self.factor_normal_equations():
                return False
            # Predictor: the affine step towards products of zero.
            self.step()
            primal_step = self.step_length(self.slack, self.ds)
            dual_step = self.step_length(self.z, self.dz)
            center = 0.0
            for i in range(self.count):
                k = self.one_sided[i]
                center += (self.slack[k] + primal_step * self.ds[k]) * (
                    self.z[k] + dual_step * self.dz[k]
                )
            # Corrector: products of sigma mu, less what the predictor's second order adds.
            center = (center / max(self.count, 1) / mu) ** 3 * mu
            for i in range(self.count):
                k = self.one_sided[i]
                self.target[k] += center - self.ds[k] * self.dz[k]
            self.step()
            primal_step = self.step_length(self.slack, self.ds)
            dual_step = self.step_length(self.z, self.dz)
            for j in range(n1):
                self.x[j] += primal_step * self.dx[j]
            for i in range(6):
                self.y[i] += dual_step * self.dy[i]
            for i in range(self.count):
                k = self.one_sided[i]
                self.slack[k] += primal_step * self.ds[k]
                self.z[k] += dual_step * self.dz[k]
        return False

    cdef Start begun(self):
        """What an optimum found by interior points leaves behind; None: there is none.

        See `read`.
        """
        return self.read() if self.solved() else None

    cdef Start read(self):
        """What the optimum that was just found leaves behind; None: no motion is behind it.

        Its mode is read from the friction, and the motion guessed, as a search does first.
        """
        cdef Py_ssize_t n1 = self.n + 1, M = self.M, W = self.W, s = 0, i, c, k
        cdef double* pair
        cdef cnp.ndarray signs = empty(M, 2)
        memset(data(signs), 0, 2 * M * sizeof(double))
        for c in range(self.n):
            if self.axes[c] % 3 and fabs(self.x[c]) > _FRICTION:
                data(signs)[2 * (self.axes[c] // 3) + self.axes[c] % 3 - 1] = (
                    -1.0 if self.x[c] > 0.0 else 1.0
                )
        for i in range(M):
            pair = data(signs) + 2 * i
            if pair[0] != 0.0 or pair[1] != 0.0:
                self.chosen[s] = i
                memcpy(self.required + 2 * s, pair, 2 * sizeof(double))
                s += 1
        map_of(M, self.L, self.points, self.normals, self.tangents, self.J, self.map)
        scaled_of(3 * M, W, self.map, self.scale, self.scaled)
        memset(self.motion, 0, W * sizeof(double))
        damping, corrections, rank_tolerance, least = self.judged_by
        if s and not witness_of(
            M, W, self.scaled, s, self.chosen, self.required, NULL, self.guesses, damping,
            corrections, rank_tolerance, least, self.guessed, self.slide, self.motion,
        ):
            return None
        for i in range(s):
            memcpy(data(signs) + 2 * self.chosen[i], self.slide + 2 * i, 2 * sizeof(double))
        rows, bounds, upper, weights = list(range(6)), [], [True] * 6, _copied(self.y, 6).tolist()
        for i in range(self.count):
            k = self.one_sided[i]
            if self.z[k] > self.slack[k]:
                if k // 2 < self.R:
                    rows.append(k // 2)
                else:
                    bounds.append(k // 2 - self.R)
                upper.append(k % 2 == 0)
                weights.append(-self.z[k] if k % 2 else self.z[k])
        return Start(
            self, rows, bounds, upper, _copied(self.x, n1), np.array(weights), self.R, signs,
            [self.chosen[i] for i in range(s)], _copied(self.slide, 2 * s),
            _copied(self.motion, W), self.judged_by,
        )
