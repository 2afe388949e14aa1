"""What other loops take of these."""

cimport numpy as cnp

cdef class KinematicChains:
    cdef Py_ssize_t n
    cdef cnp.ndarray _parents, _placements, _axes, _masses, _centers, _T, _J, _moments

    cdef void place(self, const double* position, double* poses) noexcept
    cdef void columns(self, const double* poses, double* J) noexcept
    cdef void weights(
        self, const double* poses, const double* J, const double* g, double* torques
    ) noexcept
