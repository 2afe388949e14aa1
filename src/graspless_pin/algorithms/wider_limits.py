"""Limits made so much wider, in words and as a problem."""

from __future__ import annotations

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.joint_units import JointUnit, units_text

ROOM = 1.0 + 1e-6
"""A suggestion goes further by this, so that it is feasible and not just about to be."""
DIGITS = 5


def helped(problem: QuasistaticProblem, forces: FloatArray) -> tuple[str, QuasistaticProblem]:
    """Return a wrench from outside that closes the balance of given forces."""
    help_ = -(problem.W @ forces.ravel() + problem.external_wrench)
    changed = problem.with_changes(external_wrench=problem.external_wrench + help_)
    force, moment = np.round(help_[:3], 4) + 0.0, np.round(help_[3:], 5) + 0.0
    text = (
        f"an outside help in the balance: force {force.tolist()} N and moment "
        f"{moment.tolist()} N m on the object"
    )
    return text, changed


def wider_joint(
    problem: QuasistaticProblem, joint: int, torque: float
) -> tuple[str, QuasistaticProblem]:
    """Return limits of one joint that let it make a torque: both where symmetric, else one."""
    lower, upper = problem.lower_torque.copy(), problem.upper_torque.copy()
    name, unit = problem.joint_names[joint], problem.joint_units[joint]
    room = (ROOM - 1.0) * abs(torque)
    symmetric = lower[joint] == -upper[joint]
    if torque - upper[joint] > lower[joint] - torque:
        side, limit = "upper ", rounded_up(torque + room)
        upper[joint] = limit
    else:
        side, limit = "lower ", -rounded_up(room - torque)
        lower[joint] = limit
    if symmetric:
        side, limit = "", abs(limit)
        lower[joint], upper[joint] = -limit, limit
    text = f"{name}'s {side}limit would have to be {limit:.{DIGITS}g} {unit}"
    return text, problem.with_changes(torque_limits=(lower, upper))


def in_units(problem: QuasistaticProblem, amount: float) -> str:
    """Return an amount of the torques of all joints with its unit."""
    units = units_text(problem.joint_units)
    return f"{amount:.{DIGITS}g} {units if units in list(JointUnit) else f'({units})'}"


def wider(problem: QuasistaticProblem, more: float) -> QuasistaticProblem:
    """Return the problem with every torque limit wider, but a limit of zero on one side only."""
    lower, upper = problem.lower_torque, problem.upper_torque
    lower = lower - np.where((lower == 0.0) & (upper != 0.0), 0.0, more)
    upper = upper + np.where((upper == 0.0) & (problem.lower_torque != 0.0), 0.0, more)
    return problem.with_changes(torque_limits=(lower, upper))


def rounded_up(value: float) -> float:
    """Round up to the digits that are printed, so that the printed figure is enough."""
    if value == 0.0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(abs(value))) + 1 - DIGITS)
    return float(f"{np.ceil(value / unit) * unit:.{DIGITS}g}")
