"""What other loops take of these."""

cdef void tangents_of(
    Py_ssize_t count, const double* normals, Py_ssize_t axis_count, const double* axes,
    double* frames
) noexcept nogil
