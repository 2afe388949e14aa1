"""Certificates of one linear program: balance without friction that contacts may not bear.

If forces f* balance load and torques, with f*_n >= 0 and |f*_t| <= mu l at every contact, where l
is a normal force that every outcome has at least, then every outcome has
|y|^2 <= sum (|f*_t| - mu l) |u_t| <= 0: rest is the only one.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.holding.bounds import States
from graspless_pin.holding.dynamics import (
    LEAST_LOAD,
    Dynamics,
    force_jacobian,
    free_friction,
    generalized_load,
)
from graspless_pin.holding.equilibrium import (
    BALANCE_TOLERANCE,
    Balance,
    farthest_forces,
    least_residual,
    pushed,
)
from graspless_pin.holding.relaxation import FORCE_LIMIT, Relaxation
from graspless_pin.holding.verdict import LoadProof
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.scales import coordinate_units

MOST_FORCE = 1e3
"""Of the load: admissible forces are looked at up to this, or the normal forces' limit."""
_HOPELESS = 0.03
"""Of the load: forces that leave more unbalanced let the object move."""
_ROUNDS = 4
_LEAST_TORQUE = 1e-6
"""Of the largest torque that load or weight makes: joints' torques are measured in no less."""
_EXACT = 1e-8
"""Of the load: what may stay unbalanced, or unborne, where no inertia tells what that moves."""


def balance(
    problem: QuasistaticProblem, torques: FloatArray, friction_limits: FloatArray | None = None
) -> Balance | None:
    """Find the contact forces that leave least of load and torques unbalanced.

    Where they leave far too much to be forces of rest, or a certificate, they are not the least.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) of the motors.
        friction_limits: (M,) N, friction that each contact bears at most; None: mu f_n.
    """
    jacobian, load = in_loads(problem, torques)
    count = problem.contact_count
    if friction_limits is not None and not friction_limits.any():
        found = pushed(jacobian[:, 0], load)
        if found is not None:
            return found
    most = (
        np.full(count, np.nan)
        if friction_limits is None
        else friction_limits / problem.scales.force
    )
    enough = BALANCE_TOLERANCE if friction_limits is None else _HOPELESS
    return least_residual(jacobian, load, free_friction(problem), most, enough)


def in_loads(problem: QuasistaticProblem, torques: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return G as forces see it (M, 3, P + L), and g (P + L,), for forces in loads, in loads."""
    unit, force = balance_units(problem), problem.scales.force
    return force * force_jacobian(problem) / unit, generalized_load(problem, torques) / unit


def balance_units(problem: QuasistaticProblem) -> FloatArray:
    """Return (P + L,) what the balance is measured in: what the load makes of each entry.

    At a joint with next to no lever it is no less than a small share of the largest torque that
    load or weight makes at any joint: what rounding leaves of torques moves nothing.
    """
    units = coordinate_units(problem.scales, problem.passive_units)
    joints = units[problem.passive_count :]
    most = np.maximum(joints, np.abs(problem.gravity_torques)).max(initial=0.0)
    np.maximum(joints, _LEAST_TORQUE * most, out=joints)
    return units


def proves_unrest(problem: QuasistaticProblem, torques: FloatArray, motion: FloatArray) -> float:
    """Return what every set of contact forces leaves unbalanced at least, in loads.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) of the motors.
        motion: (P + L,) z with sum |z| <= 1: the forces' part z.G^T f is never negative.
    """
    jacobian, load = in_loads(problem, torques)
    z, lost = scaled_proof(jacobian, problem.friction, motion)
    return float(z @ load) - lost


def scaled_proof(
    jacobian: FloatArray, friction: FloatArray, motion: FloatArray
) -> tuple[FloatArray, float]:
    """Return z with sum |z| <= 1, and what forces up to the limit take from z.g at most, in loads.

    Args:
        jacobian: (M, 3, k) G as forces see it, in units of the load.
        friction: (M,) coefficients.
        motion: (k,) z.
    """
    z = motion / max(1.0, float(np.abs(motion).sum()))
    c = jacobian @ z
    short = np.maximum(friction * np.hypot(c[:, 1], c[:, 2]) - c[:, 0], 0.0)
    return z, FORCE_LIMIT * float(short.sum())


def is_certificate(
    problem: QuasistaticProblem,
    torques: FloatArray,
    forces: FloatArray,
    loads: FloatArray,
    dynamics: Dynamics | None,
) -> bool:
    """Return whether forces prove that rest is the only outcome.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) of the motors.
        forces: (M, 3) N, in contact frames.
        loads: (M,) N.
        dynamics: The scaled dynamics; None: it has to hold for every inertia.
    """
    unborne = np.hypot(forces[:, 1], forces[:, 2]) - problem.friction * loads
    unborne, pulling = np.maximum(unborne, 0.0), np.maximum(-forces[:, 0], 0.0)
    if dynamics is None:
        scale = problem.scales.force
        jacobian, load = in_loads(problem, torques)
        left = np.einsum("lik,li->k", jacobian, forces / scale) + load
        return max(np.abs(left).max(), unborne.max() / scale, pulling.max() / scale) <= _EXACT
    unit, rows = dynamics.force_unit, dynamics.rows
    y = np.linalg.norm(dynamics.motion(forces / unit))
    y += unborne / unit @ np.linalg.norm(rows[:, 1:], ord=2, axis=(1, 2))
    y += pulling / unit @ np.linalg.norm(rows[:, 0], axis=1)
    return bool(y <= dynamics.resolution)


def proven_loads(
    dynamics: Dynamics, least: FloatArray, force_limit: float
) -> tuple[tuple[LoadProof, ...], int]:
    """Return smallest normal forces that every outcome has, where there are any, and the programs.

    Each contact is asked for its own, in rounds: with loads that are known friction takes more of
    the load's power, so that other contacts have to bear more.

    Args:
        dynamics: The scaled dynamics.
        least: (M,) normal forces that every outcome has at least, scaled.
        force_limit: What it proves holds for normal forces up to this, scaled.
    """
    states = States.unknown(dynamics.contact_count)
    relaxation, proofs = Relaxation(dynamics, least, force_limit), list[LoadProof]()
    for _ in range(_ROUNDS):
        found = relaxation.larger_loads(states)
        proofs += found
        if not found:
            break
        relaxation = relaxation.with_loads(found)
    return tuple(proofs), relaxation.programs


def bearing_forces(
    problem: QuasistaticProblem, torques: FloatArray, forces: FloatArray
) -> FloatArray:
    """Return forces of a rest in which all contacts bear load that do in any.

    Args:
        problem: Contacts and loads, at rest.
        torques: (L,) N m (N).
        forces: (M, 3) of a rest, in contact frames, in loads.

    Returns:
        (M, 3) in contact frames, in loads.
    """
    jacobian, load = in_loads(problem, torques)
    most = np.minimum(problem.max_normal_force / problem.scales.force, MOST_FORCE)
    found = [forces]
    for contact in np.flatnonzero(forces[:, 0] <= LEAST_LOAD).tolist():
        if np.mean(found, axis=0)[contact, 0] <= LEAST_LOAD:
            cost = np.zeros_like(forces)
            cost[contact, 0] = -1.0
            other = farthest_forces(jacobian, load, free_friction(problem), cost, most)
            if other is not None and other[contact, 0] > LEAST_LOAD:
                found.append(other)
    return np.mean(found, axis=0)
