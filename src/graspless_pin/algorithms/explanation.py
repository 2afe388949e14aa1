"""Why nothing is feasible, in the user's terms, and the smallest changes that would help."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.formulation import formulate, formulated
from graspless_pin.algorithms.minimum_friction import smallest_factor
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search import SearchState
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.rules import Rules, SignRule, SlidingRule, StaticFriction
from graspless_pin.modes.verdicts import Conflict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.joint_units import JointUnit, units_text
from graspless_pin.programs.analysis_objectives import Elastic
from graspless_pin.programs.forces import ForceCoordinates
from graspless_pin.programs.objectives import Margin
from graspless_pin.solution import Status, TorqueSolution, checked_solution
from graspless_pin.solvers import ANY_SOLVER, PRIMAL_TOLERANCE, Outcome

_ROOM = 1.0 + 1e-6
"""A suggestion goes further by this, so that it is feasible and not just about to be."""
_DIGITS = 5
_COULOMB = StaticFriction.COULOMB
_FACTOR_STEP = 1e-4
"""To this the largest factor on friction below 1 is found."""


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
            changes = (f"- {suggestion.text}" for suggestion in self.suggestions)
            lines += ["Any one of these changes would do:", *changes]
        return "\n".join(lines)


def explain(solution: TorqueSolution) -> Explanation:
    """Explain why a solution was not found.

    Where the force balance itself fails, each kind of limit is relaxed alone (one joint's torque,
    all torques, normal forces, friction, the required margin, an outside help in the balance) by
    the smallest amount that makes some feasible mode work. Where only the virtual-sliding rule
    fails, the contacts in conflict are named and the weaker rules are tried; under ``direction``
    that and the required margin are all. Where no change is enough by itself, it is tried along
    with no required margin, with Coulomb friction, or with all others. See the example of `Status`.

    Args:
        solution: A solution that was not found.

    Returns:
        The cause and suggestions that were each solved and found feasible.

    Raises:
        ArgumentError: If it is no solution.
    """
    checked_solution(solution)
    if solution.found:
        return Explanation("The problem is feasible.", (), ())
    if solution.status not in (Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES):
        return Explanation(f"Not solved: {solution.status.message}.", (), ())
    conflicts, suggestions = tuple[int, ...](), list[Suggestion]()
    if solution.status is Status.INFEASIBLE_MODES:
        conflicts = () if solution.rules.by_direction else _conflicting_contacts(solution)
        named = ", ".join(str(contact) for contact in conflicts)
        cause = (
            "Forces that balance exist, but their friction has no kinematically feasible virtual "
            "sliding behind it"
        )
        cause += f": contacts {named} exclude each other." if conflicts else "."
        suggestions += _weaker_rules(solution)
    else:
        required = solution.required_margin
        cause = (
            "No contact forces inside the cones, normal-force and torque limits balance the "
            f"external wrench{f' with a margin of {required:g} N' if required > 0.0 else ''}."
        )
    suggestions += [*_smaller_margin(solution), *_reliefs(solution)]
    if not suggestions and not solution.rules.by_direction:
        cause += " No single change is enough."
        suggestions += _combined(solution)
    return Explanation(cause, conflicts, tuple(suggestions))


def _solved(
    problem: QuasistaticProblem, solution: TorqueSolution, rules: Rules, margin: float
) -> TorqueSolution:
    objective = solution.objective.with_figure("required_margin", margin)
    return solve_problem(problem, objective, SolveOptions(rules))


def _conflicting_contacts(solution: TorqueSolution) -> tuple[int, ...]:
    """Contacts in the conflict of the relaxation's optimum."""
    formulation = formulate(solution.problem, solution.objective)
    state = SearchState(formulation, solution.rules, ANY_SOLVER)
    answer = state.relax()
    if answer.outcome is not Outcome.SOLVED:
        return ()
    with suppress(UndecidedMotionError):
        verdict = state.oracle.mode_for(answer.x, {})
        if isinstance(verdict, Conflict):
            return tuple(sorted({item[0] for item in verdict.signs} | set(verdict.contacts)))
    return ()


def _weaker_rules(solution: TorqueSolution) -> list[Suggestion]:
    """Return the first weaker sign rule, sliding rule, and Coulomb friction, where they help."""
    rules, signs = solution.rules, [SignRule.DIRECTION, *list(SignRule)[:-1]]
    tried = [
        (f"sign_rule='{sign}'", replace(rules, sign=sign))
        for sign in signs[signs.index(rules.sign) + 1 :]
    ]
    if rules.sliding is SlidingRule.CONSTRAINED:
        tried.append(("sliding_rule='exempt'", replace(rules, sliding=SlidingRule.EXEMPT)))
    tried.append(("static_friction='coulomb'", replace(rules, static_friction=_COULOMB)))
    problem, margin = solution.problem, solution.required_margin
    return [
        Suggestion(f"{text} is feasible", problem, margin, other)
        for text, other in tried
        if _solved(problem, solution, other, margin).found
    ]


def _smaller_margin(solution: TorqueSolution) -> list[Suggestion]:
    """Return the largest margin that is feasible, where one is."""
    if solution.required_margin == 0.0:
        return []
    best = solve_problem(solution.problem, Margin(), SolveOptions(solution.rules))
    if not best.found:
        return []
    rounding = PRIMAL_TOLERANCE * solution.problem.scales.force
    margin = -_rounded_up(-best.margin / _ROOM) if best.margin > rounding else 0.0
    if not _solved(solution.problem, solution, solution.rules, margin).found:
        return []
    text = f"the required margin would have to be at most {margin:.{_DIGITS}g} N"
    return [Suggestion(text, solution.problem, margin, solution.rules)]


def _combined(solution: TorqueSolution) -> list[Suggestion]:
    """Single changes beside another one, and all changes at once as the last resort."""
    coulomb = replace(solution.rules, static_friction=_COULOMB)
    beside = [("with static_friction='coulomb'", replace(solution, rules=coulomb))]
    if solution.required_margin > 0.0:
        objective = solution.objective.with_figure("required_margin", 0.0)
        free = replace(solution, objective=objective)
        both = replace(free, rules=coulomb)
        beside.insert(0, ("with no required margin", free))
        beside.append(("with no required margin and static_friction='coulomb'", both))
    for words, weaker in beside:
        found = [replace(item, text=f"{words}, {item.text}") for item in _reliefs(weaker)]
        if found:
            return found
    return [*_everything(solution)]


def _reliefs(solution: TorqueSolution) -> Iterator[Suggestion]:
    """Yield the smallest widening of each kind of limit that helps alone."""
    if solution.rules.by_direction:
        return  # it is looked for mode by mode
    problem, joints = solution.problem, range(solution.problem.joint_count)
    alone = [(one, relief) for one in joints if (relief := _relief(solution, joint=one))]
    for joint, relief in sorted(alone, key=lambda item: item[1].amount)[:3]:
        torque = float(problem.jacobian[:, joint] @ relief.forces.ravel())
        yield from _wider_joint(solution, joint, torque + problem.gravity_torques[joint])
    if not alone and joints and (relief := _relief(solution, joint=-1)):
        more = _rounded_up(relief.amount * relief.coordinates.torque_scale * _ROOM)
        text = f"every torque limit would have to be larger by {_in_units(problem, more)}"
        yield from _if_feasible(text, _wider(problem, more), solution)
    if relief := _relief(solution, normal=True):
        more = _rounded_up(relief.amount * relief.coordinates.force_scale * _ROOM)
        changed = problem.with_changes(max_normal_force=problem.max_normal_force + more)
        text = f"every normal-force limit would have to be larger by {more:.{_DIGITS}g} N"
        yield from _if_feasible(text, changed, solution)
    if relief := _relief(solution, wrench=True):
        text, changed = _helped(problem, relief.forces)
        yield from _if_feasible(text, changed, solution)
    yield from _other_friction(solution)


def _everything(solution: TorqueSolution) -> Iterator[Suggestion]:
    """All limits widened and an outside help in the balance, at once."""
    problem = solution.problem
    relief = _relief(solution, joint=-1, normal=True, wrench=True)
    if relief is None:
        return
    text, changed = _helped(problem, relief.forces)
    normal = _rounded_up(relief.amount * relief.coordinates.force_scale * _ROOM)
    torque = _rounded_up(relief.amount * relief.coordinates.torque_scale * _ROOM)
    limits = problem.max_normal_force + normal
    changed = _wider(changed, torque).with_changes(max_normal_force=limits)
    text = (
        f"every torque limit larger by {_in_units(problem, torque)}, every normal-force limit by "
        f"{normal:.{_DIGITS}g} N, and {text}"
    )
    yield from _if_feasible(text, changed, solution)


def _helped(problem: QuasistaticProblem, forces: FloatArray) -> tuple[str, QuasistaticProblem]:
    """Return a wrench from outside that closes the balance of given forces."""
    help_ = -(problem.W @ forces.ravel() + problem.external_wrench)
    changed = problem.with_changes(external_wrench=problem.external_wrench + help_)
    force, moment = np.round(help_[:3], 4) + 0.0, np.round(help_[3:], 5) + 0.0
    text = (
        f"an outside help in the balance: force {force.tolist()} N and moment "
        f"{moment.tolist()} N m on the object"
    )
    return text, changed


def _other_friction(solution: TorqueSolution) -> Iterator[Suggestion]:
    """Yield a common factor on friction; below 1 where there is too much to push."""
    problem = solution.problem
    least, _ = smallest_factor(problem, solution.objective, SolveOptions(solution.rules))
    if not np.isfinite(least):
        return

    def scaled(factor: float) -> QuasistaticProblem:
        return problem.with_changes(friction=factor * problem.friction)

    factor = _rounded_up(least * _ROOM)
    if least < 1.0:  # the smallest change is the largest factor that is enough
        low, high = least, 1.0
        while high - low > _FACTOR_STEP:
            middle = 0.5 * (low + high)
            tried = _solved(scaled(middle), solution, solution.rules, solution.required_margin)
            low, high = (middle, high) if tried.found else (low, middle)
        factor = -_rounded_up(-low / _ROOM)
    text = f"all friction coefficients would have to be {factor:.{_DIGITS}g} times as large"
    if factor == 0.0:
        text = "the contacts would have to be without friction"
    yield from _if_feasible(text, scaled(factor), solution)


class _Relief(NamedTuple):
    """How much some limits give, scaled, and the forces that it makes room for, N."""

    amount: float
    forces: FloatArray
    coordinates: ForceCoordinates


def _relief(
    solution: TorqueSolution,
    *,
    joint: int | None = None,
    normal: bool = False,
    wrench: bool = False,
) -> _Relief | None:
    """Return the smallest relief of one kind; None if it does not help."""
    objective = Elastic(solution.required_margin, joint, normal, wrench)
    formulation = formulated(solution.problem, objective)
    state = SearchState(formulation, solution.rules, ANY_SOLVER)
    # What was found before a motion could not be decided on helps all the same.
    with suppress(UndecidedMotionError):
        branch_and_bound(state)
    best, coordinates = state.best, formulation.coordinates
    if best is None or best.value <= 0.0:
        return None
    return _Relief(best.value, coordinates.forces(best.x), coordinates)


def _wider_joint(solution: TorqueSolution, joint: int, torque: float) -> Iterator[Suggestion]:
    """Limits of one joint that let it make a torque: both where they are symmetric, else one."""
    problem = solution.problem
    lower, upper = problem.lower_torque.copy(), problem.upper_torque.copy()
    name, unit = problem.joint_names[joint], problem.joint_units[joint]
    room = (_ROOM - 1.0) * abs(torque)
    symmetric = lower[joint] == -upper[joint]
    if torque - upper[joint] > lower[joint] - torque:
        side, limit = "upper ", _rounded_up(torque + room)
        upper[joint] = limit
    else:
        side, limit = "lower ", -_rounded_up(room - torque)
        lower[joint] = limit
    if symmetric:
        side, limit = "", abs(limit)
        lower[joint], upper[joint] = -limit, limit
    text = f"{name}'s {side}limit would have to be {limit:.{_DIGITS}g} {unit}"
    yield from _if_feasible(text, problem.with_changes(torque_limits=(lower, upper)), solution)


def _in_units(problem: QuasistaticProblem, amount: float) -> str:
    """Return an amount of the torques of all joints with its unit."""
    units = units_text(problem.joint_units)
    return f"{amount:.{_DIGITS}g} {units if units in list(JointUnit) else f'({units})'}"


def _wider(problem: QuasistaticProblem, more: float) -> QuasistaticProblem:
    """Return the problem with every torque limit wider, but a limit of zero on one side only."""
    lower, upper = problem.lower_torque, problem.upper_torque
    lower = lower - np.where((lower == 0.0) & (upper != 0.0), 0.0, more)
    upper = upper + np.where((upper == 0.0) & (problem.lower_torque != 0.0), 0.0, more)
    return problem.with_changes(torque_limits=(lower, upper))


def _if_feasible(
    text: str, changed: QuasistaticProblem, solution: TorqueSolution
) -> Iterator[Suggestion]:
    """Yield the suggestion if the changed problem is really feasible."""
    if _solved(changed, solution, solution.rules, solution.required_margin).found:
        yield Suggestion(text, changed, solution.required_margin, solution.rules)


def _rounded_up(value: float) -> float:
    """Round up to the digits that are printed, so that the printed figure is enough."""
    if value == 0.0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(abs(value))) + 1 - _DIGITS)
    return float(f"{np.ceil(value / unit) * unit:.{_DIGITS}g}")
