"""Gradients of a robust optimum by the figures of the set: what a larger set costs.

By the envelope theorem, as those by a problem's data: the joined problem of the corners has
multipliers, and a figure of the set moves the data of every corner.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.gradients import (
    Gradients,
    agreeing,
    gradients_at,
    optimum_gradients,
)
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.uncertain_members import Weight, gravities
from graspless_pin.algorithms.uncertainty import Uncertainty, each_of
from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.members import Corner, Member, feedback_torques, joined
from graspless_pin.records import Brief

_STEP = 1e-4
"""Of a figure; the corners' data are linear in each figure, or nearly so."""
_DATA = (
    "external_wrench", "friction", "jacobian", "gravity_torques", "upper_torque", "lower_torque"
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class UncertaintyGradients(Brief):
    """Derivatives of a robust optimum, margin (N) or largest torque (N m), by the set's figures.

    See the example of `uncertainty_gradients`.

    Attributes:
        values: By name of a field of `Uncertainty`, of its shape: per unit of each figure; NaN
            where a figure is zero, which its corners do not tell, and of sampled positions.
        unique: (same shapes) whether all optimal forces and multipliers agree on it. Where they do
            not, it is one of several one-sided derivatives.
    """

    values: Mapping[str, FloatArray]
    unique: Mapping[str, NDArray[np.bool_]]


def uncertainty_gradients(robust: RobustSolution) -> UncertaintyGradients:
    """Differentiate a robust optimum by how uncertain each thing is, in its modes.

    Args:
        robust: What `maximize_margin` or `minimize_torque` found for an uncertainty.

    Raises:
        NoSolutionError: If nothing was found.
        ArgumentError: See `optimum_gradients`; or if the members are not corners of a set, as those
            of balls are not.

    Examples:
        >>> from graspless_pin import Uncertainty, load_scene, minimize_torque
        >>> from graspless_pin import uncertainty_gradients
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> unknown = Uncertainty(mass=0.2, center_of_mass=0.01)  # m
        >>> robust = minimize_torque(
        ...     problem, 0.1, static_friction="coulomb", uncertainty=unknown
        ... )
        >>> by_mass = uncertainty_gradients(robust).values["mass"]
        >>> print(f"one percent more mass takes {0.01 * by_mass:.4f} N m more")
        one percent more mass takes 0.0084 N m more
    """
    uncertainty, weight = robust.uncertainty, robust.weight
    if uncertainty is None or weight is None:
        raise ArgumentError("robust", "does not tell of which set it is")
    if robust.policy is not None:
        raise ArgumentError(
            "robust",
            "has forces affine in balls, or in what has too many corners, and gradients are of "
            "corners; give boxes in place of balls (center_of_mass, force, moment), or solve for "
            "two sizes of the set",
        )
    found = optimum_gradients(robust.solution)
    forces = robust.solution.contact_forces
    members = robust.members[: len(robust.contact_forces)]
    directions = feedback_torques(members[0].problem, robust.feedback)
    points = [found.values, *(gradients_at(robust.solution, one) for one in found.alternatives)]
    at = [forces, *(one.forces for one in found.alternatives)]

    def slopes(name: str, place: int | None, figure: float) -> list[float]:
        if figure == 0.0 or name == "contact_position":
            return [np.nan] * len(points)
        ends = [
            joined(
                [_moved(one, uncertainty, weight, name, place, times) for one in members],
                directions,
            )
            for times in (1.0 - _STEP, 1.0 + _STEP)
        ]
        return [
            _slope(one, own, *ends) / (2.0 * _STEP * figure)
            for one, own in zip(points, at, strict=True)
        ]

    values: dict[str, FloatArray] = {}
    unique: dict[str, NDArray[np.bool_]] = {}
    for name, figure in vars(uncertainty).items():
        given = np.asarray(figure, dtype=float)
        flat = given.reshape(-1)
        places: Sequence[int | None] = range(len(flat)) if given.ndim else [None]
        each = np.array([slopes(name, k, size) for k, size in zip(places, flat, strict=True)])
        known = ~np.isnan(each[:, 0])
        same = np.zeros(len(flat), dtype=bool)
        same[known] = agreeing(each[known, 0], *each[known, 1:].T)
        values[name] = read_only(each[:, 0].reshape(given.shape).copy())
        unique[name] = read_only(same.reshape(given.shape))
    return UncertaintyGradients(MappingProxyType(values), MappingProxyType(unique))


def _slope(
    gradients: Gradients,
    forces: FloatArray,
    before: QuasistaticProblem,
    after: QuasistaticProblem,
) -> float:
    """Return what a change of a joined problem's data makes of its optimum."""
    total = sum(
        float(np.vdot(getattr(gradients, name), _change(before, after, name))) for name in _DATA
    )
    # Of a given wrench matrix the gradient is the outer product of that of the load and the forces.
    return total + float(
        gradients.external_wrench @ _change(before, after, "wrench_matrix") @ forces.ravel()
    )


def _change(before: QuasistaticProblem, after: QuasistaticProblem, name: str) -> FloatArray:
    old, new = getattr(before, name), getattr(after, name)
    return np.where(np.isfinite(old), new, 0.0) - np.where(np.isfinite(old), old, 0.0)


def _moved(
    member: Member,
    uncertainty: Uncertainty,
    weight: Weight,
    name: str,
    place: int | None,
    times: float,
) -> Member:
    """Return a member whose corner goes along with one figure of the set.

    Args:
        member: The member.
        uncertainty: The set.
        weight: Which part of its load is weight.
        name: Of the figure.
        place: Which of several; None: the one for all.
        times: What the figure is multiplied by.
    """
    corner, problem = member.corner, member.problem
    if corner is None:
        return member
    at = slice(None) if place is None else place

    def scaled(value: FloatArray) -> FloatArray:
        more = np.array(value, dtype=float)
        more[at] *= times
        return more

    match name:
        case "mass" | "mass_offset":
            own = uncertainty.mass if name == "mass" else uncertainty.mass_offset / weight.mass
            heavier = corner.mass + (times - 1.0) * np.copysign(own, corner.mass)
            return _loaded(member, weight, corner, replace(corner, mass=float(heavier)))
        case "center_of_mass" | "force" | "moment":
            moved = {name: scaled(getattr(corner, name))}
            return _loaded(member, weight, corner, replace(corner, **moved))
        case "tilt":
            known = gravities(weight, uncertainty.tilt)
            number = int(np.linalg.norm(known - corner.down, axis=1).argmin())
            down = gravities(weight, times * uncertainty.tilt)[number]
            return _loaded(member, weight, corner, replace(corner, down=down))
        case "friction":
            share = each_of("friction", uncertainty.friction, problem.contact_count, "contacts")
            # Static friction counts with its lower end, kinetic friction with both.
            off = np.where(problem.is_sliding, corner.kinetic, -share)
            friction = problem.friction / (1.0 + off) * (1.0 + scaled(off))
            return replace(member, problem=problem.with_changes(friction=friction))
        case "torque":
            return replace(member, factors=1.0 + scaled(member.factors - 1.0))
        case "torque_offset":
            return replace(member, offsets=scaled(member.offsets))
        case "effort":
            share = each_of("effort", uncertainty.effort, problem.joint_count, "joints")
            left = (1.0 - scaled(share)) / (1.0 - share)
            limits = (
                np.where(problem.lower_torque < 0.0, left, 1.0) * problem.lower_torque,
                np.where(problem.upper_torque > 0.0, left, 1.0) * problem.upper_torque,
            )
            return replace(member, problem=problem.with_changes(torque_limits=limits))
        case _:
            raise ArgumentError("uncertainty", f"has no corners of {name}")


def _loaded(member: Member, weight: Weight, before: Corner, corner: Corner) -> Member:
    """Return a member with the load of another corner than before."""
    problem = member.problem
    wrench = weight.wrench(corner.mass, corner.center_of_mass, corner.down)
    wrench = wrench - weight.wrench(before.mass, before.center_of_mass, before.down)
    wrench[:3] += corner.force - before.force
    wrench[3:] += corner.moment - before.moment
    carried = problem.gravity_torques
    if weight.links is not None:
        carried = carried + weight.links @ (corner.down - before.down)
    changed = problem.with_changes(
        external_wrench=problem.external_wrench + wrench, gravity_torques=carried
    )
    return replace(member, problem=changed, corner=corner)
