"""The linear relaxation of all outcomes with contacts in given states.

Its rows are planes around friction cones, and around the forces and slips of an arc.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graspless_pin.holding.bounds import OutcomeBounds, States, kinematic_dual, repaired_multipliers
from graspless_pin.holding.dynamics import Dynamics, leak_powers, without_free_joints
from graspless_pin.holding.verdict import ContactState, DualBound, LoadProof
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solvers.simplex import Simplex, SimplexAnswer

_INSIDE = 1e-8
"""Share of the friction by which tangents lie inside the cones: points on them are outcomes."""


def unit_directions(count: int) -> FloatArray:
    """Return ``count`` unit vectors (count, 2), evenly spaced."""
    angles = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angles), np.sin(angles)])


def cone_planes(friction: FloatArray | float, directions: FloatArray) -> FloatArray:
    """Return rows (k, 3) r with r.f <= 0, which is d.f_t <= mu f_n, for directions d (k, 2)."""
    return np.column_stack([np.broadcast_to(-np.asarray(friction), len(directions)), directions])


def cone_tangents(
    forces: FloatArray, friction: FloatArray, among: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the tangent planes of cones nearest to forces outside them.

    Args:
        forces: (M, 3) in contact frames.
        friction: (M,) coefficients.
        among: (M,) contacts whose forces are considered.

    Returns:
        The k contacts, and rows (k, 3) as of `cone_planes`.
    """
    sides, most = np.hypot(forces[:, 1], forces[:, 2]), friction * np.maximum(forces[:, 0], 0.0)
    outside = np.flatnonzero(among & (sides > most + 0.1 * _INSIDE * sides))
    toward = forces[outside, 1:] / sides[outside, None]
    return outside, cone_planes((1.0 - _INSIDE) * friction[outside], toward)


def plane_rows(
    contacts: NDArray[np.intp], planes: FloatArray, size: int, first: int = 0
) -> FloatArray:
    """Return planes (k, 3) of forces as rows (k, size) of a program.

    Args:
        contacts: The k contacts.
        planes: (k, 3) coefficients along n, t1, t2.
        size: Number of variables of the program.
        first: Index of the first variable that is a force.
    """
    rows = np.zeros((len(contacts), size))
    np.put_along_axis(rows, first + 3 * contacts[:, None] + np.arange(3), planes, axis=1)
    return rows


def arc_rows(center: float, half_width: float, friction: float) -> tuple[FloatArray, FloatArray]:
    """Return rows for the slip and the force of a contact whose slip is in an arc of at most pi.

    Args:
        center: Angle of the arc's middle, rad.
        half_width: At most pi / 2, rad.
        friction: Coefficient.

    Returns:
        Rows (2, 2) e with e.u_t >= 0, and rows (3, 3) r with r.f <= 0: the force is opposite.
    """
    low, high = center - half_width, center + half_width
    edges = np.array([[-np.sin(low), np.cos(low)], [np.sin(high), -np.cos(high)]])
    faces = np.zeros((3, 3))
    faces[:2, 1:] = edges
    faces[2] = friction * np.cos(half_width), np.cos(center), np.sin(center)
    return edges, faces


_DIRECTIONS = 8
"""Directions of the tangent planes of each cone, and of the bounds of slip."""
_MOST_CUTS = 6
"""Rounds of tangent cuts."""
_MOST_KEPT = 70
"""Tangents that later programs keep."""
_HOPELESS = 1e-3
"""Goal at the best point above which contacts are split instead of adding tangents."""
_STILL = 1e-9
"""Power over |y|^2 below which the tangent is taken at the nearest point of the ball."""
_SAME_MOTION = 1e-12
"""Scaled accelerations that differ by no more are the same."""
_WORTH_MORE, _LEAST = 1.05, 1e-6
"""Factor on the known normal force, and scaled force added, that a proof has to exceed."""
_ROUNDING = 1e-13
"""Relative to the largest multiplier: smaller ones are set to zero."""
_ROUNDED = 5e-7
"""Scaled force that is subtracted from proven ones: rounding errors at a million loads."""
_PENALTY = 2.0
"""Cost of the share of the load that is taken away; any is valid, as outcomes take none away."""
FORCE_LIMIT = 1e6
"""Proofs hold for normal forces up to this, in loads."""


@dataclass(frozen=True, eq=False)
class RelaxationPoint:
    """The best point of a relaxation, and the bound that its multipliers prove.

    Attributes:
        value: The goal there, less the penalty for the load taken away.
        bound: An upper bound of the goal over all outcomes in these states.
        dual: The multipliers that prove it.
        y: (n,) the motion of the best point.
        forces: (M, 3) its contact forces, scaled.
        load_left: Share of the load that the best point keeps.
    """

    value: float
    bound: float
    dual: DualBound
    y: FloatArray
    forces: FloatArray
    load_left: float


class _SharedRecords:
    """Data shared by relaxations of the same bodies: a count of linear programs, and dynamics."""

    def __init__(self) -> None:
        """Start empty."""
        self.count = 0
        self.dynamics: dict[bytes, Dynamics] = {}
        """Results of `without_free_joints`, by the mask of open contacts."""


class Relaxation:
    """Linear programs in (y, f, slip bounds, share s of the load taken away), reused for all nodes.

    With a spread of loads, theta is a variable, too. Rows: the dynamics y - A^T f - theta spread +
    s h = h, u_n >= 0 or = 0, tangent planes of the cones, the friction's power
    sum mu l |u_t| <= h.y, and those of the states of contacts.
    """

    def __init__(self, dynamics: Dynamics, loads: FloatArray, force_limit: float) -> None:
        """Add the rows that all nodes share.

        Args:
            dynamics: The scaled dynamics.
            loads: (M,) smallest normal forces l of all outcomes, scaled.
            force_limit: Proofs hold for normal forces up to this, scaled.
        """
        self.dynamics, self.loads, self.force_limit = dynamics, loads, force_limit
        self.bounds = OutcomeBounds(dynamics, loads, force_limit)
        count, n = dynamics.contact_count, len(dynamics.load)
        commanded = dynamics.is_commanded
        least = dynamics.commanded + np.minimum(dynamics.commanded_change, 0.0)
        self._power = dynamics.friction * np.where(commanded, least, loads)
        self._loaded = np.flatnonzero(self._power > 0.0)
        self._y_count, self._contact_count = n, count
        self._slip = n + 3 * count
        self._spread = self._slip + len(self._loaded)
        self._size = self._spread + int(dynamics.load_change.any()) + 1
        self._directions = unit_directions(_DIRECTIONS)
        free = np.full(self._size, np.inf)
        self._simplex = Simplex(np.zeros(self._size), -free, free)
        self._add_shared_rows()
        self._shared = self._simplex.row_count
        self._first = self._shared
        self._row_directions: list[tuple[int, FloatArray]] = []
        self._shared_records = _SharedRecords()

    @property
    def programs(self) -> int:
        """Linear programs solved by this relaxation and all that are derived from the same one."""
        return self._shared_records.count

    def _add_shared_rows(self) -> None:
        n, count, own = self._y_count, self._contact_count, self.dynamics
        rows, h, contacts = own.rows, own.load, np.arange(self._contact_count)
        dynamics = self._motion_rows(n, y=np.eye(n), spread=-own.load_change, taken=h)
        dynamics[:, n : self._slip] = -rows.reshape(3 * count, n).T
        self._simplex.add_rows(dynamics, h, h)
        # Where load is taken away, so is the motion of joints by themselves that parts contacts.
        moved = rows[:, 0] @ own.free_motion
        self._moved = np.where(np.abs(moved) > _SAME_MOTION, moved, 0.0)
        normal = self._motion_rows(count, y=rows[:, 0], taken=-self._moved)
        self._simplex.add_rows(normal, np.zeros(count), np.full(count, np.inf))
        self._add_power(h, 0.0)
        for column, contact in enumerate(self._loaded):
            bounds = self._motion_rows(_DIRECTIONS, y=-self._directions @ rows[contact, 1:])
            bounds[:, self._slip + column] = 1.0
            self._simplex.add_rows(bounds, np.zeros(_DIRECTIONS), np.full(_DIRECTIONS, np.inf))
        # Where load is taken away, so are the smallest normal forces, and commanded ones.
        least = self._motion_rows(count, spread=-own.commanded_change, taken=self.loads)
        least[contacts, n + 3 * contacts] = 1.0
        self._simplex.add_rows(least, self.loads, np.where(own.is_commanded, self.loads, np.inf))
        planes = [cone_planes(friction, self._directions) for friction in own.friction]
        self._add_planes(np.repeat(contacts, _DIRECTIONS), np.vstack(planes))

    def _motion_rows(
        self,
        count: int,
        *,
        y: FloatArray | float = 0.0,
        spread: FloatArray | None = None,
        taken: FloatArray | float = 0.0,
    ) -> FloatArray:
        """Return rows (count, size) with coefficients of y, of theta and of the share s."""
        rows = np.zeros((count, self._size))
        rows[:, : self._y_count], rows[:, -1] = y, taken
        if spread is not None:
            rows[:, self._spread : -1] = spread[:, None]
        return rows

    def _add_planes(self, contacts: NDArray[np.intp], planes: FloatArray) -> None:
        """Add r.f <= 0 for rows r (k, 3) of contacts (k,)."""
        rows = plane_rows(contacts, planes, self._size, self._y_count)
        self._simplex.add_rows(rows, np.full(len(rows), -np.inf), np.zeros(len(rows)))

    def _add_power(self, y: FloatArray, least: float) -> None:
        """Add the row y.Y - sum mu l |u_t| >= least, Y being the variable."""
        row = self._motion_rows(1, y=y)
        row[0, self._slip : self._spread] = -self._power[self._loaded]
        self._simplex.add_rows(row, np.full(1, least), np.full(1, np.inf))

    def solve(self, states: States, goal: tuple[FloatArray, FloatArray]) -> RelaxationPoint | None:
        """Maximise p.y + q.f over the relaxation, with tangents of ball and cones as cuts.

        A share of the load may be taken away, so that the program is always feasible.

        Args:
            states: Of the contacts.
            goal: p (n,) and q (M, 3).

        Returns:
            The last point and the smallest bound; None where the solver has no answer.
        """
        self._set_states(states, elastic=True)
        best: RelaxationPoint | None = None
        enough = self.proof_threshold(states)
        splits = states.undecided.any()
        for answer in self._cut_optima(goal):
            relaxed = self._read_answer(answer, states, goal, enough)
            if best is not None and best.bound <= relaxed.bound:
                relaxed = replace(relaxed, bound=best.bound, dual=best.dual)
            best = relaxed
            is_cut = self._add_cuts(answer.x, states, elastic=True)
            if not is_cut or best.bound <= enough or (splits and best.value > _HOPELESS):
                break
        return best

    def larger_loads(self, states: States) -> list[LoadProof]:
        """Return proofs that raise the smallest normal forces of all outcomes in these states.

        Args:
            states: Of the contacts.
        """
        proofs = list[LoadProof]()
        candidates = ~self.dynamics.is_commanded & ~states.is_in(ContactState.OPEN)
        worth = _WORTH_MORE * self.loads + _LEAST
        self._set_states(states, elastic=False)
        for contact in np.flatnonzero(candidates).tolist():
            if not candidates[contact]:
                continue
            goal = np.zeros(self._y_count), np.zeros((self._contact_count, 3))
            goal[1][contact, 0] = -1.0
            best: RelaxationPoint | None = None
            for answer in self._cut_optima(goal):
                normal = answer.x[self._y_count : self._slip : 3]
                is_cut = self._add_cuts(answer.x, states, elastic=False)
                if normal[contact] > worth[contact]:
                    relaxed = self._read_answer(answer, states, goal, -np.inf)
                    best = relaxed if best is None or relaxed.bound < best.bound else best
                if not is_cut:
                    # No more can be proven of any contact than its force at this point.
                    candidates &= normal > worth
                    break
            if best is not None and -best.bound > worth[contact]:
                force = (-best.bound - _ROUNDED) * self.dynamics.force_unit
                proofs.append(LoadProof(contact, float(force), best.dual))
        return proofs

    def _cut_optima(self, goal: tuple[FloatArray, FloatArray]) -> Iterator[SimplexAnswer]:
        """Yield optima of p.y + q.f while there are any; the caller adds cuts in between."""
        cost = np.zeros(self._size)
        cost[: self._y_count], cost[self._y_count : self._slip] = -goal[0], -goal[1].ravel()
        cost[-1] = _PENALTY
        self._simplex.set_cost(cost)
        for _ in range(_MOST_CUTS):
            answer = self._simplex.solve()
            self._shared_records.count += 1
            if not answer.is_optimal:
                return
            yield answer

    def _add_cuts(self, x: FloatArray, states: States, *, elastic: bool) -> bool:
        """Add tangents that cut off a point outside the ball or cones; return whether any were."""
        return self._cut_ball(x, elastic) | self._cut_cones(x, states)

    def with_loads(self, proofs: Iterable[LoadProof]) -> Relaxation:
        """Return the relaxation with the smallest normal forces of some proofs."""
        loads = self.loads.copy()
        for proof in proofs:
            loads[proof.contact] = proof.force / self.dynamics.force_unit
        return self._with_dynamics(self.dynamics, loads)

    def without_free_joints(self, opened: NDArray[np.bool_]) -> Relaxation:
        """Return the relaxation of `dynamics.without_free_joints` for a mask of open contacts."""
        key, cache = opened.tobytes(), self._shared_records.dynamics
        if key not in cache:
            cache[key] = without_free_joints(self.dynamics, opened, self.force_limit)
        dynamics = cache[key]
        if np.abs(dynamics.free_motion - self.dynamics.free_motion).max() <= _SAME_MOTION:
            return self
        return self._with_dynamics(dynamics, self.loads)

    def proof_threshold(self, states: States) -> float:
        """Return the power h.y up to which y counts as rest, less that of contacts along aside."""
        leaked = leak_powers(self.dynamics, self.dynamics.free_motion)[
            ~states.is_in(ContactState.OPEN)
        ]
        return self.dynamics.resolution**2 - self.force_limit * float(leaked.sum())

    def _with_dynamics(self, dynamics: Dynamics, loads: FloatArray) -> Relaxation:
        relaxation = Relaxation(dynamics, loads, self.force_limit)
        relaxation._shared_records = self._shared_records
        relaxation.bounds = self.bounds.for_dynamics(dynamics, loads)
        return relaxation

    def _drop_state_rows(self) -> None:
        """Remove the rows of the last states, and tangents (valid in all states) if too many."""
        self._simplex.drop_rows(self._first, self._first + len(self._row_directions))
        self._row_directions = []
        too_many = self._simplex.row_count - self._shared - _MOST_KEPT
        if too_many > 0:
            self._simplex.drop_rows(self._shared, self._shared + too_many)
        self._first = self._simplex.row_count

    def _set_states(self, states: States, *, elastic: bool) -> None:
        """Replace bounds and rows of the last states by those of the given ones.

        Args:
            states: Of the contacts.
            elastic: Whether a share of the load may be taken away.
        """
        self._drop_state_rows()
        n, count = self._y_count, self._contact_count
        h, commanded = self.dynamics.load, self.dynamics.is_commanded
        lb, ub = np.full(self._size, -np.inf), np.full(self._size, np.inf)
        radius = 0.5 * float(np.linalg.norm(h))
        lb[:n], ub[:n] = 0.5 * h - radius, 0.5 * h + radius
        opened = states.is_in(ContactState.OPEN)
        low, high = lb[n : self._slip].reshape(count, 3), ub[n : self._slip].reshape(count, 3)
        low[:, 0] = 0.0
        most = self.dynamics.commanded + np.maximum(self.dynamics.commanded_change, 0.0)
        high[commanded, 0] = most[commanded]
        low[opened], high[opened] = 0.0, 0.0
        lb[self._slip :] = 0.0
        ub[self._spread : -1] = 1.0
        ub[-1] = 1.0 if elastic else 0.0
        self._simplex.set_bounds(lb, ub)
        may_part = states.is_in(ContactState.FREE, ContactState.OPEN) | commanded
        self._simplex.set_sides(
            np.arange(n, n + count, dtype=np.int32),
            np.where(commanded | states.closes, -np.inf, -self._moved),
            np.where(may_part | states.closes, np.inf, 0.0),
        )
        self._add_slip_rows(states)

    def _add_slip_rows(self, states: States) -> None:
        """Add the rows of sticking, and those of slips in arcs of at most pi: see `arc_rows`."""
        sticking = np.flatnonzero(states.does_not_slip & ~states.sticks)
        slipping = np.flatnonzero(~states.does_not_slip & (states.half_width < np.pi))
        count, row = 2 * len(sticking) + 5 * len(slipping), 2 * len(sticking)
        rows, low, high = np.zeros((count, self._size)), np.zeros(count), np.zeros(count)
        own = self.dynamics.rows[:, 1:]
        rows[:row, : self._y_count] = own[sticking].reshape(row, self._y_count)
        self._row_directions = [
            (contact, along) for contact in sticking.tolist() for along in np.eye(2)
        ]
        for contact in slipping.tolist():
            center, half_width = states.center[contact], states.half_width[contact]
            edges, faces = arc_rows(center, half_width, self.dynamics.friction[contact])
            first = self._y_count + 3 * contact
            rows[row : row + 2, : self._y_count] = edges @ own[contact]
            rows[row + 2 : row + 5, first : first + 3] = faces
            high[row : row + 2], low[row + 2 : row + 5] = np.inf, -np.inf
            # Rows of forces have no coefficients of y.
            self._row_directions += [(contact, along) for along in (*edges, *np.zeros((3, 2)))]
            row += 5
        self._simplex.add_rows(rows, low, high)

    def _cut_ball(self, x: FloatArray, toward_rest: bool) -> bool:
        """Add a tangent of the ball |y|^2 <= h.y for a point outside; return whether one was added.

        Args:
            x: The point.
            toward_rest: Whether the tangent is where the line from the point to rest meets the
                ball, which suits the power h.y best, or at the nearest point of the ball.
        """
        h, y = self.dynamics.load, x[: self._y_count]
        power, square = float(h @ y), float(y @ y)
        if square <= power * (1.0 + 1e-9):
            return False
        if toward_rest and power > _STILL * square:
            touching = power / square * y
        else:
            away = y - 0.5 * h
            touching = 0.5 * h + 0.5 * np.linalg.norm(h) / np.linalg.norm(away) * away
        self._add_power(h - 2.0 * touching, -float(touching @ touching))
        return True

    def _cut_cones(self, x: FloatArray, states: States) -> bool:
        """Add a tangent for each sticking force outside its cone; return whether any was added.

        It does so only where no contact is left to be split: before, splitting is more effective.
        """
        if states.undecided.any():
            return False
        forces = x[self._y_count : self._slip].reshape(self._contact_count, 3)
        outside, planes = cone_tangents(forces, self.dynamics.friction, states.does_not_slip)
        self._add_planes(outside, planes)
        return len(outside) > 0

    def _read_answer(
        self,
        answer: SimplexAnswer,
        states: States,
        goal: tuple[FloatArray, FloatArray],
        enough: float,
    ) -> RelaxationPoint:
        """Return the best point, and the first multipliers whose bound is enough, or the best."""
        n, count = self._y_count, self._contact_count
        # Multipliers at rounding level would count at a force limit of a million loads.
        sizes = np.abs(answer.rows)
        marginals = np.where(sizes > _ROUNDING * sizes.max(), answer.rows, 0.0)
        tangential = np.zeros((count, 2))
        first = n + count + 1
        for column, contact in enumerate(self._loaded):
            own = marginals[first + column * _DIRECTIONS : first + (column + 1) * _DIRECTIONS]
            tangential[contact] -= own @ self._directions
        for row, (contact, direction) in enumerate(self._row_directions):
            tangential[contact] += marginals[self._first + row] * direction
        y, forces = answer.x[:n], answer.x[n : self._slip].reshape(count, 3)
        value = float(goal[0] @ y + (goal[1] * forces).sum() - _PENALTY * answer.x[-1])
        raw = DualBound(-marginals[:n], marginals[n : n + count].copy(), tangential)
        dual, bound = raw, np.inf
        for tried in self._multiplier_candidates(states, raw, goal):
            proven = self.bounds.bound(states, tried, goal)
            if proven < bound:
                dual, bound = tried, proven
            if bound <= enough or value > _HOPELESS:
                break
        return RelaxationPoint(value, bound, dual, y, forces, 1.0 - float(answer.x[-1]))

    def _multiplier_candidates(
        self, states: States, raw: DualBound, goal: tuple[FloatArray, FloatArray]
    ) -> Iterator[DualBound]:
        """Yield the solver's multipliers, then others that may prove more in spite of rounding."""
        yield raw
        yield repaired_multipliers(self.dynamics, states, raw, goal)
        if goal[0].any():
            yield kinematic_dual(self.dynamics, states, goal[0], np.zeros(self._contact_count))
