"""What other loops take of these."""

cimport numpy as cnp

cdef class ConvexSets:
    cdef Py_ssize_t count
    cdef cnp.ndarray _kinds, _bodies, _centers, _halves, _reaches, _planes, _starts, _faces
    cdef cnp.npy_intp* kinds
    cdef cnp.npy_intp* bodies
    cdef cnp.npy_intp* starts
    cdef double* centers
    cdef double* halves
    cdef double* reaches
    cdef double* planes
    cdef double* faces

cdef bint near_boxes(
    ConvexSets ones, Py_ssize_t p, const double* T, ConvexSets others, Py_ssize_t k,
    const double* T_other, const double* center, double tolerance
) noexcept nogil

cdef int ball_on_face(
    ConvexSets ones, Py_ssize_t p, const double* T, double radius, const double* T_ball,
    double tolerance, double max_penetration, double* row, double* gap
) noexcept nogil
