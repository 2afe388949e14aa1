"""The rule of directions by listing: each contact without friction, or in one of 32 sectors.

Straight from the problem's arrays and W, with linear programs of scipy: an outer value with
friction and sliding anywhere in their sectors, an inner one with both along the middles. The two
leave a gap of their own, of the sectors' width.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from graspless_pin import QuasistaticProblem

COUNT = 32
HALF = np.pi / COUNT
_FASTEST = 1e6
"""Slidings are at least 1, and so are no faster: the threshold of the rule."""
_CLOSE = 1e-9

Choice = tuple[int | None, ...]
"""Of the first contacts: the sector, or None without friction."""


class Enclosure(NamedTuple):
    """What the listing says of an optimum; NaN: nothing is feasible.

    Attributes:
        inner: Value of an answer whose directions are the sectors' middles; NaN where balance asks
            for others, as it mostly does with two contacts.
        outer: A value that no answer is better than.
    """

    inner: float
    outer: float


@dataclass
class SectorListing:
    """Lists all choices of sectors of one problem, depth first over the contacts.

    Choices whose outer value is no better than the best inner one are cut.

    Attributes:
        problem: The problem; its cones count as round.
        margin: Required margin, N; None: the margin is maximised.
        constrained: Whether contacts in actual sliding have to slide virtually, too.
    """

    problem: QuasistaticProblem
    margin: float | None = None
    constrained: bool = False

    def enclosure(self) -> Enclosure:
        """Return the bounds of the optimum, margin in N or largest torque in N m."""
        self._inner, self._outer = np.inf, np.inf
        self._sign = -1.0 if self.margin is None else 1.0
        count = self.problem.contact_count
        self._has_cone = [
            self.problem.friction[i] > 0.0 and not self.problem.sliding[i].any()
            for i in range(count)
        ]
        self._list((), self._forces((), inner=False))
        best = min(self._outer, self._inner)
        values = [self._sign * v if np.isfinite(v) else np.nan for v in (self._inner, best)]
        return Enclosure(*values)

    def _list(self, chosen: Choice, value: float | None) -> None:
        """Go through all choices that begin with some, whose outer value is known."""
        if value is None or value >= self._inner - _CLOSE or not self._moves(chosen, inner=False):
            return
        if len(chosen) < self.problem.contact_count:
            contact = len(chosen)
            must = self.constrained and bool(self.problem.sliding[contact].any())
            options: list[int | None] = [] if must else [None]
            if self._has_cone[contact] or must:
                options += range(COUNT)
            longer = [(*chosen, one) for one in options]
            ranked = [(self._forces(one, inner=False), one) for one in longer]
            for own, one in sorted(ranked, key=lambda pair: np.inf if pair[0] is None else pair[0]):
                self._list(one, own)
            return
        self._outer = min(self._outer, value)
        if self._moves(chosen, inner=True):
            reached = self._forces(chosen, inner=True)
            if reached is not None:
                self._inner = min(self._inner, reached)

    def _moves(self, chosen: Choice, *, inner: bool) -> bool:
        """Whether a motion slides in the chosen sectors, or along their middles."""
        problem = self.problem
        columns = 6 + problem.joint_count
        equal, below, sides = [], [], []
        for contact, sector in enumerate(chosen):
            if sector is None:
                continue
            own = slice(3 * contact, 3 * contact + 3)
            velocity = np.hstack([problem.W[:, own].T, -problem.jacobian[own]])
            relative = problem.frames[contact].T @ velocity
            middle, across = _ways(sector)
            equal.append(relative[0])
            along, aside = middle @ relative[1:], across @ relative[1:]
            if inner:
                equal.append(aside)
            else:
                below += [aside - np.tan(HALF) * along, -aside - np.tan(HALF) * along]
                sides += [0.0, 0.0]
            below += [-along, along]
            sides += [-np.cos(HALF), _FASTEST]
        if not equal:
            return True
        bounds = (-_FASTEST * 1e2, _FASTEST * 1e2)
        answer = linprog(
            np.zeros(columns), A_ub=np.array(below), b_ub=sides, A_eq=np.array(equal),
            b_eq=np.zeros(len(equal)), bounds=[bounds] * columns, method="highs",
        )  # fmt: skip
        return answer.status == 0

    def _forces(self, chosen: Choice, *, inner: bool) -> float | None:
        """Value of the program with friction opposite to the chosen sectors; None: none."""
        problem, M = self.problem, self.problem.contact_count
        F = float(np.linalg.norm(problem.external_wrench[:3])) or 1.0
        size = 3 * M + 1
        below, sides, equal, right = [], [], [], []

        def row(contact: int, local: np.ndarray, last: float = 0.0) -> np.ndarray:
            out = np.zeros(size)
            out[3 * contact : 3 * contact + 3] = problem.frames[contact] @ local
            out[-1] = last
            return out

        e = 0.0 if self.margin is None else self.margin / F
        weight = 1.0 if self.margin is None else 0.0
        for contact in range(M):
            mu, most = problem.friction[contact], problem.max_normal_force[contact] / F
            below += [row(contact, np.array([-1.0, 0, 0]), weight),
                      row(contact, np.array([1.0, 0, 0]), weight)]  # fmt: skip
            sides += [-e, most - e]
            if not self._has_cone[contact]:
                way = np.zeros(2)
                if problem.sliding[contact].any():
                    own = problem.tangents[contact].T @ problem.sliding[contact]
                    way = -mu * own / np.linalg.norm(own)
                equal += [row(contact, np.array([-way[0], 1.0, 0.0])),
                          row(contact, np.array([-way[1], 0.0, 1.0]))]  # fmt: skip
                right += [0.0, 0.0]
                continue
            root = np.sqrt(1.0 + mu**2)
            if contact >= len(chosen):
                reaches = [_ways(one)[0] for one in range(COUNT)]
            elif (sector := chosen[contact]) is None:
                equal += [row(contact, np.array([0.0, 1, 0])), row(contact, np.array([0.0, 0, 1]))]
                right += [0.0, 0.0]
                reaches = [np.zeros(2)]
            else:
                middle, across = _ways(sector)
                reaches = [-middle]
                if inner:
                    equal.append(row(contact, np.array([0.0, *across])))
                    right.append(0.0)
                    below.append(row(contact, np.array([0.0, *middle])))
                    sides.append(0.0)
                else:
                    for turn in (across, -across):
                        local = np.array([0.0, *(turn + np.tan(HALF) * middle)])
                        below.append(row(contact, local))
                        sides.append(0.0)
            for way in reaches:
                below.append(row(contact, np.array([-mu, *way]), root * weight))
                sides.append(-root * e)
        W = np.hstack([problem.W, np.zeros((6, 1))])
        torque = np.hstack([problem.jacobian.T, np.zeros((problem.joint_count, 1))])
        gravity = problem.gravity_torques / F
        below += [*torque, *-torque]
        sides += [*(problem.upper_torque / F - gravity), *(gravity - problem.lower_torque / F)]
        cost = np.zeros(size)
        cost[-1] = 1.0
        if self.margin is None:
            cost[-1] = -1.0
        else:
            t = np.zeros(size)
            t[-1] = 1.0
            below += [*(torque - t), *(-torque - t)]
            sides += [*-gravity, *gravity]
        finite = np.isfinite(sides)
        answer = linprog(
            cost, A_ub=np.array(below)[finite], b_ub=np.array(sides)[finite],
            A_eq=np.vstack([W, *equal]),
            b_eq=np.concatenate([-problem.external_wrench / F, right]),
            bounds=[(None, None)] * (size - 1) + [(0.0, None)], method="highs",
        )  # fmt: skip
        return None if answer.status != 0 else F * float(answer.fun)


def _ways(sector: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the middle of a sector, and the direction across it, along t1 and t2."""
    angle = 2.0 * HALF * sector
    return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
