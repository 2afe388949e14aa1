"""The paper's programs: Algorithms 1 and 2 of problems that are alike, assembled."""

from libc.math cimport INFINITY, fabs, isfinite
from libc.string cimport memset

cimport numpy as cnp


cpdef enum:
    MARGIN = 0
    TORQUE = 1
    SHARE = 2


cdef class PaperPrograms:
    """One of the paper's programs for problems that are alike, with a workspace for one of them.

    Rows: balance, largest torque, those that no state changes (cones, normal forces), torques.
    """

    cdef int kind
    cdef readonly Py_ssize_t M, L, n
    cdef Py_ssize_t s, p, R, T, W, faces, edges
    cdef double required, least_lever, rounding, farthest, least_limit, most_strict
    cdef bint loaded
    # How often friction was changed.
    cdef Py_ssize_t friction_count
    cdef list kept
    # Of all problems.
    cdef cnp.npy_intp* axes
    cdef cnp.npy_intp* row_start
    cdef cnp.npy_intp* row_column
    cdef double* row_value
    cdef double* reach
    cdef double* mu
    cdef double* slopes
    cdef double* directions
    cdef cnp.npy_bool* has_cone
    cdef cnp.npy_bool* turns
    # Of one problem.
    cdef const double* most
    cdef const double* wrench
    cdef const double* lower
    cdef const double* upper
    cdef double* sliding
    cdef const double* points
    cdef const double* normals
    cdef const double* tangents
    cdef const double* J
    cdef const double* gravity
    # Made of it.
    cdef double force, length, unit, strict
    cdef double* frames
    cdef double* joint_scale
    cdef double* B
    cdef double* torque
    cdef double* box
    cdef double* bounds
    cdef cnp.npy_intp* joint
    cdef double* share
    cdef double* level
    # A point and multipliers, and what they prove.
    cdef double* x
    cdef double* w
    cdef double* d
    cdef double* counted
    cdef double* levels
    cdef double value, bound, residual

    def __init__(
        self, int kind, double required, turns, axes, sides, Py_ssize_t face_count,
        reach, has_cone, friction, slopes, directions, double least_lever, double rounding,
        double farthest, double least_limit, double most_strict,
    ):
        """Take what the problems share.

        Args:
            kind: `MARGIN`, `TORQUE` or `SHARE`.
            required: The required margin, N.
            turns: (L,) whether a joint's torque is in N m.
            axes: (n,) which axis each coordinate is along, see `ForceLayout`.
            sides: (n + 1, s) see `ProgramStructure`.
            face_count: How many of these rows are side faces; the next M are normal forces.
            reach: (2, n) see `ProgramStructure`.
            has_cone: (M,).
            friction: (M,).
            slopes: (M,) slopes of the side faces.
            directions: (2, r) their directions along t1 and t2.
            least_lever: See `contact_frames.scales`.
            rounding: See there.
            farthest: Size from which on a side is far, and over the force scale the largest normal
                force that these loops are for.
            least_limit: Of the largest limit: a smaller one counts as so large.
            most_strict: The load over a limit; beyond, nothing is an answer.
        """
        cdef cnp.ndarray given = as_reals(sides, 2), cones = as_reals(has_cone, 1)
        cdef Py_ssize_t n, L = len(turns), c, i, count, rows
        self.kept, self.friction_count = [], 0
        self.kind, self.required, self.L, self.M = kind, required, L, cones.shape[0]
        self.least_limit, self.most_strict = least_limit, most_strict
        self.n = n = given.shape[0] - 1
        self.faces, self.W, rows = face_count, 6 + L, given.shape[1]
        self.s = face_count if kind != MARGIN else rows
        if rows < face_count + self.M or face_count < 0:
            raise ValueError("needs the rows of all cones")
        self.least_lever, self.rounding, self.farthest = least_lever, rounding, farthest
        self.axes = self.numbers(as_integers(axes, n))
        for c in range(n):
            if not 0 <= self.axes[c] < 3 * self.M:
                raise ValueError("needs axes that exist")
        self.reach = self.reals(as_shaped(reach, 2, n).copy())
        self.mu = self.reals(as_vector(friction, self.M).copy())
        self.slopes = self.reals(as_vector(slopes, self.M).copy())
        given_directions = as_reals(directions, 2)
        self.edges = given_directions.shape[1]
        self.directions = self.reals(as_shaped(given_directions, 2, self.edges))
        flags = as_flags(has_cone, self.M)
        self.kept.append(flags)
        self.has_cone = flags_of(flags)
        turning = as_flags(turns, L)
        self.kept.append(turning)
        self.turns = flags_of(turning)
        count = 0
        for i in range((n + 1) * rows):
            count += data(given)[i] != 0.0
        self.row_start = self.numbers(no_numbers(self.s + 1))
        self.row_column = self.numbers(no_numbers(count))
        self.row_value = self.workspace(count)
        count = 0
        for i in range(self.s):
            # In Algorithm 2 the margin is no variable.
            for c in range(n + 1 if kind == MARGIN else n):
                if data(given)[rows * c + i] != 0.0:
                    self.row_column[count], self.row_value[count] = c, data(given)[rows * c + i]
                    count += 1
            self.row_start[i + 1] = count
        self.joint = self.numbers(no_numbers(2 * L))
        self.share, self.level = self.workspace(2 * L), self.workspace(2 * L)
        self.frames, self.joint_scale = self.workspace(9 * self.M), self.workspace(L)
        self.B, self.torque = self.workspace(n * self.W), self.workspace(L)
        self.box, self.bounds = self.workspace(2 * n + 2), self.workspace(2 * n + 2)
        self.x, self.d = self.workspace(n + 1), self.workspace(n + 1)
        self.w = self.workspace(6 + 3 * L + self.s)
        self.counted, self.levels = self.workspace(self.W), self.workspace(self.W)

    cdef double* workspace(self, Py_ssize_t count):
        return self.reals(empty1(max(count, 1)))

    cdef double* reals(self, cnp.ndarray array):
        self.kept.append(array)
        return data(array)

    cdef cnp.npy_intp* numbers(self, cnp.ndarray array):
        self.kept.append(array)
        return numbers_of(array)

    cdef void take(self, problem, list kept):
        """Take what a problem shares with those of other states; its arrays are kept in a list."""
        cdef cnp.ndarray most = as_vector(problem.max_normal_force, self.M)
        cdef cnp.ndarray wrench = as_vector(problem.external_wrench, 6)
        cdef cnp.ndarray lower = as_vector(problem.lower_torque, self.L)
        cdef cnp.ndarray upper = as_vector(problem.upper_torque, self.L)
        cdef cnp.ndarray sliding = as_shaped(problem.sliding, self.M, 3)
        kept += [most, wrench, lower, upper, sliding]
        self.most, self.wrench, self.lower = data(most), data(wrench), data(lower)
        self.upper, self.sliding = data(upper), data(sliding)
        self.count_rows()

    cdef void count_rows(self) noexcept:
        """Find which rows there are under these limits, and whether there is a load."""
        cdef Py_ssize_t k
        cdef double limit
        self.p = 0
        if self.kind != MARGIN:
            for k in range(2 * self.L):
                limit = self.upper[k] if k < self.L else -self.lower[k - self.L]
                if self.kind == TORQUE or (isfinite(limit) and limit > 0.0):
                    self.joint[self.p] = k
                    self.p += 1
        self.loaded = False
        for k in range(6):
            self.loaded = self.loaded or self.wrench[k] != 0.0
        self.T = 6 + self.p + self.s
        self.R = self.T + self.L

    cdef void hold(self, problem, list kept):
        """Take a whole problem; its arrays are kept in a list."""
        cdef cnp.ndarray points = as_shaped(problem.positions, self.M, 3)
        cdef cnp.ndarray normals = as_shaped(problem.normals, self.M, 3)
        cdef cnp.ndarray tangents = as_blocks(problem.tangents, self.M, 3, 2)
        cdef cnp.ndarray J = as_shaped(problem.jacobian, 3 * self.M, self.L)
        cdef cnp.ndarray gravity = as_vector(problem.gravity_torques, self.L)
        kept += [points, normals, tangents, J, gravity]
        self.take(problem, kept)
        self.points, self.normals, self.tangents = data(points), data(normals), data(tangents)
        self.J, self.gravity = data(J), data(gravity)

    cdef bint posed(self) noexcept:
        """Assemble what the state changes; False where it has to be left to the general way."""
        cdef Py_ssize_t n = self.n, W = self.W, L = self.L, c, k, j, contact
        cdef double top, limit, size, least = INFINITY, margin
        cdef double* out
        scales_of(
            self.M, L, self.points, self.wrench, self.J, self.most, self.least_lever,
            self.rounding, &self.force, &self.length, self.joint_scale,
        )
        if self.required > 0.0 and not self.loaded:
            for k in range(L):
                self.joint_scale[k] *= self.required / self.force
            self.force = self.required
        top = 0.0
        for k in range(self.M):
            least, top = min(least, self.most[k]), max(top, self.most[k])
        if top > self.farthest * self.force:
            return False
        self.restrict(top)
        directions_of(
            self.M, self.normals, self.tangents, self.mu, self.sliding, self.has_cone, self.frames
        )
        margin = self.required / self.force
        for k in range(L):
            self.torque[k] = fabs(self.gravity[k] / self.joint_scale[k])
        for c in range(n):
            contact, out = self.axes[c] // 3, self.B + W * c
            effects_of(
                self.frames + 3 * self.axes[c], self.points + 3 * contact,
                self.J + 3 * L * contact, L, out,
            )
            top = self.most[contact] / self.force
            self.box[c] = self.reach[c] * top
            self.box[n + 1 + c] = self.reach[n + c] * top
            for k in range(3):
                out[3 + k] /= self.length
            for k in range(L):
                out[6 + k] *= self.force / self.joint_scale[k]
                self.torque[k] += fabs(out[6 + k]) * self.box[n + 1 + c]
            self.bounds[c], self.bounds[n + 1 + c] = -INFINITY, INFINITY
            if self.kind != MARGIN and self.axes[c] % 3 == 0:
                self.bounds[n + 1 + c] = top - margin
                if not self.has_cone[contact]:
                    self.bounds[c] = margin
        self.box[n], self.bounds[2 * n + 1] = 0.0, INFINITY
        if self.kind == MARGIN:
            self.unit, self.bounds[n] = self.force, -INFINITY
            self.box[2 * n + 1] = 0.5 * least / self.force
            return True
        self.unit, self.bounds[n], top = 0.0, 0.0, 0.0
        if self.kind == TORQUE:
            for k in range(L):
                self.unit = max(self.unit, self.joint_scale[k])
            if self.unit == 0.0:
                self.unit = self.force
        else:
            for k in range(self.p):
                j = self.joint[k] % L
                limit = self.upper[j] if self.joint[k] < L else -self.lower[j]
                self.unit = max(self.unit, self.joint_scale[j] / limit)
            self.unit = min(self.unit, 1.0) if self.unit > 0.0 else 1.0
        for k in range(self.p):
            j = self.joint[k] % L
            limit, size = 1.0, 1.0
            if self.kind == SHARE:
                limit = self.upper[j] if self.joint[k] < L else -self.lower[j]
                size = max(self.joint_scale[j] / limit / self.unit, 1.0)
            self.level[k] = 1.0 / size
            self.share[k] = self.joint_scale[j] / (self.unit * size * limit)
            top = max(top, self.torque[j] * self.share[k] / self.level[k])
            if self.joint[k] >= L:
                self.share[k] = -self.share[k]
        self.box[2 * n + 1] = top + 1.0
        return True

    cdef void restrict(self, double most) noexcept:
        """Find how much more closely than the balance the strictest limit has to be kept.

        Args:
            most: The largest normal-force limit, N.
        """
        cdef Py_ssize_t k
        cdef double least, limit
        cdef double largest[2]
        largest[0] = largest[1] = 0.0
        self.strict = 1.0
        for k in range(self.L):
            for limit in (fabs(self.lower[k]), fabs(self.upper[k])):
                if isfinite(limit):
                    largest[self.turns[k]] = max(largest[self.turns[k]], limit)
        for k in range(self.L):
            least = largest[self.turns[k]] if largest[self.turns[k]] > 0.0 else self.joint_scale[k]
            limit = min(fabs(self.lower[k]), fabs(self.upper[k]))
            limit = max(limit, self.least_limit * least)
            self.strict = max(self.strict, self.joint_scale[k] / limit)
        for k in range(self.M):
            limit = max(self.most[k], self.least_limit * most)
            self.strict = max(self.strict, self.force / limit)
        if self.strict > self.most_strict:
            self.strict = INFINITY

    cdef double side(self, Py_ssize_t i, bint top) noexcept:
        """The lower or upper side of a row; from R on the bound of a variable."""
        cdef Py_ssize_t j, k
        if i < 6:
            return -self.wrench[i] / (self.force if i < 3 else self.force * self.length)
        if i >= self.R:
            return self.bounds[i - self.R + (self.n + 1 if top else 0)]
        if i >= self.T:
            j = i - self.T
            return ((self.upper[j] if top else self.lower[j]) - self.gravity[j]) / (
                self.joint_scale[j]
            )
        if not top:
            return -INFINITY
        if i < 6 + self.p:
            k, j = i - 6, self.joint[i - 6] % self.L
            return -self.share[k] * (self.gravity[j] / self.joint_scale[j])
        k = i - 6 - self.p
        if k < self.faces:
            return -self.required / self.force if self.kind != MARGIN else 0.0
        k -= self.faces
        return self.most[k] / self.force if k < self.M else 0.0

    cdef void judged(self) noexcept:
        """Find what point and multipliers prove, see `Program.judged`."""
        cdef Py_ssize_t n = self.n, W = self.W, c, i, j, k, e
        cdef double* v = self.counted
        cdef double* level = self.levels
        cdef double* slope = self.d
        cdef double weight, at, total = 0.0, bound = 0.0, residual = 0.0, last = self.x[n]
        memset(v, 0, W * sizeof(double))
        memset(level, 0, W * sizeof(double))
        memset(slope, 0, (n + 1) * sizeof(double))
        slope[n] = -1.0 if self.kind == MARGIN else 1.0
        for c in range(n):
            at = self.x[c]
            for k in range(W):
                level[k] += at * self.B[W * c + k]
        for i in range(self.R):
            weight = self.w[i]
            total += weight
            if i < 6:
                at = level[i]
            elif i >= self.T:
                at = level[6 + i - self.T]
                residual = max(residual, self.side(i, False) - at)
            elif i < 6 + self.p:
                j = 6 + self.joint[i - 6] % self.L
                at = self.share[i - 6] * level[j] - self.level[i - 6] * last
            else:
                at, k = 0.0, i - 6 - self.p
                for e in range(self.row_start[k], self.row_start[k + 1]):
                    at += self.row_value[e] * self.x[self.row_column[e]]
            at -= self.side(i, True)
            residual = max(residual, at if i >= 6 else fabs(at))
            if weight == 0.0:
                continue
            at = self.side(i, weight > 0.0)
            if not isfinite(at):
                continue
            bound -= weight * at
            if i < 6:
                v[i] += weight
            elif i >= self.T:
                v[6 + i - self.T] += weight
            elif i < 6 + self.p:
                v[6 + self.joint[i - 6] % self.L] += self.share[i - 6] * weight
                slope[n] -= self.level[i - 6] * weight
            else:
                for e in range(self.row_start[k], self.row_start[k + 1]):
                    slope[self.row_column[e]] += self.row_value[e] * weight
        for c in range(n + 1):
            if c < n:
                slope[c] += inner(self.B + W * c, v, W)
            at = self.x[c]
            total += at
            residual = max(residual, at - self.bounds[n + 1 + c], self.bounds[c] - at)
            if slope[c] >= 0.0:
                bound += slope[c] * max(self.box[c], self.bounds[c])
            else:
                bound += slope[c] * min(self.box[n + 1 + c], self.bounds[n + 1 + c])
        self.value = -last if self.kind == MARGIN else last
        self.bound, self.residual = bound, residual if isfinite(total) else INFINITY
