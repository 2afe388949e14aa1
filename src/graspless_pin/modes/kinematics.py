"""Kinematic feasibility of virtual sliding: is there a virtual motion behind (B, S)? Eq. (22)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, nnls

from graspless_pin.compiled import contact_frames
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.nearest_motions import MOST_KEPT, RANK_TOLERANCE, NearestMotions
from graspless_pin.modes.rules import SignRule
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.contact_map import contact_map

# A witness with |x| = 1 / sqrt(this) for unit requirements is as good as none.
_NO_WITNESS = 1e-12
_IN_CONFLICT = 1e-9
_ROUNDING = 1e-12
_LARGEST_MOTION = 1e6


class Requirement(NamedTuple):
    """What is asked of the virtual sliding at one selected contact.

    Attributes:
        contact: Index of the contact.
        signs: s_l1, s_l2 in {-1, 0, 1}; what 0 asks depends on the sign rule: under ``exact`` the
            component is zero; under ``strict`` and ``nonzero`` it is not looked at, and neither
            is, under ``nonzero``, whether the contact moves at all.
    """

    contact: int
    signs: tuple[int, int]


@dataclass(frozen=True)
class Conflict:
    """A proof that requirements exclude each other: a positive combination of them is zero.

    Attributes:
        signs: (contact, component, sign) items that take part with a positive weight.
        contacts: Contacts that take part only by being selected (normal velocity zero, or
            tangential velocity zero under ``exact``).
    """

    signs: tuple[tuple[int, int, int], ...]
    contacts: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Witness:
    """A virtual motion that meets the requirements.

    Attributes:
        motion: (6 + L,) scaled virtual motion.
        rows: (M, 3, 6 + L) the map of `VirtualKinematics`.
        basis: (6 + L, d) motions that leave the selected contacts touching.
        slack: How far the required velocities are from zero, for unit rows.
    """

    motion: FloatArray
    rows: FloatArray
    basis: FloatArray
    slack: float

    @property
    def velocities(self) -> FloatArray:
        """(M, 3) relative velocity of the object at each contact along n, t1, t2, to scale.

        The motion is nudged within its slack in a fixed generic direction, so that a component
        that can move does not vanish by symmetry.
        """
        direction = np.cos(np.arange(1.0, self.basis.shape[1] + 1.0))
        nudge = self.basis @ direction
        reach = np.linalg.norm(self.rows, axis=2).max() * (np.linalg.norm(nudge) or 1.0)
        return self.rows @ (self.motion + (0.5 * self.slack / reach) * nudge)


@dataclass(frozen=True, eq=False)
class _Touching:
    """The motions that leave some contacts touching.

    Attributes:
        still: (k, 6 + L) rows that vanish.
        basis: (6 + L, d) orthonormal basis of the motions on which they do.
        tangential: (s, 2, d) tangential rows of the selected contacts on that basis.
    """

    still: FloatArray
    basis: FloatArray
    tangential: FloatArray


class VirtualKinematics:
    """Relative contact velocities of all virtual motions [V; theta_dot] of one problem.

    Attributes:
        rows: (M, 3, 6 + L) maps from the scaled motion to the velocity of the object relative to
            the other body along n, t1, t2: [W^T, J] [V; -theta_dot] of eq. (22), columns scaled to
            a common size.
        scale: (6 + L,) factors from a scaled motion to [V; theta_dot] in m/s and rad/s.
        nearest: Witnesses by guess, which need no search.
    """

    def __init__(self, problem: QuasistaticProblem) -> None:
        """Assemble the scaled map."""
        self.rows: FloatArray
        self.scale: FloatArray
        self.rows, self.scale = _scaled(contact_map(problem))
        self.nearest = NearestMotions(self.rows)
        self._touching: dict[tuple[tuple[int, ...], tuple[int, ...]], _Touching] = {}

    def solve(
        self,
        requirements: Sequence[Requirement],
        rule: SignRule,
        importance: FloatArray | None = None,
    ) -> Witness | Conflict:
        """Find a virtual motion that meets all requirements, or prove that there is none.

        Feasible exactly when no nonzero, nonnegative combination of the sign requirements
        vanishes on the motions that leave the selected contacts touching (Gordan's theorem);
        the nearest such combination is one nonnegative least-squares problem, whose residual is
        the motion sought.

        Args:
            requirements: At most one per contact.
            rule: How a zero sign is read, and whether both components must move.
            importance: (number of requirements, 2) positive; a conflict is sought among the
                signs of most importance. None: any conflict will do.
        """
        contacts, signs = _split(requirements)
        touching, moving, weights, slack = self._combine(contacts, signs, rule, importance)
        if slack > 0.0:
            motion = touching.basis @ (weights @ moving)
            # Rows that may be zero leave no room to nudge the motion.
            room = 0.0 if rule is SignRule.NONZERO else slack
            return Witness(motion, self.rows, touching.basis, room)
        return self._conflict(contacts, signs, rule, touching.still, weights)

    def feasible(self, requirements: Sequence[Requirement], rule: SignRule) -> bool:
        """Whether `solve` finds a witness, without naming the conflict if not."""
        contacts, signs = _split(requirements)
        return self._combine(contacts, signs, rule)[3] > 0.0

    def witness(self, requirements: Sequence[Requirement], rule: SignRule) -> FloatArray | None:
        """Velocities (M, 3) along n, t1, t2 of a motion that meets the requirements, or None.

        Without conflicts named and without the nudge of `Witness.velocities`.
        """
        contacts, signs = _split(requirements)
        touching, moving, weights, slack = self._combine(contacts, signs, rule)
        if slack <= 0.0:
            return None
        velocities: FloatArray = self.rows @ (touching.basis @ (weights @ moving))
        return velocities

    def touching_basis(self, contacts: tuple[int, ...]) -> FloatArray:
        """(6 + L, d) orthonormal basis of the motions that leave contacts touching."""
        signs = np.zeros((len(contacts), 2), dtype=int)
        return self._touching_motions(contacts, signs, SignRule.STRICT).basis

    def _combine(
        self,
        contacts: tuple[int, ...],
        signs: NDArray[np.int_],
        rule: SignRule,
        importance: FloatArray | None = None,
    ) -> tuple[_Touching, FloatArray, FloatArray, float]:
        """Weights of the rows' combination nearest to zero, and its slack, 0 if it vanishes."""
        touching = self._touching_motions(contacts, signs, rule)
        moving, strictness = _signed_rows(touching.tangential, signs, rule)
        if not strictness.any():
            return touching, moving, np.zeros(len(moving)), 1.0
        system = np.empty((moving.shape[1] + 1, len(moving)))
        system[:-1] = moving.T
        system[-1] = strictness
        target = np.zeros(len(system))
        target[-1] = 1.0
        scale = np.ones(len(moving))
        if importance is not None and rule is not SignRule.NONZERO:
            # The algorithm takes the steepest rows first, so rows that are made longer go first.
            scale = importance[signs != 0]
        try:
            weights = scale * nnls(system * scale, target)[0]
        except RuntimeError:  # too many iterations, seen on degenerate rows
            weights, slack = _by_linear_program(moving, strictness)
            return touching, moving, weights, slack
        residual = target - system @ weights
        slack = float(residual @ residual)
        # The solver is not believed: a vanishing residual proves itself, and so does one on whose
        # far side every row lies. A wrong answer has been seen on degenerate rows.
        if slack > _NO_WITNESS and (residual @ system).max() > _ROUNDING + 1e-6 * slack:
            weights, slack = _by_linear_program(moving, strictness)
            return touching, moving, weights, slack
        return touching, moving, weights, slack if slack > _NO_WITNESS else 0.0

    def _touching_motions(
        self, contacts: tuple[int, ...], signs: NDArray[np.int_], rule: SignRule
    ) -> _Touching:
        """The motions on which the selected contacts stay touching, kept between calls."""
        zeros: tuple[int, ...] = ()
        if rule is SignRule.EXACT:
            zeros = tuple(np.flatnonzero(signs.ravel() == 0).tolist())
        known = self._touching.get((contacts, zeros))
        if known is None:
            still = [self.rows[contact, 0] for contact in contacts]
            still += [self.rows[contacts[index // 2], 1 + index % 2] for index in zeros]
            matrix = np.array(still).reshape(-1, self.rows.shape[2])
            _, values, right = np.linalg.svd(matrix)
            rank = int((values > RANK_TOLERANCE * max(1.0, values.max(initial=0.0))).sum())
            basis = right[rank:].T
            tangential = self.rows[list(contacts), 1:] @ basis
            # A row that vanishes there must vanish exactly, or rounding passes for a direction.
            tangential[np.linalg.norm(tangential, axis=2) < RANK_TOLERANCE] = 0.0
            if len(self._touching) >= MOST_KEPT:
                self._touching.clear()
            known = self._touching[contacts, zeros] = _Touching(matrix, basis, tangential)
        return known

    def _conflict(
        self,
        contacts: tuple[int, ...],
        signs: NDArray[np.int_],
        rule: SignRule,
        still: FloatArray,
        weights: FloatArray,
    ) -> Conflict:
        """Name the requirements whose combination vanishes."""
        moving, _ = _signed_rows(self.rows[list(contacts), 1:], signs, rule)
        weights = np.where(weights > _IN_CONFLICT * weights.max(), weights, 0.0)
        # Each weighted row stands for one component, or for both of a contact (their sum).
        share = np.zeros((len(contacts), 2), dtype=bool)
        given = np.argwhere(signs != 0)
        for (position, component), weight in zip(given, weights, strict=False):
            share[position, component] |= weight > 0.0
        both = np.flatnonzero((signs != 0).all(axis=1))
        for position, weight in zip(both, weights[len(given) :], strict=False):
            share[position] |= weight > 0.0
        items = tuple(
            (contacts[position], int(component), int(signs[position, component]))
            for position, component in np.argwhere(share)
        )
        # The rest of the combination is carried by rows that vanish: a basic solution names few.
        rest = -(weights @ moving)
        try:
            reactions, _ = nnls(np.hstack([still.T, -still.T]), rest)
            reactions = np.abs(reactions[: len(still)] - reactions[len(still) :])
        except RuntimeError:
            reactions = np.abs(np.linalg.lstsq(still.T, rest)[0])
        owners = list(contacts)
        if rule is SignRule.EXACT:
            owners += [contacts[index // 2] for index in np.flatnonzero(signs.ravel() == 0)]
        largest = max(1.0, reactions.max(initial=0.0))
        carrying = {
            owner
            for owner, reaction in zip(owners, reactions, strict=True)
            if reaction > _IN_CONFLICT * largest
        }
        return Conflict(items, tuple(sorted(carrying - {contact for contact, _, _ in items})))


def _by_linear_program(moving: FloatArray, strictness: FloatArray) -> tuple[FloatArray, float]:
    """Decide by a linear program: the largest t <= 1 with moving x >= strictness t, x bounded.

    Returns:
        Weights of a combination that vanishes (the multipliers) and slack 0, or weights whose
        combination is a witness and its slack.
    """
    rows, size = moving.shape
    answer = linprog(
        np.append(np.zeros(size), -1.0),
        A_ub=np.hstack([-moving, strictness[:, None]]),
        b_ub=np.zeros(rows),
        bounds=[(-_LARGEST_MOTION, _LARGEST_MOTION)] * size + [(0.0, 1.0)],
        method="highs",
    )
    if answer.status != 0:
        raise UndecidedMotionError(
            f"No solver decided whether a virtual motion exists: {answer.message}"
        )
    if answer.x[-1] > 0.5:
        motion = answer.x[:-1] / (1.0 + np.linalg.norm(answer.x[:-1]) ** 2)
        return np.linalg.lstsq(moving.T, motion, rcond=None)[0], float(motion @ motion)
    weights = -answer.ineqlin.marginals
    return weights / weights.sum(), 0.0


def _scaled(local: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The map (M, 3, 6 + L) with columns of one size, and the (6 + L,) factors of its motions."""
    if contact_frames is not None:
        return contact_frames.scaled_map(local)
    size = np.sqrt(np.einsum("lij,lij->j", local, local))
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    signed = scale.copy()
    np.negative(signed[6:], out=signed[6:])  # the map takes -theta_dot
    return local * signed, scale


def _split(requirements: Sequence[Requirement]) -> tuple[tuple[int, ...], NDArray[np.int_]]:
    contacts = tuple([requirement.contact for requirement in requirements])
    return contacts, np.array([item.signs for item in requirements], dtype=int).reshape(-1, 2)


def _signed_rows(
    tangential: FloatArray, signs: NDArray[np.int_], rule: SignRule
) -> tuple[FloatArray, FloatArray]:
    """Rows that must be positive (strictness 1) or not negative (0): signed components first.

    Under ``nonzero`` the components of a contact need only be nonnegative each and positive
    together, so a strict row for their sum follows for each contact with two signs.
    """
    signed = signs[:, :, None] * tangential
    nonzero = signs != 0
    rows = signed[nonzero]
    if rule is not SignRule.NONZERO:
        return rows, np.ones(len(rows))
    sums = signed[nonzero.all(axis=1)].sum(axis=1)
    return np.vstack([rows, sums]), np.repeat([0.0, 1.0], [len(rows), len(sums)])
