# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Poses, velocities and Jacobians of points that are fixed to rigid bodies."""

from libc.math cimport fabs, sqrt

cimport numpy as cnp

from graspless_pin.compiled.shared cimport (
    as_integers, as_poses, as_reals, as_shaped, as_vector, chained, data, dot, empty, empty1,
    empty3, numbers_of,
)

cnp.import_array()

cpdef enum:
    STICKS = 0
    ROLLS = 1
    SLIDES = 2
    PARTS = 3
    PENETRATES = 4

cdef double _RIGIDITY = 1e-6  # as in `poses`
cdef double _LARGEST_LENGTH = 1e12  # as in `bounds`


def placed(T_world_joint, joints, T_joint_shape):
    """(K, 4, 4) poses of shapes from those of the joints that carry them."""
    cdef cnp.ndarray carriers = as_poses(T_world_joint), shapes = as_poses(T_joint_shape)
    cdef cnp.ndarray numbers = as_integers(joints, shapes.shape[0])
    cdef cnp.npy_intp* number = numbers_of(numbers)
    cdef cnp.ndarray poses = empty3(shapes.shape[0], 4, 4)
    cdef const double* A
    cdef const double* B
    cdef Py_ssize_t k
    for k in range(shapes.shape[0]):
        if not 0 <= number[k] < carriers.shape[0]:
            raise ValueError("needs joints that exist")
        A, B = data(carriers) + 16 * number[k], data(shapes) + 16 * k
        chained(A, B, data(poses) + 16 * k)
    return poses


def point_jacobians(J_world, moved, joints, points):
    """(K, 3, n) velocities of body-fixed points per joint rate, world axes.

    Args:
        J_world: (6, n) spatial joint columns about the world's origin.
        moved: (m, n) one where a joint moves what is attached to one of m carriers, else zero.
        joints: (K,) the carrier of each point.
        points: (K, 3) world, m.
    """
    cdef cnp.ndarray J = as_reals(J_world, 2)
    cdef Py_ssize_t n = J.shape[1], k
    cdef cnp.ndarray arms = as_reals(points, 2)
    cdef Py_ssize_t count = arms.shape[0]
    arms = as_shaped(arms, count, 3)
    J = as_shaped(J, 6, n)
    cdef cnp.ndarray mask = as_reals(moved, 2)
    mask = as_shaped(mask, mask.shape[0], n)
    cdef cnp.ndarray numbers = as_integers(joints, count)
    cdef cnp.npy_intp* number = numbers_of(numbers)
    cdef cnp.ndarray jacobians = empty3(count, 3, n)
    for k in range(count):
        if not 0 <= number[k] < mask.shape[0]:
            raise ValueError("needs joints that exist")
        jacobian_of(
            n, data(J), data(mask) + n * number[k], data(arms) + 3 * k, data(jacobians) + 3 * n * k
        )
    return jacobians


cdef void jacobian_of(
    Py_ssize_t n, const double* column, const double* moves, const double* p, double* out
) noexcept nogil:
    """Put the (3, n) velocities of one point, see `point_jacobians`, into a place."""
    cdef Py_ssize_t j
    for j in range(n):
        if moves[j] == 0.0:
            out[j] = out[n + j] = out[2 * n + j] = 0.0
            continue
        out[j] = column[j] + column[4 * n + j] * p[2] - column[5 * n + j] * p[1]
        out[n + j] = column[n + j] + column[5 * n + j] * p[0] - column[3 * n + j] * p[2]
        out[2 * n + j] = column[2 * n + j] + column[3 * n + j] * p[1] - column[4 * n + j] * p[0]


def twist_velocities(twist, center, points):
    """(M, 3) velocities v + omega x (p - c) of points."""
    cdef cnp.ndarray motion = as_vector(twist, 6), origin = as_vector(center, 3)
    cdef cnp.ndarray positions = as_reals(points, 2)
    cdef Py_ssize_t count = positions.shape[0], k
    positions = as_shaped(positions, count, 3)
    cdef cnp.ndarray velocities = empty(count, 3)
    for k in range(count):
        _velocity(
            data(motion), data(origin), data(positions) + 3 * k, data(velocities) + 3 * k
        )
    return velocities


cdef inline double _velocity(
    const double* v, const double* center, const double* p, double* out
) noexcept nogil:
    """v + omega x (p - c); the square of the arm's length."""
    cdef double x = p[0] - center[0], y = p[1] - center[1], z = p[2] - center[2]
    out[0] = v[0] + v[4] * z - v[5] * y
    out[1] = v[1] + v[5] * x - v[3] * z
    out[2] = v[2] + v[3] * y - v[4] * x
    return x * x + y * y + z * z


def motion_states(positions, normals, twist, center, others, turning, double tolerance):
    """What an object does at its contacts.

    Args:
        positions: (M, 3) world, m.
        normals: (M, 3) into the object.
        twist: (6,) of the object about its centre of mass.
        center: (3,) that centre, m.
        others: (M, 3) velocities of what it touches, m/s.
        turning: (M, 3) angular velocities of what it touches, rad/s; None: it does not turn.
        tolerance: Share of the fastest speed below which a speed is zero.

    Returns:
        M numbers of states, `STICKS` and so on; (M, 3) tangential velocities, zero where the
        contact does not slide; and (M,) speeds along the normals.
    """
    cdef cnp.ndarray motion = as_vector(twist, 6), origin = as_vector(center, 3)
    cdef cnp.ndarray points = as_reals(positions, 2)
    cdef Py_ssize_t count = points.shape[0], k
    points = as_shaped(points, count, 3)
    cdef cnp.ndarray inward = as_shaped(normals, count, 3), bodies = as_shaped(others, count, 3)
    cdef cnp.ndarray spins = None if turning is None else as_shaped(turning, count, 3)
    cdef cnp.ndarray sliding = empty(count, 3), leaving = empty1(count)
    cdef const double* v = data(motion)
    cdef const double* n
    cdef const double* u
    cdef double* along
    cdef double roll[3]
    cdef double longest = 0.0, fastest = 0.0, fastest_turn = dot(v + 3, v + 3), speed
    cdef list states = []
    cdef int i
    for k in range(count):
        n, u, along = data(inward) + 3 * k, data(bodies) + 3 * k, data(sliding) + 3 * k
        longest = max(longest, _velocity(v, data(origin), data(points) + 3 * k, along))
        fastest = max(fastest, dot(u, u))
        for i in range(3):
            along[i] -= u[i]
        speed = dot(n, along)
        data(leaving)[k] = speed
        for i in range(3):
            along[i] -= speed * n[i]
        if spins is not None:
            fastest_turn = max(fastest_turn, dot(data(spins) + 3 * k, data(spins) + 3 * k))
    # The object's own parts of speed, not their sum: at a pivot they cancel, and what is left
    # there is nothing.
    fastest = tolerance * sqrt(max(fastest, dot(v, v), dot(v + 3, v + 3) * longest))
    fastest_turn = tolerance * sqrt(fastest_turn)
    for k in range(count):
        n, along, speed = data(inward) + 3 * k, data(sliding) + 3 * k, data(leaving)[k]
        if speed > fastest:
            states.append(PARTS)
        elif speed < -fastest:
            states.append(PENETRATES)
        elif sqrt(dot(along, along)) > fastest:
            states.append(SLIDES)
            continue
        else:
            for i in range(3):
                roll[i] = v[3 + i] - (0.0 if spins is None else data(spins)[3 * k + i])
            speed = dot(n, roll)
            for i in range(3):
                roll[i] -= speed * n[i]
            states.append(ROLLS if sqrt(dot(roll, roll)) > fastest_turn else STICKS)
        along[0] = along[1] = along[2] = 0.0
    return states, sliding, leaving


def is_rigid(pose):
    """Whether a (4, 4) array passes for a rigid transform."""
    cdef cnp.ndarray array = as_shaped(pose, 4, 4)
    cdef const double* T = data(array)
    cdef double product
    cdef int i, j
    for i in range(3):
        if not fabs(T[4 * i + 3]) <= _LARGEST_LENGTH or T[12 + i] != 0.0:
            return False
        for j in range(i, 3):
            product = T[i] * T[j] + T[4 + i] * T[4 + j] + T[8 + i] * T[8 + j]
            # Not a number is within no bounds.
            if not fabs(product - (i == j)) <= _RIGIDITY:
                return False
    return T[15] == 1.0 and (
        T[0] * (T[5] * T[10] - T[9] * T[6])
        + T[1] * (T[6] * T[8] - T[4] * T[10])
        + T[2] * (T[4] * T[9] - T[8] * T[5])
        > 0.0
    )
