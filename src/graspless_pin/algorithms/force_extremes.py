"""Extreme values over all contact forces that given torques allow, by branch and bound."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.formulation import Formulation, formulated
from graspless_pin.algorithms.options import Limits, SolveOptions
from graspless_pin.algorithms.search import SearchResult, SearchState
from graspless_pin.algorithms.searching import search_modes
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.modes.sectors import Sector
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.analysis_objectives import (
    ForceBesideRay,
    ForceSet,
    FreeRays,
    HeldMargin,
)
from graspless_pin.programs.forces import force_rows
from graspless_pin.programs.program import FARTHEST
from graspless_pin.solution import Status
from graspless_pin.solvers import Outcome, solve
from graspless_pin.tree_search import TreeSearch

_FARTHEST = 1e3
"""Bounded forces are looked for up to this multiple of the largest normal-force limit."""
_IS_RAY = 1e-6
_NODES = (32, 128, 512, 2048, 8192, None)
"""Limits of the searches for a free ray, one after the other: any ray will do."""
_SECTORS = 8
_SECTOR_GAP = 1e-6
"""How near the smallest distance from a round cone is found, over the load."""
_NARROWEST = 1e-4
_ENDED_EARLY = (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT)


class Extreme(NamedTuple):
    """An extreme value over all modes (N), or one that was reached, and whether it is proven."""

    value: float
    proven: bool


class _Surface(NamedTuple):
    """A plane: (n,) distance (N) of the coordinates from it; the friction that it stands for."""

    distance: FloatArray
    contact: int = -1
    sector: Sector | None = None


class ForceExtremes:
    """The force set of given torques, and optima of linear functions over it.

    Call `feasibility` first: the other methods are of torques that some mode holds.

    Attributes:
        growing: Modes that were seen to hold a force and a free ray.
        reached: Coordinates of forces that a feasible mode holds.
        proven: Whether every search since this was last set came to its proof.
    """

    def __init__(
        self,
        problem: QuasistaticProblem,
        torques: FloatArray,
        options: SolveOptions,
    ) -> None:
        """Take the torques (L,), N m, and how to search; the time of all searches begins."""
        self.limits, self.options = Limits.of(options), options
        self.problem, self.rules, self.solver = problem, options.rules, options.solver
        self.torques = torques
        limit = float(problem.max_normal_force.max()) / problem.scales.force
        self.set = formulated(problem, ForceSet(torques, min(_FARTHEST * limit, FARTHEST)))
        self.rays = formulated(problem, FreeRays())
        self.coordinates = self.set.coordinates
        self.rows = force_rows(problem, self.coordinates)
        self.has_rays = self._has_rays()
        self.growing: list[SlidingMode] = []
        self.reached: list[FloatArray] = []
        self.proven = True

    @property
    def time_is_over(self) -> bool:
        """Whether the time limit has passed."""
        return self.limits.passed

    def feasibility(self) -> Status:
        """Whether some mode holds the torques."""
        return self._search(self.set).status

    def component(self, contact: int, component: int) -> FloatArray:
        """(n,) functional of the coordinates that gives f_n, f_t1 or f_t2 of a contact, in N."""
        frame = np.column_stack([self.problem.normals[contact], self.problem.tangents[contact]])
        block = self.coordinates.basis[3 * contact : 3 * contact + 3]
        return self.coordinates.force_scale * (frame[:, component] @ block)

    def largest(self, functional: FloatArray, *, above: float = -np.inf) -> Extreme:
        """Largest value of a linear function over all modes; inf along a free ray.

        Args:
            functional: (n,) its coefficients.
            above: Smaller values are of no interest; then this is returned.
        """
        scale = float(np.abs(functional).max())
        if scale == 0.0:
            return Extreme(0.0, proven=True)
        self.proven = not self.time_is_over
        value = -np.inf
        if self.proven:
            c = -functional / scale
            if self.has_rays and self._grows(c):
                return Extreme(np.inf, proven=True)
            result = self._search(_with_costs(self.set, c), cutoff=-above / scale)
            if result.state.best is not None:
                value = -scale * result.state.best.value
            elif above == -np.inf:
                # The torques are held: a search that finds no force has nothing to say.
                self.proven = False
        if not self.proven:
            value = max(value, *(float(functional @ x) for x in self.reached))
        return Extreme(max(value, above), self.proven)

    def smallest_margin(
        self, lower: FloatArray, upper: FloatArray, proven: NDArray[np.bool_]
    ) -> Extreme:
        """Smallest distance to any face or round cone: the margin is the least of linear functions.

        Those that the bounds of the components keep farther away than the nearest so far need no
        search. Round cones are looked at sector by sector, to 1e-6 of the load.
        """
        margin, complete = float((self.problem.max_normal_force - upper[:, 0]).min()), True
        low, high = np.zeros(self.rows.size), np.zeros(self.rows.size)
        cones = self.problem.has_cone
        sure = np.where(proven, lower, -np.inf), np.where(proven, upper, np.inf)
        for end, bounds in zip((low, high), sure, strict=True):
            end[self.coordinates.normal] = bounds[:, 0]
            end[self.coordinates.tangent[cones]] = bounds[cones, 1:]
        force = self.coordinates.force_scale
        gap = _SECTOR_GAP * force

        def bound(surface: _Surface) -> float:
            distance = surface.distance
            at = np.where(distance > 0.0, low, np.where(distance < 0.0, high, 0.0))
            return float(distance @ at) / force

        search = TreeSearch[_Surface]()
        for surface in self._surfaces():
            search.add([surface], bound(surface))
        for least, surface in search:
            if least >= margin - (0.0 if surface.sector is None else gap):
                break
            nearest = self.largest(-surface.distance, above=-margin)
            complete = complete and nearest.proven
            if surface.sector is None:
                margin = -nearest.value
                continue
            # Forces inside the cone keep a distance of zero at least.
            least = max(-nearest.value, least, 0.0)
            margin = min([margin, *(self._margin(x) for x in self.reached[-1:])])
            if surface.sector.half < _NARROWEST:
                complete = complete and least >= margin - gap
                continue
            for half in surface.sector.halves:
                narrower = self._sector(surface.contact, half)
                search.add([narrower], max(bound(narrower), least))
        return Extreme(margin, complete and bool(proven[:, 0].all()))

    def largest_margin(self) -> Extreme:
        """Largest margin over all modes, with the normal-force limit counted."""
        self.proven = not self.time_is_over
        if self.proven:
            held = formulated(self.problem, HeldMargin(self.torques))
            best = self._search(held).state.best
            if best is not None:
                self.reached.append(best.x[:-1])
                if self.proven:
                    return Extreme(-self.coordinates.force_scale * best.value, proven=True)
        return Extreme(max(self._margin(x) for x in self.reached), proven=False)

    def _surfaces(self) -> list[_Surface]:
        """Return all that forces keep a distance from, but the normal-force limits."""
        rows, force = self.rows, self.coordinates.force_scale
        flat = list(force * rows.normal[rows.without_cone])
        if not rows.cones.second_order:
            return [_Surface(one) for one in [*(-force * rows.cones.rows), *flat]]
        width = 2.0 * np.pi / _SECTORS
        sectors = [
            self._sector(contact, Sector(width * (index + 0.5), width / 2.0))
            for contact in self.coordinates.layout.cones.tolist()
            for index in range(_SECTORS)
        ]
        return [*(_Surface(one) for one in flat), *sectors]

    def _sector(self, contact: int, sector: Sector) -> _Surface:
        """Return the plane that no force of a sector is nearer to than to its round cone.

        There |f_t| <= c^T f_t / cos(half the width) with c along the sector's middle.
        """
        angle, half = sector
        mu = float(self.problem.friction[contact])
        distance = np.zeros(self.rows.size)
        distance[self.coordinates.normal[contact]] = mu
        distance[self.coordinates.tangent[contact]] = -np.array(
            [np.cos(angle), np.sin(angle)]
        ) / np.cos(half)
        return _Surface(
            self.coordinates.force_scale / np.sqrt(1.0 + mu**2) * distance, contact, sector
        )

    def _margin(self, x: FloatArray) -> float:
        """Return the margin of one set of forces, N."""
        return self.problem.margin_of(self.coordinates.forces(x))

    def _grows(self, c: FloatArray) -> bool:
        """Whether some mode holds a force and a ray along which -c grows."""
        alone = _with_costs(self.rays, c)
        answer = solve(alone.program, self.solver)
        if answer.outcome is Outcome.SOLVED and answer.value > -_IS_RAY:
            return False
        if self.rules.static_friction is StaticFriction.COULOMB:
            self.proven = self.proven and answer.outcome is Outcome.SOLVED
            return self.proven
        if any(self._in_mode(alone, mode) < -_IS_RAY for mode in self.growing):
            return True
        # Three searches take turns with ever more nodes. The rays of all modes alone tell soonest
        # that there is none; the modes of rays and of far forces mostly have the other too; forces
        # beside rays have the last word.
        priced = _with_costs(self.set, c)
        beside = ForceBesideRay(self.set.objective)
        pair = formulated(self.problem, beside, layers=(0, self.rows.size))
        pair = _with_costs(pair, np.concatenate([np.zeros(len(c)), c]))
        for limit in _NODES:
            if self.time_is_over:
                self.proven = False
                break
            ray, over = self._try(alone, limit)
            if ray is not None and self._in_mode(self.set, ray) < np.inf:
                return self._keep(ray)
            if ray is None and over:
                return False
            force, _ = self._try(priced, limit)
            if force is not None and self._in_mode(alone, force) < -_IS_RAY:
                return self._keep(force)
            both, over = self._try(pair, limit)
            if both is not None:
                return self._keep(both)
            if over:
                break
        return False

    def _keep(self, mode: SlidingMode) -> bool:
        self.growing.append(mode)
        return True

    def _try(self, formulation: Formulation, limit: int | None) -> tuple[SlidingMode | None, bool]:
        """Return the best mode within some nodes if its value is negative; whether that is all."""
        result = self._search(formulation, node_limit=limit)
        best, over = result.state.best, limit is None or result.state.nodes < limit
        return (None if best is None or best.value > -_IS_RAY else result.state.mode), over

    def _in_mode(self, formulation: Formulation, mode: SlidingMode) -> float:
        """Optimum of a program of one set of forces in one mode, inf where it has none."""
        answer = formulation.solve(*formulation.bounds_of(mode), self.solver, cutoff=np.inf)
        return answer.value if answer.outcome is Outcome.SOLVED else np.inf

    def _has_rays(self) -> bool:
        """Whether the force set without modes is unbounded."""
        priced = _with_costs(self.rays, -self.rows.normal.sum(axis=0))
        answer = solve(priced.program, self.solver)
        return answer.outcome is not Outcome.SOLVED or answer.value < -_IS_RAY

    def _search(
        self,
        formulation: Formulation,
        *,
        cutoff: float = np.inf,
        node_limit: int | None = None,
    ) -> SearchResult:
        state = SearchState(replace(formulation, cutoff=cutoff), self.rules, self.solver)
        own = self.limits if node_limit is None else replace(self.limits, node_limit=node_limit)
        result = search_modes(state, self.options, own)
        ended = result.status in _ENDED_EARLY and (self.time_is_over or node_limit is None)
        self.proven = self.proven and not (state.unproven or ended)
        # The other programs have other rows, or a force among their variables and more.
        if state.best is not None and formulation.objective is self.set.objective:
            self.reached.append(state.best.x)
        return result


def _with_costs(formulation: Formulation, c: FloatArray) -> Formulation:
    """Return a formulation with other costs, (n,)."""
    return replace(formulation, program=replace(formulation.program, c=c))
