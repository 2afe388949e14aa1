"""What there is to say of each contact where it is drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.nearest_limits import ContactLimit, contact_rooms, limiting_contacts
from graspless_pin.solution.tables import force_rounding, shown
from graspless_pin.solution.utilization import contact_state, friction_use


def contact_words(
    problem: QuasistaticProblem, solution: TorqueSolution | None, bodies: Sequence[str] | None
) -> list[tuple[str, ...]]:
    """Return lines for each contact: its name, its force, how much friction is used, what limits.

    Args:
        problem: The contacts.
        solution: A solution that was found; None: only names and coefficients.
        bodies: M names of what touches the object; None: left out.
    """
    names = [
        f"contact {index}" + (f": {bodies[index]}" if bodies is not None else "")
        for index in range(problem.contact_count)
    ]
    if solution is None:
        return [(name, f"μ = {mu:g}") for name, mu in zip(names, problem.friction, strict=True)]
    forces, load = solution.contact_forces, problem.scales.force
    normal = np.einsum("ij,ij->i", problem.normals, forces)
    friction = np.linalg.norm(forces - normal[:, None] * problem.normals, axis=1)
    rooms, use = contact_rooms(problem, forces), friction_use(problem, forces)
    limiting, rounding = limiting_contacts(solution).items(), force_rounding(problem)
    lines = []
    for index, name in enumerate(names):
        held = f", {100.0 * use[index]:.0f} % of what μ = {problem.friction[index]:g} allows"
        nearest = int(np.argmin(rooms[index]))
        limits = [limit for limit, contacts in limiting if index in contacts]
        room, own_normal, own_friction = (
            shown(float(one), load, "", rounding[index])
            for one in (rooms[index, nearest], normal[index], friction[index])
        )
        away = f"{room} N from "
        away += " and ".join(limits) or tuple(ContactLimit)[nearest]
        lines.append(
            (
                name,
                f"normal force {own_normal} N",
                f"friction {own_friction} N"
                + ("" if np.isnan(use[index]) else held)
                + f" ({contact_state(problem, forces, index)})",
                away + (", which limits the margin" if limits else ""),
            )
        )
    return lines
