"""Which outcomes of Coulomb's law exist at rest, by full enumeration of contact states.

Numpy and scipy only, and nothing of the package. An outcome is an acceleration a of object and
joints and contact forces f on the object with

    M a = G^T f + (w, tau),  u = G a,  G = [W^T  -J],  0 <= u_n  _|_  f_n >= 0,  |f_t| <= mu f_n,

and f_t = -mu f_n u_t / |u_t| where u_t is not zero. M holds the object's inertia and the joints';
tau is the motors' torque less what bears the links' weight, so that at rest tau = J^T f.

Every contact is open, sticks, or slips in one of K equal sectors. Sector by sector all conditions
are linear and homogeneous in (a, f, t), where t from 0 to 1 stands before the load: (0, 0, 0) is
always feasible, t = 1 is an outcome up to the sector's width, and t = 0 leaves only a = 0, for the
power of friction is never positive in a sector. So two maxima by LP tell all: that of the load's
power over the velocities that a combination of states allows, whatever the forces; where it is
positive, that of each component of the object's acceleration with forces. Sectors that leave it
open are halved until an exact outcome is found, or none is left, or the width is used up.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix
from tests.oracles.outcome_polish import EXACT, Polish
from tests.oracles.rest_cases import Array, Outcome, RestCase, Scaled, State

UNBALANCED = 1e-6
"""Least residual of forces that are called unable to balance."""
_HALVINGS = 400
_CUTS = 12
_BATCH = 96
CLOSE = 4.0
"""Bounds up to this many resolutions, with no exact outcome above one, count as no motion."""


class Answer(NamedTuple):
    """What exists.

    Attributes:
        status: "strong", "weak", "none", or "between" where the sectors' width leaves it open.
        rest: Whether forces balance at rest; None: too near to tell.
        moving: Whether an outcome moves the object; None: the sectors leave it open.
        outcome: One that moves it, or None.
        bound: Largest acceleration of the object in what is left, m/s^2; of no use if it moves.
        programs: LPs solved, each batch counted as one for each of its combinations.
    """

    status: str
    rest: bool | None
    moving: bool | None
    outcome: Outcome | None
    bound: float
    programs: int


class _Cone(NamedTuple):
    """Equations and inequalities of a cone, (n, columns) each."""

    equal: Array
    below: Array


def _maxima(
    cones: Sequence[_Cone], costs: Array, low: Array, high: Array
) -> tuple[Array, list[Array | None]]:
    """Maximise one cost over each cone within a box that holds zero: one LP of many blocks."""
    blocks, width = costs.shape
    answer = linprog(
        -costs.ravel(),
        A_ub=_stacked([cone.below for cone in cones], width),
        b_ub=np.zeros(sum(len(cone.below) for cone in cones)),
        A_eq=_stacked([cone.equal for cone in cones], width),
        b_eq=np.zeros(sum(len(cone.equal) for cone in cones)),
        bounds=np.tile(np.column_stack([low, high]), (blocks, 1)),
        method="highs",
        options={"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9},
    )
    if answer.status == 0:
        points = answer.x.reshape(blocks, width)
        return np.einsum("bn,bn->b", costs, points), list(points)
    if blocks == 1:
        return np.array([np.inf]), [None]
    each = [_maxima([one], cost[None], low, high) for one, cost in zip(cones, costs, strict=True)]
    return np.concatenate([values for values, _ in each]), [points[0] for _, points in each]


def _stacked(rows: Sequence[Array], width: int) -> csr_matrix:
    """Block diagonal of dense rows."""
    entries = np.concatenate(rows)
    block = np.repeat(np.arange(len(rows)), [len(one) for one in rows])
    columns = (block[:, None] * width + np.arange(width)).ravel()
    starts = np.arange(len(entries) + 1) * width
    return csr_matrix((entries.ravel(), columns, starts), (len(entries), len(rows) * width))


def least_imbalance(case: RestCase) -> float:
    """Return how far forces in the round cones are from a balance at rest, in loads; 0: balanced.

    The unit is that of |M^{-1/2} (w, tau)|.
    """
    scaled = Scaled(case)
    if scaled.size == 0.0:
        return 0.0
    count, width = scaled.count, len(scaled.load)
    cuts: list[list[float]] = [[] for _ in range(count)]
    value = 0.0
    for _ in range(60):
        rows = [scaled.force_rows(i, State("stick"), cuts[i]) for i in range(count)]
        given = np.eye(3 * count)[::3][scaled.commanded]
        equal = np.vstack([_diagonal([one for one, _ in rows], 3), given])
        right = np.concatenate([np.zeros(len(equal) - len(given)), scaled.press[scaled.commanded]])
        below = _diagonal([two for _, two in rows], 3)
        pull = scaled.rows.reshape(3 * count, width).T
        answer = linprog(
            np.concatenate([np.zeros(3 * count), np.ones(2 * width)]),
            A_ub=np.hstack([below, np.zeros((len(below), 2 * width))]),
            b_ub=np.zeros(len(below)),
            A_eq=np.block([[pull, np.eye(width), -np.eye(width)],
                           [equal, np.zeros((len(equal), 2 * width))]]),
            b_eq=np.concatenate([-scaled.load, right]),
            bounds=[(None, None)] * (3 * count) + [(0.0, None)] * (2 * width),
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )  # fmt: skip
        if answer.status != 0:
            raise ArithmeticError(answer.message)
        value = float(answer.fun)
        forces = answer.x[: 3 * count].reshape(count, 3)
        rubbing = np.linalg.norm(forces[:, 1:], axis=1)
        over = rubbing - scaled.friction * forces[:, 0] > 0.1 * EXACT * (1.0 + rubbing)
        if value > UNBALANCED or not over.any():
            break
        for i in np.flatnonzero(over):
            cuts[i].append(float(np.arctan2(forces[i, 2], forces[i, 1])))
    return value


def _diagonal(rows: Sequence[Array], width: int) -> Array:
    return _stacked(rows, width).toarray()


class Enumeration:
    """All combinations of contact states of one case.

    Args:
        case: What is at rest.
        sectors: K directions of slip, from 4.
        resolution: Accelerations of the object up to this are none, m/s^2.
    """

    def __init__(self, case: RestCase, sectors: int, resolution: float) -> None:
        self.case, self.resolution = case, resolution
        self.scaled = Scaled(case)
        self.programs = 0
        self.bound = 0.0
        edges = 2.0 * np.pi * np.arange(sectors + 1) / sectors
        self.slips = [State("slip", *pair) for pair in itertools.pairwise(edges.tolist())]
        reach = self.scaled.bound(np.linalg.norm(self.scaled.moves, axis=1))
        self.still = (resolution / reach) ** 2 if reach > 0.0 else np.inf
        self.left_open = False

    def run(self) -> Answer:
        """Go through all combinations until one moves."""
        imbalance = least_imbalance(self.case)
        rest = True if imbalance <= EXACT else False if imbalance > UNBALANCED else None
        outcome = next(self._moving(), None) if self.scaled.size else None
        moving = True if outcome else None if self.left_open else False
        status = "between"
        if rest is False:
            status = "none"
        elif rest and moving is not None:
            status = "weak" if moving else "strong"
        return Answer(status, rest, moving, outcome, self.bound, self.programs)

    def _moving(self) -> Iterator[Outcome]:
        for leaves in self._kinematic(()):
            cones = [self._cone(leaf) for leaf in leaves]
            cost = np.concatenate([self.scaled.load, np.zeros(3 * self.scaled.count + 1)])
            powers, _ = self._solve(cones, np.tile(cost, (len(cones), 1)))
            for leaf, power in zip(leaves, powers, strict=True):
                if power > self.still:
                    yield from self._looked_into(leaf)

    def _kinematic(self, first: tuple[State, ...]) -> Iterator[list[tuple[State, ...]]]:
        """Yield the combinations whose velocities may take power from the load, some at a time."""
        count = self.scaled.count
        states = [State("stick")]
        if not self.scaled.commanded[len(first)]:
            states.append(State("open"))
        if self.scaled.friction[len(first)] > 0.0:
            states += self.slips
        nodes = [(*first, state) for state in states]
        kept: list[tuple[State, ...]] = []
        for start in range(0, len(nodes), _BATCH):
            batch = nodes[start : start + _BATCH]
            cones = []
            for node in batch:
                whole = [*node, *[State("free")] * (count - len(node))]
                pairs = [self.scaled.velocity_rows(i, state) for i, state in enumerate(whole)]
                cones.append(_Cone(*(np.vstack(part) for part in zip(*pairs, strict=True))))
            self.programs += len(batch)
            load = self.scaled.load
            powers, _ = _maxima(cones, np.tile(load, (len(batch), 1)), *self._box())
            kept += [node for node, power in zip(batch, powers, strict=True) if power > self.still]
        if len(first) + 1 == count:
            yield kept
            return
        for node in kept:
            yield from self._kinematic(node)

    def _box(self) -> tuple[Array, Array]:
        return 0.5 * (self.scaled.load - 1.0), 0.5 * (self.scaled.load + 1.0)

    def _solve(self, cones: Sequence[_Cone], costs: Array) -> tuple[Array, list[Array | None]]:
        values, points = [], []
        low, high = self._box()
        count = self.scaled.count
        low = np.concatenate([low, np.full(3 * count, -np.inf), [0.0]])
        high = np.concatenate([high, np.full(3 * count, np.inf), [1.0]])
        for start in range(0, len(cones), _BATCH):
            part = slice(start, start + _BATCH)
            some, where = _maxima(cones[part], costs[part], low, high)
            values.append(some)
            points += where
        self.programs += len(cones)
        return np.concatenate([*values, np.empty(0)]), points

    def _cone(self, leaf: Sequence[State], cuts: Sequence[Sequence[float]] | None = None) -> _Cone:
        scaled = self.scaled
        count, width = scaled.count, len(scaled.load)
        pull = scaled.rows.reshape(3 * count, width).T
        equal = [np.hstack([np.eye(width), -pull, -scaled.load[:, None]])]
        below = []
        for i, state in enumerate(leaf):
            for rows, into in zip(scaled.velocity_rows(i, state), (equal, below), strict=True):
                into.append(np.pad(rows, ((0, 0), (0, 3 * count + 1))))
            own = scaled.force_rows(i, state, cuts[i] if cuts else ())
            for rows, into in zip(own, (equal, below), strict=True):
                left = width + 3 * i
                into.append(np.pad(rows, ((0, 0), (left, 3 * count - 3 * i - 2))))
        for i in np.flatnonzero(scaled.commanded):
            row = np.zeros((1, width + 3 * count + 1))
            row[0, [width + 3 * i, -1]] = 1.0, -scaled.press[i]
            equal.append(row)
        return _Cone(np.vstack(equal), np.vstack(below))

    def _looked_into(self, leaf: tuple[State, ...]) -> Iterator[Outcome]:
        """Halve sectors where the gap is largest until they move exactly or not at all."""
        waiting = [leaf]
        for _ in range(_HALVINGS):
            if not waiting:
                return
            one = waiting.pop()
            point = self._fastest(one)
            if point is None:
                continue
            y, forces, bound = point
            outcome = Polish(self.scaled, one).exact(y, forces)
            if outcome and self.case.object_motion(outcome.acceleration) > self.resolution:
                yield outcome
                return
            if bound <= CLOSE * self.resolution:
                self.bound = max(self.bound, bound)
                continue
            slipping = [i for i, state in enumerate(one) if state.kind == "slip"]
            u = self.scaled.rows @ y
            gaps = [
                self.scaled.friction[i] * forces[i, 0] * np.linalg.norm(u[i, 1:])
                + forces[i, 1:] @ u[i, 1:]
                for i in slipping
            ]
            if not slipping or max(gaps) < 1e-12:
                break
            widest = slipping[int(np.argmax(gaps))]
            waiting += [(*one[:widest], half, *one[widest + 1 :]) for half in one[widest].halves()]
        self.left_open = True

    def _fastest(self, leaf: Sequence[State]) -> tuple[Array, Array, float] | None:
        """Return the point that moves the object most, and a bound; None: none moves it."""
        scaled = self.scaled
        count, width = scaled.count, len(scaled.load)
        costs = np.pad(np.vstack([scaled.moves, -scaled.moves]), ((0, 0), (0, 3 * count + 1)))
        cuts: list[list[float]] = [[] for _ in range(count)]
        while True:
            cone = self._cone(leaf, cuts)
            values, points = self._solve([cone] * len(costs), costs)
            most = np.maximum(0.0, values.reshape(2, -1).max(axis=0))
            bound = scaled.bound(most)
            if bound <= self.resolution:
                self.bound = max(self.bound, bound)
                return None
            point = points[int(np.argmax(values))]
            if point is None:
                self.left_open = True
                return None
            y, forces = point[:width], point[width:-1].reshape(count, 3)
            over = [
                i
                for i, state in enumerate(leaf)
                if state.kind == "stick"
                and np.linalg.norm(forces[i, 1:]) > (scaled.friction[i] * forces[i, 0] + 1e-10)
            ]
            if not over or max(map(len, cuts)) >= _CUTS:
                return y, forces, bound
            for i in over:
                cuts[i].append(float(np.arctan2(forces[i, 2], forces[i, 1])))


def enumerate_outcomes(case: RestCase, *, sectors: int = 16, resolution: float = 1e-3) -> Answer:
    """Decide which outcomes exist.

    Args:
        case: What is at rest.
        sectors: K directions of slip at each contact, from 4.
        resolution: Accelerations of the object up to this share of load over mass are none.
    """
    return Enumeration(case, sectors, resolution * case.load_over_mass).run()
