"""Parts of the set of all modes: how searches and proofs bound and split them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

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
"""Combinations shorter than this share of the threshold are not corrected further."""


_PAIRS = np.eye(9, dtype=bool).reshape(9, 3, 3)[[4, 0, 1, 2, 3, 5, 6, 7, 8]]
"""One mask for each pair of signs, (0, 0) first: that of contacts that are not selected."""
_RELEASED = _PAIRS[0]


@dataclass(frozen=True, eq=False)
class ModePart:
    """All modes in which each contact has one of its allowed pairs of signs, independently.

    Attributes:
        allowed_pairs: (M, 3, 3) whether a contact may have each pair of the signs -1, 0, 1 along t1
            and t2; the pair (0, 0) stands for contacts that are not selected.
    """

    allowed_pairs: NDArray[np.bool_]

    @classmethod
    def every_mode(cls, problem: QuasistaticProblem, rules: Rules) -> ModePart:
        """Return all modes that obey the rules on signs and selections."""
        allowed = np.ones((problem.contact_count, 3, 3), dtype=bool)
        if rules.sign is not SignRule.EXACT:
            allowed[:, 1] = allowed[:, :, 1] = False
        allowed[:, 1, 1] = ~required_contacts(problem, rules)
        allowed[~candidate_contacts(problem, rules)] = _RELEASED
        return cls(allowed)

    @classmethod
    def one_mode(cls, mode: SlidingMode) -> ModePart:
        """Return one mode alone."""
        allowed = np.zeros((len(mode.signs), 3, 3), dtype=bool)
        allowed[np.arange(len(allowed)), *(mode.signs.T + 1)] = True
        return cls(allowed)

    @cached_property
    def selected(self) -> NDArray[np.bool_]:
        """(M,) contacts that every mode of the part selects."""
        return ~self.allowed_pairs[:, 1, 1]

    @cached_property
    def released(self) -> NDArray[np.bool_]:
        """(M,) contacts that no mode of the part selects."""
        return self.allowed_signs.sum(axis=(1, 2)) == 0

    @cached_property
    def allowed_signs(self) -> NDArray[np.bool_]:
        """(M, 2, 3) whether a contact, if selected, may have the sign -1, 0, 1 along t1, t2."""
        chosen = self.allowed_pairs & ~_RELEASED
        return np.stack([chosen.any(axis=2), chosen.any(axis=1)], axis=1)

    def decides(self, contact: int) -> bool:
        """Return whether all modes agree on a contact: released, or selected with equal signs."""
        return np.count_nonzero(self.allowed_pairs[contact]) == 1

    def signs(self, contact: int) -> tuple[int, int]:
        """Return the signs of a contact in all modes of the part; 0 where several are allowed."""
        first, second = self.signs_along(contact, 0), self.signs_along(contact, 1)
        return first[0] if len(first) == 1 else 0, second[0] if len(second) == 1 else 0

    @property
    def mode(self) -> SlidingMode:
        """The mode of a part that consists of one mode."""
        signs = self.allowed_signs @ SIGN_VALUES
        return SlidingMode.unchecked(self.selected, signs.astype(np.int8))

    def requirements(self) -> list[Requirement]:
        """Return the requirements that all modes of the part have in common."""
        return [Requirement(c, self.signs(c)) for c in np.flatnonzero(self.selected).tolist()]

    def signs_along(self, contact: int, component: int) -> list[int]:
        """Return the signs along one tangent that a contact may have."""
        return [sign for sign in SIGN_VALUES if self.allowed_signs[contact, component, sign + 1]]

    def restricted_to(self, contact: int, pairs: NDArray[np.bool_]) -> ModePart | None:
        """Return the part's modes in which a contact has one of some pairs; None: there is none.

        Args:
            contact: Index of the contact.
            pairs: (3, 3) mask of the pairs.
        """
        allowed = self.allowed_pairs.copy()
        allowed[contact] &= pairs
        return ModePart(allowed) if allowed[contact].any() else None


def _pairs_with(component: int, sign: int) -> NDArray[np.bool_]:
    """Return (3, 3) mask of the pairs with a sign along a tangent; 0: all of selected contacts."""
    if not sign:
        return ~_RELEASED
    along = np.broadcast_to(np.equal(SIGN_VALUES, sign), (3, 3))
    return along if component else along.T


def signs_left(part: ModePart) -> FloatArray:
    """Return (M, 2) the signs that sliding may have in a part; NaN: both, 0: there is no friction.

    Compiled loops use them where programs use `ModeTree.bounds`.
    """
    open_signs = part.allowed_signs[:, :, ::2].all(axis=2)
    return np.where(open_signs, np.nan, part.allowed_signs @ SIGN_VALUES)


@dataclass(frozen=True, eq=False)
class ModeTree:
    """Bounds and splits parts of the set of all modes, so that no mode is lost.

    Attributes:
        formulation: The program.
        rules: The reading of the virtual-sliding constraint.
        for_proof: Whether combinations are refined, so that a document's checker accepts them.
    """

    formulation: Formulation
    rules: Rules
    for_proof: bool = False

    def bounds(self, part: ModePart | None) -> tuple[FloatArray, FloatArray]:
        """Return bounds of the variables: friction opposes the sliding that the part allows.

        Eqs. (27) and (31): it vanishes at contacts that no mode of the part selects.

        Args:
            part: The modes; None: friction needs no virtual sliding at all.
        """
        if part is None:
            return self.formulation.bounds_of(None)
        cones = self.formulation.coordinates.layout.cones
        allowed = part.allowed_signs[cones]
        return self.formulation.opposing(allowed[:, :, 0], allowed[:, :, 2])

    def without_forbidden_friction(self, part: ModePart, x: FloatArray) -> FloatArray:
        """Return x clipped to the bounds of a part, as solvers leave traces of friction."""
        return np.clip(x, *self.bounds(part))

    def exclusion(self, part: ModePart) -> KinematicLeaf | None:
        """Return a proof that no mode of a part has a virtual motion; None: there is none."""
        if not part.selected.any():
            return None
        wanted = part.requirements()
        # Under `exact` a sign of 0 counts as open, unless the part decides all selected contacts.
        rule = self.rules.sign
        if rule is SignRule.EXACT and not all(part.decides(one.contact) for one in wanted):
            rule = SignRule.STRICT
        verdict = self.formulation.kinematics.solve(wanted, rule)
        if not isinstance(verdict, Conflict):
            return None
        return KinematicLeaf(self._sharpened_combination(verdict, wanted, rule))

    def split(
        self, part: ModePart, x: FloatArray, found: Conflict | Blocked | None
    ) -> tuple[ConflictSplit | ContactSplit, list[ModePart]] | None:
        """Split a part in which no mode admits the friction of its optimum.

        Args:
            part: The modes.
            x: Its optimum, see `without_forbidden_friction`.
            found: Proof that no mode of the part admits it, by `ModeOracle.conflict_for`; None: not
                known.

        Returns:
            The split, and the parts in the order of its items, or of the pairs of signs; None: the
            part is one mode.
        """
        size = self.formulation.friction_size(x)
        if found is None:
            return self._split_by_contact(part, x, size)
        rule = SignRule.STRICT if self.rules.sign is SignRule.EXACT else self.rules.sign
        if isinstance(found, Blocked):
            conflicts, opened = found.conflicts, (found.contact, found.component)
        else:
            conflicts, opened = (found,), None
        chosen = set(np.flatnonzero(part.selected).tolist())
        combinations = tuple(
            self._sharpened_combination(
                one, [Requirement(c, (0, 0)) for c in one.involved | chosen], rule
            )
            for one in conflicts
        )
        items = _split_items(part, combinations, opened, size)
        children: list[ModePart | None] = []
        remainder: ModePart | None = part
        for contact, component, sign in items:
            if remainder is None:
                break
            pairs = _pairs_with(component, sign)
            children.append(remainder.restricted_to(contact, ~pairs))
            remainder = remainder.restricted_to(contact, pairs)
        kept = [child for child in children if child is not None]
        return ConflictSplit(tuple(items), combinations, opened), kept

    def _split_by_contact(
        self, part: ModePart, x: FloatArray, size: FloatArray
    ) -> tuple[ContactSplit, list[ModePart]] | None:
        """Return the split at the undecided contact with the most friction.

        A contact at which two sets of forces have opposite friction comes first.
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
        children = [part.restricted_to(contact, pair) for pair in _PAIRS]
        return ContactSplit(contact), [child for child in children if child is not None]

    def _sharpened_combination(
        self, conflict: Conflict, wanted: list[Requirement], rule: SignRule
    ) -> FloatArray:
        """Return the combination of a conflict, its residual reduced by least squares."""
        kinematics = self.formulation.kinematics
        seen, v = kinematics.velocity_map, conflict.combination
        if not self.for_proof:
            return v
        still = np.zeros(v.shape, dtype=bool)
        for contact, signs in wanted:
            still[contact, 0] = True
            still[contact, 1:] = [rule is SignRule.EXACT and not sign for sign in signs]
        # First by weights that are not zero, so that conflicts stay small.
        for places in (still & (v != 0.0), still):
            for _ in range(_COMBINATION_CORRECTIONS):
                visible = np.einsum("mk,mkd->d", v, seen)
                if np.linalg.norm(visible) < _SHORT_COMBINATION * kinematics.threshold:
                    return v
                v = v.copy()
                v[places] -= np.linalg.lstsq(seen[places].T, visible)[0]
        return v


def _split_items(
    part: ModePart,
    combinations: Sequence[FloatArray],
    opened: tuple[int, int] | None,
    size: FloatArray,
) -> list[SignItem]:
    """Return the items of combinations: first those that the part decides, then by friction."""
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
