"""Warm starts: what an optimum leaves behind for those of similar problems."""

cdef class Start(KeptArrays):
    """What is active at an optimum, the mode that admits it and a motion behind that mode."""

    cdef Py_ssize_t row_count, changing_count, fixed_count, slide_count, friction_count
    cdef Py_ssize_t variable_count, effect_count
    # The program of the mode, of which rows, and the contacts that its motion was seen with.
    cdef DenseSimplex simplex
    cdef Py_ssize_t rows_seen, witnessed
    cdef readonly str solver
    # Active rows, those that each state changes first, and where the others are in the programs.
    cdef cnp.npy_intp* rows
    cdef cnp.npy_intp* fixed_rows
    cdef cnp.npy_bool* upper
    cdef double* weights
    cdef double* point
    # Products of the fixed rows with each other.
    cdef double* gram
    cdef cnp.npy_intp* contacts
    cdef double* signs
    cdef double* own_signs
    cdef double* motion
    cdef double judged[4]
    # Room: (n + 1, D) changing rows, multipliers, sides and what is left of them.
    cdef double* changing_rows
    cdef double* multipliers
    cdef double* sides
    cdef double* left
    cdef double* workspace

    def __init__(
        self, PaperPrograms programs not None, rows, at_bounds, upper, x, weights, Py_ssize_t count,
        signs, contacts, own_signs, motion, judged_by, str solver="",
    ):
        """Take an optimum of one of the problems that the programs are of.

        Args:
            programs: The programs.
            rows: (r,) the active rows.
            at_bounds: (h,) variables at a bound.
            upper: (r + h,) whether it is the upper side, or bound.
            x: (n + 1,) the point.
            weights: (r + h,) its multipliers.
            count: R, the number of all rows.
            signs: (M, 2) of the mode's sliding.
            contacts: (s,) those that the mode selects.
            own_signs: (2 s,) theirs.
            motion: (6 + L,) scaled.
            judged_by: The last four figures that `witness_of` judges by.
            solver: Which found it.

        Raises:
            ValueError: If the shapes do not fit.
        """
        cdef Py_ssize_t M = programs.contact_count, L = programs.joint_count, W = 6 + L
        cdef Py_ssize_t n1 = programs.coordinate_count + 1, first_torque = count - L
        cdef Py_ssize_t first_fixed = first_torque - programs.fixed_count, r, m, k, i, q = 0
        cdef cnp.ndarray active = as_integers(rows, len(rows))
        cdef cnp.ndarray bounded = as_integers(at_bounds, len(at_bounds))
        r = active.shape[0]
        m = r + bounded.shape[0]
        cdef cnp.ndarray top = as_flags(upper, m), given = as_vector(weights, m)
        self.row_count, self.slide_count, self.solver = count, len(contacts), solver
        self.rows_seen = self.witnessed = -1
        self.variable_count, self.effect_count = n1, W
        if not 0 <= first_fixed - 6 <= 2 * L:
            raise ValueError("needs rows of these programs")
        self.point = self.reals(as_vector(x, n1).copy())
        self.signs = self.reals(as_shaped(signs, M, 2).copy())
        self.contacts = self.numbers(as_integers(contacts, self.slide_count).copy())
        self.own_signs = self.reals(as_vector(own_signs, 2 * self.slide_count).copy())
        self.motion = self.reals(as_vector(motion, W).copy())
        for k in range(self.slide_count):
            if not 0 <= self.contacts[k] < M:
                raise ValueError("needs contacts that exist")
        for k in range(4):
            self.judged[k] = judged_by[k]
        self.rows, self.fixed_rows = self.number_room(m), self.number_room(m)
        self.weights, self.upper = self.room(m), self.flags(as_flags([False] * m, m))
        self.changing_count = 0
        for changes in (True, False):
            for k in range(m):
                i = numbers_of(active)[k] if k < r else count + numbers_of(bounded)[k - r]
                if not 0 <= i < count + n1 or (k < r and i >= count):
                    raise ValueError("needs rows and variables that exist")
                if (i < first_fixed or first_torque <= i < count) != changes:
                    continue
                self.rows[q], self.weights[q] = i, data(given)[k]
                self.upper[q] = flags_of(top)[k]
                if changes:
                    self.changing_count += 1
                else:
                    i = i - first_fixed if i < count else programs.fixed_count + i - count
                    self.fixed_rows[q - self.changing_count] = i
                q += 1
        self.fixed_count = m - self.changing_count
        self.gram = self.reals(np.empty((n1, n1)))
        self.fit(programs)
        self.changing_rows = self.room(self.changing_count * n1)
        self.multipliers, self.sides, self.left = self.room(m), self.room(m), self.room(m)
        self.workspace = self.room(witness_workspace(self.slide_count, W))

    cdef void fit(self, PaperPrograms programs) noexcept:
        """Take the cones of the programs that it was made of, whose friction may have changed."""
        cdef Py_ssize_t k
        memset(self.gram, 0, self.variable_count * self.variable_count * sizeof(double))
        for k in range(self.fixed_count):
            add_fixed_square(programs, self.fixed_rows[k], 1.0, self.gram)
        self.friction_count = programs.friction_count
