"""Why a problem is infeasible, and the smallest single changes that make it feasible.

Each suggestion was solved and found feasible; all searches share one time limit.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.comparison import smallest_factor
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search_state import SearchState
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.rules import (
    Blocked,
    Conflict,
    Rules,
    SignRule,
    SlidingRule,
    StaticFriction,
)
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, JointUnit, units_text
from graspless_pin.problem.matrices import load_words
from graspless_pin.programs.analysis_objectives import LimitRelief
from graspless_pin.programs.forces import ForceCoordinates
from graspless_pin.programs.objectives import Margin
from graspless_pin.solution import Status, TorqueSolution, checked_solution
from graspless_pin.solution.certificate import EXPLAINED, UNDECIDED
from graspless_pin.solution.torque_solution import overload
from graspless_pin.solvers import PRIMAL_TOLERANCE, Outcome
from graspless_pin.tree_search import Limits

SUGGESTION_ROOM = 1.0 + 1e-6
"""Factor on the smallest change, so that a suggestion is feasible and not just at the limit."""
SUGGESTION_DIGITS = 5


def extra_wrench(problem: QuasistaticProblem, forces: FloatArray) -> tuple[str, QuasistaticProblem]:
    """Return the text and the problem of an extra wrench that balances given forces."""
    help_ = -(problem.W @ forces.ravel() + problem.external_wrench)
    changed = problem.with_changes(external_wrench=problem.external_wrench + help_)
    words = load_words(help_, problem.passive_units, joined=" and ")
    where = "object" if problem.wrench_matrix is None else "passive coordinates"
    return f"an extra external wrench: {words} on the {where}", changed


def wider_joint_limit(
    problem: QuasistaticProblem, joint: int, torque: float
) -> tuple[str, QuasistaticProblem]:
    """Return text and problem with limits of a joint that allow a torque: both if symmetric."""
    lower, upper = problem.lower_torque.copy(), problem.upper_torque.copy()
    name, unit = problem.joint_names[joint], problem.joint_units[joint]
    reserve = (SUGGESTION_ROOM - 1.0) * abs(torque)
    symmetric = lower[joint] == -upper[joint]
    if torque - upper[joint] > lower[joint] - torque:
        side, limit = "upper ", rounded_up(torque + reserve)
        upper[joint] = limit
    else:
        side, limit = "lower ", -rounded_up(reserve - torque)
        lower[joint] = limit
    if symmetric:
        side, limit = "", abs(limit)
        lower[joint], upper[joint] = -limit, limit
    text = f"{name}'s {side}torque limit would have to be {limit:.{SUGGESTION_DIGITS}g} {unit}"
    return text, problem.with_changes(torque_limits=(lower, upper))


def torque_text(problem: QuasistaticProblem, amount: float) -> str:
    """Return an amount of the torques of all joints with its unit."""
    units = units_text(problem.joint_units)
    return f"{amount:.{SUGGESTION_DIGITS}g} {units if units in list(JointUnit) else f'({units})'}"


def wider_torque_limits(problem: QuasistaticProblem, more: float) -> QuasistaticProblem:
    """Return the problem with all torque limits wider, except a zero limit on one side."""
    lower, upper = problem.lower_torque, problem.upper_torque
    lower = lower - np.where((lower == 0.0) & (upper != 0.0), 0.0, more)
    upper = upper + np.where((upper == 0.0) & (problem.lower_torque != 0.0), 0.0, more)
    return problem.with_changes(torque_limits=(lower, upper))


def rounded_up(value: float) -> float:
    """Round up to the digits that are printed, so that the printed figure is enough."""
    if value == 0.0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(abs(value))) + 1 - SUGGESTION_DIGITS)
    return float(f"{np.ceil(value / unit) * unit:.{SUGGESTION_DIGITS}g}")


class ChangeSearches:
    """The searches for changes that help, under one common limit.

    Attributes:
        limits: Limits of all of them.
        cut_short: Whether one of them was ended by a limit, or not begun.
    """

    def __init__(self, options: SolveOptions) -> None:
        """Start the time limit."""
        self.limits = Limits.from_options(options)
        self.cut_short = False

    def options(self, rules: Rules) -> SolveOptions | None:
        """Return the options of the next solve; None: the time is over."""
        if self.limits.is_time_over:
            self.cut_short = True
            return None
        return self.limits.with_time_left(SolveOptions(rules, node_limit=self.limits.node_limit))

    def note_status(self, status: Status) -> None:
        """Note whether a search ended early, by its status."""
        self.cut_short |= status in (Status.LIMIT_REACHED, *UNDECIDED)

    def is_feasible(
        self, problem: QuasistaticProblem, solution: TorqueSolution, rules: Rules, margin: float
    ) -> bool:
        """Return whether a problem is found feasible under given rules and margin."""
        options = self.options(rules)
        if options is None:
            return False
        objective = solution.objective.with_figure("required_margin", margin)
        found = solve_problem(problem, objective, options)
        self.note_status(found.status)
        return found.found


_BRIEF_NODES = 1000
_BRIEF_SECONDS = 10.0
"""Limits of an explanation that is printed or written along with an answer."""
_COULOMB = StaticFriction.COULOMB
_FACTOR_STEP = 1e-4
"""Tolerance of the largest factor on friction below 1."""


@dataclass(frozen=True, eq=False)
class Suggestion:
    """A change that makes the problem feasible; it was tried. See the example of `Status`.

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
    """Why a problem is infeasible. See the example of `Status`.

    Attributes:
        cause: One sentence.
        conflicting_contacts: Contacts whose virtual slidings exclude each other, if that is why.
        suggestions: Changes that help, each enough by itself.
        complete: Whether every search was completed; else other or smaller changes may help.
    """

    cause: str
    conflicting_contacts: tuple[int, ...]
    suggestions: tuple[Suggestion, ...]
    complete: bool = True

    def __str__(self) -> str:
        """Return the cause and the suggestions, a line each."""
        lines = [self.cause]
        if self.suggestions:
            changes = (f"- {suggestion.text}" for suggestion in self.suggestions)
            lines += ["Any one of these changes makes the problem feasible:", *changes]
        if not self.complete:
            lines.append(
                "A limit ended the search for changes: others, or smaller ones, may be enough, too."
            )
        return "\n".join(lines)


def explain(
    solution: TorqueSolution, *, node_limit: int | None = None, time_limit: float | None = None
) -> Explanation:
    """Explain why a solution was not found.

    Where the force balance itself fails, each kind of limit is relaxed alone (one joint's torque,
    all torques, normal forces, friction, the required margin, an extra external wrench) by
    the smallest amount that makes some mode feasible. Where only the virtual-sliding rule fails,
    the contacts in conflict are named and the weaker rules are tried; under ``direction`` only
    these and the required margin. Where no single change is enough, each is tried without a
    required margin, with Coulomb friction, and all are tried together. See the example of `Status`.

    Args:
        solution: A solution that was not found.
        node_limit: Nodes after which each search for a change ends.
        time_limit: Seconds after which all of them end.

    Returns:
        The cause and suggestions that were each solved and found feasible.

    Raises:
        ArgumentError: If it is no solution, or a limit out of range.
    """
    checked_solution(solution)
    searches = ChangeSearches(SolveOptions.parse(node_limit=node_limit, time_limit=time_limit))
    if solution.found:
        return Explanation("The problem is feasible.", (), ())
    if solution.status is Status.LOAD_TOO_LARGE:
        return Explanation(f"Not solved: {overload(solution.problem)}.", (), ())
    if solution.status not in EXPLAINED:
        head = "Not solved" if solution.status in UNDECIDED else "Not explained further"
        return Explanation(f"{head}: {solution.status.message}.", (), ())
    conflicts, suggestions = tuple[int, ...](), list[Suggestion]()
    if solution.status is Status.INFEASIBLE_MODES:
        conflicts = () if solution.rules.by_direction else _conflicting_contacts(solution)
        named = ", ".join(str(contact) for contact in conflicts)
        cause = (
            "Contact forces balance the external wrench, but no kinematically feasible virtual "
            "sliding justifies their friction"
        )
        cause += f": contacts {named} exclude each other." if conflicts else "."
        suggestions += _weaker_rules(solution, searches)
    else:
        required = solution.required_margin
        cause = (
            "No contact forces inside the friction cones, the normal-force limits and the torque "
            "limits balance the external wrench"
            f"{f' with a margin of {required:g} N' if required > 0.0 else ''}."
        )
    suggestions += [*_smaller_margins(solution, searches), *_reliefs(solution, searches)]
    if not suggestions and not solution.rules.by_direction:
        cause += "" if searches.cut_short else " No single change is enough."
        suggestions += _combined_changes(solution, searches)
    return Explanation(cause, conflicts, tuple(suggestions), not searches.cut_short)


def explained_briefly(solution: TorqueSolution) -> str:
    """Return why a solution was not found, by short searches; empty if the status is enough."""
    if solution.status not in (*EXPLAINED, Status.LOAD_TOO_LARGE):
        return ""
    return str(explain(solution, node_limit=_BRIEF_NODES, time_limit=_BRIEF_SECONDS))


def _conflicting_contacts(solution: TorqueSolution) -> tuple[int, ...]:
    """Return the contacts in the conflict of the relaxation's optimum."""
    formulation = formulate(solution.problem, solution.objective)
    state = SearchState(formulation, SolveOptions(solution.rules))
    answer = state.relax()
    if answer.outcome is not Outcome.SOLVED:
        return ()
    with suppress(UndecidedMotionError):
        verdict = state.oracle.mode_for(answer.x)
        if isinstance(verdict, Conflict | Blocked):
            return tuple(sorted(verdict.involved))
    return ()


def _weaker_rules(solution: TorqueSolution, searches: ChangeSearches) -> list[Suggestion]:
    """Return weaker sign and sliding rules, and Coulomb friction, where they make it feasible."""
    rules = solution.rules
    # Each is weaker than those before it.
    signs = (SignRule.DIRECTION, SignRule.STRICT, SignRule.EXACT, SignRule.NONZERO)
    tried = [
        (f"sign_rule='{sign}'", replace(rules, sign=sign))
        for sign in signs[signs.index(rules.sign) + 1 :]
    ]
    if rules.sliding is SlidingRule.CONSTRAINED:
        tried.append(("sliding_rule='exempt'", replace(rules, sliding=SlidingRule.EXEMPT)))
    tried.append(("static_friction='coulomb'", replace(rules, static_friction=_COULOMB)))
    problem, margin = solution.problem, solution.required_margin
    return [
        Suggestion(f"solving with {text}", problem, margin, other)
        for text, other in tried
        if searches.is_feasible(problem, solution, other, margin)
    ]


def _smaller_margins(solution: TorqueSolution, searches: ChangeSearches) -> list[Suggestion]:
    """Return the largest feasible margin as a suggestion, if there is one."""
    options = searches.options(solution.rules)
    if solution.required_margin == 0.0 or options is None:
        return []
    best = solve_problem(solution.problem, Margin(), options)
    searches.note_status(best.status)
    if not best.found:
        return []
    rounding = PRIMAL_TOLERANCE * solution.problem.scales.force
    margin = -rounded_up(-best.margin / SUGGESTION_ROOM) if best.margin > rounding else 0.0
    if not searches.is_feasible(solution.problem, solution, solution.rules, margin):
        return []
    text = f"the required margin would have to be at most {margin:.{SUGGESTION_DIGITS}g} N"
    return [Suggestion(text, solution.problem, margin, solution.rules)]


def _combined_changes(solution: TorqueSolution, searches: ChangeSearches) -> list[Suggestion]:
    """Return single changes combined with weaker demands; if none helps, all at once."""
    coulomb = replace(solution.rules, static_friction=_COULOMB)
    variants = [("with static_friction='coulomb'", replace(solution, rules=coulomb))]
    if solution.required_margin > 0.0:
        free = replace(solution, objective=solution.objective.with_figure("required_margin", 0.0))
        weakest = replace(free, rules=coulomb)
        variants.insert(0, ("with no required margin", free))
        variants.append(("with no required margin and static_friction='coulomb'", weakest))
    for words, weaker in variants:
        found = [replace(item, text=f"{words}, {item.text}") for item in _reliefs(weaker, searches)]
        if found:
            return found
    return [*_all_limits_widened(solution, searches)]


def _reliefs(solution: TorqueSolution, searches: ChangeSearches) -> Iterator[Suggestion]:
    """Yield the smallest relaxation of each kind of limit that is enough by itself."""
    if solution.rules.by_direction:
        return  # reliefs are searched over modes (B, S)
    problem, joints = solution.problem, tuple(range(solution.problem.joint_count))
    alone = [(one, relief) for one in joints if (relief := _relief(solution, searches, (one,)))]
    for joint, relief in sorted(alone, key=lambda item: item[1].amount)[:3]:
        torque = float(problem.jacobian[:, joint] @ relief.forces.ravel())
        text, changed = wider_joint_limit(problem, joint, torque + problem.gravity_torques[joint])
        yield from _feasible_suggestion(text, changed, solution, searches)
    if not alone and joints and (relief := _relief(solution, searches, joints)):
        more = rounded_up(relief.amount * relief.coordinates.torque_scale * SUGGESTION_ROOM)
        text = f"every torque limit would have to be larger by {torque_text(problem, more)}"
        yield from _feasible_suggestion(
            text, wider_torque_limits(problem, more), solution, searches
        )
    if relief := _relief(solution, searches, normal=True):
        more = rounded_up(relief.amount * relief.coordinates.force_scale * SUGGESTION_ROOM)
        changed = problem.with_changes(max_normal_force=problem.max_normal_force + more)
        text = f"every normal-force limit would have to be larger by {more:.{SUGGESTION_DIGITS}g} N"
        yield from _feasible_suggestion(text, changed, solution, searches)
    if relief := _relief(solution, searches, wrench=True):
        text, changed = extra_wrench(problem, relief.forces)
        yield from _feasible_suggestion(text, changed, solution, searches)
    yield from _friction_changes(solution, searches)


def _all_limits_widened(solution: TorqueSolution, searches: ChangeSearches) -> Iterator[Suggestion]:
    """Yield one suggestion: all limits wider and an extra external wrench, at once."""
    problem = solution.problem
    joints = tuple(range(problem.joint_count))
    relief = _relief(solution, searches, joints, normal=True, wrench=True)
    if relief is None:
        return
    text, changed = extra_wrench(problem, relief.forces)
    normal = rounded_up(relief.amount * relief.coordinates.force_scale * SUGGESTION_ROOM)
    torque = rounded_up(relief.amount * relief.coordinates.torque_scale * SUGGESTION_ROOM)
    limits = problem.max_normal_force + normal
    changed = wider_torque_limits(changed, torque).with_changes(max_normal_force=limits)
    text = (
        f"every torque limit larger by {torque_text(problem, torque)}, every normal-force limit by "
        f"{normal:.{SUGGESTION_DIGITS}g} N, and {text}"
    )
    yield from _feasible_suggestion(text, changed, solution, searches)


def _friction_changes(solution: TorqueSolution, searches: ChangeSearches) -> Iterator[Suggestion]:
    """Yield a common factor on friction that is enough; below 1 where friction is too large."""
    problem = solution.problem
    options = searches.options(solution.rules)
    if options is None:
        return
    found = smallest_factor(problem, solution.objective, options)
    searches.cut_short |= not found.proven
    if not found.found:
        return

    def scaled(factor: float) -> QuasistaticProblem:
        return problem.with_changes(friction=factor * problem.friction)

    factor = rounded_up(found.factor * SUGGESTION_ROOM)
    if found.factor < 1.0:  # the smallest change is the largest factor that is enough
        low, high = found.factor, 1.0
        while high - low > _FACTOR_STEP:
            middle = 0.5 * (low + high)
            holds = searches.is_feasible(
                scaled(middle), solution, solution.rules, solution.required_margin
            )
            low, high = (middle, high) if holds else (low, middle)
        factor = -rounded_up(-low / SUGGESTION_ROOM)
    text = (
        f"all friction coefficients would have to be {factor:.{SUGGESTION_DIGITS}g} times as large"
    )
    if factor == 0.0:
        text = "all friction coefficients would have to be 0"
    yield from _feasible_suggestion(text, scaled(factor), solution, searches)


class _Relief(NamedTuple):
    """The smallest relaxation of some limits, scaled, and the forces (M, 3) that it allows, N."""

    amount: float
    forces: FloatArray
    coordinates: ForceCoordinates


def _relief(
    solution: TorqueSolution,
    searches: ChangeSearches,
    joints: tuple[int, ...] = (),
    *,
    normal: bool = False,
    wrench: bool = False,
) -> _Relief | None:
    """Return the smallest relief of one kind; None: none was found, or none is needed."""
    options = searches.options(solution.rules)
    if options is None:
        return None
    objective = LimitRelief(solution.required_margin, joints, normal, wrench)
    formulation = formulate(solution.problem, objective)
    state = SearchState(formulation, options, searches.limits)
    # The best answer so far is of use even where a motion could not be decided.
    try:
        searches.note_status(branch_and_bound(state))
    except UndecidedMotionError:
        searches.cut_short = True
    best, coordinates = state.best, formulation.coordinates
    if best is None or best.value <= 0.0:
        return None
    return _Relief(best.value, coordinates.forces(best.x), coordinates)


def _feasible_suggestion(
    text: str, changed: QuasistaticProblem, solution: TorqueSolution, searches: ChangeSearches
) -> Iterator[Suggestion]:
    """Yield the suggestion if the changed problem is found feasible."""
    if searches.is_feasible(changed, solution, solution.rules, solution.required_margin):
        yield Suggestion(text, changed, solution.required_margin, solution.rules)
