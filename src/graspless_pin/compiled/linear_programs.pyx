# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""What answers to a linear program prove, and optima near to others.

Rows are taken and given transposed, (n, R) and contiguous: a column of the program in one piece.
"""

from libc.math cimport INFINITY, isfinite
from libc.string cimport memcpy, memset

cimport numpy as cnp

from graspless_pin.compiled.shared cimport (
    as_flags, as_reals, as_shaped, as_vector, data, empty, empty1, factor, flags_of, inner,
    numbers_of, solve_factored,
)

cnp.import_array()


def judged(rows, low, high, c, lb, ub, box, x, y, z):
    """What a point and multipliers prove of a linear program, see `Program`.

    Args:
        rows: (n, R) transposed rows.
        low: (R,) their lower sides, -inf where there is none.
        high: (R,) their upper sides, inf where there is none.
        c: (n,) objective.
        lb: (n,) lower bounds.
        ub: (n,) upper bounds.
        box: (2, n) bounds that are implied.
        x: (n,) the point.
        y: (m,) multipliers of the first rows.
        z: (R - m,) multipliers of the other rows, positive at upper sides.

    Returns:
        The bound that the multipliers prove, the objective at the point, and the largest violation
        of a constraint there, infinite where a number is none.
    """
    cdef cnp.ndarray matrix = as_reals(rows, 2)
    cdef Py_ssize_t n = matrix.shape[0], R = matrix.shape[1], j, i
    cdef cnp.ndarray lower = as_vector(low, R), upper = as_vector(high, R), cost = as_vector(c, n)
    cdef cnp.ndarray least = as_vector(lb, n), most = as_vector(ub, n)
    cdef cnp.ndarray implied = as_shaped(box, 2, n)
    cdef cnp.ndarray point = as_vector(x, n), first = as_reals(y, 1)
    cdef Py_ssize_t m = first.shape[0]
    cdef cnp.ndarray others = as_vector(z, R - m), level = empty1(R), counted = empty1(R)
    cdef double* at = data(level)
    cdef double* w = data(counted)
    cdef cnp.ndarray places = <cnp.ndarray>cnp.PyArray_EMPTY(
        1, cnp.PyArray_DIMS(level), cnp.NPY_INTP, 0
    )
    cdef cnp.npy_intp* place = numbers_of(places)
    cdef Py_ssize_t count = 0
    cdef const double* column
    cdef double bound = 0.0, value = 0.0, residual = 0.0, slope, side, total = 0.0
    for i in range(R):
        at[i], w[i] = 0.0, data(first)[i] if i < m else data(others)[i - m]
        total += w[i]
        if w[i] != 0.0:
            side = data(upper)[i] if w[i] > 0.0 else data(lower)[i]
            if isfinite(side):
                bound -= w[i] * side
                place[count] = i
                count += 1
    for j in range(n):
        column, side = data(matrix) + R * j, data(point)[j]
        slope = data(cost)[j]
        for i in range(R):
            at[i] += side * column[i]
        for i in range(count):
            slope += w[place[i]] * column[place[i]]
        total += side
        value += data(cost)[j] * side
        residual = max(residual, side - data(most)[j], data(least)[j] - side)
        if slope >= 0.0:
            bound += slope * max(data(implied)[j], data(least)[j])
        else:
            bound += slope * min(data(implied)[n + j], data(most)[j])
    for i in range(R):
        residual = max(residual, at[i] - data(upper)[i], data(lower)[i] - at[i])
    return bound, value, residual if isfinite(total) else INFINITY


def refined(
    rows, low, high, c, lb, ub, active, at_bounds, upper, x, weights, double damping,
    int corrections,
):
    """A point and multipliers of a linear program for given active constraints, or None.

    Args:
        rows: (n, R) transposed rows.
        low: (R,) their lower sides.
        high: (R,) their upper sides.
        c: (n,) objective.
        lb: (n,) lower bounds.
        ub: (n,) upper bounds.
        active: (r,) the active rows.
        at_bounds: (h,) variables at a bound.
        upper: (r + h,) whether it is the upper side, or bound.
        x: (n,) a point nearby.
        weights: (r + h,) multipliers nearby.
        damping: Stands in for ranks, see `active_set`.
        corrections: How often what is left is taken away.

    Returns:
        (n,) the point, (r + h,) its multipliers, and (R,) those of all rows; None where a side is
        infinite or the rows cannot be told apart.
    """
    cdef cnp.ndarray matrix = as_reals(rows, 2)
    cdef Py_ssize_t n = matrix.shape[0], R = matrix.shape[1], m, r, h, i, j, k, size
    cdef cnp.ndarray bounded = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(
        at_bounds, cnp.NPY_INTP, 1, 1
    )
    h = bounded.shape[0]
    cdef cnp.ndarray chosen = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(active, cnp.NPY_INTP, 1, 1)
    r = chosen.shape[0]
    m = r + h
    cdef cnp.ndarray lower = as_vector(low, R), higher = as_vector(high, R), cost = as_vector(c, n)
    cdef cnp.ndarray least = as_vector(lb, n), most = as_vector(ub, n), top = as_flags(upper, m)
    cdef cnp.ndarray point = <cnp.ndarray>cnp.PyArray_NewCopy(as_vector(x, n), cnp.NPY_CORDER)
    cdef cnp.ndarray multipliers = <cnp.ndarray>cnp.PyArray_NewCopy(
        as_vector(weights, m), cnp.NPY_CORDER
    )
    cdef cnp.ndarray gathered = empty(m, n), sides = empty1(m), left = empty1(max(m, n))
    cdef cnp.ndarray rest = empty1(max(m, n)), other = empty1(n)
    cdef cnp.npy_intp length = m * n + m
    cdef cnp.ndarray entries = <cnp.ndarray>cnp.PyArray_EMPTY(1, &length, cnp.NPY_INTP, 0)
    cdef cnp.npy_intp* place = numbers_of(entries)
    cdef cnp.npy_intp* ends = place + m * n
    cdef double* y = data(other)
    cdef double* E = data(gathered)
    cdef double* e = data(sides)
    cdef double* b = data(left)
    cdef double* d = data(rest)
    cdef double* z = data(point)
    cdef double* w = data(multipliers)
    cdef double trace = 0.0
    cdef bint wide = m <= n
    memset(E, 0, m * n * sizeof(double))
    for i in range(r):
        if not 0 <= numbers_of(chosen)[i] < R:
            raise ValueError("needs rows that exist")
    for j in range(n):
        for i in range(r):
            E[n * i + j] = data(matrix)[R * j + numbers_of(chosen)[i]]
    for i in range(m):
        if i < r:
            k = numbers_of(chosen)[i]
            e[i] = data(higher)[k] if flags_of(top)[i] else data(lower)[k]
        else:
            k = numbers_of(bounded)[i - r]
            if not 0 <= k < n:
                raise ValueError("needs variables that exist")
            E[n * i + k] = 1.0
            e[i] = data(most)[k] if flags_of(top)[i] else data(least)[k]
        if not isfinite(e[i]):
            return None
        # Most rows are those of cones, which have few entries.
        ends[i] = n * i
        for j in range(n):
            if E[n * i + j] != 0.0:
                place[ends[i]] = j
                ends[i] += 1
    size = m if wide else n
    cdef cnp.ndarray gram = empty(size, size)
    cdef double* G = data(gram)
    if wide:
        for i in range(m):
            for j in range(i + 1):
                G[m * i + j] = inner(E + n * i, E + n * j, n)
    else:
        memset(G, 0, n * n * sizeof(double))
        for k in range(m):
            for i in range(n * k, ends[k]):
                for j in range(n * k, i + 1):
                    G[n * place[i] + place[j]] += E[n * k + place[i]] * E[n * k + place[j]]
    for i in range(size):
        trace += G[size * i + i]
    for i in range(size):
        G[size * i + i] += damping * trace
    if not factor(G, size):
        return None
    for _ in range(corrections):
        # What is left of the sides, and the slope of the Lagrangian.
        memcpy(d, data(cost), n * sizeof(double))
        for i in range(m):
            b[i] = e[i]
            for j in range(n * i, ends[i]):
                b[i] -= E[n * i + place[j]] * z[place[j]]
                d[place[j]] += w[i] * E[n * i + place[j]]
        if wide:
            solve_factored(G, m, b)
            for i in range(m):
                for j in range(n):
                    z[j] += b[i] * E[n * i + j]
            for i in range(m):
                b[i] = inner(E + n * i, d, n)
            solve_factored(G, m, b)
            for i in range(m):
                w[i] -= b[i]
        else:
            solve_factored(G, n, d)
            memset(y, 0, n * sizeof(double))
            for i in range(m):
                for j in range(n * i, ends[i]):
                    w[i] -= E[n * i + place[j]] * d[place[j]]
                    y[place[j]] += b[i] * E[n * i + place[j]]
            memcpy(d, y, n * sizeof(double))
            solve_factored(G, n, d)
            for j in range(n):
                z[j] += d[j]
    for i in range(h):
        z[numbers_of(bounded)[i]] = e[r + i]
    cdef cnp.ndarray full = empty1(R)
    memset(data(full), 0, R * sizeof(double))
    for i in range(r):
        data(full)[numbers_of(chosen)[i]] = w[i]
    return point, multipliers, full
