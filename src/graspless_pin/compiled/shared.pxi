"""What the loops share: arrays as they take them, and rigid transforms of points.

Arrays of other types or layouts than contiguous doubles are copied; shapes that do not fit are
refused with a ValueError.
"""

cdef inline cnp.ndarray as_reals(object values, int ndim):
    """The values as a contiguous array of doubles with a number of dimensions; 0: with any."""
    if (
        cnp.PyArray_Check(values)
        and cnp.PyArray_TYPE(<cnp.ndarray>values) == cnp.NPY_DOUBLE
        and cnp.PyArray_ISCARRAY_RO(<cnp.ndarray>values)
        and (ndim == 0 or cnp.PyArray_NDIM(<cnp.ndarray>values) == ndim)
    ):
        return <cnp.ndarray>values
    return <cnp.ndarray>cnp.PyArray_ContiguousFromAny(values, cnp.NPY_DOUBLE, ndim, ndim)


cdef inline cnp.ndarray as_shaped(object values, Py_ssize_t rows, Py_ssize_t columns):
    """The values as a contiguous (rows, columns) array of doubles."""
    cdef cnp.ndarray array = as_reals(values, 2)
    if array.shape[0] != rows or array.shape[1] != columns:
        raise ValueError(f"needs shape ({rows}, {columns})")
    return array


cdef inline cnp.ndarray as_poses(object values, Py_ssize_t count):
    """The values as a contiguous (count, 4, 4) array of doubles."""
    cdef cnp.ndarray array = as_reals(values, 3)
    if array.shape[0] != count or array.shape[1] != 4 or array.shape[2] != 4:
        raise ValueError(f"needs one pose for each set or joint: ({count}, 4, 4)")
    return array


cdef inline cnp.ndarray as_vector(object values, Py_ssize_t length):
    """The values as a contiguous (length,) array of doubles."""
    cdef cnp.ndarray array = as_reals(values, 1)
    if array.shape[0] != length:
        raise ValueError(f"needs shape ({length},)")
    return array


cdef inline cnp.ndarray as_kind(object values, Py_ssize_t length, int kind):
    """The values as a contiguous (length,) array of one of numpy's kinds of numbers."""
    cdef cnp.ndarray array = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(values, kind, 1, 1)
    if array.shape[0] != length:
        raise ValueError(f"needs shape ({length},)")
    return array


cdef inline cnp.ndarray as_integers(object values, Py_ssize_t length):
    """The values as a contiguous (length,) array of integers of a pointer's size."""
    return as_kind(values, length, cnp.NPY_INTP)


cdef inline cnp.ndarray as_flags(object values, Py_ssize_t length):
    """The values as a contiguous (length,) array of truth values."""
    return as_kind(values, length, cnp.NPY_BOOL)


cdef inline cnp.ndarray as_blocks(
    object values, Py_ssize_t count, Py_ssize_t rows, Py_ssize_t columns
):
    """The values as a contiguous (count, rows, columns) array of doubles."""
    cdef cnp.ndarray array = as_reals(values, 3)
    if array.shape[0] != count or array.shape[1] != rows or array.shape[2] != columns:
        raise ValueError(f"needs shape ({count}, {rows}, {columns})")
    return array


cdef inline cnp.npy_bool* flags_of(cnp.ndarray array) noexcept nogil:
    return <cnp.npy_bool*>cnp.PyArray_DATA(array)


cdef inline cnp.npy_intp* numbers_of(cnp.ndarray array) noexcept nogil:
    return <cnp.npy_intp*>cnp.PyArray_DATA(array)


cdef inline cnp.ndarray empty1(Py_ssize_t length):
    cdef cnp.npy_intp shape = length
    return <cnp.ndarray>cnp.PyArray_EMPTY(1, &shape, cnp.NPY_DOUBLE, 0)


cdef inline double* data(cnp.ndarray array) noexcept nogil:
    return <double*>cnp.PyArray_DATA(array)


cdef class KeptArrays:
    """What keeps the arrays that its loops go through by pointers."""

    cdef list kept

    def __cinit__(self):
        self.kept = []

    cdef double* reals(self, cnp.ndarray array):
        self.kept.append(array)
        return data(array)

    cdef cnp.npy_intp* numbers(self, cnp.ndarray array):
        self.kept.append(array)
        return numbers_of(array)

    cdef cnp.npy_bool* flags(self, cnp.ndarray array):
        self.kept.append(array)
        return flags_of(array)

    cdef double* room(self, Py_ssize_t count):
        return self.reals(empty1(max(count, 1)))

    cdef cnp.npy_intp* number_room(self, Py_ssize_t count):
        return self.numbers(np.zeros(max(count, 1), np.intp))


cdef inline double dot(const double* a, const double* b) noexcept nogil:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


cdef inline void turn(const double* T, const double* x, double* y) noexcept nogil:
    """y = R x for the rotation of a pose."""
    cdef int i
    for i in range(3):
        y[i] = dot(T + 4 * i, x)


cdef inline void turn_back(const double* T, const double* x, double* y) noexcept nogil:
    """y = R^T x for the rotation of a pose."""
    cdef int i
    for i in range(3):
        y[i] = T[i] * x[0] + T[4 + i] * x[1] + T[8 + i] * x[2]


cdef inline void move(const double* T, const double* x, double* y) noexcept nogil:
    """y = R x + t."""
    cdef int i
    for i in range(3):
        y[i] = dot(T + 4 * i, x) + T[4 * i + 3]


cdef inline void chained(const double* A, const double* B, double* C) noexcept nogil:
    """The pose C = A B."""
    cdef int i, j
    for i in range(3):
        for j in range(4):
            C[4 * i + j] = A[4 * i] * B[j] + A[4 * i + 1] * B[4 + j] + A[4 * i + 2] * B[8 + j]
        C[4 * i + 3] += A[4 * i + 3]
    C[12], C[13], C[14], C[15] = 0.0, 0.0, 0.0, 1.0


cdef inline void effects_of(
    const double* a, const double* p, const double* J, Py_ssize_t L, double* out
) noexcept nogil:
    """Wrench [a; p x a] and torques J^T a of a unit force along a at p, J being (3, L)."""
    cdef Py_ssize_t k
    out[0], out[1], out[2] = a[0], a[1], a[2]
    out[3] = p[1] * a[2] - p[2] * a[1]
    out[4] = p[2] * a[0] - p[0] * a[2]
    out[5] = p[0] * a[1] - p[1] * a[0]
    for k in range(L):
        out[6 + k] = a[0] * J[k] + a[1] * J[L + k] + a[2] * J[2 * L + k]


cdef inline double inner(const double* a, const double* b, Py_ssize_t n) noexcept nogil:
    """Product of two vectors, by four sums that do not wait for each other."""
    cdef Py_ssize_t k, whole = n - n % 4
    cdef double first = 0.0, second = 0.0, third = 0.0, fourth = 0.0
    for k in range(0, whole, 4):
        first += a[k] * b[k]
        second += a[k + 1] * b[k + 1]
        third += a[k + 2] * b[k + 2]
        fourth += a[k + 3] * b[k + 3]
    for k in range(whole, n):
        first += a[k] * b[k]
    return (first + second) + (third + fourth)


cdef inline bint factor(double* gram, Py_ssize_t n) noexcept nogil:
    """Put the Cholesky factor L of a symmetric matrix into its lower half; whether there is one."""
    cdef Py_ssize_t i, j
    cdef double pivot
    cdef double* row
    cdef double* other
    for j in range(n):
        row = gram + n * j
        pivot = row[j] - inner(row, row, j)
        if not pivot > 0.0:
            return False
        row[j] = sqrt(pivot)
        for i in range(j + 1, n):
            other = gram + n * i
            other[j] = (other[j] - inner(other, row, j)) / row[j]
    return True


cdef inline void solve_factored(const double* L, Py_ssize_t n, double* b) noexcept nogil:
    """Solve L L^T x = b in place."""
    cdef Py_ssize_t i, k
    for i in range(n):
        b[i] = (b[i] - inner(L + n * i, b, i)) / L[n * i + i]
    for i in range(n - 1, -1, -1):
        b[i] /= L[n * i + i]
        for k in range(i):
            b[k] -= L[n * i + k] * b[i]
