"""Parts of the set of all modes: how the search and a proof bound them, and split them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.formulation import NO_FRICTION, Formulation
from graspless_pin.modes.rules import (
    SIGN_VALUES,
    Blocked,
    Conflict,
    Requirement,
    Rules,
    SignRule,
    SlidingMode,
    candidate_contacts,
    required_contacts,
)
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solution.certificate import ConflictSplit, ContactSplit, KinematicLeaf

SignItem = tuple[int, int, int]
"""Contact, component and sign of a virtual sliding; the sign 0: the contact is selected."""
_COMBINATION_CORRECTIONS = 2
_SHORT_COMBINATION = 0.1
"""Combinations shorter than this share of the threshold are not brought nearer to zero."""


@dataclass(frozen=True, eq=False)
class ModePart:
    """All modes that select some contacts, leave others, and have certain signs.

    Attributes:
        selected: (M,) contacts that each of the modes selects.
        released: (M,) contacts that none of them selects.
        allowed_signs: (M, 2, 3) whether a contact, if selected, may have the sign -1, 0, 1 along
            t1, t2.
    """

    selected: NDArray[np.bool_]
    released: NDArray[np.bool_]
    allowed_signs: NDArray[np.bool_]

    @classmethod
    def every_mode(cls, problem: QuasistaticProblem, rules: Rules) -> ModePart:
        """Return all modes that obey the rules on signs and selections."""
        every = np.ones((problem.contact_count, 2, 3), dtype=bool)
        every[:, :, 1] = rules.sign is SignRule.EXACT
        required = required_contacts(problem, rules)
        return cls(required, ~candidate_contacts(problem, rules), every)

    @classmethod
    def one_mode(cls, mode: SlidingMode) -> ModePart:
        """Return one mode alone."""
        return cls(mode.selection, ~mode.selection, mode.signs[:, :, None] == SIGN_VALUES)

    def decides(self, contact: int) -> bool:
        """Whether all its modes agree on a contact: released, or selected with the same signs."""
        is_one = all(len(self.signs_along(contact, component)) == 1 for component in range(2))
        return bool(self.released[contact] or (self.selected[contact] and is_one))

    def signs(self, contact: int) -> tuple[int, int]:
        """Signs of a contact that all its modes have; 0 where there are several, or zero is."""
        first, second = self.signs_along(contact, 0), self.signs_along(contact, 1)
        return first[0] if len(first) == 1 else 0, second[0] if len(second) == 1 else 0

    @property
    def mode(self) -> SlidingMode:
        """The mode of a part that is one alone."""
        signs = np.where(self.selected[:, None], self.allowed_signs @ SIGN_VALUES, 0)
        return SlidingMode.unchecked(self.selected, signs.astype(np.int8))

    def requirements(self) -> list[Requirement]:
        """Return what all its modes ask of the virtual motion."""
        return [Requirement(c, self.signs(c)) for c in np.flatnonzero(self.selected).tolist()]

    def signs_along(self, contact: int, component: int) -> list[int]:
        """Return the signs along one tangent that are left to a contact."""
        return [sign for sign in SIGN_VALUES if self.allowed_signs[contact, component, sign + 1]]

    def pairs(self, contact: int) -> list[tuple[int, int]]:
        """Return the pairs of signs that are left to a contact."""
        first, second = self.signs_along(contact, 0), self.signs_along(contact, 1)
        return [(a, b) for a in first for b in second if a or b]

    def holding(self, item: SignItem) -> ModePart | None:
        """Return the modes of it that have an item; None: none does."""
        contact, component, sign = item
        part = self._with("selected", contact, to=True)
        if sign:
            part = part._only(contact, component, sign)
        return part._settled(contact)

    def breaking(self, item: SignItem) -> ModePart | None:
        """Return the modes of it that lack an item; None: none does."""
        contact, component, sign = item
        if not sign:
            return self._with("released", contact, to=True)._settled(contact)
        return self._with("allowed_signs", (contact, component, sign + 1), to=False)._settled(
            contact
        )

    def with_pair(self, contact: int, pair: tuple[int, int]) -> ModePart | None:
        """Return the modes of it that select a contact with two signs."""
        part = self.holding((contact, 0, 0))
        for component, sign in enumerate(pair):
            part = part and part._only(contact, component, sign)._settled(contact)
        return part

    def _with(self, name: str, at: int | tuple[int, int, int], *, to: bool) -> ModePart:
        """Return the part with one entry of one of its arrays replaced."""
        entries = getattr(self, name).copy()
        entries[at] = to
        return replace(self, **{name: entries})

    def _only(self, contact: int, component: int, sign: int) -> ModePart:
        allowed = self.allowed_signs.copy()
        allowed[contact, component] &= np.equal(SIGN_VALUES, sign)
        return replace(self, allowed_signs=allowed)

    def _settled(self, contact: int) -> ModePart | None:
        """Return the part, a contact without signs released; None: it holds no mode."""
        if self.pairs(contact):
            return None if self.selected[contact] and self.released[contact] else self
        return None if self.selected[contact] else self._with("released", contact, to=True)


def signs_left(part: ModePart) -> FloatArray:
    """Return (M, 2) the signs that sliding may have in a part; NaN: both, 0: there is no friction.

    It tells loops what `ModeTree.bounds` tells programs.
    """
    signs = np.where(
        part.allowed_signs[:, :, ::2].all(axis=2), np.nan, part.allowed_signs @ SIGN_VALUES
    )
    return np.where(part.released[:, None], 0.0, signs)


@dataclass(frozen=True, eq=False)
class ModeTree:
    """Bounds parts of all modes and splits them, so that no mode is left out.

    Attributes:
        formulation: The program.
        rules: The reading of the virtual-sliding constraint.
        for_proof: Whether combinations are sharpened, for others to check.
    """

    formulation: Formulation
    rules: Rules
    for_proof: bool = False

    def bounds(self, part: ModePart | None) -> tuple[FloatArray, FloatArray]:
        """Return bounds of the variables: friction opposes the sliding that is left to it.

        Eqs. (27) and (31): it vanishes at contacts that no mode of the part selects.

        Args:
            part: The modes; None: friction needs no virtual sliding at all.
        """
        if part is None:
            return self.formulation.bounds_of(None)
        cones = self.formulation.coordinates.layout.cones
        allowed = part.allowed_signs[cones] & ~part.released[cones, None, None]
        return self.formulation.opposing(allowed[:, :, 0], allowed[:, :, 2])

    def within(self, part: ModePart, x: FloatArray) -> FloatArray:
        """Return x without the friction that a part forbids: a solver may leave traces of it."""
        return np.clip(x, *self.bounds(part))

    def exclusion(self, part: ModePart) -> KinematicLeaf | None:
        """Return why no virtual motion is behind any mode of a part; None: one may be."""
        if not part.selected.any():
            return None
        wanted = part.requirements()
        # Under `exact` a sign of 0 is read as an open one, unless no sign is open.
        rule = self.rules.sign
        if rule is SignRule.EXACT and not all(part.decides(one.contact) for one in wanted):
            rule = SignRule.STRICT
        verdict = self.formulation.kinematics.solve(wanted, rule)
        if not isinstance(verdict, Conflict):
            return None
        return KinematicLeaf(self._sharpened(verdict, wanted, rule))

    def split(
        self, part: ModePart, x: FloatArray, found: Conflict | Blocked | None
    ) -> tuple[ConflictSplit | ContactSplit, list[ModePart]] | None:
        """Split a part in which no mode admits the friction of its optimum.

        Args:
            part: The modes.
            x: Its optimum, see `within`.
            found: What excludes every mode of the part that admits it, by
                `ModeOracle.conflict_for`; None: that is not known.

        Returns:
            How it is split, and the parts in the order of the items, or of the pairs of signs;
            None: it is one mode.
        """
        size = self.formulation.friction_size(x)
        if found is None:
            return self._by_contact(part, x, size)
        rule = SignRule.STRICT if self.rules.sign is SignRule.EXACT else self.rules.sign
        if isinstance(found, Blocked):
            conflicts, opened = found.conflicts, (found.contact, found.component)
        else:
            conflicts, opened = (found,), None
        chosen = set(np.flatnonzero(part.selected).tolist())
        combinations = tuple(
            self._sharpened(one, [Requirement(c, (0, 0)) for c in one.involved | chosen], rule)
            for one in conflicts
        )
        items = _items(part, combinations, opened, size)
        children: list[ModePart] = []
        rest: ModePart | None = part
        for item in items:
            if rest is None:
                break
            broken = rest.breaking(item)
            if broken is not None:
                children.append(broken)
            rest = rest.holding(item)
        return ConflictSplit(tuple(items), combinations, opened), children

    def _by_contact(
        self, part: ModePart, x: FloatArray, size: FloatArray
    ) -> tuple[ContactSplit, list[ModePart]] | None:
        """Return the split of the contact with the most friction of which not all is known.

        One at which two sets of forces oppose each other comes first.
        """
        unknown = [c for c in range(len(size)) if not part.decides(c)]
        if not unknown:
            return None
        friction = x[self.formulation.cone_columns]
        opposed = np.zeros(len(size))
        opposed[self.formulation.coordinates.layout.cones] = np.minimum(
            friction.max(axis=0, initial=0.0), -friction.min(axis=0, initial=0.0)
        ).max(axis=1, initial=0.0)
        contact = max(
            unknown,
            key=lambda one: (opposed[one] > NO_FRICTION, size[one].sum(), part.selected[one]),
        )
        children = [] if part.selected[contact] else [part.breaking((contact, 0, 0))]
        children += [part.with_pair(contact, pair) for pair in part.pairs(contact)]
        return ContactSplit(contact), [child for child in children if child is not None]

    def _sharpened(
        self, conflict: Conflict, wanted: list[Requirement], rule: SignRule
    ) -> FloatArray:
        """Return a combination of which motions see as little as rounding allows."""
        kinematics = self.formulation.kinematics
        seen, v = kinematics.seen, conflict.combination
        if not self.for_proof:
            return v
        still = np.zeros(v.shape, dtype=bool)
        for contact, signs in wanted:
            still[contact, 0] = True
            still[contact, 1:] = [rule is SignRule.EXACT and not sign for sign in signs]
        # First by what takes part already, so that conflicts stay small.
        for places in (still & (v != 0.0), still):
            for _ in range(_COMBINATION_CORRECTIONS):
                visible = np.einsum("mk,mkd->d", v, seen)
                if np.linalg.norm(visible) < _SHORT_COMBINATION * kinematics.threshold:
                    return v
                v = v.copy()
                v[places] -= np.linalg.lstsq(seen[places].T, visible)[0]
        return v


def _items(
    part: ModePart,
    combinations: Sequence[FloatArray],
    opened: tuple[int, int] | None,
    size: FloatArray,
) -> list[SignItem]:
    """Return what combinations are made of; first what the part knows, then by friction."""
    signs, chosen = {}, set()
    for v in combinations:
        for contact, axis in np.argwhere(v):
            chosen.add(int(contact))
            if axis and (int(contact), int(axis) - 1) != opened:
                signs[int(contact), int(axis) - 1] = int(np.sign(v[contact, axis]))
    if opened is not None:
        chosen.add(opened[0])
    items = [(c, k, s) for (c, k), s in signs.items()]
    items.sort(key=lambda item: (
        item[2] != part.signs(item[0])[item[1]],
        not part.selected[item[0]],
        -size[item[0], item[1]],
    ))  # fmt: skip
    return items + [(c, 0, 0) for c in sorted(chosen - {c for c, _, _ in items})]
