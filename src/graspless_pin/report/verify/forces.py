"""Checks of forces: balance, cones, limits, torques, and the figures that follow from them."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify.figures import Forces, Problem
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.values import array, entry, number, word

FORCE_ERROR = 1e-6
"""Of the load: what counts as met."""
ROUNDING = 1e-9
"""Of the load: figures that follow from others by plain arithmetic agree to this."""
_FRAMES = 3e-6


def frames_check(problem: Problem) -> Check:
    """Check that the contact frames are orthonormal and that what slides does so tangentially."""
    off = np.abs(problem.frames @ problem.frames.transpose(0, 2, 1) - np.eye(3)).max()
    along = np.abs(np.einsum("li,li->l", problem.v, problem.frames[:, 0]))
    speed = np.where(problem.slides, np.linalg.norm(problem.v, axis=1), 1.0)
    off = max(float(off), float((along * problem.slides / speed).max()))
    return within("orthonormal frames, tangential sliding", off, _FRAMES, "")


def force_checks(problem: Problem, forces: Forces) -> list[Check]:
    """Check that forces balance the wrench within cones and limits, with the required margin."""
    F, L, normal = problem.force, problem.length, forces.local[:, 0]
    force, moment = forces.unbalanced[:3], forces.unbalanced[3:]
    over, joints = _over_limits(problem, forces), problem.joint_scale
    checks = [
        within("balance of forces", float(np.abs(force).max()), FORCE_ERROR * F, "N"),
        within("balance of moments", float(np.abs(moment).max()), FORCE_ERROR * F * L, "N m"),
        within("inside friction cones", _largest(forces.outside), FORCE_ERROR * F, "N"),
        within("normal forces within 0 and limit", _beyond(problem, normal), FORCE_ERROR * F, "N"),
        within("kinetic friction against sliding", _kinetic(problem, forces), FORCE_ERROR * F, "N"),
        within("required margin", problem.e0 - forces.margin, FORCE_ERROR * F, "N short"),
    ]
    if problem.own is not None:
        own, left = problem.own, own_residual(problem, forces)
        checks.append(within("constraints of the objective", left, FORCE_ERROR, "of their units"))
        if "torque" not in own.keeps:
            return [*checks, given("torques within limits", "the objective does not ask for them")]
    within_limits = within(
        "torques within limits", _largest(over / joints), FORCE_ERROR, "of the load's"
    )
    return [*checks, within_limits]


def own_residual(problem: Problem, forces: Forces) -> float:
    """Return the largest violation of an objective's own constraints, over their units."""
    own = problem.own
    if own is None:
        return 0.0
    beyond = own.beyond_forces(forces.local[:, 0], problem.limit, forces.faces, forces.columns)
    return max(own.beyond(forces.local, forces.columns), beyond / problem.force)


def residual(problem: Problem, forces: Forces) -> float:
    """Return the largest violation of any constraint, in scaled units."""
    F, L = problem.force, problem.length
    force = np.abs(forces.unbalanced[:3]).max() / F
    moment = np.abs(forces.unbalanced[3:]).max() / (F * L)
    short = (problem.e0 - forces.margin) / F
    over = _largest(_over_limits(problem, forces) / problem.joint_scale)
    if problem.own is not None:
        short = own_residual(problem, forces)
        over *= "torque" in problem.own.keeps
    return max(float(force), float(moment), short, over, _kinetic(problem, forces) / F, 0.0)


def figure_checks(problem: Problem, forces: Forces, document: dict[str, Any]) -> list[Check]:
    """Check the figures that are stated of the forces: torques, margin, the largest torque."""
    joints, scale = document["joints"], problem.joint_scale
    rows = {
        key: array([entry(j, key, "a joint") for j in joints], (len(joints),), key)
        for key in ("torque_contact", "torque")
    }
    # Torques may be small beside what gravity and contacts take from each other.
    sizes = (
        scale
        + np.abs(problem.gravity)
        + np.einsum("lij,li->j", np.abs(problem.J), np.abs(forces.f))
    )
    off = np.abs(rows["torque_contact"] - forces.made)
    off = np.maximum(off, np.abs(rows["torque"] - forces.torques)) / sizes
    margin = number(entry(document, "margin", "the document"), "margin")
    largest = number(entry(document, "max_torque", "the document"), "max_torque")
    unit = word(entry(document, "max_torque_unit", "the document"), "max_torque_unit", ("N m", "N"))
    torques = np.abs(forces.torques)
    found = float(torques.max(initial=0.0))
    tolerance = ROUNDING * float(sizes.max(initial=0.0))
    having = {
        name for name, one in zip(problem.units, torques, strict=True) if one >= found - tolerance
    } or {"N m"}  # fmt: skip
    room = ROUNDING * max(problem.force, float(np.abs(forces.f).max()))
    return [
        within("torques J^T f + g as stated", _largest(off), ROUNDING, "of the load's"),
        agrees("margin as stated", margin, forces.margin, room, "N"),
        agrees("largest torque as stated", largest, found, tolerance, unit),
        holds("its unit as stated", unit in having, unit),
    ]


def _largest(values: np.ndarray | float) -> float:
    return float(np.max(values, initial=0.0))


def _beyond(problem: Problem, normal: np.ndarray) -> float:
    return float(max((-normal).max(), (normal - problem.limit).max(), 0.0))


def _over_limits(problem: Problem, forces: Forces) -> np.ndarray:
    return np.maximum(
        np.maximum(forces.torques - problem.upper, problem.lower - forces.torques), 0.0
    )


def _kinetic(problem: Problem, forces: Forces) -> float:
    """How far forces are from the kinetic friction where they have no cone, N."""
    bare = ~problem.cone
    along = forces.local[:, :1] * problem.directions
    return float(np.abs(forces.f - along)[bare].max(initial=0.0))
