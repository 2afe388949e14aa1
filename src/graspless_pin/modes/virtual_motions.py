"""Virtual motions that slide: nearest to wanted slidings, or with the fastest slowest sliding.

The former are guessed witnesses, each of them checked. The latter come with weights: where no
motion is fast enough, a combination of contact velocities that nearly vanishes proves a conflict.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from graspless_pin.caching import Bounded
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.rules import Conflict, SignRule
from graspless_pin.problem.checks import FloatArray, all_finite, read_only

# Rows are scaled to unit size, so this is the largest relative velocity that counts as zero: it
# lets four corner contacts whose normals differ by rounding share a motion.
RANK_TOLERANCE = 1e-8
MOST_KEPT = 4096
"""Number of sets of contacts for which results are cached."""

CLEARLY = 10.0
"""Slidings this many times faster than the threshold need no search."""
GUESSES = 4
# Regularises rank-deficient rows; answers are checked. Relative to squared rows of unit size: far
# above their rounding and far below what a motion needs.
_DAMPING = 1e-12
_DAMPING_CORRECTIONS = 2

_posv, _potrf, _potrs = get_lapack_funcs(("posv", "potrf", "potrs"))


class _ContactMotion(NamedTuple):
    """A virtual motion at s contacts.

    Attributes:
        sliding: (2 s,) velocities along t1 and t2.
        apart: (s,) velocities along n.
        motion: (P + L,) the motion, scaled.
    """

    sliding: FloatArray
    apart: FloatArray
    motion: FloatArray

    def completed_signs(self, signs: FloatArray) -> FloatArray:
        """Return the signs (2 s,), with those of the sliding in the place of zeros."""
        if np.logical_and.reduce(signs):
            return signs
        return np.where(signs != 0.0, signs, np.where(self.sliding < 0.0, -1.0, 1.0))


def witness_criteria(clear: float) -> tuple[float, int, float, float]:
    """Return the tolerances of the compiled `witness`; ``clear`` as in `NearestMotions`."""
    return _DAMPING, _DAMPING_CORRECTIONS, RANK_TOLERANCE, clear**2


class NearestMotions:
    """Damped least squares over the motions that keep contacts touching, with a cache."""

    def __init__(self, rows: FloatArray, clear: float) -> None:
        """Store the map of `VirtualKinematics`.

        Args:
            rows: (M, 3, P + L) from the scaled motion to velocities along n, t1, t2.
            clear: The slowest sliding, over the length of all contact velocities, that counts.
        """
        self._rows = rows
        self._clear = clear
        self._known_maps: dict[tuple[int, ...], FloatArray] = Bounded(MOST_KEPT)

    def guessed_witness(
        self, contacts: tuple[int, ...], signs: FloatArray, near: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray] | None:
        """Guess a witness: first near a given motion, then nearest to wanted slidings.

        Args:
            contacts: s contacts that must touch and slide along both tangents.
            signs: (2 s,) signs of their sliding, 0 where either will do.
            near: (P + L,) a motion that may be close to one; None: none is known.

        Returns:
            (2 s,) the signs completed by a motion that slides with all of them, a witness under
            every rule, and (P + L,) that motion; None: none was found, there may be one.
        """
        if not contacts:
            return signs, np.zeros(self._rows.shape[2])
        if near is not None and len(near) == self._rows.shape[2]:
            seen = self._nearest_touching(contacts, near)
            full = seen.completed_signs(signs)
            if self._clearly_slides(seen, full):
                return full, seen.motion
        nearest = self._motion_map(contacts)
        wanted = signs
        for _ in range(GUESSES):
            seen = self._motion_parts(nearest @ wanted)
            full = seen.completed_signs(signs)
            if self._clearly_slides(seen, full):
                return full, seen.motion
            wanted = full * np.maximum(seen.sliding * full, 1.0)
        return None

    def witness_near(
        self, contacts: tuple[int, ...], signs: NDArray[np.int8], near: FloatArray
    ) -> FloatArray | None:
        """Return the motion nearest to another one that keeps touching, if it has the signs.

        Args:
            contacts: s contacts that must touch and slide along both tangents.
            signs: (s, 2) signs of their sliding.
            near: (P + L,) the other motion.

        Returns:
            (P + L,) a witness under every rule; None: none was found, there may be one.
        """
        if not contacts:
            return near
        if len(near) != self._rows.shape[2] or np.count_nonzero(signs) < signs.size:
            return None
        seen = self._nearest_touching(contacts, near)
        return seen.motion if self._clearly_slides(seen, signs.ravel()) else None

    def _clearly_slides(self, seen: _ContactMotion, signs: FloatArray | NDArray[np.int8]) -> bool:
        """Return whether a motion keeps touching and is clearly fast enough with all signs."""
        least = float(np.minimum.reduce(seen.sliding * signs))
        if not least > 0.0:
            return False
        size = self._squared_length(seen.motion)
        apart = float(seen.apart.dot(seen.apart))
        return least * least >= self._clear**2 * size and apart <= RANK_TOLERANCE**2 * size

    def _squared_length(self, motion: FloatArray) -> float:
        """Return the squared length of all contact velocities of a motion."""
        velocities = self._rows.reshape(-1, len(motion)).dot(motion)
        return float(velocities.dot(velocities))

    def _nearest_touching(self, contacts: tuple[int, ...], motion: FloatArray) -> _ContactMotion:
        """Return the motion nearest to another that keeps the contacts touching."""
        rows = self._rows
        if len(contacts) < len(rows):
            rows = rows[list(contacts)]
        normal, tangential = rows[:, 0], rows[:, 1:].reshape(-1, rows.shape[2])
        factor, failed = _potrf(_damped_gram(normal), lower=1)
        if not failed:
            for _ in range(_DAMPING_CORRECTIONS):
                motion = motion - _potrs(factor, normal.dot(motion), lower=1)[0].dot(normal)
        return _ContactMotion(tangential.dot(motion), normal.dot(motion), motion)

    def _motion_map(self, contacts: tuple[int, ...]) -> FloatArray:
        """(3 s + P + L, 2 s) map of wanted slidings to tangential, normal velocities and motion.

        The motion is the one with the nearest slidings among those that keep the contacts touching.
        A little damping replaces rank decisions, so the result has to be checked.
        """
        cached = self._known_maps.get(contacts)
        if cached is None:
            rows = self._rows[list(contacts)]
            normal, tangential = rows[:, 0], rows[:, 1:].reshape(-1, self._rows.shape[2])
            inverse = _damped_pseudo_inverse(normal)
            projected = tangential - (tangential @ inverse) @ normal
            motion = _damped_pseudo_inverse(projected)
            # Iterative refinement against damping and rounding.
            for _ in range(_DAMPING_CORRECTIONS):
                motion -= inverse @ (normal @ motion)
            cached = np.concatenate([tangential @ motion, normal @ motion, motion])
            self._known_maps[contacts] = cached
        return cached

    def sliding(
        self, contacts: tuple[int, ...], wanted: FloatArray
    ) -> tuple[FloatArray | None, FloatArray]:
        """Return the sliding nearest to a wanted one among motions that keep contacts touching.

        Args:
            contacts: s contacts.
            wanted: (s, 2) sliding along t1 and t2.

        Returns:
            (s, 2) sliding, 0 where it is too slow to count; None if the motion found does not keep
            the contacts touching; and the (P + L,) motion.
        """
        sliding, apart, motion = self._motion_parts(self._motion_map(contacts) @ wanted.ravel())
        size = self._squared_length(motion)
        if float(apart @ apart) > RANK_TOLERANCE**2 * size:
            return None, motion
        fast = np.where(sliding**2 >= self._clear**2 * size, sliding, 0.0)
        return fast.reshape(-1, 2), motion

    def _motion_parts(self, whole: FloatArray) -> _ContactMotion:
        """Return the parts of a product of `_motion_map` with wanted slidings."""
        count = (len(whole) - self._rows.shape[2]) // 3
        return _ContactMotion(whole[: 2 * count], whole[2 * count : 3 * count], whole[3 * count :])


def _damped_pseudo_inverse(rows: FloatArray) -> FloatArray:
    """Damped pseudo-inverse of rows that may be dependent; zeros if the factorisation fails."""
    # LAPACK directly: for such small matrices numpy's overhead is several times the solution.
    _, solved, failed = _posv(_damped_gram(rows), rows)
    return np.zeros_like(rows.T) if failed else solved.T


def _damped_gram(rows: FloatArray) -> FloatArray:
    gram = rows @ rows.T
    diagonal = gram.reshape(-1)[:: len(gram) + 1]
    diagonal += _DAMPING * (1.0 + float(np.add.reduce(diagonal)))
    return gram


TAKES_PART = 1e-9
"""Weights below this share of the largest one count as zero."""
_THRESHOLD_TIE = 1.001
"""Motions that no solver brings to the threshold do not count if they are within this factor."""
_LARGEST_MOTION = 1e6
# Weights of the row for the sum in the least-squares system: small ones give more digits.
_SUM_WEIGHTS = (1.0, 1e-3, 1e-5)


class Sliding(NamedTuple):
    """The motion with the fastest slowest sliding, in coordinates y of contact velocities.

    Attributes:
        motion: (r,) the motion; zero where nothing has to slide.
        slowest: The slowest required sliding over the length of the motion.
        weights: (k,) weights of sum 1 of the rows whose combination is the motion.
    """

    motion: FloatArray
    slowest: float
    weights: FloatArray


def fastest_sliding(
    moving: FloatArray, strict: FloatArray, scale: FloatArray | None, threshold: float
) -> Sliding:
    """Return the motion that maximises the slowest required sliding.

    Args:
        moving: (k, r) rows of the required sliding.
        strict: (k,) 1 for rows that must be positive, 0 for those that must not be negative.
        scale: (k,) priority of each row where several choices of rows prove a conflict; None: all
            equal.
        threshold: The slowest sliding that counts; where none is as fast, the weights prove it.

    Raises:
        UndecidedMotionError: If no solver decides.
    """
    found = _shortest_combination(moving, strict, scale, threshold)
    return _fastest_by_program(moving, strict, threshold) if found is None else found


def _shortest_combination(
    moving: FloatArray, strict: FloatArray, scale: FloatArray | None, threshold: float
) -> Sliding | None:
    """Return the shortest combination of rows by nonnegative least squares; None where that fails.

    The answer is checked, as wrong ones occur on degenerate rows. Two kinds are their own proof: a
    combination below the threshold, and a motion that reaches the threshold in all rows.
    """
    from scipy.optimize import nnls

    best = None
    size = moving.shape[1]
    system, target = np.empty((size + 1, len(moving))), np.zeros(size + 1)
    for worth in _SUM_WEIGHTS:
        system[:size] = moving.T
        system[size] = worth * strict
        target[size] = worth
        if scale is not None:
            system *= scale
        try:
            weights = np.maximum(nnls(system, target)[0], 0.0)
        except RuntimeError:  # too many iterations, seen on degenerate rows
            break
        if scale is not None:
            weights *= scale
        total = float(weights @ strict) if all_finite((weights,)) else 0.0
        if total <= 0.0:
            continue
        weights = weights / total
        found = _sliding_of_motion(moving, strict, weights @ moving, weights)
        norm = vector_length(found.motion)
        if norm < threshold:
            return found._replace(slowest=min(found.slowest, norm))
        if found.slowest < threshold:
            even = _equal_sliding(moving, strict, found)
            if even.slowest < threshold and norm < _THRESHOLD_TIE * threshold:
                return found
            found = even
        if best is None or found.slowest > best.slowest:
            best = found
        if best.slowest >= CLEARLY * threshold:
            return best
    return None if best is None or best.slowest < threshold else best


def _equal_sliding(moving: FloatArray, strict: FloatArray, sliding: Sliding) -> Sliding:
    """Return the motion with equal sliding in all rows with a weight, where that is faster."""
    part = sliding.weights > TAKES_PART * sliding.weights.max()
    solved = np.linalg.lstsq(moving[part], strict[part], rcond=None)[0]
    equal = _sliding_of_motion(moving, strict, solved.astype(np.float64), sliding.weights)
    return equal if equal.slowest > sliding.slowest else sliding


def _sliding_of_motion(
    moving: FloatArray, strict: FloatArray, motion: FloatArray, weights: FloatArray
) -> Sliding:
    """Return a motion with its slowest required sliding; 0 where it slides the wrong way."""
    size = vector_length(motion)
    if not 0.0 < size < np.inf:
        return Sliding(motion, 0.0, weights)
    along = moving @ motion
    if np.count_nonzero(strict) == len(strict):
        return Sliding(motion, min(along.tolist()) / size, weights)
    needed = strict > 0.0
    wrong = (along[~needed] < -RANK_TOLERANCE * size).any()
    return Sliding(motion, 0.0 if wrong else float(along[needed].min()) / size, weights)


def _fastest_by_program(moving: FloatArray, strict: FloatArray, threshold: float) -> Sliding:
    """Return the fastest sliding by linear programming: max t <= 1, moving y >= strict t."""
    from scipy.optimize import linprog

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
        found = _sliding_of_motion(moving, strict, motion, np.zeros(rows))
        if found.slowest >= threshold:
            return found
    weights = np.maximum(-answer.ineqlin.marginals, 0.0)
    total = float(weights @ strict)
    if total > 0.0:
        weights /= total
    found = _sliding_of_motion(moving, strict, weights @ moving, weights)
    if not (total > 0.0 and vector_length(found.motion) < threshold):
        raise UndecidedMotionError("No solver decided whether a virtual motion exists.")
    return found._replace(slowest=min(found.slowest, vector_length(found.motion)))


def signed_rows(
    tangential: FloatArray, signs: NDArray[np.int_], rule: SignRule
) -> tuple[FloatArray, FloatArray]:
    """Return rows that must be positive (strictness 1) or not negative (0), and the strictness.

    Signed components come first. Under ``nonzero`` the components of a contact must be nonnegative
    and their sum positive, so one strict row follows for each contact with two signs.
    """
    signed = signs[:, :, None] * tangential
    nonzero = signs != 0
    rows = signed[nonzero]
    if rule is not SignRule.NONZERO:
        return rows, _ones(len(rows))
    sums = signed[nonzero.all(axis=1)].sum(axis=1)
    return np.vstack([rows, sums]), np.repeat([0.0, 1.0], [len(rows), len(sums)])


@lru_cache(maxsize=64)
def _ones(count: int) -> FloatArray:
    return read_only(np.ones(count))


def vector_length(motion: FloatArray) -> float:
    """Return the length of a vector (n,), in an eighth of the time of `numpy.linalg.norm`."""
    return math.sqrt(motion.dot(motion))


def conflict_of(
    velocity_map: FloatArray,
    contacts: tuple[int, ...],
    signs: NDArray[np.int_],
    rule: SignRule,
    still: FloatArray,
    weights: FloatArray,
    threshold: float,
) -> Conflict:
    """Return the conflict whose combination of requirements nearly vanishes.

    Args:
        velocity_map: (M, 3, r) contact velocities of all motions along n, t1, t2.
        contacts: s selected contacts.
        signs: (s, 2) their required signs.
        rule: How a zero sign is read.
        still: (k, r) rows that vanish on the selected contacts.
        weights: Weights of the required rows, see `signed_rows`.
        threshold: The slowest sliding that counts.
    """
    moving, strict = signed_rows(velocity_map[list(contacts), 1:], signs, rule)
    # Strict rows are compared with each other only, so that the largest of them always stays.
    most = np.where(strict > 0.0, (weights * strict).max(), weights.max())
    weights = np.where(weights > TAKES_PART * most, weights, 0.0)
    weights /= float(weights @ strict)
    # Each row belongs to one component, or to both of a contact (their sum).
    pairs, values = signs.tolist(), weights.tolist()
    given = [(k, m) for k, pair in enumerate(pairs) for m in (0, 1) if pair[m]]
    share = [[0.0, 0.0] for _ in contacts]
    for (k, m), weight in zip(given, values, strict=False):
        share[k][m] += weight
    both = [k for k, pair in enumerate(pairs) if all(pair)]
    for k, weight in zip(both, values[len(given) :], strict=False):
        share[k] = [own + weight for own in share[k]]
    items = tuple([(contacts[k], m, pairs[k][m]) for k, m in given if share[k][m] > 0.0])
    # Rows that vanish balance the rest of the combination; a basic solution needs few of them.
    carried = balancing_weights(still, -(weights @ moving), threshold).tolist()
    owners, places = list(contacts), [0] * len(contacts)
    if rule is SignRule.EXACT:
        zeros = np.flatnonzero(signs.ravel() == 0)
        owners += [contacts[index // 2] for index in zeros]
        places += [int(1 + index % 2) for index in zeros]
    largest = max((1.0, *map(abs, carried)))
    combination, carrying = np.zeros(velocity_map.shape[:2]), set[int]()
    combination[list(contacts), 1:] = signs * np.array(share)
    for owner, place, reaction in zip(owners, places, carried, strict=True):
        if abs(reaction) > TAKES_PART * largest:
            carrying.add(owner)
            combination[owner, place] = reaction
    others = tuple(sorted(carrying - {contact for contact, _, _ in items}))
    return Conflict(items, others, read_only(combination))


def balancing_weights(still: FloatArray, target: FloatArray, threshold: float) -> FloatArray:
    """Return weights of the vanishing rows whose combination is `target`, few if possible."""
    from scipy.optimize import nnls

    try:
        halves, _ = nnls(np.concatenate((still.T, -still.T), axis=1), target)
        if all_finite((halves,)):
            weights: FloatArray = halves[: len(still)] - halves[len(still) :]
            if vector_length(weights @ still - target) < threshold:
                return weights
    except RuntimeError:
        pass
    return np.linalg.lstsq(still.T, target)[0].astype(np.float64)
