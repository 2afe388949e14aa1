"""Active limits of a solution: the contacts that limit its margin, the joint nearest its limit."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.solution.certificate import Status
from graspless_pin.solution.tables import (
    decimals,
    force_sizes,
    friction_use,
    limit_shares,
    torque_rounding,
    torque_size,
)
from graspless_pin.solution.torque_solution import TorqueSolution

_TIE_TOLERANCE = 1e-6
_LIMITING_SHARE = 0.25
_UNUSED_FRICTION = 0.05
"""Share of its friction below which a contact force counts as using none."""


class ContactLimit(StrEnum):
    """Limits of a contact force; the texts continue a sentence after "from"."""

    LOSS = "losing contact"
    PRESS = "its normal-force limit"
    SLIP = "slipping"


def contact_rooms(problem: QuasistaticProblem, forces: FloatArray) -> FloatArray:
    """Return (M, 3) distances of each contact force from each `ContactLimit`, in their order, N.

    The smallest of all is the margin. The distance is infinite if there is no such limit.

    Args:
        problem: The problem.
        forces: (M, 3) contact forces on the object, N.
    """
    normal = np.einsum("ij,ij->i", problem.normals, forces)
    return np.column_stack(
        (normal, problem.max_normal_force - normal, problem.cone_distances(forces))
    )


def limiting_contacts(solution: TorqueSolution) -> dict[ContactLimit, list[int]]:
    """Return the contacts that limit the margin, by the limit that they are nearest to.

    They are the contacts with no more than the margin whose multipliers are at least a quarter of
    the largest: relaxing their limits raises the margin most. If another objective was optimised,
    or all multipliers are zero, they are all contacts with no more than the margin.

    Args:
        solution: A solution that was found.
    """
    problem = solution.problem
    distances = contact_rooms(problem, solution.contact_forces)
    limiting = distances <= solution.margin + _TIE_TOLERANCE * force_sizes(problem)[:, None]
    if solution.algorithm is Algorithm.MARGIN and solution.status is not Status.STRONG:
        duals = solution.multipliers
        # The first of a round cone's multipliers is its force in the direction of the margin.
        second_order = problem.cone_model.second_order
        sides = duals["round_cones"][:, 0] if second_order else duals["faces"].sum(axis=1)
        weights = limiting * np.column_stack([duals["normal_lower"], duals["normal_upper"], sides])
        if weights.any():
            limiting = weights >= _LIMITING_SHARE * weights.max()
    return {
        limit: np.flatnonzero(column).tolist()
        for limit, column in zip(ContactLimit, limiting.T, strict=True)
        if column.any()
    }


def margin_limit_words(solution: TorqueSolution, bodies: Sequence[str] | None = None) -> str:
    """Return a sentence on which contacts limit the margin, and by which limit.

    Contacts near slipping are told apart by whether they use friction: a force along the normal is
    already as far from the sides of its cone as its size and the friction allow. Contacts without
    friction are named, too: (42) does not apply to them, so less friction may mean more margin.

    Args:
        solution: A solution that was found.
        bodies: M names of what touches the object at each contact; None: left out.
    """
    by_limit: dict[str, list[int]] = {}
    use = friction_use(solution.problem, solution.contact_forces)
    for limit, contacts in limiting_contacts(solution).items():
        for contact in contacts:
            unused = limit is ContactLimit.SLIP and use[contact] <= _UNUSED_FRICTION
            words = "available friction" if unused else f"the distance to {limit}"
            by_limit.setdefault(words, []).append(contact)
    parts = [
        f"{words} at {_contact_list(contacts, bodies)}" for words, contacts in by_limit.items()
    ]
    sentence = f"The margin is limited by {' and by '.join(parts)}."
    problem = solution.problem
    frictionless = np.flatnonzero(~problem.has_cone & ~problem.is_sliding).tolist()
    if not frictionless:
        return sentence
    where = _contact_list(frictionless, bodies)
    return f"{sentence} At {where}, without friction, it counts only the normal force."


def _contact_list(contacts: Sequence[int], bodies: Sequence[str] | None) -> str:
    numbers = ", ".join(map(str, contacts))
    names = "" if bodies is None else f" ({', '.join({bodies[c]: 0 for c in contacts})})"
    return f"contact{'s' * (len(contacts) > 1)} {numbers}{names}"


def joint_limit_words(solution: TorqueSolution) -> str:
    """Return a sentence on which joint is nearest its limit.

    Empty without joints, and if the torque nearest its limit is zero up to rounding.

    Args:
        solution: A solution that was found.
    """
    problem, torques = solution.problem, solution.torques
    if not problem.joint_count:
        return ""
    shares = limit_shares(torques, problem.lower_torque, problem.upper_torque)
    if np.isnan(shares).all():
        return "No joint has a finite limit other than zero on the side of its torque."
    # If joints tie, as at the minimum of the largest torque, rounding must not choose among them.
    joint = int(np.argmax(shares >= (1.0 - _TIE_TOLERANCE) * np.nanmax(shares)))
    torque, size = float(torques[joint]), torque_size(problem, torques)
    rounding = torque_rounding(problem, solution.contact_torques)[joint]
    limit = (problem.upper_torque if torque >= 0.0 else problem.lower_torque)[joint]
    figure = decimals(torque, size, "+", rounding)
    if figure == "0":
        return ""
    spent = "; nothing is left for feedback to add" if shares[joint] >= 1.0 - _TIE_TOLERANCE else ""
    return (
        f"Joint {problem.joint_names[joint]} is nearest its limit: {figure} of "
        f"{limit:+.6g} {problem.joint_units[joint]}, {100.0 * shares[joint]:.1f} %{spent}."
    )
