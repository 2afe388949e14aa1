"""The paper's programs: Algorithms 1 and 2 of problems that are alike, assembled."""

cpdef enum:
    MARGIN = 0
    TORQUE = 1
    SHARE = 2


cdef class PaperPrograms(KeptArrays):
    """One of the paper's programs for problems that are alike, with a workspace for one of them.

    Rows: balance, largest torque, those that no state changes (cones, normal forces), torques.
    Where a number of a row goes on after these, it is that of a variable at its bound.
    """

    cdef int objective
    cdef readonly Py_ssize_t contact_count, joint_count, coordinate_count
    cdef Py_ssize_t fixed_count, peak_count, row_count, first_torque_row
    cdef Py_ssize_t effect_count, face_count, edge_count
    cdef double required, least_lever, rounding, farthest, least_limit, most_strict
    cdef bint loaded
    # How often friction was changed.
    cdef Py_ssize_t friction_count
    # Of all problems. After the rows that no state changes come unit rows: the variables.
    cdef cnp.npy_intp* axes
    cdef cnp.npy_intp* row_start
    cdef cnp.npy_intp* row_column
    cdef double* row_value
    cdef double* reach
    cdef double* friction
    cdef double* slopes
    cdef double* directions
    cdef cnp.npy_bool* has_cone
    cdef cnp.npy_bool* turns
    # Of one problem.
    cdef const double* largest_normal
    cdef const double* wrench
    cdef const double* lower
    cdef const double* upper
    cdef double* sliding
    cdef const double* points
    cdef const double* normals
    cdef const double* tangents
    cdef const double* jacobian
    cdef const double* gravity
    # Made of it: scales, and (n, 6 + L) wrench and torques of unit forces, scaled.
    cdef double force, length, unit, strict
    cdef double* frames
    cdef double* joint_scale
    cdef double* effects
    cdef double* torque_reach
    cdef double* box
    cdef double* bounds
    # Of the rows of the largest torque: share * torque - level * (largest torque) <= side.
    cdef cnp.npy_intp* peak_joint
    cdef double* peak_share
    cdef double* peak_level
    # A point and multipliers, and what they prove.
    cdef double* point
    cdef double* multipliers
    cdef double* slope
    cdef double* effect_values
    cdef double* values
    cdef double* counted
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
        cdef cnp.ndarray ways = as_reals(directions, 2)
        cdef Py_ssize_t n, n1, L = len(turns), M = cones.shape[0], c, i, count, rows, most_rows
        self.friction_count, self.objective, self.required = 0, kind, required
        self.joint_count, self.contact_count, self.effect_count = L, M, 6 + L
        self.least_limit, self.most_strict = least_limit, most_strict
        n1 = given.shape[0]
        self.coordinate_count = n = n1 - 1
        self.face_count, rows = face_count, given.shape[1]
        self.fixed_count = face_count if kind != MARGIN else rows
        if rows < face_count + M or face_count < 0:
            raise ValueError("needs the rows of all cones")
        self.least_lever, self.rounding, self.farthest = least_lever, rounding, farthest
        self.axes = self.numbers(as_integers(axes, n))
        for c in range(n):
            if not 0 <= self.axes[c] < 3 * M:
                raise ValueError("needs axes that exist")
        self.reach = self.reals(as_shaped(reach, 2, n).copy())
        self.friction = self.reals(as_vector(friction, M).copy())
        self.slopes = self.reals(as_vector(slopes, M).copy())
        self.edge_count = ways.shape[1]
        self.directions = self.reals(as_shaped(ways, 2, self.edge_count))
        self.has_cone = self.flags(as_flags(has_cone, M))
        self.turns = self.flags(as_flags(turns, L))
        count = n1
        for i in range(n1 * rows):
            count += data(given)[i] != 0.0
        self.row_start = self.number_room(self.fixed_count + n1 + 1)
        self.row_column, self.row_value = self.number_room(count), self.room(count)
        count = 0
        for i in range(self.fixed_count + n1):
            if i >= self.fixed_count:
                self.row_column[count], self.row_value[count] = i - self.fixed_count, 1.0
                count += 1
            # In Algorithm 2 the margin is no variable.
            for c in range(0 if i >= self.fixed_count else n1 if kind == MARGIN else n):
                if data(given)[rows * c + i] != 0.0:
                    self.row_column[count], self.row_value[count] = c, data(given)[rows * c + i]
                    count += 1
            self.row_start[i + 1] = count
        most_rows = 6 + 3 * L + self.fixed_count
        self.peak_joint = self.number_room(2 * L)
        self.peak_share, self.peak_level = self.room(2 * L), self.room(2 * L)
        self.frames, self.joint_scale = self.room(9 * M), self.room(L)
        self.effects, self.torque_reach = self.room(n * self.effect_count), self.room(L)
        self.box, self.bounds = self.room(2 * n1), self.room(2 * n1)
        self.point, self.slope, self.effect_values = self.room(n1), self.room(n1), self.room(6 + L)
        self.multipliers = self.room(most_rows)
        self.values, self.counted = self.room(most_rows + n1), self.room(most_rows + n1)

    cdef void take(self, problem, list kept):
        """Take what a problem shares with those of other states; its arrays are kept in a list."""
        cdef cnp.ndarray most = as_vector(problem.max_normal_force, self.contact_count)
        cdef cnp.ndarray wrench = as_vector(problem.external_wrench, 6)
        cdef cnp.ndarray lower = as_vector(problem.lower_torque, self.joint_count)
        cdef cnp.ndarray upper = as_vector(problem.upper_torque, self.joint_count)
        cdef cnp.ndarray sliding = as_shaped(problem.sliding, self.contact_count, 3)
        kept += [most, wrench, lower, upper, sliding]
        self.largest_normal, self.wrench, self.lower = data(most), data(wrench), data(lower)
        self.upper, self.sliding = data(upper), data(sliding)
        self.count_rows()

    cdef void count_rows(self) noexcept:
        """Find which rows there are under these limits, and whether there is a load."""
        cdef Py_ssize_t k
        cdef double limit
        self.peak_count = 0
        if self.objective != MARGIN:
            for k in range(2 * self.joint_count):
                limit = self.limit_of(k)
                if self.objective == TORQUE or (isfinite(limit) and limit > 0.0):
                    self.peak_joint[self.peak_count] = k
                    self.peak_count += 1
        self.loaded = False
        for k in range(6):
            self.loaded = self.loaded or self.wrench[k] != 0.0
        self.first_torque_row = 6 + self.peak_count + self.fixed_count
        self.row_count = self.first_torque_row + self.joint_count

    cdef double limit_of(self, Py_ssize_t side) noexcept:
        """The size of a joint's upper limit, or of a lower one, which come after all upper ones."""
        cdef Py_ssize_t L = self.joint_count
        return self.upper[side] if side < L else -self.lower[side - L]

    cdef void hold(self, problem, list kept):
        """Take a whole problem; its arrays are kept in a list."""
        cdef Py_ssize_t M = self.contact_count
        cdef cnp.ndarray points = as_shaped(problem.positions, M, 3)
        cdef cnp.ndarray normals = as_shaped(problem.normals, M, 3)
        cdef cnp.ndarray tangents = as_blocks(problem.tangents, M, 3, 2)
        cdef cnp.ndarray jacobian = as_shaped(problem.jacobian, 3 * M, self.joint_count)
        cdef cnp.ndarray gravity = as_vector(problem.gravity_torques, self.joint_count)
        kept += [points, normals, tangents, jacobian, gravity]
        self.take(problem, kept)
        self.points, self.normals, self.tangents = data(points), data(normals), data(tangents)
        self.jacobian, self.gravity = data(jacobian), data(gravity)

    cdef bint posed(self) noexcept:
        """Assemble what the state changes; False where it has to be left to the general way."""
        cdef Py_ssize_t n = self.coordinate_count, W = self.effect_count, L = self.joint_count
        cdef Py_ssize_t c, k, j, contact
        cdef double top, limit, size, least = INFINITY, margin
        cdef double* out
        scales_of(
            self.contact_count, L, self.points, self.wrench, self.jacobian, self.largest_normal,
            self.least_lever, self.rounding, &self.force, &self.length, self.joint_scale,
        )
        if self.required > 0.0 and not self.loaded:
            for k in range(L):
                self.joint_scale[k] *= self.required / self.force
            self.force = self.required
        top = 0.0
        for k in range(self.contact_count):
            least, top = min(least, self.largest_normal[k]), max(top, self.largest_normal[k])
        if top > self.farthest * self.force:
            return False
        self.restrict(top)
        directions_of(
            self.contact_count, self.normals, self.tangents, self.friction, self.sliding,
            self.has_cone, self.frames,
        )
        margin = self.required / self.force
        for k in range(L):
            self.torque_reach[k] = fabs(self.gravity[k] / self.joint_scale[k])
        for c in range(n):
            contact, out = self.axes[c] // 3, self.effects + W * c
            effects_of(
                self.frames + 3 * self.axes[c], self.points + 3 * contact,
                self.jacobian + 3 * L * contact, L, out,
            )
            top = self.largest_normal[contact] / self.force
            self.box[c] = self.reach[c] * top
            self.box[n + 1 + c] = self.reach[n + c] * top
            for k in range(3):
                out[3 + k] /= self.length
            for k in range(L):
                out[6 + k] *= self.force / self.joint_scale[k]
                self.torque_reach[k] += fabs(out[6 + k]) * self.box[n + 1 + c]
            self.bounds[c], self.bounds[n + 1 + c] = -INFINITY, INFINITY
            if self.objective != MARGIN and self.axes[c] % 3 == 0:
                self.bounds[n + 1 + c] = top - margin
                if not self.has_cone[contact]:
                    self.bounds[c] = margin
        self.box[n], self.bounds[2 * n + 1] = 0.0, INFINITY
        if self.objective == MARGIN:
            self.unit, self.bounds[n] = self.force, -INFINITY
            self.box[2 * n + 1] = 0.5 * least / self.force
            return True
        self.unit, self.bounds[n], top = 0.0, 0.0, 0.0
        if self.objective == TORQUE:
            for k in range(L):
                self.unit = max(self.unit, self.joint_scale[k])
            if self.unit == 0.0:
                self.unit = self.force
        else:
            for k in range(self.peak_count):
                j = self.peak_joint[k]
                self.unit = max(self.unit, self.joint_scale[j % L] / self.limit_of(j))
            self.unit = min(self.unit, 1.0) if self.unit > 0.0 else 1.0
        for k in range(self.peak_count):
            j = self.peak_joint[k] % L
            limit, size = 1.0, 1.0
            if self.objective == SHARE:
                limit = self.limit_of(self.peak_joint[k])
                size = max(self.joint_scale[j] / limit / self.unit, 1.0)
            self.peak_level[k] = 1.0 / size
            self.peak_share[k] = self.joint_scale[j] / (self.unit * size * limit)
            top = max(top, self.torque_reach[j] * self.peak_share[k] / self.peak_level[k])
            if self.peak_joint[k] >= L:
                self.peak_share[k] = -self.peak_share[k]
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
        for k in range(self.joint_count):
            for limit in (fabs(self.lower[k]), fabs(self.upper[k])):
                if isfinite(limit):
                    largest[self.turns[k]] = max(largest[self.turns[k]], limit)
        for k in range(self.joint_count):
            least = largest[self.turns[k]] if largest[self.turns[k]] > 0.0 else self.joint_scale[k]
            limit = min(fabs(self.lower[k]), fabs(self.upper[k]))
            limit = max(limit, self.least_limit * least)
            self.strict = max(self.strict, self.joint_scale[k] / limit)
        for k in range(self.contact_count):
            limit = max(self.largest_normal[k], self.least_limit * most)
            self.strict = max(self.strict, self.force / limit)
        if self.strict > self.most_strict:
            self.strict = INFINITY

    cdef double side(self, Py_ssize_t i, bint top) noexcept:
        """The lower or upper side of a row, or the bound of a variable."""
        cdef Py_ssize_t j, k
        if i < 6:
            return -self.wrench[i] / (self.force if i < 3 else self.force * self.length)
        if i >= self.row_count:
            return self.bounds[i - self.row_count + (self.coordinate_count + 1 if top else 0)]
        if i >= self.first_torque_row:
            j = i - self.first_torque_row
            return ((self.upper[j] if top else self.lower[j]) - self.gravity[j]) / (
                self.joint_scale[j]
            )
        if not top:
            return -INFINITY
        if i < 6 + self.peak_count:
            k, j = i - 6, self.peak_joint[i - 6] % self.joint_count
            return -self.peak_share[k] * (self.gravity[j] / self.joint_scale[j])
        k = i - 6 - self.peak_count
        if k < self.face_count:
            return -self.required / self.force if self.objective != MARGIN else 0.0
        k -= self.face_count
        return self.largest_normal[k] / self.force if k < self.contact_count else 0.0

    cdef void write_changing_row(self, Py_ssize_t i, double* row, Py_ssize_t step) noexcept:
        """Put a row that each state changes into a place, its entries some steps apart."""
        cdef Py_ssize_t n = self.coordinate_count, c, effect = i
        cdef double share = 1.0, last = 0.0
        if i >= self.first_torque_row:
            effect = 6 + i - self.first_torque_row
        elif i >= 6:
            share, last = self.peak_share[i - 6], -self.peak_level[i - 6]
            effect = 6 + self.peak_joint[i - 6] % self.joint_count
        for c in range(n):
            row[step * c] = share * self.effects[self.effect_count * c + effect]
        row[step * n] = last

    cdef void row_values(self, const double* point, double* values) noexcept:
        """Put the values of all rows, and after them the variables, into a place."""
        cdef Py_ssize_t n = self.coordinate_count, W = self.effect_count, L = self.joint_count
        cdef Py_ssize_t c, i, k, first = 6 + self.peak_count
        cdef double* level = self.effect_values
        memset(level, 0, W * sizeof(double))
        for c in range(n):
            for k in range(W):
                level[k] += point[c] * self.effects[W * c + k]
        memcpy(values, level, 6 * sizeof(double))
        for i in range(self.peak_count):
            values[6 + i] = (
                self.peak_share[i] * level[6 + self.peak_joint[i] % L]
                - self.peak_level[i] * point[n]
            )
        for i in range(self.fixed_count):
            values[first + i] = fixed_row_at(self, i, point)
        memcpy(values + self.first_torque_row, level + 6, L * sizeof(double))
        memcpy(values + self.row_count, point, (n + 1) * sizeof(double))

    cdef void add_rows(self, const double* weights, double* slope) noexcept:
        """Add rows, and after them the variables, times weights to a slope."""
        cdef Py_ssize_t n = self.coordinate_count, W = self.effect_count, L = self.joint_count
        cdef Py_ssize_t c, i, k, first = 6 + self.peak_count
        cdef double* v = self.effect_values
        memcpy(v, weights, 6 * sizeof(double))
        memset(v + 6, 0, L * sizeof(double))
        for i in range(self.peak_count):
            v[6 + self.peak_joint[i] % L] += self.peak_share[i] * weights[6 + i]
            slope[n] -= self.peak_level[i] * weights[6 + i]
        for k in range(L):
            v[6 + k] += weights[self.first_torque_row + k]
        for i in range(self.fixed_count):
            if weights[first + i] != 0.0:
                add_fixed_row(self, i, weights[first + i], slope)
        for c in range(n):
            slope[c] += inner(self.effects + W * c, v, W)
        for c in range(n + 1):
            slope[c] += weights[self.row_count + c]

    cdef void assess(self) noexcept:
        """Find what point and multipliers prove, see `Program.assess`."""
        cdef Py_ssize_t n = self.coordinate_count, c, i
        cdef double* slope = self.slope
        cdef double weight, at, total = 0.0, bound = 0.0, residual = 0.0, last = self.point[n]
        self.row_values(self.point, self.values)
        memset(self.counted, 0, (self.row_count + n + 1) * sizeof(double))
        for i in range(self.row_count):
            weight = self.multipliers[i]
            total += weight
            if i >= self.first_torque_row:
                residual = max(residual, self.side(i, False) - self.values[i])
            at = self.values[i] - self.side(i, True)
            residual = max(residual, at if i >= 6 else fabs(at))
            if weight != 0.0:
                at = self.side(i, weight > 0.0)
                if isfinite(at):
                    bound -= weight * at
                    self.counted[i] = weight
        memset(slope, 0, (n + 1) * sizeof(double))
        slope[n] = self.cost()
        self.add_rows(self.counted, slope)
        for c in range(n + 1):
            at = self.point[c]
            total += at
            residual = max(residual, at - self.bounds[n + 1 + c], self.bounds[c] - at)
            if c < n and self.axes[c] % 3 == 0:  # the faces of a narrow cone tell less
                residual = max(residual, -at)
            if slope[c] >= 0.0:
                bound += slope[c] * max(self.box[c], self.bounds[c])
            else:
                bound += slope[c] * min(self.box[n + 1 + c], self.bounds[n + 1 + c])
        self.value = self.cost() * last
        self.bound, self.residual = bound, residual if isfinite(total) else INFINITY

    cdef double cost(self) noexcept:
        """What the last variable costs: the margin, or the largest torque."""
        return -1.0 if self.objective == MARGIN else 1.0


cdef inline double sliding_sign(const double* signs, Py_ssize_t axis) noexcept nogil:
    """The sign among (M, 2) of the sliding along a tangent, by the number of its axis."""
    return signs[2 * (axis // 3) + axis % 3 - 1]


cdef inline double fixed_row_at(
    PaperPrograms programs, Py_ssize_t row, const double* point
) noexcept nogil:
    """The value of a row that no state changes, or of a unit row after these."""
    cdef Py_ssize_t e
    cdef double value = 0.0
    for e in range(programs.row_start[row], programs.row_start[row + 1]):
        value += programs.row_value[e] * point[programs.row_column[e]]
    return value


cdef inline void add_fixed_row(
    PaperPrograms programs, Py_ssize_t row, double weight, double* slope
) noexcept nogil:
    """Add such a row times a weight to a slope."""
    cdef Py_ssize_t e
    for e in range(programs.row_start[row], programs.row_start[row + 1]):
        slope[programs.row_column[e]] += weight * programs.row_value[e]


cdef inline void add_fixed_square(
    PaperPrograms programs, Py_ssize_t row, double weight, double* gram
) noexcept nogil:
    """Add the products of such a row's entries with each other, times a weight, to a lower half."""
    cdef Py_ssize_t n1 = programs.coordinate_count + 1, e, f
    for e in range(programs.row_start[row], programs.row_start[row + 1]):
        for f in range(programs.row_start[row], e + 1):
            # Columns of a row rise.
            gram[n1 * programs.row_column[e] + programs.row_column[f]] += (
                weight * programs.row_value[e] * programs.row_value[f]
            )
