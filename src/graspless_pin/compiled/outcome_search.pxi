"""Bounds over sets of outcomes, and forces that relax contact by contact."""

# States as `holding.bounds` numbers them.
cdef enum:
    FREE = 0
    OPEN = 1
    CLOSED = 2
    STICKING = 3
    SLIPPING = 4


cdef double least_product(double x, double y, double center, double half_width) noexcept nogil:
    """The smallest product of a vector with a unit vector of an arc."""
    if x == 0.0 and y == 0.0:
        return 0.0
    cdef double turn = atan2(-y, -x) - center
    turn -= 2.0 * M_PI * floor((turn + M_PI) / (2.0 * M_PI))
    turn = center + fmin(fmax(turn, -half_width), half_width)
    return cos(turn) * x + sin(turn) * y


cdef bint is_stuck(Py_ssize_t state, double half_width) noexcept nogil:
    """Whether a contact does not slip, by itself or with its patch."""
    return state == STICKING or half_width < 0.0


cdef class Bounds(KeptArrays):
    """What multipliers prove, see `holding.bounds.outcome_bound`, for one dynamics and loads."""

    cdef Py_ssize_t count, n
    cdef double tolerance, force_limit
    cdef double* rows
    cdef double* load
    cdef double* friction
    cdef double* commanded
    cdef double* spread
    cdef double* own_spread
    cdef double* loads
    cdef double* aside
    cdef double* leaks
    cdef double* reach
    cdef double* left
    cdef double* needed
    cdef double* pay
    cdef bint is_whole

    def __init__(
        self, rows, load, friction, commanded, spread, commanded_spread, loads,
        double tolerance, double force_limit, aside, leaks,
    ):
        cdef Py_ssize_t n = len(load), count = len(rows), k
        self.count, self.n = count, n
        self.rows = self.reals(as_blocks(rows, count, 3, n))
        self.load = self.reals(as_vector(load, n))
        self.friction = self.reals(as_vector(friction, count))
        self.commanded = self.reals(as_vector(commanded, count))
        self.spread = self.reals(as_vector(spread, n))
        self.own_spread = self.reals(as_vector(commanded_spread, count))
        self.loads = self.reals(as_vector(loads, count))
        self.aside = self.reals(as_vector(aside, n))
        self.leaks = self.reals(as_vector(leaks, count))
        self.is_whole = inner(self.aside, self.aside, n) == 0.0
        self.tolerance, self.force_limit = tolerance, force_limit
        self.reach, self.left = self.room(count), self.room(n)
        self.needed, self.pay = self.room(count), self.room(count)
        for k in range(count):
            self.reach[k] = sqrt(
                inner(self.rows + (3 * k + 1) * n, self.rows + (3 * k + 1) * n, 2 * n)
            )

    def bound(
        self, states, center, half_width, parts, slips, motion, normal, tangential, p, q
    ):
        """Return what one set of multipliers proves; arguments as of `outcome_bound`.

        Args:
            states: (M,) numbers.
            center: (M,) rad.
            half_width: (M,) rad, as of `holding.bounds.States`.
            parts: (M,) as there.
            slips: (M,) as there.
            motion: (n,) lambda.
            normal: (M,) nu.
            tangential: (M, 2) kappa.
            p: (n,) goal.
            q: (M, 3) goal.
        """
        cdef cnp.ndarray kinds = as_integers(states, self.count)
        cdef cnp.ndarray at = as_vector(center, self.count)
        cdef cnp.ndarray wide = as_vector(half_width, self.count)
        cdef cnp.ndarray open_by = as_vector(parts, self.count)
        cdef cnp.ndarray slip_by = as_vector(slips, self.count)
        cdef cnp.ndarray one = as_vector(motion, self.n), two = as_vector(normal, self.count)
        cdef cnp.ndarray three = as_shaped(tangential, self.count, 2)
        cdef cnp.ndarray first = as_vector(p, self.n), second = as_shaped(q, self.count, 3)
        return self._bound(
            numbers_of(kinds), data(at), data(wide), data(open_by), data(slip_by), data(one),
            data(two), data(three), data(first), data(second), INFINITY,
        )

    def first(
        self, states, center, half_width, parts, slips, motions, normals, tangentials, p,
        Py_ssize_t known, double enough,
    ):
        """Return the last of some multipliers that prove p.y to be at most ``enough``; -1: none.

        Args:
            states: (M,) numbers.
            center: (M,) rad.
            half_width: (M,) rad, as of `holding.bounds.States`.
            parts: (M,) as there.
            slips: (M,) as there.
            motions: (K, n) lambda.
            normals: (K, M) nu.
            tangentials: (K, M, 2) kappa.
            p: (n,) goal.
            known: How many of the K are some.
            enough: What is to be proven.
        """
        cdef cnp.ndarray kinds = as_integers(states, self.count)
        cdef cnp.ndarray at = as_vector(center, self.count)
        cdef cnp.ndarray wide = as_vector(half_width, self.count)
        cdef cnp.ndarray open_by = as_vector(parts, self.count)
        cdef cnp.ndarray slip_by = as_vector(slips, self.count)
        cdef cnp.ndarray first = as_vector(p, self.n), one = as_reals(motions, 2)
        cdef Py_ssize_t whole = one.shape[0], k
        one = as_shaped(one, whole, self.n)
        cdef cnp.ndarray two = as_shaped(normals, whole, self.count)
        cdef cnp.ndarray three = as_blocks(tangentials, whole, self.count, 2)
        if not 0 <= known <= whole:
            raise ValueError("needs multipliers that exist")
        for k in range(known - 1, -1, -1):
            if self._bound(
                numbers_of(kinds), data(at), data(wide), data(open_by), data(slip_by),
                data(one) + k * self.n, data(two) + k * self.count,
                data(three) + 2 * k * self.count, data(first), NULL, enough,
            ) <= enough:
                return k
        return -1

    cdef double _bound(
        self, const cnp.npy_intp* states, const double* center, const double* half_width,
        const double* parts, const double* slips, const double* motion, const double* normal,
        const double* kappa, const double* p, const double* q, double enough,
    ) noexcept nogil:
        """The bound; without q, infinite once it is above ``enough`` with terms of forces alone.

        Where something is left aside, later terms may be below zero.
        """
        cdef Py_ssize_t k, j, n = self.n, marked = 0
        cdef const double* own
        cdef double* v = self.left
        cdef double c[3]
        cdef double bound = inner(motion, self.load, n), gain, low, high, arc, nu, wrong
        cdef double rise = inner(motion, self.spread, n), slack = 0.0, power
        cdef double size, along, best, beta, ball, unpaid, square, least, leak = 0.0
        cdef bint held
        for k in range(self.count):
            own = self.rows + 3 * k * n
            held = isfinite(self.commanded[k])
            arc = M_PI if is_stuck(states[k], half_width[k]) else half_width[k]
            for j in range(3):
                c[j] = inner(own + j * n, motion, n) + (0.0 if q == NULL else q[3 * k + j])
            gain = -self.friction[k] * least_product(c[1], c[2], center[k], arc)
            if not held:
                gain += c[0]
            low = self.commanded[k] if held else self.loads[k]
            high = self.commanded[k] if held else self.force_limit
            if states[k] != OPEN:
                bound += gain * (high if gain > 0.0 else low)
                leak += self.force_limit * self.leaks[k]
            rise += gain * self.own_spread[k]
        if q == NULL and self.is_whole and bound > enough:
            return INFINITY
        for j in range(n):
            v[j] = p[j] - motion[j]
        for k in range(self.count):
            own = self.rows + 3 * k * n
            held = isfinite(self.commanded[k])
            nu = 0.0 if held else normal[k]
            if states[k] == FREE or states[k] == OPEN:
                nu = fmax(nu, 0.0)
            slack += fmax(-nu, 0.0) * fmax(parts[k], self.tolerance)
            for j in range(n):
                v[j] += nu * own[j] + kappa[2 * k] * own[n + j] + kappa[2 * k + 1] * own[2 * n + j]
            if is_stuck(states[k], half_width[k]):
                wrong = sqrt(kappa[2 * k] * kappa[2 * k] + kappa[2 * k + 1] * kappa[2 * k + 1])
                slack += wrong * fmax(slips[k], self.tolerance)
                continue
            wrong = -least_product(kappa[2 * k], kappa[2 * k + 1], center[k], half_width[k])
            if wrong > 0.0:
                low = self.commanded[k] if held else self.loads[k]
                power = self.friction[k] * (low + fmin(self.own_spread[k], 0.0))
                if states[k] == OPEN:
                    power = 0.0
                self.needed[marked] = wrong / power if power != 0.0 else INFINITY
                self.pay[marked] = wrong * self.reach[k]
                marked += 1
        bound += slack + fmax(rise, 0.0)
        # Slips are paid for by a larger beta, or by their length.
        size, along, best = sqrt(inner(v, v, n)), inner(v, self.load, n), INFINITY
        bound += inner(v, self.aside, n) + inner(motion, self.aside, n)
        square = inner(self.load, self.load, n) + 4.0 * leak
        least = size / fmax(sqrt(square), 1e-9)
        for k in range(-1, marked):
            beta = least if k < 0 else self.needed[k]
            if k >= 0 and not least < beta < INFINITY:
                continue
            ball = 0.0
            if beta > 0.0:
                ball = 0.25 * (size * size / beta + 2.0 * along + beta * square)
            unpaid = 0.0
            for j in range(marked):
                if self.needed[j] > beta:
                    unpaid += self.pay[j]
            best = fmin(best, ball + unpaid)
        return bound + best


def swept(
    rows, pushes, friction, commanded, points, forces, motions, int sweeps, int look,
    double still, double settled, double diverged, double tiny,
):
    """Relax contact after contact, all starts side by side, see `holding.unstable_motion`.

    Args:
        rows: (M, 3, n) scaled by the steps.
        pushes: (M, 3, n).
        friction: (M,).
        commanded: (M,) normal forces, NaN where there is none.
        points: (P, 3, n) from motions to accelerations of points.
        forces: (M, 3, K) starts, changed in place.
        motions: (n, K) what they move, changed in place.
        sweeps: How many at most.
        look: Sweeps after which it looks whether all go to rest.
        still: Accelerations of points below are rest.
        settled: Changes below end it.
        diverged: Changes above end it.
        tiny: In place of sides of no length.
    """
    cdef cnp.ndarray matrix = as_reals(rows, 3), acting = as_reals(pushes, 3)
    cdef Py_ssize_t count = matrix.shape[0], n = matrix.shape[2], s, c, i, j, k
    matrix, acting = as_blocks(matrix, count, 3, n), as_blocks(acting, count, 3, n)
    cdef cnp.ndarray mu = as_vector(friction, count), given = as_vector(commanded, count)
    cdef cnp.ndarray places = as_reals(points, 3)
    cdef Py_ssize_t at = places.shape[0], starts = (<cnp.ndarray?>motions).shape[1]
    places = as_blocks(places, at, 3, n)
    if as_blocks(forces, count, 3, starts) is not forces or as_shaped(motions, n, starts) is not (
        motions
    ):
        raise ValueError("needs arrays of doubles that can be changed in place")
    cdef double* f = data(<cnp.ndarray>forces)
    cdef double* y = data(<cnp.ndarray>motions)
    cdef cnp.ndarray slips = empty1(3 * starts)
    cdef double* u = data(slips)
    cdef double* own
    cdef double* force
    cdef double change, side, share, size, first, second, third, total, square
    with nogil:
        for s in range(sweeps):
            if s % look == look - 1:
                change = 0.0
                for k in range(starts):
                    for c in range(at):
                        square = 0.0
                        for i in range(3):
                            total, own = 0.0, data(places) + (3 * c + i) * n
                            for j in range(n):
                                total += own[j] * y[j * starts + k]
                            square += total * total
                        change = fmax(change, square)
                if sqrt(change) < still:
                    break
            change = 0.0
            for c in range(count):
                own, force = data(matrix) + 3 * c * n, f + 3 * c * starts
                for i in range(3):
                    for k in range(starts):
                        u[i * starts + k] = 0.0
                    for j in range(n):
                        share = own[i * n + j]
                        for k in range(starts):
                            u[i * starts + k] += share * y[j * starts + k]
                size = data(mu)[c]
                for k in range(starts):
                    first, second = force[k] - u[k], force[starts + k] - u[starts + k]
                    third = force[2 * starts + k] - u[2 * starts + k]
                    side = sqrt(second * second + third * third)
                    if isfinite(data(given)[c]):
                        first = data(given)[c]
                    else:
                        first -= size * sqrt(
                            u[starts + k] * u[starts + k] + u[2 * starts + k] * u[2 * starts + k]
                        )
                        first = fmax(fmax(first, (first + size * side) / (1.0 + size * size)), 0.0)
                    share = fmin(1.0, size * first / fmax(side, tiny))
                    u[k] = first - force[k]
                    u[starts + k] = share * second - force[starts + k]
                    u[2 * starts + k] = share * third - force[2 * starts + k]
                    for i in range(3):
                        force[i * starts + k] += u[i * starts + k]
                        change = fmax(change, fabs(u[i * starts + k]))
                own = data(acting) + 3 * c * n
                for i in range(3):
                    for j in range(n):
                        share = own[i * n + j]
                        for k in range(starts):
                            y[j * starts + k] += share * u[i * starts + k]
            if change < settled or change > diverged:
                break
