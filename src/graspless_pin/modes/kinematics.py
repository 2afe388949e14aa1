"""Kinematic feasibility of virtual sliding: is there a virtual motion behind (B, S)? Eq. (22)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, nnls

from graspless_pin.compiled import contact_frames
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.nearest_motions import (
    CLEARLY,
    MOST_KEPT,
    RANK_TOLERANCE,
    NearestMotions,
)
from graspless_pin.modes.rules import SignRule
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.contact_map import contact_map

THRESHOLD = 1e-6
"""A sliding counts if it is at least this share of all contact velocities of its motion."""
_TIE = 1.001
"""A motion that is this close to the threshold, and that no solver brings to it, does not count."""
_IN_CONFLICT = 1e-9
_LARGEST_MOTION = 1e6
# What the sum of the weights is worth beside the velocities: less where more digits are needed.
_WORTH = (1.0, 1e-3, 1e-5)


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


@dataclass(frozen=True, eq=False)
class Conflict:
    """A proof that requirements exclude each other: a combination of them all but vanishes.

    Attributes:
        signs: (contact, component, sign) items that take part with a positive weight.
        contacts: Contacts that take part only by being selected (normal velocity zero, or
            tangential velocity zero under ``exact``).
        combination: (M, 3) weights of the contact velocities along n, t1, t2. Those of the items
            have their signs and a sum of 1 (under ``nonzero``: the smaller of each contact's two);
            the part of them that any motion can see is shorter than the threshold, so no motion of
            unit contact velocities slides as fast as the threshold in all items. None where two
            conflicts, one for either sign of a component that must move, make this one.
    """

    signs: tuple[tuple[int, int, int], ...]
    contacts: tuple[int, ...]
    combination: FloatArray | None


@dataclass(frozen=True, eq=False)
class Witness:
    """A virtual motion that meets the requirements.

    Attributes:
        motion: (6 + L,) scaled virtual motion.
        velocities: (M, 3) relative velocity of the object at each contact along n, t1, t2, to
            scale. Those of the motion nudged within its slack in a fixed generic direction, so that
            a component that can move does not vanish by symmetry.
        slowest: The slowest required sliding over the length of all contact velocities; inf where
            nothing has to slide.
    """

    motion: FloatArray
    velocities: FloatArray
    slowest: float


class _Sliding(NamedTuple):
    """The motion that slides fastest where it is slowest, in coordinates of contact velocities.

    Attributes:
        motion: (r,) the motion; zero where nothing has to slide.
        slowest: The slowest required sliding over the length of the motion.
        weights: (k,) weights of the rows whose combination is the motion, of sum 1.
    """

    motion: FloatArray
    slowest: float
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class _Touching:
    """The motions that leave some contacts touching.

    Attributes:
        still: (k, r) rows that vanish.
        basis: (r, d) orthonormal basis of the motions on which they do.
        tangential: (s, 2, d) tangential rows of the selected contacts on that basis.
    """

    still: FloatArray
    basis: FloatArray
    tangential: FloatArray


class VirtualKinematics:
    """Relative contact velocities of all virtual motions [V; theta_dot] of one problem.

    A motion counts for a mode if the selected contacts keep touching and every sliding that the
    rule asks for is at least the threshold times the length of all contact velocities of the
    motion: no unit, frame, length or order of contacts changes that. Searches work in coordinates y
    of unit contact velocities, |y| being their length.

    Attributes:
        rows: (M, 3, 6 + L) maps from the scaled motion to the velocity of the object relative to
            the other body along n, t1, t2: [W^T, J] [V; -theta_dot] of eq. (22), columns scaled to
            a common size.
        scale: (6 + L,) factors from a scaled motion to [V; theta_dot] in m/s and rad/s.
        nearest: Witnesses by guess, which need no search.
        threshold: The slowest sliding that counts.
        undecided_near: Whether a motion was refused that a tenth of the threshold may admit.
    """

    def __init__(self, problem: QuasistaticProblem, threshold: float = THRESHOLD) -> None:
        """Assemble the scaled map."""
        self.rows: FloatArray
        self.scale: FloatArray
        self.rows, self.scale = _scaled(contact_map(problem))
        self.nearest = NearestMotions(self.rows, CLEARLY * threshold)
        self.threshold = threshold
        self.undecided_near = False
        self._touching: dict[tuple[tuple[int, ...], tuple[int, ...]], _Touching] = {}

    @cached_property
    def _seen(self) -> tuple[FloatArray, FloatArray]:
        """Orthonormal coordinates of the contact velocities, and the motions behind them.

        Motions that no contact notices are left out.
        """
        count, _, size = self.rows.shape
        left, values, right = np.linalg.svd(self.rows.reshape(-1, size), full_matrices=False)
        rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
        return left[:, :rank].reshape(count, 3, rank), right[:rank].T / values[:rank]

    @property
    def seen(self) -> FloatArray:
        """(M, 3, r) contact velocities along n, t1, t2 of each coordinate of y; orthonormal."""
        return self._seen[0]

    def solve(
        self,
        requirements: Sequence[Requirement],
        rule: SignRule,
        importance: FloatArray | None = None,
    ) -> Witness | Conflict:
        """Find a virtual motion that meets all requirements, or prove that there is none.

        The slowest required sliding of a motion of unit contact velocities is at most the length of
        any combination of the required rows with nonnegative weights of sum 1, and the shortest
        combination is that motion: one nonnegative least-squares problem finds both.

        Args:
            requirements: At most one per contact.
            rule: How a zero sign is read, and whether both components must move.
            importance: (number of requirements, 2) positive; a conflict is sought among the
                signs of most importance. None: any conflict will do.
        """
        contacts, signs = _split(requirements)
        touching, found = self._fastest(contacts, signs, rule, importance)
        if found.slowest < self.threshold:
            return self._conflict(contacts, signs, rule, touching.still, found.weights)
        y = touching.basis @ found.motion
        velocities = self.seen @ self._nudged(y, touching.basis, found, rule)
        return Witness(self._seen[1] @ y, velocities, found.slowest)

    def _nudged(
        self, y: FloatArray, basis: FloatArray, found: _Sliding, rule: SignRule
    ) -> FloatArray:
        """A motion with a little of a fixed generic one, within half of its slack."""
        # Rows that may be zero leave no room to nudge the motion.
        if rule is SignRule.NONZERO and np.isfinite(found.slowest):
            return y
        nudge = basis @ np.cos(np.arange(1.0, basis.shape[1] + 1.0))
        reach = np.linalg.norm(self.seen, axis=2).max() * (np.linalg.norm(nudge) or 1.0)
        slack = found.slowest * np.linalg.norm(y) if np.isfinite(found.slowest) else 1.0
        return y + (0.5 * slack / reach) * nudge

    def feasible(self, requirements: Sequence[Requirement], rule: SignRule) -> bool:
        """Whether `solve` finds a witness, without naming the conflict if not."""
        contacts, signs = _split(requirements)
        return self._fastest(contacts, signs, rule)[1].slowest >= self.threshold

    def slowest(self, requirements: Sequence[Requirement], rule: SignRule) -> float:
        """Return the slowest required sliding of the best motion; below the threshold: none counts.

        It is relative to the length of all contact velocities; inf where nothing has to slide.
        """
        contacts, signs = _split(requirements)
        return self._fastest(contacts, signs, rule)[1].slowest

    def witness(self, requirements: Sequence[Requirement], rule: SignRule) -> FloatArray | None:
        """Velocities (M, 3) along n, t1, t2 of a motion that meets the requirements, or None.

        Without conflicts named and without the nudge of `Witness.velocities`.
        """
        contacts, signs = _split(requirements)
        touching, found = self._fastest(contacts, signs, rule)
        if found.slowest < self.threshold:
            return None
        velocities: FloatArray = self.seen @ (touching.basis @ found.motion)
        return velocities

    def counts(
        self, velocities: FloatArray, requirements: Sequence[Requirement], rule: SignRule
    ) -> bool:
        """Return whether contact velocities meet requirements by the rule for motions.

        Args:
            velocities: (M, 3) along n, t1, t2.
            requirements: At most one per contact.
            rule: How a zero sign is read, and whether both components must move.
        """
        contacts, signs = _split(requirements)
        size = float(np.linalg.norm(velocities))
        here = velocities[list(contacts)]
        rest, clear = RANK_TOLERANCE * size, self.threshold * size
        along = signs * here[:, 1:]
        if not contacts:
            return True
        if size == 0.0 or np.abs(here[:, 0]).max() > rest:
            return False
        if rule is SignRule.NONZERO:
            both = (signs != 0).all(axis=1)
            return bool((along >= -rest).all() and (along[both].sum(axis=1) >= clear).all())
        zero = signs == 0
        still = rule is not SignRule.EXACT or bool((np.abs(here[:, 1:][zero]) <= rest).all())
        return still and bool((along[~zero] >= clear).all())

    def touching_basis(self, contacts: tuple[int, ...]) -> FloatArray:
        """(r, d) orthonormal basis of the motions y that leave contacts touching."""
        signs = np.zeros((len(contacts), 2), dtype=int)
        return self._touching_motions(contacts, signs, SignRule.STRICT).basis

    def _fastest(
        self,
        contacts: tuple[int, ...],
        signs: NDArray[np.int_],
        rule: SignRule,
        importance: FloatArray | None = None,
    ) -> tuple[_Touching, _Sliding]:
        """The motion that slides fastest where it is slowest.

        Where none is as fast as the threshold, the weights prove that.
        """
        touching = self._touching_motions(contacts, signs, rule)
        moving, strict = _signed_rows(touching.tangential, signs, rule)
        if not strict.any():
            nothing = np.zeros(moving.shape[1])
            return touching, _Sliding(nothing, np.inf, np.zeros(len(moving)))
        scale = np.ones(len(moving))
        if importance is not None and rule is not SignRule.NONZERO:
            # The algorithm takes the steepest rows first, so rows that are made longer go first.
            scale = importance[signs != 0]
        found = _shortest(moving, strict, scale, self.threshold)
        if found is None:
            found = _by_linear_program(moving, strict, self.threshold)
        if found.slowest < self.threshold <= CLEARLY * np.linalg.norm(found.motion):
            self.undecided_near = True
        return touching, found

    def _touching_motions(
        self, contacts: tuple[int, ...], signs: NDArray[np.int_], rule: SignRule
    ) -> _Touching:
        """The motions on which the selected contacts stay touching, kept between calls."""
        zeros: tuple[int, ...] = ()
        if rule is SignRule.EXACT:
            zeros = tuple(np.flatnonzero(signs.ravel() == 0).tolist())
        known = self._touching.get((contacts, zeros))
        if known is None:
            rows = self.seen
            still = [rows[contact, 0] for contact in contacts]
            still += [rows[contacts[index // 2], 1 + index % 2] for index in zeros]
            matrix = np.array(still).reshape(-1, rows.shape[2])
            _, values, right = np.linalg.svd(matrix)
            rank = int((values > RANK_TOLERANCE * max(1.0, values.max(initial=0.0))).sum())
            basis = right[rank:].T
            tangential = rows[list(contacts), 1:] @ basis
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
        """Name the requirements whose combination all but vanishes."""
        moving, strict = _signed_rows(self.seen[list(contacts), 1:], signs, rule)
        # Rows that must be positive stay whatever the others weigh.
        most = np.where(strict > 0.0, (weights * strict).max(), weights.max())
        weights = np.where(weights > _IN_CONFLICT * most, weights, 0.0)
        weights /= float(weights @ strict)
        # Each weighted row stands for one component, or for both of a contact (their sum).
        share = np.zeros((len(contacts), 2))
        given = np.argwhere(signs != 0)
        np.add.at(share, tuple(given.T), weights[: len(given)])
        both = np.flatnonzero((signs != 0).all(axis=1))
        share[both] += weights[len(given) :, None] if len(weights) > len(given) else 0.0
        items = tuple(
            (contacts[position], int(component), int(signs[position, component]))
            for position, component in np.argwhere(share > 0.0)
        )
        # The rest of the combination is carried by rows that vanish: a basic solution names few.
        reactions = _reactions(still, -(weights @ moving), self.threshold)
        owners, places = list(contacts), [0] * len(contacts)
        if rule is SignRule.EXACT:
            zeros = np.flatnonzero(signs.ravel() == 0)
            owners += [contacts[index // 2] for index in zeros]
            places += [int(1 + index % 2) for index in zeros]
        largest = max(1.0, np.abs(reactions).max(initial=0.0))
        combination, carrying = np.zeros(self.rows.shape[:2]), set[int]()
        combination[list(contacts), 1:] = signs * share
        for owner, place, reaction in zip(owners, places, reactions, strict=True):
            if abs(reaction) > _IN_CONFLICT * largest:
                carrying.add(owner)
                combination[owner, place] = reaction
        others = tuple(sorted(carrying - {contact for contact, _, _ in items}))
        return Conflict(items, others, read_only(combination))


def _reactions(still: FloatArray, rest: FloatArray, threshold: float) -> FloatArray:
    """Weights of rows that vanish which make up for the rest of a combination, few if possible."""
    try:
        halves, _ = nnls(np.hstack([still.T, -still.T]), rest)
        if np.isfinite(halves).all():
            reactions: FloatArray = halves[: len(still)] - halves[len(still) :]
            if np.linalg.norm(reactions @ still - rest) < threshold:
                return reactions
    except RuntimeError:
        pass
    return np.linalg.lstsq(still.T, rest)[0].astype(np.float64)


def _shortest(
    moving: FloatArray, strict: FloatArray, scale: FloatArray, threshold: float
) -> _Sliding | None:
    """The shortest combination of rows, by nonnegative least squares; None where that fails.

    The solver is not believed: a wrong answer has been seen on degenerate rows. A short combination
    proves itself, and so does a motion that slides as fast as the threshold in all rows.
    """
    best = None
    for worth in _WORTH:
        system = np.empty((moving.shape[1] + 1, len(moving)))
        system[:-1] = moving.T
        system[-1] = worth * strict
        target = np.zeros(len(system))
        target[-1] = worth
        try:
            weights = scale * np.maximum(nnls(system * scale, target)[0], 0.0)
        except RuntimeError:  # too many iterations, seen on degenerate rows
            break
        total = float(weights @ strict) if np.isfinite(weights).all() else 0.0
        if total <= 0.0:
            continue
        found = _judged(moving, strict, weights / total)
        size = float(np.linalg.norm(found.motion))
        if size < threshold:
            return found._replace(slowest=min(found.slowest, size))
        if found.slowest < threshold:
            even = _evened(moving, strict, found)
            if even.slowest < threshold and size < _TIE * threshold:
                return found
            found = even
        if best is None or found.slowest > best.slowest:
            best = found
        if best.slowest >= CLEARLY * threshold:
            return best
    return None if best is None or best.slowest < threshold else best


def _evened(moving: FloatArray, strict: FloatArray, found: _Sliding) -> _Sliding:
    """The motion that slides equally in all rows that take part, where that is faster."""
    part = found.weights > _IN_CONFLICT * found.weights.max()
    solved = np.linalg.lstsq(moving[part], strict[part], rcond=None)[0]
    other = _speed(moving, strict, solved.astype(np.float64), found.weights)
    return other if other.slowest > found.slowest else found


def _judged(moving: FloatArray, strict: FloatArray, weights: FloatArray) -> _Sliding:
    """What a combination of rows is worth as a motion."""
    return _speed(moving, strict, weights @ moving, weights)


def _speed(
    moving: FloatArray, strict: FloatArray, motion: FloatArray, weights: FloatArray
) -> _Sliding:
    """How fast a motion slides where it is slowest; not at all if it slides a wrong way."""
    size = float(np.linalg.norm(motion))
    if not 0.0 < size < np.inf:
        return _Sliding(motion, 0.0, weights)
    along = moving @ motion / size
    needed = strict > 0.0
    wrong = (along[~needed] < -RANK_TOLERANCE).any()
    return _Sliding(motion, 0.0 if wrong else float(along[needed].min()), weights)


def _by_linear_program(moving: FloatArray, strict: FloatArray, threshold: float) -> _Sliding:
    """Decide by a linear program: the largest t <= 1 with moving y >= strict t, y bounded."""
    rows, size = moving.shape
    answer = linprog(
        np.append(np.zeros(size), -1.0),
        A_ub=np.hstack([-moving, strict[:, None]]),
        b_ub=np.zeros(rows),
        bounds=[(-_LARGEST_MOTION, _LARGEST_MOTION)] * size + [(0.0, 1.0)],
        method="highs",
    )
    if answer.status != 0:
        raise UndecidedMotionError(
            f"No solver decided whether a virtual motion exists: {answer.message}"
        )
    if answer.x[-1] > 0.5:
        motion = answer.x[:-1]
        found = _speed(moving, strict, motion, np.zeros(rows))
        if found.slowest >= threshold:
            return found
    weights = np.maximum(-answer.ineqlin.marginals, 0.0)
    total = float(weights @ strict)
    found = _judged(moving, strict, weights / total) if total > 0.0 else None
    if found is None or not np.linalg.norm(found.motion) < threshold:
        raise UndecidedMotionError("No solver decided whether a virtual motion exists.")
    return found._replace(slowest=min(found.slowest, float(np.linalg.norm(found.motion))))


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
