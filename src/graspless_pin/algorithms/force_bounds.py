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
from graspless_pin.modes.rules import Rules
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
from graspless_pin.solvers import Outcome, check_solver, solve

_FARTHEST = 1e3
"""Bounded forces are looked for up to this multiple of the largest normal-force limit."""
_IS_RAY = 1e-6
_DETERMINATE = 1e-6


@dataclass(frozen=True, eq=False)
class ContactForceBounds:
    """The range of every contact force over all feasible virtual-sliding modes.

    Attributes:
        status: OPTIMAL, or why there is no range.
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
        return self.status is Status.OPTIMAL

    @property
    def indeterminate(self) -> NDArray[np.bool_]:
        """(M, 3) components that the torques do not determine."""
        width = self.upper - self.lower
        return width > _DETERMINATE * float(self.problem.max_normal_force.max())

    def __str__(self) -> str:
        """Return a readable table."""
        if not self.found:
            return f"not found: {self.status.message}"
        rows = [
            [contact, *(f"{a:+.4f} .. {b:+.4f}" for a, b in zip(low, high, strict=True))]
            for contact, (low, high) in enumerate(zip(self.lower, self.upper, strict=True))
        ]
        table = tabulate(rows, ["#", "f_n [N]", "f_t1 [N]", "f_t2 [N]"])
        margins = f"margin between {self.smallest_margin:.4g} and {self.largest_margin:.4g} N"
        return f"{table}\n\n{margins} with these torques"


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
        margins = search.smallest_margin(upper), search.largest_margin()
    return ContactForceBounds(status, read_only(lower), read_only(upper), *margins, given, problem)


class _Bounds:
    """The force set of given torques, and optima of linear functions over it."""

    def __init__(
        self, problem: QuasistaticProblem, torques: FloatArray, rules: Rules, solver: str
    ) -> None:
        self.problem, self.rules, self.solver = problem, rules, solver
        self.coordinates, self.kinematics = shared_parts(problem)
        self.rows: ForceRows = force_rows(problem, self.coordinates)
        self.torque = (torques - problem.gravity_torques) / self.coordinates.torque_scale
        self.set = force_set_program(self.rows, self.coordinates, self.torque, _FARTHEST)
        self.rays: Program | None = None
        if self._has_rays():
            self.rays = ray_program(self.set, self.rows, self.coordinates)

    def feasibility(self) -> Status:
        """Whether some mode holds the torques."""
        result = self._search(self.set, (0,))
        return result.status

    def component(self, contact: int, component: int) -> FloatArray:
        """(n,) functional of the coordinates that gives f_n, f_t1 or f_t2 of a contact, in N."""
        frame = np.column_stack([self.problem.normals[contact], self.problem.tangents[contact]])
        block = self.coordinates.basis[3 * contact : 3 * contact + 3]
        return self.coordinates.force_scale * (frame[:, component] @ block)

    def largest(self, functional: FloatArray) -> float:
        """Largest value of a linear function over all modes; inf along a free ray."""
        scale = float(np.abs(functional).max())
        if scale == 0.0:
            return 0.0
        c = -functional / scale
        if self.rays is not None and self._grows(c):
            return np.inf
        result = self._search(with_objective(self.set, c), (0,))
        if result.state.best is None:
            raise NoSolutionError(f"The bound of a contact force: {result.status.message}.")
        return -scale * result.state.best.value

    def smallest_margin(self, upper: FloatArray) -> float:
        """Smallest distance to any face: the margin is the least of linear functions."""
        force = self.coordinates.force_scale
        margin = float((self.problem.max_normal_force - upper[:, 0]).min())
        distances = [-force * face for face in self.rows.faces]
        distances += [force * row for row in self.rows.normal[self.rows.bare]]
        for distance in distances:
            margin = min(margin, -self.largest(-distance))
        return margin

    def largest_margin(self) -> float:
        """Largest margin over all modes, with the normal-force limit counted."""
        program = held_margin_program(self.rows, self.coordinates, self.torque)
        result = self._search(program, (0,))
        if result.state.best is None:
            return -np.inf
        return -self.coordinates.force_scale * result.state.best.value

    def _grows(self, c: FloatArray) -> bool:
        """Whether some mode holds a force and a ray along which -c grows."""
        assert self.rays is not None  # noqa: S101 - asked only where rays exist
        program = with_objective(self.rays, np.concatenate([np.zeros(len(c)), c]))
        alone = solve(self._ray_alone(c), self.solver)
        if alone.outcome is Outcome.SOLVED and alone.value > -_IS_RAY:
            return False
        result = self._search(program, (0, self.rows.size))
        best = result.state.best
        return best is not None and best.value < -_IS_RAY

    def _has_rays(self) -> bool:
        """Whether the force set without modes is unbounded."""
        answer = solve(self._ray_alone(-self.rows.normal.sum(axis=0)), self.solver)
        return answer.outcome is not Outcome.SOLVED or answer.value < -_IS_RAY

    def _ray_alone(self, c: FloatArray) -> Program:
        still = np.zeros_like(self.torque)
        ray = force_set_program(self.rows, self.coordinates, still, 1.0)
        return with_objective(replace(ray, b=np.zeros(len(ray.b))), c)

    def _search(self, program: Program, layers: tuple[int, ...]) -> SearchResult:
        formulation = Formulation(
            self.problem, self.coordinates, program, self.kinematics, layers=layers
        )
        return branch_and_bound(SearchState(formulation, self.rules, self.solver))
