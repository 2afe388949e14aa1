# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Optima of Algorithms 1 and 2 of which nothing is known yet: by interior points, then proven."""

from libc.math cimport fabs, isfinite
from libc.string cimport memcpy, memset

cimport numpy as cnp

from graspless_pin.compiled.carried_optima cimport Carrier
from graspless_pin.compiled.contact_frames cimport map_of
from graspless_pin.compiled.optimum_starts cimport Start
from graspless_pin.compiled.paper_programs cimport MARGIN
from graspless_pin.compiled.shared cimport data, empty1, factor, inner, solve_factored
from graspless_pin.compiled.virtual_motions cimport scaled_of

import numpy as np

from graspless_pin.compiled import virtual_motions

cnp.import_array()

cdef int _MOST_STEPS = 40
cdef double _CLOSE = 1e-13  # slacks times multipliers, scaled: active rows can be told apart
cdef double _BACK = 0.995  # share of the way to the nearest side
cdef double _RUBS = 1e-6  # friction over the load: the check shows whether less was none
cdef double _RIDGE = 1e-14


cdef class ColdCarrier(Carrier):
    """A carrier that finds optima by itself, too."""

    cdef int guesses
    cdef tuple judged_by
    cdef double* rows
    cdef double* ends
    cdef double* slack
    cdef double* z
    cdef double* ds
    cdef double* dz
    cdef double* apart
    cdef double* target
    cdef double* at
    cdef double* y
    cdef double* dy
    cdef double* dx
    cdef double* q
    cdef double* H
    cdef double* back
    cdef double* schur

    def __init__(self, int guesses, judged_by, **shared):
        """Take what the problems share.

        Args:
            guesses: How many motions are tried behind the friction of an optimum.
            judged_by: What `virtual_motions.witness` judges by.
            shared: See `Carrier`.
        """
        Carrier.__init__(self, **shared)
        cdef Py_ssize_t n1 = self.n + 1, N = 6 + 3 * self.L + self.s + n1
        self.guesses, self.judged_by = guesses, judged_by
        self.rows = self.room((6 + 3 * self.L) * n1)
        self.ends, self.slack, self.z = self.room(2 * N), self.room(2 * N), self.room(2 * N)
        self.ds, self.dz = self.room(2 * N), self.room(2 * N)
        self.apart, self.target = self.room(2 * N), self.room(2 * N)
        self.at, self.y, self.dy, self.dx = self.room(N), self.room(6), self.room(6), self.room(n1)
        self.q, self.H = self.room(n1), self.room(n1 * n1)
        self.back, self.schur = self.room(6 * n1), self.room(36)

    cdef void levels_at(self, const double* x, double* level) noexcept:
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

    cdef void add_rows(self, const double* w, double* slope) noexcept:
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

    cdef bint weighed(self) noexcept:
        """Factor the weighed products of all rows with inequalities, and those with the balance."""
        cdef Py_ssize_t n1 = self.n + 1, D = 6 + self.p, i, j, k, e, f
        cdef double* H = self.H
        cdef const double* row
        cdef double d, trace = 0.0
        memset(H, 0, n1 * n1 * sizeof(double))
        for i in range(6, D + self.L):
            k, row = (i if i < D else self.T + i - D), self.rows + n1 * i
            d = self.z[2 * k] / self.slack[2 * k] + self.z[2 * k + 1] / self.slack[2 * k + 1]
            for j in range(n1):
                if row[j] != 0.0:
                    for e in range(j + 1):
                        H[n1 * j + e] += d * row[j] * row[e]
        for i in range(self.s):
            k = D + i
            d = self.z[2 * k] / self.slack[2 * k] + self.z[2 * k + 1] / self.slack[2 * k + 1]
            for e in range(self.row_start[i], self.row_start[i + 1]):
                for f in range(self.row_start[i], e + 1):
                    # Columns of a row rise.
                    H[n1 * self.row_column[e] + self.row_column[f]] += (
                        d * self.row_value[e] * self.row_value[f]
                    )
        for j in range(n1):
            k = self.R + j
            H[n1 * j + j] += self.z[2 * k] / self.slack[2 * k]
            H[n1 * j + j] += self.z[2 * k + 1] / self.slack[2 * k + 1]
            trace += H[n1 * j + j]
        for j in range(n1):
            H[n1 * j + j] += _RIDGE * trace
        if not factor(H, n1):
            return False
        trace = 0.0
        for i in range(6):
            memcpy(self.back + n1 * i, self.rows + n1 * i, n1 * sizeof(double))
            solve_factored(H, n1, self.back + n1 * i)
        for i in range(6):
            for j in range(i + 1):
                self.schur[6 * i + j] = inner(self.rows + n1 * i, self.back + n1 * j, n1)
            trace += self.schur[7 * i]
        for i in range(6):
            self.schur[7 * i] += _RIDGE * trace
        return factor(self.schur, 6)

    cdef void step(self) noexcept:
        """Find the step to the targets of slacks times multipliers."""
        cdef Py_ssize_t n1 = self.n + 1, N = self.R + n1, i, j, k
        cdef double* w = self.at
        memset(w, 0, 6 * sizeof(double))
        for i in range(6, N):
            w[i] = 0.0
            for k in range(2 * i, 2 * i + 2):
                if isfinite(self.ends[k]):
                    w[i] += (1.0 if k == 2 * i else -1.0) * (
                        (self.target[k] + self.z[k] * self.apart[k]) / self.slack[k]
                    )
        memset(self.dx, 0, n1 * sizeof(double))
        self.add_rows(w, self.dx)
        for j in range(n1):
            self.dx[j] = -self.q[j] - self.dx[j]
        solve_factored(self.H, n1, self.dx)
        for i in range(6):
            self.dy[i] = inner(self.rows + n1 * i, self.dx, n1) + self.apart[2 * i]
        solve_factored(self.schur, 6, self.dy)
        for i in range(6):
            for j in range(n1):
                self.dx[j] -= self.dy[i] * self.back[n1 * i + j]
        self.levels_at(self.dx, self.at)
        for i in range(6, N):
            for k in range(2 * i, 2 * i + 2):
                if isfinite(self.ends[k]):
                    self.ds[k] = -self.apart[k] - (self.at[i] if k == 2 * i else -self.at[i])
                    self.dz[k] = (self.target[k] - self.z[k] * self.ds[k]) / self.slack[k]

    cdef double reached(self, const double* values, const double* steps) noexcept:
        """The share of a step that keeps values positive."""
        cdef Py_ssize_t k
        cdef double share = 1.0
        for k in range(12, 2 * (self.R + self.n + 1)):
            if isfinite(self.ends[k]) and steps[k] < 0.0:
                share = min(share, -_BACK * values[k] / steps[k])
        return share

    cdef bint solved(self) noexcept:
        """Find an optimum by interior points."""
        cdef Py_ssize_t n1 = self.n + 1, N = self.R + n1, W = self.W, D = 6 + self.p, c, i, j, k
        cdef Py_ssize_t count = 0, _
        cdef double factor_of, primal, dual, mean, aimed, far, near, total
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
        memset(self.x, 0, n1 * sizeof(double))
        memset(self.y, 0, 6 * sizeof(double))
        self.x[n1 - 1] = -1.0 if self.kind == MARGIN else 1.0
        self.levels_at(self.x, self.at)
        for i in range(N):
            for k in range(2 * i, 2 * i + 2):
                self.ends[k] = self.side(i, k == 2 * i)
                self.slack[k], self.z[k] = 1.0, 0.0
                if i >= 6 and isfinite(self.ends[k]):
                    far = self.ends[k] - self.at[i] if k == 2 * i else self.at[i] - self.ends[k]
                    self.slack[k] = max(far, 1.0)
                    self.z[k] = 1.0 / self.slack[k]
                    count += 1
        for _ in range(_MOST_STEPS):
            self.levels_at(self.x, self.at)
            primal, dual, mean = 0.0, 0.0, 0.0
            for i in range(N):
                for k in range(2 * i, 2 * i + 2):
                    if not isfinite(self.ends[k]):
                        continue
                    self.apart[k] = self.at[i] - self.ends[k]
                    if i >= 6:
                        if k > 2 * i:
                            self.apart[k] = -self.apart[k]
                        self.apart[k] += self.slack[k]
                        mean += self.slack[k] * self.z[k]
                        self.target[k] = -self.slack[k] * self.z[k]
                    primal = max(primal, fabs(self.apart[k]))
                self.at[i] = self.y[i] if i < 6 else self.z[2 * i] - self.z[2 * i + 1]
            mean /= max(count, 1)
            memset(self.q, 0, n1 * sizeof(double))
            self.q[n1 - 1] = -1.0 if self.kind == MARGIN else 1.0
            self.add_rows(self.at, self.q)
            for j in range(n1):
                dual = max(dual, fabs(self.q[j]))
            total = primal + dual + mean
            if not isfinite(total):
                return False
            if mean <= _CLOSE and primal <= 1e-8 and dual <= 1e-8:
                return True
            if not self.weighed():
                return False
            self.step()
            far, near = self.reached(self.slack, self.ds), self.reached(self.z, self.dz)
            aimed = 0.0
            for k in range(12, 2 * N):
                if isfinite(self.ends[k]):
                    aimed += (self.slack[k] + far * self.ds[k]) * (self.z[k] + near * self.dz[k])
            aimed = (aimed / max(count, 1) / mean) ** 3 * mean
            for k in range(12, 2 * N):
                if isfinite(self.ends[k]):
                    self.target[k] += aimed - self.ds[k] * self.dz[k]
            self.step()
            far, near = self.reached(self.slack, self.ds), self.reached(self.z, self.dz)
            for j in range(n1):
                self.x[j] += far * self.dx[j]
            for i in range(6):
                self.y[i] += near * self.dy[i]
            for k in range(12, 2 * N):
                if isfinite(self.ends[k]):
                    self.slack[k] += far * self.ds[k]
                    self.z[k] += near * self.dz[k]
        return False

    cdef Start begun(self):
        """What an optimum found by interior points leaves behind; None: there is none.

        Its mode is read from the friction, and the motion guessed, as a search does first.
        """
        cdef Py_ssize_t n1 = self.n + 1, W = self.W, i, c, k
        cdef double sign
        if not self.solved():
            return None
        x = _copied(self.x, n1)
        rows, upper, weights = list(range(6)), [True] * 6, [self.y[i] for i in range(6)]
        for i in range(6, self.R + n1):
            for k in range(2 * i, 2 * i + 2):
                if isfinite(self.ends[k]) and self.z[k] > self.slack[k]:
                    rows.append(i)
                    upper.append(k == 2 * i)
                    weights.append(self.z[k] if k == 2 * i else -self.z[k])
        signs = np.zeros((self.M, 2))
        for c in range(self.n):
            if self.axes[c] % 3 and fabs(self.x[c]) > _RUBS:
                sign = -1.0 if self.x[c] > 0.0 else 1.0
                signs[self.axes[c] // 3, self.axes[c] % 3 - 1] = sign
        contacts = np.flatnonzero(signs.any(axis=1))
        wanted, motion = signs[contacts].ravel(), np.zeros(W)
        map_of(self.M, self.L, self.points, self.normals, self.tangents, self.J, self.map)
        scaled_of(3 * self.M, W, self.map, self.scale, self.scaled)
        if len(contacts):
            seen = virtual_motions.witness(
                _blocks(self.scaled, self.M, W), contacts, wanted, None, self.guesses,
                *self.judged_by,
            )
            if seen is None:
                return None
            wanted, motion = seen
            signs[contacts] = wanted.reshape(-1, 2)
        count = sum(i < self.R for i in rows)
        bounds = [i - self.R for i in rows[count:]]
        return Start(
            self, rows[:count], bounds, upper, x, np.array(weights), self.R, signs, contacts,
            wanted, motion, self.judged_by,
        )


cdef cnp.ndarray _copied(const double* values, Py_ssize_t count):
    cdef cnp.ndarray array = empty1(count)
    memcpy(data(array), values, count * sizeof(double))
    return array


cdef cnp.ndarray _blocks(const double* values, Py_ssize_t count, Py_ssize_t columns):
    return _copied(values, 3 * count * columns).reshape(count, 3, columns)
