"""What other loops take of these."""

cdef void jacobian_of(
    Py_ssize_t n, const double* column, const double* moves, const double* p, double* out
) noexcept nogil
