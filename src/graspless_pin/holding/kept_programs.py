"""Linear programs over the outcomes under a declared motion with contacts in given states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspless_pin.holding.bounds import States
from graspless_pin.holding.cuts import arc_rows, around, cone_planes, cone_tangents
from graspless_pin.holding.dynamics import Dynamics
from graspless_pin.holding.verdict import ContactState, DualBound
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solvers.simplex import Simplex, SimplexAnswer

_DIRECTIONS = 8
"""Directions of the tangent planes of each cone."""
_BOX = 1e3
"""Normal forces of best points, scaled; no proof leans on it."""
_MOST_CUTS = 6
"""Rounds of tangent cuts."""
_WHOLE = 1.0 - 1e-9
"""Share of the load from which a point has the whole of it."""


class KeptPrograms:
    """Linear programs in forces and the share t of the load: y = B^T f + t h, u = A y.

    Rows: u_n >= 0 or = 0, u_t = 0 where a contact sticks, commanded forces, tangent planes of the
    cones, and for a slip in an arc its edges, for slip and force.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        """Build the rows that all sets of outcomes share."""
        self._dynamics = dynamics
        count, self._size = dynamics.contact_count, 3 * dynamics.contact_count + 1
        self._pushes = np.vstack([dynamics.pushes.reshape(self._size - 1, -1), dynamics.load])
        self._slips = dynamics.rows @ self._pushes.T
        free = np.full(self._size, np.inf)
        self._simplex = Simplex(np.zeros(self._size), -free, free)
        across = self._slips[:, 1:].reshape(2 * count, -1)
        self._simplex.add_rows(np.vstack([self._slips[:, 0], across]), -free[:-1], free[:-1])
        held = np.flatnonzero(dynamics.is_commanded)
        given = np.zeros((len(held), self._size))
        given[np.arange(len(held)), 3 * held] = 1.0
        given[:, -1] = -dynamics.commanded[held]
        self._simplex.add_rows(given, np.zeros(len(held)), np.zeros(len(held)))
        for contact in range(count):
            planes = cone_planes(dynamics.friction[contact], around(_DIRECTIONS))
            self._add_planes(np.full(_DIRECTIONS, contact), planes)
        self._shared = self._simplex.row_count
        self._edges: list[tuple[int, FloatArray]] = []

    @property
    def programs(self) -> int:
        """Linear programs solved."""
        return self._simplex.solves

    def set(self, states: States) -> None:
        """Go to the outcomes in these states, with any share of the load."""
        self._simplex.drop_rows(self._shared, self._simplex.row_count)
        self._edges = []
        count, held = self._dynamics.contact_count, self._dynamics.is_commanded
        lb, ub = np.full(self._size, -np.inf), np.full(self._size, np.inf)
        low, high = lb[:-1].reshape(count, 3), ub[:-1].reshape(count, 3)
        low[:, 0], high[:, 0] = 0.0, np.where(held, np.inf, _BOX)
        opened = states.are(ContactState.OPEN)
        low[opened], high[opened] = 0.0, 0.0
        lb[-1], ub[-1] = 0.0, 1.0
        self._simplex.set_bounds(lb, ub)
        self._bounds = lb, ub
        may_part = states.are(ContactState.FREE, ContactState.OPEN) | held
        sticking = np.repeat(states.are(ContactState.STICKING), 2)
        self._simplex.set_sides(
            np.arange(3 * count, dtype=np.int32),
            np.concatenate([np.where(held, -np.inf, 0.0), np.where(sticking, 0.0, -np.inf)]),
            np.concatenate([np.where(may_part, np.inf, 0.0), np.where(sticking, 0.0, np.inf)]),
        )
        for contact in np.flatnonzero(states.are(ContactState.SLIPPING)):
            self._add_arc(int(contact), states.center[contact], states.half_width[contact])

    def keep_load(self) -> None:
        """Ask for the whole load from now on, if the last point had it: there is a point then."""
        lb, ub = self._bounds
        if self._load > _WHOLE:
            lb[-1] = 1.0
            self._simplex.set_bounds(lb, ub)

    def largest(
        self, goal: FloatArray, states: States
    ) -> tuple[DualBound, FloatArray, FloatArray] | None:
        """Maximise p.y, or t where p is zero, cut by tangents of cones where contacts stick.

        Args:
            goal: p (n,).
            states: Those that were set.

        Returns:
            Multipliers without their lambda, the best point's forces (M, 3) and its y (n,); None
            where the solver has no answer.
        """
        cost = -self._pushes @ goal
        size = float(np.abs(cost).max()) or 1.0
        cost /= size
        cost[-1] -= not goal.any()
        self._simplex.set_cost(cost)
        answer = self._simplex.solve()
        for _ in range(_MOST_CUTS):
            if not answer.is_optimal:
                return None
            if not self._cut_cones(answer, states):
                break
            answer = self._simplex.solve()
        if not answer.is_optimal:
            return None
        self._load = float(answer.x[-1])
        forces, y = answer.x[:-1].reshape(-1, 3), self._pushes.T @ answer.x
        return self._multipliers(answer, size), forces, y

    def _multipliers(self, answer: SimplexAnswer, size: float) -> DualBound:
        count = self._dynamics.contact_count
        rows = size * answer.rows
        tangential = rows[count : 3 * count].reshape(count, 2).copy()
        for row, (contact, direction) in enumerate(self._edges):
            tangential[contact] += rows[self._shared + row] * direction
        return DualBound(np.zeros(len(self._dynamics.load)), rows[:count].copy(), tangential)

    def _add_planes(self, contacts: NDArray[np.int_], planes: FloatArray) -> None:
        """Add r.f <= 0 for rows r (k, 3) of contacts (k,)."""
        rows = np.zeros((len(contacts), self._size))
        for row, contact, plane in zip(rows, contacts, planes, strict=True):
            row[3 * contact : 3 * contact + 3] = plane
        self._simplex.add_rows(rows, np.full(len(rows), -np.inf), np.zeros(len(rows)))

    def _add_arc(self, contact: int, center: float, half_width: float) -> None:
        """Add what a slip in an arc of less than pi says: edges for slip and force."""
        edges, faces = arc_rows(center, half_width, self._dynamics.friction[contact])
        self._simplex.add_rows(edges @ self._slips[contact, 1:], np.zeros(2), np.full(2, np.inf))
        self._add_planes(np.full(3, contact), faces)
        # Rows on forces alone have no multiplier of their own.
        self._edges += [(contact, edge) for edge in (*edges, *np.zeros((3, 2)))]

    def _cut_cones(self, answer: SimplexAnswer, states: States) -> bool:
        """Add the cone's tangent beside each sticking force outside; return whether any was added.

        Only where no contact is left to be split: before, splitting tells more.
        """
        smooth = self._dynamics.friction == 0.0
        if (states.are(ContactState.FREE, ContactState.CLOSED) & ~smooth).any():
            return False
        forces = answer.x[:-1].reshape(-1, 3)
        sticking = states.are(ContactState.STICKING) & ~smooth
        outside, planes = cone_tangents(forces, self._dynamics.friction, sticking)
        self._add_planes(outside, planes)
        self._edges += [(0, np.zeros(2))] * len(outside)
        return len(outside) > 0
