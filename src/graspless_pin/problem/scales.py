"""The scales of a problem: reference values of its forces, lengths and torques."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import (
    FloatArray,
    JointUnit,
    read_only,
    squared_lengths,
    torque_mask,
)

LEAST_LEVER = 1e-12
"""Joint scales use at least this share of the longest lever, so that none is zero."""
LEAST_DIFFERENCE = 1e-12
"""Relative to the figures subtracted: smaller distances and moments are rounding."""
LEAST_MARGIN = 1e-20
"""Relative to the smallest normal-force limit: a smaller margin counts as zero, and is no scale.

Placeholder limits may well be 1e14 times a margin.
"""
LIMIT_TOLERANCE = 1e-6
"""Tolerance of a limit, relative to the limit, or to the load if that is smaller."""
LEAST_LIMIT = 1e-3
"""For tolerances, a limit counts as at least this share of the largest one."""
MOST_STRICT = 1e6
"""Largest ratio of load to limit that is solved: above it the tolerance of the balance exceeds the
limit."""


class Scales(NamedTuple):
    """Reference values of a problem, to which tolerances, programs and proofs are relative.

    Attributes:
        force: F, the load, N: the larger of the external force and of the external moment about the
            contacts' centre over the length. If the wrench is zero, it is the smallest normal-force
            limit (Algorithm 2: the required margin, if at least 1e-20 of that). With a given wrench
            matrix, force and moment are the norms of all external generalised forces in N, and of
            all in N m.
        length: The distance of the farthest contact from the contacts' centre, m; if all are there,
            up to rounding, that moment over the external force, or 1 m. With a given wrench matrix
            it is the longest lever, that is the largest norm of the three entries of one contact in
            a row in N m; if there is none, that moment over the force, or 1 m.
        joints: (L,) torques of the load on each joint's longest lever, N m (N).
    """

    force: float
    length: float
    joints: FloatArray

    def without_load(self, margin: float) -> Scales:
        """Return the scales of a problem without a load at a required margin, N.

        The margin replaces the load, unless it is below 1e-20 of the smallest normal-force limit:
        gravity torques divided by it would exceed every number that a program may hold.
        """
        if margin < LEAST_MARGIN * self.force:
            return self
        return Scales(margin, self.length, read_only(margin / self.force * self.joints))


class Strictness(NamedTuple):
    """Factors, at least 1, by which tolerances of limits are smaller than the load's.

    Attributes:
        torque: (L,) for torque limits.
        normal: (M,) for normal-force limits.
    """

    torque: FloatArray
    normal: FloatArray

    @property
    def can_be_kept(self) -> bool:
        """Whether every limit exceeds the tolerance of the balance."""
        return bool(max(self.torque.max(initial=1.0), self.normal.max(initial=1.0)) <= MOST_STRICT)


def strictness_of(
    scales: Scales,
    lower: FloatArray,
    upper: FloatArray,
    units: tuple[JointUnit, ...],
    normal_limits: FloatArray,
) -> Strictness | None:
    """Return the factors by which tolerances of limits are smaller; None: none is.

    Args:
        scales: Scales of the problem.
        lower: (L,) smallest torques.
        upper: (L,) largest torques.
        units: (L,) units of the torques.
        normal_limits: (M,) largest normal forces, N.
    """
    force, _, load = scales
    smaller = np.minimum(np.abs(lower), np.abs(upper))
    if (smaller >= load).all() and (normal_limits >= force).all():
        return None
    limit_sizes = np.abs(np.array((lower, upper)))
    limit_sizes[np.isinf(limit_sizes)] = 0.0
    largest = np.full(len(load), limit_sizes.max(initial=0.0))
    if len(kinds := set(units)) > 1:
        for unit in kinds:
            has_unit = np.array([joint_unit is unit for joint_unit in units])
            largest[has_unit] = limit_sizes[:, has_unit].max()
    least = LEAST_LIMIT * np.where(largest > 0.0, largest, load)
    torque = load / np.maximum(smaller, least)
    normal = force / np.maximum(normal_limits, LEAST_LIMIT * normal_limits.max())
    if max(torque.max(initial=1.0), normal.max()) <= 1.0:
        return None
    return Strictness(np.maximum(torque, 1.0), np.maximum(normal, 1.0))


def scales_of(
    positions: FloatArray, wrench: FloatArray, jacobian: FloatArray, limits: FloatArray
) -> Scales:
    """Return the scales of a problem of one free object.

    Args:
        positions: (M, 3) m.
        wrench: (6,) external wrench, N and N m.
        jacobian: (3M, L).
        limits: (M,) largest normal forces, N.
    """
    center = positions.mean(axis=0)
    (x, y, z), (u, v, w) = center.tolist(), wrench[:3].tolist()
    moment = wrench[3:] - (y * w - z * v, z * u - x * w, x * v - y * u)
    pull, turn = (math.sqrt(float(part @ part)) for part in (wrench[:3], moment))
    length = math.sqrt(float(squared_lengths(positions - center).max()))
    reach = math.sqrt(float(squared_lengths(positions).max()))
    if length <= LEAST_DIFFERENCE * reach:
        least = LEAST_DIFFERENCE * (math.sqrt(float(wrench[3:] @ wrench[3:])) + reach * pull)
        length = turn / pull if pull > 0.0 and turn > least else 1.0
    return _scales_of_load(pull, turn, length, jacobian, limits)


def scales_of_matrix(
    matrix: FloatArray,
    units: tuple[JointUnit, ...],
    load: FloatArray,
    jacobian: FloatArray,
    limits: FloatArray,
) -> Scales:
    """Return the scales of a problem with a given wrench matrix.

    Args:
        matrix: (P, 3M).
        units: (P,) units of its rows.
        load: (P,) external generalised forces, N and N m.
        jacobian: (3M, L).
        limits: (M,) largest normal forces, N.
    """
    turns = torque_mask(units)
    pull, turn = (math.sqrt(float(part @ part)) for part in (load[~turns], load[turns]))
    levers = np.linalg.norm(matrix[turns].reshape(-1, len(limits), 3), axis=2)
    length = float(levers.max(initial=0.0))
    if length == 0.0:
        length = turn / pull if pull > 0.0 and turn > 0.0 else 1.0
    return _scales_of_load(pull, turn, length, jacobian, limits)


def bears_contacts(jacobian: FloatArray) -> NDArray[np.bool_]:
    """Return the (L,) mask of joints that bear contact forces: with levers above rounding.

    Args:
        jacobian: (n, L) contact Jacobian.
    """
    levers = np.abs(jacobian).max(axis=0, initial=0.0)
    return levers > LEAST_LEVER * levers.max(initial=0.0)


def passive_levers(units: tuple[JointUnit, ...], length: float) -> FloatArray:
    """Return the (P,) load of one newton in each passive coordinate: 1, or the length, m.

    Args:
        units: (P,) units of the coordinates.
        length: See `Scales`, m.
    """
    return np.where(torque_mask(units), length, 1.0)


def coordinate_units(scales: Scales, units: tuple[JointUnit, ...]) -> FloatArray:
    """Return the (P + L,) effects of the load in each row of the balance and at each joint.

    Args:
        scales: Scales of the problem.
        units: (P,) units of the passive coordinates.
    """
    force, length, joints = scales
    return np.concatenate([force * passive_levers(units, length), joints])


def _scales_of_load(
    pull: float, turn: float, length: float, jacobian: FloatArray, limits: FloatArray
) -> Scales:
    """Return the scales from the sizes of external force, N, and moment, N m, and the length, m."""
    force = max(pull, turn / length) or float(limits.min())
    blocks = jacobian.reshape(len(limits), 3, -1)
    levers = np.sqrt(np.einsum("lij,lij->lj", blocks, blocks).max(axis=0))
    longest = float(levers.max(initial=0.0))
    levers = np.maximum(levers, LEAST_LEVER * longest) if longest > 0.0 else levers + length
    return Scales(force, length, read_only(force * levers))
