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


@dataclass(frozen=True)
class Opposition:
    """Two sets of forces of one program have friction of opposite signs along one tangent.

    Attributes:
        contact: Index of the contact.
        component: 0 for t1, 1 for t2.
    """

    contact: int
    component: int


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

    def read(
        self, x: FloatArray, decided: dict[int, SignPair]
    ) -> SlidingMode | Conflict | Opposition | None:
        """Return a feasible mode that admits the friction in x.

        Args:
            x: Solution of the program.
            decided: Sign pairs that the search has already fixed for some contacts.

        Returns:
            A mode; or the conflict among its nonzero friction components, or the opposition of
            two sets of forces, that excludes every mode; or None if only the signs of vanishing
            components stand in the way.
        """
        if self.rules.static_friction is StaticFriction.COULOMB:
            return self.describe(x)
        friction = self._friction(x)
        if isinstance(friction, Opposition):
            return friction
        needed = [
            Requirement(contact, decided.get(contact, (-a, -b)))
            for contact, (a, b) in friction.items()
            if a or b
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

    def propose(self, x: FloatArray) -> SlidingMode | None:
        """Return a feasible mode near the friction in x: a guess whose program may be as good.

        Of the motions that keep all contacts touching, the one whose sliding opposes the friction
        best by least squares; contacts that it leaves at rest are not selected.
        """
        contacts = [*self.formulation.cone_contacts, *self._always_selected()]
        touching = self.formulation.kinematics.touching(tuple(contacts))
        if touching.shape[2] == 0:
            return None
        columns = self.formulation.cone_columns
        wanted = np.zeros((len(contacts), 2))
        wanted[: columns.shape[1]] = -x[columns].sum(axis=0)
        rows = touching.reshape(-1, touching.shape[2])
        motion = np.linalg.lstsq(rows, wanted.ravel(), rcond=None)[0]
        sliding = touching @ motion
        moves = np.abs(sliding) > _MOVES * np.abs(sliding).max(initial=0.0)
        chosen = moves.all(axis=1)
        if not chosen[columns.shape[1] :].all():
            return None
        signs = np.sign(sliding).astype(int).tolist()
        return mode_of(
            self.formulation.problem,
            tuple(
                Requirement(contact, (signs[i][0], signs[i][1]))
                for i, contact in enumerate(contacts)
                if chosen[i]
            ),
        )

    def describe(self, x: FloatArray) -> SlidingMode:
        """Return the mode that only describes the friction in x, feasible or not."""
        friction = self._friction(x)
        signs = {} if isinstance(friction, Opposition) else friction
        requirements = tuple(
            Requirement(contact, (-a, -b)) for contact, (a, b) in signs.items() if a or b
        )
        return mode_of(self.formulation.problem, requirements)

    def _friction(self, x: FloatArray) -> dict[int, SignPair] | Opposition:
        """Signs of the friction at each contact with a cone, 0 where a component vanishes."""
        values = x[self.formulation.cone_columns]
        signs = np.sign(values).astype(int)
        signs[np.abs(values) <= NO_FRICTION] = 0
        contacts = self.formulation.cone_contacts
        if len(signs) > 1:
            opposed = np.argwhere((signs > 0).any(axis=0) & (signs < 0).any(axis=0))
            if len(opposed):
                return Opposition(contacts[opposed[0, 0]], int(opposed[0, 1]))
            signs = np.sign(signs.sum(axis=0))[None]
        return dict(zip(contacts, map(tuple, signs[0].tolist()), strict=True))

    def _always_selected(self) -> list[int]:
        """Contacts in actual sliding, where (22) is asked of them."""
        if self.rules.sliding is SlidingRule.EXEMPT:
            return []
        return [int(contact) for contact in np.flatnonzero(self.formulation.problem.is_sliding)]

    def _complete(self, known: list[Requirement], witness: Witness) -> SlidingMode | None:
        """Fill in the signs that the friction leaves open, first as the witness moves.

        A witness that moves along every open component proves its own signs.
        """
        if not any(0 in requirement.signs for requirement in known):
            return mode_of(self.formulation.problem, tuple(known))
        velocities = witness.velocities
        moves = np.abs(velocities) > _MOVES * np.abs(velocities).max()
        seen = np.where(moves, np.sign(velocities), 0.0)[:, 1:].astype(int).tolist()
        shown = tuple(
            Requirement(contact, (a or seen[contact][0], b or seen[contact][1]))
            for contact, (a, b) in known
        )
        if all(0 not in requirement.signs for requirement in shown):
            return mode_of(self.formulation.problem, shown)
        options = []
        for requirement, suggested in zip(known, shown, strict=True):
            admitted = [
                pair for pair in sign_pairs(self.rules.sign) if _extends(pair, requirement.signs)
            ]
            admitted.sort(key=lambda pair, first=suggested.signs: pair != first)
            options.append([Requirement(requirement.contact, pair) for pair in admitted])
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
            if self.formulation.kinematics.feasible(extended, self.rules.sign):
                complete = self._first_feasible(options, extended)
                if complete is not None:
                    return complete
        return None


def _extends(pair: SignPair, signs: SignPair) -> bool:
    """Whether a sign pair agrees with the signs that are fixed."""
    return all(fixed in (0, sign) for sign, fixed in zip(pair, signs, strict=True))
