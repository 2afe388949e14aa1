"""Parts of the set of all modes, as a proof splits them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graspless_pin.modes.kinematics import Requirement
from graspless_pin.modes.rules import (
    Rules,
    SignRule,
    SlidingMode,
    SlidingRule,
    candidate_contacts,
)
from graspless_pin.problem import QuasistaticProblem

SignItem = tuple[int, int, int]
"""Contact, component and sign of a virtual sliding; the sign 0: the contact is selected."""


@dataclass(frozen=True, eq=False)
class ModePart:
    """All modes that select some contacts, leave others, and have certain signs.

    Attributes:
        selected: (M,) contacts that each of the modes selects.
        released: (M,) contacts that none of them selects.
        minus: (M, 2) whether a contact, if selected, may have the sign -1 along t1, t2.
        zero: (M, 2) whether it may have the sign 0.
        plus: (M, 2) whether it may have the sign 1.
    """

    selected: NDArray[np.bool_]
    released: NDArray[np.bool_]
    minus: NDArray[np.bool_]
    zero: NDArray[np.bool_]
    plus: NDArray[np.bool_]

    @classmethod
    def every_mode(cls, problem: QuasistaticProblem, rules: Rules) -> ModePart:
        """Return all modes that obey the rules on signs and selections."""
        every = np.ones((problem.contact_count, 2), dtype=bool)
        always = problem.is_sliding & (rules.sliding is SlidingRule.CONSTRAINED)
        zero = every & (rules.sign is SignRule.EXACT)
        return cls(always, ~candidate_contacts(problem, rules), every, zero, every)

    @classmethod
    def one_mode(cls, mode: SlidingMode) -> ModePart:
        """Return one mode alone."""
        signs = mode.signs
        return cls(mode.selection, ~mode.selection, signs < 0, signs == 0, signs > 0)

    def knows(self, contact: int) -> bool:
        """Whether all its modes agree on a contact: released, or selected with the same signs."""
        is_one = all(len(self.left(contact, component)) == 1 for component in range(2))
        return bool(self.released[contact] or (self.selected[contact] and is_one))

    def signs(self, contact: int) -> tuple[int, int]:
        """Signs of a contact that all its modes have; 0 where there are several, or zero is."""
        first, second = self.left(contact, 0), self.left(contact, 1)
        return first[0] if len(first) == 1 else 0, second[0] if len(second) == 1 else 0

    def requirements(self) -> list[Requirement]:
        """Return what all its modes ask of the virtual motion."""
        return [Requirement(c, self.signs(c)) for c in np.flatnonzero(self.selected).tolist()]

    def left(self, contact: int, component: int) -> list[int]:
        """Return the signs along one tangent that are left to a contact."""
        ways = zip((-1, 0, 1), (self.minus, self.zero, self.plus), strict=True)
        return [sign for sign, there in ways if there[contact, component]]

    def pairs(self, contact: int) -> list[tuple[int, int]]:
        """Return the pairs of signs that are left to a contact."""
        first, second = self.left(contact, 0), self.left(contact, 1)
        return [(a, b) for a in first for b in second if a or b]

    def holding(self, item: SignItem) -> ModePart | None:
        """Return the modes of it that have an item; None: none does."""
        contact, component, sign = item
        selected = self.selected.copy()
        selected[contact] = True
        part = replace(self, selected=selected)
        if sign:
            part = part._only(contact, component, sign)
        return part._settled(contact)

    def breaking(self, item: SignItem) -> ModePart | None:
        """Return the modes of it that lack an item; None: none does."""
        contact, component, sign = item
        if not sign:
            released = self.released.copy()
            released[contact] = True
            return replace(self, released=released)._settled(contact)
        name = "minus" if sign < 0 else "plus"
        there = getattr(self, name).copy()
        there[contact, component] = False
        return replace(self, **{name: there})._settled(contact)

    def with_pair(self, contact: int, pair: tuple[int, int]) -> ModePart | None:
        """Return the modes of it that select a contact with two signs."""
        part = self.holding((contact, 0, 0))
        for component, sign in enumerate(pair):
            part = part and part._only(contact, component, sign)._settled(contact)
        return part

    def _only(self, contact: int, component: int, sign: int) -> ModePart:
        ways = {}
        for name, value in (("minus", -1), ("zero", 0), ("plus", 1)):
            there = getattr(self, name).copy()
            there[contact, component] &= sign == value
            ways[name] = there
        return replace(self, **ways)

    def _settled(self, contact: int) -> ModePart | None:
        """Return the part, a contact without signs released; None: it holds no mode."""
        if self.pairs(contact):
            return None if self.selected[contact] and self.released[contact] else self
        if self.selected[contact]:
            return None
        released = self.released.copy()
        released[contact] = True
        return replace(self, released=released)
