"""Ranges of the contact forces under given torques: the indeterminate forces, eq. (32).

Extreme values over all contact forces that given torques allow, by branch and bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.branch_and_bound import search_modes
from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.algorithms.options import SolveKeywords, SolveOptions
from graspless_pin.algorithms.search_state import SearchState
from graspless_pin.modes.rules import Rules, SlidingMode, StaticFriction
from graspless_pin.modes.sectors import Sector
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only
from graspless_pin.programs.analysis_objectives import (
    ForceBesideRay,
    ForceSet,
    FreeRays,
    HeldMargin,
)
from graspless_pin.programs.forces import component_row, force_rows
from graspless_pin.programs.program import FARTHEST
from graspless_pin.records import Brief
from graspless_pin.solution import FOUND, Status
from graspless_pin.solution.tables import Table, brief_figure, decimals, force_rounding, paragraph
from graspless_pin.solvers import Outcome, solve
from graspless_pin.tree_search import Limits, TreeSearch

_AT_REACH = 1.0 - 1e-6
"""Share of the largest normal force in the program: optima beyond it may be truncated."""
_LEAST_RAY_GROWTH = 1e-6
_RAY_NODE_LIMITS = (32, 128, 512, 2048, 8192, None)
"""Node limits of successive searches for a free ray: any ray will do."""
_CONE_SECTORS = 8
_SECTOR_GAP = 1e-6
"""Tolerance of the smallest distance from a round cone, over the load."""
_NARROWEST_SECTOR = 1e-4
_ROUNDING = 1e-9
"""Rounding error of a distance of zero, over the load."""
_ENDED_EARLY = (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT)


class Extreme(NamedTuple):
    """An extreme value over all modes, N, and whether it is proven; if not, one that is reached."""

    value: float
    proven: bool


class _Surface(NamedTuple):
    """A face of a cone, or a tangent plane of a round cone.

    Attributes:
        distance: (n,) coefficients; distance . x is the distance of forces x from the surface, N.
        contact: Contact of the round cone; -1: a flat face.
        sector: Directions of friction for which the plane bounds the round cone; None: a flat
            face.
    """

    distance: FloatArray
    contact: int = -1
    sector: Sector | None = None


class ForceExtremes:
    """The force set of given torques, and optima of linear functions over it.

    The methods assume that some mode balances the torques.

    Attributes:
        status: Whether some mode balances the torques.
        growing: Modes that were found to admit a force and a free ray.
        reached: Coordinates of forces that feasible modes admit.
        proven: Whether every search since this was last set was completed with a proof.
    """

    def __init__(
        self, problem: QuasistaticProblem, torques: FloatArray, options: SolveOptions
    ) -> None:
        """Look for a mode that balances the torques (L,), N m; the time of all searches begins."""
        self.limits, self.options = Limits.from_options(options), options
        self.problem, self.torques = problem, torques
        self.force_set = formulate(problem, ForceSet(torques))
        self.rays = formulate(problem, FreeRays())
        self.coordinates = self.force_set.coordinates
        self.rows = force_rows(problem, self.coordinates)
        self.has_rays = self._has_rays()
        self.growing: list[SlidingMode] = []
        self.reached: list[FloatArray] = []
        self.proven = True
        self.status, _ = self._search_modes(self.force_set)
        if self.status not in FOUND and self._normal_reach < FARTHEST:
            self.force_set = formulate(problem, ForceSet(torques, farthest=True))
            self.status, _ = self._search_modes(self.force_set)

    @property
    def _normal_reach(self) -> float:
        """The largest normal force that the program allows, over the load F."""
        return float(self.force_set.program.ub[self.coordinates.normal_columns].max())

    def component(self, contact: int, component: int) -> FloatArray:
        """Return the (n,) coefficients that give f_n, f_t1 or f_t2 of a contact, N."""
        row = component_row(self.problem, self.coordinates, contact, component)
        return self.coordinates.force_scale * row

    def largest(self, functional: FloatArray, *, above: float = -np.inf) -> Extreme:
        """Return the largest value of a linear function over all modes; inf along a free ray.

        Args:
            functional: (n,) coefficients of the function.
            above: Lower bound on the returned value: smaller values are of no interest.
        """
        scale = float(np.abs(functional).max())
        if scale == 0.0:
            return Extreme(0.0, proven=True)
        self.proven = not self.limits.is_time_over
        value = -np.inf
        if self.proven:
            c = -functional / scale
            if self.has_rays and self._has_growing_ray(c):
                return Extreme(np.inf, proven=True)
            _, state = self._search_modes(self.force_set.with_costs(c), cutoff=-above / scale)
            if state.best is not None:
                value = -scale * state.best.value
                normal = state.best.x[self.coordinates.normal_columns]
                self.proven = self.proven and bool((normal < _AT_REACH * self._normal_reach).all())
            elif above == -np.inf:
                # Some mode balances the torques: a search that finds no force proves nothing.
                self.proven = False
        if not self.proven:
            value = max(value, *(float(functional @ x) for x in self.reached))
        return Extreme(max(value, above), self.proven)

    def smallest_margin(
        self, lower: FloatArray, upper: FloatArray, proven: NDArray[np.bool_]
    ) -> Extreme:
        """Return the smallest margin: the least of linear distances to faces and round cones.

        Branch and bound over surfaces, from the least margin that was reached, with bounds over the
        box of proven ranges. Round cones are split into sectors, to 1e-6 of the load.
        """
        margin, complete = self.least_margin(), True
        low, high = np.zeros(self.rows.size), np.zeros(self.rows.size)
        cones = self.problem.has_cone
        sure = np.where(proven, lower, -np.inf), np.where(proven, upper, np.inf)
        for end, bounds in zip((low, high), sure, strict=True):
            end[self.coordinates.normal_columns] = bounds[:, 0]
            end[self.coordinates.tangent_columns[cones]] = bounds[cones, 1:]
        force = self.coordinates.force_scale
        gap, rounding = _SECTOR_GAP * force, _ROUNDING * force
        limits = self.problem.max_normal_force
        for at in np.flatnonzero(limits - sure[1][:, 0] < margin - rounding).tolist():
            most = self.largest(self.component(at, 0), above=float(limits[at]) - margin)
            margin, complete = float(limits[at]) - most.value, complete and most.proven

        def box_bound(surface: _Surface) -> float:
            distance = surface.distance
            at = np.where(distance > 0.0, low, np.where(distance < 0.0, high, 0.0))
            # Forces inside the cones keep a distance of zero at least.
            return max(float(distance @ at) / force, 0.0)

        search = TreeSearch[_Surface]()
        for surface in self._surfaces():
            search.add([surface], box_bound(surface))
        for least, surface in search:
            if least >= margin - (rounding if surface.sector is None else gap):
                break
            nearest = self.largest(-surface.distance, above=-margin)
            complete = complete and nearest.proven
            if surface.sector is None:
                margin = -nearest.value
                continue
            least = max(-nearest.value, least)
            margin = min([margin, *(self._margin(x) for x in self.reached[-1:])])
            if surface.sector.half < _NARROWEST_SECTOR:
                complete = complete and least >= margin - gap
                continue
            for half in surface.sector.halves:
                narrower = self._tangent_plane(surface.contact, half)
                search.add([narrower], max(box_bound(narrower), least))
        return Extreme(margin, complete)

    def largest_margin(self) -> Extreme:
        """Return the largest margin over all modes, normal-force limits included."""
        self.proven = not self.limits.is_time_over
        if self.proven:
            best = self._search_modes(formulate(self.problem, HeldMargin(self.torques)))[1].best
            if best is not None:
                self.reached.append(best.x[:-1])
                if self.proven:
                    return Extreme(-self.coordinates.force_scale * best.value, proven=True)
        return Extreme(max(self._margin(x) for x in self.reached), proven=False)

    def least_margin(self) -> float:
        """Return the smallest margin of the forces that were reached, N: of cones zero at least."""
        most = self.coordinates.force_scale * np.max(self.reached, axis=0)
        below = self.problem.max_normal_force - most[self.coordinates.normal_columns]
        return min(float(below.min()), max(min(map(self._margin, self.reached)), 0.0))

    def _surfaces(self) -> list[_Surface]:
        """Return all surfaces that bound the margin, except the normal-force limits."""
        rows, force = self.rows, self.coordinates.force_scale
        flat = list(force * rows.normal_rows[rows.without_cone])
        if not rows.cones.second_order:
            return [_Surface(one) for one in [*(-force * rows.cones.rows), *flat]]
        width = 2.0 * np.pi / _CONE_SECTORS
        sectors = [
            self._tangent_plane(contact, Sector(width * (index + 0.5), width / 2.0))
            for contact in self.coordinates.layout.cones.tolist()
            for index in range(_CONE_SECTORS)
        ]
        return [*(_Surface(one) for one in flat), *sectors]

    def _tangent_plane(self, contact: int, sector: Sector) -> _Surface:
        """Return the plane whose distance bounds that of the round cone from below in a sector.

        There |f_t| <= c^T f_t / cos(half the width) with c along the sector's middle.
        """
        angle, half = sector
        mu = float(self.problem.friction[contact])
        distance = np.zeros(self.rows.size)
        distance[self.coordinates.normal_columns[contact]] = mu
        distance[self.coordinates.tangent_columns[contact]] = -np.array(
            [np.cos(angle), np.sin(angle)]
        ) / np.cos(half)
        return _Surface(
            self.coordinates.force_scale / np.sqrt(1.0 + mu**2) * distance, contact, sector
        )

    def _margin(self, x: FloatArray) -> float:
        """Return the margin of one set of forces, N."""
        return self.problem.margin_of(self.coordinates.forces(x))

    def _has_growing_ray(self, c: FloatArray) -> bool:
        """Return whether some mode admits a force and a free ray along which -c . x grows."""
        alone = self.rays.with_costs(c)
        answer = solve(alone.program, self.options.solver)
        if answer.outcome is Outcome.SOLVED and answer.value > -_LEAST_RAY_GROWTH:
            return False
        if self.options.rules.static_friction is StaticFriction.COULOMB:
            self.proven = self.proven and answer.outcome is Outcome.SOLVED
            return self.proven
        if any(self._optimum_in_mode(alone, mode) < -_LEAST_RAY_GROWTH for mode in self.growing):
            return True
        # Three searches alternate with growing node limits. Rays alone prove soonest that there is
        # none; modes of rays mostly have forces, too, and modes of far forces rays; the pair of a
        # force and a ray decides.
        priced = self.force_set.with_costs(c)
        beside = ForceBesideRay(self.force_set.objective)
        pair = formulate(self.problem, beside, layers=(0, self.rows.size))
        pair = pair.with_costs(np.concatenate([np.zeros(len(c)), c]))
        for limit in _RAY_NODE_LIMITS:
            if self.limits.is_time_over:
                self.proven = False
                break
            ray, over = self._improving_mode(alone, limit)
            if ray is not None and self._optimum_in_mode(self.force_set, ray) < np.inf:
                return self._add_growing_mode(ray)
            if ray is None and over:
                return False
            force, _ = self._improving_mode(priced, limit)
            if force is not None and self._optimum_in_mode(alone, force) < -_LEAST_RAY_GROWTH:
                return self._add_growing_mode(force)
            both, over = self._improving_mode(pair, limit)
            if both is not None:
                return self._add_growing_mode(both)
            if over:
                break
        return False

    def _add_growing_mode(self, mode: SlidingMode) -> bool:
        self.growing.append(mode)
        return True

    def _improving_mode(
        self, formulation: Formulation, limit: int | None
    ) -> tuple[SlidingMode | None, bool]:
        """Return a mode of negative value within some nodes, and whether the search is complete."""
        _, state = self._search_modes(formulation, node_limit=limit)
        over = limit is None or state.nodes < limit
        return (None if state.best_value > -_LEAST_RAY_GROWTH else state.mode), over

    def _optimum_in_mode(self, formulation: Formulation, mode: SlidingMode) -> float:
        """Return the optimum of a program of one set of forces in one mode; inf: it has none."""
        answer = formulation.solve(*formulation.bounds_of(mode), self.options.solver, cutoff=np.inf)
        return answer.value if answer.outcome is Outcome.SOLVED else np.inf

    def _has_rays(self) -> bool:
        """Return whether the force set without modes may be unbounded."""
        pressing = self.rays.with_costs(-self.rows.normal_rows.sum(axis=0))
        answer = solve(pressing.program, self.options.solver)
        return answer.outcome is not Outcome.SOLVED or answer.value < -_LEAST_RAY_GROWTH

    def _search_modes(
        self, formulation: Formulation, *, cutoff: float = np.inf, node_limit: int | None = None
    ) -> tuple[Status, SearchState]:
        own = self.limits if node_limit is None else replace(self.limits, node_limit=node_limit)
        state = SearchState(replace(formulation, cutoff=cutoff), self.options, own)
        status = search_modes(state)
        ended = status in _ENDED_EARLY and (self.limits.is_time_over or node_limit is None)
        self.proven = self.proven and not (state.unproven or ended)
        # Only programs of the force set have the variables and rows of such forces.
        if state.best is not None and formulation.objective is self.force_set.objective:
            self.reached.append(state.best.x)
        return status, state


_DETERMINATE_RANGE = 1e-6
_HEADERS = ["#", "f_n [N]", "f_t1 [N]", "f_t2 [N]"]
_REACHED = " *"
_NO_FORCES = (
    "infeasible: no contact forces inside the cones balance the external wrench with these torques"
)
_NOTE = "* found; it is not proven that these torques allow no wider range"


@dataclass(frozen=True, eq=False, repr=False)
class ContactForceBounds(Brief):
    """The range of every contact force over all feasible virtual-sliding modes.

    See the example of `contact_force_bounds`.

    Attributes:
        status: OPTIMAL where all that was searched for is proven; LIMIT_REACHED where a limit ended
            the search or no solver answered some program; or why there is no range.
        lower: (M, 3) smallest f_n, f_t1, f_t2, N; -inf where a free ray exists; NaN: not searched.
        upper: (M, 3) largest f_n, f_t1, f_t2, N; inf where a free ray exists; NaN: not searched.
        proven: (M, 3) whether no feasible mode leads beyond either end. Elsewhere `lower` and
            `upper` were reached by forces that a feasible mode admits, and the range may be wider.
        smallest_margin: Smallest margin (N) that the torques can end up with; -inf where a
            normal force is unbounded. With LIMIT_REACHED the smallest one reached.
        largest_margin: Largest margin that they can end up with, N: the optimum's best case. With
            LIMIT_REACHED the largest one reached.
        torques: (L,) the motor torques that were given.
        problem: The problem.
        rules: The rules on static friction that the forces keep.
    """

    status: Status
    lower: FloatArray
    upper: FloatArray
    proven: NDArray[np.bool_]
    smallest_margin: float
    largest_margin: float
    torques: FloatArray
    problem: QuasistaticProblem
    rules: Rules

    @property
    def found(self) -> bool:
        """Whether some feasible mode balances the torques."""
        return self.status in FOUND

    @property
    def message(self) -> str:
        """The status in words: here forces have no limit, and no margin is required."""
        return _NO_FORCES if self.status is Status.INFEASIBLE_FORCES else self.status.message

    @property
    def indeterminate(self) -> NDArray[np.bool_]:
        """(M, 3) mask of components that the torques do not determine, by the known ranges."""
        return self.upper - self.lower > _DETERMINATE_RANGE * self.problem.scales.force

    @property
    def covers(self) -> str:
        """The set of forces that the ranges cover, in words."""
        if self.rules.static_friction is not StaticFriction.COULOMB:
            return "over all admissible contact forces"
        return f"over all forces of rest ({self.problem.cone_model.words(self.problem.cone_edges)})"

    def squeeze_words(self, bodies: Sequence[str] | None = None) -> str:
        """Return which bodies may press with unbounded force under the torques; empty: none.

        Args:
            bodies: (M,) names of the bodies in contact; None: contacts are named by number.
        """
        free = np.flatnonzero(np.isinf(self.upper[:, 0])).tolist() if self.found else []
        if not free:
            return ""
        rows = self.problem.jacobian.reshape(len(self.upper), 3 * self.problem.joint_count)
        who = "contacts" if rows[free].any() else "the supports"
        if bodies is not None:
            who = " and ".join(dict.fromkeys(bodies[contact] for contact in free))
        *first, last = map(str, free)
        listed = f"{', '.join(first)} and {last}" if first else last
        noun = "contact" if len(free) == 1 else "contacts"
        return f"{who} may squeeze the object with unbounded force: {noun} {listed}"

    def __str__(self) -> str:
        """Return a readable table."""
        if not self.found:
            return f"not found: {self.message}"
        return f"{Table(self._table_rows(), _HEADERS)}\n\n{self._margins_text()}"

    def _repr_html_(self) -> str:
        """Return the table as HTML, for notebooks."""
        if not self.found:
            return paragraph(str(self))
        return Table(self._table_rows(), _HEADERS, self._margins_text()).html()

    def _table_rows(self) -> list[list[object]]:
        return [
            [contact, *(self._range_text(contact, component, rounding) for component in range(3))]
            for contact, rounding in enumerate(force_rounding(self.problem))
        ]

    def _range_text(self, contact: int, component: int, rounding: float) -> str:
        at, load = (contact, component), self.problem.scales.force
        if np.isnan(self.lower[at]):
            return "not searched"
        ends = (decimals(float(end[at]), load, "+", rounding) for end in (self.lower, self.upper))
        return " .. ".join(ends) + ("" if self.proven[at] else _REACHED)

    def _margins_text(self) -> str:
        words = f"{self._margin_range_text()}, {self.covers}"
        return "\n".join(filter(None, [words, self.squeeze_words()]))

    def _margin_range_text(self) -> str:
        ends, load = (self.smallest_margin, self.largest_margin), self.problem.scales.force
        least, most = (brief_figure(end, load) for end in ends)
        if self.status is Status.OPTIMAL:
            return f"margin between {least} and {most} N with these torques"
        words = f"margin from {least} N or less to {most} N or more with these torques"
        return words if self.proven.all() else f"{_NOTE}\n{words}"


def contact_force_bounds(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    *,
    ranges: bool = True,
    **options: Unpack[SolveKeywords],
) -> ContactForceBounds:
    """Bound the contact forces that may result from given motor torques, eq. (32).

    Every component is minimised and maximised over all feasible modes by branch and bound. The
    force set (32) has no normal-force limit: a component is infinite where a direction exists that
    keeps balance, torques, cones and one feasible mode (a free ray, found and not presumed).

    With ``static_friction="coulomb"`` there is no virtual-sliding rule, and with round cones
    (``problem.with_changes(cone="round")``) the ranges are over all outcomes of rest.

    Args:
        problem: Contacts, wrench and joints.
        torques: (L,) motor torques J^T f + g, N m; for example `TorqueSolution.torques`. Those of
            joints that move no contact bear no force and do not count.
        ranges: Whether to search for all ranges. If not, only those are searched for that prove
            the smallest margin, in less time; others are NaN, and the status is of the margins.
        options: See `SolveOptions.parse`. A limit returns what was reached, with LIMIT_REACHED, or
            NOT_FOUND_IN_LIMIT if no mode that balances the torques was found before.

    Raises:
        ArgumentError: If the torques have the wrong shape, an option is not known, the time limit
            is negative, the sign rule is ``direction`` or ``stability="strong"``.

    Examples:
        >>> from graspless_pin import load_scene, contact_force_bounds, minimize_torque
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> torques = minimize_torque(problem, margin=0.1).torques
        >>> bounds = contact_force_bounds(problem, torques)
        >>> print(f"margins up to {bounds.largest_margin:.1f} N")
        margins up to 0.1 N
    """
    how = SolveOptions.parse(**options).need_weak(
        "contact_force_bounds is for given torques", "leave it out, and call `stability` with them"
    )
    how.rules.need_signs("contact_force_bounds")
    checked_problem(problem)
    given = finite_array("torques", torques, (problem.joint_count,))
    search = ForceExtremes(problem, given, how)
    status, shape = search.status, (problem.contact_count, 3)
    lower, upper, margins = np.full(shape, np.nan), np.full(shape, np.nan), (np.nan, np.nan)
    proven = np.zeros(shape, dtype=bool)
    if status in FOUND:
        # First, as its optimum counts as reached in the searches below.
        largest = search.largest_margin()
        for at in np.ndindex(shape):
            # No forces inside cones have less than zero, and limits need no ranges.
            if not ranges and search.least_margin() <= _ROUNDING * problem.scales.force:
                break
            direction = search.component(*at)
            least, most = search.largest(-direction), search.largest(direction)
            lower[at], upper[at] = -least.value, most.value
            proven[at] = least.proven and most.proven
        smallest = search.smallest_margin(lower, upper, proven)
        margins = smallest.value, largest.value
        complete = (proven.all() or not ranges) and smallest.proven and largest.proven
        status = Status.OPTIMAL if complete else Status.LIMIT_REACHED
    return ContactForceBounds(
        status, read_only(lower), read_only(upper), read_only(proven), *margins, given, problem,
        how.rules,
    )  # fmt: skip
