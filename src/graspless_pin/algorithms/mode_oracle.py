"""From friction forces to a kinematically feasible mode, or to the conflict that excludes all."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.formulation import NO_FRICTION, Formulation
from graspless_pin.algorithms.mode_tree import ModePart
from graspless_pin.modes.kinematics import mode_of, requirements_of, sign_pairs
from graspless_pin.modes.rules import (
    Blocked,
    Conflict,
    Requirement,
    Rules,
    SignRule,
    SlidingMode,
    StaticFriction,
    Witness,
    required_contacts,
)
from graspless_pin.modes.virtual_motions import CLEARLY
from graspless_pin.problem.checks import FloatArray

_LEAST_IMPORTANCE = 1e-3


@dataclass(frozen=True, eq=False)
class FoundMode:
    """A feasible mode, and a virtual motion that realises it.

    Attributes:
        mode: The mode.
        motion: (P + L,) the motion, scaled; None: it was not kept.
        is_clear: Whether the motion is known to be clearly faster than the threshold.
    """

    mode: SlidingMode
    motion: FloatArray | None = None
    is_clear: bool = False


@dataclass
class ModeOracle:
    """Finds a mode that admits given friction forces.

    Attributes:
        formulation: The shared program and kinematics.
        rules: The reading of the constraint.
        kinematic_programs: Number of feasibility problems solved so far.
    """

    formulation: Formulation
    rules: Rules
    kinematic_programs: int = 0

    def mode_for(
        self, x: FloatArray, near: FloatArray | None = None
    ) -> FoundMode | Conflict | Blocked | None:
        """Return a feasible mode that admits the friction in x.

        Args:
            x: Solution of the program.
            near: (P + L,) a virtual motion that may admit the friction, scaled, such as that of a
                similar problem; None: none is known.

        Returns:
            A mode; or a proof that no mode admits x; or None if only the signs of vanishing
            components exclude one, or if two sets of forces have friction of opposite signs.
        """
        if self.rules.static_friction is StaticFriction.COULOMB:
            return FoundMode(self.mode_of_friction(x))
        found = self._mode_without_search(x, near)
        if found is not None:
            return found
        every = ModePart.every_mode(self.formulation.problem, self.rules)
        known = self._requirements_in_part(x, every)
        if known is None:
            return None
        verdict = self._solve_requirements(x, known)
        return verdict if isinstance(verdict, Conflict) else self._full_mode(known, verdict, every)

    def conflict_for(self, x: FloatArray, part: ModePart) -> Conflict | Blocked | None:
        """Return a proof that no mode of a part admits the friction in x.

        Args:
            x: Solution of the program.
            part: The modes.

        Returns:
            The proof; None: there is none, as where only the signs of vanishing components exclude
            a mode, or where two sets of forces have friction of opposite signs.
        """
        known = self._requirements_in_part(x, part)
        if known is None:
            return None
        verdict = self._solve_requirements(x, known)
        return verdict if isinstance(verdict, Conflict) else self._blocked_component(known, part)

    def _requirements_in_part(self, x: FloatArray, part: ModePart) -> list[Requirement] | None:
        """Return the requirements of the friction in x and of all modes of a part.

        Components with a sign from neither have sign 0. None: two sets of forces have friction of
        opposite signs.
        """
        friction = self._friction_signs(x)
        if friction is None:
            return None
        required = []
        for contact, selected in enumerate(part.selected.tolist()):
            own = part.signs(contact) if selected else (0, 0)
            a, b = (-f or s for f, s in zip(friction[contact].tolist(), own, strict=True))
            if a or b or selected:
                required.append(Requirement(contact, (a, b)))
        return required

    def _solve_requirements(self, x: FloatArray, known: list[Requirement]) -> Witness | Conflict:
        """Return a motion that meets the known signs, whatever the others are, or a conflict."""
        rule = SignRule.STRICT if self.rules.sign is SignRule.EXACT else self.rules.sign
        # Splitting on conflicts among large friction forces raises the children's bounds the most.
        size = self.formulation.friction_size(x)[[one.contact for one in known]]
        importance = np.sqrt(np.maximum(size / size.max(initial=1e-300), _LEAST_IMPORTANCE))
        self.kinematic_programs += 1
        return self.formulation.kinematics.solve(known, rule, importance)

    def heuristic_mode(self, x: FloatArray) -> FoundMode | None:
        """Return a feasible mode near the friction in x, whose optimum may be as good.

        Its motion is the one whose sliding opposes the friction best by least squares, of all that
        keep the contacts touching; contacts that it leaves at rest are not selected.
        """
        contacts = [*self.formulation.coordinates.layout.cones.tolist(), *self._always_selected]
        columns = self.formulation.cone_columns
        wanted = np.zeros((len(contacts), 2))
        wanted[: columns.shape[1]] = -x[columns].sum(axis=0)
        sliding, motion = self.formulation.kinematics.nearest.sliding(tuple(contacts), wanted)
        if sliding is None:
            return None
        chosen = (sliding != 0.0).all(axis=1)
        if not chosen[columns.shape[1] :].all():
            return None
        signs = np.sign(sliding).astype(int).tolist()
        wanted_of = tuple(
            Requirement(contact, (signs[i][0], signs[i][1]))
            for i, contact in enumerate(contacts)
            if chosen[i]
        )
        return FoundMode(mode_of(self.formulation.problem, wanted_of), motion, is_clear=True)

    def mode_of_friction(self, x: FloatArray) -> SlidingMode:
        """Return the mode with the signs opposite to the friction in x, feasible or not."""
        friction = self._friction_signs(x)
        signs = np.zeros((self.formulation.problem.contact_count, 2), dtype=np.int8)
        if friction is not None:
            signs -= friction
        return SlidingMode.unchecked(np.logical_or.reduce(signs, axis=1), signs)

    def _mode_without_search(self, x: FloatArray, guess: FloatArray | None) -> FoundMode | None:
        """Return the mode of the friction in x, if a motion of it is found without a search."""
        if self._always_selected or len(self.formulation.layers) > 1:
            return None
        mode = self.mode_of_friction(x)
        seen = self._witness_without_search(
            mode.contacts, mode.own_signs.ravel().astype(np.float64), guess
        )
        if seen is None:
            return None
        known, motion = seen
        signs = mode.signs.copy()
        signs[mode.selection] = known.reshape(-1, 2)
        return FoundMode(SlidingMode.unchecked(mode.selection, signs), motion, is_clear=True)

    def mode_still_admitting(
        self, x: FloatArray, mode: SlidingMode, near: FloatArray
    ) -> tuple[FoundMode, FloatArray] | None:
        """Return a known mode if it still admits the friction in x, and x without rounding.

        Forbidden friction must be rounding alone, and its virtual motion has to be found near the
        known one. Then `mode_for` would find a mode too, though perhaps another one.

        Args:
            x: Solution of the program.
            mode: A mode of as many contacts, such as that of a similar problem.
            near: (P + L,) its virtual motion there, scaled.

        Returns:
            The mode, and (n,) x without traces of forbidden friction; None: not decided.
        """
        admitted = self.formulation.admitted(mode, x)
        if admitted is not x and np.abs(admitted - x).max() > NO_FRICTION:
            return None
        nearest = self.formulation.kinematics.nearest
        motion = nearest.witness_near(mode.contacts, mode.own_signs, near)
        if motion is None:
            return None
        self.kinematic_programs += 1
        return FoundMode(mode, motion, is_clear=True), admitted

    def feasible_mode(self, mode: SlidingMode, near: FloatArray | None = None) -> FoundMode | None:
        """Return a mode if it is feasible, else None; `near` as in `mode_for`."""
        signs = mode.own_signs.ravel().astype(float)
        seen = self._witness_without_search(mode.contacts, signs, near) if signs.all() else None
        if seen is not None:
            return FoundMode(mode, seen[1], is_clear=True)
        self.kinematic_programs += 1
        feasible = self.formulation.kinematics.feasible(requirements_of(mode), self.rules.sign)
        return FoundMode(mode) if feasible else None

    def _witness_without_search(
        self, contacts: tuple[int, ...], signs: FloatArray, guess: FloatArray | None
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return completed signs and a motion with them, without a search; None: not found."""
        found = self.formulation.kinematics.nearest.guessed_witness(contacts, signs, guess)
        self.kinematic_programs += found is not None
        return found

    def _friction_signs(self, x: FloatArray) -> NDArray[np.int8] | None:
        """Return (M, 2) signs of the friction in x, 0 where it vanishes or there is no cone.

        None: two sets of forces have opposite signs.
        """
        values = x[self.formulation.cone_columns]
        signs = np.sign(values) * (np.abs(values) > NO_FRICTION)
        if len(signs) > 1 and ((signs > 0.0).any(axis=0) & (signs < 0.0).any(axis=0)).any():
            return None
        friction = np.zeros((self.formulation.problem.contact_count, 2), dtype=np.int8)
        friction[self.formulation.coordinates.layout.cones] = np.sign(signs.sum(axis=0))
        return friction

    @cached_property
    def _always_selected(self) -> list[int]:
        """Contacts in actual sliding, where (22) applies to them."""
        return np.flatnonzero(required_contacts(self.formulation.problem, self.rules)).tolist()

    def _full_mode(
        self, known: list[Requirement], witness: Witness, part: ModePart
    ) -> FoundMode | Blocked | None:
        """Return the mode with the open signs filled in, first by those of the witness.

        A witness that moves along every open component proves its own signs.
        """
        velocities, kinematics = witness.velocities, self.formulation.kinematics
        if not any(0 in requirement.signs for requirement in known):
            is_clear = witness.slowest >= CLEARLY * kinematics.threshold
            return self._mode_with_motion(tuple(known), witness, is_clear=is_clear)
        moves = np.abs(velocities) >= kinematics.threshold * np.linalg.norm(velocities)
        seen = np.where(moves, np.sign(velocities), 0.0)[:, 1:].astype(int).tolist()
        shown = tuple(
            Requirement(contact, (a or seen[contact][0], b or seen[contact][1]))
            for contact, (a, b) in known
        )
        if all(
            0 not in requirement.signs for requirement in shown
        ) and kinematics.meets_requirements(velocities, shown, self.rules.sign):
            return self._mode_with_motion(shown, witness)
        blocked = self._blocked_component(known, part)
        if blocked is not None:
            return blocked
        options = []
        for requirement, suggested in zip(known, shown, strict=True):
            admitted = sign_pairs(self.rules.sign, requirement.signs)
            admitted.sort(key=lambda pair, first=suggested.signs: pair != first)
            options.append([Requirement(requirement.contact, pair) for pair in admitted])
        chosen = self._first_feasible(options, ())
        return None if chosen is None else self._mode_with_motion(chosen, witness)

    def _mode_with_motion(
        self, known: tuple[Requirement, ...], witness: Witness, *, is_clear: bool = False
    ) -> FoundMode:
        """Return the mode of requirements with the motion of a witness."""
        motion = self.formulation.kinematics.scaled_motion(witness.coordinates)
        return FoundMode(mode_of(self.formulation.problem, known), motion, is_clear)

    def _blocked_component(self, known: list[Requirement], part: ModePart) -> Blocked | None:
        """Return a component that must move but has no feasible sign; None: there is none."""
        if self.rules.sign is not SignRule.STRICT:
            return None
        for index, (contact, signs) in enumerate(known):
            for component in range(2):
                if signs[component]:
                    continue
                conflicts = self._conflicts_of_signs(
                    known, index, component, part.signs_along(contact, component)
                )
                if conflicts:
                    return Blocked(contact, component, conflicts)
        return None

    def _conflicts_of_signs(
        self, known: list[Requirement], index: int, component: int, allowed: list[int]
    ) -> tuple[Conflict, ...]:
        """Return a conflict for each allowed sign of a component; empty if one is feasible."""
        contact, signs = known[index]
        conflicts: list[Conflict] = []
        for sign in allowed:
            pair = (sign, signs[1]) if component == 0 else (signs[0], sign)
            tried = [*known[:index], Requirement(contact, pair), *known[index + 1 :]]
            self.kinematic_programs += 1
            verdict = self.formulation.kinematics.solve(tried, self.rules.sign)
            if isinstance(verdict, Witness):
                return ()
            conflicts.append(verdict)
        return tuple(conflicts)

    def _first_feasible(
        self, options: list[list[Requirement]], chosen: tuple[Requirement, ...]
    ) -> tuple[Requirement, ...] | None:
        """Return the first feasible choice of one requirement from each of the options."""
        if not options:
            return chosen
        for requirement in options[0]:
            extended = (*chosen, requirement)
            self.kinematic_programs += 1
            if self.formulation.kinematics.feasible(extended, self.rules.sign):
                complete = self._first_feasible(options[1:], extended)
                if complete is not None:
                    return complete
        return None
