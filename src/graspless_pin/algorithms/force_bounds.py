"""What contact forces given torques can end up with: the indeterminate forces, eq. (32)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tabulate import tabulate

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.formulation import Formulation, shared_parts
from graspless_pin.algorithms.search import SearchResult, SearchState
from graspless_pin.errors import NoSolutionError
from graspless_pin.modes.rules import Rules, SlidingMode, StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only
from graspless_pin.programs.analysis_programs import (
    force_set_program,
    held_margin_program,
    ray_program,
    with_objective,
)
from graspless_pin.programs.force_programs import ForceRows, force_rows
from graspless_pin.programs.program import Program
from graspless_pin.solution import Status
from graspless_pin.solution.records import FOUND
from graspless_pin.solution.table import paragraph, table_html
from graspless_pin.solvers import Outcome, check_solver, solve

_FARTHEST = 1e3
"""Bounded forces are looked for up to this multiple of the largest normal-force limit."""
_IS_RAY = 1e-6
_NODES = (32, 128, 512, 2048, 8192, None)
"""Limits of the searches for a free ray, one after the other: any ray will do."""
_DETERMINATE = 1e-6
_HEADERS = ["#", "f_n [N]", "f_t1 [N]", "f_t2 [N]"]


@dataclass(frozen=True, eq=False)
class ContactForceBounds:
    """The range of every contact force over all feasible virtual-sliding modes.

    Attributes:
        status: OPTIMAL; LIMIT_REACHED where no solver answered some program, so that the range
            may be wider; or why there is no range.
        lower: (M, 3) smallest f_n, f_t1, f_t2, N; -inf where a free ray exists.
        upper: (M, 3) largest f_n, f_t1, f_t2, N; inf where a free ray exists.
        smallest_margin: Smallest margin (N) that the torques can end up with; -inf where a
            normal force is unbounded.
        largest_margin: Largest margin that they can end up with, N: the optimum's best case.
        torques: (L,) the motor torques that were given.
        problem: The problem.
    """

    status: Status
    lower: FloatArray
    upper: FloatArray
    smallest_margin: float
    largest_margin: float
    torques: FloatArray
    problem: QuasistaticProblem

    @property
    def found(self) -> bool:
        """Whether the torques can be held at all."""
        return self.status in FOUND

    @property
    def indeterminate(self) -> NDArray[np.bool_]:
        """(M, 3) components that the torques do not determine."""
        width = self.upper - self.lower
        return width > _DETERMINATE * float(self.problem.max_normal_force.max())

    def __str__(self) -> str:
        """Return a readable table."""
        if not self.found:
            return f"not found: {self.status.message}"
        return f"{tabulate(self._rows(), _HEADERS)}\n\n{self._margins()}"

    def _repr_html_(self) -> str:
        """Return the table as HTML, for notebooks."""
        if not self.found:
            return paragraph(str(self))
        return table_html(self._rows(), _HEADERS, self._margins())

    def _rows(self) -> list[list[object]]:
        return [
            [contact, *(f"{a:+.4f} .. {b:+.4f}" for a, b in zip(low, high, strict=True))]
            for contact, (low, high) in enumerate(zip(self.lower, self.upper, strict=True))
        ]

    def _margins(self) -> str:
        return (
            f"margin between {self.smallest_margin:.4g} and {self.largest_margin:.4g} N with these "
            "torques"
        )


def contact_force_bounds(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    *,
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    static_friction: str = "virtual_sliding",
    solver: str = "piqp",
) -> ContactForceBounds:
    """Bound the contact forces that given motor torques can end up with, eq. (32).

    Every component is minimised and maximised over all feasible modes by branch and bound. The
    force set (32) has no normal-force limit: a component is infinite where a direction exists that
    keeps balance, torques, cones and one feasible mode (a free ray, found and not presumed).

    Args:
        problem: Contacts, wrench and joints.
        torques: (L,) motor torques J^T f + g, N m; for example `TorqueSolution.torques`.
        sign_rule: See `maximize_margin`, as for the other options.
        sliding_rule: See `maximize_margin`.
        static_friction: See `maximize_margin`.
        solver: See `maximize_margin`.

    Raises:
        ArgumentError: If the torques have the wrong shape or an option is not known.
        NoSolutionError: If no solver answers for one of the bounds.
    """
    given = finite_array("torques", torques, (problem.joint_count,))
    rules = Rules.parse(sign_rule, sliding_rule, static_friction)
    search = _Bounds(problem, given, rules, check_solver(solver))
    status = search.feasibility()
    count = problem.contact_count
    lower, upper = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    margins = np.nan, np.nan
    if status is Status.OPTIMAL:
        for contact in range(count):
            for component in range(3):
                direction = search.component(contact, component)
                lower[contact, component] = -search.largest(-direction)
                upper[contact, component] = search.largest(direction)
        margins = search.smallest_margin(lower, upper), search.largest_margin()
        status = Status.OPTIMAL if search.proven else Status.LIMIT_REACHED
    return ContactForceBounds(status, read_only(lower), read_only(upper), *margins, given, problem)


class _Bounds:
    """The force set of given torques, and optima of linear functions over it.

    Attributes:
        growing: Modes that were seen to hold a force and a free ray.
        proven: Whether every search so far came to its proof.
    """

    def __init__(
        self, problem: QuasistaticProblem, torques: FloatArray, rules: Rules, solver: str
    ) -> None:
        self.problem, self.rules, self.solver = problem, rules, solver
        self.coordinates, self.kinematics = shared_parts(problem)
        self.rows: ForceRows = force_rows(problem, self.coordinates)
        self.torque = (torques - problem.gravity_torques) / self.coordinates.torque_scale
        self.set = force_set_program(self.rows, self.coordinates, self.torque, _FARTHEST)
        self.has_rays = self._has_rays()
        self.growing: list[SlidingMode] = []
        self.proven = True

    def feasibility(self) -> Status:
        """Whether some mode holds the torques."""
        return self._search(self.set).status

    def component(self, contact: int, component: int) -> FloatArray:
        """(n,) functional of the coordinates that gives f_n, f_t1 or f_t2 of a contact, in N."""
        frame = np.column_stack([self.problem.normals[contact], self.problem.tangents[contact]])
        block = self.coordinates.basis[3 * contact : 3 * contact + 3]
        return self.coordinates.force_scale * (frame[:, component] @ block)

    def largest(self, functional: FloatArray, *, above: float = -np.inf) -> float:
        """Largest value of a linear function over all modes; inf along a free ray.

        Args:
            functional: (n,) its coefficients.
            above: Smaller values are of no interest; then this is returned.
        """
        scale = float(np.abs(functional).max())
        if scale == 0.0:
            return 0.0
        c = -functional / scale
        if self.has_rays and self._grows(c):
            return np.inf
        result = self._search(with_objective(self.set, c), cutoff=-above / scale)
        if result.state.best is not None:
            return max(-scale * result.state.best.value, above)
        if above == -np.inf or result.status is Status.UNVERIFIED:
            raise NoSolutionError(f"The bound of a contact force: {result.status.message}.")
        return above

    def smallest_margin(self, lower: FloatArray, upper: FloatArray) -> float:
        """Smallest distance to any face: the margin is the least of linear functions.

        Faces that the bounds of the components keep farther away than the nearest face so far
        need no search.
        """
        margin = float((self.problem.max_normal_force - upper[:, 0]).min())
        force, rows = self.coordinates.force_scale, self.rows
        distances = force * np.vstack([-rows.faces, rows.normal[rows.bare]])
        low, high = np.zeros(rows.size), np.zeros(rows.size)
        cones = self.problem.has_cone
        for end, bounds in ((low, lower), (high, upper)):
            end[self.coordinates.normal] = bounds[:, 0]
            end[self.coordinates.tangent[cones]] = bounds[cones, 1:]
        at = np.where(distances > 0.0, low, np.where(distances < 0.0, high, 0.0))
        least = (distances * at).sum(axis=1) / force
        for index in np.argsort(least):
            if least[index] >= margin:
                break
            margin = -self.largest(-distances[index], above=-margin)
        return margin

    def largest_margin(self) -> float:
        """Largest margin over all modes, with the normal-force limit counted."""
        program = held_margin_program(self.rows, self.coordinates, self.torque)
        result = self._search(program)
        if result.state.best is None:
            return -np.inf
        return -self.coordinates.force_scale * result.state.best.value

    def _grows(self, c: FloatArray) -> bool:
        """Whether some mode holds a force and a ray along which -c grows."""
        alone = self._ray_alone(c)
        answer = solve(alone, self.solver)
        if answer.outcome is Outcome.SOLVED and answer.value > -_IS_RAY:
            return False
        if self.rules.static_friction is StaticFriction.COULOMB:
            return True
        if any(self._in_mode(alone, mode) < -_IS_RAY for mode in self.growing):
            return True
        # Three searches take turns with ever more nodes. The rays of all modes alone tell soonest
        # that there is none; the modes of rays and of far forces mostly have the other too; forces
        # beside rays have the last word.
        far = with_objective(self.set, c)
        beside = ray_program(self.set, self.rows, self.coordinates)
        pair = with_objective(beside, np.concatenate([np.zeros(len(c)), c]))
        for limit in _NODES:
            ray, over = self._try(alone, limit)
            if ray is not None and self._in_mode(self.set, ray) < np.inf:
                return self._keep(ray)
            if ray is None and over:
                return False
            force, _ = self._try(far, limit)
            if force is not None and self._in_mode(alone, force) < -_IS_RAY:
                return self._keep(force)
            both, over = self._try(pair, limit, layers=(0, self.rows.size))
            if both is not None:
                return self._keep(both)
            if over:
                break
        return False

    def _keep(self, mode: SlidingMode) -> bool:
        self.growing.append(mode)
        return True

    def _try(
        self, program: Program, limit: int | None, *, layers: tuple[int, ...] = (0,)
    ) -> tuple[SlidingMode | None, bool]:
        """The best mode within so many nodes if its objective is negative; whether that is all."""
        result = self._search(program, layers=layers, node_limit=limit)
        best, over = result.state.best, limit is None or result.state.nodes < limit
        return (None if best is None or best.value > -_IS_RAY else result.state.mode), over

    def _in_mode(self, program: Program, mode: SlidingMode) -> float:
        """Optimum of a program of one set of forces in one mode, inf where it has none."""
        formulation = Formulation(self.problem, self.coordinates, program, self.kinematics)
        answer = formulation.solve(*formulation.bounds_of(mode), self.solver, cutoff=np.inf)
        return answer.value if answer.outcome is Outcome.SOLVED else np.inf

    def _has_rays(self) -> bool:
        """Whether the force set without modes is unbounded."""
        answer = solve(self._ray_alone(-self.rows.normal.sum(axis=0)), self.solver)
        return answer.outcome is not Outcome.SOLVED or answer.value < -_IS_RAY

    def _ray_alone(self, c: FloatArray) -> Program:
        still = np.zeros_like(self.torque)
        ray = force_set_program(self.rows, self.coordinates, still, 1.0)
        return with_objective(replace(ray, b=np.zeros(len(ray.b))), c)

    def _search(
        self,
        program: Program,
        *,
        layers: tuple[int, ...] = (0,),
        cutoff: float = np.inf,
        node_limit: int | None = None,
    ) -> SearchResult:
        formulation = Formulation(
            self.problem, self.coordinates, program, self.kinematics, cutoff, layers=layers
        )
        state = SearchState(formulation, self.rules, self.solver)
        result = branch_and_bound(state, node_limit=node_limit)
        self.proven = self.proven and not state.unproven
        return result
