"""A problem from arrays that the caller owns, without copies and with few checks."""

from __future__ import annotations

import numpy as np

from graspless_pin.bounds import (
    LARGEST,
    LARGEST_FRICTION,
    LARGEST_LOAD_OVER_LIMIT,
    MOST_CONE_EDGES,
    SMALLEST,
)
from graspless_pin.problem.arguments import is_too_small
from graspless_pin.problem.checks import (
    FREE_BODY,
    FloatArray,
    JointUnit,
    all_true,
    all_within,
    read_only,
)
from graspless_pin.problem.cones import checked_cone
from graspless_pin.problem.quasistatic import QuasistaticProblem
from graspless_pin.records import unchecked


def problem_of_own_arrays(
    positions: FloatArray,
    normals: FloatArray,
    external_wrench: FloatArray,
    jacobian: FloatArray,
    *,
    friction: FloatArray,
    tangents: FloatArray,
    sliding: FloatArray,
    torque_limits: tuple[FloatArray, FloatArray],
    max_normal_force: float,
    cone_edges: int,
    cone: str = "edges",
    joint_names: tuple[str, ...],
    joint_units: tuple[JointUnit, ...],
    gravity_torques: FloatArray,
) -> QuasistaticProblem:
    """Return the problem of one free object from the caller's arrays, six times as fast as usual.

    The arrays become read-only and are not copied. The ranges of the numbers are checked; shapes,
    orthonormal frames, tangential sliding and distinct names are not: the caller ensures them.

    Args:
        positions: (M, 3) m.
        normals: (M, 3) unit.
        external_wrench: (6,) N and N m.
        jacobian: (3M, L).
        friction: (M,).
        tangents: (M, 3, 2).
        sliding: (M, 3) m/s.
        torque_limits: (lower, upper), each (L,).
        max_normal_force: The limit of all contacts, N.
        cone_edges: See `QuasistaticProblem`.
        cone: See `QuasistaticProblem`.
        joint_names: L distinct names.
        joint_units: L units.
        gravity_torques: (L,).

    Raises:
        ArgumentError: See `QuasistaticProblem`.
    """
    lower, upper = torque_limits
    if not (
        len(positions) > 0
        and SMALLEST <= max_normal_force <= LARGEST
        and isinstance(cone_edges, int)
        and 3 <= cone_edges <= MOST_CONE_EDGES
        and not is_too_small(external_wrench)
        # No entry is NaN, coefficients are not negative, and limits are in order.
        and all_within((positions, external_wrench, jacobian, friction, sliding, gravity_torques))
        and all_within((external_wrench[:3],), LARGEST_LOAD_OVER_LIMIT * max_normal_force)
        and all_true((friction >= 0.0) & (friction <= LARGEST_FRICTION))
        and all_true((lower <= upper) & (lower <= LARGEST) & (upper >= -LARGEST))
        and all_true((lower >= -LARGEST) | np.isinf(lower))
        and all_true((upper <= LARGEST) | np.isinf(upper))
    ):  # fmt: skip
        # The constructor raises the error that names the wrong argument.
        return QuasistaticProblem(positions, normals, external_wrench, jacobian, friction=friction,
                   tangents=tangents, sliding=sliding, torque_limits=torque_limits,
                   max_normal_force=max_normal_force, cone_edges=cone_edges, cone=cone,
                   joint_names=joint_names, joint_units=joint_units,
                   gravity_torques=gravity_torques)  # fmt: skip
    for array in (
        positions, normals, external_wrench, jacobian, friction, tangents, sliding, lower,
        upper, gravity_torques,
    ):  # fmt: skip
        array.setflags(write=False)
    return unchecked(
        QuasistaticProblem,
        positions=positions,
        normals=normals,
        external_wrench=external_wrench,
        jacobian=jacobian,
        friction=friction,
        tangents=tangents,
        sliding=sliding,
        lower_torque=lower,
        upper_torque=upper,
        max_normal_force=read_only(np.full(len(positions), max_normal_force)),
        cone_edges=cone_edges,
        cone=checked_cone(cone),
        joint_names=joint_names,
        joint_units=joint_units,
        gravity_torques=gravity_torques,
        wrench_matrix=None,
        passive_units=FREE_BODY,
    )
