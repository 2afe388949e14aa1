"""Comparisons of one problem: under every reading of the rules, by mode, and with less friction.

The least friction is the smallest with which the problem is feasible.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Unpack

import numpy as np

from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.options import Search, SolveKeywords, SolveOptions, objective_named
from graspless_pin.algorithms.search_state import SearchState
from graspless_pin.algorithms.solve import solution_of, solve_problem
from graspless_pin.bounds import LARGEST_FRICTION
from graspless_pin.errors import OverrunError
from graspless_pin.modes.kinematics import enumerate_modes
from graspless_pin.modes.rules import Rules, SignRule, SlidingRule, StaticFriction
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import units_text
from graspless_pin.programs.objectives import Algorithm, Margin, Objective
from graspless_pin.records import Brief, Record
from graspless_pin.solution import UNDECIDED, TorqueSolution
from graspless_pin.solution.tables import Table, decimals, torque_size
from graspless_pin.tree_search import Limits


@dataclass(frozen=True, eq=False, repr=False)
class RuleComparison(Record, Brief):
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
        problem, rows = next(iter(self.solutions.values())).problem, []  # the same for all
        force = problem.scales.force
        for rules, solution in self.solutions.items():
            name = f"{rules.sign} + {rules.sliding}"
            if rules.static_friction is StaticFriction.COULOMB:
                name = "coulomb"
            own = solution.problem
            cones = "" if own.cone == problem.cone else own.cone_model.words(own.cone_edges)
            if solution.found:
                size = torque_size(problem, solution.torques)
                figures = decimals(solution.margin, force), decimals(solution.max_torque, size)
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

    The spread of the optima shows how much of the answer depends on the rule. ``direction`` is
    solved with round cones, whatever pyramids the problem has; it is left out where the cones are
    another model than Coulomb's law, and where all modes are to be enumerated.

    Args:
        problem: Contacts, wrench, joints and limits.
        algorithm: ``margin`` (Algorithm 1), ``torque`` (Algorithm 2) or another objective's name,
            which the rule ``direction`` does not take.
        margin: Required margin e_0, N; Algorithm 1 has none.
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
    limits = Limits.from_options(how)
    readings = [Rules(sign, sliding) for sign, sliding in product(SignRule, SlidingRule)]
    readings.append(Rules(static_friction=StaticFriction.COULOMB))
    refuses_directions = objective.algorithm is None or how.search is Search.ENUMERATE
    if refuses_directions or not checked_problem(problem).cone_model.is_coulomb:
        readings = [rules for rules in readings if not rules.by_direction]
    found = {
        rules: solve_problem(problem, objective, limits.with_time_left(replace(how, rules=rules)))
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

    Where `node_limit` (modes count as nodes) or `time_limit` ends the listing before the last mode,
    one solution without a mode follows, with the status NOT_FOUND_IN_LIMIT. Without it all modes
    were listed. The time that the caller spends between two solutions counts, too.

    Args:
        problem: Contacts, wrench, joints and limits.
        algorithm: ``margin`` (Algorithm 1), ``torque`` (Algorithm 2) or another objective's name.
        margin: Required margin e_0, N; Algorithm 1 has none.
        options: See `SolveOptions.parse`; ``coulomb`` has no modes and is ignored.

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
    limits = Limits.from_options(how)
    modes = enumerate_modes(
        problem, sign_rule=signs, sliding_rule=sliding, maximal=True, time_limit=how.time_limit
    )
    with suppress(OverrunError):
        for nodes, mode in enumerate(modes):
            if limits.is_over(nodes):
                break
            yield solve_problem(problem, objective, how, mode=mode)
        else:
            return
    state = SearchState(formulate(problem, objective), how, limits)
    yield solution_of(state.final_status(interrupted=True), state)


_LARGEST_FACTOR = 16.0
_FACTORS_SCANNED = 48
_FACTOR_TOLERANCE = 1e-7


@dataclass(frozen=True)
class MinimumFriction:
    """The smallest common factor on all friction coefficients.

    See the example of `minimum_friction`.

    Attributes:
        factor: Smallest factor with which the scene is feasible (at margin zero); 0 if it needs no
            friction, NaN if no factor up to 16 is enough. Where a limit ended a search, the
            smallest one that was found to be enough.
        proven: Whether all searches were completed, with proven answers of solvers.
    """

    factor: float
    proven: bool

    @property
    def found(self) -> bool:
        """Whether any factor up to 16 makes the scene feasible."""
        return bool(np.isfinite(self.factor))


def minimum_friction(
    problem: QuasistaticProblem, **options: Unpack[SolveKeywords]
) -> MinimumFriction:
    """Find the smallest common factor on all friction coefficients that keeps a scene feasible.

    Without actual sliding the force set grows with the factor, and bisection is exact. Kinetic
    friction turns with its coefficient, so with sliding contacts 1 and 48 factors from 1/16 to 16
    are tried first, and a feasible interval between two of them can be missed.

    Args:
        problem: Contacts, wrench, joints and limits.
        options: See `SolveOptions.parse`.

    Raises:
        ArgumentError: If an option is not known, or ``stability="strong"``.

    Examples:
        >>> from graspless_pin import load_scene, minimum_friction
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> print(f"{minimum_friction(problem).factor:.2f} of the friction is needed")
        0.22 of the friction is needed
    """
    checked_problem(problem)
    how = SolveOptions.parse(**options).need_weak(
        "minimum_friction considers only the best admissible contact forces",
        "leave it out, and solve the problem with scaled friction and stability='strong'",
    )
    return smallest_factor(problem, Margin(), how)


def smallest_factor(
    problem: QuasistaticProblem, objective: Objective, options: SolveOptions
) -> MinimumFriction:
    """Return the smallest common factor on friction with which an objective is feasible.

    A search that was not completed counts as infeasible.

    Args:
        problem: Contacts, wrench, joints and limits.
        objective: What has to be feasible. With a required margin the factor 0 is left out, as no
            contact has a cone then.
        options: How the problems are solved.
    """
    proven, limits = True, Limits.from_options(options)

    def is_feasible(factor: float) -> bool:
        nonlocal proven
        if limits.is_time_over:
            proven = False
            return False
        friction = np.minimum(factor * problem.friction, LARGEST_FRICTION)
        scaled = problem.with_changes(friction=friction)
        solution = solve_problem(scaled, objective, limits.with_time_left(options))
        proven = proven and solution.status not in UNDECIDED
        return solution.found

    if objective.required_margin == 0.0 and is_feasible(0.0):
        return MinimumFriction(0.0, proven)
    factors = [1.0, _LARGEST_FACTOR]
    if problem.is_sliding.any():
        # With the factor 1, so that a problem that is feasible as it is is not missed.
        factors = sorted(
            {1.0, *np.geomspace(1.0 / _LARGEST_FACTOR, _LARGEST_FACTOR, _FACTORS_SCANNED).tolist()}
        )
    low = 0.0
    for top in factors:
        if is_feasible(top):
            break
        low = top
    else:
        return MinimumFriction(np.nan, proven)
    while top - low > _FACTOR_TOLERANCE * top:
        middle = 0.5 * (low + top)
        low, top = (low, middle) if is_feasible(middle) else (middle, top)
    return MinimumFriction(top, proven)
