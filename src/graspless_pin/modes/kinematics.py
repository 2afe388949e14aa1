"""Kinematic feasibility of virtual sliding: does a virtual motion realise (B, S)? Eq. (22).

Also lists all kinematically feasible virtual-sliding modes (B, S).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from threading import local
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from graspless_pin.caching import Bounded
from graspless_pin.errors import OverrunError
from graspless_pin.modes.rules import (
    Conflict,
    Requirement,
    Rules,
    SignRule,
    SlidingMode,
    StaticFriction,
    Witness,
    candidate_contacts,
)
from graspless_pin.modes.virtual_motions import (
    CLEARLY,
    MOST_KEPT,
    RANK_TOLERANCE,
    NearestMotions,
    Sliding,
    conflict_of,
    fastest_sliding,
    signed_rows,
    vector_length,
)
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, real_number, whole_number
from graspless_pin.problem.quasistatic import contact_map
from graspless_pin.tree_search import Limits, TreeSearch

THRESHOLD = 1e-6
"""Slowest sliding that counts, over the length of all contact velocities of its motion."""


@dataclass(frozen=True, eq=False)
class Touching:
    """The virtual motions in which the selected contacts keep touching.

    Attributes:
        still: (k, r) rows of the velocities that vanish.
        basis: (r, d) orthonormal basis of their null space.
        tangential: (s, 2, d) tangential rows of the selected contacts in that basis.
    """

    still: FloatArray
    basis: FloatArray
    tangential: FloatArray


class VirtualKinematics:
    """Relative contact velocities of all virtual motions [V; theta_dot] of one problem.

    A motion counts for a mode if the selected contacts keep touching and every sliding that the
    rule requires is at least the threshold times the length of all contact velocities of the
    motion. This does not depend on units, frames, lengths or the order of contacts. Searches use
    coordinates y whose length |y| is that of all contact velocities.

    Attributes:
        rows: (M, 3, P + L) maps from the scaled motion to the velocity of the object relative to
            the other body along n, t1, t2: [W^T, J] [V; -theta_dot] of eq. (22), columns scaled to
            a common size.
        scale: (P + L,) factors from a scaled motion to [V; theta_dot] in m/s and rad/s.
        nearest: Guesses witnesses by least squares, without a search.
        threshold: The slowest sliding that counts.
        undecided_near: Whether a motion was refused that a tenth of the threshold may admit.
    """

    def __init__(self, problem: QuasistaticProblem, threshold: float = THRESHOLD) -> None:
        """Assemble the scaled map."""
        self.rows: FloatArray
        self.scale: FloatArray
        self.rows, self.scale = _scaled_contact_map(contact_map(problem), problem.passive_count)
        self.nearest = NearestMotions(self.rows, CLEARLY * threshold)
        self.threshold = threshold
        self.undecided_near = False
        self._verdicts: dict[Hashable, Witness | Conflict] = Bounded(MOST_KEPT)
        self._touching: dict[tuple[tuple[int, ...], tuple[int, ...]], Touching] = Bounded(MOST_KEPT)

    @cached_property
    def _map_factors(self) -> tuple[FloatArray, FloatArray]:
        """Q (3M, r) and R P^T (r, P + L) of the scaled map, by QR with column pivoting.

        Pivots give the rank as singular values do, in a third of the time for many contacts.
        """
        rows = self.rows.reshape(-1, self.rows.shape[2])
        found: Any = qr(rows, mode="economic", pivoting=True, check_finite=False)
        Q, R, order = found
        pivots = np.abs(R.diagonal())
        rank = int((pivots > RANK_TOLERANCE * pivots.max(initial=0.0)).sum())
        back = np.empty((rank, rows.shape[1]))
        back[:, order] = R[:rank]
        return Q[:, :rank], back

    @cached_property
    def velocity_map(self) -> FloatArray:
        """(M, 3, r) contact velocities along n, t1, t2 per coordinate of y; orthonormal columns."""
        return self._map_factors[0].reshape(len(self.rows), 3, -1)

    @cached_property
    def _fastest_contact_speed(self) -> float:
        """Upper bound on the speed along n, t1 or t2 of any contact in a motion with |y| = 1."""
        return float(np.linalg.norm(self.velocity_map, axis=2).max())

    @cached_property
    def _shortest_motions(self) -> FloatArray:
        """(P + L, r) the shortest scaled motion for each coordinate of y."""
        Q, R = np.linalg.qr(self._map_factors[1].T)
        return Q @ solve_triangular(R.T, np.eye(len(R)), lower=True, check_finite=False)

    def solve(
        self,
        requirements: Sequence[Requirement],
        rule: SignRule,
        importance: FloatArray | None = None,
    ) -> Witness | Conflict:
        """Find a virtual motion that meets all requirements, or prove that there is none.

        The slowest required sliding of a motion with |y| = 1 is at most the length of any convex
        combination of the required rows. The shortest combination is, up to its length, the motion
        that attains this bound: one nonnegative least-squares problem finds both.

        Args:
            requirements: At most one per contact.
            rule: How a zero sign is read, and whether both components must move.
            importance: (number of requirements, 2) positive; a conflict is sought among the
                signs of most importance. None: any conflict will do, and the result is cached.
        """
        if importance is not None:
            return self._witness_or_conflict(requirements, rule, importance)
        key = *requirements, rule
        found = self._verdicts.get(key)
        if found is None:
            found = self._verdicts[key] = self._witness_or_conflict(requirements, rule, None)
        return found

    def _witness_or_conflict(
        self, requirements: Sequence[Requirement], rule: SignRule, importance: FloatArray | None
    ) -> Witness | Conflict:
        contacts, signs = _contacts_and_signs(requirements)
        touching, found = self._fastest_sliding(contacts, signs, rule, importance)
        if found.slowest < self.threshold:
            return conflict_of(
                self.velocity_map,
                contacts,
                signs,
                rule,
                touching.still,
                found.weights,
                self.threshold,
            )
        y = touching.basis @ found.motion
        velocities = self.velocity_map @ self._nudged_motion(y, touching.basis, found, rule)
        return Witness(y, velocities, found.slowest)

    def _nudged_motion(
        self, y: FloatArray, basis: FloatArray, found: Sliding, rule: SignRule
    ) -> FloatArray:
        """Return y plus a fixed generic motion that uses up at most half of its slack."""
        # Rows that may be zero leave no room to nudge the motion.
        if rule is SignRule.NONZERO and np.isfinite(found.slowest):
            return y
        nudge = basis @ np.cos(np.arange(1.0, basis.shape[1] + 1.0))
        reach = self._fastest_contact_speed * (vector_length(nudge) or 1.0)
        slack = found.slowest * vector_length(y) if np.isfinite(found.slowest) else 1.0
        return y + (0.5 * slack / reach) * nudge

    def feasible(self, requirements: Sequence[Requirement], rule: SignRule) -> bool:
        """Return whether `solve` finds a witness, without naming the conflict if not."""
        return self.slowest(requirements, rule) >= self.threshold

    def slowest(self, requirements: Sequence[Requirement], rule: SignRule) -> float:
        """Return the largest attainable value of the slowest required sliding.

        Relative to the length of all contact velocities; inf where nothing has to slide. Below the
        threshold no motion counts.
        """
        contacts, signs = _contacts_and_signs(requirements)
        return self._fastest_sliding(contacts, signs, rule)[1].slowest

    def meets_requirements(
        self, velocities: FloatArray, requirements: Sequence[Requirement], rule: SignRule
    ) -> bool:
        """Return whether contact velocities meet the requirements, threshold included.

        Args:
            velocities: (M, 3) along n, t1, t2.
            requirements: At most one per contact.
            rule: How a zero sign is read, and whether both components must move.
        """
        contacts, signs = _contacts_and_signs(requirements)
        size = float(np.linalg.norm(velocities))
        own = velocities[list(contacts)]
        rounding, least = RANK_TOLERANCE * size, self.threshold * size
        along = signs * own[:, 1:]
        if not contacts:
            return True
        if size == 0.0 or np.abs(own[:, 0]).max() > rounding:
            return False
        if rule is SignRule.NONZERO:
            both = (signs != 0).all(axis=1)
            return bool((along >= -rounding).all() and (along[both].sum(axis=1) >= least).all())
        zero = signs == 0
        is_zero = rule is not SignRule.EXACT or bool((np.abs(own[:, 1:][zero]) <= rounding).all())
        return is_zero and bool((along[~zero] >= least).all())

    def touching(self, contacts: tuple[int, ...]) -> Touching:
        """Return the motions y in which the contacts keep touching."""
        signs = np.zeros((len(contacts), 2), dtype=int)
        return self._touching_motions(contacts, signs, SignRule.STRICT)

    def scaled_motion(self, y: FloatArray) -> FloatArray:
        """Return the (P + L,) scaled motion of the coordinates y."""
        return self._shortest_motions @ y

    def _fastest_sliding(
        self,
        contacts: tuple[int, ...],
        signs: NDArray[np.int_],
        rule: SignRule,
        importance: FloatArray | None = None,
    ) -> tuple[Touching, Sliding]:
        """Return the motion that maximises the slowest required sliding, and its subspace.

        Where that stays below the threshold, the weights prove it.
        """
        touching = self._touching_motions(contacts, signs, rule)
        moving, strict = signed_rows(touching.tangential, signs, rule)
        if not np.count_nonzero(strict):
            nothing = np.zeros(moving.shape[1])
            return touching, Sliding(nothing, np.inf, np.zeros(len(moving)))
        scale = None
        if importance is not None and rule is not SignRule.NONZERO:
            # The algorithm takes the steepest rows first, so rows that are made longer go first.
            scale = importance[signs != 0]
        found = fastest_sliding(moving, strict, scale, self.threshold)
        if found.slowest < self.threshold <= CLEARLY * vector_length(found.motion):
            self.undecided_near = True
        return touching, found

    def _touching_motions(
        self, contacts: tuple[int, ...], signs: NDArray[np.int_], rule: SignRule
    ) -> Touching:
        """Return the motions in which the selected contacts keep touching; cached."""
        zeros: tuple[int, ...] = ()
        if rule is SignRule.EXACT:
            zeros = tuple(np.flatnonzero(signs.ravel() == 0).tolist())
        cached = self._touching.get((contacts, zeros))
        if cached is None:
            own = self.velocity_map[list(contacts)]
            matrix = own[:, 0]
            if zeros:
                matrix = np.vstack([matrix, own[:, 1:].reshape(-1, own.shape[2])[list(zeros)]])
            _, values, right = np.linalg.svd(matrix)
            least = RANK_TOLERANCE * max((1.0, *values[:1].tolist()))
            basis = right[np.count_nonzero(values > least) :].T
            tangential = own[:, 1:] @ basis
            # A row that vanishes on the basis is set to zero: rounding is no direction.
            squares = np.einsum("lij,lij->li", tangential, tangential)
            tangential[squares < RANK_TOLERANCE**2] = 0.0
            cached = self._touching[contacts, zeros] = Touching(matrix, basis, tangential)
        return cached


def kinematics_of(problem: QuasistaticProblem) -> VirtualKinematics:
    """Return the virtual motions of a problem; the last ones of this thread if they are equal.

    Loads, friction and limits do not change them, so cached results stay valid. Where a motion near
    the threshold was refused they are made anew, as `undecided_near` belongs to a single problem.
    """
    made, last = VirtualKinematics(problem), getattr(_OF_THREAD, "last", None)
    if (
        last is not None
        and not last.undecided_near
        and last.rows.shape == made.rows.shape
        and last.rows.tobytes() == made.rows.tobytes()
        and last.scale.tobytes() == made.scale.tobytes()
    ):
        return last
    _OF_THREAD.last = made
    return made


_OF_THREAD = local()


def _scaled_contact_map(contact_rows: FloatArray, passive: int) -> tuple[FloatArray, FloatArray]:
    """Return the map (M, 3, P + L) with unit columns, and (P + L,) the factors of motions."""
    size = np.sqrt(np.einsum("lij,lij->j", contact_rows, contact_rows))
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    signed = scale.copy()
    np.negative(signed[passive:], out=signed[passive:])  # the map takes -theta_dot
    return contact_rows * signed, scale


def _contacts_and_signs(
    requirements: Sequence[Requirement],
) -> tuple[tuple[int, ...], NDArray[np.int_]]:
    contacts = tuple([requirement.contact for requirement in requirements])
    return contacts, np.array([item.signs for item in requirements], dtype=int).reshape(-1, 2)


def enumerate_modes(
    problem: QuasistaticProblem,
    *,
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    maximal: bool = False,
    node_limit: int | None = None,
    time_limit: float | None = None,
) -> Iterator[SlidingMode]:
    """Yield every feasible virtual-sliding mode, lazily, depth first over the contacts.

    A restriction of a feasible mode to fewer contacts is feasible, so partial modes without a
    virtual motion are pruned at once and the work grows with the number of feasible modes.

    Under ``exact`` a zero component is a sign of its own; under ``nonzero`` the signs are those of
    a closed quadrant that holds a nonzero sliding.

    Args:
        problem: The contacts and joints.
        sign_rule: ``strict``, ``exact`` or ``nonzero``.
        sliding_rule: ``exempt`` or ``constrained``; when constrained, contacts in actual sliding
            are selected in every mode.
        maximal: Only modes that no feasible mode extends. Those are enough for an optimum: a
            larger mode allows every force of a smaller one.
        node_limit: Partial modes whose feasibility may be decided; None: any number.
        time_limit: Seconds from the request for the first mode; None: no limit.

    Raises:
        ArgumentError: If a rule is not known or lists no modes, or a limit is out of range.
        OverrunError: While modes are listed, where a limit ends that before the last one.

    Examples:
        >>> from graspless_pin import load_scene, enumerate_modes
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> sum(1 for _ in enumerate_modes(problem, maximal=True))
        262
    """
    checked_problem(problem)
    rules = Rules.parse(sign_rule, sliding_rule, StaticFriction.VIRTUAL_SLIDING)
    rules.need_signs("enumerate_modes")
    nodes = None if node_limit is None else whole_number("node_limit", node_limit, 0)
    if time_limit is not None:
        time_limit = real_number("time_limit", time_limit, 0.0, finite=False)
    return _modes_within_limits(problem, rules, maximal, nodes, time_limit)


def _modes_within_limits(
    problem: QuasistaticProblem,
    rules: Rules,
    maximal: bool,
    nodes: int | None,
    seconds: float | None,
) -> Iterator[SlidingMode]:
    is_over = Limits.from_now(nodes, seconds).is_over
    yield from feasible_modes(
        problem, VirtualKinematics(problem), rules, maximal=maximal, is_over=is_over
    )


def feasible_modes(
    problem: QuasistaticProblem,
    kinematics: VirtualKinematics,
    rules: Rules,
    *,
    maximal: bool,
    is_over: Callable[[int], bool],
) -> Iterator[SlidingMode]:
    """Yield the modes of `enumerate_modes` for known kinematics and rules.

    Args:
        problem: The contacts and joints.
        kinematics: Their virtual motions.
        rules: The rules on signs and sliding contacts.
        maximal: Only modes that no feasible mode extends.
        is_over: Whether the listing has to end, given the number of partial modes decided.

    Raises:
        OverrunError: Where it has to end before the last mode.
    """
    candidates = np.flatnonzero(candidate_contacts(problem, rules)).tolist()
    decided = 0

    def is_feasible(requirements: Sequence[Requirement]) -> bool:
        nonlocal decided
        if is_over(decided):
            raise OverrunError(
                f"a limit ended the enumeration of modes after {decided} partial modes"
            )
        decided += 1
        return kinematics.feasible(requirements, rules.sign)

    # A node: the number of decided candidates, and the requirements at those selected.
    search = TreeSearch[tuple[int, tuple[Requirement, ...]]]([(0, ())])
    for _, (depth, requirements) in search:
        if depth == len(candidates):
            if not (
                maximal and any(map(is_feasible, _extensions(requirements, candidates, rules)))
            ):
                yield mode_of(problem, requirements)
            continue
        contact = candidates[depth]
        children = []
        if not problem.is_sliding[contact]:
            children.append((depth + 1, requirements))
        for pair in sign_pairs(rules.sign):
            extended = (*requirements, Requirement(contact, pair))
            if is_feasible(extended):
                children.append((depth + 1, extended))
        search.add(reversed(children))


def _extensions(
    requirements: tuple[Requirement, ...], candidates: list[int], rules: Rules
) -> Iterator[Sequence[Requirement]]:
    """Yield the requirements with one more selected contact, or with one zero sign replaced."""
    chosen = {requirement.contact for requirement in requirements}
    for contact in candidates:
        if contact not in chosen:
            for pair in sign_pairs(rules.sign):
                yield *requirements, Requirement(contact, pair)
    for index, (contact, signs) in enumerate(requirements):
        for pair in sign_pairs(rules.sign, signs):
            if pair != signs:
                yield *requirements[:index], Requirement(contact, pair), *requirements[index + 1 :]


def sign_pairs(rule: SignRule, known: tuple[int, int] = (0, 0)) -> list[tuple[int, int]]:
    """Return the sign pairs that a selected contact can have under a rule.

    Args:
        rule: The rule.
        known: The fixed signs, 0 where a sign is open.
    """
    values = (1, 0, -1) if rule is SignRule.EXACT else (1, -1)
    first, second = ((sign,) if sign else values for sign in known)
    return [(a, b) for a, b in product(first, second) if (a, b) != (0, 0)]


def requirements_of(mode: SlidingMode) -> tuple[Requirement, ...]:
    """Return the requirements of a mode on the virtual motion, one for each selected contact."""
    return tuple(
        Requirement(int(contact), (int(mode.signs[contact, 0]), int(mode.signs[contact, 1])))
        for contact in np.flatnonzero(mode.selection)
    )


def mode_of(problem: QuasistaticProblem, requirements: tuple[Requirement, ...]) -> SlidingMode:
    """Return the mode with the contacts and signs of the requirements."""
    selection = np.zeros(problem.contact_count, dtype=bool)
    signs = np.zeros((problem.contact_count, 2), dtype=np.int8)
    for requirement in requirements:
        selection[requirement.contact] = True
        signs[requirement.contact] = requirement.signs
    return SlidingMode.unchecked(selection, signs)
