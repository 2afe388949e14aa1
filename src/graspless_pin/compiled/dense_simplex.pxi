"""The simplex method on small dense linear programs that grow, shrink and are solved again."""

cdef double _FEASIBLE = 1e-10  # a value outside its bounds by less is inside
cdef double _OPTIMAL = 1e-12  # a cost below is none
cdef double _SLACK = 1e-11  # by so much costs may turn round where that gives a larger pivot
cdef double _TILT = 1e-8  # costs are tilted by up to so much, so that ties do not go in circles
cdef double _DRIFT = 1e-11  # what rounding leaves of rows and costs, before pivots are made anew
cdef int _FRESH = 100  # pivots after which they are made anew

cdef enum:
    OPTIMAL = 0
    INFEASIBLE = 1
    UNBOUNDED = 2
    FAILED = 3


cdef class DenseSimplex(Dictionary):
    """Minimise c.x over lb <= x <= ub and low <= R x <= high, see `solvers.simplex.Simplex`."""

    def solve(self):
        """Return whether it is 0 optimal, 1 infeasible, 2 unbounded or 3 failed, x and marginals.

        It begins with the variables at bounds that were so before.
        """
        cdef int outcome
        cdef cnp.ndarray x = empty1(self.n), marginals = empty1(self.m)
        with nogil:
            outcome = self.optimum(data(x), data(marginals))
        return outcome, x, marginals

    cdef int optimum(self, double* x, double* marginals) noexcept nogil:
        """Do what `solve` does, with places for x and marginals."""
        cdef int outcome = FAILED, tries
        cdef Py_ssize_t i, k
        for tries in range(3):
            if self.pivots > _FRESH or tries:
                self.renew(tries == 2)
            outcome = self._run()
            if outcome != FAILED and self.drift() <= _DRIFT:
                break
            outcome = FAILED
        memcpy(x, self.value, self.n * sizeof(double))
        for i in range(self.m):
            k = self.place[self.n + i]
            marginals[i] = 0.0 if k >= 0 else self.slopes[-1 - k]
        return outcome

    cdef int _run(self) noexcept nogil:
        """Go to an optimum."""
        cdef int outcome
        self._settle()
        outcome = self._dual()
        if outcome != OPTIMAL:
            return outcome
        self.correct()
        outcome = self._primal()
        self.correct()
        return outcome

    cdef void _settle(self) noexcept nogil:
        """Put variables that are not basic to bounds that suit the cost, and tilt that."""
        cdef Py_ssize_t j, v
        cdef double slope, size = 0.0
        cdef unsigned int chance
        for j in range(self.n):
            size = fmax(size, fabs(self.cost[j]))
        for j in range(self.n):
            v, slope = self.others[j], self.slopes[j]
            chance = <unsigned int>(v + 1) * 2654435761u
            chance ^= chance >> 15
            if slope > _OPTIMAL * size and not isfinite(self.lower[v]):
                slope = 0.0
            elif slope < -_OPTIMAL * size and not isfinite(self.upper[v]):
                slope = 0.0
            if slope > _OPTIMAL * size:
                self.value[v] = self.lower[v]
            elif slope < -_OPTIMAL * size:
                self.value[v] = self.upper[v]
            elif self.value[v] == self.upper[v]:
                pass
            elif isfinite(self.lower[v]):
                self.value[v] = self.lower[v]
            elif isfinite(self.upper[v]):
                self.value[v] = self.upper[v]
            else:
                self.value[v], slope = 0.0, 0.0
                self.tilted[j] = 0.0
                continue
            slope = fmax(slope, 0.0) if self.value[v] == self.lower[v] else -fmax(-slope, 0.0)
            self.tilted[j] = slope + (
                1.0 if self.value[v] == self.lower[v] else -1.0
            ) * _TILT * size * (0.5 + (chance & 0xffff) / 131072.0)
        self.revalue()

    cdef int _dual(self) noexcept nogil:
        """Go on until every variable is within its bounds; costs stay feasible."""
        cdef Py_ssize_t r, q, i, j, v, _step, most = 50 + 20 * (self.m + self.n)
        cdef double worst, out, target, sign, entry, bound, ratio, size, change
        cdef const double* row
        for _step in range(most):
            r, worst = -1, _FEASIBLE
            for i in range(self.m):
                v = self.basic[i]
                out = fmax(self.lower[v] - self.value[v], self.value[v] - self.upper[v])
                if out > worst:
                    r, worst = i, out
            if r < 0:
                return OPTIMAL
            v, row = self.basic[r], self.table + r * self.n
            sign = 1.0 if self.value[v] < self.lower[v] else -1.0
            target = self.lower[v] if sign > 0.0 else self.upper[v]
            bound, q, size = INFINITY, -1, 0.0
            for j in range(self.n):
                entry = sign * row[j]
                if self._may(self.others[j], entry) and is_pivot(entry):
                    ratio = (fabs(self.tilted[j]) + _SLACK) / fabs(entry)
                    if ratio < bound:
                        bound = ratio
            for j in range(self.n):
                entry = sign * row[j]
                if self._may(self.others[j], entry) and is_pivot(entry):
                    if fabs(self.tilted[j]) / fabs(entry) <= bound and fabs(entry) > size:
                        q, size = j, fabs(entry)
            if q < 0:
                return INFEASIBLE
            change = (target - self.value[v]) / row[q]
            self.shift(q, change)
            self.value[v] = target
            self.pivot(r, q)
            # Costs that turned round by the slack count as none.
            for j in range(self.n):
                v = self.others[j]
                if self.lower[v] < self.upper[v] and (
                    (self.tilted[j] > 0.0 and self.value[v] != self.lower[v])
                    or (self.tilted[j] < 0.0 and self.value[v] != self.upper[v])
                ):
                    self.tilted[j] = 0.0
        return FAILED

    cdef inline bint _may(self, Py_ssize_t v, double way) noexcept nogil:
        """Whether a variable that is not basic may rise (way > 0) or fall."""
        if way > 0.0:
            return self.value[v] < self.upper[v]
        return self.value[v] > self.lower[v]

    cdef int _primal(self) noexcept nogil:
        """Go on until the cost is least; every variable stays within its bounds."""
        cdef Py_ssize_t r, q, i, j, v, steps, most = 50 + 20 * (self.m + self.n)
        cdef double best, way, slack, entry, step, limit, size, target = 0.0, scale = 0.0
        for j in range(self.n):
            scale = fmax(scale, fabs(self.cost[j]))
        for steps in range(most):
            q, best = -1, _OPTIMAL * scale
            for j in range(self.n):
                if fabs(self.slopes[j]) > best and self._may(self.others[j], -self.slopes[j]):
                    q, best = j, fabs(self.slopes[j])
                    if steps > most / 2:
                        break
            if q < 0:
                return OPTIMAL
            way = -1.0 if self.slopes[q] > 0.0 else 1.0
            v = self.others[q]
            limit = INFINITY
            for i in range(self.m):
                entry = way * self.table[i * self.n + q]
                if is_pivot(entry):
                    slack = self._slack(self.basic[i], entry) + _FEASIBLE
                    if slack / fabs(entry) < limit:
                        limit = slack / fabs(entry)
            step = self.upper[v] - self.lower[v]
            if step <= limit:
                if not isfinite(step):
                    return UNBOUNDED
                self.shift(q, way * step)
                self.value[v] = self.upper[v] if way > 0.0 else self.lower[v]
                continue
            r, size = -1, 0.0
            for i in range(self.m):
                entry = way * self.table[i * self.n + q]
                if is_pivot(entry) and fabs(entry) > size:
                    if self._slack(self.basic[i], entry) / fabs(entry) <= limit:
                        r, size = i, fabs(entry)
            if r < 0:
                return FAILED
            entry = way * self.table[r * self.n + q]
            target = self.upper[self.basic[r]] if entry > 0.0 else self.lower[self.basic[r]]
            step = fmax(self._slack(self.basic[r], entry), 0.0) / size
            v = self.basic[r]
            self.shift(q, way * step)
            self.value[v] = target
            self.pivot(r, q)
        return FAILED

    cdef inline double _slack(self, Py_ssize_t v, double way) noexcept nogil:
        """How far a variable may go up (way > 0) or down."""
        if way > 0.0:
            return self.upper[v] - self.value[v]
        return self.value[v] - self.lower[v]
