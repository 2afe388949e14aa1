"""Dense linear programs as dictionaries: rows in terms of the variables that are at their bounds.

A pivot goes over all of a dictionary, which for some hundred rows and some dozen variables takes a
few microseconds.
"""

cdef inline bint is_pivot(double entry) noexcept nogil:
    """Whether an entry of a table is large enough for a pivot."""
    return fabs(entry) > 1e-9


cdef class Dictionary:
    """The program min c.x over lb <= x <= ub and low <= R x <= high, and where its solution stands.

    Variables are numbered: the n of the program first, then the rows' own values.
    """

    cdef Py_ssize_t n, m, capacity
    cdef double* rows  # (m, n) R
    cdef double* table  # (m, n) basic variables in terms of the others
    cdef double* cost  # (n,) c
    cdef double* slopes  # (n,) what the cost rises with each variable that is not basic
    cdef double* tilted  # (n,) the same, tilted and shifted to be feasible
    cdef double* left  # (2, n) of the cost after the slopes, and that in terms of the table
    cdef double* lower  # (n + m,)
    cdef double* upper  # (n + m,)
    cdef double* value  # (n + m,)
    cdef Py_ssize_t* basic  # (m,) the variable of each row of the table
    cdef Py_ssize_t* others  # (n,) that of each column
    cdef Py_ssize_t* place  # (n + m,) row of a basic variable; -1 - column of another
    cdef int pivots

    def __cinit__(self, cost, lb, ub):
        cdef Py_ssize_t j
        cdef cnp.ndarray c = as_vector(cost, len(cost))
        self.n, self.m, self.capacity, self.pivots = c.shape[0], 0, 0, 0
        self.cost = <double*>malloc(5 * self.n * sizeof(double))
        self.others = <Py_ssize_t*>malloc(self.n * sizeof(Py_ssize_t))
        if self.cost == NULL or self.others == NULL:
            raise MemoryError
        self.slopes, self.tilted = self.cost + self.n, self.cost + 2 * self.n
        self.left = self.cost + 3 * self.n
        self._make_room(64)
        memset(self.value, 0, self.n * sizeof(double))
        for j in range(self.n):
            self.others[j], self.place[j] = j, -1 - j
        self.set_bounds(lb, ub)
        self.set_cost(c)

    def __dealloc__(self):
        free(self.rows)
        free(self.table)
        free(self.cost)
        free(self.lower)
        free(self.upper)
        free(self.value)
        free(self.basic)
        free(self.others)
        free(self.place)

    cdef int _make_room(self, Py_ssize_t count) except -1:
        """Make room for as many rows."""
        if count <= self.capacity:
            return 0
        cdef Py_ssize_t capacity = max(count, 2 * self.capacity), entries = capacity * self.n
        cdef Py_ssize_t all_of = self.n + capacity
        self.rows = <double*>realloc(self.rows, entries * sizeof(double))
        self.table = <double*>realloc(self.table, entries * sizeof(double))
        self.lower = <double*>realloc(self.lower, all_of * sizeof(double))
        self.upper = <double*>realloc(self.upper, all_of * sizeof(double))
        self.value = <double*>realloc(self.value, all_of * sizeof(double))
        self.basic = <Py_ssize_t*>realloc(self.basic, capacity * sizeof(Py_ssize_t))
        self.place = <Py_ssize_t*>realloc(self.place, all_of * sizeof(Py_ssize_t))
        if (
            self.rows == NULL or self.table == NULL or self.lower == NULL or self.upper == NULL
            or self.value == NULL or self.basic == NULL or self.place == NULL
        ):
            raise MemoryError
        self.capacity = capacity
        return 0

    def add_rows(self, rows, low, high):
        """Add (k, n) rows with their sides."""
        cdef cnp.ndarray added = as_shaped(rows, len(rows), self.n)
        cdef Py_ssize_t count = added.shape[0], i
        cdef cnp.ndarray least = as_vector(low, count), most = as_vector(high, count)
        self._make_room(self.m + count)
        memcpy(self.rows + self.m * self.n, data(added), count * self.n * sizeof(double))
        for i in range(count):
            self._combine(data(added) + i * self.n, self.table + self.m * self.n)
            self.lower[self.n + self.m] = data(least)[i]
            self.upper[self.n + self.m] = data(most)[i]
            self.basic[self.m], self.place[self.n + self.m] = self.n + self.m, self.m
            self.m += 1

    cdef void _combine(self, const double* row, double* out) noexcept nogil:
        """Put a row on the program's variables in terms of those that are not basic."""
        cdef Py_ssize_t s, j, at
        cdef const double* own
        memset(out, 0, self.n * sizeof(double))
        for s in range(self.n):
            if row[s] != 0.0:
                at = self.place[s]
                if at < 0:
                    out[-1 - at] += row[s]
                else:
                    own = self.table + at * self.n
                    for j in range(self.n):
                        out[j] += row[s] * own[j]

    def drop_rows(self, Py_ssize_t first, Py_ssize_t after):
        """Take away the rows from ``first`` to before ``after``."""
        cdef Py_ssize_t i, k, best, gone = after - first, variable
        cdef double size
        if not 0 <= first <= after <= self.m:
            raise ValueError("needs rows that exist")
        for i in range(first, after):
            k = self.place[self.n + i]
            if k < 0:
                # It has to be basic; another row takes its column.
                best, size = -1, 0.0
                for k in range(self.m):
                    variable = self.basic[k] - self.n
                    if not first <= variable < after:
                        if fabs(self.table[k * self.n - 1 - self.place[self.n + i]]) > size:
                            best = k
                            size = fabs(self.table[k * self.n - 1 - self.place[self.n + i]])
                if best < 0:
                    raise ValueError("no row depends on this one")
                self.pivot(best, -1 - self.place[self.n + i])
            k = self.place[self.n + i]
            # The last row of the table takes its place.
            self._move(self.m - 1 - (i - first), k)
        memmove(
            self.rows + first * self.n, self.rows + after * self.n,
            (self.m - after) * self.n * sizeof(double),
        )
        for i in range(after, self.m):
            self.lower[self.n + i - gone] = self.lower[self.n + i]
            self.upper[self.n + i - gone] = self.upper[self.n + i]
            self.value[self.n + i - gone] = self.value[self.n + i]
            self.place[self.n + i - gone] = self.place[self.n + i]
        self.m -= gone
        for i in range(self.m):
            if self.basic[i] >= self.n + after:
                self.basic[i] -= gone
        for i in range(self.n):
            if self.others[i] >= self.n + after:
                self.others[i] -= gone

    cdef void _move(self, Py_ssize_t source, Py_ssize_t target) noexcept nogil:
        """Put a row of the table in another's place."""
        if source != target:
            memcpy(
                self.table + target * self.n, self.table + source * self.n,
                self.n * sizeof(double),
            )
            self.basic[target] = self.basic[source]
            self.place[self.basic[target]] = target

    def set_sides(self, rows, low, high):
        """Set the sides of some rows."""
        cdef cnp.ndarray which = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(
            rows, cnp.NPY_INTP, 1, 1
        )
        cdef Py_ssize_t count = which.shape[0], i, k
        cdef cnp.ndarray least = as_vector(low, count), most = as_vector(high, count)
        for i in range(count):
            k = (<cnp.npy_intp*>cnp.PyArray_DATA(which))[i]
            if not 0 <= k < self.m:
                raise ValueError("needs rows that exist")
            self.lower[self.n + k], self.upper[self.n + k] = data(least)[i], data(most)[i]

    def set_bounds(self, lb, ub):
        """Set the bounds of all variables."""
        memcpy(self.lower, data(as_vector(lb, self.n)), self.n * sizeof(double))
        memcpy(self.upper, data(as_vector(ub, self.n)), self.n * sizeof(double))

    def set_cost(self, cost):
        """Set the cost of all variables."""
        memcpy(self.cost, data(as_vector(cost, self.n)), self.n * sizeof(double))
        self._combine(self.cost, self.slopes)

    def program(self):
        """Return (m, n) R, (n + m,) lower and upper bounds of variables, then rows, and (n,) c."""
        cdef cnp.ndarray rows = np.empty((self.m, self.n)), low = empty1(self.n + self.m)
        cdef cnp.ndarray high = empty1(self.n + self.m), cost = empty1(self.n)
        memcpy(data(rows), self.rows, self.m * self.n * sizeof(double))
        memcpy(data(low), self.lower, (self.n + self.m) * sizeof(double))
        memcpy(data(high), self.upper, (self.n + self.m) * sizeof(double))
        memcpy(data(cost), self.cost, self.n * sizeof(double))
        return rows, low, high, cost

    cdef double correct(self) noexcept nogil:
        """Take away what rounding has left of the cost after the slopes; return how much it was."""
        cdef Py_ssize_t i, j, k
        cdef double worst = 0.0, scale = 1.0
        for j in range(self.n):
            k = self.place[j]
            self.left[j] = self.cost[j] - (self.slopes[-1 - k] if k < 0 else 0.0)
            scale = fmax(scale, fabs(self.slopes[j]))
        for i in range(self.n):
            if self.others[i] >= self.n:
                for j in range(self.n):
                    self.left[j] -= (
                        self.slopes[i] * self.rows[(self.others[i] - self.n) * self.n + j]
                    )
        for j in range(self.n):
            worst = fmax(worst, fabs(self.left[j]) / scale)
        self._combine(self.left, self.left + self.n)
        for j in range(self.n):
            self.slopes[j] += self.left[self.n + j]
        return worst

    cdef void revalue(self) noexcept nogil:
        """Work out the values of the basic variables."""
        cdef Py_ssize_t i, j
        cdef double total
        cdef const double* row
        for i in range(self.m):
            total, row = 0.0, self.table + i * self.n
            for j in range(self.n):
                total += row[j] * self.value[self.others[j]]
            self.value[self.basic[i]] = total

    cdef void shift(self, Py_ssize_t q, double change) noexcept nogil:
        """Change the value of a variable that is not basic, and of those that depend on it."""
        cdef Py_ssize_t i
        self.value[self.others[q]] += change
        for i in range(self.m):
            self.value[self.basic[i]] += change * self.table[i * self.n + q]

    cdef void pivot(self, Py_ssize_t r, Py_ssize_t q) noexcept nogil:
        """Let a basic variable and one that is not change places."""
        cdef Py_ssize_t i, j, leaving = self.basic[r], entering = self.others[q], n = self.n
        cdef double* row = self.table + r * n
        cdef double one_over = 1.0 / row[q]
        for j in range(n):
            row[j] *= -one_over
        row[q] = one_over
        for i in range(self.m):
            if i != r:
                _replace(self.table + i * n, row, n, q)
        _replace(self.slopes, row, n, q)
        _replace(self.tilted, row, n, q)
        self.basic[r], self.others[q] = entering, leaving
        self.place[entering], self.place[leaving] = r, -1 - q
        self.pivots += 1

    cdef void renew(self, bint cold) noexcept nogil:
        """Make the table anew, with the same basic variables, or with the rows' own."""
        cdef Py_ssize_t i, j, _turn, r, q, n = self.n, m = self.m, left = 0
        cdef double size
        cdef Py_ssize_t v
        # Place tells for a while what is to be basic: at least zero.
        memcpy(self.table, self.rows, m * n * sizeof(double))
        memcpy(self.slopes, self.cost, n * sizeof(double))
        memset(self.tilted, 0, n * sizeof(double))
        for j in range(n):
            self.others[j] = j
            left += self.place[j] >= 0
        for i in range(m):
            self.basic[i] = n + i
        if not cold:
            for _turn in range(left):
                r, q, size = -1, -1, 0.0
                for i in range(m):
                    v = self.basic[i]
                    if v >= n and self.place[v] < 0:
                        for j in range(n):
                            if self.others[j] < n and self.place[self.others[j]] >= 0:
                                if is_pivot(self.table[i * n + j]) and (
                                    fabs(self.table[i * n + j]) > size
                                ):
                                    r, q, size = i, j, fabs(self.table[i * n + j])
                if r < 0:
                    break
                self._swap(r, q)
        for i in range(m):
            self.place[self.basic[i]] = i
        for j in range(n):
            self.place[self.others[j]] = -1 - j
        self.pivots = 0

    cdef void _swap(self, Py_ssize_t r, Py_ssize_t q) noexcept nogil:
        """Pivot, and leave what `place` says of the two for others to read."""
        cdef Py_ssize_t leaving = self.basic[r], entering = self.others[q]
        cdef Py_ssize_t first = self.place[leaving], second = self.place[entering]
        self.pivot(r, q)
        self.place[leaving], self.place[entering] = first, second

    cdef double drift(self) noexcept nogil:
        """What rounding has left: of the rows at the answer, and of the cost's multipliers."""
        cdef Py_ssize_t i, j
        cdef double total, worst = 0.0, scale = 1.0
        cdef const double* row
        for j in range(self.n):
            scale = fmax(scale, fabs(self.value[j]))
        for i in range(self.m):
            total, row = -self.value[self.n + i], self.rows + i * self.n
            for j in range(self.n):
                total += row[j] * self.value[j]
            worst = fmax(worst, fabs(total) / scale)
            if not isfinite(total):
                return INFINITY
        return fmax(worst, self.correct())


cdef inline void _replace(
    double* row, const double* by, Py_ssize_t n, Py_ssize_t q
) noexcept nogil:
    """Put what a variable is made of in its place, in another row."""
    cdef Py_ssize_t j
    cdef double share = row[q]
    if share == 0.0:
        return
    row[q] = 0.0
    for j in range(n):
        row[j] += share * by[j]
