"""Multipliers of the scaled programs in the units of the problem, constraint by constraint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.force_programs import force_coordinates, share_rows, torque_unit


@dataclass(frozen=True, eq=False)
class ConstraintMultipliers:
    """Multipliers of the constraints of (44) or (45); all but the balance's are >= 0.

    Attributes:
        balance: (6,) of W f + w_ext = 0.
        faces: (cones, r) of h^T f + e <= 0, for the contacts with a cone in their order.
        normal_upper: (M,) of n^T f + e <= f_n,max; zero in Algorithm 2 (there a bound).
        normal_lower: (M,) of e <= n^T f where there is no cone; zero elsewhere.
        torque_upper: (L,) of J^T f + g <= upper.
        torque_lower: (L,) of lower <= J^T f + g.
        share_upper: (L,) of J^T f + g <= t (or t times the upper limit); zero in Algorithm 1.
        share_lower: (L,) of -(J^T f + g) <= t (or t times minus the lower limit).
    """

    balance: FloatArray
    faces: FloatArray
    normal_upper: FloatArray
    normal_lower: FloatArray
    torque_upper: FloatArray
    torque_lower: FloatArray
    share_upper: FloatArray
    share_lower: FloatArray


def constraint_multipliers(
    problem: QuasistaticProblem,
    y: FloatArray,
    z: FloatArray,
    *,
    algorithm: str,
    by_limits: bool,
    margin: float = 0.0,
) -> ConstraintMultipliers:
    """Return the multipliers of a program of `force_programs` for an objective in N or N m.

    Args:
        problem: The problem.
        y: (6,) multipliers of the scaled balance.
        z: Multipliers of the scaled rows, positive on the upper side.
        algorithm: ``margin`` or ``torque``.
        by_limits: Whether Algorithm 2 counted shares of the limits.
        margin: Required margin of Algorithm 2, N.
    """
    coordinates = force_coordinates(problem, margin)
    force = coordinates.force_scale
    weight = np.repeat([1.0, 1.0 / coordinates.length_scale], 3)
    count, joints = problem.contact_count, problem.joint_count
    cones = int(problem.has_cone.sum())
    faces, rest = np.split(np.maximum(z, 0.0), [cones * problem.cone_edges])
    hard = z[len(z) - joints :] if joints else np.zeros(0)
    upper, lower = np.maximum(hard, 0.0), np.maximum(-hard, 0.0)
    normal_upper, normal_lower = np.zeros(count), np.zeros(count)
    share_upper, share_lower = np.zeros(joints), np.zeros(joints)
    # The objective's own unit: F for the margin.
    if algorithm == "margin":
        unit = force
        normal_upper = rest[:count]
        normal_lower[~problem.has_cone] = rest[count : count + int((~problem.has_cone).sum())]
    else:
        unit = torque_unit(problem, coordinates, by_limits=by_limits)
        up, down = share_rows(problem, coordinates, by_limits=by_limits)
        first, second = int(up.counts.sum()), int(down.counts.sum())
        share_upper[up.counts] = up.weight * rest[:first]
        share_lower[down.counts] = down.weight * rest[first : first + second]
    per_force = unit / force
    return ConstraintMultipliers(
        balance=weight * y * per_force,
        faces=faces.reshape(cones, problem.cone_edges) * per_force,
        normal_upper=normal_upper * per_force,
        normal_lower=normal_lower * per_force,
        torque_upper=upper * (unit / coordinates.joint_scale),
        torque_lower=lower * (unit / coordinates.joint_scale),
        share_upper=share_upper,
        share_lower=share_lower,
    )


def scaled_multipliers(
    problem: QuasistaticProblem,
    multipliers: ConstraintMultipliers,
    *,
    algorithm: str,
    by_limits: bool,
    margin: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the multipliers (y, z) of the scaled program: what `constraint_multipliers` takes.

    Args:
        problem: The problem.
        multipliers: In the units of the problem.
        algorithm: ``margin`` or ``torque``.
        by_limits: Whether Algorithm 2 counted shares of the limits.
        margin: Required margin of Algorithm 2, N.
    """
    coordinates = force_coordinates(problem, margin)
    weight = np.repeat([1.0, 1.0 / coordinates.length_scale], 3)
    if algorithm == "margin":
        unit = coordinates.force_scale
        middle = [multipliers.normal_upper, multipliers.normal_lower[~problem.has_cone]]
    else:
        unit = torque_unit(problem, coordinates, by_limits=by_limits)
        up, down = share_rows(problem, coordinates, by_limits=by_limits)
        middle = [
            multipliers.share_upper[up.counts] / up.weight,
            multipliers.share_lower[down.counts] / down.weight,
        ]
    per_force = unit / coordinates.force_scale
    if algorithm == "margin":
        middle = [part / per_force for part in middle]
    hard = (multipliers.torque_upper - multipliers.torque_lower) * coordinates.joint_scale / unit
    return (
        multipliers.balance / (weight * per_force),
        np.concatenate([multipliers.faces.ravel() / per_force, *middle, hard]),
    )
