# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""A problem in its contact frames: effects of unit forces, friction, margins, scales."""

from libc.math cimport INFINITY, sqrt
from libc.string cimport memset

cimport numpy as cnp

from graspless_pin.compiled.shared cimport (
    as_blocks, as_flags, as_reals, as_shaped, as_vector, data, dot, effects_of, empty,
    empty1, empty3, flags_of, numbers_of,
)

cnp.import_array()


def contact_map(positions, normals, tangents, jacobian):
    """(M, 3, 6 + L) wrench and torques of unit forces along n, t1, t2 of each contact.

    Args:
        positions: (M, 3) m.
        normals: (M, 3).
        tangents: (M, 3, 2).
        jacobian: (3M, L).
    """
    cdef cnp.ndarray points = as_reals(positions, 2), J = as_reals(jacobian, 2)
    cdef Py_ssize_t M = points.shape[0], L = J.shape[1]
    points, J = as_shaped(points, M, 3), as_shaped(J, 3 * M, L)
    cdef cnp.ndarray n = as_shaped(normals, M, 3), t = as_blocks(tangents, M, 3, 2)
    cdef cnp.ndarray effects = empty3(M, 3, 6 + L)
    map_of(M, L, data(points), data(n), data(t), data(J), data(effects))
    return effects


cdef void map_of(
    Py_ssize_t M, Py_ssize_t L, const double* points, const double* n, const double* t,
    const double* J, double* effects
) noexcept nogil:
    """Put what `contact_map` returns into a place."""
    cdef double axes[9]
    cdef Py_ssize_t contact
    cdef int i
    for contact in range(M):
        for i in range(3):
            axes[i] = n[3 * contact + i]
            axes[3 + i] = t[6 * contact + 2 * i]
            axes[6 + i] = t[6 * contact + 2 * i + 1]
        for i in range(3):
            effects_of(
                axes + 3 * i, points + 3 * contact, J + 3 * L * contact, L,
                effects + (3 * contact + i) * (6 + L),
            )


def force_directions(normals, tangents, friction, sliding, has_cone):
    """(M, 3, 3) rows n, t1, t2; where there is no cone n - mu v/|v| in the place of n."""
    cdef cnp.ndarray n = as_reals(normals, 2)
    cdef Py_ssize_t M = n.shape[0]
    n = as_shaped(n, M, 3)
    cdef cnp.ndarray t = as_blocks(tangents, M, 3, 2), v = as_shaped(sliding, M, 3)
    cdef cnp.ndarray mu = as_vector(friction, M), cones = as_flags(has_cone, M)
    cdef cnp.ndarray rows = empty3(M, 3, 3)
    directions_of(M, data(n), data(t), data(mu), data(v), flags_of(cones), data(rows))
    return rows


cdef void directions_of(
    Py_ssize_t M, const double* n, const double* t, const double* mu, const double* v,
    const cnp.npy_bool* has_cone, double* rows
) noexcept nogil:
    """Put what `force_directions` returns into a place."""
    cdef double* out
    cdef double speed, share
    cdef Py_ssize_t contact
    cdef int i
    for contact in range(M):
        out = rows + 9 * contact
        share = 0.0
        if not has_cone[contact]:
            speed = sqrt(dot(v + 3 * contact, v + 3 * contact))
            if speed > 0.0:
                share = mu[contact] / speed
        for i in range(3):
            out[i] = n[3 * contact + i] - share * v[3 * contact + i]
            out[3 + i] = t[6 * contact + 2 * i]
            out[6 + i] = t[6 * contact + 2 * i + 1]


def forces(x, axes, directions, double scale):
    """(M, 3) forces of scaled coordinates.

    Args:
        x: (n or more,) coordinates, then anything.
        axes: (n,) which row of the directions each is along, counted through.
        directions: (M, 3, 3) rows.
        scale: What a coordinate of one stands for, N.
    """
    cdef cnp.ndarray rows = as_reals(directions, 3)
    cdef Py_ssize_t M = rows.shape[0], n, k, axis
    rows = as_blocks(rows, M, 3, 3)
    cdef cnp.ndarray numbers = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(axes, cnp.NPY_INTP, 1, 1)
    cdef cnp.ndarray values = as_reals(x, 1), total = empty(M, 3)
    n = numbers.shape[0]
    if values.shape[0] < n:
        raise ValueError(f"needs shape ({n},) or longer")
    cdef int i
    memset(data(total), 0, 3 * M * sizeof(double))
    for k in range(n):
        axis = numbers_of(numbers)[k]
        if not 0 <= axis < 3 * M:
            raise ValueError("needs axes that exist")
        for i in range(3):
            data(total)[3 * (axis // 3) + i] += (
                scale * data(values)[k] * data(rows)[3 * axis + i]
            )
    return total


def without_forbidden(x, columns, cones, signs):
    """A solution without the friction that one mode forbids; the same array if there is none.

    Args:
        x: (n,) solution.
        columns: (layers, c, 2) columns of the friction of each cone.
        cones: (c,) contacts of the cones.
        signs: (M, 2) signs of the mode's sliding.

    Returns:
        (n,) what is left.
    """
    cdef cnp.ndarray before = as_reals(x, 1), after = None
    cdef Py_ssize_t n = before.shape[0], count, layers, M, k, layer, column, contact
    cdef cnp.ndarray numbers = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(
        cones, cnp.NPY_INTP, 1, 1
    )
    count = numbers.shape[0]
    cdef cnp.ndarray places = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(
        columns, cnp.NPY_INTP, 3, 3
    )
    layers = places.shape[0]
    if places.shape[1] != count or places.shape[2] != 2:
        raise ValueError(f"needs shape (layers, {count}, 2)")
    cdef cnp.ndarray given = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(signs, cnp.NPY_INT8, 2, 2)
    cdef cnp.npy_int8* sign = <cnp.npy_int8*>cnp.PyArray_DATA(given)
    cdef double friction
    M = given.shape[0]
    for layer in range(layers):
        for k in range(2 * count):
            contact, column = numbers_of(numbers)[k // 2], numbers_of(places)[2 * count * layer + k]
            if not (0 <= contact < M and 0 <= column < n and given.shape[1] == 2):
                raise ValueError("needs contacts and columns that exist")
            friction = data(before)[column]
            if friction != 0.0 and friction * sign[2 * contact + k % 2] >= 0.0:
                if after is None:
                    after = <cnp.ndarray>cnp.PyArray_NewCopy(before, cnp.NPY_CORDER)
                data(after)[column] = 0.0
    return x if after is None else after


def margin(forces, normals, tangents, friction, has_cone, most, face_directions):
    """The margin of contact forces, see `QuasistaticProblem.margin_of`.

    Args:
        forces: (M, 3) N.
        normals: (M, 3).
        tangents: (M, 3, 2).
        friction: (M,) slopes of the side faces, mu cos(pi / r).
        has_cone: (M,).
        most: (M,) largest normal forces, N.
        face_directions: (2, r) directions of the side faces along t1 and t2.
    """
    cdef cnp.ndarray f = as_reals(forces, 2)
    cdef Py_ssize_t M = f.shape[0], r
    f = as_shaped(f, M, 3)
    cdef cnp.ndarray n = as_shaped(normals, M, 3), t = as_blocks(tangents, M, 3, 2)
    cdef cnp.ndarray slope = as_vector(friction, M), cones = as_flags(has_cone, M)
    cdef cnp.ndarray limit = as_vector(most, M), faces = as_reals(face_directions, 2)
    r = faces.shape[1]
    faces = as_shaped(faces, 2, r)
    return margin_of(
        M, data(f), data(n), data(t), data(slope), flags_of(cones), data(limit), r, data(faces)
    )


cdef double margin_of(
    Py_ssize_t M, const double* forces, const double* normals, const double* tangents,
    const double* slope, const cnp.npy_bool* has_cone, const double* limit, Py_ssize_t r,
    const double* faces
) noexcept nogil:
    """What `margin` returns, of plain arrays."""
    cdef double least = INFINITY, along, first, second, outward
    cdef const double* g
    cdef const double* axes
    cdef Py_ssize_t contact, k
    for contact in range(M):
        g, axes = forces + 3 * contact, tangents + 6 * contact
        along = dot(normals + 3 * contact, g)
        least = min(least, along, limit[contact] - along)
        if has_cone[contact]:
            first = axes[0] * g[0] + axes[2] * g[1] + axes[4] * g[2]
            second = axes[1] * g[0] + axes[3] * g[1] + axes[5] * g[2]
            outward = -INFINITY
            for k in range(r):
                outward = max(outward, first * faces[k] + second * faces[r + k])
            along = slope[contact] * along - outward
            least = min(least, along / sqrt(1.0 + slope[contact] ** 2))
    return least


def scales(positions, wrench, jacobian, limits, double least_lever, double rounding):
    """Force, length and joint scales of a problem, see `problem.scales`.

    Args:
        positions: (M, 3) m.
        wrench: (6,) external wrench.
        jacobian: (3M, L).
        limits: (M,) largest normal forces, N.
        least_lever: Shortest lever that counts, over the longest.
        rounding: Smallest distance and moment that count, over what they are differences of.
    """
    cdef cnp.ndarray points = as_reals(positions, 2), J = as_reals(jacobian, 2)
    cdef Py_ssize_t M = points.shape[0], L = J.shape[1]
    points, J = as_shaped(points, M, 3), as_shaped(J, 3 * M, L)
    cdef cnp.ndarray load = as_vector(wrench, 6), most = as_vector(limits, M), joints = empty1(L)
    cdef double force, length
    scales_of(
        M, L, data(points), data(load), data(J), data(most), least_lever, rounding, &force, &length,
        data(joints),
    )
    return force, length, joints


cdef void scales_of(
    Py_ssize_t M, Py_ssize_t L, const double* points, const double* f, const double* J,
    const double* most, double least_lever, double rounding, double* force_scale,
    double* length_scale, double* lever
) noexcept nogil:
    """Put what `scales` returns into three places."""
    cdef const double* row
    cdef double length = 0.0, longest = 0.0, force = INFINITY, reach = 0.0, turn, least
    cdef double pull = sqrt(dot(f, f))
    cdef double center[3]
    cdef double arm[3]
    cdef Py_ssize_t contact, k
    cdef int i
    for i in range(3):
        center[i] = 0.0
        for contact in range(M):
            center[i] += points[3 * contact + i]
        center[i] /= M
    for contact in range(M):
        for i in range(3):
            arm[i] = points[3 * contact + i] - center[i]
        length = max(length, dot(arm, arm))
        reach = max(reach, dot(points + 3 * contact, points + 3 * contact))
        force = min(force, most[contact])
    arm[0] = f[3] - (center[1] * f[2] - center[2] * f[1])
    arm[1] = f[4] - (center[2] * f[0] - center[0] * f[2])
    arm[2] = f[5] - (center[0] * f[1] - center[1] * f[0])
    turn = sqrt(dot(arm, arm))
    length = sqrt(length)
    reach = sqrt(reach)
    if length <= rounding * reach:
        least = rounding * (sqrt(dot(f + 3, f + 3)) + reach * pull)
        length = turn / pull if pull > 0.0 and turn > least else 1.0
    if pull > 0.0 or turn > 0.0:
        force = max(pull, turn / length)
    for k in range(L):
        lever[k] = 0.0
    for contact in range(M):
        row = J + 3 * L * contact
        for k in range(L):
            lever[k] = max(
                lever[k],
                row[k] * row[k] + row[L + k] * row[L + k] + row[2 * L + k] * row[2 * L + k],
            )
    for k in range(L):
        lever[k] = sqrt(lever[k])
        longest = max(longest, lever[k])
    for k in range(L):
        lever[k] = force * (max(lever[k], least_lever * longest) if longest > 0.0 else length)
    force_scale[0], length_scale[0] = force, length


def squared_lengths(vectors):
    """(M,) squares of the lengths of rows (M, 3)."""
    cdef cnp.ndarray rows = as_reals(vectors, 2)
    cdef Py_ssize_t count = rows.shape[0], k
    rows = as_shaped(rows, count, 3)
    cdef cnp.ndarray squares = empty1(count)
    for k in range(count):
        data(squares)[k] = dot(data(rows) + 3 * k, data(rows) + 3 * k)
    return squares
