"""Gradients of a robust optimum by the figures of the set: what a larger set costs.

By the envelope theorem, as those by a problem's data: the joined problem of the corners has
multipliers, and a figure of the set moves the data of every corner.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.gradients import (
    Gradients,
    agreeing,
    gradients_at,
    optimum_gradients,
)
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.uncertain_members import scaled_member
from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.members import feedback_torques, joined
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

        def at_end(times: float) -> QuasistaticProblem:
            def scaled(of: str, value: ArrayLike) -> FloatArray:
                figures = np.array(value, dtype=float)
                if of == name:
                    figures[... if place is None else place] *= times
                return figures

            return joined(
                [scaled_member(one, weight, uncertainty, scaled) for one in members], directions
            )

        ends = at_end(1.0 - _STEP), at_end(1.0 + _STEP)
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
