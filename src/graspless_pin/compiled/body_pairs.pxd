"""What other loops take of these."""

cimport numpy as cnp

from graspless_pin.compiled.contact_search cimport ConvexSets

cdef class BodyPairs:
    cdef ConvexSets sets
    cdef Py_ssize_t count
    cdef cnp.ndarray _ones, _twos, _centers

    cdef bint any_deep(
        self, const double* poses, ConvexSets others, const double* others_poses, double depth
    ) noexcept
    cdef cnp.ndarray _placed(self, object poses)
    cdef void _place(self, const double* poses) noexcept
    cdef bint _deep(self, const double* poses, Py_ssize_t i, Py_ssize_t j, double depth) noexcept
    cdef bint _deep_beside(
        self, const double* poses, Py_ssize_t k, ConvexSets others, const double* others_poses,
        Py_ssize_t m, double depth
    ) noexcept
