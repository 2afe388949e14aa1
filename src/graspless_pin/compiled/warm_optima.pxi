"""Optima of Algorithms 1 and 2 by a warm start from the active set of a similar problem, proven."""

from libc.math cimport fabs, isfinite
from libc.string cimport memcpy, memset

cimport numpy as cnp


cdef Py_ssize_t _MOST_STARTS = 8

FIGURES = ("margin", "value", "bound", "gap", "residual", "unit")
"""Columns of what `WarmOptima.optima_of_states` finds, in the objective's unit or scaled."""


cdef class WarmOptima(PaperPrograms):
    """Programs with a workspace for the optimum of one problem."""

    cdef double damping, exact, close, cutoff
    cdef int corrections
    cdef double* y
    cdef double* G
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
        cdef Py_ssize_t n = self.n
        self.damping, self.corrections, self.exact = damping, corrections, exact
        self.close, self.cutoff = close, cutoff
        self.y, self.G = self.workspace(n + 1), self.workspace((n + 1) * (n + 1))
        self.forces = self.workspace(3 * self.M)
        self.map = self.workspace(3 * self.M * self.W)
        self.scaled = self.workspace(3 * self.M * self.W)
        self.scale, self.motion = self.workspace(self.W), self.workspace(self.W)
        self.signs = self.workspace(2 * self.M)

    cdef bint refined(self, Start start) noexcept:
        """Find point and multipliers for the active rows of an earlier optimum."""
        cdef Py_ssize_t n1 = self.n + 1, W = self.W, D = start.D, S = start.S, c, q, i, j, e
        cdef double trace = 0.0, turned, last, factor_of
        cdef const double* column
        cdef double* G = self.G
        cdef double* A = start.A
        cdef double* w = start.w
        cdef double* b = start.b
        cdef double* sides = start.sides
        for q in range(D + S):
            sides[q] = self.side(start.rows[q], start.upper[q])
            if not isfinite(sides[q]):
                return False
        for q in range(D):
            i, factor_of, last = start.rows[q], 1.0, 0.0
            if i >= self.T:
                i = 6 + i - self.T
            elif i >= 6:
                factor_of, last = self.share[i - 6], -self.level[i - 6]
                i = 6 + self.joint[i - 6] % self.L
            for c in range(n1 - 1):
                A[D * c + q] = factor_of * self.B[W * c + i]
            A[D * (n1 - 1) + q] = last
        for i in range(n1):
            for j in range(i + 1):
                G[n1 * i + j] = start.gram[n1 * i + j] + inner(A + D * i, A + D * j, D)
            trace += G[n1 * i + i]
        for i in range(n1):
            G[n1 * i + i] += self.damping * trace
        if not factor(G, n1):
            return False
        memcpy(w, start.weights, (D + S) * sizeof(double))
        memcpy(self.x, start.x, n1 * sizeof(double))
        for _ in range(self.corrections):
            # What is left of the sides, and the slope of the Lagrangian.
            memcpy(b, sides, (D + S) * sizeof(double))
            for c in range(n1):
                column, turned = A + D * c, self.x[c]
                for q in range(D):
                    b[q] -= column[q] * turned
                self.d[c] = inner(column, w, D)
            self.d[n1 - 1] += -1.0 if self.kind == MARGIN else 1.0
            for q in range(S):
                for e in range(start.starts[q], start.starts[q + 1]):
                    b[D + q] -= start.values[e] * self.x[start.columns[e]]
                    self.d[start.columns[e]] += w[D + q] * start.values[e]
            for c in range(n1):
                self.y[c] = inner(A + D * c, b, D)
            for q in range(S):
                for e in range(start.starts[q], start.starts[q + 1]):
                    self.y[start.columns[e]] += b[D + q] * start.values[e]
            solve_factored(G, n1, self.d)
            solve_factored(G, n1, self.y)
            for c in range(n1):
                column, turned = A + D * c, self.d[c]
                for q in range(D):
                    w[q] -= column[q] * turned
                self.x[c] += self.y[c]
            for q in range(S):
                for e in range(start.starts[q], start.starts[q + 1]):
                    w[D + q] -= start.values[e] * self.d[start.columns[e]]
        memset(self.w, 0, self.R * sizeof(double))
        for q in range(D + S):
            if start.rows[q] >= self.R:
                self.x[start.rows[q] - self.R] = sides[q]
            else:
                self.w[start.rows[q]] = w[q]
        return True

    cdef bint optimum(self, Start start, bint has_map) noexcept:
        """Find and prove the optimum that an earlier one leads to."""
        cdef Py_ssize_t c, contact
        cdef double friction
        if start.R != self.R or start.n1 != self.n + 1 or start.W != self.W:
            return False
        if start.friction_count != self.friction_count:
            start.fit(self)
        if not self.refined(start):
            return False
        for c in range(self.n):
            contact, friction = self.axes[c] // 3, self.x[c]
            if (
                self.axes[c] % 3 and friction != 0.0
                and friction * start.signs[2 * contact + self.axes[c] % 3 - 1] >= 0.0
            ):
                self.x[c] = 0.0
        return self.is_proven() and self.is_behind(start, has_map)

    cdef bint is_proven(self) noexcept:
        """Whether point and multipliers are an optimum and its proof."""
        cdef double close
        self.judged()
        close = self.exact * max(1.0, fabs(self.value))
        return (
            self.residual <= close and fabs(self.value - self.bound) <= close
            and self.residual * self.strict <= self.close and self.value <= self.cutoff
        )

    cdef bint is_behind(self, Start start, bint has_map) noexcept:
        """Find the motion of an earlier optimum; whether it is behind its mode. Keep the forces."""
        if not has_map:
            map_of(
                self.M, self.L, self.points, self.normals, self.tangents, self.J, self.map
            )
            scaled_of(3 * self.M, self.W, self.map, self.scale, self.scaled)
        if start.s:
            if not witness_of(
                self.M, self.W, self.scaled, start.s, start.contacts, start.own_signs,
                start.motion, 0, start.judged[0], <int>start.judged[1], start.judged[2],
                start.judged[3], start.workspace,
                self.signs, self.motion,
            ):
                return False
        else:
            memcpy(self.motion, start.motion, self.W * sizeof(double))
        self.keep_forces(start)
        return True

    cdef void keep_forces(self, Start start) noexcept:
        """Take the forces of the point, to which an earlier optimum has led."""
        cdef Py_ssize_t c, contact
        memset(self.forces, 0, 3 * self.M * sizeof(double))
        for c in range(self.n):
            for contact in range(3):
                self.forces[3 * (self.axes[c] // 3) + contact] += (
                    self.force * self.x[c] * self.frames[3 * self.axes[c] + contact]
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
        cdef Py_ssize_t place
        self.hold(problem, kept)
        if not self.posed():
            return None
        for place in range(len(starts)):
            start = starts[place]
            if start is not None and self.optimum(start, False):
                return place, self.result()
        return None

    cdef bint tried(self, list starts, bint cold) except -1:
        """Find the optimum that one of several earlier ones leads to; else that found otherwise.

        Args:
            starts: As in `warm_optimum`; that which served comes first afterwards.
            cold: Whether to look for one otherwise.
        """
        cdef Py_ssize_t place
        if not self.posed():
            return False
        for place in range(len(starts)):
            start = starts[place]
            if start is not None and self.optimum(start, False):
                if place:
                    starts.insert(0, starts.pop(place))
                return True
        start = self.begun() if cold else None
        if start is None or not self.optimum(start, True):
            return False
        starts.insert(0, start)
        del starts[_MOST_STARTS:]
        return True

    cdef void write_figures(self, double* figures, double* torques, Py_ssize_t rows) noexcept:
        """Write the `FIGURES` and the torques; the first rows of forces act on joints."""
        cdef Py_ssize_t k, j
        figures[0] = margin_of(
            self.M, self.forces, self.normals, self.tangents, self.slopes, self.has_cone, self.most,
            self.edges, self.directions,
        )
        figures[1], figures[4] = self.value, self.residual
        figures[5] = -self.unit if self.kind == MARGIN else self.unit
        figures[2], figures[3] = self.bound * figures[5], (self.value - self.bound) * self.unit
        for j in range(self.L):
            torques[j] = self.gravity[j]
        for k in range(rows):
            for j in range(self.L):
                torques[j] += self.forces[k] * self.J[self.L * k + j]

    def result(self):
        """What was found of the last problem, as `warm_optimum` returns it."""
        cdef Start start = self.served
        cdef Py_ssize_t k
        if start is None:
            raise ValueError("no optimum was found")
        return (
            _copied(self.forces, 3 * self.M).reshape(self.M, 3), self.unit,
            _copied(self.x, self.n + 1), self.value, self.bound, self.residual,
            _copied(self.w, self.R), _copied(self.motion, self.W), _copied(self.scale, self.W),
            [start.contacts[k] for k in range(start.s)],
            _copied(start.signs, 2 * self.M).reshape(self.M, 2), start.solver,
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
        cdef cnp.ndarray points = as_shaped(problem.positions, self.M, 3).copy()
        cdef cnp.ndarray normals = as_shaped(problem.normals, self.M, 3).copy()
        cdef cnp.ndarray tangents = as_blocks(problem.tangents, self.M, 3, 2).copy()
        cdef cnp.ndarray J = empty(3 * self.M, self.L)
        cdef Py_ssize_t H = carrier.shape[0], L = self.L, total = weights.shape[0], number, k, j
        cdef Py_ssize_t count = 0, most = rows.shape[1]
        cdef const double* row
        if (
            H > min(self.M, most) or rows.shape[2] != 6 or weights.shape[1] != L
            or mask.shape[1] != L
        ):
            raise ValueError("needs states of these contacts")
        rows, columns = as_blocks(rows, total, most, 6), as_blocks(columns, total, 6, L)
        figures, torques = as_shaped(figures, total, 6), as_shaped(torques, total, L)
        for k in range(H):
            if not 0 <= numbers_of(carrier)[k] < mask.shape[0]:
                raise ValueError("needs joints that exist")
        memset(data(J), 0, 3 * self.M * L * sizeof(double))
        self.points, self.normals, self.tangents = data(points), data(normals), data(tangents)
        self.J = data(J)
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
                    data(J) + 3 * L * k,
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
