"""Virtual motions that slide in given sectors of directions, or a proof that there are none.

Under the rule ``direction`` friction opposes the virtual sliding exactly. A sector is an interval
of angles about a contact's normal: the sliding lies in it, and friction opposes its directions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np

from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.virtual_motions import (
    CLEARLY,
    RANK_TOLERANCE,
    TAKES_PART,
    balancing_weights,
    fastest_sliding,
)
from graspless_pin.problem.checks import FloatArray

WIDEST = np.deg2rad(80.0)
"""Half the width of the widest sector: beyond a half-plane a sector is no convex cone."""
_LEAST_SECTOR_WIDTH = 1e-12
"""Narrower sectors are rounding, rad."""


class Sector(NamedTuple):
    """Directions at angles from middle - half to middle + half, from t1 towards t2, rad."""

    middle: float
    half: float

    @property
    def edges(self) -> FloatArray:
        """(2, 2) unit vectors along the first and the last direction, as columns."""
        first, last = self.middle - self.half, self.middle + self.half
        return np.array([[np.cos(first), np.cos(last)], [np.sin(first), np.sin(last)]])

    @property
    def halves(self) -> tuple[Sector, Sector]:
        """The two halves of the sector."""
        half = 0.5 * self.half
        return Sector(self.middle - half, half), Sector(self.middle + half, half)

    def clipped(self, angle: float, half: float) -> Self:
        """Return the intersection with the sector (angle, half); else the nearest direction."""
        offset = (angle - self.middle + np.pi) % (2.0 * np.pi) - np.pi
        low = min(max(offset - half, -self.half), self.half)
        high = max(min(offset + half, self.half), -self.half)
        return self._replace(middle=self.middle + 0.5 * (low + high), half=0.5 * (high - low))

    def remainders(self, part: Sector) -> list[Sector]:
        """Return the pieces of the sector on both sides of a part of it."""
        low, high = self.middle - self.half, self.middle + self.half
        ends = (low, part.middle - part.half), (part.middle + part.half, high)
        return [
            Sector(0.5 * (a + b), 0.5 * (b - a)) for a, b in ends if b - a > _LEAST_SECTOR_WIDTH
        ]


def other_directions(part: Sector) -> list[Sector]:
    """Return sectors of equal width that cover all directions outside one sector."""
    remaining = np.pi - part.half
    count = int(np.ceil(remaining / WIDEST))
    half = remaining / count
    first = part.middle + part.half
    return [Sector(first + (2 * index + 1) * half, half) for index in range(count)]


Sectors = Mapping[int, Sector | None]
"""Sector by selected contact; None: it may slide in any direction, or not at all."""


class Exclusion(NamedTuple):
    """A proof that no motion slides in all sectors: a combination of their rows vanishes.

    Attributes:
        directed: Contacts whose sectors have a weight in the combination.
        touching: Contacts that enter by being selected; includes those of `directed`.
    """

    directed: frozenset[int]
    touching: frozenset[int]


class SectorMotions:
    """Virtual motions of one problem that slide in sectors at the threshold or faster.

    Attributes:
        kinematics: The virtual motions.
        programs: Number of feasibility problems solved so far.
    """

    def __init__(self, kinematics: VirtualKinematics) -> None:
        """Store the virtual motions."""
        self.kinematics = kinematics
        self.programs = 0

    def find(self, sectors: Sectors) -> FloatArray | Exclusion:
        """Return a motion that slides in all sectors, or a proof that none does.

        For wide sectors the condition is weaker than the rule: the sliding along the middle,
        divided by the cosine of half the width, must reach the threshold. So an exclusion is a
        proof, while a motion has to be checked with `directions`.

        Args:
            sectors: Sectors of the selected contacts, which keep touching.

        Returns:
            (P + L,) the motion, scaled, zero without sectors; or an exclusion.

        Raises:
            UndecidedMotionError: If no solver decides.
        """
        kinematics, contacts = self.kinematics, tuple(sorted(sectors))
        touching = kinematics.touching(contacts)
        directed = [place for place, one in enumerate(contacts) if sectors[one] is not None]
        if not directed:
            return np.zeros(len(kinematics.scale))
        rows = np.array([_sector_rows(sectors[contacts[place]]) for place in directed])
        moving = (rows @ touching.tangential[directed]).reshape(3 * len(directed), -1)
        strict = np.tile([0.0, 0.0, 1.0], len(directed))
        self.programs += 1
        found = fastest_sliding(moving, strict, None, kinematics.threshold)
        if found.slowest >= kinematics.threshold:
            return kinematics.scaled_motion(touching.basis @ found.motion)
        if kinematics.threshold <= CLEARLY * np.linalg.norm(found.motion):
            kinematics.undecided_near = True
        weights = np.where(found.weights > TAKES_PART * found.weights.max(), found.weights, 0.0)
        weights = weights.reshape(len(directed), 3)
        whole = rows @ kinematics.velocity_map[[contacts[place] for place in directed], 1:]
        residual = -np.einsum("ki,kir->r", weights, whole)
        carry = np.abs(balancing_weights(touching.still, residual, kinematics.threshold))
        least = TAKES_PART * max(1.0, carry.max(initial=0.0))
        ruled = frozenset(
            contacts[place] for place, own in zip(directed, weights, strict=True) if own.any()
        )
        carrying = {one for one, size in zip(contacts, carry, strict=True) if size > least}
        return Exclusion(ruled, ruled | carrying)

    def directions(self, motion: FloatArray) -> dict[int, float]:
        """Return the angles of the sliding, rad, at contacts that touch and slide fast enough.

        Only at these contacts the motion can justify friction.

        Args:
            motion: (P + L,) scaled.
        """
        velocities = self.kinematics.rows @ motion
        size, speeds = np.linalg.norm(velocities), np.hypot(velocities[:, 1], velocities[:, 2])
        counts = np.abs(velocities[:, 0]) <= RANK_TOLERANCE * size
        counts &= (speeds > 0.0) & (speeds >= self.kinematics.threshold * size)
        angles = np.arctan2(velocities[:, 2], velocities[:, 1])
        return {one: float(angles[one]) for one in np.flatnonzero(counts).tolist()}

    def opposes(self, motion: FloatArray, angles: Mapping[int, float]) -> bool:
        """Return whether a motion slides at the given angles, at the threshold or faster.

        Args:
            motion: (P + L,) scaled.
            angles: Angles of the sliding by contact, rad.
        """
        velocities = self.kinematics.rows @ motion
        size, here = float(np.linalg.norm(velocities)), velocities[list(angles)]
        turn = np.array(list(angles.values()))
        along = here[:, 1] * np.cos(turn) + here[:, 2] * np.sin(turn)
        across = here[:, 2] * np.cos(turn) - here[:, 1] * np.sin(turn)
        is_zero = np.abs([here[:, 0], across]) <= RANK_TOLERANCE * size
        return bool(is_zero.all() and (along >= self.kinematics.threshold * size).all())


def _sector_rows(sector: Sector | None) -> FloatArray:
    """(3, 2) inward normals of both sides, and the middle over the cosine of half the width."""
    middle, half = sector if sector is not None else (0.0, 0.0)
    angles = np.array([middle - half + 0.5 * np.pi, middle + half - 0.5 * np.pi, middle])
    rows = np.column_stack([np.cos(angles), np.sin(angles)])
    rows[2] /= np.cos(half)
    return rows
