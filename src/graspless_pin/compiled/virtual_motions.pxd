"""What other loops take of these."""

cimport numpy as cnp

cdef void scaled_of(
    Py_ssize_t rows, Py_ssize_t n, const double* values, double* size, double* out
) noexcept nogil

cdef Py_ssize_t witness_room(Py_ssize_t s, Py_ssize_t n) noexcept nogil

cdef bint witness_of(
    Py_ssize_t M, Py_ssize_t n, const double* local, Py_ssize_t s, const cnp.npy_intp* number,
    const double* wanted_signs, const double* near, int guesses, double damping, int corrections,
    double rank_tolerance, double least, double* room, double* sign, double* x
) noexcept nogil
