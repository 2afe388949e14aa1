"""Patches: contacts whose slips u_t = T x follow from one planar motion x (3,).

A set of outcomes is split at a patch into the one in which none of its contacts slips, and into
cones of motions. The motions of a cone are the nonnegative combinations of the rays at its corners.
So where T takes all rays into an arc of less than pi, the contact slips in that arc.

The rest of the slips, r |y|, turns them by little, since some contact slips by more than the
tolerance e in such a set: then |x| >= (e - r) / |T|, and a contact with d.T x >= m |x| for the
arc's middle d turns by at most arcsin(r |T| / (m (e - r))).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part

_LONGEST = 2.0
"""Largest length of y, with the free motion of joints."""


@dataclass(frozen=True, eq=False)
class MotionCone:
    """Motions sum c_k axes[k] with c at ``axis`` of a sign, and the others' ratios to its size.

    Attributes:
        axes: (3, 3).
        axis: 0 to 2.
        sign: 1 or -1.
        low: (2,) least ratios.
        high: (2,) largest ones.
    """

    axes: np.ndarray
    axis: int
    sign: int
    low: np.ndarray
    high: np.ndarray

    def rays(self) -> np.ndarray:
        """Return the motions at the corners, unit vectors (4, 3)."""
        others = [k for k in range(3) if k != self.axis]
        corners = np.zeros((4, 3))
        corners[:, self.axis] = self.sign
        corners[:, others] = [(a, b) for a in (self.low[0], self.high[0])
                              for b in (self.low[1], self.high[1])]  # fmt: skip
        rays = corners @ self.axes
        return rays / np.linalg.norm(rays, axis=1)[:, None]


@dataclass(frozen=True, eq=False)
class PatchSlip:
    """The slip of the k contacts of a patch.

    Attributes:
        contacts: Their indices.
        images: (k, 2, 3) T.
        arcs: (k, 2) middle and half width of each contact's slip, rad.
        cone: The motions; None: no contact slips.
    """

    contacts: tuple[int, ...]
    images: np.ndarray
    arcs: np.ndarray
    cone: MotionCone | None


def read_patch(stated: Part) -> PatchSlip:
    """Return the patch that a node states.

    Raises:
        ValueError: If it is invalid.
    """
    contacts = tuple(stated["contacts"])
    if len(set(contacts)) < len(contacts):
        raise ValueError(f"{stated.where} names a contact twice")
    stated = stated.with_sizes(k=len(contacts))
    cone, own = None, stated.maybe("cone")
    if own is not None:
        cone = MotionCone(own["axes"], own["axis"], own["sign"], own["low"], own["high"])
    return PatchSlip(contacts, stated["images"], stated["arcs"], cone)


def slip_tolerance(still: float) -> float:
    """Return the scaled slip that counts as none, by the power up to which nothing moves."""
    return min(tolerances.NO_SLIP_SHARE * still, tolerances.NO_SLIP)


def uncovered_motions(children: list[PatchSlip], known: PatchSlip | None) -> str:
    """Return in words which motions of a patch the children of a node leave out; empty: none.

    Args:
        children: The patch of each child.
        known: The patch as it is known at the node; None: nothing is known.
    """
    cones = [one.cone for one in children if one.cone is not None]
    first = children[0] if known is None else known
    if any(one.contacts != first.contacts or not np.array_equal(one.images, first.images)
           for one in children):  # fmt: skip
        return "its children have other contacts or images"
    if known is not None:
        return _uncovered_half(cones, known.cone, len(children))
    if len(cones) != len(children) - 1:
        return "exactly one child must be the case in which none of its contacts slips"
    if any(not np.array_equal(one.axes, cones[0].axes) for one in cones):
        return "its cones must have the same axes"
    whole = {
        (one.axis, one.sign) for one in cones if (one.low <= -1.0).all() and (one.high >= 1.0).all()
    }
    if whole != {(axis, sign) for axis in range(3) for sign in (-1, 1)}:
        return "its cones do not cover all motions"
    return "" if np.linalg.matrix_rank(cones[0].axes) == 3 else "its axes must not lie in one plane"


def _uncovered_half(cones: list[MotionCone], outer: MotionCone | None, count: int) -> str:
    """Return in words which motions of a cone two parts of it leave out; empty: none."""
    if outer is None:
        return "it does not slip, so it cannot be split further"
    same = [np.array_equal(one.axes, outer.axes) for one in cones]
    faces = {(one.axis, one.sign) for one in cones}
    if len(cones) != 2 or count != 2 or not all(same) or faces != {(outer.axis, outer.sign)}:
        return "its cone must be split into two parts with the same axes, axis and sign"
    low, high = (np.array([getattr(one, end) for one in cones]) for end in ("low", "high"))
    covers = (low <= outer.low) & (high >= outer.high)
    for side in (0, 1):
        lower, upper = np.argsort(low[:, side], kind="stable")
        meets = low[lower, side] <= outer.low[side] and high[upper, side] >= outer.high[side]
        if covers[:, 1 - side].all() and meets and low[upper, side] <= high[lower, side]:
            return ""
    return "the two parts do not cover its cone"


def unproven_arcs(patch: PatchSlip, rows: np.ndarray, tolerance: float) -> str:
    """Return the contacts of a patch whose stated arcs do not follow, listed; empty: none.

    Args:
        patch: The stated patch.
        rows: (M, 3, n) from y to accelerations along n, t1, t2, scaled.
        tolerance: Scaled slip that counts as none.
    """
    if patch.cone is None:
        return ""
    slips = rows[list(patch.contacts), 1:].reshape(2 * len(patch.contacts), -1)
    images = patch.images.reshape(-1, 3)
    motion = np.linalg.lstsq(images, slips, rcond=None)[0]
    residual = (slips - images @ motion).reshape(len(patch.contacts), 2, -1)
    error = _LONGEST * float(np.linalg.norm(residual, ord=2, axis=(1, 2)).max())
    longest = float(np.linalg.norm(patch.images, ord=2, axis=(1, 2)).max())
    rays, wrong = patch.cone.rays(), list[str]()
    for contact, image, (middle, half_width) in zip(
        patch.contacts, patch.images, patch.arcs, strict=True
    ):
        if half_width >= np.pi:
            continue
        ahead = rays @ image.T @ [np.cos(middle), np.sin(middle)]
        aside = rays @ image.T @ [-np.sin(middle), np.cos(middle)]
        least, widest = float(ahead.min()), float(np.abs(np.arctan2(aside, ahead)).max())
        if error >= tolerance or least <= 0.0:
            wrong.append(str(contact))
            continue
        turns = np.arcsin(min(error * longest / least / (tolerance - error), 1.0))
        if not (half_width < 0.5 * np.pi and widest + turns <= half_width + tolerances.ANGLE):
            wrong.append(str(contact))
    return ", ".join(wrong)
