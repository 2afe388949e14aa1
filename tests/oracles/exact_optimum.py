"""Algorithms 1 and 2 over all modes (B, S) in rational numbers: what the package should answer.

It reads the arrays of a `QuasistaticProblem` as the exact rationals that they are and states
equations (18) to (45) anew; it shares no other code with the package. Irrational numbers (the
directions of the cones' faces, the length of a sliding velocity) are rounded at 2^-96. Forces are
counted in loads and lengths in the arrangement's own, each rounded to few digits as a unit may be.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache, cached_property
from typing import Any

import numpy as np
from scipy.optimize import nnls
from tests.oracles.exact_programs import Infeasible, Optimum, Rows, solve

from graspless_pin import QuasistaticProblem

Signs = tuple[int, int]
Mode = tuple[Signs | None, ...]
"""Signs of the virtual sliding of each contact; None where it is not selected."""
Vector = list[Fraction]

_DIGITS = 96
_ROUNDED_UP = Fraction(1, 10**25)
_CLOSE = Fraction(1, 10**7)
_FREE: tuple[None, None] = (None, None)


@dataclass(frozen=True)
class Question:
    """What is asked of a problem; the names are those of the package's options."""

    algorithm: str = "margin"
    margin: float = 0.1
    by_limits: bool = False
    sign_rule: str = "strict"
    sliding_rule: str = "exempt"
    static_friction: str = "virtual_sliding"


@dataclass(frozen=True)
class Best:
    """An optimum over modes.

    Attributes:
        value: The margin, N, or the largest |torque|, N m, or the largest share.
        forces: (M, 3) contact forces that reach it, N.
        mode: The mode; None under coulomb.
    """

    value: Fraction
    forces: tuple[tuple[Fraction, ...], ...]
    mode: Mode | None


@dataclass(eq=False)
class ExactScene:
    """One problem under one question, with what was already solved of it.

    Attributes:
        problem: The arrays.
        question: What is asked.
        slack: How far every row of the forces may be missed, in units of the load; below zero,
            inequalities must hold with as much room.
        still: Velocities up to this share of the largest component count as zero.
    """

    problem: QuasistaticProblem
    question: Question
    slack: Fraction = Fraction(0)
    still: Fraction = Fraction(0)
    programs: int = 0
    _forces: dict[tuple[Any, ...], Optimum | None] = field(default_factory=dict)
    _speeds: dict[Mode, _Motions] = field(default_factory=dict)

    @cached_property
    def load(self) -> Fraction:
        """The larger of the wrench's |force| and |moment about the contacts' centre| / length, N.

        Without a wrench the least normal-force limit.
        """
        force, moment = (_vector(part) for part in np.split(self.problem.external_wrench, 2))
        moment = [a - b for a, b in zip(moment, _cross(self._center, force), strict=True)]
        load = max(_size(force), _size(moment) / self.length)
        return load or _exact(self.problem.max_normal_force.min())

    @cached_property
    def length(self) -> Fraction:
        """The largest distance of a contact from the contacts' centre, m; 1 if there is none."""
        return max(_size(arm) for arm in self._arms) or Fraction(1)

    @cached_property
    def levers(self) -> Vector:
        """(L,) the largest torque of a unit force at one contact, m or 1.

        At least 1e-12 of the longest; the length where all are zero.
        """
        blocks = self.problem.jacobian.reshape(len(self._arms), 3, -1)
        levers = [
            max(_size(_vector(block[:, joint])) for block in blocks)
            for joint in range(blocks.shape[2])
        ]
        longest = max(levers, default=Fraction(0))
        return [max(lever, longest / 10**12) or self.length for lever in levers]

    @cached_property
    def candidates(self) -> tuple[int, ...]:
        """Contacts that a mode may select."""
        if self.question.static_friction == "coulomb":
            return ()
        constrained = self.question.sliding_rule == "constrained"
        return tuple(
            contact
            for contact in range(len(self._has_cone))
            if self._has_cone[contact] or (self._slides[contact] and constrained)
        )

    def optimum(self, threshold: Fraction | float = 0) -> Best | None:
        """Return the optimum over all modes whose virtual motion is fast enough.

        Branch and bound over the contacts, each bound the exact optimum of the forces that what
        is decided leaves.

        Args:
            threshold: See `admits`.

        Returns:
            None where nothing is feasible.
        """
        best: tuple[Fraction, Mode, Optimum] | None = None
        undecided = len(self.candidates)

        def look(decided: dict[int, Signs | None], bound: Optimum) -> None:
            nonlocal best
            if len(decided) == undecided:
                best = bound.value, self._mode(decided), bound
                return
            contact = self.candidates[len(decided)]
            for signs in self._ways(contact, bound):
                if best is not None and bound.value >= best[0]:
                    return
                further = {**decided, contact: signs}
                if signs is not None and not self.admits(self._mode(further), threshold):
                    continue
                child = self._least(further, bound)
                if child is not None and (best is None or child.value < best[0]):
                    look(further, child)

        root = self._least({}, None)
        if root is not None:
            look({}, root)
        if best is None:
            return None
        value, mode, reached = best
        forces = self._world(reached.x)
        selected = None if self.question.static_friction == "coulomb" else mode
        return Best(self._unscaled(value), forces, selected)

    def relaxation(self) -> Fraction | None:
        """Return the optimum without (22), (27) and (31); None where nothing is feasible."""
        root = self._least({}, None)
        return None if root is None else self._unscaled(root.value)

    def in_mode(self, mode: Mode) -> Fraction | None:
        """Return the optimum in one mode, whether or not it has a virtual motion."""
        found = self._least({contact: mode[contact] for contact in self.candidates}, None)
        return None if found is None else self._unscaled(found.value)

    def modes(self) -> Iterator[Mode]:
        """Yield every combination of selections and signs, feasible or not."""
        ways = [self._ways(contact, None) for contact in self.candidates]
        for chosen in itertools.product(*ways):
            yield self._mode(dict(zip(self.candidates, chosen, strict=True)))

    def admits(self, mode: Mode, threshold: Fraction | float = 0) -> bool:
        """Whether a virtual motion stands behind a mode, (22), (29), (30).

        Args:
            mode: The mode.
            threshold: How fast each required component must be, as a share of the length of all
                contact velocities; at 0 any motion counts.
        """
        motions = self._motions(mode)
        if not threshold:
            return motions.slowest > 0
        motions.refine(until=Fraction(threshold))
        return motions.slowest >= threshold

    def speed(self, mode: Mode) -> Fraction | float:
        """Return how fast the fastest motion of a mode is where it is slowest; 0 without one.

        The slowest required sliding (``s u`` under strict and exact, ``s1 u1 + s2 u2`` under
        nonzero) over the length of all contact velocities, to seven digits at best and never too
        large; inf if none is required.
        """
        motions = self._motions(mode)
        motions.refine()
        return motions.slowest

    def _motions(self, mode: Mode) -> _Motions:
        if mode not in self._speeds:
            self._speeds[mode] = self._stated(mode)
        return self._speeds[mode]

    def miss(self, forces: Any) -> Fraction:
        """Return the largest violation of balance, cones and limits by forces, over the load.

        Args:
            forces: (M, 3) contact forces, N. The margin asked of them is the question's under
                Algorithm 2 and 0 under Algorithm 1.
        """
        given = [[_exact(entry) for entry in row] for row in forces]
        x = []
        for contact, force in enumerate(given):
            # Frames are orthonormal to rounding only, which large forces would multiply.
            n, first, second = self._frames[contact]
            duals = [_cross(first, second), _cross(second, n), _cross(n, first)]
            volume = _dot(n, duals[0]) * self.load
            x += [_dot(dual, force) / volume for dual in duals[: len(self._local[contact])]]
        worst = Fraction(0)
        for contact, force in enumerate(given):
            # What no coordinate carries: the kinetic friction's other directions.
            share = x[self._columns[contact][0]] * self.load
            if len(self._local[contact]) == 1:
                apart = [f - share * d for f, d in zip(force, self._local[contact][0], strict=True)]
                worst = max(worst, *(abs(entry) / self.load for entry in apart))
        x.append(Fraction(0))
        for row, side, equal in self._statement(with_goal=False):
            room = side - _dot(row, x)
            worst = max(worst, abs(room) if equal else -room)
        return worst

    def beyond_limits(self, forces: Any) -> Fraction:
        """Return by how many times what may be forces exceed limits; `docs/limits.md` has it.

        Args:
            forces: (M, 3) contact forces, N.
        """
        problem, worst = self.problem, Fraction(0)
        given = [_vector(row) for row in forces]
        most = [_exact(limit) for limit in problem.max_normal_force]
        for normal, force, limit in zip(problem.normals, given, most, strict=True):
            tolerance = min(self._weighing, max(limit, max(most) / 1000)) / 10**6
            worst = max(worst, (_dot(_vector(normal), force) - limit) / tolerance)
        for joint, gravity in enumerate(problem.gravity_torques.tolist()):
            column = problem.jacobian[:, joint].reshape(-1, 3)
            torque = _exact(gravity) + sum(
                (_dot(_vector(row), force) for row, force in zip(column, given, strict=True)),
                Fraction(0),
            )
            for sign, limits in ((1, problem.upper_torque), (-1, problem.lower_torque)):
                limit = float(limits[joint])
                if math.isfinite(limit):
                    tolerance = min(self._load_on(joint), self._size_of(joint, limit)) / 10**6
                    worst = max(worst, (sign * (torque - _exact(limit))) / tolerance)
        return worst

    @cached_property
    def is_overloaded(self) -> bool:
        """Whether the load is so large beside a limit that nothing may be found."""
        problem = self.problem
        limits = np.concatenate([problem.lower_torque, problem.upper_torque]).tolist()
        joints = 2 * list(range(problem.joint_count))
        return any(
            self._load_on(joint) > 10**6 * self._size_of(joint, limit)
            for joint, limit in zip(joints, limits, strict=True)
            if math.isfinite(limit)
        )

    def _load_on(self, joint: int) -> Fraction:
        return self._weighing * self.levers[joint]

    @property
    def _weighing(self) -> Fraction:
        """The load; without a wrench the required margin, if there is one."""
        margin = Fraction(0) if self.question.algorithm == "margin" else self.question.margin
        return _exact(margin) if margin and not self.problem.external_wrench.any() else self.load

    def _size_of(self, joint: int, limit: float) -> Fraction:
        """What one of a joint's limits counts as, N m."""
        problem = self.problem
        sizes = [
            abs(_exact(one))
            for limits in (problem.lower_torque, problem.upper_torque)
            for one, unit in zip(limits.tolist(), problem.joint_units, strict=True)
            if unit is problem.joint_units[joint] and math.isfinite(one)
        ]
        largest = max(sizes, default=Fraction(0)) or self._load_on(joint)
        return max(abs(_exact(limit)), largest / 1000)

    # -- the forces ------------------------------------------------------------------------

    @cached_property
    def _slides(self) -> list[bool]:
        return [bool(row.any()) for row in self.problem.sliding]

    @cached_property
    def _has_cone(self) -> list[bool]:
        return [
            mu > 0 and not slides
            for mu, slides in zip(self.problem.friction, self._slides, strict=True)
        ]

    @cached_property
    def _frames(self) -> list[list[Vector]]:
        """(M, 3, 3) rows n, t1, t2."""
        problem = self.problem
        return [
            [_vector(n), _vector(t[:, 0]), _vector(t[:, 1])]
            for n, t in zip(problem.normals, problem.tangents, strict=True)
        ]

    @cached_property
    def _local(self) -> list[list[Vector]]:
        """Forces of the coordinates of each contact: n, t1, t2, or n - mu v/|v| alone."""
        local = []
        for contact, frame in enumerate(self._frames):
            if self._has_cone[contact]:
                local.append(frame)
                continue
            v = _vector(self.problem.sliding[contact])
            mu = _exact(self.problem.friction[contact])
            share = mu / _root(_dot(v, v)) if any(v) else Fraction(0)
            local.append([[n - share * s for n, s in zip(frame[0], v, strict=True)]])
        return local

    @cached_property
    def _columns(self) -> list[list[int]]:
        """Columns of each contact's coordinates."""
        start = itertools.accumulate((len(own) for own in self._local), initial=0)
        return [list(range(at, at + len(own))) for at, own in zip(start, self._local, strict=False)]

    @cached_property
    def _center(self) -> Vector:
        places = [_vector(row) for row in self.problem.positions]
        return [_coarse(sum(axis, Fraction()) / len(places)) for axis in zip(*places, strict=True)]

    @cached_property
    def _arms(self) -> list[Vector]:
        """(M, 3) positions about the contacts' centre, so that a far reference costs no digits."""
        return [
            [a - b for a, b in zip(_vector(row), self._center, strict=True)]
            for row in self.problem.positions
        ]

    @cached_property
    def _torques(self) -> Vector:
        """(L,) sizes of torques, N m."""
        return [_coarse(self.load * lever) for lever in self.levers]

    @cached_property
    def _goal_size(self) -> Fraction:
        """What a unit of the last variable is: N, N m or 1."""
        if self.question.algorithm == "margin":
            return self.load
        return Fraction(1) if self.question.by_limits else max(self._torques, default=Fraction(1))

    def _statement(self, *, with_goal: bool) -> list[tuple[Vector, Fraction, bool]]:
        """Rows a^T x = or <= b in forces over their size and the goal, each in units of the load.

        Args:
            with_goal: Whether to ask for the goal, too; else for the constraints alone.
        """
        problem, question, force = self.problem, self.question, self.load
        size = self._columns[-1][-1] + 2
        rows: list[tuple[Vector, Fraction, bool]] = []
        is_margin = question.algorithm == "margin"
        keeps = Fraction(0) if is_margin else _exact(question.margin) / force
        room = Fraction(1 if is_margin and with_goal else 0)

        def add(entries: dict[int, Fraction], side: Fraction, *, equal: bool = False) -> None:
            row = [Fraction(0)] * size
            for column, entry in entries.items():
                row[column] += entry
            rows.append((row, side, equal))

        arms = self._arms
        columns = [
            (column, contact, direction)
            for contact, own in enumerate(self._columns)
            for column, direction in zip(own, self._local[contact], strict=True)
        ]
        pull, twist = _vector(problem.external_wrench[:3]), _vector(problem.external_wrench[3:])
        twist = [a - b for a, b in zip(twist, _cross(self._center, pull), strict=True)]
        for axis in range(3):
            add({c: d[axis] for c, _, d in columns}, -pull[axis] / force, equal=True)
        for axis in range(3):
            turned = {c: _cross(arms[at], d)[axis] / self.length for c, at, d in columns}
            add(turned, -twist[axis] / (force * self.length), equal=True)
        for contact, own in enumerate(self._columns):
            limit = _exact(problem.max_normal_force[contact]) / force
            add({own[0]: Fraction(1), size - 1: room}, limit - keeps)
            add({own[0]: Fraction(-1), size - 1: room}, -keeps)
            if len(own) == 1:
                continue
            mu = _exact(problem.friction[contact])
            for normal, first, second in _faces(mu, problem.cone_edges):
                face = dict(zip(own, (normal, first, second), strict=True))
                add({**face, size - 1: room}, -keeps)
        for joint, unit in enumerate(self._torques):
            column = problem.jacobian[:, joint].reshape(-1, 3)
            levers = {c: _dot(_vector(column[at]), d) * force / unit for c, at, d in columns}
            gravity = _exact(problem.gravity_torques[joint])
            low, high = float(problem.lower_torque[joint]), float(problem.upper_torque[joint])
            if low == high:
                add(levers, (_exact(high) - gravity) / unit, equal=True)
            for sign, limit in ((1, high), (-1, -low)):
                one_way = {c: sign * entry for c, entry in levers.items()}
                if low != high and math.isfinite(limit):
                    add(one_way, (_exact(limit) - sign * gravity) / unit)
                if is_margin or not with_goal:
                    continue
                share = Fraction(1)
                if question.by_limits:
                    if not (math.isfinite(limit) and limit > 0):
                        continue
                    share = _exact(limit)
                add({**one_way, size - 1: -share * self._goal_size / unit}, -sign * gravity / unit)
        if with_goal:
            add({size - 1: Fraction(-1)}, Fraction(0))
        return rows

    @cached_property
    def _rows(self) -> Rows:
        slack = self.slack
        equations, others = [], []
        for row, side, equal in self._statement(with_goal=True):
            if equal and slack <= 0:
                equations.append((row, side))
                continue
            others.append((row, side + slack))
            if equal:
                others.append(([-entry for entry in row], slack - side))
        # The last row says that the goal is not negative, to the last digit.
        others[-1] = others[-1][0], Fraction(0)
        return Rows.of(equations, others)

    @cached_property
    def _cost(self) -> Vector:
        cost = [Fraction(0)] * (self._columns[-1][-1] + 2)
        cost[-1] = Fraction(-1 if self.question.algorithm == "margin" else 1)
        return cost

    def _least(self, decided: dict[int, Signs | None], parent: Optimum | None) -> Optimum | None:
        """The optimum of the forces that decisions leave, in scaled units, (27) and (31).

        Args:
            decided: Signs of contacts, None for those that are not selected; the friction of the
                others is free.
            parent: The optimum of fewer decisions.
        """
        allowed = {
            self._columns[contact][1 + m]: (0 if signs is None else signs[m])
            for contact, signs in decided.items()
            if self._has_cone[contact]
            for m in range(2)
        }
        key = tuple(sorted(allowed.items()))
        if key not in self._forces:
            if parent is not None and all(
                parent.x[column] * sign <= 0 if sign else parent.x[column] == 0
                for column, sign in allowed.items()
            ):
                self._forces[key] = parent
            else:
                self._forces[key] = self._solved(allowed)
        return self._forces[key]

    def _solved(self, allowed: dict[int, int]) -> Optimum | None:
        size = len(self._cost)
        zero, signed = [], []
        for column, sign in allowed.items():
            row = [Fraction(0)] * size
            row[column] = Fraction(sign or 1)
            (signed if sign else zero).append((row, Fraction(0)))
        rows = self._rows.joined(Rows.of(zero, signed)) if allowed else self._rows
        self.programs += 1
        answer = solve(rows, self._cost)
        return None if isinstance(answer, Infeasible) else answer

    def _unscaled(self, value: Fraction) -> Fraction:
        return abs(value) * self._goal_size

    def _world(self, x: Sequence[Fraction]) -> tuple[tuple[Fraction, ...], ...]:
        """(M, 3) forces of coordinates, N."""
        return tuple(
            tuple(
                self.load
                * sum((x[c] * d[axis] for c, d in zip(own, local, strict=True)), Fraction())
                for axis in range(3)
            )
            for own, local in zip(self._columns, self._local, strict=True)
        )

    # -- the modes -------------------------------------------------------------------------

    def _mode(self, decided: dict[int, Signs | None]) -> Mode:
        return tuple(decided.get(contact) for contact in range(len(self._has_cone)))

    def _ways(self, contact: int, bound: Optimum | None) -> list[Signs | None]:
        """How a contact may be decided; what leaves a bound's forces alone comes first."""
        values = (1, 0, -1) if self.question.sign_rule == "exact" else (1, -1)
        ways: list[Signs | None] = [
            (a, b) for a, b in itertools.product(values, values) if (a, b) != (0, 0)
        ]
        if not self._slides[contact]:
            ways.append(None)
        if bound is not None and self._has_cone[contact]:
            friction = [bound.x[column] for column in self._columns[contact][1:]]

            def lost(signs: Signs | None) -> Fraction:
                return sum(
                    (
                        abs(f)
                        for f, sign in zip(friction, signs or (0, 0), strict=True)
                        if f * sign > 0 or (not sign and f)
                    ),
                    Fraction(),
                )

            ways.sort(key=lost)
        return ways

    @cached_property
    def _velocities(self) -> list[list[Vector]]:
        """(M, 3, 6 + L) velocities along n, t1, t2 of motions [V about the centre; rates]."""
        problem = self.problem
        blocks = []
        for contact, frame in enumerate(self._frames):
            arm = [entry / self.length for entry in self._arms[contact]]
            own = problem.jacobian[3 * contact : 3 * contact + 3]
            rates = [
                [_exact(entry) / lever for entry in own[:, joint]]
                for joint, lever in enumerate(self.levers)
            ]
            # The velocity of the point is v + w x arm, so along an axis w counts arm x axis.
            blocks.append(
                [
                    [*axis, *_cross(arm, axis), *(_dot(rate, axis) for rate in rates)]
                    for axis in frame
                ]
            )
        return blocks

    def _stated(self, mode: Mode) -> _Motions:
        nothing, one = Fraction(0), Fraction(1)
        equations: list[tuple[Vector, Fraction]] = []
        others: list[tuple[Vector, Fraction]] = []

        still: list[Vector] = []

        def vanish(row: Vector) -> None:
            still.append(row)
            if self.still:
                others.extend(([sign * e for e in row] + [nothing], self.still) for sign in (1, -1))
            else:
                equations.append(([*row, nothing], nothing))

        for contact, signs in enumerate(mode):
            if signs is None:
                continue
            normal, *tangents = self._velocities[contact]
            vanish(normal)
            against = [[-s * e for e in row] for s, row in zip(signs, tangents, strict=True)]
            if self.question.sign_rule == "nonzero":
                others += [([*row, nothing], nothing) for row in against]
                total = [a + b for a, b in zip(*against, strict=True)]
                others.append(([*total, one], nothing))
                continue
            for sign, row, tangent in zip(signs, against, tangents, strict=True):
                if sign:
                    others.append(([*row, one], nothing))
                else:
                    vanish(tangent)
        velocities = [row for block in self._velocities for row in block]
        return _Motions(velocities, still, equations, others)


class _Motions:
    """The motions of one mode, and how fast the fastest is where it is slowest.

    Contact velocities of length 1 lie in a cube; its program bounds the speed from above, and the
    motion found, brought to length 1, from below: within a factor of the root of the number of
    components. Closer, floats propose the best velocities: the plane that touches the ball there
    bounds the speed from above, and a rational motion next to them from below.

    Attributes:
        slowest: The required speed that a motion of length 1 surely has.
        bound: What none exceeds.
    """

    def __init__(
        self,
        velocities: list[Vector],
        still: list[Vector],
        equations: list[tuple[Vector, Fraction]],
        others: list[tuple[Vector, Fraction]],
    ) -> None:
        """Take rows of the motion, and rows a^T x = or <= b of the motion and the speed.

        Args:
            velocities: (3M, 6 + L).
            still: Those of them that vanish.
            equations: What says so.
            others: What the speed says of the motion, first of all.
        """
        self.slowest: float | Fraction = Fraction(0)
        self.bound: float | Fraction = Fraction(1)
        self._velocities, self._still = velocities, still
        size = len(velocities[0])
        self._asked = [row for row, side in others if not side]
        if not self._asked:
            self.slowest = self.bound = math.inf
            return
        box: list[tuple[Vector, Fraction]] = [
            ([sign * entry for entry in row] + [Fraction(0)], Fraction(1))
            for row in velocities
            for sign in (1, -1)
        ]
        box.append(([Fraction(0)] * size + [Fraction(1)], Fraction(1)))
        self._rows = Rows.of(equations, others + box)
        self._cost = [*[Fraction(0)] * size, Fraction(-1)]
        self._bound_by(self._rows)

    def refine(self, until: Fraction | None = None) -> None:
        """Narrow what is known, or only to one side of a speed."""
        if self.slowest >= self.bound * (1 - _CLOSE):
            return
        if until is not None and not self.slowest < until <= self.bound:
            return
        proposed = self._proposed()
        if proposed is None:
            return
        nothing = Fraction(0)
        touching = [
            sum((n * v[j] for n, v in zip(proposed, self._velocities, strict=True)), Fraction())
            for j in range(len(self._velocities[0]))
        ]
        reach = _root(_dot(proposed, proposed)) + _ROUNDED_UP
        self._bound_by(self._rows.joined(Rows.of([], [([*touching, nothing], reach)])))
        near = [
            ([sign * entry for entry in row] + [nothing], sign * n + _CLOSE / 100)
            for row, n in zip(self._velocities, proposed, strict=True)
            for sign in (1, -1)
        ]
        self._bound_by(self._rows.joined(Rows.of([], near)), above=False)

    def _bound_by(self, rows: Rows, *, above: bool = True) -> None:
        """Solve a program; it holds all motions of length 1 if it bounds the speed from above."""
        answer = solve(rows, self._cost)
        if isinstance(answer, Infeasible):
            if above:
                self.bound = Fraction(0)
            return
        *motion, speed = answer.x
        if above:
            self.bound = min(self.bound, speed)
        u = [_dot(row, motion) for row in self._velocities]
        largest = max(abs(entry) for entry in u)
        if speed and largest:
            length = _root(sum(((e / largest) ** 2 for e in u), Fraction())) + _ROUNDED_UP
            self.slowest = max(self.slowest, speed / (largest * length))

    def _proposed(self) -> Vector | None:
        """(3M,) velocities of length 1 that are likely to slide fastest where they are slowest.

        The shortest combination of the required rows, by nonnegative least squares.
        """
        velocities = np.array(self._velocities, dtype=float)
        left, values, right = np.linalg.svd(velocities, full_matrices=False)
        rank = int((values > 1e-12 * values.max()).sum())
        back = right[:rank].T / values[:rank]
        basis = np.eye(rank)
        if self._still:
            _, sizes, rest = np.linalg.svd(np.array(self._still, dtype=float) @ back)
            basis = rest[int((sizes > 1e-10).sum()) :].T
        asked = np.array(self._asked, dtype=float)
        moving = -asked[:, :-1] @ back @ basis
        system = np.vstack([moving.T, asked[:, -1]])
        try:
            weights, _ = nnls(system, np.eye(len(system))[-1])
        except RuntimeError:  # too many iterations
            return None
        u = left[:, :rank] @ basis @ (moving.T @ weights)
        size = float(np.linalg.norm(u))
        return _vector(u / size) if size > 0.0 else None


def _exact(value: Any) -> Fraction:
    return Fraction(float(value))


def _vector(row: Any) -> Vector:
    return [Fraction(float(entry)) for entry in row]


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction())


def _cross(a: Sequence[Fraction], b: Sequence[Fraction]) -> Vector:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def _coarse(value: Fraction, digits: int = 12) -> Fraction:
    """A value near another one, to so many binary digits."""
    if not value:
        return value
    power = Fraction(2) ** (math.frexp(float(value))[1] - digits)
    return round(value / power) * power


def _size(vector: Sequence[Fraction]) -> Fraction:
    """The length of a vector, near enough for a unit."""
    largest = max(abs(entry) for entry in vector)
    if not largest:
        return largest
    return _coarse(largest * _root(sum(((e / largest) ** 2 for e in vector), Fraction())))


def _rounded(value: Fraction) -> Fraction:
    return Fraction(round(value * 2**_DIGITS), 2**_DIGITS)


def _root(square: Fraction) -> Fraction:
    """The square root, to 2^-96 of itself or better."""
    down = max(0, square.denominator.bit_length() - square.numerator.bit_length()) // 2
    shift = 2 * (_DIGITS + down)
    return Fraction(math.isqrt((square.numerator << shift) // square.denominator), 1 << shift // 2)


@cache
def _faces(friction: Fraction, edges: int) -> list[tuple[Fraction, Fraction, Fraction]]:
    """Unit outward normals of the side faces along n, t1, t2, eq. (38)."""
    slope = friction * _rounded(_cosine(Fraction(1, edges)))
    length = _root(1 + slope * slope)
    faces = []
    for face in range(edges):
        turn = Fraction(2 * face + 1, edges)
        along = _rounded(_cosine(turn)), _rounded(_cosine(turn - Fraction(1, 2)))
        faces.append((-slope / length, along[0] / length, along[1] / length))
    return faces


@cache
def _pi() -> Fraction:
    """Pi by Machin's formula, 16 atan(1/5) - 4 atan(1/239), to 2^-128."""

    def arc(one_over: int) -> Fraction:
        terms = (Fraction((-1) ** k, (2 * k + 1) * one_over ** (2 * k + 1)) for k in range(30 + 3))
        return sum(terms, Fraction())

    return Fraction(round((16 * arc(5) - 4 * arc(239)) * 2**140), 2**140)


@cache
def _cosine(turn: Fraction) -> Fraction:
    """cos(pi turn), to far below 2^-96, and with its symmetries exact after rounding."""
    turn = abs(turn) % 2
    if turn > 1:
        turn = 2 - turn
    if turn > Fraction(1, 2):
        return -_cosine(1 - turn)
    x = turn * _pi()
    total = term = Fraction(1)
    for k in range(1, 24):
        term = Fraction(round(-term * x * x / ((2 * k - 1) * (2 * k)) * 2**140), 2**140)
        total += term
    return total
