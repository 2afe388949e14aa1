# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Checks of small arrays and tuples, and positions and tangents of a few contacts."""

from libc.math cimport INFINITY, fabs, isfinite, sqrt
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


def about(points, center):
    """(M, 3) points (M, 3) seen from a center (3,)."""
    cdef cnp.ndarray at = as_reals(points, 2), origin = as_vector(center, 3)
    cdef Py_ssize_t count = at.shape[0], k
    at = as_shaped(at, count, 3)
    cdef cnp.ndarray seen = empty(count, 3)
    for k in range(3 * count):
        data(seen)[k] = data(at)[k] - data(origin)[k % 3]
    return seen


def stacked(first, second):
    """(M + N, 3) the rows of two arrays."""
    cdef cnp.ndarray one = as_reals(first, 2), two = as_reals(second, 2)
    cdef Py_ssize_t M = one.shape[0], N = two.shape[0]
    one, two = as_shaped(one, M, 3), as_shaped(two, N, 3)
    cdef cnp.ndarray both = empty(M + N, 3)
    memcpy(data(both), data(one), 3 * M * sizeof(double))
    memcpy(data(both) + 3 * M, data(two), 3 * N * sizeof(double))
    return both


def are_same(tuple ones, tuple others):
    """Whether two tuples hold the same objects, or equal numbers and texts, see `Latest`."""
    cdef Py_ssize_t k, count = len(ones)
    if len(others) != count:
        return False
    for k in range(count):
        if ones[k] is others[k]:
            continue
        kind = type(ones[k])
        if kind is not type(others[k]):
            return False
        if kind is float:
            if repr(ones[k]) != repr(others[k]):
                return False
        elif not (kind is int or kind is str or kind is bool or kind is bytes):
            return False
        elif ones[k] != others[k]:
            return False
    return True


def are_possible(arrays, friction, wrench, lower, upper, double most, double most_load):
    """Whether a problem's numbers are possible ones, see `problem_of_own_arrays`."""
    cdef cnp.ndarray mu = as_reals(friction, 1), load = as_vector(wrench, 6)
    cdef cnp.ndarray least = as_reals(lower, 1), largest = as_vector(upper, least.shape[0])
    cdef Py_ssize_t k
    for k in range(mu.shape[0]):
        if not data(mu)[k] >= 0.0:
            return False
    for k in range(3):
        if not fabs(data(load)[k]) <= most_load:
            return False
    for k in range(least.shape[0]):
        if not (
            data(least)[k] <= data(largest)[k]
            and data(least)[k] < INFINITY
            and data(largest)[k] > -INFINITY
        ):
            return False
    return all_within(arrays, most)


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
