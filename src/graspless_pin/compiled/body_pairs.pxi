"""Pairs of convex sets that may be deep in each other, by the boxes and spheres around them.

Two sets are parted by a shift of at most some depth if their boxes, or the sphere around one and
the box around the other, are: then nothing else has to be measured.
"""

from libc.math cimport fabs, sqrt

cimport numpy as cnp


cdef double _PARALLEL = 1e-6  # squared sine of the angle between two edges


cdef class BodyPairs:
    """Some pairs of a body's sets, and each of them beside sets that stand around it."""

    cdef ConvexSets sets
    cdef Py_ssize_t count
    cdef cnp.ndarray _ones, _twos, _centers

    def __init__(self, ConvexSets sets not None, ones, twos):
        """Take the sets.

        Args:
            sets: K sets.
            ones: (P,) the first and
            twos: (P,) the second set of each pair that counts.
        """
        cdef Py_ssize_t place
        self.sets = sets
        self._ones = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(ones, cnp.NPY_INTP, 1, 1)
        self.count = self._ones.shape[0]
        self._twos = as_integers(twos, self.count)
        for place in range(self.count):
            if not (
                0 <= numbers_of(self._ones)[place] < sets.count
                and 0 <= numbers_of(self._twos)[place] < sets.count
            ):
                raise ValueError("needs sets that exist")
        self._centers = empty(sets.count, 3)

    def may_be_deep(self, poses, ConvexSets others not None, others_poses, double depth):
        """Return whether there is a pair, or a set beside one around it, that may be deep.

        Args:
            poses: (K, 4, 4).
            others: M sets around.
            others_poses: (M, 4, 4).
            depth: m, not negative.
        """
        cdef cnp.ndarray T = as_poses(poses), there = as_poses(others_poses)
        if T.shape[0] != self.sets.count or there.shape[0] != others.count:
            raise ValueError("needs one pose for each set")
        # The room for the centres is shared, hence the lock of Python is kept.
        return self.any_deep(data(T), others, data(there), depth)

    cdef bint any_deep(
        self, const double* poses, ConvexSets others, const double* others_poses, double depth
    ) noexcept:
        """Whether there is such a pair of either kind."""
        cdef Py_ssize_t place, k, m
        self._place(poses)
        for place in range(self.count):
            if self._deep(
                poses, numbers_of(self._ones)[place], numbers_of(self._twos)[place], depth
            ):
                return True
        for k in range(self.sets.count):
            for m in range(others.count):
                if self._deep_beside(poses, k, others, others_poses, m, depth):
                    return True
        return False

    cdef void _place(self, const double* poses) noexcept:
        cdef Py_ssize_t k
        for k in range(self.sets.count):
            move(poses + 16 * k, self.sets.centers + 3 * k, data(self._centers) + 3 * k)

    cdef bint _deep(
        self, const double* poses, Py_ssize_t i, Py_ssize_t j, double depth
    ) noexcept:
        cdef const double* centers = data(self._centers)
        return _may_be_deep(
            self.sets, i, poses + 16 * i, centers + 3 * i, self.sets, j, poses + 16 * j,
            centers + 3 * j, depth,
        )

    cdef bint _deep_beside(
        self, const double* poses, Py_ssize_t k, ConvexSets others, const double* others_poses,
        Py_ssize_t m, double depth
    ) noexcept:
        cdef const double* T = poses + 16 * k
        cdef const double* there = others_poses + 16 * m
        cdef const double* own = data(self._centers) + 3 * k
        cdef double center[3]
        if others.kinds[m] == PLANE:
            return _deep_in_plane(self.sets, k, T, own, others.planes + 4 * m, there, depth)
        move(there, others.centers + 3 * m, center)
        return _may_be_deep(self.sets, k, T, own, others, m, there, center, depth)


cdef bint _deep_in_plane(
    ConvexSets sets, Py_ssize_t k, const double* T, const double* center, const double* plane,
    const double* T_plane, double depth
) noexcept nogil:
    """Whether a set may reach deeper than a depth into a half-space."""
    cdef double normal[3]
    cdef double local[3]
    cdef double height, reach = 0.0
    cdef int i
    for i in range(3):
        normal[i] = dot(T_plane + 4 * i, plane)
    height = dot(normal, center) - plane[3]
    for i in range(3):
        height -= normal[i] * T_plane[4 * i + 3]
    turn_back(T, normal, local)
    for i in range(3):
        reach += fabs(local[i]) * sets.halves[3 * k + i]
    return min(reach, sets.reaches[k]) - height > depth


cdef bint _from_box_by(double reach, const double* local, const double* half) noexcept nogil:
    """Whether a point is outside a box about the origin, and as far from it as some reach."""
    cdef double over, total = 0.0
    cdef int i
    for i in range(3):
        over = fabs(local[i]) - half[i]
        if over > 0.0:
            total += over * over
    return total > 0.0 and (reach <= 0.0 or total >= reach * reach)


cdef bint _may_be_deep(
    ConvexSets ones, Py_ssize_t p, const double* T, const double* center, ConvexSets others,
    Py_ssize_t k, const double* T_other, const double* other_center, double depth
) noexcept nogil:
    """Whether two bounded sets may overlap by more than a depth."""
    cdef const double* half = ones.halves + 3 * p
    cdef const double* other_half = others.halves + 3 * k
    cdef double offset[3]
    cdef double local[3]
    cdef double beyond[3]
    cdef double R[9]
    cdef double S[9]
    cdef double gap, reach, along, sine
    cdef int i, j, i1, i2, j1, j2
    for i in range(3):
        offset[i] = other_center[i] - center[i]
    reach = ones.reaches[p] + others.reaches[k] - depth
    if reach <= 0.0 or dot(offset, offset) >= reach * reach:
        return False
    turn_back(T, offset, local)
    if _from_box_by(others.reaches[k] - depth, local, half):
        return False
    turn_back(T_other, offset, beyond)
    if _from_box_by(ones.reaches[p] - depth, beyond, other_half):
        return False
    for i in range(3):
        for j in range(3):
            R[3 * i + j] = (
                T[i] * T_other[j] + T[4 + i] * T_other[4 + j] + T[8 + i] * T_other[8 + j]
            )
            S[3 * i + j] = fabs(R[3 * i + j])
    for i in range(3):
        reach = half[i] + dot(S + 3 * i, other_half)
        if reach - fabs(local[i]) <= depth:
            return False
        reach = other_half[i] + S[i] * half[0] + S[3 + i] * half[1] + S[6 + i] * half[2]
        if reach - fabs(beyond[i]) <= depth:
            return False
    # Along the common normals of an edge of one box and one of the other.
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            sine = 1.0 - R[3 * i + j] * R[3 * i + j]
            if sine <= _PARALLEL:
                continue
            along = fabs(local[i2] * R[3 * i1 + j] - local[i1] * R[3 * i2 + j])
            reach = half[i1] * S[3 * i2 + j] + half[i2] * S[3 * i1 + j]
            reach += other_half[j1] * S[3 * i + j2] + other_half[j2] * S[3 * i + j1]
            gap = along - reach
            if -gap <= depth * sqrt(sine):
                return False
    return True
