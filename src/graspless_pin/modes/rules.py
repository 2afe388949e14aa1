"""The rules that the paper leaves open, as enums, and the virtual-sliding mode (B, S).

Also the requirements on virtual motions, and the two answers to them: a witness or a conflict.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, NamedTuple, Self, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, choice, read_only
from graspless_pin.records import unchecked

SIGN_VALUES = (-1, 0, 1)


class SignRule(StrEnum):
    """What the virtual sliding of a selected contact must be, eqs. (29) and (30).

    See the example of `maximize_margin`.
    """

    STRICT = "strict"
    """Both components are nonzero: (29) and (30) taken literally."""
    EXACT = "exact"
    """One component may be zero, and then there is no static friction along it."""
    NONZERO = "nonzero"
    """The vector is nonzero; where one component is zero the friction along it is free."""
    DIRECTION = "direction"
    """The vector is nonzero, and friction opposes it exactly: no component has a meaning."""


class SlidingRule(StrEnum):
    """Whether (22) applies to the contacts in actual sliding.

    See the example of `maximize_margin`.
    """

    EXEMPT = "exempt"
    """(22) is not asked of them."""
    CONSTRAINED = "constrained"
    """(22) is asked of them with b = 1 and any sign (Sec. III-C)."""


class StaticFriction(StrEnum):
    """Which static friction is admitted. See the example of `maximize_margin`."""

    VIRTUAL_SLIDING = "virtual_sliding"
    """Only against a feasible virtual sliding: (22), (27) and (31) hold."""
    COULOMB = "coulomb"
    """Anything inside the friction cone: (22), (27) and (31) are dropped."""


class RuleOptions(TypedDict, total=False):
    """The rules as keyword options, by name."""

    sign_rule: str
    sliding_rule: str
    static_friction: str


@dataclass(frozen=True)
class Rules:
    """One reading of the virtual-sliding constraint. See the example of `maximize_margin`.

    Attributes:
        sign: The rule on the signs of a virtual sliding.
        sliding: The rule on contacts in actual sliding.
        static_friction: Whether the constraint applies at all.
    """

    sign: SignRule = SignRule.STRICT
    sliding: SlidingRule = SlidingRule.EXEMPT
    static_friction: StaticFriction = StaticFriction.VIRTUAL_SLIDING

    @classmethod
    def parse(
        cls,
        sign_rule: str = SignRule.STRICT,
        sliding_rule: str = SlidingRule.EXEMPT,
        static_friction: str = StaticFriction.VIRTUAL_SLIDING,
    ) -> Self:
        """Return the rules by name.

        Raises:
            ArgumentError: Naming the argument and the values it can have.
        """
        return cls(
            choice(SignRule, "sign_rule", sign_rule),
            choice(SlidingRule, "sliding_rule", sliding_rule),
            choice(StaticFriction, "static_friction", static_friction),
        )

    @property
    def by_direction(self) -> bool:
        """Whether friction has to oppose the virtual sliding exactly."""
        virtual = self.static_friction is StaticFriction.VIRTUAL_SLIDING
        return self.sign is SignRule.DIRECTION and virtual

    def need_signs(self, what: str) -> None:
        """Refuse the rule of directions where modes (B, S) are needed.

        Args:
            what: The subject that needs them, for the message.

        Raises:
            ArgumentError: Naming it.
        """
        if self.by_direction:
            raise ArgumentError(
                "sign_rule",
                f"is 'direction', but {what} requires modes with signs; use 'strict', 'exact' or "
                "'nonzero'",
            )

    def options(self) -> RuleOptions:
        """Return the rules as keyword options of the algorithms."""
        return {
            "sign_rule": str(self.sign),
            "sliding_rule": str(self.sliding),
            "static_friction": str(self.static_friction),
        }


@dataclass(frozen=True, eq=False)
class SlidingMode:
    """A virtual-sliding mode (B, S): which contacts virtually slide, and which way.

    See the example of `enumerate_modes`.

    Attributes:
        selection: (M,) bool, b_l of eq. (21).
        signs: (M, 2) int, s_lm of eq. (29): signs of the virtual sliding of the object relative
            to the other body along t_l1 and t_l2; static friction has the opposite signs. Rows
            of contacts that are not selected are zero.
    """

    selection: NDArray[np.bool_]
    signs: NDArray[np.int8]

    def __init__(self, selection: ArrayLike, signs: ArrayLike) -> None:
        """Validate and freeze.

        Raises:
            ArgumentError: If shapes differ, a sign is not -1, 0 or 1, or a contact that is not
                selected has a sign.
        """
        chosen = _plain_array("selection", selection)
        values = _plain_array("signs", signs)
        if not np.isin(chosen, (0, 1)).all():
            raise ArgumentError("selection", f"is {chosen.tolist()}; each must be true or false")
        chosen = chosen.astype(bool)
        if chosen.ndim != 1 or values.shape != (len(chosen), 2):
            raise ArgumentError(
                "signs", f"has shape {values.shape} for a selection of shape {chosen.shape}"
            )
        if not np.isin(values, SIGN_VALUES).all():
            raise ArgumentError("signs", f"is {values.tolist()}; each must be -1, 0 or 1")
        stray = ~chosen & values.any(axis=1)
        if stray.any():
            index = int(np.argmax(stray))
            raise ArgumentError(
                "signs",
                f"is {values[index].tolist()} at index {index}, which is not selected; it must be "
                "[0, 0] there",
            )
        object.__setattr__(self, "selection", read_only(chosen))
        object.__setattr__(self, "signs", read_only(values.astype(np.int8)))

    @classmethod
    def unchecked(cls, selection: NDArray[np.bool_], signs: NDArray[np.int8]) -> Self:
        """Return a mode of arrays that are valid by construction; they become read-only."""
        return unchecked(cls, selection=read_only(selection), signs=read_only(signs))

    @cached_property
    def contacts(self) -> tuple[int, ...]:
        """The s contacts that are selected."""
        return tuple(self.selection.nonzero()[0].tolist())

    @cached_property
    def own_signs(self) -> NDArray[np.int8]:
        """(s, 2) signs of the selected contacts."""
        return self.signs[self.selection]

    def __eq__(self, other: object) -> bool:
        """Compare by value."""
        if not isinstance(other, SlidingMode):
            return NotImplemented
        return np.array_equal(self.selection, other.selection) and np.array_equal(
            self.signs, other.signs
        )

    def __hash__(self) -> int:
        """Hash by value."""
        return hash((self.selection.tobytes(), self.signs.tobytes()))

    def __str__(self) -> str:
        """Return one token a contact: ``++``, ``+-``, ``0-`` ..., or ``..`` if not selected."""
        token = {-1: "-", 0: "0", 1: "+"}
        return " ".join(
            token[int(pair[0])] + token[int(pair[1])] if chosen else ".."
            for chosen, pair in zip(self.selection, self.signs, strict=True)
        )


def _plain_array(name: str, value: ArrayLike) -> NDArray[Any]:
    try:
        array = np.array(value)
    except ValueError:
        array = np.array(None)
    if array.dtype.kind not in "biuf":
        raise ArgumentError(name, f"is {value!r:.200}; it must be an array of numbers")
    return array


def candidate_contacts(problem: QuasistaticProblem, rules: Rules) -> NDArray[np.bool_]:
    """(M,) contacts that a mode may select.

    Those with a friction cone and, when actual sliding is constrained, those that slide. A
    frictionless contact at rest has no friction to constrain and is never selected.
    """
    return problem.has_cone | required_contacts(problem, rules)


def required_contacts(problem: QuasistaticProblem, rules: Rules) -> NDArray[np.bool_]:
    """(M,) contacts in actual sliding that every mode selects (Sec. III-C)."""
    return problem.is_sliding & (rules.sliding is SlidingRule.CONSTRAINED)


class Requirement(NamedTuple):
    """The signs that the virtual sliding at one selected contact must have.

    Attributes:
        contact: Index of the contact.
        signs: s_l1, s_l2 in {-1, 0, 1}; the meaning of 0 depends on the sign rule: under ``exact``
            the component is zero; under ``strict`` and ``nonzero`` it is unconstrained, and under
            ``nonzero`` the contact then need not move at all.
    """

    contact: int
    signs: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Conflict:
    """A certificate of Farkas' type that no virtual motion meets some requirements.

    Attributes:
        signs: (contact, component, sign) items with a positive weight.
        contacts: Contacts that enter only by being selected (normal velocity zero, or
            tangential velocity zero under ``exact``).
        combination: (M, 3) weights of the contact velocities along n, t1, t2. Those of the items
            have their signs and a sum of 1 (under ``nonzero``: the smaller of each contact's two).
            Projected onto the contact velocities of all motions it is shorter than the threshold,
            so no motion of unit contact velocities slides as fast as the threshold in all items.
    """

    signs: tuple[tuple[int, int, int], ...]
    contacts: tuple[int, ...]
    combination: FloatArray

    @property
    def involved(self) -> frozenset[int]:
        """All contacts with a weight in the combination."""
        return frozenset([*self.contacts, *(contact for contact, _, _ in self.signs)])


@dataclass(frozen=True, eq=False)
class Blocked:
    """A proof that requirements leave a selected contact no sign along one tangent.

    Attributes:
        contact: Index of the contact.
        component: 0 for t1, 1 for t2.
        conflicts: One for each sign that the component could still have.
    """

    contact: int
    component: int
    conflicts: tuple[Conflict, ...]

    @property
    def involved(self) -> frozenset[int]:
        """The contact itself and all contacts of the conflicts."""
        return frozenset([self.contact]).union(*(one.involved for one in self.conflicts))


@dataclass(frozen=True, eq=False)
class Witness:
    """A virtual motion that meets the requirements.

    Attributes:
        coordinates: (r,) y of the motion, see `VirtualKinematics.scaled_motion`.
        velocities: (M, 3) relative velocity of the object at each contact along n, t1, t2, to
            scale. The motion is perturbed within its slack in a fixed generic direction, so that a
            component that can move does not vanish by symmetry.
        slowest: The slowest required sliding over the length of all contact velocities; inf where
            nothing has to slide.
    """

    coordinates: FloatArray
    velocities: FloatArray
    slowest: float
