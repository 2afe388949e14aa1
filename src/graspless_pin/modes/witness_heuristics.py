"""Virtual motions nearest to wanted slidings: witnesses by guess, each of them checked."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from graspless_pin.caching import Bounded
from graspless_pin.problem.checks import FloatArray

# Rows are scaled to unit size, so this is the largest relative velocity that counts as zero: it
# lets four corner contacts whose normals differ by rounding share a motion.
RANK_TOLERANCE = 1e-8
MOST_KEPT = 4096
"""Sets of contacts for which something is kept."""

CLEARLY = 10.0
"""How many times faster than the threshold a sliding is that needs no search."""
GUESSES = 4
# Stands in for ranks where the answer is checked: of squared rows of unit size, far above their
# rounding and far below what a motion needs.
_DAMPING = 1e-12
_CORRECTIONS = 2

_posv, _potrf, _potrs = get_lapack_funcs(("posv", "potrf", "potrs"))


class _Seen(NamedTuple):
    """A virtual motion at s contacts.

    Attributes:
        sliding: (2 s,) velocities along t1 and t2.
        apart: (s,) velocities along n.
        motion: (P + L,) the motion, scaled.
    """

    sliding: FloatArray
    apart: FloatArray
    motion: FloatArray

    def completed(self, signs: FloatArray) -> FloatArray:
        """Return the signs, with those of the sliding in the place of zeros."""
        if np.logical_and.reduce(signs):
            return signs
        return np.where(signs != 0.0, signs, np.where(self.sliding < 0.0, -1.0, 1.0))


def judged_by(clear: float) -> tuple[float, int, float, float]:
    """Return what the compiled `witness` judges motions by; ``clear`` as in `NearestMotions`."""
    return _DAMPING, _CORRECTIONS, RANK_TOLERANCE, clear**2


class NearestMotions:
    """Damped least squares over the motions that keep contacts touching, kept between calls."""

    def __init__(self, rows: FloatArray, clear: float) -> None:
        """Take the map of `VirtualKinematics`.

        Args:
            rows: (M, 3, P + L) from the scaled motion to velocities along n, t1, t2.
            clear: The slowest sliding, over the length of all contact velocities, that counts.
        """
        self._rows = rows
        self._clear = clear
        self._known: dict[tuple[int, ...], FloatArray] = Bounded(MOST_KEPT)

    def guessed_witness(
        self, contacts: tuple[int, ...], signs: FloatArray, near: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray] | None:
        """Look for a witness without a search: near a motion, then nearest to wanted slidings.

        Args:
            contacts: s contacts that must touch and slide along both tangents.
            signs: (2 s,) signs of their sliding, 0 where any will do.
            near: (P + L,) a motion that may be close to one; None: none is known.

        Returns:
            (2 s,) the signs completed by a motion that slides with all of them, a witness under
            every rule, and (P + L,) that motion; None says nothing.
        """
        if not contacts:
            return signs, np.zeros(self._rows.shape[2])
        if near is not None and len(near) != self._rows.shape[2]:
            near = None
        if near is not None:
            seen = self._held(contacts, near)
            full = seen.completed(signs)
            if self._slides(seen, full):
                return full, seen.motion
        nearest = self._motions(contacts)
        wanted = signs
        for _ in range(GUESSES):
            seen = self._split(nearest @ wanted)
            full = seen.completed(signs)
            if self._slides(seen, full):
                return full, seen.motion
            wanted = full * np.maximum(seen.sliding * full, 1.0)
        return None

    def witness_near(
        self, contacts: tuple[int, ...], signs: NDArray[np.int8], near: FloatArray
    ) -> FloatArray | None:
        """Return a motion near another one, if it slides with signs none of which is open.

        Args:
            contacts: s contacts that must touch and slide along both tangents.
            signs: (s, 2) signs of their sliding.
            near: (P + L,) the other motion.

        Returns:
            (P + L,) a witness under every rule; None says nothing.
        """
        if not contacts:
            return near
        if len(near) != self._rows.shape[2] or np.count_nonzero(signs) < signs.size:
            return None
        seen = self._held(contacts, near)
        return seen.motion if self._slides(seen, signs.ravel()) else None

    def _slides(self, seen: _Seen, signs: FloatArray | NDArray[np.int8]) -> bool:
        """Return whether a motion keeps the contacts touching and clearly slides with all signs."""
        least = float(np.minimum.reduce(seen.sliding * signs))
        if not least > 0.0:
            return False
        size = self._size(seen.motion)
        apart = float(seen.apart.dot(seen.apart))
        return least * least >= self._clear**2 * size and apart <= RANK_TOLERANCE**2 * size

    def _size(self, motion: FloatArray) -> float:
        """Square of the length of all contact velocities of a motion."""
        velocities = self._rows.reshape(-1, len(motion)).dot(motion)
        return float(velocities.dot(velocities))

    def _held(self, contacts: tuple[int, ...], motion: FloatArray) -> _Seen:
        """Return the motion nearest to another that keeps the contacts touching."""
        rows = self._rows
        if len(contacts) < len(rows):
            rows = rows[list(contacts)]
        normal, tangential = rows[:, 0], rows[:, 1:].reshape(-1, rows.shape[2])
        factor, failed = _potrf(_damped_gram(normal), lower=1)
        if not failed:
            for _ in range(_CORRECTIONS):
                motion = motion - _potrs(factor, normal.dot(motion), lower=1)[0].dot(normal)
        return _Seen(tangential.dot(motion), normal.dot(motion), motion)

    def _motions(self, contacts: tuple[int, ...]) -> FloatArray:
        """(3 s + P + L, 2 s) from wanted slidings to tangential, normal velocities and the motion.

        Of the motions that keep the contacts touching, that with the nearest slidings, up to a
        little damping in place of the ranks: what comes out is checked.
        """
        known = self._known.get(contacts)
        if known is None:
            rows = self._rows[list(contacts)]
            normal, tangential = rows[:, 0], rows[:, 1:].reshape(-1, self._rows.shape[2])
            back = _damped_pseudo_inverse(normal)
            held = tangential - (tangential @ back) @ normal
            motion = _damped_pseudo_inverse(held)
            # Again, to take away what damping and rounding left.
            for _ in range(_CORRECTIONS):
                motion -= back @ (normal @ motion)
            known = np.concatenate([tangential @ motion, normal @ motion, motion])
            self._known[contacts] = known
        return known

    def sliding(
        self, contacts: tuple[int, ...], wanted: FloatArray
    ) -> tuple[FloatArray | None, FloatArray]:
        """Sliding, nearest to what is wanted, of a motion that keeps all the contacts touching.

        Args:
            contacts: s contacts.
            wanted: (s, 2) sliding along t1 and t2.

        Returns:
            (s, 2), 0 where it is too slow to count as a sliding; None if none was found; and the
            (P + L,) motion.
        """
        sliding, apart, motion = self._split(self._motions(contacts) @ wanted.ravel())
        size = self._size(motion)
        if float(apart @ apart) > RANK_TOLERANCE**2 * size:
            return None, motion
        fast = np.where(sliding**2 >= self._clear**2 * size, sliding, 0.0)
        return fast.reshape(-1, 2), motion

    def _split(self, found: FloatArray) -> _Seen:
        """Return what a product of `_motions` says."""
        count = (len(found) - self._rows.shape[2]) // 3
        return _Seen(found[: 2 * count], found[2 * count : 3 * count], found[3 * count :])


def _damped_pseudo_inverse(rows: FloatArray) -> FloatArray:
    """Pseudo-inverse of rows that may depend on each other, nearly: zeros if that fails too."""
    # LAPACK's own function: around such small matrices, numpy's costs several times their solution.
    _, solved, failed = _posv(_damped_gram(rows), rows)
    return np.zeros_like(rows.T) if failed else solved.T


def _damped_gram(rows: FloatArray) -> FloatArray:
    gram = rows @ rows.T
    diagonal = gram.reshape(-1)[:: len(gram) + 1]
    diagonal += _DAMPING * (1.0 + float(np.add.reduce(diagonal)))
    return gram
