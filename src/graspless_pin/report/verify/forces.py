"""Checks of forces: balance, cones, limits, torques, and the figures that follow from them."""

from __future__ import annotations

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part, stacked
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.problem import Forces, Problem


def frames_check(problem: Problem) -> Check:
    """Check that contact frames are orthonormal and sliding velocities tangential."""
    error = np.abs(problem.frames @ problem.frames.transpose(0, 2, 1) - np.eye(3)).max()
    along = np.abs(np.einsum("li,li->l", problem.v, problem.frames[:, 0]))
    speed = np.where(problem.slides, np.linalg.norm(problem.v, axis=1), 1.0)
    error = max(float(error), float((along * problem.slides / speed).max()))
    return within("orthonormal frames, tangential sliding", error, tolerances.FRAMES, "")


def force_checks(problem: Problem, forces: Forces) -> list[Check]:
    """Check that forces balance the wrench within cones and limits, with the required margin."""
    normal, limit = forces.local[:, 0], tolerances.force(problem)
    force, moment = _unbalanced_load(problem, forces)
    checks = [
        within("balance of forces", force, limit, "N"),
        within("balance of moments", moment, tolerances.moment(problem), "N m"),
        within("inside friction cones", _largest_excess(forces.outside), limit, "N"),
        within("normal forces between 0 and limit", _normal_excess(problem, normal),
               tolerances.SHARE, "of limit or load"),
        within("kinetic friction opposes sliding", _kinetic_error(problem, forces), limit, "N"),
        within("required margin", problem.e0 - forces.margin, limit, "N short"),
    ]  # fmt: skip
    if problem.own is not None:
        own, violation = problem.own, own_residual(problem, forces)
        checks.append(
            within("constraints of the objective", violation, tolerances.SHARE, "of their units")
        )
        if "torque" not in own.keeps:
            return [*checks, given("torques within limits", "the objective omits them")]
    name, over = "torques within limits", _torque_excess(problem, forces)
    if not tolerances.are_limits_resolved(problem):
        lost = "the load is too large to check torque limits in double precision"
        return [*checks, holds(name, passed=False, detail=lost)]
    return [*checks, within(name, over, tolerances.SHARE, "of limit or load")]


def against_mode(
    problem: Problem, forces: Forces, selected: np.ndarray, signs: np.ndarray
) -> float:
    """Return the largest friction that does not oppose a mode as (27) and (31) require, N."""
    friction = forces.local[:, 1:] * problem.has_cone[:, None]
    allowed = np.where(signs == 0, np.abs(friction), signs * friction)
    allowed[~selected] = np.abs(friction[~selected])
    return _largest_excess(allowed)


def own_residual(problem: Problem, forces: Forces) -> float:
    """Return the largest violation of an objective's own constraints, over their units."""
    own = problem.own
    if own is None:
        return 0.0
    beyond = own.force_violation(forces.local[:, 0], problem.limit, forces.faces, forces.columns)
    return max(own.violation(forces.local, forces.columns), beyond / problem.force)


def residual(problem: Problem, forces: Forces) -> float:
    """Return the largest violation of any constraint, in scaled units."""
    F, L = problem.force, problem.length
    force, moment = _unbalanced_load(problem, forces)
    short = (problem.e0 - forces.margin) / F
    over, beyond = _torque_excess(problem, forces), _normal_excess(problem, forces.local[:, 0])
    if problem.own is not None:
        short = own_residual(problem, forces)
        over *= "torque" in problem.own.keeps
    return max(
        force / F, moment / (F * L), short, over, beyond, _kinetic_error(problem, forces) / F, 0.0
    )


def figure_checks(problem: Problem, forces: Forces, stated: Part) -> list[Check]:
    """Check the figures that a document states of the forces: torques, margin, largest torque."""
    # Torques may be small differences of gravity and contact torques.
    allowed = tolerances.torque_figure(problem)
    off = np.abs(stacked(stated["joints"], "torque_contact") - forces.contact_torques)
    off = np.maximum(off, np.abs(stacked(stated["joints"], "torque") - forces.torques)) / allowed
    margin, largest, unit = (stated[key] for key in ("margin", "max_torque", "max_torque_unit"))
    torques = np.abs(forces.torques)
    found = float(torques.max(initial=0.0))
    tolerance = float(allowed.max(initial=0.0))
    units = {
        name for name, one in zip(problem.units, torques, strict=True) if one >= found - tolerance
    } or {"N m"}  # fmt: skip
    # A margin slightly below zero, within the tolerance of `force_checks`, is stated as zero.
    is_none = margin == 0.0 and -tolerances.force(problem) <= forces.margin < 0.0
    checked_margin = 0.0 if is_none else forces.margin
    return [
        within(
            "torques J^T f + g as stated",
            tolerances.ARITHMETIC * _largest_excess(off),
            tolerances.ARITHMETIC,
            "of the load's torque",
        ),
        agrees("margin as stated", margin, checked_margin, tolerances.force_figure(problem), "N"),
        agrees("largest torque as stated", largest, found, tolerance, unit),
        holds("unit of the largest torque as stated", unit in units, unit),
    ]


def _largest_excess(values: np.ndarray | float) -> float:
    return float(np.max(values, initial=0.0))


def _unbalanced_load(problem: Problem, forces: Forces) -> tuple[float, float]:
    """Return upper bounds on the unbalanced force and moment, N and N m."""
    parts, f, w = (one.astype(np.longdouble) for one in (problem.passive, forces.f, problem.w))
    unbalanced = np.einsum("lji,lj->i", parts, f) + w
    sizes = np.einsum("lji,lj->i", np.abs(parts), np.abs(f)) + np.abs(w)
    if problem.own is not None:
        unbalanced = unbalanced + problem.own.balance @ forces.columns
        sizes = sizes + np.abs(problem.own.balance) @ np.abs(forces.columns)
    most = np.abs(unbalanced) + tolerances.rounding_error(sizes)
    force, moment = (most[one].max(initial=0.0) for one in (~problem.is_moment, problem.is_moment))
    return float(force), float(moment)


def _normal_excess(problem: Problem, normal: np.ndarray) -> float:
    """Return the largest excess of normal forces over 0 and limits, relative to their scales."""
    over = _largest_excess((normal - problem.limit) / tolerances.normal_limits(problem))
    return max(_largest_excess(-normal) / problem.force, tolerances.SHARE * over)


def _torque_excess(problem: Problem, forces: Forces) -> float:
    """Return the largest excess of torques over their limits, relative to their scales."""
    lower, upper = tolerances.torque_limits(problem)
    over = (forces.torques - problem.upper) / upper, (problem.lower - forces.torques) / lower
    return tolerances.SHARE * _largest_excess(np.concatenate(over))


def _kinetic_error(problem: Problem, forces: Forces) -> float:
    """Return the largest distance of forces without a cone from kinetic friction, N."""
    without_cone = ~problem.has_cone
    along = forces.local[:, :1] * problem.kinetic_directions
    return float(np.abs(forces.f - along)[without_cone].max(initial=0.0))
