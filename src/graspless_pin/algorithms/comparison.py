"""Side by side: the optimum under every reading of the rules, and mode by mode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

from tabulate import tabulate

from graspless_pin.algorithms.limits import Limits
from graspless_pin.algorithms.torque import maximize_margin, minimize_torque
from graspless_pin.modes.enumeration import enumerate_modes
from graspless_pin.modes.rules import Rules, SignRule, SlidingRule, StaticFriction, choice
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.joint_units import units_text
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.table import table_html


@dataclass(frozen=True, eq=False)
class RuleComparison:
    """The optimum under the six rule pairs and plain Coulomb friction.

    Attributes:
        algorithm: Algorithm 1 or 2.
        solutions: Solution by rules.
    """

    algorithm: Algorithm
    solutions: Mapping[Rules, TorqueSolution]

    def __str__(self) -> str:
        """Return a readable table."""
        return tabulate(self._rows(), self._headers())

    def _repr_html_(self) -> str:
        """Return the table as HTML, for notebooks."""
        return table_html(self._rows(), self._headers())

    def _headers(self) -> list[str]:
        problem = next(iter(self.solutions.values())).problem  # they are all of one
        return ["rule", "margin [N]", f"max |torque| [{units_text(problem.joint_units)}]", ""]

    def _rows(self) -> list[list[str]]:
        rows = []
        for rules, solution in self.solutions.items():
            name = f"{rules.sign} + {rules.sliding}"
            if rules.static_friction is StaticFriction.COULOMB:
                name = "coulomb"
            if solution.found:
                rows.append([name, f"{solution.margin:.4f}", f"{solution.max_torque:.4f}", ""])
            else:
                rows.append([name, "-", "-", solution.status.message])
        return rows


def compare_rules(
    problem: QuasistaticProblem,
    algorithm: str = "margin",
    *,
    margin: float = 0.1,
    node_limit: int | None = None,
    time_limit: float | None = None,
) -> RuleComparison:
    """Solve a problem under each of the six rule pairs and plain Coulomb friction.

    How much the optimum moves tells how much of the answer hangs on the rule.

    Args:
        problem: Contacts, wrench, joints and limits.
        algorithm: ``margin`` (Algorithm 1) or ``torque`` (Algorithm 2).
        margin: Required margin e_0 of Algorithm 2, N.
        node_limit: Limit of each of the searches over modes; None: none.
        time_limit: Seconds for all of them; None: no limit.

    Raises:
        ArgumentError: If the algorithm is not known or the margin is negative.
    """
    limits = Limits.parse(node_limit, time_limit)
    chosen = choice(Algorithm, "algorithm", algorithm)
    readings = [Rules(sign, sliding) for sign, sliding in product(SignRule, SlidingRule)]
    readings.append(Rules(static_friction=StaticFriction.COULOMB))
    return RuleComparison(
        chosen, {rules: _solve(problem, chosen, margin, rules, limits) for rules in readings}
    )


def solve_each_mode(
    problem: QuasistaticProblem,
    algorithm: str = "margin",
    *,
    margin: float = 0.1,
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
) -> Iterator[TorqueSolution]:
    """Yield the solution of each feasible maximal mode, found or not, in the order of listing.

    Args:
        problem: Contacts, wrench, joints and limits.
        algorithm: ``margin`` (Algorithm 1) or ``torque`` (Algorithm 2).
        margin: Required margin e_0 of Algorithm 2, N.
        sign_rule: See `maximize_margin`.
        sliding_rule: See `maximize_margin`.

    Raises:
        ArgumentError: If an option is not known.
    """
    chosen = choice(Algorithm, "algorithm", algorithm)
    modes = enumerate_modes(problem, sign_rule=sign_rule, sliding_rule=sliding_rule, maximal=True)
    for mode in modes:
        rules = Rules.parse(sign_rule, sliding_rule, StaticFriction.VIRTUAL_SLIDING).options()
        if chosen is Algorithm.MARGIN:
            yield maximize_margin(problem, mode=mode, **rules)
        else:
            yield minimize_torque(problem, margin, mode=mode, **rules)


def _solve(
    problem: QuasistaticProblem,
    algorithm: Algorithm,
    margin: float,
    rules: Rules,
    limits: Limits,
) -> TorqueSolution:
    if algorithm is Algorithm.MARGIN:
        return maximize_margin(problem, **rules.options(), **limits.left)
    return minimize_torque(problem, margin, **rules.options(), **limits.left)
