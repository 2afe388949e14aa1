"""A hand that carries its object along: what bears on both in many configurations."""

from libc.string cimport memcpy

cimport numpy as cnp


cdef class CarriedStates(HandStates):
    """A hand and an object that move with one joint.

    Seen from that joint, the contacts stay where they are, and so does what they do at the joints
    behind it. The load turns; and the joints before it bear hand and object, whatever the contact
    forces are that balance the load.
    """

    cdef Py_ssize_t _joint, M, L
    cdef cnp.ndarray _carries, _motors, _center, _wrench, _own_wrench, _row, _torques

    def __init__(
        self, *, Py_ssize_t joint, carries, motors, center, wrench, own_wrench, row, **hand
    ):
        """Take the hand, its object and the loads.

        Args:
            joint: The one that carries the object.
            carries: (n,) one where a joint moves that one, else zero.
            motors: (n, L) the torques of the joints become those of the actuators by it.
            center: (3,) what wrenches are about, in the frame of the joint, m.
            wrench: (6,) on the object, world axes, N and N m.
            own_wrench: (6,) what is added to it, in the axes of the joint.
            row: (2M + 6 + 3L,) see `LoadedStates.optima`, with what no state changes: the wrench
                does not count, and what the weight takes is added to the torques that stand there.
            hand: See `HandStates`.
        """
        HandStates.__init__(self, **hand)
        self._motors = as_reals(motors, 2)
        self.L = self._motors.shape[1]
        self._motors, self._carries = as_shaped(motors, self.n, self.L), as_vector(carries, self.n)
        self._center, self._wrench = as_vector(center, 3), as_vector(wrench, 6)
        self._own_wrench, self._row = as_vector(own_wrench, 6), as_reals(row, 1)
        self.M = (self._row.shape[0] - 6 - 3 * self.L) // 2
        if self.M < 0 or self._row.shape[0] != 2 * self.M + 6 + 3 * self.L:
            raise ValueError("needs a row of loads")
        if not 0 < joint <= self.n:
            raise ValueError("needs a joint that exists")
        self._joint, self._torques = joint, empty1(self.n)

    def loads(self, q):
        """Find what bears on the contacts of configurations.

        Args:
            q: (S, a) positions of the independent joints, rad or m.

        Returns:
            (S, 2M + 6 + 3L) rows in the axes of the joint, see `LoadedStates.optima`; (S,) whether
            all joints are within their limits: else there is no row; and (S,) whether bodies may be
            in each other: see `HandStates.at`.
        """
        cdef cnp.ndarray states = as_reals(q, 2)
        cdef Py_ssize_t count = states.shape[0], width = self._row.shape[0], s
        states = as_shaped(q, count, self.a)
        cdef cnp.npy_intp length = count
        cdef cnp.ndarray rows = empty(count, width)
        cdef cnp.ndarray within = <cnp.ndarray>cnp.PyArray_ZEROS(1, &length, cnp.NPY_BOOL, 0)
        cdef cnp.ndarray doubtful = <cnp.ndarray>cnp.PyArray_ZEROS(1, &length, cnp.NPY_BOOL, 0)
        # The room for one state is shared, hence the lock of Python is kept.
        for s in range(count):
            memcpy(data(rows) + width * s, data(self._row), width * sizeof(double))
            if not self._posed(data(states) + self.a * s):
                continue
            flags_of(within)[s] = True
            self._bear(data(rows) + width * s)
            if self.pairs is not None:
                self._place_shapes()
                flags_of(doubtful)[s] = self.pairs.any_deep(
                    data(self._links), self.around, data(self._around_poses), self.max_penetration
                )
        return rows, within, doubtful

    cdef void _bear(self, double* row) noexcept:
        """Put the wrench, and the torques that no contact force changes, into a row."""
        cdef const double* T = data(self._T) + 16 * self._joint
        cdef const double* J = data(self._J)
        cdef double* torque = data(self._torques)
        cdef double* load = row + self.M
        cdef double center[3]
        cdef double world[6]
        cdef Py_ssize_t n = self.n, L = self.L, j, k
        cdef int i
        self.columns(data(self._T), data(self._J))
        self.weights(data(self._T), J, data(self._gravity), torque)
        for i in range(0, 6, 3):
            turn(T, data(self._own_wrench) + i, world + i)
            turn_back(T, data(self._wrench) + i, load + i)
        for i in range(6):
            world[i] += data(self._wrench)[i]
            load[i] += data(self._own_wrench)[i]
        move(T, data(self._center), center)
        for j in range(n):
            if data(self._carries)[j] == 0.0:
                continue
            # The joint's twist about the centre, against the wrench.
            torque[j] -= (
                (J[j] + J[4 * n + j] * center[2] - J[5 * n + j] * center[1]) * world[0]
                + (J[n + j] + J[5 * n + j] * center[0] - J[3 * n + j] * center[2]) * world[1]
                + (J[2 * n + j] + J[3 * n + j] * center[1] - J[4 * n + j] * center[0]) * world[2]
                + J[3 * n + j] * world[3] + J[4 * n + j] * world[4] + J[5 * n + j] * world[5]
            )
        row += self.M + 6 + 2 * L
        for j in range(n):
            for k in range(L):
                row[k] += data(self._motors)[L * j + k] * torque[j]
