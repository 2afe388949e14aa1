"""What follows for all contacts from the virtual sliding of some: fewer modes left to search."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from graspless_pin.caching import Bounded
from graspless_pin.modes.feasibility import Requirement
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import Rules, SignRule, SlidingRule
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray

_VANISHES = 1e-8
"""Rows of unit size that are shorter than this count as zero."""
_SURELY = 1e-4
"""Rows of unit size that are longer than this surely are not zero."""
_CLEARLY = 1e-6
_MOST_KEPT = 16384


@dataclass(frozen=True, eq=False)
class Decisions:
    """What a part of a search presumes of its modes.

    Attributes:
        selected: (M,) contacts that every mode of it selects.
        released: (M,) contacts that none of them selects.
        signs: (M, 2) signs of the virtual sliding in each of them that selects the contact; 0
            where any will do.
    """

    selected: NDArray[np.bool_]
    released: NDArray[np.bool_]
    signs: NDArray[np.int8]

    @classmethod
    def none(cls, count: int) -> Self:
        """Nothing is presumed of any of the contacts."""
        return cls(np.zeros(count, bool), np.zeros(count, bool), np.zeros((count, 2), np.int8))

    def select(self, contact: int) -> Decisions | None:
        """With one more contact selected, None if it is released."""
        if self.released[contact]:
            return None
        selected = self.selected.copy()
        selected[contact] = True
        return Decisions(selected, self.released, self.signs)

    def release(self, contact: int) -> Decisions | None:
        """With one more contact released, None if it is selected."""
        if self.selected[contact]:
            return None
        released = self.released.copy()
        released[contact] = True
        return Decisions(self.selected, released, self.signs)

    def sign(self, contact: int, component: int, sign: int) -> Decisions | None:
        """With one more sign; a contact that would need two is released, None if it must not be."""
        known = self.signs[contact, component]
        if known == -sign:
            return self.release(contact)
        if known == sign:
            return self
        signs = self.signs.copy()
        signs[contact, component] = sign
        return Decisions(self.selected, self.released, signs)

    @property
    def key(self) -> tuple[bytes, bytes, bytes]:
        """Tells decisions apart."""
        return self.selected.tobytes(), self.released.tobytes(), self.signs.tobytes()


class Propagation:
    """Propagates decisions to all contacts, for one problem under one reading of the rules.

    Only maximal modes are kept in view: a larger mode allows every force of a smaller one.
    """

    def __init__(
        self, problem: QuasistaticProblem, kinematics: VirtualKinematics, rules: Rules
    ) -> None:
        """Know the problem and keep what is found out about it."""
        self._kinematics, self._rule = kinematics, rules.sign
        # Under `exact` a known sign is strict, and one that is not known may be zero.
        self._reading = SignRule.STRICT if rules.sign is SignRule.EXACT else rules.sign
        self._cones = problem.has_cone
        self._always = np.zeros(problem.contact_count, dtype=bool)
        if rules.sliding is SlidingRule.CONSTRAINED:
            self._always = problem.is_sliding
        self._bases: dict[bytes, FloatArray] = Bounded(_MOST_KEPT)
        self._followed: dict[tuple[bytes, bytes, bytes, bool], Decisions | None] = Bounded(
            _MOST_KEPT
        )
        self._ways: dict[tuple[bytes, bytes, int], NDArray[np.bool_]] = Bounded(_MOST_KEPT)

    def propagate(self, decisions: Decisions, *, probe: bool) -> Decisions | None:
        """Return decisions with what follows from them, None if no mode is left; it is kept.

        Args:
            decisions: What is presumed.
            probe: Whether to presume, in turn, each contact that might still be selected.
        """
        key = *decisions.key, probe
        followed = self._followed.get(key, decisions)
        if followed is decisions:
            followed = self._propagated(decisions, probe=probe)
            self._followed[key] = followed
        return followed

    def _propagated(self, decisions: Decisions, *, probe: bool) -> Decisions | None:
        if self._rule is SignRule.STRICT:
            closed = self._close(decisions)
            if closed is None:
                return None
            decisions = closed
        if not decisions.selected.any():
            return decisions
        known = np.where(decisions.selected[:, None], decisions.signs, 0).astype(np.int8)
        ways = self._known_ways(decisions.selected, known, None)
        if not ways.any():
            return None
        if self._rule is SignRule.EXACT:
            return decisions
        ways = ways[decisions.selected]
        if not ways.any(axis=2).all():
            return None
        signs, released = decisions.signs.copy(), decisions.released
        signs[decisions.selected] = _only(ways, signs[decisions.selected])
        decisions = Decisions(decisions.selected, released, signs)
        return self._probe(decisions, known) if probe else decisions

    def _probe(self, decisions: Decisions, known: NDArray[np.int8]) -> Decisions:
        """Add the signs that contacts would have if they were selected, release the impossible."""
        signs, released = decisions.signs.copy(), decisions.released.copy()
        undecided = self._cones & ~decisions.selected & ~released
        for contact in np.flatnonzero(undecided).tolist():
            presumed = known.copy()
            presumed[contact] = signs[contact]
            ways = self._known_ways(decisions.selected, presumed, contact)
            if ways.any(axis=1).all():
                signs[contact] = _only(ways, signs[contact])
            else:
                released[contact] = True
        return Decisions(decisions.selected, released, signs)

    def _close(self, decisions: Decisions) -> Decisions | None:
        """Select what touches anyway, and release what would make a released contact touch.

        A contact that stays touching in all motions of a mode slides in nearly all of them, unless
        its sliding vanishes in them: so a maximal mode selects it. Of interchangeable contacts,
        like many on one plane, releasing one thus leaves few that can be selected together.
        """
        tied = self._tied & ~decisions.selected
        if not tied.any():
            return decisions
        rows = self._kinematics.seen
        normal = rows[:, 0] @ self._basis(decisions.selected | self._always)
        size = np.linalg.norm(normal, axis=1)
        touches = tied & (size < _VANISHES)
        barred = tied & decisions.released
        if not (touches.any() or barred.any()):
            return decisions
        # What slides while all others touch slides in every mode.
        most = self._basis((self._cones & ~decisions.released) | self._always)
        slides = (np.linalg.norm(rows[:, 1:] @ most, axis=2) > _SURELY).all(axis=1)
        touches &= slides
        if (touches & decisions.released).any():
            return None
        selected = decisions.selected | touches
        # Only rows that surely are not zero have a direction to compare.
        barred &= slides & (size > _SURELY)
        undecided = np.flatnonzero(tied & ~selected & ~decisions.released & (size > _SURELY))
        released = decisions.released.copy()
        unit = normal / np.maximum(size, _SURELY)[:, None]
        others = unit[barred]
        along = unit[undecided] @ others.T
        for own, other in np.argwhere(np.abs(along) > 1.0 - _SURELY):
            apart = unit[undecided[own]] - along[own, other] * others[other]
            released[undecided[own]] |= np.linalg.norm(apart) < _VANISHES
        return Decisions(selected, released, decisions.signs)

    @cached_property
    def _tied(self) -> NDArray[np.bool_]:
        """(M,) contacts with a cone that touch in all motions in which all others do."""
        touching = np.flatnonzero(self._cones | self._always)
        tied = np.zeros(len(self._cones), dtype=bool)
        # Only they take part in combinations of normal rows that vanish.
        left, values, _ = np.linalg.svd(self._kinematics.seen[touching, 0])
        rank = int((values > _VANISHES * max(1.0, values.max(initial=0.0))).sum())
        tied[touching] = np.linalg.norm(left[:, rank:], axis=1) > _VANISHES
        return tied & self._cones

    def _basis(self, contacts: NDArray[np.bool_]) -> FloatArray:
        """(r, d) motions that leave contacts touching."""
        key = contacts.tobytes()
        if key not in self._bases:
            chosen = tuple(np.flatnonzero(contacts).tolist())
            self._bases[key] = self._kinematics.touching(chosen).basis
        return self._bases[key]

    def _known_ways(
        self, selected: NDArray[np.bool_], signs: NDArray[np.int8], extra: int | None
    ) -> NDArray[np.bool_]:
        """Which ways selected contacts can slide, or one more contact; kept between calls.

        Returns:
            (M, 2, 2) for the selected contacts: forward and backward along each tangent; (2, 2)
            for the extra contact, with it selected. All false if no motion is left.
        """
        key = selected.tobytes(), signs.tobytes(), -1 if extra is None else extra
        known = self._ways.get(key)
        if known is None:
            known = self._ways[key] = self._find_ways(selected, signs, extra)
        return known

    def _find_ways(
        self, selected: NDArray[np.bool_], signs: NDArray[np.int8], extra: int | None
    ) -> NDArray[np.bool_]:
        chosen = selected | self._always
        if extra is not None:
            chosen[extra] = True
        asked = [
            Requirement(int(contact), (int(signs[contact, 0]), int(signs[contact, 1])))
            for contact in np.flatnonzero(chosen)
        ]
        ways = np.zeros((len(chosen), 2, 2), dtype=bool)
        velocities = self._kinematics.witness(asked, self._reading)
        if velocities is None:
            return ways if extra is None else ways[extra]
        ways |= _moving(velocities)
        for index, (contact, pair) in enumerate(asked):
            if extra is not None and contact != extra:
                continue
            for component in range(2):
                if pair[component]:
                    ways[contact, component] = pair[component] > 0, pair[component] < 0
                    continue
                for way in np.flatnonzero(~ways[contact, component]):
                    sign = -1 if way else 1
                    tried = (sign, pair[1]) if component == 0 else (pair[0], sign)
                    asked[index] = Requirement(contact, tried)
                    velocities = self._kinematics.witness(asked, self._reading)
                    if velocities is not None:
                        ways |= _moving(velocities)
                        ways[contact, component, way] = True
            asked[index] = Requirement(contact, pair)
        return ways if extra is None else ways[extra]


def _only(ways: NDArray[np.bool_], signs: NDArray[np.int8]) -> NDArray[np.int8]:
    """Signs, with those added where only one way is left."""
    only = ways[..., 0].astype(np.int8) - ways[..., 1].astype(np.int8)
    return np.where(only != 0, only, signs)


def _moving(velocities: FloatArray) -> NDArray[np.bool_]:
    """(M, 2, 2) whether contacts clearly move forward, backward along their tangents."""
    clear = _CLEARLY * float(np.abs(velocities).max())
    return np.stack([velocities[:, 1:] > clear, velocities[:, 1:] < -clear], axis=2)
