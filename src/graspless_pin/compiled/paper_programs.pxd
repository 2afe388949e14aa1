"""What other loops take of these."""

cimport numpy as cnp

cpdef enum:
    MARGIN = 0
    TORQUE = 1
    SHARE = 2

cdef class PaperPrograms:
    cdef int kind
    cdef readonly Py_ssize_t M, L, n
    cdef Py_ssize_t s, p, R, T, W, faces, edges
    cdef double required, least_lever, rounding, farthest, least_limit, most_strict
    cdef bint loaded
    # How often friction was changed.
    cdef Py_ssize_t rubbed
    cdef list kept
    # Of all problems.
    cdef cnp.npy_intp* axes
    cdef cnp.npy_intp* row_start
    cdef cnp.npy_intp* row_column
    cdef double* row_value
    cdef double* reach
    cdef double* mu
    cdef double* slopes
    cdef double* directions
    cdef cnp.npy_bool* has_cone
    cdef cnp.npy_bool* turns
    # Of one problem.
    cdef const double* most
    cdef const double* wrench
    cdef const double* lower
    cdef const double* upper
    cdef double* sliding
    cdef const double* points
    cdef const double* normals
    cdef const double* tangents
    cdef const double* J
    cdef const double* gravity
    # Made of it.
    cdef double force, length, unit, strict
    cdef double* frames
    cdef double* joint_scale
    cdef double* B
    cdef double* torque
    cdef double* box
    cdef double* bounds
    cdef cnp.npy_intp* joint
    cdef double* share
    cdef double* level
    # A point and multipliers, and what they prove.
    cdef double* x
    cdef double* w
    cdef double* d
    cdef double* counted
    cdef double* levels
    cdef double value, bound, residual

    cdef double* room(self, Py_ssize_t count)
    cdef double* reals(self, cnp.ndarray array)
    cdef cnp.npy_intp* numbers(self, cnp.ndarray array)
    cdef void take(self, problem, list held)
    cdef void count_rows(self) noexcept
    cdef void hold(self, problem, list held)
    cdef bint posed(self) noexcept
    cdef void restrict(self, double most) noexcept
    cdef double side(self, Py_ssize_t i, bint top) noexcept
    cdef void judged(self) noexcept
