"""A problem in its contact frames: tangents, effects of unit forces, friction, margins, scales."""

cdef double _NEARLY_PARALLEL = 0.99  # as in `cones`


cdef void map_of(
    Py_ssize_t M, Py_ssize_t L, const double* points, const double* n, const double* t,
    const double* J, double* effects
) noexcept nogil:
    """Put (M, 3, 6 + L) wrench and torques of unit forces along n, t1, t2 into a place."""
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


cdef void directions_of(
    Py_ssize_t M, const double* n, const double* t, const double* mu, const double* v,
    const cnp.npy_bool* has_cone, double* rows
) noexcept nogil:
    """Put (M, 3, 3) rows n, t1, t2 into a place; n - mu v/|v| for n where there is no cone."""
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


cdef double margin_of(
    Py_ssize_t M, const double* forces, const double* normals, const double* tangents,
    const double* slope, const cnp.npy_bool* has_cone, const double* limit, Py_ssize_t r,
    const double* faces
) noexcept nogil:
    """The margin of forces (M, 3), see `QuasistaticProblem.margin_of`.

    The slopes of the side faces are mu cos(pi / r); their directions along t1 and t2 (2, r).
    """
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


cdef void scales_of(
    Py_ssize_t M, Py_ssize_t L, const double* points, const double* f, const double* J,
    const double* most, double least_lever, double rounding, double* force_scale,
    double* length_scale, double* lever
) noexcept nogil:
    """Put force, length and (L,) joint scales of a problem into places, see `problem.scales`.

    The shortest lever counts over the longest; the smallest distance and moment that count, over
    what they are differences of.
    """
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


cdef void tangents_of(
    Py_ssize_t count, const double* normals, Py_ssize_t axis_count, const double* axes,
    double* frames
) noexcept nogil:
    """Put the (M, 3, 2) tangents of normals into a place, see `projected_tangents`."""
    cdef const double* n
    cdef const double* a
    cdef double* out
    cdef double t[3]
    cdef double along, length
    cdef Py_ssize_t k, axis
    cdef int i
    for k in range(count):
        n, out = normals + 3 * k, frames + 6 * k
        length = 0.0
        for axis in range(axis_count):
            a = axes + 3 * axis
            along = dot(a, n)
            if fabs(along) <= _NEARLY_PARALLEL * sqrt(dot(a, a)):
                for i in range(3):
                    t[i] = a[i] - along * n[i]
                length = sqrt(dot(t, t))
                if length > 0.0:
                    break
        if not length > 0.0:
            if fabs(n[1]) > _NEARLY_PARALLEL:
                t[0], t[1], t[2] = 0.0, n[2], -n[1]
            else:
                t[0], t[1], t[2] = -n[2], 0.0, n[0]
            length = sqrt(dot(t, t))
            if length == 0.0:  # a normal of no length is refused elsewhere
                length = 1.0
        for i in range(3):
            t[i] /= length
            out[2 * i] = t[i]
        out[1] = n[1] * t[2] - n[2] * t[1]
        out[3] = n[2] * t[0] - n[0] * t[2]
        out[5] = n[0] * t[1] - n[1] * t[0]
