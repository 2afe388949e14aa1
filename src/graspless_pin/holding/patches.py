"""Patches: contacts in one plane between two bodies, whose slips one planar motion determines.

The slips of the k contacts of a patch are u_t = T x with three numbers x: two of translation and
one of rotation. So a patch is branched on as a whole: none of its contacts slips, or x lies in one
of six cones over the faces of a cube, each of which may be halved. In a cone the slip of a contact
lies in an arc and its friction in the opposite one, whether the contact is closed or open. Contacts
near a centre of rotation are an exception: the cone does not determine their slip direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Record

_FEWEST_CONTACTS = 3
"""Contacts of a patch: fewer are split one by one."""
_FEWEST_OF_SEVERAL = 5
"""Contacts of each of several patches: states of four corners in one plane decide other planes."""
_DEPENDENT = 1e-12
"""Relative to the largest singular value: a smaller fourth one is rounding."""
_THIN = 1e-6
"""Relative to the largest singular value: least third one, to exclude contacts in one place."""
_UNTOLD = 1e-3
"""Smallest singular value with which the first contacts' rows T determine a planar motion."""
_ROUNDING = 2e-15
"""Scaled acceleration: rounding error of slips as T x, if rows are computed in another order."""
_SAFETY = 4.0
"""Safety factor on the residual of slips as T x: checkers round differently."""
_MOST_TURN = 0.1
"""Largest error of a slip's direction due to that residual, rad."""
_MOST_UNTOLD = 5e-3
"""Largest `Patch.turning`: with more, too few slip directions are determined."""
_WIDEST = 0.5 * np.pi - 1e-3
"""Half the width of the widest arc that is used, rad."""


@dataclass(frozen=True, eq=False)
class MotionCone(Record):
    """Planar motions x = sum c_k axes[k], with the largest coefficient at one axis.

    Attributes:
        axes: (3, 3) rows.
        axis: The one with the largest coefficient.
        sign: 1 or -1, its sign.
        low: (2,) smallest ratios of the other coefficients, in their order, to its absolute value.
        high: (2,) largest ratios.
    """

    axes: FloatArray
    axis: int
    sign: int
    low: FloatArray
    high: FloatArray

    @property
    def rays(self) -> FloatArray:
        """(4, 3) motions at the corners: all others are nonnegative sums of these."""
        first, second = (axis for axis in range(3) if axis != self.axis)
        rays = np.zeros((4, 3))
        rays[:, self.axis] = self.sign
        rays[:, first] = np.repeat([self.low[0], self.high[0]], 2)
        rays[:, second] = np.tile([self.low[1], self.high[1]], 2)
        return rays @ self.axes

    @property
    def width(self) -> float:
        """The larger of the two angles that it spans, rad."""
        return float((np.arctan(self.high) - np.arctan(self.low)).max())

    def halves(self) -> list[MotionCone]:
        """Return the two halves, split across the larger angle."""
        low, high = np.arctan(self.low), np.arctan(self.high)
        side = int(np.argmax(high - low))
        lower, upper = self.high.copy(), self.low.copy()
        lower[side] = upper[side] = np.tan(0.5 * (low[side] + high[side]))
        return [replace(self, high=lower), replace(self, low=upper)]


@dataclass(frozen=True, eq=False)
class PatchSlip(Record):
    """The known slip of a patch: a cone of planar motions, or none.

    Attributes:
        contacts: The k contacts.
        images: (k, 2, 3) T, from planar motions to slips along t1 and t2.
        cone: The planar motions; None: no contact slips.
        arcs: (k, 2) middle and half width of the arc of slip directions of each contact, rad; pi:
            any; -1: it does not slip.
    """

    contacts: tuple[int, ...]
    images: FloatArray
    cone: MotionCone | None
    arcs: FloatArray

    @cached_property
    def determining_count(self) -> int:
        """How many of the first contacts determine the motion: two, if in two places."""
        count = 2
        while np.linalg.matrix_rank(self.images[:count].reshape(-1, 3), tol=_UNTOLD) < 3:
            count += 1
        return count

    @property
    def width(self) -> float:
        """The larger of the two angles that its motions span, rad; 0: none."""
        return 0.0 if self.cone is None else self.cone.width


@dataclass(frozen=True, eq=False)
class Patch(Record):
    """Contacts whose slips one planar motion determines.

    Attributes:
        contacts: The k contacts.
        images: (k, 2, 3) T, from planar motions to slips along t1 and t2.
        motion: (3, n) from y to the planar motion.
        turning: Error of the directions of slips above the tolerance: its sine is this over the
            contact's slip in a planar motion of norm one.
    """

    contacts: tuple[int, ...]
    images: FloatArray
    motion: FloatArray
    turning: float

    def split(self, known: PatchSlip | None, y: FloatArray) -> list[PatchSlip]:
        """Return slips that together cover all slips of the patch.

        Args:
            known: Its known slip; None: nothing is known of it.
            y: (n,) the motion of a point, around which the first cones lie.
        """
        if known is not None:
            cones = [] if known.cone is None else known.cone.halves()
            return [self._slip_in_cone(cone) for cone in cones]
        axes, _ = np.linalg.qr(np.column_stack([self.motion @ y, np.eye(3)]))
        ones, no_slip = np.ones(2), np.tile([0.0, -1.0], (len(self.contacts), 1))
        cones = [MotionCone(axes.T, k, sign, -ones, ones) for k in range(3) for sign in (1, -1)]
        return [
            PatchSlip(self.contacts, self.images, None, no_slip),
            *map(self._slip_in_cone, cones),
        ]

    def _slip_in_cone(self, cone: MotionCone) -> PatchSlip:
        """Return the slip of motions in a cone, with the arc of each contact."""
        rays = cone.rays / np.linalg.norm(cone.rays, axis=1)[:, None]
        arcs = np.tile([0.0, np.pi], (len(self.contacts), 1))
        for arc, image in zip(arcs, self.images, strict=True):
            slips = rays @ image.T
            angles = np.sort(np.arctan2(slips[:, 1], slips[:, 0]))
            gaps = np.append(angles[1:], angles[0] + 2.0 * np.pi) - angles
            widest = int(np.argmax(gaps))
            half_width = np.pi - 0.5 * gaps[widest]
            middle = angles[(widest + 1) % len(angles)] + half_width
            least = float((slips @ [np.cos(middle), np.sin(middle)]).min())
            if least * np.sin(_MOST_TURN) > self.turning:
                half_width += np.arcsin(self.turning / least)
                if half_width < _WIDEST:
                    arc[:] = middle, half_width
        return PatchSlip(self.contacts, self.images, cone, arcs)


def find_patches(rows: FloatArray, friction: FloatArray, tolerance: float) -> list[Patch]:
    """Return the patches: a single one has three contacts or more, several have five or more each.

    Args:
        rows: (M, 3, n) from y to accelerations along n, t1, t2, scaled.
        friction: (M,) coefficients.
        tolerance: Scaled accelerations up to which a contact counts as sticking.
    """
    patches, remaining = list[Patch](), np.flatnonzero(friction > 0.0).tolist()
    while remaining:
        members = remaining[:1]
        for contact in remaining[1:]:
            sizes = np.linalg.svd(_slip_rows(rows, [*members, contact]), compute_uv=False)
            if len(sizes) > 3 and sizes[3] < _DEPENDENT * sizes[0]:
                members.append(contact)
        remaining = [contact for contact in remaining if contact not in members]
        if len(members) < _FEWEST_CONTACTS:
            continue
        slips = _slip_rows(rows, members)
        images, sizes, turns = np.linalg.svd(slips, full_matrices=False)
        images, motion = images[:, :3], sizes[:3, None] * turns[:3]
        # The error of slips as T x, for y up to |y| = 2, the longest there is.
        residual = (slips - images @ motion).reshape(len(members), 2, -1)
        error = _ROUNDING + _SAFETY * float(np.linalg.norm(residual, ord=2, axis=(1, 2)).max())
        if sizes[2] > _THIN * sizes[0] and error < 0.5 * tolerance:
            images = images.reshape(len(members), 2, 3)
            longest = float(np.linalg.norm(images, ord=2, axis=(1, 2)).max())
            turning = error * longest / (tolerance - error)
            if turning < _MOST_UNTOLD:
                patches.append(Patch(tuple(members), images, motion, turning))
    fewest = _FEWEST_CONTACTS if len(patches) == 1 else _FEWEST_OF_SEVERAL
    return [patch for patch in patches if len(patch.contacts) >= fewest]


def _slip_rows(rows: FloatArray, contacts: list[int]) -> FloatArray:
    return rows[contacts, 1:].reshape(2 * len(contacts), -1)
