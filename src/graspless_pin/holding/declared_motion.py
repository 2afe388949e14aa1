"""Whether a declared motion is kept: a proof that nothing else is an outcome, or another outcome.

All contact states are enumerated: open or closed, and sticking or slipping in sectors where a
contact does not slide by the declared motion. In each set of outcomes linear programs bound every
component of the object's acceleration: the power of kinetic friction has no sign.

For every outcome in given states and all multipliers nu and kappa, with
lambda = p + sum_l (nu_l A_n,l + A_t,l^T kappa_l) and c = B lambda,

    p.y = lambda.h + sum_l c_l.f_l - sum_l (nu_l u_n,l + kappa_l.u_t,l),

because y = B^T f + h and u = A y. Kinetic friction may add power, so that nothing else bounds y:
c_l.f_l may be positive by rounding alone, and kappa is zero unless the contact sticks or slips.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graspless_pin.holding.bounds import States, allowed_normals, least_products, newton_gains
from graspless_pin.holding.branching import NEAR_OUTCOME, SearchResult, UnprovenSet, split_contact
from graspless_pin.holding.dynamics import Dynamics
from graspless_pin.holding.relaxation import (
    arc_rows,
    cone_planes,
    cone_tangents,
    plane_rows,
    unit_directions,
)
from graspless_pin.holding.unstable_motion import coulomb_gaps, polish
from graspless_pin.holding.verdict import ContactState, DualBound
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solvers.simplex import Simplex, SimplexAnswer
from graspless_pin.tree_search import TreeSearch

_DIRECTIONS = 8
"""Directions of the tangent planes of each cone."""
_BOX = 1e3
"""Largest normal force of the best points, scaled; no proof depends on it."""
_MOST_CUTS = 6
"""Rounds of tangent cuts."""
_WHOLE = 1.0 - 1e-9
"""A share of the load from here on counts as the whole load."""


class OutcomePrograms:
    """Linear programs in forces and the share t of the load: y = B^T f + t h, u = A y.

    Rows: u_n >= 0 or = 0, u_t = 0 where a contact sticks, commanded forces, tangent planes of the
    cones, and for a slip in an arc its edges, for slip and force.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        """Add the rows that all sets of outcomes share."""
        self._dynamics = dynamics
        count, self._size = dynamics.contact_count, 3 * dynamics.contact_count + 1
        self._pushes = np.vstack([dynamics.pushes.reshape(self._size - 1, -1), dynamics.load])
        self._slips = dynamics.rows @ self._pushes.T
        free = np.full(self._size, np.inf)
        self._simplex = Simplex(np.zeros(self._size), -free, free)
        across = self._slips[:, 1:].reshape(2 * count, -1)
        self._simplex.add_rows(np.vstack([self._slips[:, 0], across]), -free[:-1], free[:-1])
        commanded = np.flatnonzero(dynamics.is_commanded)
        given = np.zeros((len(commanded), self._size))
        given[np.arange(len(commanded)), 3 * commanded] = 1.0
        given[:, -1] = -dynamics.commanded[commanded]
        self._simplex.add_rows(given, np.zeros(len(commanded)), np.zeros(len(commanded)))
        planes = [
            cone_planes(friction, unit_directions(_DIRECTIONS)) for friction in dynamics.friction
        ]
        self._add_planes(np.repeat(np.arange(count), _DIRECTIONS), np.vstack(planes))
        self._shared = self._simplex.row_count
        self._edges: list[tuple[int, FloatArray]] = []

    @property
    def programs(self) -> int:
        """Linear programs solved."""
        return self._simplex.solves

    def set_states(self, states: States) -> None:
        """Set bounds and rows to the outcomes in these states, with any share of the load."""
        self._simplex.drop_rows(self._shared, self._simplex.row_count)
        self._edges = []
        count, commanded = self._dynamics.contact_count, self._dynamics.is_commanded
        lb, ub = np.full(self._size, -np.inf), np.full(self._size, np.inf)
        low, high = lb[:-1].reshape(count, 3), ub[:-1].reshape(count, 3)
        low[:, 0], high[:, 0] = 0.0, np.where(commanded, np.inf, _BOX)
        opened = states.is_in(ContactState.OPEN)
        low[opened], high[opened] = 0.0, 0.0
        lb[-1], ub[-1] = 0.0, 1.0
        self._simplex.set_bounds(lb, ub)
        self._bounds = lb, ub
        may_part = states.is_in(ContactState.FREE, ContactState.OPEN) | commanded
        sticking = np.repeat(states.is_in(ContactState.STICKING), 2)
        self._simplex.set_sides(
            np.arange(3 * count, dtype=np.int32),
            np.concatenate([np.where(commanded, -np.inf, 0.0), np.where(sticking, 0.0, -np.inf)]),
            np.concatenate([np.where(may_part, np.inf, 0.0), np.where(sticking, 0.0, np.inf)]),
        )
        for contact in np.flatnonzero(states.is_in(ContactState.SLIPPING)):
            self._add_arc(int(contact), states.center[contact], states.half_width[contact])

    def require_whole_load(self) -> None:
        """Fix the share of the load to 1 if the last point has it: then the program is feasible."""
        lb, ub = self._bounds
        if self._load > _WHOLE:
            lb[-1] = 1.0
            self._simplex.set_bounds(lb, ub)

    def maximize(
        self, goal: FloatArray, states: States
    ) -> tuple[DualBound, FloatArray, FloatArray] | None:
        """Maximise p.y, or t where p is zero, cut by tangents of cones where contacts stick.

        Args:
            goal: p (n,).
            states: Those of `set_states`.

        Returns:
            Multipliers with lambda = 0 (see `completed_multipliers`), the best point's forces
            (M, 3) and its y (n,); None where the solver has no answer.
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

    def _add_planes(self, contacts: NDArray[np.intp], planes: FloatArray) -> None:
        """Add r.f <= 0 for rows r (k, 3) of contacts (k,)."""
        rows = plane_rows(contacts, planes, self._size)
        self._simplex.add_rows(rows, np.full(len(rows), -np.inf), np.zeros(len(rows)))

    def _add_arc(self, contact: int, center: float, half_width: float) -> None:
        """Add rows of a slip in an arc of less than pi: its edges, for slip and force."""
        edges, faces = arc_rows(center, half_width, self._dynamics.friction[contact])
        self._simplex.add_rows(edges @ self._slips[contact, 1:], np.zeros(2), np.full(2, np.inf))
        self._add_planes(np.full(3, contact), faces)
        # Rows on forces alone have no multiplier of their own.
        self._edges += [(contact, edge) for edge in (*edges, *np.zeros((3, 2)))]

    def _cut_cones(self, answer: SimplexAnswer, states: States) -> bool:
        """Add a tangent for each sticking force outside its cone; return whether any was added.

        It does so only where no contact is left to be split: before, splitting is more effective.
        """
        smooth = self._dynamics.friction == 0.0
        if (states.is_in(ContactState.FREE, ContactState.CLOSED) & ~smooth).any():
            return False
        forces = answer.x[:-1].reshape(-1, 3)
        sticking = states.is_in(ContactState.STICKING) & ~smooth
        outside, planes = cone_tangents(forces, self._dynamics.friction, sticking)
        self._add_planes(outside, planes)
        self._edges += [(0, np.zeros(2))] * len(outside)
        return len(outside) > 0


def point_goals(dynamics: Dynamics) -> FloatArray:
    """Return (2 P + 1, n) goals p: while p.y is at most 1 for each, all points count as at rest.

    The first one is zero: a negative bound on it proves that there is no outcome.
    The others are both signs of the accelerations of the reference point and of the angular ones
    times the longest lever, each in units of limit / (2 sqrt(3)); with other passive coordinates
    the units are limit / `Dynamics.limit_divisor`.
    """
    positive = dynamics.levers[:, None] * dynamics.acceleration[: len(dynamics.levers)]
    positive *= dynamics.limit_divisor / dynamics.limit
    return np.vstack([np.zeros(positive.shape[1]), positive, -positive])


def goal_bound(dynamics: Dynamics, states: States, dual: DualBound, force_limit: float) -> float:
    """Return an upper bound of p.y over all outcomes in these states.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        dual: The multipliers of `completed_multipliers`, whose lambda includes p.
        force_limit: The bound holds for outcomes with normal forces up to this, scaled.
    """
    rows, pushes, commanded = dynamics.rows, dynamics.pushes, dynamics.is_commanded
    high = np.where(commanded, dynamics.commanded, force_limit)
    high = np.where(states.is_in(ContactState.OPEN), 0.0, high)
    low = np.where(commanded, high, 0.0)
    gain = newton_gains(dynamics, states, pushes @ dual.motion)
    bound = float(dual.motion @ dynamics.load + (np.maximum(gain * low, gain * high)).sum())
    wrong = np.maximum(-least_products(dual.tangential, *states.arcs), 0.0)
    wrong = np.where(states.is_in(ContactState.STICKING), 0.0, wrong)
    sizes = np.linalg.norm(pushes, axis=2).sum(axis=1) * (1.0 + dynamics.friction)
    reach = float(np.linalg.norm(dynamics.load)) + float(high @ sizes)
    return bound + reach * float(wrong @ np.linalg.norm(rows[:, 1:], axis=(1, 2)))


def completed_multipliers(
    dynamics: Dynamics, states: States, dual: DualBound, goal: FloatArray
) -> DualBound:
    """Return multipliers restricted to valid values, with the lambda that follows from them."""
    normal = allowed_normals(dynamics, states, dual.normal)
    is_split = states.is_in(ContactState.STICKING, ContactState.SLIPPING)
    tangential = np.where(is_split[:, None], dual.tangential, 0.0)
    rows = dynamics.rows
    motion = goal + normal @ rows[:, 0] + np.einsum("li,lin->n", tangential, rows[:, 1:])
    return DualBound(motion, normal, tangential)


_EMPTY = -0.5
"""Where the goal zero has a smaller bound, there is no outcome: it is -1 but for rounding."""


def search_other_motion(
    dynamics: Dynamics, force_limit: float, is_over: Callable[[int], bool]
) -> SearchResult:
    """Prove that no outcome moves the object otherwise than declared, or find one.

    Args:
        dynamics: The scaled dynamics.
        force_limit: Proofs have to hold for normal forces up to this, scaled.
        is_over: Returns for a number of nodes whether the search has to end.
    """
    programs, goals = OutcomePrograms(dynamics), point_goals(dynamics)
    count = dynamics.contact_count
    root = UnprovenSet(-1, States.all_free(count), remaining=list(range(1, len(goals))))
    search, unproven, nodes = TreeSearch([root]), list[UnprovenSet](), 0
    for _, node in search:
        if is_over(nodes):
            unproven += [node, *search.open_nodes()]
            break
        nodes += 1
        point = _prove_goals(dynamics, programs, goals, node, force_limit)
        if point is None:
            continue
        y, forces = point
        contact, parts = split_contact(dynamics, np.zeros(count), node.states, y, forces)
        gaps = float(coulomb_gaps(dynamics, forces, dynamics.contact_motion(y)).sum())
        if not parts or gaps <= NEAR_OUTCOME * float(y @ y):
            motion = polish(dynamics, forces)
            if motion is not None:
                return SearchResult(None, motion, nodes, len(search), programs.programs)
        node.children = [
            UnprovenSet(contact, states, remaining=list(node.remaining)) for states in parts
        ]
        if not parts:
            unproven.append(node)
        search.add(reversed(node.children))
    tree = None if unproven else root.proof_node()
    resisting = unproven[0].states.state if unproven else ()
    return SearchResult(tree, None, nodes, len(unproven), programs.programs, resisting)


def _prove_goals(
    dynamics: Dynamics,
    programs: OutcomePrograms,
    goals: FloatArray,
    node: UnprovenSet,
    force_limit: float,
) -> tuple[FloatArray, FloatArray] | None:
    """Prove goals of a node in turn; return y and forces of the first that is not proven, or None.

    Where the solver has no answer, y and forces are zero.
    """
    states = node.states
    programs.set_states(states)
    for index in (0, *node.remaining):
        answer = programs.maximize(goals[index], states)
        if answer is None:
            return np.zeros(len(dynamics.load)), np.zeros((dynamics.contact_count, 3))
        dual, forces, y = answer
        dual = completed_multipliers(dynamics, states, dual, goals[index])
        bound = goal_bound(dynamics, states, dual, force_limit)
        if bound <= (1.0 if index else _EMPTY):
            node.sides.append((index, dual))
            if not index:
                return None
        elif index:
            node.remaining = node.remaining[node.remaining.index(index) :]
            return y, forces
        else:
            programs.require_whole_load()
    return None
