"""Optima of Algorithms 1 and 2 of which nothing is known, found by interior points, then proven.

Mehrotra's predictor-corrector method (SIAM J. Optim. 2(4), 1992) on the dense program: a step
towards complementarity products of zero tells how far they can be taken; a second step corrects it.
"""

cdef int _MOST_STEPS = 40
cdef double _COMPLEMENTARY = 1e-13  # mean of slacks times multipliers, scaled: strict by then
cdef double _TO_BOUNDARY = 0.995  # share of the step to the nearest bound
cdef double _FRICTION = 1e-6  # over the load: the check shows whether less was none
cdef double _RIDGE = 1e-14


cdef class ColdOptima(WarmOptima):
    """Optima without a warm start, too.

    Each side that there is of a row or variable is an equation with a slack: sign (a x - side) +
    slack = 0, with sign 1 for an upper and -1 for a lower one; slack and multiplier are positive.
    """

    cdef int guesses
    cdef tuple judged_by
    cdef Py_ssize_t side_count
    cdef cnp.npy_intp* chosen
    cdef double* required_signs
    cdef double* slide
    cdef double* guessed
    # Balance, largest torque and torques.
    cdef double* changing_rows
    # By side: its row, sign and value, slack and multiplier, their steps, what is left of the
    # equation, and what of the product.
    cdef cnp.npy_intp* row_of_side
    cdef double* sign
    cdef double* side_value
    cdef double* slack
    cdef double* multiplier
    cdef double* slack_step
    cdef double* multiplier_step
    cdef double* primal_residual
    cdef double* product_target
    # By row.
    cdef double* row_work
    cdef double* balance_residual
    cdef double* balance_multipliers
    cdef double* balance_step
    cdef double* point_step
    cdef double* dual_residual
    cdef double* solved_balance
    cdef double* schur

    def __init__(self, int guesses, judged_by, **shared):
        """Take what the problems share.

        Args:
            guesses: How many motions are tried behind the friction of an optimum.
            judged_by: The last four figures that `witness_of` judges by.
            shared: See `WarmOptima`.
        """
        WarmOptima.__init__(self, **shared)
        cdef Py_ssize_t n1 = self.coordinate_count + 1, M = self.contact_count
        cdef Py_ssize_t changing = 6 + 3 * self.joint_count, N = changing + self.fixed_count + n1
        self.guesses, self.judged_by = guesses, judged_by
        self.changing_rows, self.row_work = self.room(changing * n1), self.room(N)
        self.slack, self.multiplier = self.room(2 * N), self.room(2 * N)
        self.slack_step, self.multiplier_step = self.room(2 * N), self.room(2 * N)
        self.primal_residual, self.product_target = self.room(2 * N), self.room(2 * N)
        self.sign, self.side_value = self.room(2 * N), self.room(2 * N)
        self.row_of_side = self.number_room(2 * N)
        self.point_step, self.dual_residual = self.room(n1), self.room(n1)
        self.balance_multipliers, self.balance_step = self.room(6), self.room(6)
        self.balance_residual = self.room(6)
        self.solved_balance, self.schur = self.room(6 * n1), self.room(36)
        self.chosen, self.required_signs = self.number_room(M), self.room(2 * M)
        self.slide = self.room(2 * M)
        self.guessed = self.room(witness_workspace(M, self.effect_count))

    cdef Py_ssize_t row_of_changing(self, Py_ssize_t i) noexcept:
        """The number among all rows of one among those that a state may change."""
        return i if i < 6 + self.peak_count else i + self.fixed_count

    cdef void write_changing_rows(self) noexcept:
        """Put the rows that a state may change into a place: balance, largest torque, torques."""
        cdef Py_ssize_t n1 = self.coordinate_count + 1, i
        for i in range(self.row_count - self.fixed_count):
            self.write_changing_row(self.row_of_changing(i), self.changing_rows + n1 * i, 1)

    cdef bint factor_normal_equations(self) noexcept:
        """Factor the normal equations, A^T (Z/S) A, and the Schur complement of the balance."""
        cdef Py_ssize_t n1 = self.coordinate_count + 1, first = 6 + self.peak_count, i, j, k, e
        cdef double* H = self.normal_equations
        cdef const double* row
        cdef double weight, trace = 0.0
        memset(H, 0, n1 * n1 * sizeof(double))
        memset(self.row_work, 0, (self.row_count + n1) * sizeof(double))
        for k in range(self.side_count):
            self.row_work[self.row_of_side[k]] += self.multiplier[k] / self.slack[k]
        for i in range(6, self.row_count - self.fixed_count):
            weight = self.row_work[self.row_of_changing(i)]
            row = self.changing_rows + n1 * i
            for j in range(n1):
                if row[j] != 0.0:
                    for e in range(j + 1):
                        H[n1 * j + e] += weight * row[j] * row[e]
        for i in range(self.fixed_count):
            add_fixed_square(self, i, self.row_work[first + i], H)
        for j in range(n1):
            H[n1 * j + j] += self.row_work[self.row_count + j]
            trace += H[n1 * j + j]
        for j in range(n1):
            H[n1 * j + j] += _RIDGE * trace
        if not factor(H, n1):
            return False
        trace = 0.0
        memcpy(self.solved_balance, self.changing_rows, 6 * n1 * sizeof(double))
        for i in range(6):
            solve_factored(H, n1, self.solved_balance + n1 * i)
        for i in range(6):
            row = self.changing_rows + n1 * i
            for j in range(i + 1):
                self.schur[6 * i + j] = inner(row, self.solved_balance + n1 * j, n1)
            trace += self.schur[7 * i]
        for i in range(6):
            self.schur[7 * i] += _RIDGE * trace
        return factor(self.schur, 6)

    cdef void step(self) noexcept:
        """Solve the KKT system for the step to the targets of slacks times multipliers."""
        cdef Py_ssize_t n1 = self.coordinate_count + 1, i, j, k
        cdef double change
        cdef double* dx = self.point_step
        memset(self.row_work, 0, (self.row_count + n1) * sizeof(double))
        for k in range(self.side_count):
            change = self.product_target[k] + self.multiplier[k] * self.primal_residual[k]
            self.row_work[self.row_of_side[k]] += self.sign[k] * (change / self.slack[k])
        memset(dx, 0, n1 * sizeof(double))
        self.add_rows(self.row_work, dx)
        for j in range(n1):
            dx[j] = -self.dual_residual[j] - dx[j]
        solve_factored(self.normal_equations, n1, dx)
        for i in range(6):
            self.balance_step[i] = (
                inner(self.changing_rows + n1 * i, dx, n1) + self.balance_residual[i]
            )
        solve_factored(self.schur, 6, self.balance_step)
        for i in range(6):
            for j in range(n1):
                dx[j] -= self.balance_step[i] * self.solved_balance[n1 * i + j]
        self.row_values(dx, self.row_work)
        for k in range(self.side_count):
            change = self.sign[k] * self.row_work[self.row_of_side[k]]
            self.slack_step[k] = -change - self.primal_residual[k]
            self.multiplier_step[k] = (
                self.product_target[k] - self.multiplier[k] * self.slack_step[k]
            ) / self.slack[k]

    cdef double step_length(self, const double* values, const double* steps) noexcept:
        """Ratio test: the share of a step that keeps values positive."""
        cdef Py_ssize_t k
        cdef double share = 1.0
        for k in range(self.side_count):
            if share * steps[k] < -_TO_BOUNDARY * values[k]:
                share = -_TO_BOUNDARY * values[k] / steps[k]
        return share

    cdef void begin(self) noexcept:
        """Begin at a point inside the sides, or as far outside as slacks of one make up for."""
        cdef Py_ssize_t n1 = self.coordinate_count + 1, i, k = 0
        cdef int top
        cdef double side
        self.write_changing_rows()
        memset(self.point, 0, n1 * sizeof(double))
        memset(self.balance_multipliers, 0, 6 * sizeof(double))
        self.point[n1 - 1] = self.cost()
        self.row_values(self.point, self.row_work)
        for i in range(6, self.row_count + n1):
            for top in range(1, -1, -1):
                side = self.side(i, top)
                if isfinite(side):
                    self.row_of_side[k], self.side_value[k] = i, side
                    self.sign[k] = 1.0 if top else -1.0
                    self.slack[k] = max(self.sign[k] * (side - self.row_work[i]), 1.0)
                    self.multiplier[k] = 1.0 / self.slack[k]
                    k += 1
        self.side_count = k

    cdef bint converge(self) noexcept:
        """Find an optimum by the predictor-corrector method; whether it converged.

        mu is the mean complementarity product, sigma its share that the corrector aims at.
        """
        cdef Py_ssize_t n1 = self.coordinate_count + 1, i, j, k, _
        cdef double primal, dual, mu, center, primal_step, dual_step, total
        self.begin()
        for _ in range(_MOST_STEPS):
            self.row_values(self.point, self.row_work)
            primal, dual, mu = 0.0, 0.0, 0.0
            for i in range(6):
                self.balance_residual[i] = self.row_work[i] - self.side(i, True)
                primal = max(primal, fabs(self.balance_residual[i]))
            for k in range(self.side_count):
                self.primal_residual[k] = self.slack[k] + self.sign[k] * (
                    self.row_work[self.row_of_side[k]] - self.side_value[k]
                )
                self.product_target[k] = -self.slack[k] * self.multiplier[k]
                mu -= self.product_target[k]
                primal = max(primal, fabs(self.primal_residual[k]))
            memset(self.row_work, 0, (self.row_count + n1) * sizeof(double))
            memcpy(self.row_work, self.balance_multipliers, 6 * sizeof(double))
            for k in range(self.side_count):
                self.row_work[self.row_of_side[k]] += self.sign[k] * self.multiplier[k]
            mu /= max(self.side_count, 1)
            memset(self.dual_residual, 0, n1 * sizeof(double))
            self.dual_residual[n1 - 1] = self.cost()
            self.add_rows(self.row_work, self.dual_residual)
            for j in range(n1):
                dual = max(dual, fabs(self.dual_residual[j]))
            total = primal + dual + mu
            if not isfinite(total):
                return False
            if mu <= _COMPLEMENTARY:
                # The proof tells whether that will do; further steps only lose digits.
                return primal <= 1e-6 and dual <= 1e-6
            if not self.factor_normal_equations():
                return False
            # Predictor: the affine step towards products of zero.
            self.step()
            primal_step = self.step_length(self.slack, self.slack_step)
            dual_step = self.step_length(self.multiplier, self.multiplier_step)
            center = 0.0
            for k in range(self.side_count):
                center += (self.slack[k] + primal_step * self.slack_step[k]) * (
                    self.multiplier[k] + dual_step * self.multiplier_step[k]
                )
            # Corrector: products of sigma mu, less what the predictor's second order adds.
            center = (center / max(self.side_count, 1) / mu) ** 3 * mu
            for k in range(self.side_count):
                self.product_target[k] += center - self.slack_step[k] * self.multiplier_step[k]
            self.step()
            primal_step = self.step_length(self.slack, self.slack_step)
            dual_step = self.step_length(self.multiplier, self.multiplier_step)
            for j in range(n1):
                self.point[j] += primal_step * self.point_step[j]
            for i in range(6):
                self.balance_multipliers[i] += dual_step * self.balance_step[i]
            for k in range(self.side_count):
                self.slack[k] += primal_step * self.slack_step[k]
                self.multiplier[k] += dual_step * self.multiplier_step[k]
        return False

    cdef Start begun(self):
        """What an optimum found by interior points leaves behind; None: no motion is behind it.

        Its mode is read from the friction, and the motion guessed, as a search does first.
        """
        if not self.converge():
            return None
        cdef Py_ssize_t M = self.contact_count, s = 0, i, c, k
        cdef double* pair
        cdef cnp.ndarray signs = np.zeros((M, 2))
        for c in range(self.coordinate_count):
            if self.axes[c] % 3 and fabs(self.point[c]) > _FRICTION:
                data(signs)[2 * (self.axes[c] // 3) + self.axes[c] % 3 - 1] = (
                    -1.0 if self.point[c] > 0.0 else 1.0
                )
        for i in range(M):
            pair = data(signs) + 2 * i
            if pair[0] != 0.0 or pair[1] != 0.0:
                self.chosen[s] = i
                memcpy(self.required_signs + 2 * s, pair, 2 * sizeof(double))
                s += 1
        self.write_map()
        memset(self.motion, 0, self.effect_count * sizeof(double))
        damping, corrections, rank_tolerance, least = self.judged_by
        if s and not witness_of(
            M, self.effect_count, self.scaled, s, self.chosen, self.required_signs, NULL,
            self.guesses, damping, corrections, rank_tolerance, least, self.guessed, self.slide,
            self.motion,
        ):
            return None
        for i in range(s):
            memcpy(data(signs) + 2 * self.chosen[i], self.slide + 2 * i, 2 * sizeof(double))
        rows, bounds, upper = list(range(6)), [], [True] * 6
        weights = _copied(self.balance_multipliers, 6).tolist()
        for k in range(self.side_count):
            if self.multiplier[k] > self.slack[k]:
                i = self.row_of_side[k]
                if i < self.row_count:
                    rows.append(i)
                else:
                    bounds.append(i - self.row_count)
                upper.append(self.sign[k] > 0.0)
                weights.append(self.sign[k] * self.multiplier[k])
        return Start(
            self, rows, bounds, upper, _copied(self.point, self.coordinate_count + 1),
            np.array(weights), self.row_count, signs, [self.chosen[i] for i in range(s)],
            _copied(self.slide, 2 * s), _copied(self.motion, self.effect_count), self.judged_by,
        )
