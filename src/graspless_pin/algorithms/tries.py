"""Problems that are tried in the place of one that is infeasible, within limits of all together."""

from __future__ import annotations

from graspless_pin.algorithms.limits import NO_LIMITS, Limits
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.modes.rules import Rules
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.solution import Status, TorqueSolution


class Tries:
    """The searches for changes that help, within the limits of all.

    Attributes:
        limits: Of all of them.
        is_limited: Whether there are any.
        cut_short: Whether one of them was ended by a limit, or not begun.
    """

    def __init__(self, options: SolveOptions) -> None:
        """Let the time begin."""
        self.limits = Limits.of(options)
        self.is_limited = self.limits != NO_LIMITS
        self.cut_short = False

    def options(self, rules: Rules) -> SolveOptions | None:
        """Return how the next problem is solved; None: the time is over."""
        if self.limits.passed:
            self.cut_short = True
            return None
        return self.limits.within(SolveOptions(rules, node_limit=self.limits.node_limit))

    def ended(self, status: Status) -> None:
        """Note how a search ended."""
        self.cut_short |= status in (Status.NOT_FOUND_IN_LIMIT, Status.LIMIT_REACHED)

    def feasible(
        self, problem: QuasistaticProblem, solution: TorqueSolution, rules: Rules, margin: float
    ) -> bool:
        """Return whether another problem is found feasible under other rules and margins."""
        options = self.options(rules)
        if options is None:
            return False
        objective = solution.objective.with_figure("required_margin", margin)
        found = solve_problem(problem, objective, options)
        self.ended(found.status)
        return found.found
