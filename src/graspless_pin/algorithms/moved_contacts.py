"""Members of a set whose contacts are elsewhere than they are meant to be: they are sampled.

Positions change the maps of a problem, not its load: what given torques bear is not convex in them,
and no corners prove what is between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from graspless_pin.algorithms.uncertainty import Uncertainty, each_of
from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member, feedback_torques


def contact_radii(
    problem: QuasistaticProblem, uncertainty: Uncertainty, slopes: FloatArray | None
) -> FloatArray:
    """Return (M,) m, how far each contact may be off within its tangent plane.

    Args:
        problem: The nominal one.
        uncertainty: The set.
        slopes: See `moved_members`.

    Raises:
        ArgumentError: If there are figures for another number of contacts or by name, or it is not
            known what moved contacts do to the load or to joints.
    """
    radii = each_of(
        "contact_position", uncertainty.contact_position, problem.contact_count, "contacts"
    )
    moved = radii > 0.0
    if moved.any() and problem.wrench_matrix is not None:
        raise ArgumentError(
            "contact_position", "is of one free object, and the problem has a wrench_matrix"
        )
    if slopes is None and problem.jacobian.reshape(len(radii), -1)[moved].any():
        raise ArgumentError(
            "contact_position",
            "moves contacts of joints, and arrays do not tell their Jacobian elsewhere; ask it of "
            "a scene, or give 0 for these contacts",
        )
    return radii


def moved_members(
    members: Sequence[Member],
    radii: FloatArray,
    slopes: FloatArray | None,
    rng: np.random.Generator,
    count: int,
    *,
    stiffness: FloatArray | None = None,
    far: bool = False,
) -> list[Member]:
    """Return members, drawn at random, with all contacts moved at random.

    Normals stay, and so does how fast contacts slide.

    Args:
        members: Those to draw from, with contacts where they are meant to be.
        radii: (M,) m, how far each contact may be off within its tangent plane.
        slopes: (3, 3M, L) what the Jacobian gains where contacts are moved along each world axis,
            per m; None: nothing.
        rng: What draws.
        count: How many.
        stiffness: (L,) of joints with feedback, N m/rad (N/m); None: there is none.
        far: Whether contacts are as far off as they may be; else evenly spread.
    """
    drawn = []
    for number in rng.integers(len(members), size=count).tolist():
        member = members[number]
        problem = member.problem
        angles = rng.uniform(0.0, 2.0 * np.pi, len(radii))
        off = radii * (1.0 if far else np.sqrt(rng.uniform(size=len(radii))))
        within = off[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        moved = np.einsum("lij,lj->li", problem.tangents, within)
        jacobian = problem.jacobian
        if slopes is not None:
            jacobian = jacobian + np.einsum("kal,ak->al", slopes, np.repeat(moved, 3, axis=0))
        elsewhere = problem.with_changes(positions=problem.positions + moved, jacobian=jacobian)
        told = f"contacts moved by up to {1000.0 * off.max():.3g} mm"
        words = told if member.words == "nominal" else f"{member.words}, {told}"
        own = None if stiffness is None else feedback_torques(elsewhere, stiffness)
        drawn.append(replace(member, problem=elsewhere, words=words, moved=moved, directions=own))
    return drawn
