"""Optima in modes that are known, by pivots from the last state's, and what they prove of all."""

cdef double _SAME_ROW = 1e-12  # rows that differ by less are the same


cdef class ModeCover:
    """Parts that together hold all modes with a motion behind them."""

    cdef Py_ssize_t count, rows_count
    cdef cnp.ndarray signs
    cdef list programs

    def __init__(self, signs):
        """Take the parts.

        Args:
            signs: (K, M, 2) signs that sliding may have in each; NaN where it may have both, and
                zero where there is no friction.
        """
        self.signs, self.programs, self.rows_count = as_reals(signs, 3).copy(), [], -1
        self.count = self.signs.shape[0]
        if self.signs.shape[2] != 2:
            raise ValueError("needs signs along two tangents")


cdef class ModePrograms(LoadedStates):
    """States whose contacts stay while the load turns: from one to the next few limits change.

    In each of the modes that led to an optimum before, friction has signs and the program is one
    that the simplex method goes on with. What its multipliers say of signs is no bound for other
    modes; then the multipliers of the program without signs may be, or those of parts that hold all
    modes.
    """

    cdef double* marginals
    cdef double* bounding
    cdef double* best_point
    cdef double best
    cdef Start best_start
    cdef list covers
    cdef DenseSimplex any_mode
    cdef bint is_bounded, by_cover
    cdef Py_ssize_t any_rows
    cdef double* known_rows
    cdef double enough, closed
    cdef object held
    cdef Py_ssize_t rows_count, held_count, known_friction, known_row_count

    def __init__(self, **shared):
        """Take what the problems share, see `ColdOptima`."""
        LoadedStates.__init__(self, **shared)
        cdef Py_ssize_t n1 = self.coordinate_count + 1
        cdef Py_ssize_t changing = 6 + 3 * self.joint_count
        self.marginals = self.room(changing + self.fixed_count)
        self.bounding = self.room(changing + self.fixed_count)
        self.best_point, self.covers = self.room(n1), []
        self.known_rows = self.room(changing * n1)
        self.enough, self.closed, self.held, self.by_cover = -1.0, 0.0, None, False
        self.rows_count = self.held_count = 0
        self.known_friction = self.known_row_count = self.any_rows = -1

    def decide(self, double enough, double closed, list covers not None):
        """Tell which margin is looked for, and what is known of all modes.

        Args:
            enough: A state is done with where it is proven that its margin is one at least, or is
                not, N; negative: optima are looked for.
            closed: What passes for none, over the larger of one and the margin, scaled.
            covers: `ModeCover`s; that which served last comes first afterwards.
        """
        self.enough, self.closed, self.covers = enough, closed, covers

    def optima(self, problem, loads, Py_ssize_t begin, list starts, bint cold, figures, torques):
        """Do what `LoadedStates.optima` does."""
        if problem is not self.held:
            self.held = problem
            self.held_count += 1
        return LoadedStates.optima(self, problem, loads, begin, starts, cold, figures, torques)

    cdef bint tried(self, list starts, bint cold) except -1:
        """Find the optimum in a mode of several; else that found otherwise: see `WarmOptima`."""
        cdef Py_ssize_t place
        cdef Start start
        if not self.posed():
            return False
        self._see_rows()
        self.is_bounded, self.best, self.best_start = False, INFINITY, None
        for place in range(len(starts)):
            start = starts[place]
            if start is not None and self._in_mode(start):
                starts.insert(0, starts.pop(place))
                self.by_cover = False
                return True
            # Where a cover was needed for the last state, it mostly is for this one.
            if place == 0 and self.by_cover and self.best_start is not None and self._covered():
                return True
        self.by_cover = self.best_start is not None and self._covered()
        if self.by_cover:
            starts.insert(0, starts.pop(starts.index(self.best_start)))
            return True
        return cold and self.begins(starts)

    cdef void _see_rows(self) noexcept:
        """Put the rows that contacts and joints make into a place, and count where they change."""
        cdef Py_ssize_t n1 = self.coordinate_count + 1, k
        cdef Py_ssize_t count = (self.row_count - self.fixed_count) * n1
        cdef double* known = self.known_rows
        cdef bint same = self.known_friction == self.friction_count
        same = same and self.known_row_count == self.row_count
        self.write_changing_rows()
        for k in range(count if same else 0):
            if fabs(self.changing_rows[k] - known[k]) > _SAME_ROW * (1.0 + fabs(known[k])):
                same = False
                break
        if not same:
            memcpy(known, self.changing_rows, count * sizeof(double))
            self.known_friction, self.known_row_count = self.friction_count, self.row_count
            self.rows_count += 1

    cdef DenseSimplex _program(self):
        """The program with its rows as they are known; sides and bounds are set for each state."""
        cdef Py_ssize_t n1 = self.coordinate_count + 1, i
        cdef cnp.ndarray rows = np.zeros((self.row_count, n1)), zero = np.zeros(self.row_count)
        cdef cnp.ndarray cost = np.zeros(n1)
        cdef DenseSimplex program
        cdef double* row = data(rows)
        data(cost)[n1 - 1] = self.cost()
        for i in range(self.row_count - self.fixed_count):
            memcpy(
                row + n1 * self.row_of_changing(i), self.known_rows + n1 * i, n1 * sizeof(double)
            )
        for i in range(self.fixed_count):
            add_fixed_row(self, i, 1.0, row + n1 * (6 + self.peak_count + i))
        program = DenseSimplex(cost, np.zeros(n1), np.zeros(n1))
        program.add_rows(rows, zero, zero)
        return program

    cdef bint _in_mode(self, Start start) except -1:
        """Go to the optimum in the mode of a start; whether it is one of all modes, or enough."""
        cdef double goal, none
        cdef bint done
        if not self.is_of(start):
            return False
        if start.rows_seen != self.rows_count:
            start.simplex, start.rows_seen = self._program(), self.rows_count
        if not self._go_on(start.simplex, start.signs, self.point, self.multipliers):
            return False
        done = self.is_proven()
        if not done and self.residual <= self.exact * max(1.0, fabs(self.value)):
            if self.enough >= 0.0:
                goal = self.enough / self.unit
                none = self.closed * max(1.0, goal)
                done = self.value <= none - goal or self.bound > none - goal
            if not done and self.value < self.best:
                self.best, self.best_start = self.value, start
                memcpy(
                    self.best_point, self.point, (self.coordinate_count + 1) * sizeof(double)
                )
            if not done:
                done = self._bounded() and self.is_proven()
        return done and self._is_witnessed(start)

    cdef bint _is_witnessed(self, Start start) noexcept:
        """Keep the forces, if a motion is behind the mode; it is looked at once for all states."""
        if start.witnessed == self.held_count:
            memcpy(self.motion, start.motion, self.effect_count * sizeof(double))
            self.keep_forces(start)
            return True
        if not self.is_behind(start, False):
            return False
        memcpy(start.motion, self.motion, self.effect_count * sizeof(double))
        start.witnessed = self.held_count
        return True

    cdef bint _covered(self) except -1:
        """Whether parts that hold all modes bound the best that was found in one; then keep it."""
        cdef double close = self.exact * max(1.0, fabs(self.best)), bound
        cdef Py_ssize_t place
        for place in range(len(self.covers)):
            bound = self._bound_of(self.covers[place], self.best - close)
            if bound < self.best - close:
                continue
            if place:
                self.covers.insert(0, self.covers.pop(place))
            memcpy(self.point, self.best_point, (self.coordinate_count + 1) * sizeof(double))
            memset(self.multipliers, 0, self.row_count * sizeof(double))
            self.assess()
            self.bound = bound
            return (
                self.residual <= close and self.residual * self.strict <= self.close
                and self.value <= self.cutoff and self._is_witnessed(self.best_start)
            )
        return False

    cdef double _bound_of(self, ModeCover cover, double enough) except? -1.0:
        """The lowest bound of the parts of a cover, or one that is not enough."""
        cdef Py_ssize_t n1 = self.coordinate_count + 1, part, c
        cdef double lowest = INFINITY, sign
        cdef const double* signs
        if cover.signs.shape[1] != self.contact_count:
            return -INFINITY
        if cover.rows_count != self.rows_count:
            cover.programs = [self._program() for part in range(cover.count)]
            cover.rows_count = self.rows_count
        for part in range(cover.count):
            signs = data(cover.signs) + 2 * self.contact_count * part
            if not self._go_on(cover.programs[part], signs, self.point, self.multipliers):
                return -INFINITY
            for c in range(self.coordinate_count):
                if self.axes[c] % 3:
                    sign = sliding_sign(signs, self.axes[c])
                    self.bounds[c] = 0.0 if sign <= 0.0 else -INFINITY
                    self.bounds[n1 + c] = 0.0 if sign >= 0.0 else INFINITY
            self.assess()
            for c in range(self.coordinate_count):
                if self.axes[c] % 3:
                    self.bounds[c], self.bounds[n1 + c] = -INFINITY, INFINITY
            lowest = min(lowest, self.bound)
            if lowest < enough:
                break
        return lowest

    cdef bint _bounded(self) except -1:
        """Take the multipliers of the program without signs; whether there are any."""
        if not self.is_bounded:
            if self.any_rows != self.rows_count:
                self.any_mode, self.any_rows = self._program(), self.rows_count
            # Its point goes where slopes are worked out next.
            if not self._go_on(self.any_mode, NULL, self.slope, self.bounding):
                return False
            self.is_bounded = True
        memcpy(self.multipliers, self.bounding, self.row_count * sizeof(double))
        return True

    cdef bint _go_on(
        self, DenseSimplex program, const double* signs, double* x, double* w
    ) noexcept:
        """Solve a program for this state; friction is against signs, if any are given.

        Args:
            program: Whose rows are those of this state.
            signs: (M, 2) zero where there is no friction, NaN where it is free; NULL: it is.
            x: Takes the point.
            w: Takes the multipliers of all rows.
        """
        cdef Py_ssize_t n1 = self.coordinate_count + 1, c, i
        cdef double sign
        for i in range(self.row_count):
            program.lower[n1 + i] = self.side(i, False)
            program.upper[n1 + i] = self.side(i, True)
        for c in range(n1):
            program.lower[c], program.upper[c] = self.bounds[c], self.bounds[n1 + c]
            if signs != NULL and c < self.coordinate_count and self.axes[c] % 3:
                sign = sliding_sign(signs, self.axes[c])
                if sign >= 0.0:
                    program.upper[c] = min(program.upper[c], 0.0)
                if sign <= 0.0:
                    program.lower[c] = max(program.lower[c], 0.0)
        if program.optimum(x, self.marginals) != OPTIMAL:
            return False
        for i in range(self.row_count):
            w[i] = -self.marginals[i]
        return True
