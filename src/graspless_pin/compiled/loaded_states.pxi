"""Optima of states whose contacts stay while loads, friction and limits change, and their proof."""

cdef class LoadedStates(ColdOptima):
    """A carrier for problems that differ in what bears on the same contacts."""

    cdef void set_friction(self, const double* friction) noexcept:
        """Put coefficients of friction into the cones, above zero where they were."""
        cdef Py_ssize_t M = self.contact_count, n = self.coordinate_count, c, i, e, axis
        cdef double slope, size
        if memcmp(self.friction, friction, M * sizeof(double)) == 0:
            return
        for i in range(M):
            self.friction[i] = friction[i]
            self.slopes[i] = friction[i] * cos(M_PI / self.edge_count)
        for c in range(n):
            if self.axes[c] % 3:
                self.reach[c] = -friction[self.axes[c] // 3]
                self.reach[n + c] = friction[self.axes[c] // 3]
        for i in range(self.face_count):
            slope = self.slopes[self.axes[self.row_column[self.row_start[i]]] // 3]
            size = sqrt(1.0 + slope * slope)
            for e in range(self.row_start[i], self.row_start[i + 1]):
                if self.row_column[e] < n:
                    axis = self.axes[self.row_column[e]] % 3
                    self.row_value[e] = (
                        self.directions[self.edge_count * (axis - 1) + i % self.edge_count]
                        if axis else -slope
                    ) / size
        self.friction_count += 1

    def optima(self, problem, loads, Py_ssize_t begin, list starts, bint cold, figures, torques):
        """Find the optima of states, one after the other, until one is not found.

        Args:
            problem: One of them, of which the contacts and the Jacobian count.
            loads: (K, 2M + 6 + 3L): of each state the (M,) coefficients of friction, the wrench,
                the (L,) lower and (L,) upper torques, those that the hand's weight takes, and the
                (M,) largest normal forces.
            begin: The first state.
            starts: As in `WarmOptima.warm_optimum`; that which served last comes first afterwards.
            cold: Whether to look for an optimum that none of them leads to.
            figures: (K, 6) array for the `FIGURES` of all states.
            torques: (K, L) array for their torques.

        Returns:
            The first state whose optimum is not found, or K.
        """
        cdef list kept = []
        self.hold(problem, kept)
        cdef Py_ssize_t M = self.contact_count, L = self.joint_count, count = len(loads)
        cdef Py_ssize_t width = 2 * M + 6 + 3 * L
        cdef cnp.ndarray rows = as_shaped(loads, count, width)
        cdef const double* row
        figures, torques = as_shaped(figures, count, 6), as_shaped(torques, count, L)
        if begin < 0:
            raise ValueError("needs states that exist")
        while begin < count:
            row = data(rows) + width * begin
            self.set_friction(row)
            self.wrench, self.lower, self.upper = row + M, row + M + 6, row + M + 6 + L
            self.gravity, self.largest_normal = row + M + 6 + 2 * L, row + M + 6 + 3 * L
            self.count_rows()
            if not self.tried(starts, cold):
                break
            self.write_figures(data(figures) + 6 * begin, data(torques) + L * begin, 3 * M)
            begin += 1
        return begin
