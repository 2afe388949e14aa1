"""Parts of the set of all modes: which contacts are selected, and which signs are left to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from graspless_pin.report.verify.problem import Problem

_SIGNS = (-1, 0, 1)


@dataclass(frozen=True, eq=False)
class State:
    """All modes that select some contacts, do not select others, and have some signs.

    Attributes:
        selected: (M,) contacts that every mode of it selects.
        released: (M,) contacts that none of them selects.
        left: (M, 2, 3) whether the signs -1, 0, 1 along t1 and t2 are left to a contact if it is
            selected.
        exact: Whether one sign of a contact may be 0.
        free: Whether friction needs no virtual sliding at all.
    """

    selected: np.ndarray
    released: np.ndarray
    left: np.ndarray
    exact: bool
    free: bool = False

    @classmethod
    def every_mode(cls, problem: Problem, *, free: bool) -> State:
        """Return all modes that the rules let exist; ``free``: all friction, without any rule."""
        exact = problem.sign_rule == "exact"
        left = np.ones((problem.count, 2, 3), dtype=bool)
        left[:, :, 1] = exact
        always = problem.slides & problem.constrained
        return cls(always, ~problem.candidates, left, exact, free)

    @classmethod
    def one_mode(cls, problem: Problem, selected: np.ndarray, signs: np.ndarray) -> State:
        """Return one mode alone."""
        left = signs[:, :, None] == np.array(_SIGNS)
        return cls(selected, ~selected, left, problem.sign_rule == "exact")

    @property
    def known_signs(self) -> np.ndarray:
        """(M, 2) the sign that is left if it is the only one; else 0."""
        only = self.left.sum(axis=2) == 1
        return np.where(only, self.left[:, :, 2].astype(int) - self.left[:, :, 0], 0)

    @property
    def known_zeros(self) -> np.ndarray:
        """(M, 2) components where only the sign 0 is left."""
        return self.left[:, :, 1] & (self.left.sum(axis=2) == 1)

    @property
    def friction(self) -> np.ndarray:
        """(M, 2, 2) whether friction may be negative, positive: opposite to the sliding."""
        if self.free:
            return np.ones((len(self.selected), 2, 2), dtype=bool)
        return self.left[:, :, [2, 0]] & ~self.released[:, None, None]

    def select(self, contact: int) -> State | None:
        """Return the modes of it that select a contact; None: there is none."""
        selected = self.selected.copy()
        selected[contact] = True
        return replace(self, selected=selected)._settled(contact)

    def release(self, contact: int) -> State | None:
        """Return the modes of it that do not select a contact."""
        released = self.released.copy()
        released[contact] = True
        return replace(self, released=released)._settled(contact)

    def keep(self, contact: int, component: int, sign: int) -> State | None:
        """Return the modes of it that select a contact with a sign."""
        left = self.left.copy()
        left[contact, component] &= np.array(_SIGNS) == sign
        return replace(self, left=left).select(contact)

    def without(self, contact: int, component: int, sign: int) -> State | None:
        """Return the modes of it that do not select a contact, or with another sign."""
        left = self.left.copy()
        left[contact, component, sign + 1] = False
        return replace(self, left=left)._settled(contact)

    def pairs(self, contact: int) -> list[tuple[int, int]]:
        """Return the pairs of signs that are left to a contact, in the order of -1, 0, 1."""
        first, second = (np.flatnonzero(row) - 1 for row in self.left[contact])
        return [(int(a), int(b)) for a in first for b in second if (a, b) != (0, 0)]

    def _settled(self, contact: int) -> State | None:
        """Return the state where a contact without any pair of signs is released; None: empty."""
        if self.pairs(contact):
            return None if self.selected[contact] and self.released[contact] else self
        if self.selected[contact]:
            return None
        released = self.released.copy()
        released[contact] = True
        return replace(self, released=released)
