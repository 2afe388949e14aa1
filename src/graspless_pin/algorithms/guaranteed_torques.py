"""Torques of which rest is the only outcome: those that need little friction at the supports.

The best case may rest on a squeeze between supports that nothing guarantees. Torques that balance
the load with less of the supports' friction rely on the fingers, whose loads the torques make: the
first guesses are Algorithms 1 and 2 with that friction reduced. Only the verdict guarantees.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

import numpy as np

from graspless_pin.algorithms.options import SolveKeywords, SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import NoSolutionError
from graspless_pin.holding.stability import NODE_LIMIT, stability
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.solution import TorqueSolution

_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Of the supports' friction, tried one after the other."""


@dataclass(frozen=True, eq=False)
class GuaranteedTorques:
    """Torques of which rest is the only outcome, and what they cost.

    Attributes:
        problem: The problem.
        best_case: The optimum over all forces that statics leave open.
        solution: The optimum with part of the supports' friction, whose torques are guaranteed;
            None where none was found. Its forces are forces of the problem, too.
        verdict: On its torques; else on those of the best case. None where there is none.
        friction_share: Share of the supports' friction that `solution` relies on.
        tried: Sets of torques that were tried.
    """

    problem: QuasistaticProblem
    best_case: TorqueSolution
    solution: TorqueSolution | None
    verdict: StabilityVerdict | None
    friction_share: float
    tried: int

    @property
    def found(self) -> bool:
        """Whether there are guaranteed torques to read."""
        return self.solution is not None

    @property
    def torques(self) -> FloatArray:
        """(L,) the motors' torques, N m (N).

        Raises:
            NoSolutionError: If none were found.
        """
        return self._read().torques

    @property
    def margin(self) -> float:
        """The margin in the problem's own cones of the forces that `solution` found, N.

        Raises:
            NoSolutionError: If none were found.
        """
        return self.problem.margin_of(self._read().contact_forces)

    def _read(self) -> TorqueSolution:
        if self.solution is None:
            raise NoSolutionError(f"There are no guaranteed torques to read ({self}).")
        return self.solution

    def __str__(self) -> str:
        """Return one line: what was found, and what it costs beside the best case."""
        if not self.best_case.found:
            return f"not found: not even the best case is: {self.best_case.status.message}"
        if self.solution is None:
            return (
                f"not found: rest is the only outcome of none of {self.tried} sets of torques; "
                "that there are none is not proven"
            )
        best, share = self.best_case, 100.0 * self.friction_share
        return (
            f"rest is the only outcome: margin {self.margin:.4g} N (best case {best.margin:.4g} N)"
            f", largest torque {self.solution.max_torque:.4g} {self.solution.max_torque_unit} "
            f"({best.max_torque:.4g}), with {share:.0f} % of the supports' friction"
        )


def guaranteed_torques(
    problem: QuasistaticProblem,
    objective: Objective | None = None,
    *,
    verdict_nodes: int = NODE_LIMIT,
    **options: Unpack[SolveKeywords],
) -> GuaranteedTorques:
    """Find torques of which rest is the only outcome, the best ones first.

    The objective is optimised with all, three quarters, half, a quarter and nothing of the friction
    at contacts that no joint moves, until a verdict says that rest is the only outcome.

    Args:
        problem: At rest, with `object_inertia` and `joint_inertia`.
        objective: Such as ``Margin()`` (Algorithm 1, the default) or ``Torque(0.1)`` (Algorithm 2).
        verdict_nodes: Sets of outcomes that each verdict may look at.
        options: See `SolveOptions.parse`.

    Raises:
        ArgumentError: If an argument is wrong.
    """
    checked_problem(problem)
    objective = Margin() if objective is None else objective
    how = SolveOptions.parse(**options)
    rows = problem.jacobian.reshape(problem.contact_count, 3 * problem.joint_count)
    supports = ~rows.any(axis=1)
    best = solve_problem(problem, objective, how)
    verdict: StabilityVerdict | None = None
    tried = 0
    for share in _SHARES if best.found else ():
        solution = best
        if share < 1.0:
            friction = np.where(supports, share, 1.0) * problem.friction
            solution = solve_problem(problem.with_changes(friction=friction), objective, how)
        if not solution.found:
            continue
        tried += 1
        said = stability(problem, solution.torques, node_limit=verdict_nodes)
        if said.status is Stability.STRONG:
            return GuaranteedTorques(problem, best, solution, said, share, tried)
        verdict = verdict or said
    return GuaranteedTorques(problem, best, None, verdict, 1.0, tried)
