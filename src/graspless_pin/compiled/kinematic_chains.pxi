"""Joints that turn about an axis or move along one: their poses, Jacobian columns and weight."""

from libc.math cimport cos, sin
from libc.string cimport memset

cimport numpy as cnp


cdef class KinematicChains:
    """What joints carry, and how each moves in the frame of the one before."""

    cdef Py_ssize_t n
    cdef cnp.ndarray _parents, _placements, _axes, _masses, _centers, _T, _J, _moments

    def __init__(self, *, parents, placements, axes, masses, centers):
        """Take the joints.

        Args:
            parents: (n + 1,) the joint before each, all but the base behind their own.
            placements: (n + 1, 4, 4) pose of each in the frame of the one before.
            axes: (n, 6) unit direction [v; omega] of each in its own frame; half of it is zero.
            masses: (n + 1,) mass that each joint carries, kg, and
            centers: (n + 1, 3) its centre in the joint's frame, m.
        """
        cdef Py_ssize_t k
        self._axes = as_reals(axes, 2)
        self.n = self._axes.shape[0]
        self._axes = as_shaped(axes, self.n, 6)
        self._parents = as_integers(parents, self.n + 1)
        self._placements, self._masses = as_poses(placements), as_vector(masses, self.n + 1)
        self._centers = as_shaped(centers, self.n + 1, 3)
        if self._placements.shape[0] != self.n + 1:
            raise ValueError("needs one pose for each joint")
        for k in range(self.n):
            if not 0 <= numbers_of(self._parents)[k + 1] <= k:
                raise ValueError("needs parents before their children")
        self._T, self._J = empty3(self.n + 1, 4, 4), empty(6, self.n)
        self._moments = empty(self.n + 1, 4)

    def kinematics(self, positions):
        """Return where the joints are at (n,) positions, rad or m.

        Returns:
            (n + 1, 4, 4) poses, the base first, and (6, n) spatial joint columns [v; omega] about
            the world's origin; both are read-only.
        """
        cdef cnp.ndarray given = as_vector(positions, self.n)
        cdef cnp.ndarray T = empty3(self.n + 1, 4, 4), J = empty(6, self.n)
        self.place(data(given), data(T))
        self.columns(data(T), data(J))
        T.setflags(write=False)
        J.setflags(write=False)
        return T, J

    def gravity_torques(self, positions, gravity):
        """Return the (n,) torques that carry the weight.

        Args:
            positions: (n,) rad or m.
            gravity: (3,) m/s^2.
        """
        cdef cnp.ndarray given = as_vector(positions, self.n), g = as_vector(gravity, 3)
        cdef cnp.ndarray torques = empty1(self.n)
        # The room is shared, hence the lock of Python is kept.
        self.place(data(given), data(self._T))
        self.columns(data(self._T), data(self._J))
        self.weights(data(self._T), data(self._J), data(g), data(torques))
        return torques

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
                poses + 16 * numbers_of(self._parents)[j + 1],
                data(self._placements) + 16 * (j + 1), fixed,
            )
            chained(fixed, step, poses + 16 * (j + 1))

    cdef void columns(self, const double* poses, double* J) noexcept:
        """Put the spatial joint columns into a place."""
        cdef const double* T
        cdef double v[3]
        cdef double w[3]
        cdef Py_ssize_t j, n = self.n
        for j in range(n):
            T = poses + 16 * (j + 1)
            turn(T, data(self._axes) + 6 * j, v)
            turn(T, data(self._axes) + 6 * j + 3, w)
            J[j] = v[0] + T[7] * w[2] - T[11] * w[1]
            J[n + j] = v[1] + T[11] * w[0] - T[3] * w[2]
            J[2 * n + j] = v[2] + T[3] * w[1] - T[7] * w[0]
            J[3 * n + j], J[4 * n + j], J[5 * n + j] = w[0], w[1], w[2]

    cdef void weights(
        self, const double* poses, const double* J, const double* g, double* torques
    ) noexcept:
        """Put the torques that carry the weight into a place."""
        cdef double* moment = data(self._moments)
        cdef double x[3]
        cdef double m
        cdef Py_ssize_t j, n = self.n
        cdef int i
        for j in range(1, n + 1):
            m = data(self._masses)[j]
            move(poses + 16 * j, data(self._centers) + 3 * j, x)
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
