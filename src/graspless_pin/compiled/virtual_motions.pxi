"""Virtual motions: their map, scaled, and those that slide with given signs."""

cdef void scaled_of(
    Py_ssize_t rows, Py_ssize_t n, const double* values, double* size, double* out
) noexcept nogil:
    """Put a map of virtual motions with columns of one size and the columns' factors into places.

    The factors are positive; in the map, those of the joints count negative, as it is their
    backward rates that it takes.
    """
    cdef Py_ssize_t row, k
    memset(size, 0, n * sizeof(double))
    for row in range(rows):
        for k in range(n):
            size[k] += values[n * row + k] * values[n * row + k]
    for k in range(n):
        size[k] = 1.0 / sqrt(size[k]) if size[k] > 0.0 else 1.0
    for row in range(rows):
        for k in range(n):
            out[n * row + k] = values[n * row + k] * (size[k] if k < 6 else -size[k])


cdef void touching(
    const double* normal, const double* gram, Py_ssize_t s, Py_ssize_t n, double* motion, double* a
) noexcept nogil:
    """Take the velocities along the normals (s, n) from a motion, up to damping."""
    cdef Py_ssize_t i, j
    for i in range(s):
        a[i] = inner(normal + n * i, motion, n)
    solve_factored(gram, s, a)
    for i in range(s):
        for j in range(n):
            motion[j] -= a[i] * normal[n * i + j]


cdef bint factor_of(
    const double* rows, Py_ssize_t count, Py_ssize_t n, double damping, double* gram
) noexcept nogil:
    """Put the factor of the damped products of rows with each other into an array."""
    cdef Py_ssize_t i, j
    cdef double trace = 1.0
    for i in range(count):
        for j in range(i + 1):
            gram[count * i + j] = inner(rows + n * i, rows + n * j, n)
        trace += gram[count * i + i]
    for i in range(count):
        gram[count * i + i] += damping * trace
    return factor(gram, count)


cdef Py_ssize_t witness_workspace(Py_ssize_t s, Py_ssize_t n) noexcept nogil:
    """Numbers that `witness_of` keeps on its way."""
    return 5 * s * n + 5 * s * s + 5 * s + 1


cdef bint witness_of(
    Py_ssize_t M, Py_ssize_t n, const double* local, Py_ssize_t s, const cnp.npy_intp* number,
    const double* wanted_signs, const double* near, int guesses, double damping, int corrections,
    double rank_tolerance, double least, double* workspace, double* sign, double* x
) noexcept nogil:
    """Find a motion that keeps some contacts touching and slides with signs, near another one.

    Args:
        M: Contacts.
        n: Coordinates of motions.
        local: (M, 3, n) map of virtual motions to velocities along n, t1, t2.
        s: How many contacts slide,
        number: and which.
        wanted_signs: (2 s,) signs of their sliding, 0 where any will do.
        near: (n,) a motion that may be close to one; NULL: none is known.
        guesses: How many motions nearest to wanted slidings are tried.
        damping: Stands in for ranks, see `witness_heuristics`.
        corrections: How often the velocities along the normals are taken away.
        rank_tolerance: Largest velocity along a normal that counts as none, over the length of all
            contact velocities.
        least: Least square of a sliding that counts as one, over the square of that length.
        workspace: `witness_workspace` numbers.
        sign: Takes the (2 s,) signs, with those of the sliding in the place of zeros.
        x: Takes the (n,) motion.

    Returns:
        Whether one was found.
    """
    cdef double* N = workspace
    cdef double* T = N + s * n
    cdef double* H = T + 2 * s * n
    cdef double* G = H + 2 * s * n
    cdef double* other = G + s * s
    cdef double* small = other + 4 * s * s
    cdef double* w = small + s + 1
    cdef double* b = w + 2 * s
    cdef double slowest, size, apart, slide
    cdef bint can_hold, can_guess = False
    cdef Py_ssize_t i, j, attempt
    cdef int _
    for i in range(s):
        memcpy(N + n * i, local + 3 * n * number[i], n * sizeof(double))
        memcpy(T + 2 * n * i, local + (3 * number[i] + 1) * n, 2 * n * sizeof(double))
    can_hold = factor_of(N, s, n, damping, G)
    for attempt in range(-1, guesses):
        if attempt < 0:
            if near == NULL:
                continue
            memcpy(x, near, n * sizeof(double))
        else:
            if attempt == 0:
                memcpy(H, T, 2 * s * n * sizeof(double))
                if can_hold:
                    for i in range(2 * s):
                        touching(N, G, s, n, H + n * i, small)
                can_guess = factor_of(H, 2 * s, n, damping, other)
                memcpy(w, wanted_signs, 2 * s * sizeof(double))
            if not can_guess:
                return False
            memcpy(b, w, 2 * s * sizeof(double))
            solve_factored(other, 2 * s, b)
            memset(x, 0, n * sizeof(double))
            for i in range(2 * s):
                for j in range(n):
                    x[j] += b[i] * H[n * i + j]
        if can_hold:
            for _ in range(corrections):
                touching(N, G, s, n, x, small)
        size, apart, slowest = 0.0, 0.0, INFINITY
        for i in range(3 * M):
            size += inner(local + n * i, x, n) ** 2
        for i in range(s):
            apart += inner(N + n * i, x, n) ** 2
        for i in range(2 * s):
            slide = inner(T + n * i, x, n)
            sign[i] = wanted_signs[i]
            if sign[i] == 0.0:
                sign[i] = -1.0 if slide < 0.0 else 1.0
            slowest = min(slowest, slide * sign[i])
            w[i] = sign[i] * max(slide * sign[i], 1.0)
        if (
            slowest > 0.0 and slowest * slowest >= least * size
            and apart <= rank_tolerance * rank_tolerance * size
        ):
            return True
    return False
