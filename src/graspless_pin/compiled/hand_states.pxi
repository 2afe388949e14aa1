"""A hand in many configurations: kinematics, weight, and its contacts that are spheres on faces."""

from libc.string cimport memcpy

cimport numpy as cnp


cpdef enum:
    MOST_CONTACTS = 16
    MOST_PAIRS = 64


cdef class HandStates(KinematicChains):
    """A hand, and an object that stays."""

    cdef Py_ssize_t a, K, P
    cdef double tolerance, max_penetration
    cdef ConvexSets links, pieces, around
    cdef BodyPairs pairs
    cdef cnp.ndarray _coupling, _offset, _lower, _upper, _gravity, _carriers, _shapes, _poses
    cdef cnp.ndarray _at, _links, _times, _around_poses

    def __init__(
        self, *, coupling, offset, lower, upper, gravity, carriers, shapes,
        ConvexSets links not None, ConvexSets pieces not None, poses, BodyPairs pairs,
        ConvexSets around not None, around_poses, double tolerance, double max_penetration,
        **joints,
    ):
        """Take the hand and the object.

        Args:
            coupling: (n, a) matrix and
            offset: (n,) offset from positions of independent joints to those of all.
            lower: (n,) lowest and
            upper: (n,) highest positions, rad or m.
            gravity: (3,) m/s^2; zeros: the hand's own weight does not count.
            carriers: (K,) joint that carries each collision shape.
            shapes: (K, 4, 4) pose of each in the frame of that joint.
            links: The K shapes.
            pieces: The P pieces of the object.
            poses: (P, 4, 4) their poses.
            pairs: Pairs of the shapes that may not be in each other, nor any of them in
            around: the sets that stand around; None: they may.
            around_poses: (M, 4, 4) the poses of these.
            tolerance: Largest gap of a contact, m.
            max_penetration: Largest overlap, m.
            joints: See `KinematicChains`.
        """
        cdef Py_ssize_t k
        KinematicChains.__init__(self, **joints)
        self._coupling = as_reals(coupling, 2)
        self.a = self._coupling.shape[1]
        self._coupling = as_shaped(coupling, self.n, self.a)
        self._offset, self._lower = as_vector(offset, self.n), as_vector(lower, self.n)
        self._upper, self._gravity = as_vector(upper, self.n), as_vector(gravity, 3)
        self.links, self.pieces, self.K, self.P = links, pieces, links.count, pieces.count
        self._carriers, self._shapes = as_integers(carriers, self.K), as_poses(shapes)
        self._poses = as_poses(poses)
        self.pairs, self.around, self._around_poses = pairs, around, as_poses(around_poses)
        if (
            self._shapes.shape[0] != self.K or self._poses.shape[0] != self.P
            or self._around_poses.shape[0] != around.count
        ):
            raise ValueError("needs one pose for each shape and piece")
        if pairs is not None and pairs.sets.count != self.K:
            raise ValueError("needs pairs of the hand's shapes")
        for k in range(self.K):
            if not 0 <= numbers_of(self._carriers)[k] <= self.n:
                raise ValueError("needs joints that exist")
        self.tolerance, self.max_penetration = tolerance, max_penetration
        self._at, self._links = empty(1, self.n + 1), empty3(self.K, 4, 4)
        self._times = no_numbers(self.K)

    def at(self, q):
        """Find what loops need of configurations.

        Args:
            q: (S, a) positions of the independent joints, rad or m.

        Returns:
            (S,) numbers of contacts, -1 where other loops have to find them or a joint is outside
            its limits; (S, MOST_CONTACTS) the shape of each, (S, MOST_CONTACTS, 6) positions and
            normals into the object; (S, 6, n) spatial joint columns about the world's origin;
            (S, n) torques that carry the weight; (S,) whether the hand may be deeper in itself or
            in what stands around than ``max_penetration``: False proves that it is not, wherever
            contacts have to be found; and (S, n + 1, 4, 4) poses of the joints, the base first.
        """
        cdef cnp.ndarray states = as_reals(q, 2)
        cdef Py_ssize_t count = states.shape[0], s
        states = as_shaped(q, count, self.a)
        cdef Py_ssize_t size = 16 * (self.n + 1)
        cdef cnp.npy_intp shape[4]
        shape[0], shape[1] = count, self.n + 1
        shape[2] = shape[3] = 4
        cdef cnp.ndarray poses = <cnp.ndarray>cnp.PyArray_EMPTY(4, shape, cnp.NPY_DOUBLE, 0)
        shape[1] = MOST_CONTACTS
        cdef cnp.ndarray counts = <cnp.ndarray>cnp.PyArray_EMPTY(1, shape, cnp.NPY_INTP, 0)
        cdef cnp.ndarray shapes = <cnp.ndarray>cnp.PyArray_ZEROS(2, shape, cnp.NPY_INTP, 0)
        cdef cnp.ndarray rows = empty3(count, MOST_CONTACTS, 6), J = empty3(count, 6, self.n)
        cdef cnp.ndarray weights = empty(count, self.n)
        cdef cnp.ndarray doubtful = <cnp.ndarray>cnp.PyArray_ZEROS(1, shape, cnp.NPY_BOOL, 0)
        cdef cnp.npy_intp* found = numbers_of(counts)
        cdef cnp.npy_intp* own = numbers_of(shapes)
        # The room for one state is shared, hence the lock of Python is kept.
        for s in range(count):
            found[s] = -1
            flags_of(doubtful)[s] = self.pairs is not None
            if self._posed(data(states) + self.a * s):
                memcpy(data(poses) + size * s, data(self._T), size * sizeof(double))
                self.columns(data(self._T), data(J) + 6 * self.n * s)
                self.weights(
                    data(self._T), data(J) + 6 * self.n * s, data(self._gravity),
                    data(weights) + self.n * s,
                )
                self._place_shapes()
                found[s] = self._contacts(
                    own + MOST_CONTACTS * s, data(rows) + 6 * MOST_CONTACTS * s
                )
                if self.pairs is not None:
                    flags_of(doubtful)[s] = self.pairs.any_deep(
                        data(self._links), self.around, data(self._around_poses),
                        self.max_penetration,
                    )
        return counts, shapes, rows, J, weights, doubtful, poses

    cdef bint _posed(self, const double* q) noexcept:
        """Place the joints; False where one is outside its limits."""
        cdef double* position = data(self._at)
        cdef Py_ssize_t j, k
        for j in range(self.n):
            position[j] = data(self._offset)[j]
            for k in range(self.a):
                position[j] += data(self._coupling)[self.a * j + k] * q[k]
            if not data(self._lower)[j] <= position[j] <= data(self._upper)[j]:
                return False
        self.place(position, data(self._T))
        return True

    cdef void _place_shapes(self) noexcept:
        """Place the shapes on the joints."""
        cdef Py_ssize_t k
        for k in range(self.K):
            chained(
                data(self._T) + 16 * numbers_of(self._carriers)[k], data(self._shapes) + 16 * k,
                data(self._links) + 16 * k,
            )

    cdef Py_ssize_t _contacts(self, cnp.npy_intp* shapes, double* rows) noexcept:
        """Put shapes, positions and normals of contacts into places; their number, or -1."""
        cdef ConvexSets links = self.links, pieces = self.pieces
        cdef cnp.npy_intp* times = numbers_of(self._times)
        cdef cnp.npy_intp hits[MOST_PAIRS]
        cdef double* poses = data(self._links)
        cdef double center[3]
        cdef double gap
        cdef Py_ssize_t k, p, count = 0, found = 0, place
        cdef int touches
        for k in range(self.K):
            times[k] = 0
        for k in range(self.K):
            move(poses + 16 * k, links.centers + 3 * k, center)
            for p in range(self.P):
                if near_boxes(
                    pieces, p, data(self._poses) + 16 * p, links, k, poses + 16 * k, center,
                    self.tolerance,
                ):
                    if count == MOST_PAIRS:
                        return -1
                    hits[count] = k * self.P + p
                    count += 1
                    times[links.bodies[k]] += 1
        for place in range(count):
            p, k = hits[place] % self.P, hits[place] // self.P
            if (
                links.kinds[k] != BALL or pieces.kinds[p] != POLYTOPE
                or times[links.bodies[k]] != 1 or found == MOST_CONTACTS
            ):
                return -1
            touches = ball_on_face(
                pieces, p, data(self._poses) + 16 * p, links.reaches[k], poses + 16 * k,
                self.tolerance, self.max_penetration, rows + 6 * found, &gap,
            )
            if touches < 0:
                return -1
            if touches > 0:
                shapes[found] = k
                found += 1
        return found
