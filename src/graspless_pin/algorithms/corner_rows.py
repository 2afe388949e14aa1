"""Rows of a set's corners in scaled force coordinates, for forces affine in what is unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.force_policy import Unknowns
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member, shared_commands
from graspless_pin.programs.forces import ForceCoordinates, force_coordinates, force_rows

CANCELS = 1e-9
"""Scaled: what balance may leave of a unit of what is unknown."""


class CornerRows(NamedTuple):
    """Rows of a corner in its force coordinates, without those that its mode forbids.

    Attributes:
        coordinates: Of all forces.
        kept: (n,) columns that are there.
        rows: (R, n) that stay below their sides.
        level: (R,) what the margin counts in each.
        sides: (R,).
        balance: (P, n).
        wrench: (P,) its sides.
        weight: (P,) what a load over the load counts there.
        torque: (L, n) commands, over the joint scale.
        carried: (L,) those without forces.
    """

    coordinates: ForceCoordinates
    kept: NDArray[np.int_]
    rows: FloatArray
    level: FloatArray
    sides: FloatArray
    balance: FloatArray
    wrench: FloatArray
    weight: FloatArray
    torque: FloatArray
    carried: FloatArray

    def forces(self, x: FloatArray) -> FloatArray:
        """Return the (M, 3) contact forces of n columns, N."""
        whole = np.zeros(self.coordinates.layout.size)
        whole[self.kept] = x
        return self.coordinates.forces(whole)


class Group(NamedTuple):
    """Corners of the same contacts, and the same loads of what is unknown.

    Attributes:
        corners: Their numbers.
        rows: Of the first; wrench and what is carried are its own.
        effects: (P + s, n) balance, then shared commands.
        inverse: (n, P + s) pseudo-inverse.
        loads: (P, D) sides of the balance of each unknown.
    """

    corners: list[int]
    rows: CornerRows
    effects: FloatArray
    inverse: FloatArray
    loads: FloatArray


def corner_rows(
    corners: Sequence[Member], scale: ForceCoordinates, mode: SlidingMode | None
) -> list[CornerRows]:
    """Return the rows of each corner.

    Args:
        corners: K members.
        scale: The scales of all.
        mode: The one mode of all forces; None: plain Coulomb friction.
    """
    found: list[CornerRows] = []
    known: dict[bytes, CornerRows] = {}
    for member in corners:
        key = member.problem.friction.tobytes() + member.factors.tobytes()
        if key not in known:
            known[key] = _rows_of(member, scale, mode)
        rows = known[key]
        carried = member.commanded(np.zeros(member.problem.joint_count)) / scale.joint_scale
        wrench = -rows.weight * member.problem.external_wrench / scale.force_scale
        found.append(rows._replace(wrench=wrench, carried=carried))
    return found


def _rows_of(member: Member, scale: ForceCoordinates, mode: SlidingMode | None) -> CornerRows:
    problem = member.problem
    if problem.cone_model.second_order:
        problem = problem.with_changes(cone="edges")  # inside the round cones
    coordinates = replace(scale, directions=force_coordinates(problem).directions)
    forces = force_rows(problem, coordinates)
    cones, bare = forces.cones, np.flatnonzero(forces.without_cone)
    rows = [cones.rows, forces.normal, -forces.normal[bare]]
    level = [cones.margin, np.ones(len(forces.normal) + len(bare))]
    sides = [np.zeros(len(cones.rows)), forces.limit, np.zeros(len(bare))]
    kept = np.arange(forces.size)
    if mode is not None:
        columns, signs = coordinates.layout.friction, mode.signs[coordinates.layout.cones]
        opposed = columns[signs != 0]
        rows.append(signs[signs != 0][:, None] * np.eye(forces.size)[opposed])
        level.append(np.zeros(len(opposed)))
        sides.append(np.zeros(len(opposed)))
        kept = np.setdiff1d(kept, columns[signs == 0])
    torque = forces.torque / member.factors[:, None]
    return CornerRows(
        coordinates, kept, np.vstack(rows)[:, kept], np.concatenate(level), np.concatenate(sides),
        forces.balance[:, kept], forces.wrench, forces.weight, torque[:, kept], forces.gravity,
    )  # fmt: skip


def grouped(
    corners: Sequence[Member],
    rows: Sequence[CornerRows],
    unknowns: Unknowns,
    shared: FloatArray,
) -> list[Group]:
    """Return the corners that may share what their forces add for each unknown.

    Args:
        corners: K members.
        rows: K of them.
        unknowns: What is unknown.
        shared: (s, L) see `scaled_shared`.
    """
    groups: dict[bytes, Group] = {}
    for number, (member, own) in enumerate(zip(corners, rows, strict=True)):
        loads = -own.weight[:, None] * unknowns.loads[number] / own.coordinates.force_scale
        parts = loads.round(12) + 0.0, member.problem.friction, member.factors
        key = b"".join(one.tobytes() for one in parts)
        if key not in groups:
            effects = np.vstack([own.balance, shared @ own.torque])
            inverse: FloatArray = np.asarray(np.linalg.pinv(effects, rcond=CANCELS), dtype=float)
            groups[key] = Group([], own, effects, inverse, loads)
        groups[key].corners.append(number)
    return list(groups.values())


def scaled_shared(
    corners: Sequence[Member], scale: ForceCoordinates, directions: FloatArray | None
) -> FloatArray:
    """Return (s, L) sums of scaled commands that are the same for all members.

    Args:
        corners: K members.
        scale: The scales of all.
        directions: (L, d) what feedback may add to commands, see `feedback_torques`.
    """
    shared = shared_commands(corners, directions)[0] * scale.joint_scale
    sizes = np.abs(shared).max(axis=1, initial=0.0)
    return shared / np.where(sizes > 0.0, sizes, 1.0)[:, None]
