"""Side by side: the optimum under every reading of the rules, and mode by mode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Unpack

from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.named_objectives import objective_named
from graspless_pin.algorithms.options import Limits, SolveKeywords, SolveOptions
from graspless_pin.algorithms.search import SearchState, finished
from graspless_pin.algorithms.solve import solution_of, solve_problem
from graspless_pin.errors import OverrunError
from graspless_pin.modes.kinematics import enumerate_modes
from graspless_pin.modes.rules import Rules, SignRule, SlidingRule, StaticFriction
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import units_text
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.records import Brief
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.tables import Table, shown, torque_size


@dataclass(frozen=True, eq=False, repr=False)
class RuleComparison(Brief):
    """The optimum under every pair of rules and plain Coulomb friction.

    See the example of `compare_rules`.

    Attributes:
        algorithm: Algorithm 1 or 2; None: another objective.
        solutions: Solution by rules.
    """

    algorithm: Algorithm | None
    solutions: Mapping[Rules, TorqueSolution]

    def __str__(self) -> str:
        """Return a readable table."""
        return str(self._table())

    def _repr_html_(self) -> str:
        """Return the table as HTML, for notebooks."""
        return self._table().html()

    def _table(self) -> Table:
        problem, rows = next(iter(self.solutions.values())).problem, []  # they are all of one
        force = problem.scales.force
        for rules, solution in self.solutions.items():
            name = f"{rules.sign} + {rules.sliding}"
            if rules.static_friction is StaticFriction.COULOMB:
                name = "coulomb"
            own = solution.problem
            cones = "" if own.cone == problem.cone else own.cone_model.words(own.cone_edges)
            if solution.found:
                size = torque_size(problem, solution.torques)
                figures = shown(solution.margin, force), shown(solution.max_torque, size)
                rows.append([name, *figures, cones])
            else:
                rows.append([name, "-", "-", solution.status.message])
        headers = ["rule", "margin [N]", f"max |torque| [{units_text(problem.joint_units)}]", ""]
        return Table(rows, headers)


def compare_rules(
    problem: QuasistaticProblem,
    algorithm: str = "margin",
    *,
    margin: float = 0.1,
    **options: Unpack[SolveKeywords],
) -> RuleComparison:
    """Solve a problem under every pair of rules and plain Coulomb friction.

    How much the optimum moves tells how much of the answer hangs on the rule. That of
    ``direction`` is of round cones, whatever pyramids the problem has; it is left out where the
    cones are another model than Coulomb's law.

    Args:
        problem: Contacts, wrench, joints and limits.
        algorithm: ``margin`` (Algorithm 1), ``torque`` (Algorithm 2) or another objective's name,
            which the rule ``direction`` does not take.
        margin: Required margin e_0, N, but of Algorithm 1.
        options: See `SolveOptions.parse`; the rules are the compared ones.

    Raises:
        ArgumentError: If an option is not known or the margin is negative.

    Examples:
        >>> from graspless_pin import load_scene, compare_rules
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> table = compare_rules(problem, "torque", margin=0.1)
        >>> print(str(table).splitlines()[2])
        strict + exempt                   0.1                0.9618
    """
    how, objective = SolveOptions.parse(**options), objective_named(algorithm, {"margin": margin})
    limits = Limits.of(how)
    readings = [Rules(sign, sliding) for sign, sliding in product(SignRule, SlidingRule)]
    readings.append(Rules(static_friction=StaticFriction.COULOMB))
    if not checked_problem(problem).cone_model.is_coulomb or objective.algorithm is None:
        readings = [rules for rules in readings if not rules.by_direction]
    found = {
        rules: solve_problem(problem, objective, limits.within(replace(how, rules=rules)))
        for rules in readings
    }
    return RuleComparison(objective.algorithm, found)


def solve_each_mode(
    problem: QuasistaticProblem,
    algorithm: str = "margin",
    *,
    margin: float = 0.1,
    **options: Unpack[SolveKeywords],
) -> Iterator[TorqueSolution]:
    """Yield the solution of each feasible maximal mode, found or not, in the order of listing.

    Where `node_limit` (modes count as nodes) or `time_limit` ends it before the last mode, one
    solution of no mode follows, with the status NOT_FOUND_IN_LIMIT: modes that come after it are
    missing. Without it the modes are all. What the caller does between two solutions takes of the
    time, too.

    Args:
        problem: Contacts, wrench, joints and limits.
        algorithm: ``margin`` (Algorithm 1), ``torque`` (Algorithm 2) or another objective's name.
        margin: Required margin e_0, N, but of Algorithm 1.
        options: See `SolveOptions.parse`; ``coulomb`` has no modes and counts as the rule without.

    Raises:
        ArgumentError: If an option is not known.

    Examples:
        >>> from graspless_pin import load_scene, solve_each_mode
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> best = max(s.margin for s in solve_each_mode(problem) if s.found)
        >>> print(f"{best:.4f} N")
        1.6504 N
    """
    options["static_friction"] = StaticFriction.VIRTUAL_SLIDING
    how, objective = SolveOptions.parse(**options), objective_named(algorithm, {"margin": margin})
    signs, sliding = how.rules.sign, how.rules.sliding
    limits = Limits.of(how)
    modes = enumerate_modes(
        problem, sign_rule=signs, sliding_rule=sliding, maximal=True, time_limit=how.time_limit
    )
    with suppress(OverrunError):
        for nodes, mode in enumerate(modes):
            if limits.end(nodes):
                break
            yield solve_problem(problem, objective, how, mode=mode)
        else:
            return
    state = SearchState(formulate(problem, objective), how.rules, how.solver)
    yield solution_of(finished(state, interrupted=True), how.rules)
