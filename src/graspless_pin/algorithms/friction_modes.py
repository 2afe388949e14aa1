"""From friction forces to a kinematically feasible mode, or to the conflict that forbids one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from graspless_pin.algorithms.formulation import Formulation
from graspless_pin.modes.enumeration import mode_of, sign_pairs
from graspless_pin.modes.kinematics import Conflict, Requirement, Witness
from graspless_pin.modes.rules import Rules, SignRule, SlidingMode, SlidingRule, StaticFriction
from graspless_pin.problem.checks import FloatArray

NO_FRICTION = 1e-8
"""Friction below this share of the largest normal-force limit counts as none."""
_MOVES = 1e-6

SignPair = tuple[int, int]


@dataclass
class ModeReader:
    """Finds a mode that admits given friction forces.

    Attributes:
        formulation: The shared program and kinematics.
        rules: The reading of the constraint.
        kinematic_programs: How many feasibility problems were solved so far.
    """

    formulation: Formulation
    rules: Rules
    kinematic_programs: int = field(default=0)

    def read(self, x: FloatArray, decided: dict[int, SignPair]) -> SlidingMode | Conflict | None:
        """Return a feasible mode that admits the friction in x.

        Args:
            x: Solution of the program.
            decided: Sign pairs that the search has already fixed for some contacts.

        Returns:
            A mode; or the conflict among its nonzero friction components that excludes every
            mode; or None if only the signs of vanishing components stand in the way.
        """
        friction = self._friction(x)
        if self.rules.static_friction is StaticFriction.COULOMB:
            return self._describing_mode(friction)
        needed = [
            Requirement(contact, decided.get(contact, _opposing(pair)))
            for contact, pair in friction.items()
            if pair.any()
        ]
        always = self._always_selected()
        # What does not depend on the signs of vanishing components: necessary for every mode.
        known = [*needed, *(Requirement(contact, (0, 0)) for contact in always)]
        rule = SignRule.STRICT if self.rules.sign is SignRule.EXACT else self.rules.sign
        self.kinematic_programs += 1
        verdict = self.formulation.kinematics.solve(known, rule)
        if isinstance(verdict, Conflict):
            return verdict
        return self._complete(known, verdict)

    def _friction(self, x: FloatArray) -> dict[int, FloatArray]:
        """Friction components of each contact with a cone, vanishing ones set to zero."""
        columns = self.formulation.coordinates.tangent
        contacts = np.flatnonzero(self.formulation.problem.has_cone)
        values = x[columns[contacts]]
        values[np.abs(values) <= NO_FRICTION] = 0.0
        return {int(contact): pair for contact, pair in zip(contacts, values, strict=True)}

    def _always_selected(self) -> list[int]:
        """Contacts in actual sliding, where (22) is asked of them."""
        if self.rules.sliding is SlidingRule.EXEMPT:
            return []
        return [int(contact) for contact in np.flatnonzero(self.formulation.problem.is_sliding)]

    def _describing_mode(self, friction: dict[int, FloatArray]) -> SlidingMode:
        requirements = tuple(
            Requirement(contact, _opposing(pair))
            for contact, pair in friction.items()
            if pair.any()
        )
        return mode_of(self.formulation.problem, requirements)

    def _complete(self, known: list[Requirement], witness: Witness) -> SlidingMode | None:
        """Fill in the signs that the friction leaves open, first as the witness moves."""
        largest = np.abs(witness.velocities).max(initial=0.0)
        options: list[list[Requirement]] = []
        is_open = False
        for requirement in known:
            admitted = [
                pair for pair in sign_pairs(self.rules.sign) if _extends(pair, requirement.signs)
            ]
            if 0 not in requirement.signs:
                admitted = [requirement.signs]
            moving = witness.velocities[requirement.contact, 1:]
            seen = np.where(np.abs(moving) > _MOVES * largest, np.sign(moving), 0.0)
            seen = tuple(
                int(sign or shown) for sign, shown in zip(requirement.signs, seen, strict=True)
            )
            admitted.sort(key=lambda pair, seen=seen: pair != seen)
            is_open = is_open or len(admitted) > 1
            options.append([Requirement(requirement.contact, pair) for pair in admitted])
        if not is_open:
            return mode_of(self.formulation.problem, tuple(known))
        chosen = self._first_feasible(options, ())
        return None if chosen is None else mode_of(self.formulation.problem, chosen)

    def _first_feasible(
        self, options: list[list[Requirement]], chosen: tuple[Requirement, ...]
    ) -> tuple[Requirement, ...] | None:
        """Depth-first search through the open signs."""
        if len(chosen) == len(options):
            return chosen
        for requirement in options[len(chosen)]:
            extended = (*chosen, requirement)
            self.kinematic_programs += 1
            if isinstance(self.formulation.kinematics.solve(extended, self.rules.sign), Witness):
                complete = self._first_feasible(options, extended)
                if complete is not None:
                    return complete
        return None


def _opposing(friction: FloatArray) -> SignPair:
    """Signs of the virtual sliding that friction opposes, 0 where there is none, (31)."""
    return int(-np.sign(friction[0])), int(-np.sign(friction[1]))


def _extends(pair: SignPair, signs: SignPair) -> bool:
    """Whether a sign pair agrees with the signs that are fixed."""
    return all(fixed in (0, sign) for sign, fixed in zip(pair, signs, strict=True))
