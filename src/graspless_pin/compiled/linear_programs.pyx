# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Algorithms 1 and 2 as rows and sides, what answers to a linear program prove, nearby optima.

Rows are taken and given transposed, (n, R) and contiguous: a column of the program in one piece.
"""

from libc.math cimport INFINITY, fabs, isfinite
from libc.string cimport memcpy, memset

cimport numpy as cnp

from graspless_pin.compiled.shared cimport (
    as_blocks, as_flags, as_integers, as_reals, as_shaped, as_vector, data, effects_of, empty,
    empty1, factor, flags_of, inner, numbers_of, solve_factored,
)

cnp.import_array()


def paper_program(
    positions, directions, jacobian, axes, cone_rows, Py_ssize_t face_count, reach, has_cone, most,
    wrench, lower, upper, gravity, double force_scale, joint_scale, double length_scale,
    double farthest, double margin, joints, factors, levels,
):
    """Rows, sides, box and bounds of Algorithm 1 or 2, see `objectives`.

    Args:
        positions: (M, 3) m.
        directions: (M, 3, 3) rows n, t1, t2 of each contact.
        jacobian: (3M, L).
        axes: (n,) which of these rows each coordinate is along, counted through.
        cone_rows: (n + 1, s) the rows of the cones, transposed.
        face_count: How many of them are side faces; the next M are those of the normal forces.
        reach: (2, n) bounds of forces inside cones, each in limits of its contact's normal force.
        has_cone: (M,).
        most: (M,) largest normal forces, N.
        wrench: (6,) external wrench.
        lower: (L,) lower torque limits, N m.
        upper: (L,) upper torque limits, N m.
        gravity: (L,) torques that carry the links, N m.
        force_scale: N.
        joint_scale: (L,) N m.
        length_scale: m.
        farthest: Size from which on a side is far.
        margin: Margin of Algorithm 2 over the force scale, below zero: Algorithm 1.
        joints: (p,) joints of the rows of the largest torque; none: Algorithm 1.
        factors: (p,) what these rows' torques count.
        levels: (p,) what the largest torque counts there.

    Returns:
        (n + 1, R) transposed rows: balance, largest torque, cones, torques; (R,) lower and (R,)
        upper sides; the (2, n + 1) box; (2, n + 1) bounds; and whether a side is far or a row has
        none.
    """
    cdef cnp.ndarray points = as_reals(positions, 2), J = as_reals(jacobian, 2)
    cdef Py_ssize_t M = points.shape[0], L = J.shape[1], n, s, p, R, S, T, c, k, contact
    points, J = as_shaped(points, M, 3), as_shaped(J, 3 * M, L)
    cdef cnp.ndarray along = as_blocks(directions, M, 3, 3), cones = as_reals(cone_rows, 2)
    n, S = cones.shape[0] - 1, cones.shape[1]
    cdef cnp.ndarray number = as_integers(axes, n), bounds = as_shaped(reach, 2, n)
    cdef cnp.ndarray limits = as_vector(most, M), load = as_vector(wrench, 6)
    cdef cnp.ndarray lowest = as_vector(lower, L), highest = as_vector(upper, L)
    cdef cnp.ndarray weight = as_vector(gravity, L), scale = as_vector(joint_scale, L)
    cdef cnp.ndarray coned = as_flags(has_cone, M), factor_of = as_reals(factors, 1)
    p = factor_of.shape[0]
    cdef cnp.ndarray level = as_vector(levels, p), joint = as_integers(joints, p)
    cdef bint largest = margin >= 0.0, far = False
    # Algorithm 2 bounds normal forces by their columns.
    s = face_count if largest else S
    T, R = 6 + p + s, 6 + p + s + L
    if S < face_count + M or face_count < 0 or (p and not largest):
        raise ValueError("needs the rows of all cones")
    for k in range(p):
        if not 0 <= numbers_of(joint)[k] < L:
            raise ValueError("needs joints that exist")
    cdef cnp.ndarray rows = empty(n + 1, R), low = empty1(R), high = empty1(R)
    cdef cnp.ndarray box = empty(2, n + 1), imposed = empty(2, n + 1), effects = empty1(6 + L)
    cdef cnp.ndarray reached = empty1(L)
    cdef double* out
    cdef double* effect = data(effects)
    cdef double* torque = data(reached)
    cdef double least = INFINITY, top, side
    for k in range(L):
        torque[k] = fabs(data(weight)[k] / data(scale)[k])
    for c in range(n):
        if not 0 <= numbers_of(number)[c] < 3 * M:
            raise ValueError("needs axes that exist")
        contact, out = numbers_of(number)[c] // 3, data(rows) + R * c
        effects_of(
            data(along) + 3 * numbers_of(number)[c], data(points) + 3 * contact,
            data(J) + 3 * L * contact, L, effect,
        )
        top = data(limits)[contact] / force_scale
        for k in range(3):
            out[k], out[3 + k] = effect[k], effect[3 + k] / length_scale
        memcpy(out + 6 + p, data(cones) + S * c, s * sizeof(double))
        for k in range(2):
            data(box)[(n + 1) * k + c] = data(bounds)[n * k + c] * top
        for k in range(L):
            out[T + k] = effect[6 + k] * (force_scale / data(scale)[k])
            torque[k] += fabs(out[T + k]) * data(box)[n + 1 + c]
        for k in range(p):
            out[6 + k] = data(factor_of)[k] * out[T + numbers_of(joint)[k]]
        data(imposed)[c], data(imposed)[n + 1 + c] = -INFINITY, INFINITY
        if largest and numbers_of(number)[c] % 3 == 0:
            data(imposed)[n + 1 + c] = top - margin
            if not flags_of(coned)[contact]:
                data(imposed)[c] = margin
    out = data(rows) + R * n
    memset(out, 0, R * sizeof(double))
    memset(data(high), 0, R * sizeof(double))
    for k in range(6):
        data(low)[k] = -data(load)[k] / (force_scale if k < 3 else force_scale * length_scale)
        data(high)[k] = data(low)[k]
    for k in range(6, T):
        data(low)[k] = -INFINITY
    for k in range(L):
        data(low)[T + k] = (data(lowest)[k] - data(weight)[k]) / data(scale)[k]
        data(high)[T + k] = (data(highest)[k] - data(weight)[k]) / data(scale)[k]
    for k in range(M):
        least = min(least, data(limits)[k] / force_scale)
    top = 0.5 * least
    if largest:
        top = 0.0
        for k in range(p):
            c = numbers_of(joint)[k]
            out[6 + k] = -data(level)[k]
            data(high)[6 + k] = -data(factor_of)[k] * (data(weight)[c] / data(scale)[c])
            top = max(top, torque[c] * fabs(data(factor_of)[k]) / data(level)[k])
        top += 1.0
        for k in range(face_count):
            data(high)[6 + p + k] = -margin
    else:
        memcpy(out + 6, data(cones) + S * n, s * sizeof(double))
        for k in range(M):
            data(high)[6 + face_count + k] = data(limits)[k] / force_scale
    data(box)[n], data(box)[2 * n + 1] = 0.0, top
    data(imposed)[n], data(imposed)[2 * n + 1] = 0.0 if largest else -INFINITY, INFINITY
    for k in range(2 * R):
        side = data(low)[k] if k < R else data(high)[k - R]
        far = far or (fabs(side) > farthest and isfinite(side))
    for k in range(R):
        far = far or (not isfinite(data(low)[k]) and not isfinite(data(high)[k]))
    for k in range(2 * n):
        side = data(imposed)[k + k // n]
        far = far or (fabs(side) > farthest and isfinite(side))
    return rows, low, high, box, imposed, far


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
