"""Joints that turn about an axis or move along one: their poses, Jacobian columns and weight."""

cdef class KinematicChains(KeptArrays):
    """What joints carry, and how each moves in the frame of the one before."""

    cdef Py_ssize_t joint_count
    cdef cnp.npy_intp* parents
    cdef double* placements
    cdef double* axes
    cdef double* masses
    cdef double* centers
    # Room for one state.
    cdef double* joint_poses
    cdef double* moments

    def __init__(self, *, parents, placements, axes, masses, centers):
        """Take the joints.

        Args:
            parents: (n + 1,) the joint before each, all but the base behind their own.
            placements: (n + 1, 4, 4) pose of each in the frame of the one before.
            axes: (n, 6) unit direction [v; omega] of each in its own frame; half of it is zero.
            masses: (n + 1,) mass that each joint carries, kg.
            centers: (n + 1, 3) centre of that mass in the joint's frame, m.
        """
        cdef Py_ssize_t k, n = len(axes)
        self.joint_count, self.axes = n, self.reals(as_shaped(axes, n, 6))
        self.parents = self.numbers(as_integers(parents, n + 1))
        self.placements = self.reals(as_poses(placements, n + 1))
        self.masses = self.reals(as_vector(masses, n + 1))
        self.centers = self.reals(as_shaped(centers, n + 1, 3))
        for k in range(n):
            if not 0 <= self.parents[k + 1] <= k:
                raise ValueError("needs parents before their children")
        self.joint_poses, self.moments = self.room(16 * (n + 1)), self.room(4 * (n + 1))

    cdef void place(self, const double* position, double* poses) noexcept:
        """Put the poses of the joints at positions into a place."""
        cdef double* T = poses
        cdef const double* axis
        cdef double step[16]
        cdef double fixed[16]
        cdef double c, s
        cdef Py_ssize_t j, k
        cdef int i
        memset(T, 0, 16 * sizeof(double))
        T[0] = T[5] = T[10] = T[15] = 1.0
        for j in range(self.joint_count):
            axis = self.axes + 6 * j
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
                poses + 16 * self.parents[j + 1], self.placements + 16 * (j + 1), fixed
            )
            chained(fixed, step, poses + 16 * (j + 1))

    cdef void columns(self, const double* poses, double* J) noexcept:
        """Put the spatial joint columns into a place."""
        cdef const double* T
        cdef double v[3]
        cdef double w[3]
        cdef Py_ssize_t j, n = self.joint_count
        for j in range(n):
            T = poses + 16 * (j + 1)
            turn(T, self.axes + 6 * j, v)
            turn(T, self.axes + 6 * j + 3, w)
            J[j] = v[0] + T[7] * w[2] - T[11] * w[1]
            J[n + j] = v[1] + T[11] * w[0] - T[3] * w[2]
            J[2 * n + j] = v[2] + T[3] * w[1] - T[7] * w[0]
            J[3 * n + j], J[4 * n + j], J[5 * n + j] = w[0], w[1], w[2]

    cdef void weights(
        self, const double* poses, const double* J, const double* g, double* torques
    ) noexcept:
        """Put the torques that carry the weight into a place."""
        cdef double* moment = self.moments
        cdef double x[3]
        cdef double m
        cdef Py_ssize_t j, n = self.joint_count
        cdef int i
        for j in range(1, n + 1):
            m = self.masses[j]
            move(poses + 16 * j, self.centers + 3 * j, x)
            moment[4 * j] = m
            for i in range(3):
                moment[4 * j + 1 + i] = m * x[i]
        for j in range(n, 0, -1):
            if self.parents[j] > 0:
                for i in range(4):
                    moment[4 * self.parents[j] + i] += moment[4 * j + i]
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


cdef void jacobian_of(
    Py_ssize_t n, const double* column, const double* moves, const double* p, double* out
) noexcept nogil:
    """Put the (3, n) velocities of one point per joint rate into a place.

    Args:
        n: Joints.
        column: (6, n) spatial joint columns about the world's origin.
        moves: (n,) one for each joint that moves the point, else zero.
        p: (3,) the point, m.
        out: The place.
    """
    cdef Py_ssize_t j
    for j in range(n):
        if moves[j] == 0.0:
            out[j] = out[n + j] = out[2 * n + j] = 0.0
            continue
        out[j] = column[j] + column[4 * n + j] * p[2] - column[5 * n + j] * p[1]
        out[n + j] = column[n + j] + column[5 * n + j] * p[0] - column[3 * n + j] * p[2]
        out[2 * n + j] = column[2 * n + j] + column[3 * n + j] * p[1] - column[4 * n + j] * p[0]
