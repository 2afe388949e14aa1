"""Optima of Algorithms 1 and 2 by a warm start from the active set of a similar problem, proven."""

cdef Py_ssize_t _MOST_STARTS = 8

FIGURES = ("margin", "value", "bound", "gap", "residual", "unit")
"""Columns of what `WarmOptima.optima_of_states` finds, in the objective's unit or scaled."""


cdef class WarmOptima(PaperPrograms):
    """Programs with a workspace for the optimum of one problem."""

    cdef double damping, exact, close, cutoff
    cdef int corrections
    cdef double* point_change
    cdef double* normal_equations
    cdef double* forces
    cdef double* map
    cdef double* scaled
    cdef double* scale
    cdef double* motion
    cdef double* signs
    cdef Start served

    def __init__(
        self, double damping, int corrections, double exact, double close, double cutoff, **shared
    ):
        """Take what the problems share.

        Args:
            damping: What the diagonal is raised by where active rows depend on each other.
            corrections: Steps of iterative refinement that take it away again.
            exact: Largest residual and gap of an optimum, scaled.
            close: Largest residual over how much more closely limits have to be kept.
            cutoff: A value from which on there is no solution.
            shared: See `PaperPrograms`.
        """
        PaperPrograms.__init__(self, **shared)
        cdef Py_ssize_t n1 = self.coordinate_count + 1, M = self.contact_count
        self.damping, self.corrections, self.exact = damping, corrections, exact
        self.close, self.cutoff = close, cutoff
        self.point_change, self.normal_equations = self.room(n1), self.room(n1 * n1)
        self.forces, self.signs = self.room(3 * M), self.room(2 * M)
        self.map = self.room(3 * M * self.effect_count)
        self.scaled = self.room(3 * M * self.effect_count)
        self.scale, self.motion = self.room(self.effect_count), self.room(self.effect_count)

    cdef bint refined(self, Start start) noexcept:
        """Find point and multipliers for the active rows of an earlier optimum.

        With all active rows A and their sides b, A x = b and A^T w = -c: least squares by damped
        normal equations, and iterative refinement.
        """
        cdef Py_ssize_t n1 = self.coordinate_count + 1, D = start.changing_count, c, q, i, j, _
        cdef Py_ssize_t count = D + start.fixed_count
        cdef double trace = 0.0, share
        cdef const double* column
        cdef double* G = self.normal_equations
        cdef double* A = start.changing_rows
        cdef double* w = start.multipliers
        cdef double* b = start.left
        cdef double* x = self.point
        for q in range(count):
            start.sides[q] = self.side(start.rows[q], start.upper[q])
            if not isfinite(start.sides[q]):
                return False
        for q in range(D):
            self.write_changing_row(start.rows[q], A + q, D)
        for i in range(n1):
            for j in range(i + 1):
                G[n1 * i + j] = start.gram[n1 * i + j] + inner(A + D * i, A + D * j, D)
            trace += G[n1 * i + i]
        for i in range(n1):
            G[n1 * i + i] += self.damping * trace
        if not factor(G, n1):
            return False
        memcpy(w, start.weights, count * sizeof(double))
        memcpy(x, start.point, n1 * sizeof(double))
        for _ in range(self.corrections):
            # What is left of the sides, and the slope of the Lagrangian.
            memcpy(b, start.sides, count * sizeof(double))
            for c in range(n1):
                column, share = A + D * c, x[c]
                for q in range(D):
                    b[q] -= column[q] * share
                self.slope[c] = inner(column, w, D)
            self.slope[n1 - 1] += self.cost()
            for q in range(start.fixed_count):
                b[D + q] -= fixed_row_at(self, start.fixed_rows[q], x)
                add_fixed_row(self, start.fixed_rows[q], w[D + q], self.slope)
            for c in range(n1):
                self.point_change[c] = inner(A + D * c, b, D)
            for q in range(start.fixed_count):
                add_fixed_row(self, start.fixed_rows[q], b[D + q], self.point_change)
            solve_factored(G, n1, self.slope)
            solve_factored(G, n1, self.point_change)
            for c in range(n1):
                column, share = A + D * c, self.slope[c]
                for q in range(D):
                    w[q] -= column[q] * share
                x[c] += self.point_change[c]
            for q in range(start.fixed_count):
                w[D + q] -= fixed_row_at(self, start.fixed_rows[q], self.slope)
        memset(self.multipliers, 0, self.row_count * sizeof(double))
        for q in range(count):
            if start.rows[q] >= self.row_count:
                x[start.rows[q] - self.row_count] = start.sides[q]
            else:
                self.multipliers[start.rows[q]] = w[q]
        return True

    cdef bint is_of(self, Start start) noexcept:
        """Whether a start is of a program with as many rows and variables."""
        return (
            start.row_count == self.row_count and start.effect_count == self.effect_count
            and start.variable_count == self.coordinate_count + 1
        )

    cdef bint optimum(self, Start start, bint has_map) noexcept:
        """Find and prove the optimum that an earlier one leads to."""
        cdef Py_ssize_t c
        if not self.is_of(start):
            return False
        if start.friction_count != self.friction_count:
            start.fit(self)
        if not self.refined(start):
            return False
        for c in range(self.coordinate_count):
            if self.axes[c] % 3 and self.point[c] * sliding_sign(start.signs, self.axes[c]) >= 0.0:
                self.point[c] = 0.0
        return self.is_proven() and self.is_behind(start, has_map)

    cdef bint is_proven(self) noexcept:
        """Whether point and multipliers are an optimum and its proof."""
        cdef double close
        self.assess()
        close = self.exact * max(1.0, fabs(self.value))
        return (
            self.residual <= close and fabs(self.value - self.bound) <= close
            and self.residual * self.strict <= self.close and self.value <= self.cutoff
        )

    cdef bint is_behind(self, Start start, bint has_map) noexcept:
        """Find the motion of an earlier optimum; whether it is behind its mode. Keep the forces."""
        if not has_map:
            self.write_map()
        if start.slide_count:
            if not witness_of(
                self.contact_count, self.effect_count, self.scaled, start.slide_count,
                start.contacts, start.own_signs, start.motion, 0, start.judged[0],
                <int>start.judged[1], start.judged[2], start.judged[3], start.workspace, self.signs,
                self.motion,
            ):
                return False
        else:
            memcpy(self.motion, start.motion, self.effect_count * sizeof(double))
        self.keep_forces(start)
        return True

    cdef void write_map(self) noexcept:
        """Put the map of virtual motions, and the same scaled, into places."""
        map_of(
            self.contact_count, self.joint_count, self.points, self.normals, self.tangents,
            self.jacobian, self.map,
        )
        scaled_of(3 * self.contact_count, self.effect_count, self.map, self.scale, self.scaled)

    cdef void keep_forces(self, Start start) noexcept:
        """Take the forces of the point, to which an earlier optimum has led."""
        cdef Py_ssize_t c, k
        memset(self.forces, 0, 3 * self.contact_count * sizeof(double))
        for c in range(self.coordinate_count):
            for k in range(3):
                self.forces[3 * (self.axes[c] // 3) + k] += (
                    self.force * self.point[c] * self.frames[3 * self.axes[c] + k]
                )
        self.served = start

    cdef Start begun(self):
        """What an optimum of the problem leaves behind that is found otherwise; None: nothing."""
        return None

    def warm_optimum(self, problem, list starts):
        """Return the optimum of one problem, if one of several earlier ones leads to it.

        Args:
            problem: The problem, or what loops read of it.
            starts: `Start`s, or None in the place of what does not fit.

        Returns:
            The place of the one that leads to it, and of the optimum: (M, 3) forces, the factor
            from values to the objective's unit, (n + 1,) the point, value, bound and residual, (R,)
            multipliers, (6 + L,) a motion, scaled, and (6 + L,) its scale; the contacts and (M, 2)
            signs of the mode, and the solver of the start that led to it. None if none does.
        """
        cdef list kept = []
        self.hold(problem, kept)
        cdef Py_ssize_t place = self.serving(starts) if self.posed() else -1
        return None if place < 0 else (place, self.result())

    cdef Py_ssize_t serving(self, list starts) except -2:
        """The place of the first start that leads to the optimum; -1: none does."""
        cdef Py_ssize_t place
        for place in range(len(starts)):
            if starts[place] is not None and self.optimum(starts[place], False):
                return place
        return -1

    cdef bint begins(self, list starts) except -1:
        """Find the optimum otherwise, and put what it leaves behind before the starts."""
        cdef Start start = self.begun()
        if start is None or not self.optimum(start, True):
            return False
        starts.insert(0, start)
        del starts[_MOST_STARTS:]
        return True

    cdef bint tried(self, list starts, bint cold) except -1:
        """Find the optimum that one of several earlier ones leads to; else that found otherwise.

        Args:
            starts: As in `warm_optimum`; that which served comes first afterwards.
            cold: Whether to look for one otherwise.
        """
        if not self.posed():
            return False
        cdef Py_ssize_t place = self.serving(starts)
        if place < 0:
            return cold and self.begins(starts)
        starts.insert(0, starts.pop(place))
        return True

    cdef void write_figures(self, double* figures, double* torques, Py_ssize_t rows) noexcept:
        """Write the `FIGURES` and the torques; the first rows of forces act on joints."""
        cdef Py_ssize_t k, j, L = self.joint_count
        figures[0] = margin_of(
            self.contact_count, self.forces, self.normals, self.tangents, self.slopes,
            self.has_cone, self.largest_normal, self.edge_count, self.directions,
        )
        figures[1], figures[4], figures[5] = self.value, self.residual, self.cost() * self.unit
        figures[2], figures[3] = self.bound * figures[5], (self.value - self.bound) * self.unit
        for j in range(L):
            torques[j] = self.gravity[j]
        for k in range(rows):
            for j in range(L):
                torques[j] += self.forces[k] * self.jacobian[L * k + j]

    def result(self):
        """What was found of the last problem, as `warm_optimum` returns it."""
        cdef Start start = self.served
        cdef Py_ssize_t k, M = self.contact_count
        if start is None:
            raise ValueError("no optimum was found")
        return (
            _copied(self.forces, 3 * M).reshape(M, 3), self.unit,
            _copied(self.point, self.coordinate_count + 1), self.value, self.bound, self.residual,
            _copied(self.multipliers, self.row_count), _copied(self.motion, self.effect_count),
            _copied(self.scale, self.effect_count),
            [start.contacts[k] for k in range(start.slide_count)],
            _copied(start.signs, 2 * M).reshape(M, 2), start.solver,
        )

    def optima_of_states(
        self, problem, list starts, bint may_begin, order, states, moves, carriers, center, axes,
        figures, torques,
    ):
        """Find the optima of states with the same contacts until one is not found.

        Args:
            problem: What the problems of all of them share; the contacts with supports come last.
            starts: As in `warm_optimum`; that which served last comes first afterwards.
            may_begin: Whether an optimum may be looked for of which nothing is known.
            order: Numbers of the states.
            states: What `HandStates.at` returned.
            moves: (n + 1, L) see `jacobian_of`.
            carriers: The joint that carries each contact with the hand.
            center: (3,) what positions are about, m.
            axes: (A, 3) see `tangents_of`.
            figures: (S, 6) array for the `FIGURES` of all states.
            torques: (S, L) array for their torques.

        Returns:
            How many in that order are found before the first one that is not.
        """
        cdef list kept = []
        self.take(problem, kept)
        cdef cnp.ndarray rows = as_reals(states[2], 3), columns = as_reals(states[3], 3)
        cdef cnp.ndarray weights = as_reals(states[4], 2), mask = as_reals(moves, 2)
        cdef cnp.ndarray numbers = as_integers(order, len(order)), about = as_vector(center, 3)
        cdef cnp.ndarray carrier = as_integers(carriers, len(carriers)), given = as_reals(axes, 2)
        cdef Py_ssize_t M = self.contact_count, L = self.joint_count, H = carrier.shape[0]
        cdef Py_ssize_t total = weights.shape[0], count = 0, most = rows.shape[1], number, k, j
        cdef cnp.ndarray points = as_shaped(problem.positions, M, 3).copy()
        cdef cnp.ndarray normals = as_shaped(problem.normals, M, 3).copy()
        cdef cnp.ndarray tangents = as_blocks(problem.tangents, M, 3, 2).copy()
        cdef cnp.ndarray jacobian = np.empty((3 * M, L))
        cdef const double* row
        if H > min(M, most) or weights.shape[1] != L or mask.shape[1] != L:
            raise ValueError("needs states of these contacts")
        rows, columns = as_blocks(rows, total, most, 6), as_blocks(columns, total, 6, L)
        figures, torques = as_shaped(figures, total, 6), as_shaped(torques, total, L)
        for k in range(H):
            if not 0 <= numbers_of(carrier)[k] < mask.shape[0]:
                raise ValueError("needs joints that exist")
        memset(data(jacobian), 0, 3 * M * L * sizeof(double))
        self.points, self.normals, self.tangents = data(points), data(normals), data(tangents)
        self.jacobian = data(jacobian)
        while count < numbers.shape[0]:
            number = numbers_of(numbers)[count]
            if not 0 <= number < total:
                raise ValueError("needs states that exist")
            for k in range(H):
                row = data(rows) + 6 * (most * number + k)
                for j in range(3):
                    data(points)[3 * k + j] = row[j] - data(about)[j]
                    data(normals)[3 * k + j] = row[3 + j]
                jacobian_of(
                    L, data(columns) + 6 * L * number, data(mask) + L * numbers_of(carrier)[k], row,
                    data(jacobian) + 3 * L * k,
                )
            tangents_of(H, data(normals), given.shape[0], data(given), data(tangents))
            self.gravity = data(weights) + L * number
            if not self.tried(starts, may_begin and len(starts) > 0):
                break
            self.write_figures(data(figures) + 6 * number, data(torques) + L * number, 3 * H)
            count += 1
        return count


cdef cnp.ndarray _copied(const double* values, Py_ssize_t count):
    cdef cnp.ndarray array = empty1(count)
    memcpy(data(array), values, count * sizeof(double))
    return array
