"""What the loops share: arrays as they take them, and rigid transforms of points.

Arrays of other types or layouts than contiguous doubles are copied; shapes that do not fit are
refused with a ValueError.
"""

cimport numpy as cnp

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


cdef inline cnp.ndarray as_poses(object values):
    """The values as a contiguous (K, 4, 4) array of doubles."""
    cdef cnp.ndarray array = as_reals(values, 3)
    if array.shape[1] != 4 or array.shape[2] != 4:
        raise ValueError("needs shape (K, 4, 4)")
    return array


cdef inline cnp.ndarray as_vector(object values, Py_ssize_t length):
    """The values as a contiguous (length,) array of doubles."""
    cdef cnp.ndarray array = as_reals(values, 1)
    if array.shape[0] != length:
        raise ValueError(f"needs shape ({length},)")
    return array


cdef inline cnp.ndarray as_integers(object values, Py_ssize_t length):
    """The values as a contiguous (length,) array of integers of a pointer's size."""
    cdef cnp.ndarray array = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(
        values, cnp.NPY_INTP, 1, 1
    )
    if array.shape[0] != length:
        raise ValueError(f"needs shape ({length},)")
    return array


cdef inline double* data(cnp.ndarray array) noexcept:
    return <double*>cnp.PyArray_DATA(array)


cdef inline cnp.ndarray empty(Py_ssize_t rows, Py_ssize_t columns):
    cdef cnp.npy_intp shape[2]
    shape[0], shape[1] = rows, columns
    return <cnp.ndarray>cnp.PyArray_EMPTY(2, shape, cnp.NPY_DOUBLE, 0)


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
