"""What other loops take of these."""

cimport numpy as cnp

cdef double margin_of(
    Py_ssize_t M, const double* forces, const double* normals, const double* tangents,
    const double* slope, const cnp.npy_bool* has_cone, const double* limit, Py_ssize_t r,
    const double* faces
) noexcept nogil

cdef void scales_of(
    Py_ssize_t M, Py_ssize_t L, const double* points, const double* f, const double* J,
    const double* most, double least_lever, double rounding, double* force_scale,
    double* length_scale, double* lever
) noexcept nogil

cdef void directions_of(
    Py_ssize_t M, const double* n, const double* t, const double* mu, const double* v,
    const cnp.npy_bool* has_cone, double* rows
) noexcept nogil

cdef void map_of(
    Py_ssize_t M, Py_ssize_t L, const double* points, const double* n, const double* t,
    const double* J, double* effects
) noexcept nogil
