"""How the largest margin changes with the data, from the multipliers of its program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

import numpy as np

from graspless_pin.algorithms.formulation import shared_parts
from graspless_pin.algorithms.torque import maximize_margin
from graspless_pin.errors import NoSolutionError
from graspless_pin.modes.rules import RuleOptions
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.force_programs import force_coordinates, margin_program
from graspless_pin.solution import TorqueSolution

_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class MarginSensitivity:
    """Derivatives of the largest margin in its optimal mode.

    Where the optimum is degenerate or the mode is about to change, they are one of several
    one-sided derivatives.

    Attributes:
        friction: (M,) N per unit of each friction coefficient.
        external_wrench: (6,) N per N of force and per N m of moment.
        load: N per unit of a common factor on the external wrench; over the mass where the wrench
            is the object's weight.
        upper_torque: (L,) N per N m of each upper limit.
        lower_torque: (L,) N per N m of each lower limit.
        max_normal_force: (M,) N per N of each normal-force limit.
        solution: The solution that they belong to.
    """

    friction: FloatArray
    external_wrench: FloatArray
    load: float
    upper_torque: FloatArray
    lower_torque: FloatArray
    max_normal_force: FloatArray
    solution: TorqueSolution

    def per_mass(self, mass: float) -> float:
        """Return N per kilogram where the external wrench is the weight of this mass (kg)."""
        return self.load / mass


def margin_sensitivity(
    problem: QuasistaticProblem,
    *,
    node_limit: int | None = None,
    time_limit: float | None = None,
    **options: Unpack[RuleOptions],
) -> MarginSensitivity:
    """Differentiate the largest margin by its data.

    The derivative of an optimum is that of its Lagrangian at fixed forces and multipliers.

    Args:
        problem: Contacts, wrench, joints and limits.
        node_limit: See `maximize_margin`; with a limit the derivatives are those of the best found.
        time_limit: See `maximize_margin`.
        options: ``sign_rule``, ``sliding_rule``, ``static_friction`` of `maximize_margin`.

    Raises:
        NoSolutionError: If no margin is feasible.
    """
    solution = maximize_margin(problem, node_limit=node_limit, time_limit=time_limit, **options)
    if not solution.found:
        raise NoSolutionError(f"There is no margin to differentiate ({solution.status.message}).")
    # The search's own multipliers: friction that happens to vanish is not held at zero in them.
    y, z = solution.multipliers.mode
    coordinates, _ = shared_parts(problem)
    basis, force = coordinates.basis, coordinates.force_scale
    per_torque = force / coordinates.joint_scale
    scaled = basis.T @ solution.contact_forces.ravel() / ((basis**2).sum(axis=0) * force)
    x = np.append(scaled, solution.margin / force)
    # Lagrangian: c x + y (A x - b) + up (G x - u) + down (l - G x); the margin is -F times it.
    up, down = np.maximum(z, 0.0), np.maximum(-z, 0.0)
    joints, cones = problem.joint_count, int(problem.has_cone.sum()) * problem.cone_edges
    weight = np.repeat([1.0, 1.0 / coordinates.length_scale], 3)
    wrench = -weight * y
    friction = np.array(
        [
            -force * _by_friction(problem, contact, x, y, up - down)
            for contact in range(problem.contact_count)
        ]
    )
    limits = slice(cones, cones + problem.contact_count)
    tail = slice(len(z) - joints, len(z))
    return MarginSensitivity(
        friction=read_only(friction),
        external_wrench=read_only(wrench),
        load=float(wrench @ problem.external_wrench),
        upper_torque=read_only(per_torque * up[tail]),
        lower_torque=read_only(-per_torque * down[tail]),
        max_normal_force=read_only(up[limits]),
        solution=solution,
    )


def _by_friction(
    problem: QuasistaticProblem,
    contact: int,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
) -> float:
    """Derivative of the Lagrangian by one coefficient, by differences of its rows.

    Central ones, but for a sliding contact without friction: its rows are linear in the
    coefficient, which cannot be negative. A frictionless contact at rest has no cone to widen.
    """
    mu = float(problem.friction[contact])
    if mu == 0.0 and not problem.is_sliding[contact]:
        return 0.0
    step = _STEP * (mu or 1.0)
    values, ends = [], (mu + step, max(mu - step, 0.0))
    for end in ends:
        friction = problem.friction.copy()
        friction[contact] = end
        moved = problem.with_changes(friction=friction)
        other = margin_program(moved, force_coordinates(moved), 0.0)
        values.append(float(y @ (other.A @ x) + z @ (other.G @ x)))
    return (values[0] - values[1]) / (ends[0] - ends[1])
