"""Pairs of convex sets that may be deep in each other, by the boxes and spheres around them.

Two sets are parted by a shift of at most some depth if their boxes, or the sphere around one and
the box around the other, are: then nothing else has to be measured. Around what is revolved the box
is a cylinder.
"""

cdef double _PARALLEL = 1e-6  # squared sine of the angle between two edges


cdef class BodyPairs(KeptArrays):
    """Some pairs of a body's sets, and each of them beside sets that stand around it."""

    cdef ConvexSets sets
    cdef Py_ssize_t count
    cdef cnp.npy_intp* ones
    cdef cnp.npy_intp* twos
    cdef double* centers

    def __init__(self, ConvexSets sets not None, ones, twos):
        """Take the sets.

        Args:
            sets: K sets.
            ones: (P,) the first and
            twos: (P,) the second set of each pair that counts.
        """
        cdef Py_ssize_t place
        self.sets, self.count = sets, len(ones)
        self.ones = self.numbers(as_integers(ones, self.count))
        self.twos = self.numbers(as_integers(twos, self.count))
        for place in range(self.count):
            if not (0 <= self.ones[place] < sets.count and 0 <= self.twos[place] < sets.count):
                raise ValueError("needs sets that exist")
        self.centers = self.room(3 * sets.count)

    cdef bint any_deep(
        self, const double* poses, ConvexSets others, const double* others_poses, double depth
    ) noexcept:
        """Whether there is a pair, or a set beside one around it, that may be deep.

        Args:
            poses: (K, 4, 4).
            others: M sets around.
            others_poses: (M, 4, 4).
            depth: m, not negative.
        """
        cdef ConvexSets sets = self.sets
        cdef Py_ssize_t place, i, k, m
        cdef const double* there
        cdef double center[3]
        for k in range(sets.count):
            move(poses + 16 * k, sets.centers + 3 * k, self.centers + 3 * k)
        for place in range(self.count):
            i, k = self.ones[place], self.twos[place]
            if may_be_deep(
                sets, i, poses + 16 * i, self.centers + 3 * i, sets, k, poses + 16 * k,
                self.centers + 3 * k, depth,
            ):
                return True
        for m in range(others.count):
            there = others_poses + 16 * m
            move(there, others.centers + 3 * m, center)
            for k in range(sets.count):
                if _deep_in_plane(
                    sets, k, poses + 16 * k, self.centers + 3 * k, others.planes + 4 * m, there,
                    depth,
                ) if others.kinds[m] == PLANE else may_be_deep(
                    sets, k, poses + 16 * k, self.centers + 3 * k, others, m, there, center, depth
                ):
                    return True
        return False


cdef double _reach_along(ConvexSets sets, Py_ssize_t k, const double* sizes) noexcept nogil:
    """Most that a bounded set reaches from its centre; sizes of a direction along its axes."""
    cdef const double* half = sets.halves + 3 * k
    if sets.kinds[k] == REVOLVED:
        return sqrt(sizes[0] * sizes[0] + sizes[1] * sizes[1]) * half[0] + sizes[2] * half[2]
    return dot(sizes, half)


cdef bint _deep_in_plane(
    ConvexSets sets, Py_ssize_t k, const double* T, const double* center, const double* plane,
    const double* T_plane, double depth
) noexcept nogil:
    """Whether a set may reach deeper than a depth into a half-space."""
    cdef double normal[3]
    cdef double local[3]
    cdef double height
    cdef int i
    for i in range(3):
        normal[i] = dot(T_plane + 4 * i, plane)
    height = dot(normal, center) - plane[3]
    for i in range(3):
        height -= normal[i] * T_plane[4 * i + 3]
    turn_back(T, normal, local)
    for i in range(3):
        local[i] = fabs(local[i])
    return min(_reach_along(sets, k, local), sets.reaches[k]) - height > depth


cdef bint _from_box_by(double reach, const double* local, const double* half) noexcept nogil:
    """Whether a point is outside a box about the origin, and as far from it as some reach."""
    cdef double over, total = 0.0
    cdef int i
    for i in range(3):
        over = fabs(local[i]) - half[i]
        if over > 0.0:
            total += over * over
    return total > 0.0 and (reach <= 0.0 or total >= reach * reach)


cdef bint may_be_deep(
    ConvexSets ones, Py_ssize_t p, const double* T, const double* center, ConvexSets others,
    Py_ssize_t k, const double* T_other, const double* other_center, double depth
) noexcept nogil:
    """Whether two bounded sets may overlap by more than a depth; negative: be nearer than that."""
    cdef const double* half = ones.halves + 3 * p
    cdef const double* other_half = others.halves + 3 * k
    cdef double offset[3]
    cdef double local[3]
    cdef double beyond[3]
    cdef double R[9]
    cdef double S[9]
    cdef double turned[9]
    cdef double sizes[3]
    cdef double other_sizes[3]
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
            S[3 * i + j] = turned[3 * j + i] = fabs(R[3 * i + j])
    for i in range(3):
        reach = half[i] + _reach_along(others, k, S + 3 * i)
        if reach - fabs(local[i]) <= depth:
            return False
        reach = other_half[i] + _reach_along(ones, p, turned + 3 * i)
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
            sizes[i], sizes[i1], sizes[i2] = 0.0, S[3 * i2 + j], S[3 * i1 + j]
            other_sizes[j], other_sizes[j1], other_sizes[j2] = 0.0, S[3 * i + j2], S[3 * i + j1]
            reach = _reach_along(ones, p, sizes) + _reach_along(others, k, other_sizes)
            gap = along - reach
            if -gap <= depth * sqrt(sine):
                return False
    return True
