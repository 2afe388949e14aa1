"""What the simplex method takes of dictionaries."""

from libc.math cimport fabs

cdef class Dictionary:
    cdef Py_ssize_t n, m, room
    cdef double* rows  # (m, n) R
    cdef double* table  # (m, n) basic variables in terms of the others
    cdef double* cost  # (n,) c
    cdef double* slopes  # (n,) what the cost rises with each variable that is not basic
    cdef double* tilted  # (n,) the same, tilted and shifted to be feasible
    cdef double* left  # (2, n) of the cost after the slopes, and that in terms of the table
    cdef double* lower  # (n + m,)
    cdef double* upper  # (n + m,)
    cdef double* value  # (n + m,)
    cdef Py_ssize_t* basic  # (m,) the variable of each row of the table
    cdef Py_ssize_t* others  # (n,) that of each column
    cdef Py_ssize_t* place  # (n + m,) row of a basic variable; -1 - column of another
    cdef int pivots

    cdef int _make_room(self, Py_ssize_t count) except -1
    cdef void _combine(self, const double* row, double* out) noexcept nogil
    cdef void _move(self, Py_ssize_t source, Py_ssize_t target) noexcept nogil
    cdef double correct(self) noexcept nogil
    cdef void revalue(self) noexcept nogil
    cdef void shift(self, Py_ssize_t q, double change) noexcept nogil
    cdef void pivot(self, Py_ssize_t r, Py_ssize_t q) noexcept nogil
    cdef void renew(self, bint cold) noexcept nogil
    cdef void _swap(self, Py_ssize_t r, Py_ssize_t q) noexcept nogil
    cdef double drift(self) noexcept nogil

cdef inline bint is_pivot(double entry) noexcept nogil:
    """Whether an entry of a table is large enough for a pivot."""
    return fabs(entry) > 1e-9
