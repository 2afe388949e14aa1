"""A hand in many configurations: kinematics, weight, and its contacts that are spheres on faces."""

cpdef enum:
    MOST_CONTACTS = 16
    MOST_PAIRS = 64


cdef class HandStates(KinematicChains):
    """A hand, and an object that stays."""

    cdef Py_ssize_t independent_count
    cdef double tolerance, max_penetration
    cdef ConvexSets links, pieces, around
    cdef BodyPairs pairs
    cdef double* coupling
    cdef double* offset
    cdef double* lower
    cdef double* upper
    cdef double* gravity
    cdef cnp.npy_intp* carriers
    cdef double* placements_of_shapes
    cdef double* piece_poses
    cdef double* piece_centers
    cdef double* around_poses
    # Room for one state.
    cdef double* positions
    cdef double* shape_poses
    cdef cnp.npy_intp* times

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
        cdef Py_ssize_t n, a, k
        KinematicChains.__init__(self, **joints)
        n = self.joint_count
        self.independent_count = a = np.shape(coupling)[1]
        self.coupling = self.reals(as_shaped(coupling, n, a))
        self.offset = self.reals(as_vector(offset, n))
        self.lower, self.upper = self.reals(as_vector(lower, n)), self.reals(as_vector(upper, n))
        self.gravity = self.reals(as_vector(gravity, 3))
        self.links, self.pieces, self.around, self.pairs = links, pieces, around, pairs
        self.carriers = self.numbers(as_integers(carriers, links.count))
        self.placements_of_shapes = self.reals(as_poses(shapes, links.count))
        self.piece_poses = self.reals(as_poses(poses, pieces.count))
        self.around_poses = self.reals(as_poses(around_poses, around.count))
        if pairs is not None and pairs.sets.count != links.count:
            raise ValueError("needs pairs of the hand's shapes")
        for k in range(links.count):
            if not 0 <= self.carriers[k] <= n:
                raise ValueError("needs joints that exist")
        self.piece_centers = self.room(3 * pieces.count)
        for k in range(pieces.count):
            move(self.piece_poses + 16 * k, pieces.centers + 3 * k, self.piece_centers + 3 * k)
        self.tolerance, self.max_penetration = tolerance, max_penetration
        self.positions, self.shape_poses = self.room(n), self.room(16 * links.count)
        self.times = self.number_room(links.count)

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
        cdef Py_ssize_t count = len(q), n = self.joint_count, size = 16 * (n + 1), s
        cdef cnp.ndarray states = as_shaped(q, count, self.independent_count)
        cdef cnp.ndarray poses = np.empty((count, n + 1, 4, 4)), weights = np.empty((count, n))
        cdef cnp.ndarray counts = np.full(count, -1, np.intp), J = np.empty((count, 6, n))
        cdef cnp.ndarray shapes = np.zeros((count, MOST_CONTACTS), np.intp)
        cdef cnp.ndarray rows = np.empty((count, MOST_CONTACTS, 6))
        cdef cnp.ndarray doubtful = np.full(count, self.pairs is not None)
        # The room for one state is shared, hence the lock of Python is kept.
        for s in range(count):
            if self._posed(data(states) + self.independent_count * s):
                memcpy(data(poses) + size * s, self.joint_poses, size * sizeof(double))
                self.columns(self.joint_poses, data(J) + 6 * n * s)
                self.weights(
                    self.joint_poses, data(J) + 6 * n * s, self.gravity, data(weights) + n * s
                )
                self._place_shapes()
                numbers_of(counts)[s] = self._contacts(
                    numbers_of(shapes) + MOST_CONTACTS * s, data(rows) + 6 * MOST_CONTACTS * s
                )
                if self.pairs is not None:
                    flags_of(doubtful)[s] = self.pairs.any_deep(
                        self.shape_poses, self.around, self.around_poses, self.max_penetration
                    )
        return counts, shapes, rows, J, weights, doubtful, poses

    cdef bint _posed(self, const double* q) noexcept:
        """Place the joints; False where one is outside its limits."""
        cdef double* position = self.positions
        cdef Py_ssize_t j, k
        for j in range(self.joint_count):
            position[j] = self.offset[j]
            for k in range(self.independent_count):
                position[j] += self.coupling[self.independent_count * j + k] * q[k]
            if not self.lower[j] <= position[j] <= self.upper[j]:
                return False
        self.place(position, self.joint_poses)
        return True

    cdef void _place_shapes(self) noexcept:
        """Place the shapes on the joints."""
        cdef Py_ssize_t k
        for k in range(self.links.count):
            chained(
                self.joint_poses + 16 * self.carriers[k], self.placements_of_shapes + 16 * k,
                self.shape_poses + 16 * k,
            )

    cdef Py_ssize_t _contacts(self, cnp.npy_intp* shapes, double* rows) noexcept:
        """Put shapes, positions and normals of contacts into places; their number, or -1."""
        cdef ConvexSets links = self.links, pieces = self.pieces
        cdef cnp.npy_intp hits[MOST_PAIRS]
        cdef double* poses = self.shape_poses
        cdef double center[3]
        cdef double gap
        cdef Py_ssize_t k, p, count = 0, found = 0, place
        cdef int touches
        memset(self.times, 0, links.count * sizeof(cnp.npy_intp))
        for k in range(links.count):
            move(poses + 16 * k, links.centers + 3 * k, center)
            for p in range(pieces.count):
                if links.kinds[k] == PLANE or may_be_deep(
                    pieces, p, self.piece_poses + 16 * p, self.piece_centers + 3 * p, links, k,
                    poses + 16 * k, center, -(self.tolerance + _ON_FACE),
                ):
                    if count == MOST_PAIRS:
                        return -1
                    hits[count] = k * pieces.count + p
                    count += 1
                    self.times[links.bodies[k]] += 1
        for place in range(count):
            p, k = hits[place] % pieces.count, hits[place] // pieces.count
            if (
                links.kinds[k] != BALL or pieces.kinds[p] != POLYTOPE
                or self.times[links.bodies[k]] != 1 or found == MOST_CONTACTS
            ):
                return -1
            touches = ball_on_face(
                pieces, p, self.piece_poses + 16 * p, links.reaches[k], poses + 16 * k,
                self.tolerance, self.max_penetration, rows + 6 * found, &gap,
            )
            if touches < 0:
                return -1
            if touches > 0:
                shapes[found] = k
                found += 1
        return found
