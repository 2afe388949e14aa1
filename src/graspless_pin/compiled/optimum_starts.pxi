"""Warm starts: what an optimum leaves behind for those of similar problems."""

from libc.string cimport memset

cimport numpy as cnp


cdef class Start:
    """What is active at an optimum, the mode that admits it and a motion behind that mode."""

    cdef Py_ssize_t R, D, S, s, n1, W, p, friction_count
    # The program of the mode, of which rows, and the contacts that its motion was seen with.
    cdef DenseSimplex simplex
    cdef Py_ssize_t rows_count, witnessed
    cdef readonly str solver
    cdef list kept
    cdef cnp.npy_intp* rows
    cdef cnp.npy_intp* starts
    cdef cnp.npy_intp* columns
    cdef cnp.npy_intp* contacts
    cdef cnp.npy_bool* upper
    cdef double* values
    cdef double* gram
    cdef double* weights
    cdef double* x
    cdef double* signs
    cdef double* own_signs
    cdef double* motion
    cdef double* A
    cdef double* w
    cdef double* b
    cdef double* sides
    cdef double* workspace
    cdef double judged[4]

    def __init__(
        self, PaperPrograms programs not None, rows, at_bounds, upper, x, weights, Py_ssize_t count,
        signs, contacts, own_signs, motion, judged_by, str solver="",
    ):
        """Take an optimum of one of the problems that the programs are of.

        Args:
            programs: The programs.
            rows: (r,) the active rows.
            at_bounds: (h,) variables at a bound.
            upper: (r + h,) whether it is the upper side, or bound.
            x: (n + 1,) the point.
            weights: (r + h,) its multipliers.
            count: R, the number of all rows.
            signs: (M, 2) of the mode's sliding.
            contacts: (s,) those that the mode selects.
            own_signs: (2 s,) theirs.
            motion: (6 + L,) scaled.
            judged_by: The last four figures that `witness_of` judges by.
            solver: Which found it.

        Raises:
            ValueError: If the shapes do not fit.
        """
        cdef Py_ssize_t n1 = programs.n + 1, p = count - 6 - programs.s - programs.L, r, h, m, k
        cdef Py_ssize_t i, j, e, total = 0, T = count - programs.L
        cdef cnp.ndarray active = as_integers(rows, len(rows))
        cdef cnp.ndarray bounded = as_integers(at_bounds, len(at_bounds))
        r, h = active.shape[0], bounded.shape[0]
        m = r + h
        cdef cnp.ndarray top = as_flags(upper, m), given = as_vector(weights, m)
        self.kept, self.R, self.s, self.solver = [], count, len(contacts), solver
        self.rows_count = self.witnessed = -1
        self.n1, self.W, self.p = n1, programs.W, p
        if not 0 <= p <= 2 * programs.L:
            raise ValueError("needs rows of these programs")
        self.x = self.real(as_vector(x, n1).copy())
        self.signs = self.real(as_shaped(signs, programs.M, 2).copy())
        self.contacts = self.number(as_integers(contacts, self.s).copy())
        self.own_signs = self.real(as_vector(own_signs, 2 * self.s).copy())
        self.motion = self.real(as_vector(motion, programs.W).copy())
        for k in range(self.s):
            if not 0 <= self.contacts[k] < programs.M:
                raise ValueError("needs contacts that exist")
        for k in range(4):
            self.judged[k] = judged_by[k]
        self.rows = self.number(no_numbers(m + 1))
        self.weights = self.real(empty1(m + 1))
        flags = as_flags([False] * (m + 1), m + 1)
        self.kept.append(flags)
        self.upper = flags_of(flags)
        self.D = self.S = 0
        # Rows that each state changes come first.
        for changes in (True, False):
            for k in range(m):
                i = numbers_of(active)[k] if k < r else count + numbers_of(bounded)[k - r]
                if not 0 <= i < count + n1 or (k < r and i >= count):
                    raise ValueError("needs rows and variables that exist")
                if (i < 6 + p or T <= i < count) != changes:
                    continue
                self.rows[self.D + self.S] = i
                self.weights[self.D + self.S] = data(given)[k]
                self.upper[self.D + self.S] = flags_of(top)[k]
                if changes:
                    self.D += 1
                    continue
                j = i - 6 - p
                total += 1 if i >= count else programs.row_start[j + 1] - programs.row_start[j]
                self.S += 1
        self.starts = self.number(no_numbers(self.S + 1))
        self.columns = self.number(no_numbers(total + 1))
        self.values = self.real(empty1(total + 1))
        self.gram = self.real(empty(n1, n1))
        total = 0
        for k in range(self.S):
            i = self.rows[self.D + k]
            if i >= count:
                self.columns[total], self.values[total] = i - count, 1.0
                total += 1
            else:
                j = i - 6 - p
                for e in range(programs.row_start[j], programs.row_start[j + 1]):
                    self.columns[total] = programs.row_column[e]
                    total += 1
            self.starts[k + 1] = total
        self.fit(programs)
        self.A = self.real(empty1(self.D * n1 + 1))
        self.w, self.b = self.real(empty1(m + 1)), self.real(empty1(m + 1))
        self.sides = self.real(empty1(m + 1))
        self.workspace = self.real(empty1(witness_workspace(self.s, programs.W)))

    cdef void fit(self, PaperPrograms programs) noexcept:
        """Take the cones of the programs that it was made of, whose friction may have changed."""
        cdef Py_ssize_t k, i, j, first
        memset(self.gram, 0, self.n1 * self.n1 * sizeof(double))
        for k in range(self.S):
            i = self.rows[self.D + k]
            if i < self.R:
                first = programs.row_start[i - 6 - self.p] - self.starts[k]
                for j in range(self.starts[k], self.starts[k + 1]):
                    self.values[j] = programs.row_value[first + j]
            for i in range(self.starts[k], self.starts[k + 1]):
                for j in range(self.starts[k], i + 1):
                    # Columns of a row rise.
                    self.gram[self.n1 * self.columns[i] + self.columns[j]] += (
                        self.values[i] * self.values[j]
                    )
        self.friction_count = programs.friction_count

    cdef double* real(self, cnp.ndarray array):
        self.kept.append(array)
        return data(array)

    cdef cnp.npy_intp* number(self, cnp.ndarray array):
        self.kept.append(array)
        return numbers_of(array)
