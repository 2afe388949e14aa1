"""Motions of object and joints that no friction resists: torques alone do not hold against them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from graspless_pin.holding.verdict import SmallMotions
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.contact_map import contact_map
from graspless_pin.problem.inertias import hybrid_contacts

NEGLIGIBLE = 1e-6
"""A speed below this share of the others is none, and so is a lever."""


def free_motions(problem: QuasistaticProblem) -> FloatArray:
    """Return a basis of the motions that move the object while every contact just rolls.

    Object and joints move so that all contacts keep touching and none slips, but those that slide
    anyway or have no friction. To first order nothing resists such a motion: whether constant
    torques hold the object then hangs on curvatures and weights, and mostly they do not; position
    feedback does. In a declared sliding the sliding itself is among them.

    Motions of the joints alone are left out: each motion moves the joints as little as it can. At
    a hybrid finger's contact the finger follows along the normal, and its entry is zero.

    Args:
        problem: Contacts and joints. `joint_inertia` tells which columns are hybrid fingers';
            without it such a column is a joint that follows.

    Returns:
        (k, P + L) velocities, read-only: of the object [linear of the reference point; angular],
        world axes, m/s and rad/s, or of other passive coordinates, then of the joints. k = 0: none.
        The rows are orthonormal when linear velocities count in `problem.scales.length` per second,
        angular ones in rad/s, and a joint's rate in that length over its longest lever. Those that
        move the object most come first.

    Raises:
        ArgumentError: If it is no problem.

    Examples:
        >>> from graspless_pin import load_scene, free_motions
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> len(free_motions(scene.problem()))
        3
    """
    checked_problem(problem)
    basis, moving, units = _without_slip(problem)
    _, shares, turns = np.linalg.svd(basis[: problem.passive_count], full_matrices=True)
    count = int((shares > NEGLIGIBLE).sum())
    motions = np.zeros((count, len(moving)))
    motions[:, moving] = turns[:count] @ basis.T * units
    return read_only(motions)


def rolling_without_scene(problem: QuasistaticProblem) -> SmallMotions:
    """Return what is known of small motions about a rest from its contacts' first order alone.

    Where no motion of object and joints leaves all contacts without slip, there is none. How
    contacts roll in others hangs on surfaces, which a problem does not have.

    Args:
        problem: Contacts and joints at rest.
    """
    if problem.is_sliding.any():
        return SmallMotions.not_known("contacts slide as declared")
    basis, _, _ = _without_slip(problem)
    if not basis.shape[1]:
        return SmallMotions(0.0, 0.0)
    return SmallMotions.not_known("how the contacts roll needs a scene with shapes")


def _without_slip(
    problem: QuasistaticProblem,
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """Return a basis of the motions without slip, scaled, of which entries, and their units."""
    hybrid = hybrid_contacts(problem)
    counts = [problem.passive_count, problem.joint_count]
    moving = np.concatenate([np.ones(counts[0], dtype=bool), hybrid < 0])
    units = motion_units(problem)[moving]
    velocities = contact_map(problem) * np.repeat([1.0, -1.0], counts)
    velocities = velocities[:, :, moving] * (units / problem.scales.length)
    still = np.ones((problem.contact_count, 3), dtype=bool)
    still[:, 1:] = problem.has_cone[:, None]
    still[hybrid[hybrid >= 0], 0] = False
    return null_space(velocities[still], rcond=NEGLIGIBLE), moving, units


def motion_units(problem: QuasistaticProblem) -> FloatArray:
    """Return the (P + L,) velocities of object and joints that count as one in `free_motions`."""
    length = problem.scales.length
    blocks = problem.jacobian.reshape(problem.contact_count, 3, problem.joint_count)
    levers = np.linalg.norm(blocks, axis=1).max(axis=0)
    levers = np.maximum(levers, NEGLIGIBLE * levers.max(initial=0.0))
    joints = np.divide(length, levers, out=np.ones_like(levers), where=levers > 0.0)
    return np.concatenate([np.where(problem.passive_turns, 1.0, length), joints])
