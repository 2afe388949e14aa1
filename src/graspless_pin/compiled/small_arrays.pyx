# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Checks of small arrays, and the tangents of a few contacts."""

from libc.math cimport fabs, isfinite, sqrt
from libc.string cimport memcpy

cimport numpy as cnp

from graspless_pin.compiled.shared cimport (
    as_reals, as_shaped, as_vector, data, dot, empty, empty3,
)

cnp.import_array()

cdef double _NEARLY_PARALLEL = 0.99  # as in `cones`


def tangents(normals, axes):
    """(M, 3, 2) tangents, see `projected_tangents`; `axes` is a sequence of (3,) arrays."""
    cdef cnp.ndarray inward = as_reals(normals, 2)
    cdef Py_ssize_t count = inward.shape[0], k
    inward = as_shaped(inward, count, 3)
    cdef cnp.ndarray frames = empty3(count, 3, 2)
    cdef list directions = [as_vector(axis, 3) for axis in axes]
    cdef cnp.ndarray given = empty(len(directions), 3)
    for k in range(len(directions)):
        memcpy(data(given) + 3 * k, data(<cnp.ndarray>directions[k]), 3 * sizeof(double))
    tangents_of(count, data(inward), len(directions), data(given), data(frames))
    return frames


cdef void tangents_of(
    Py_ssize_t count, const double* normals, Py_ssize_t axis_count, const double* axes,
    double* frames
) noexcept nogil:
    """Put what `tangents` returns into a place."""
    cdef const double* n
    cdef const double* a
    cdef double* out
    cdef double t[3]
    cdef double along, length
    cdef Py_ssize_t k, axis
    cdef int i
    for k in range(count):
        n, out = normals + 3 * k, frames + 6 * k
        length = 0.0
        for axis in range(axis_count):
            a = axes + 3 * axis
            along = dot(a, n)
            if fabs(along) <= _NEARLY_PARALLEL * sqrt(dot(a, a)):
                for i in range(3):
                    t[i] = a[i] - along * n[i]
                length = sqrt(dot(t, t))
                if length > 0.0:
                    break
        if not length > 0.0:
            if fabs(n[1]) > _NEARLY_PARALLEL:
                t[0], t[1], t[2] = 0.0, n[2], -n[1]
            else:
                t[0], t[1], t[2] = -n[2], 0.0, n[0]
            length = sqrt(dot(t, t))
            if length == 0.0:  # a normal of no length is refused elsewhere
                length = 1.0
        for i in range(3):
            t[i] /= length
            out[2 * i] = t[i]
        out[1] = n[1] * t[2] - n[2] * t[1]
        out[3] = n[2] * t[0] - n[0] * t[2]
        out[5] = n[0] * t[1] - n[1] * t[0]


def all_finite(arrays):
    """Whether every entry of every array is finite."""
    cdef cnp.ndarray array
    cdef Py_ssize_t k
    for item in arrays:
        array = as_reals(item, 0)
        for k in range(cnp.PyArray_SIZE(array)):
            if not isfinite(data(array)[k]):
                return False
    return True


def all_within(arrays, double most):
    """Whether every entry of every array is a number of at most this magnitude."""
    cdef cnp.ndarray array
    cdef Py_ssize_t k
    for item in arrays:
        array = as_reals(item, 0)
        for k in range(cnp.PyArray_SIZE(array)):
            # Not a number is within no bounds.
            if not fabs(data(array)[k]) <= most:
                return False
    return True


def seal(arrays):
    """Make arrays read-only."""
    for item in arrays:
        cnp.PyArray_CLEARFLAGS(<cnp.ndarray?>item, cnp.NPY_ARRAY_WRITEABLE)


def in_order(arrays, bint strictly):
    """Whether all entries of an array are below those of the next one, or equal if not strictly."""
    cdef cnp.ndarray before = None, after
    cdef Py_ssize_t k
    for item in arrays:
        after = as_reals(item, 0)
        if before is not None:
            if cnp.PyArray_SIZE(before) != cnp.PyArray_SIZE(after):
                raise ValueError("needs arrays of one size")
            for k in range(cnp.PyArray_SIZE(after)):
                if not (
                    data(before)[k] < data(after)[k]
                    or (not strictly and data(before)[k] == data(after)[k])
                ):
                    return False
        before = after
    return True
