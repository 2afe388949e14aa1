"""How much of their limits forces and torques use."""

from __future__ import annotations

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.scales import LIMIT_TOLERANCE

_AT_LIMIT = 1e-6
_OWN_LEVER = 1e-3
"""Of the longest lever at a contact: joints with a shorter one say nothing of forces there."""


def joint_sizes(problem: QuasistaticProblem) -> FloatArray:
    """(L,) what the load makes on each joint, or its limit where that is smaller."""
    return problem.limit_tolerances[0] / LIMIT_TOLERANCE


def force_sizes(problem: QuasistaticProblem) -> FloatArray:
    """(M,) the load, N, or what the hand can do at a contact of its own where that is less."""
    load = problem.scales.force
    sizes = np.full(problem.contact_count, load)
    if problem.strictness is None:
        return sizes
    blocks = problem.jacobian.reshape(problem.contact_count, 3, -1)
    levers = np.sqrt((blocks**2).sum(axis=1))
    own = (levers > 0.0) & (levers >= _OWN_LEVER * levers.max(axis=1, initial=0.0, keepdims=True))
    forces = np.where(own, joint_sizes(problem), 0.0) / np.where(own, levers, 1.0)
    return np.where(own.any(axis=1), np.minimum(forces.max(axis=1, initial=0.0), load), sizes)


def friction_use(problem: QuasistaticProblem, forces: FloatArray) -> FloatArray:
    """(M,) |tangential force| / (mu times normal force); NaN where there is no friction or load.

    1 is the edge of the Coulomb cone; the polyhedral cone inside it ends a little earlier. Of
    other laws it is the edge of the cone itself, where contacts that slide are.
    """
    local = np.einsum("mji,mj->mi", problem.frames, forces)
    most, model = problem.friction * local[:, 0], problem.cone_model
    with np.errstate(divide="ignore", invalid="ignore"):
        use = model.friction_sizes(local[:, 1:], problem.cone_edges) / most
    if not model.is_coulomb:
        use[problem.is_sliding] = 1.0
    return np.where(most > 0.0, use, np.nan)


def contact_state(problem: QuasistaticProblem, forces: FloatArray, contact: int) -> str:
    """Return ``sliding``, ``frictionless``, ``at its limit`` (on its cone) or ``sticking``."""
    if problem.is_sliding[contact]:
        return "sliding"
    if not problem.has_cone[contact]:
        return "frictionless"
    room = problem.room_in_cones(forces)[contact]
    return "at its limit" if room <= _AT_LIMIT * force_sizes(problem)[contact] else "sticking"


def limit_shares(torques: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """(L,) share of the limit on the side where each torque is; NaN where that side has none."""
    limit = np.where(torques >= 0.0, upper, lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = torques / limit
    return np.where(np.isfinite(limit) & (limit != 0.0), share, np.nan)
