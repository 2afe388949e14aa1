"""Why nothing is feasible, in the user's terms, and the smallest changes that would help."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.formulation import Formulation, Objective, formulate, shared_parts
from graspless_pin.algorithms.minimum_friction import minimum_friction
from graspless_pin.algorithms.search import SearchState
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.modes.kinematics import Conflict
from graspless_pin.modes.rules import Rules, SignRule, SlidingRule, StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.analysis_programs import relief_program
from graspless_pin.programs.force_programs import force_rows
from graspless_pin.solution import Algorithm, Status, TorqueSolution
from graspless_pin.solvers import Outcome

_ROOM = 1.0 + 1e-6
"""A suggestion is rounded up by this, so that it is feasible and not just about to be."""


@dataclass(frozen=True, eq=False)
class Suggestion:
    """A change that makes the problem feasible; it was tried.

    Attributes:
        text: The change in words.
        problem: The changed problem.
        margin: Required margin with which it is feasible, N.
        rules: Rules with which it is feasible.
    """

    text: str
    problem: QuasistaticProblem
    margin: float
    rules: Rules


@dataclass(frozen=True, eq=False)
class Explanation:
    """Why a problem is infeasible.

    Attributes:
        cause: One sentence.
        conflicting_contacts: Contacts whose virtual slidings exclude each other, if that is why.
        suggestions: Changes that help, each enough by itself; the first is the smallest of its
            kind to try.
    """

    cause: str
    conflicting_contacts: tuple[int, ...]
    suggestions: tuple[Suggestion, ...]

    def __str__(self) -> str:
        """Return the cause and the suggestions, a line each."""
        lines = [self.cause]
        if self.suggestions:
            lines.append("Any one of these changes would do:")
            lines += [f"- {suggestion.text}" for suggestion in self.suggestions]
        return "\n".join(lines)


def explain(solution: TorqueSolution) -> Explanation:
    """Explain why a solution was not found.

    Where the force balance itself fails, each kind of limit is relaxed alone (one joint's torque,
    all torques, normal forces, friction, the required margin, an outside help in the balance) by
    the smallest amount that makes some feasible mode work. Where only the virtual-sliding rule
    fails, the contacts in conflict are named and the weaker rules are tried.

    Args:
        solution: A solution that was not found.

    Returns:
        The cause and suggestions that were each solved and found feasible.
    """
    if solution.found:
        return Explanation("The problem is feasible.", (), ())
    if solution.status not in (Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES):
        return Explanation(f"Not solved: {solution.status.message}.", (), ())
    conflicts: tuple[int, ...] = ()
    suggestions: list[Suggestion] = []
    if solution.status is Status.INFEASIBLE_MODES:
        conflicts = _conflicting_contacts(solution)
        named = ", ".join(str(contact) for contact in conflicts)
        cause = (
            "Forces that balance exist, but their friction has no kinematically feasible virtual "
            "sliding behind it"
        )
        cause += f": contacts {named} exclude each other." if conflicts else "."
        suggestions += _weaker_rules(solution)
    else:
        cause = (
            "No contact forces inside the cones, normal-force and torque limits balance the "
            "external wrench"
        )
        if solution.required_margin > 0.0:
            cause += f" with a margin of {solution.required_margin:g} N"
        cause += "."
    suggestions += _smaller_margin(solution)
    suggestions += _reliefs(solution)
    if solution.required_margin == 0.0:
        suggestions += _more_friction(solution)
    return Explanation(cause, conflicts, tuple(suggestions))


def _solved(
    problem: QuasistaticProblem, solution: TorqueSolution, rules: Rules, margin: float
) -> TorqueSolution:
    objective = Objective(solution.algorithm, margin, by_limits=False, regularization=0.0)
    return solve_problem(problem, objective, rules)


def _conflicting_contacts(solution: TorqueSolution) -> tuple[int, ...]:
    """Contacts in the conflict of the relaxation's optimum."""
    problem = solution.problem
    objective = Objective(
        solution.algorithm, solution.required_margin, by_limits=False, regularization=0.0
    )
    state = SearchState(formulate(problem, objective), solution.rules, "piqp")
    answer = state.relax()
    if answer.outcome is not Outcome.SOLVED:
        return ()
    verdict = state.reader.read(answer.x, {})
    if not isinstance(verdict, Conflict):
        return ()
    return tuple(sorted({item[0] for item in verdict.signs} | set(verdict.contacts)))


def _weaker_rules(solution: TorqueSolution) -> list[Suggestion]:
    """The first weaker sign rule, sliding rule, and Coulomb friction, where they help."""
    rules = solution.rules
    signs = list(SignRule)
    tried = [replace(rules, sign=sign) for sign in signs[signs.index(rules.sign) + 1 :]]
    if rules.sliding is SlidingRule.CONSTRAINED:
        tried.append(replace(rules, sliding=SlidingRule.EXEMPT))
    tried.append(replace(rules, static_friction=StaticFriction.COULOMB))
    found = []
    for other in tried:
        if _solved(solution.problem, solution, other, solution.required_margin).found:
            text = f"sign_rule='{other.sign}'"
            if other.sliding is not rules.sliding:
                text = f"sliding_rule='{other.sliding}'"
            if other.static_friction is StaticFriction.COULOMB:
                text = "static_friction='coulomb'"
            found.append(
                Suggestion(f"{text} is feasible", solution.problem, solution.required_margin, other)
            )
    return found


def _smaller_margin(solution: TorqueSolution) -> list[Suggestion]:
    """The largest margin that is feasible, where one is."""
    if solution.algorithm is Algorithm.MARGIN or solution.required_margin == 0.0:
        return []
    best = _solved(
        solution.problem,
        replace(solution, algorithm=Algorithm.MARGIN),
        solution.rules,
        0.0,
    )
    if not best.found:
        return []
    margin = max(0.0, best.margin / _ROOM - 1e-9)
    if not _solved(solution.problem, solution, solution.rules, margin).found:
        return []
    text = f"the required margin would have to be at most {margin:.4g} N"
    return [Suggestion(text, solution.problem, margin, solution.rules)]


def _reliefs(solution: TorqueSolution) -> Iterator[Suggestion]:
    """The smallest widening of each kind of limit that helps alone."""
    problem, margin = solution.problem, solution.required_margin
    coordinates, _ = shared_parts(problem)
    joints = list(range(problem.joint_count))
    alone = [(joint, given) for joint in joints if (given := _relief(solution, joint=joint))]
    for joint, given in sorted(alone, key=lambda item: item[1])[:3]:
        changed, limit = _wider(problem, [joint], given * coordinates.torque_scale)
        text = f"{problem.joint_names[joint]}'s limit would have to be {limit:.4g} N m"
        yield from _if_feasible(text, changed, solution, margin)
    if not alone and joints:
        given = _relief(solution, joint=-1)
        if given:
            more = given * coordinates.torque_scale
            changed, _ = _wider(problem, joints, more)
            text = f"every torque limit would have to be larger by {more:.4g} N m"
            yield from _if_feasible(text, changed, solution, margin)
    given = _relief(solution, normal=True)
    if given:
        more = given * coordinates.force_scale * _ROOM
        changed = problem.with_changes(max_normal_force=problem.max_normal_force + more)
        text = f"every normal-force limit would have to be larger by {more:.4g} N"
        yield from _if_feasible(text, changed, solution, margin)
    yield from _outside_help(solution)


def _outside_help(solution: TorqueSolution) -> Iterator[Suggestion]:
    """A wrench from outside that closes the balance."""
    problem = solution.problem
    coordinates, kinematics = shared_parts(problem)
    rows = force_rows(problem, coordinates)
    program = relief_program(
        rows, coordinates, solution.required_margin / coordinates.force_scale, wrench=True
    )
    formulation = Formulation(problem, coordinates, program, kinematics)
    best = branch_and_bound(SearchState(formulation, solution.rules, "piqp")).state.best
    if best is None:
        return
    missing = (rows.balance @ best.x[:-1] - rows.wrench) * coordinates.force_scale / rows.weight
    changed = problem.with_changes(external_wrench=problem.external_wrench - missing)
    force, moment = np.round(-missing[:3], 4) + 0.0, np.round(-missing[3:], 5) + 0.0
    text = (
        f"an outside help in the balance: force {force.tolist()} N and moment "
        f"{moment.tolist()} N m on the object"
    )
    yield from _if_feasible(text, changed, solution, solution.required_margin)


def _more_friction(solution: TorqueSolution) -> Iterator[Suggestion]:
    """A common factor on friction."""
    rules = solution.rules
    least = minimum_friction(
        solution.problem,
        **rules.options(),
    )
    if least.found:
        factor = least.factor * _ROOM
        changed = solution.problem.with_changes(friction=factor * solution.problem.friction)
        text = f"all friction coefficients would have to be {factor:.4g} times what they are"
        yield from _if_feasible(text, changed, solution, solution.required_margin)


def _relief(solution: TorqueSolution, *, joint: int | None = None, normal: bool = False) -> float:
    """Smallest relief of one kind over all modes, 0 if it does not help."""
    problem = solution.problem
    coordinates, kinematics = shared_parts(problem)
    margin = solution.required_margin / coordinates.force_scale
    rows = force_rows(problem, coordinates)
    program = relief_program(rows, coordinates, margin, joint=joint, normal=normal)
    formulation = Formulation(problem, coordinates, program, kinematics)
    best = branch_and_bound(SearchState(formulation, solution.rules, "piqp")).state.best
    return 0.0 if best is None else float(best.x[-1])


def _wider(
    problem: QuasistaticProblem, joints: list[int], more: float
) -> tuple[QuasistaticProblem, float]:
    """Return the problem with wider torque limits, and the largest of the new limits."""
    lower, upper = problem.lower_torque.copy(), problem.upper_torque.copy()
    for joint in joints:
        low, high = lower[joint], upper[joint]
        lower[joint] -= 0.0 if low == 0.0 < high else more * _ROOM
        upper[joint] += 0.0 if high == 0.0 > low else more * _ROOM
    finite = np.abs(np.concatenate([lower[joints], upper[joints]]))
    return (
        problem.with_changes(torque_limits=(lower, upper)),
        float(finite[np.isfinite(finite)].max(initial=0.0)),
    )


def _if_feasible(
    text: str, changed: QuasistaticProblem, solution: TorqueSolution, margin: float
) -> Iterator[Suggestion]:
    """Yield the suggestion if the changed problem is really feasible."""
    if _solved(changed, solution, solution.rules, margin).found:
        yield Suggestion(text, changed, margin, solution.rules)
