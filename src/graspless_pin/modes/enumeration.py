"""Listing of all kinematically feasible virtual-sliding modes (B, S)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import (
    Rules,
    SignRule,
    SlidingMode,
    StaticFriction,
    candidate_contacts,
)
from graspless_pin.modes.verdicts import Requirement
from graspless_pin.problem import QuasistaticProblem, checked_problem


def enumerate_modes(
    problem: QuasistaticProblem,
    *,
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    maximal: bool = False,
) -> Iterator[SlidingMode]:
    """Yield every feasible virtual-sliding mode, lazily, depth first over the contacts.

    A restriction of a feasible mode to fewer contacts is feasible, so partial modes without a
    virtual motion are cut at once and the work grows with the number of feasible modes.

    Under ``exact`` a zero component is a sign of its own; under ``nonzero`` the signs are those of
    a closed quadrant that holds a nonzero sliding.

    Args:
        problem: The contacts and joints.
        sign_rule: ``strict``, ``exact`` or ``nonzero``.
        sliding_rule: ``exempt`` or ``constrained``; when constrained, contacts in actual sliding
            are selected in every mode.
        maximal: Only modes that no feasible mode extends. Those are enough for an optimum: a
            larger mode allows every force of a smaller one.

    Raises:
        ArgumentError: If a rule is not known or lists no modes.

    Examples:
        >>> from graspless_pin import load_scene, enumerate_modes
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> sum(1 for _ in enumerate_modes(problem, maximal=True))
        262
    """
    checked_problem(problem)
    rules = Rules.parse(sign_rule, sliding_rule, StaticFriction.VIRTUAL_SLIDING)
    rules.need_signs("enumerate_modes")
    return feasible_modes(problem, VirtualKinematics(problem), rules, maximal=maximal)


def feasible_modes(
    problem: QuasistaticProblem, kinematics: VirtualKinematics, rules: Rules, *, maximal: bool
) -> Iterator[SlidingMode]:
    """Yield the modes of `enumerate_modes` for known kinematics and rules."""
    return (
        mode_of(problem, requirements)
        for requirements in _feasible(problem, kinematics, rules)
        if not (maximal and _extensible(problem, kinematics, rules, requirements))
    )


def sign_pairs(rule: SignRule) -> list[tuple[int, int]]:
    """Return the sign pairs that a selected contact can have under a rule."""
    values = (1, 0, -1) if rule is SignRule.EXACT else (1, -1)
    return [(a, b) for a, b in product(values, values) if (a, b) != (0, 0)]


def requirements_of(mode: SlidingMode) -> tuple[Requirement, ...]:
    """Return what a mode asks of the virtual motion, contact by contact."""
    return tuple(
        Requirement(int(contact), (int(mode.signs[contact, 0]), int(mode.signs[contact, 1])))
        for contact in np.flatnonzero(mode.selection)
    )


def mode_of(problem: QuasistaticProblem, requirements: tuple[Requirement, ...]) -> SlidingMode:
    """Return the mode that selects the contacts of the requirements with their signs."""
    selection = np.zeros(problem.contact_count, dtype=bool)
    signs = np.zeros((problem.contact_count, 2), dtype=np.int8)
    for requirement in requirements:
        selection[requirement.contact] = True
        signs[requirement.contact] = requirement.signs
    return SlidingMode.unchecked(selection, signs)


def _feasible(
    problem: QuasistaticProblem, kinematics: VirtualKinematics, rules: Rules
) -> Iterator[tuple[Requirement, ...]]:
    candidates = [int(contact) for contact in np.flatnonzero(candidate_contacts(problem, rules))]
    pairs = sign_pairs(rules.sign)
    # Depth first with an explicit stack: (how many candidates are decided, their requirements).
    stack: list[tuple[int, tuple[Requirement, ...]]] = [(0, ())]
    while stack:
        depth, requirements = stack.pop()
        if depth == len(candidates):
            yield requirements
            continue
        contact = candidates[depth]
        children = []
        if not problem.is_sliding[contact]:
            children.append((depth + 1, requirements))
        for pair in pairs:
            extended = (*requirements, Requirement(contact, pair))
            if kinematics.feasible(extended, rules.sign):
                children.append((depth + 1, extended))
        stack.extend(reversed(children))


def _extensible(
    problem: QuasistaticProblem,
    kinematics: VirtualKinematics,
    rules: Rules,
    requirements: tuple[Requirement, ...],
) -> bool:
    """Return whether one more selected contact, or a sign in place of a zero, is feasible."""
    chosen = {requirement.contact for requirement in requirements}
    for contact in np.flatnonzero(candidate_contacts(problem, rules)):
        if contact in chosen:
            continue
        for pair in sign_pairs(rules.sign):
            extended = (*requirements, Requirement(int(contact), pair))
            if kinematics.feasible(extended, rules.sign):
                return True
    for index, requirement in enumerate(requirements):
        for pair in _refinements(requirement.signs):
            refined = (
                *requirements[:index],
                Requirement(requirement.contact, pair),
                *requirements[index + 1 :],
            )
            if kinematics.feasible(refined, rules.sign):
                return True
    return False


def _refinements(signs: tuple[int, int]) -> list[tuple[int, int]]:
    """Sign pairs that replace the zero of a pair."""
    if signs[0] == 0:
        return [(1, signs[1]), (-1, signs[1])]
    if signs[1] == 0:
        return [(signs[0], 1), (signs[0], -1)]
    return []
