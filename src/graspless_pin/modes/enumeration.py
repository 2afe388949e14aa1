"""Listing of all kinematically feasible virtual-sliding modes (B, S)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from graspless_pin.errors import OverrunError
from graspless_pin.modes.feasibility import Requirement
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import (
    Rules,
    SignRule,
    SlidingMode,
    StaticFriction,
    candidate_contacts,
)
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import real_number, whole_number
from graspless_pin.tree_search import Limits, TreeSearch


def enumerate_modes(
    problem: QuasistaticProblem,
    *,
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    maximal: bool = False,
    node_limit: int | None = None,
    time_limit: float | None = None,
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
        node_limit: Partial modes whose virtual motion may be asked for; None: any number.
        time_limit: Seconds from the first mode that is asked for; None: no limit.

    Raises:
        ArgumentError: If a rule is not known or lists no modes, or a limit is out of range.
        OverrunError: While modes are listed, where a limit ends that before the last one.

    Examples:
        >>> from graspless_pin import load_scene, enumerate_modes
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> sum(1 for _ in enumerate_modes(problem, maximal=True))
        262
    """
    checked_problem(problem)
    rules = Rules.parse(sign_rule, sliding_rule, StaticFriction.VIRTUAL_SLIDING)
    rules.need_signs("enumerate_modes")
    nodes = None if node_limit is None else whole_number("node_limit", node_limit, 0)
    if time_limit is not None:
        time_limit = real_number("time_limit", time_limit, 0.0, finite=False)
    return _limited(problem, rules, maximal, nodes, time_limit)


def _limited(
    problem: QuasistaticProblem,
    rules: Rules,
    maximal: bool,
    nodes: int | None,
    seconds: float | None,
) -> Iterator[SlidingMode]:
    is_over = Limits.from_now(nodes, seconds).end
    yield from feasible_modes(
        problem, VirtualKinematics(problem), rules, maximal=maximal, is_over=is_over
    )


def feasible_modes(
    problem: QuasistaticProblem,
    kinematics: VirtualKinematics,
    rules: Rules,
    *,
    maximal: bool,
    is_over: Callable[[int], bool],
) -> Iterator[SlidingMode]:
    """Yield the modes of `enumerate_modes` for known kinematics and rules.

    Args:
        problem: The contacts and joints.
        kinematics: Their virtual motions.
        rules: That list modes.
        maximal: Only modes that no feasible mode extends.
        is_over: Tells after so many partial modes whether the listing has to end.

    Raises:
        OverrunError: Where it has to end before the last mode.
    """
    listing = _Listing(problem, kinematics, rules, is_over)
    return (
        mode_of(problem, requirements)
        for requirements in listing.feasible()
        if not (maximal and listing.extensible(requirements))
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


class _Listing:
    """One listing of modes, and how many partial ones it asked for."""

    def __init__(
        self,
        problem: QuasistaticProblem,
        kinematics: VirtualKinematics,
        rules: Rules,
        is_over: Callable[[int], bool],
    ) -> None:
        self.problem, self.kinematics, self.rules = problem, kinematics, rules
        self.is_over, self.asked = is_over, 0

    def feasible(self) -> Iterator[tuple[Requirement, ...]]:
        """Yield what every feasible mode asks of the virtual motion."""
        candidates = np.flatnonzero(candidate_contacts(self.problem, self.rules)).tolist()
        pairs = sign_pairs(self.rules.sign)
        # A node: how many candidates are decided, and what is required of them.
        search = TreeSearch[tuple[int, tuple[Requirement, ...]]]([(0, ())])
        for _, (depth, requirements) in search:
            if depth == len(candidates):
                yield requirements
                continue
            contact = candidates[depth]
            children = []
            if not self.problem.is_sliding[contact]:
                children.append((depth + 1, requirements))
            for pair in pairs:
                extended = (*requirements, Requirement(contact, pair))
                if self._is_feasible(extended):
                    children.append((depth + 1, extended))
            search.add(reversed(children))

    def extensible(self, requirements: tuple[Requirement, ...]) -> bool:
        """Return whether one more selected contact, or a sign in place of a zero, is feasible."""
        chosen = {requirement.contact for requirement in requirements}
        for contact in np.flatnonzero(candidate_contacts(self.problem, self.rules)).tolist():
            if contact in chosen:
                continue
            for pair in sign_pairs(self.rules.sign):
                if self._is_feasible((*requirements, Requirement(contact, pair))):
                    return True
        for index, requirement in enumerate(requirements):
            for pair in _refinements(requirement.signs):
                refined = (
                    *requirements[:index],
                    Requirement(requirement.contact, pair),
                    *requirements[index + 1 :],
                )
                if self._is_feasible(refined):
                    return True
        return False

    def _is_feasible(self, requirements: tuple[Requirement, ...]) -> bool:
        if self.is_over(self.asked):
            raise OverrunError(f"the limit ended the listing after {self.asked} partial modes")
        self.asked += 1
        return self.kinematics.feasible(requirements, self.rules.sign)


def _refinements(signs: tuple[int, int]) -> list[tuple[int, int]]:
    """Sign pairs that replace the zero of a pair."""
    if signs[0] == 0:
        return [(1, signs[1]), (-1, signs[1])]
    if signs[1] == 0:
        return [(signs[0], 1), (signs[0], -1)]
    return []
