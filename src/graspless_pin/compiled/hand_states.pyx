# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""A hand in many configurations: kinematics, weight, and its contacts that are spheres on faces."""

from libc.math cimport cos, sin
from libc.string cimport memset

cimport numpy as cnp

from graspless_pin.compiled.contact_search cimport ConvexSets, ball_on_face, near_boxes
from graspless_pin.compiled.shared cimport (
    as_integers, as_poses, as_reals, as_shaped, as_vector, chained, data, empty, empty3, move,
    no_numbers, numbers_of, turn,
)

from graspless_pin.compiled.contact_search import BALL, POLYTOPE

cnp.import_array()

cpdef enum:
    MOST_CONTACTS = 16
    MOST_PAIRS = 64

cdef int _BALL = BALL
cdef int _POLYTOPE = POLYTOPE


cdef class HandStates:
    """A hand whose joints turn about an axis or move along one, and an object that stays."""

    cdef Py_ssize_t n, a, K, P
    cdef double tolerance, max_penetration
    cdef ConvexSets links, pieces
    cdef cnp.ndarray _parents, _placements, _axes, _coupling, _offset, _lower, _upper, _masses
    cdef cnp.ndarray _centers, _gravity, _carriers, _shapes, _poses
    cdef cnp.ndarray _at, _T, _links, _moments, _times

    def __init__(
        self, parents, placements, axes, coupling, offset, lower, upper, masses, centers, gravity,
        carriers, shapes, ConvexSets links not None, ConvexSets pieces not None, poses,
        double tolerance, double max_penetration,
    ):
        """Take the hand and the object.

        Args:
            parents: (n + 1,) the joint before each, all but the base behind their own.
            placements: (n + 1, 4, 4) pose of each in the frame of the one before.
            axes: (n, 6) unit direction [v; omega] of each in its own frame; half of it is zero.
            coupling: (n, a) matrix and
            offset: (n,) offset from positions of independent joints to those of all.
            lower: (n,) lowest and
            upper: (n,) highest positions, rad or m.
            masses: (n + 1,) mass that each joint carries, kg, and
            centers: (n + 1, 3) its centre in the joint's frame, m.
            gravity: (3,) m/s^2; zeros: the hand's own weight does not count.
            carriers: (K,) joint that carries each collision shape.
            shapes: (K, 4, 4) pose of each in the frame of that joint.
            links: The K shapes.
            pieces: The P pieces of the object.
            poses: (P, 4, 4) their poses.
            tolerance: Largest gap of a contact, m.
            max_penetration: Largest overlap, m.
        """
        cdef Py_ssize_t k
        self._axes = as_reals(axes, 2)
        self.n = self._axes.shape[0]
        self._axes = as_shaped(axes, self.n, 6)
        self._parents = as_integers(parents, self.n + 1)
        self._placements, self._coupling = as_poses(placements), as_reals(coupling, 2)
        self.a = self._coupling.shape[1]
        self._coupling = as_shaped(coupling, self.n, self.a)
        self._offset, self._lower = as_vector(offset, self.n), as_vector(lower, self.n)
        self._upper, self._masses = as_vector(upper, self.n), as_vector(masses, self.n + 1)
        self._centers, self._gravity = as_shaped(centers, self.n + 1, 3), as_vector(gravity, 3)
        self.links, self.pieces, self.K, self.P = links, pieces, links.count, pieces.count
        self._carriers, self._shapes = as_integers(carriers, self.K), as_poses(shapes)
        self._poses = as_poses(poses)
        if (
            self._placements.shape[0] != self.n + 1 or self._shapes.shape[0] != self.K
            or self._poses.shape[0] != self.P
        ):
            raise ValueError("needs one pose for each joint, shape and piece")
        for k in range(self.n):
            if not 0 <= numbers_of(self._parents)[k + 1] <= k:
                raise ValueError("needs parents before their children")
        for k in range(self.K):
            if not 0 <= numbers_of(self._carriers)[k] <= self.n:
                raise ValueError("needs joints that exist")
        self.tolerance, self.max_penetration = tolerance, max_penetration
        self._at, self._T = empty(1, self.n + 1), empty3(self.n + 1, 4, 4)
        self._links, self._moments = empty3(self.K, 4, 4), empty(self.n + 1, 4)
        self._times = no_numbers(self.K)

    def at(self, q):
        """Find what loops need of configurations.

        Args:
            q: (S, a) positions of the independent joints, rad or m.

        Returns:
            (S,) numbers of contacts, -1 where other loops have to find them or a joint is outside
            its limits; (S, MOST_CONTACTS) the shape of each, (S, MOST_CONTACTS, 6) positions and
            normals into the object; (S, 6, n) spatial joint columns about the world's origin, and
            (S, n) torques that carry the weight.
        """
        cdef cnp.ndarray states = as_reals(q, 2)
        cdef Py_ssize_t count = states.shape[0], s
        states = as_shaped(q, count, self.a)
        cdef cnp.npy_intp shape[2]
        shape[0], shape[1] = count, MOST_CONTACTS
        cdef cnp.ndarray counts = <cnp.ndarray>cnp.PyArray_EMPTY(1, shape, cnp.NPY_INTP, 0)
        cdef cnp.ndarray shapes = <cnp.ndarray>cnp.PyArray_ZEROS(2, shape, cnp.NPY_INTP, 0)
        cdef cnp.ndarray rows = empty3(count, MOST_CONTACTS, 6), J = empty3(count, 6, self.n)
        cdef cnp.ndarray weights = empty(count, self.n)
        cdef cnp.npy_intp* found = numbers_of(counts)
        cdef cnp.npy_intp* own = numbers_of(shapes)
        # The room for one state is shared, hence the lock of Python is kept.
        for s in range(count):
            found[s] = -1
            if self._posed(data(states) + self.a * s):
                self._columns(data(J) + 6 * self.n * s)
                self._weights(data(J) + 6 * self.n * s, data(weights) + self.n * s)
                found[s] = self._contacts(
                    own + MOST_CONTACTS * s, data(rows) + 6 * MOST_CONTACTS * s
                )
        return counts, shapes, rows, J, weights

    cdef bint _posed(self, const double* q) noexcept:
        """Place the joints; False where one is outside its limits."""
        cdef double* position = data(self._at)
        cdef double* T
        cdef const double* axis
        cdef double step[16]
        cdef double fixed[16]
        cdef double c, s
        cdef Py_ssize_t j, k
        cdef int i
        T = data(self._T)
        memset(T, 0, 16 * sizeof(double))
        T[0] = T[5] = T[10] = T[15] = 1.0
        for j in range(self.n):
            position[j] = data(self._offset)[j]
            for k in range(self.a):
                position[j] += data(self._coupling)[self.a * j + k] * q[k]
            if not data(self._lower)[j] <= position[j] <= data(self._upper)[j]:
                return False
        for j in range(self.n):
            axis = data(self._axes) + 6 * j
            memset(step, 0, 16 * sizeof(double))
            c, s = 1.0, 0.0
            if axis[3] != 0.0 or axis[4] != 0.0 or axis[5] != 0.0:
                c, s = cos(position[j]), sin(position[j])
            for i in range(3):
                for k in range(3):
                    step[4 * i + k] = (1.0 - c) * axis[3 + i] * axis[3 + k]
                step[4 * i + i] += c
                step[4 * i + 3] = position[j] * axis[i]
            step[1] -= s * axis[5]
            step[2] += s * axis[4]
            step[4] += s * axis[5]
            step[6] -= s * axis[3]
            step[8] -= s * axis[4]
            step[9] += s * axis[3]
            step[15] = 1.0
            chained(
                data(self._T) + 16 * numbers_of(self._parents)[j + 1],
                data(self._placements) + 16 * (j + 1), fixed,
            )
            chained(fixed, step, data(self._T) + 16 * (j + 1))
        return True

    cdef void _columns(self, double* J) noexcept:
        """Put the spatial joint columns into a place."""
        cdef const double* T
        cdef double v[3]
        cdef double w[3]
        cdef Py_ssize_t j, n = self.n
        for j in range(n):
            T = data(self._T) + 16 * (j + 1)
            turn(T, data(self._axes) + 6 * j, v)
            turn(T, data(self._axes) + 6 * j + 3, w)
            J[j] = v[0] + T[7] * w[2] - T[11] * w[1]
            J[n + j] = v[1] + T[11] * w[0] - T[3] * w[2]
            J[2 * n + j] = v[2] + T[3] * w[1] - T[7] * w[0]
            J[3 * n + j], J[4 * n + j], J[5 * n + j] = w[0], w[1], w[2]

    cdef void _weights(self, const double* J, double* torques) noexcept:
        """Put the torques that carry the weight into a place."""
        cdef double* moment = data(self._moments)
        cdef const double* g = data(self._gravity)
        cdef double x[3]
        cdef double m
        cdef Py_ssize_t j, n = self.n
        cdef int i
        for j in range(1, n + 1):
            m = data(self._masses)[j]
            move(data(self._T) + 16 * j, data(self._centers) + 3 * j, x)
            moment[4 * j] = m
            for i in range(3):
                moment[4 * j + 1 + i] = m * x[i]
        for j in range(n, 0, -1):
            if numbers_of(self._parents)[j] > 0:
                for i in range(4):
                    moment[4 * numbers_of(self._parents)[j] + i] += moment[4 * j + i]
        for j in range(n):
            m = moment[4 * j + 4]
            for i in range(3):
                x[i] = moment[4 * j + 5 + i]
            torques[j] = -(
                m * (g[0] * J[j] + g[1] * J[n + j] + g[2] * J[2 * n + j])
                + J[3 * n + j] * (x[1] * g[2] - x[2] * g[1])
                + J[4 * n + j] * (x[2] * g[0] - x[0] * g[2])
                + J[5 * n + j] * (x[0] * g[1] - x[1] * g[0])
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
            chained(
                data(self._T) + 16 * numbers_of(self._carriers)[k], data(self._shapes) + 16 * k,
                poses + 16 * k,
            )
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
                links.kinds[k] != _BALL or pieces.kinds[p] != _POLYTOPE
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
