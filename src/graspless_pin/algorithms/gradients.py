"""Gradients of the optimum of Algorithm 1 or 2 by all data of the problem.

The derivative of an optimum is that of its Lagrangian at fixed forces, multipliers and mode (the
envelope theorem). With the multipliers y of the balance and kappa of the joints' torques, a change
df of one contact's force costs c^T df, c = W^T y + J kappa. So turning or moving a contact counts
by the change of its force. Likewise for the figures of an uncertain set: each changes the data of
the corners, and the joined problem of the corners has multipliers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.dual_degeneracy import (
    DERIVATIVE_ROUNDING,
    OptimalPoint,
    OptimalSet,
    agreeing_entries,
)
from graspless_pin.algorithms.optimization import maximize_margin
from graspless_pin.algorithms.options import SolveKeywords
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.uncertain_members import scaled_member
from graspless_pin.bounds import SMALLEST
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only, real_number
from graspless_pin.problem.members import feedback_torques, join_members
from graspless_pin.programs.builder import Marginals
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.records import Brief
from graspless_pin.solution import Status, TorqueSolution, checked_solution
from graspless_pin.solution.tables import Table


@dataclass(frozen=True, eq=False, repr=False)
class Gradients(Brief):
    """Derivatives of one optimum: of the largest margin e (N) or of the smallest torque t (N m).

    See the example of `optimum_gradients`.

    Attributes:
        positions: (M, 3) per m of each contact point; its frame and the joints' lever arms stay.
            Zero beside a given wrench matrix, whose own gradient is the outer product of
            `external_wrench` and the contact forces.
        normals: (M, 3) per rad, tangential: the contact's frame, its sliding and the force in it
            turn with the normal the shortest way; position and Jacobian stay.
        spins: (M,) per rad about each normal: tangents and sliding direction turn, n stays.
        friction: (M,) per unit of each coefficient.
        external_wrench: (P,) per N of force and N m of moment.
        jacobian: (3M, L) per unit of each entry.
        gravity_torques: (L,) per N m of the motors' torques besides those of contacts.
        upper_torque: (L,) per N m of each upper limit.
        lower_torque: (L,) per N m of each lower limit.
        max_normal_force: (M,) per N of each normal-force limit.
        required_margin: (1,) per N of the margin that Algorithm 2 keeps; 0 in Algorithm 1.
    """

    positions: FloatArray
    normals: FloatArray
    spins: FloatArray
    friction: FloatArray
    external_wrench: FloatArray
    jacobian: FloatArray
    gravity_torques: FloatArray
    upper_torque: FloatArray
    lower_torque: FloatArray
    max_normal_force: FloatArray
    required_margin: FloatArray

    def __str__(self) -> str:
        """Return the largest derivative by each quantity, and of which entry it is."""
        return str(Table(self.rows, _COLUMNS))

    @property
    def rows(self) -> list[list[object]]:
        """Rows of the table: the largest derivative by each quantity, its unit and its entry."""
        rows: list[list[object]] = []
        for name, unit in _UNITS.items():
            values = getattr(self, name)
            if values.size:
                place = np.unravel_index(np.abs(values).argmax(), values.shape)
                index = ", ".join(map(str, map(int, place)))
                is_zero = abs(values[place]) <= DERIVATIVE_ROUNDING
                shown = "0" if is_zero else f"{values[place]:+.4g}"
                rows.append([name, shown, unit, "" if is_zero else f"[{index}]"])
        return rows


_UNITS = {
    "positions": "m", "normals": "rad", "spins": "rad", "friction": "1",
    "external_wrench": "N (N m)", "jacobian": "1 (m)", "gravity_torques": "N m (N)",
    "upper_torque": "N m (N)", "lower_torque": "N m (N)", "max_normal_force": "N",
    "required_margin": "N",
}  # fmt: skip
_COLUMNS = ["by", "largest derivative", "per", "entry"]


@dataclass(frozen=True, eq=False, repr=False)
class OptimumGradients(Brief):
    """Gradients of an optimum, and where they are only one of several one-sided derivatives.

    See the example of `optimum_gradients`.

    Attributes:
        values: The derivatives.
        unique: By name of a field of `Gradients`, (same shape) whether all optimal forces and
            multipliers agree on an entry. Where they do not, the optimum has or may have a kink:
            forces or multipliers are not unique, or a sign of the mode is about to change.
        solution: The solution that the derivatives belong to.
        point: The optimal forces and multipliers of the derivatives.
        alternatives: Two more points of the affine hulls of all optimal forces and multipliers:
            entries that differ there are not unique.
    """

    values: Gradients
    unique: Mapping[str, NDArray[np.bool_]]
    solution: TorqueSolution
    point: OptimalPoint
    alternatives: tuple[OptimalPoint, ...]

    def __str__(self) -> str:
        """Return the largest derivative by each quantity, and whether all entries are unique."""
        optimum = (
            "largest margin, N"
            if self.solution.algorithm is Algorithm.MARGIN
            else "smallest torque, in the unit of its objective"
        )
        rows = [
            [*row, "yes" if self.unique[str(row[0])].all() else "not all"]
            for row in self.values.rows
        ]
        return f"derivatives of the {optimum}\n\n{Table(rows, [*_COLUMNS, 'unique'])}"

    @property
    def degenerate(self) -> bool:
        """Whether any entry is not unique."""
        return not all(mask.all() for mask in self.unique.values())

    @property
    def load(self) -> float:
        """Derivative by a common factor on the external wrench."""
        return float(self.values.external_wrench @ self.solution.problem.external_wrench)

    def per_mass(self, mass: float) -> float:
        """Return the derivative per kilogram where the external wrench is the weight of a mass.

        Raises:
            ArgumentError: If the mass is not above zero.
        """
        return self.load / real_number("mass", mass, SMALLEST)


def optimum_gradients(solution: TorqueSolution) -> OptimumGradients:
    """Differentiate the optimum of a solution by its problem's data, in its mode.

    Args:
        solution: A solution of `maximize_margin` or `minimize_torque` without regularisation.

    Returns:
        The gradients; where forces or multipliers are not unique, those of the solution's own,
        marked so. Interior-point methods, the default, give a point in the middle of all optima.

    Raises:
        NoSolutionError: If nothing was found.
        ArgumentError: If it is no solution, or one with a regularisation, under ``direction`` or
            with status STRONG.

    Examples:
        >>> from graspless_pin import load_scene, maximize_margin, optimum_gradients
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> gradients = optimum_gradients(maximize_margin(problem))
        >>> gradients.values.external_wrench.shape
        (6,)
    """
    checked_solution(solution)
    if not solution.found:
        raise NoSolutionError(f"There is no optimum to differentiate ({solution.status.message}).")
    solution.rules.need_signs("a gradient")
    if solution.algorithm is None:
        raise ArgumentError(
            "solution",
            f"has the objective '{solution.objective.name}'; gradients are only available for "
            "Algorithms 1 and 2",
        )
    if solution.status is Status.STRONG:
        raise ArgumentError(
            "solution",
            "has guaranteed torques, which are worse than the optimum of the best case; gradients "
            "are only available for that optimum: solve with stability='weak'",
        )
    if solution.regularization > 0.0:
        raise ArgumentError(
            "solution", "has a regularisation; gradients require the optimum without one"
        )
    optimum = OptimalSet(solution)
    point, alternatives = optimum.point(), optimum.alternatives()
    values = gradients_at(solution, point)
    others = [gradients_at(solution, other) for other in alternatives]
    unique = {
        item.name: agreeing_entries(
            getattr(values, item.name), *(getattr(other, item.name) for other in others)
        )
        for item in fields(Gradients)
    }
    # One of two equal limits moves away from the other only.
    pinned = solution.problem.lower_torque == solution.problem.upper_torque
    for limit in ("upper_torque", "lower_torque"):
        unique[limit] = read_only(unique[limit] & ~pinned)
    return OptimumGradients(values, MappingProxyType(unique), solution, point, alternatives)


def force_costs(problem: QuasistaticProblem, at: OptimalPoint) -> FloatArray:
    """Return (M, 3) c = W^T y + J kappa: the cost of a unit change of each contact's force."""
    return (problem.W.T @ at.multipliers["balance"] + problem.jacobian @ at.torque).reshape(-1, 3)


def gradients_at(solution: TorqueSolution, at: OptimalPoint) -> Gradients:
    """Return the derivatives at given optimal forces and multipliers."""
    problem, f = solution.problem, at.forces
    sign = solution.objective.sign  # the multipliers are those of a minimisation
    cost = force_costs(problem, at)
    found, normal_upper = at.multipliers, at.of_contacts("normal_upper")
    upper, lower = -found["torque_upper"], found["torque_lower"]
    if solution.objective.by_limits:
        upper = upper - found["share_upper"] * at.value
        lower = lower + found["share_lower"] * at.value
    by_position, margin = np.zeros_like(f), 0.0
    if problem.wrench_matrix is None:
        by_position = np.cross(f, found["balance"][3:])
    if solution.algorithm is Algorithm.TORQUE:
        without_cone = at.of_contacts("normal_lower")[~problem.has_cone]
        margin = float(_cone_costs(problem, found).sum() + normal_upper.sum() + without_cone.sum())
    values = {
        "positions": by_position,
        "normals": np.cross(np.cross(f, cost), problem.normals),
        "spins": np.einsum("mi,mi->m", cost, np.cross(problem.normals, f)),
        "friction": _friction_slopes(problem, at, cost),
        "external_wrench": found["balance"],
        "jacobian": np.outer(f.ravel(), at.torque),
        "gravity_torques": at.torque,
        "upper_torque": upper,
        "lower_torque": lower,
        "max_normal_force": -normal_upper,
        "required_margin": np.array([margin]),
    }
    return Gradients(**{name: read_only(sign * value) for name, value in values.items()})


def _cone_costs(problem: QuasistaticProblem, found: Marginals) -> FloatArray:
    """Return the costs of a unit of margin at the faces or round cones."""
    if not problem.cone_model.second_order:
        return found["faces"]
    return found["round_cones"][:, 0] * np.sqrt(1.0 + problem.friction**2)


def _friction_slopes(problem: QuasistaticProblem, at: OptimalPoint, cost: FloatArray) -> FloatArray:
    """(M,) derivatives by friction: of cones' surfaces, and of kinetic friction against sliding."""
    local = np.einsum("mij,mi->mj", problem.frames, at.forces)
    wider = _round_cone_slopes if problem.cone_model.second_order else _face_slopes
    by_cone = wider(problem, at.multipliers, local)
    slide, normals, ones = problem.is_sliding, problem.normals, np.ones(problem.contact_count)
    kinetic = problem.cone_model.kinetic_directions(
        normals, problem.tangents, ones, problem.sliding, slide
    )
    by_sliding = local[:, 0] * np.einsum("mi,mi->m", cost, kinetic - normals)
    return np.where(slide, by_sliding, np.where(problem.has_cone, by_cone, 0.0))


def _round_cone_slopes(
    problem: QuasistaticProblem, found: Marginals, local: FloatArray
) -> FloatArray:
    """(M,) derivatives by mu in |f_t| <= mu f_n - sqrt(1 + mu^2) e; e is the active distance."""
    mu = problem.friction
    distance = problem.cone_model.surface_distances(local, mu, problem.cone_edges)
    distance_slope = local[:, 0] - mu / np.sqrt(1.0 + mu**2) * distance
    return -found["round_cones"][:, 0] * distance_slope


def _face_slopes(problem: QuasistaticProblem, found: Marginals, local: FloatArray) -> FloatArray:
    """(M,) derivatives by mu in h^T f + e <= 0: h = (-s, d) / sqrt(1 + s^2), s = mu * distance."""
    section = problem.cone_section
    around = local[:, 1:] @ section.directions
    slope = problem.friction[:, None] * section.distances
    length = np.sqrt(1.0 + slope**2)
    row_slope = -local[:, :1] - slope / length**2 * (around - slope * local[:, :1])
    return np.einsum("mk,mk->m", section.distances / length * found["faces"], row_slope)


@dataclass(frozen=True, eq=False, repr=False)
class MarginSensitivity(Brief):
    """Derivatives of the largest margin in its optimal mode, taken from its `OptimumGradients`.

    Where the optimum is degenerate or the mode is about to change, they are one of several
    one-sided derivatives. See the example of `margin_sensitivity`.

    Attributes:
        gradients: Derivatives by all data of the problem, and where they are not unique.
    """

    gradients: OptimumGradients

    @property
    def solution(self) -> TorqueSolution:
        """The solution that the derivatives belong to."""
        return self.gradients.solution

    @property
    def friction(self) -> FloatArray:
        """(M,) N per unit of each friction coefficient."""
        return self.gradients.values.friction

    @property
    def external_wrench(self) -> FloatArray:
        """(P,) N per N of force and per N m of moment."""
        return self.gradients.values.external_wrench

    @property
    def load(self) -> float:
        """N per unit of a common factor on the external wrench."""
        return self.gradients.load

    @property
    def upper_torque(self) -> FloatArray:
        """(L,) N per N m of each upper limit."""
        return self.gradients.values.upper_torque

    @property
    def lower_torque(self) -> FloatArray:
        """(L,) N per N m of each lower limit."""
        return self.gradients.values.lower_torque

    @property
    def max_normal_force(self) -> FloatArray:
        """(M,) N per N of each normal-force limit."""
        return self.gradients.values.max_normal_force

    def per_mass(self, mass: float) -> float:
        """Return N per kilogram where the external wrench is the weight of this mass (kg)."""
        return self.gradients.per_mass(mass)


def margin_sensitivity(
    problem: QuasistaticProblem, **options: Unpack[SolveKeywords]
) -> MarginSensitivity:
    """Differentiate the largest margin by its data: `optimum_gradients` of `maximize_margin`.

    Args:
        problem: Contacts, wrench, joints and limits.
        options: See `SolveOptions.parse`; with a limit the derivatives are those of the best found.

    Raises:
        NoSolutionError: If no margin is feasible.

    Examples:
        >>> from graspless_pin import load_scene, margin_sensitivity
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> margin_sensitivity(problem).friction.round(2)  # N a unit of each coefficient
        array([2.24, 2.24, 0.41, 1.87, 1.87, 0.41])
    """
    return MarginSensitivity(optimum_gradients(maximize_margin(problem, **options)))


_STEP = 1e-4
"""Relative step of a figure; the corners' data are linear in each figure, or nearly so."""
_DATA = (
    "external_wrench", "friction", "jacobian", "gravity_torques", "upper_torque", "lower_torque"
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class UncertaintyGradients(Brief):
    """Derivatives of a robust optimum, margin (N) or largest torque (N m), by the set's figures.

    See the example of `uncertainty_gradients`.

    Attributes:
        values: By name of a field of `Uncertainty`, of its shape: per unit of each figure; NaN
            where a figure is zero, as corners do not show it, and for sampled positions.
        unique: (same shapes) whether all optimal forces and multipliers agree on it. Where they do
            not, it is one of several one-sided derivatives.
    """

    values: Mapping[str, FloatArray]
    unique: Mapping[str, NDArray[np.bool_]]


def uncertainty_gradients(robust: RobustSolution) -> UncertaintyGradients:
    """Differentiate a robust optimum by the figures of its uncertain set, in its modes.

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
        raise ArgumentError(
            "robust", "does not state its uncertainty; solve with uncertainty=... again"
        )
    if robust.policy is not None:
        raise ArgumentError(
            "robust",
            "has contact forces that are affine in balls, or in a set with too many corners, but "
            "gradients require corners; give boxes instead of balls (center_of_mass, force, "
            "moment), or compare solutions for two sizes of the set",
        )
    found = optimum_gradients(robust.solution)
    forces = robust.solution.contact_forces
    members = robust.members[: len(robust.contact_forces)]
    directions = feedback_torques(members[0].problem, robust.feedback)
    points = [found.values, *(gradients_at(robust.solution, one) for one in found.alternatives)]
    point_forces = [forces, *(one.forces for one in found.alternatives)]

    def figure_slopes(name: str, place: int | None, figure: float) -> list[float]:
        if figure == 0.0 or name == "contact_position":
            return [np.nan] * len(points)

        def joined_with(times: float) -> QuasistaticProblem:
            def scaled(figure_name: str, value: ArrayLike) -> FloatArray:
                figures = np.array(value, dtype=float)
                if figure_name == name:
                    figures[... if place is None else place] *= times
                return figures

            return join_members(
                [scaled_member(one, weight, uncertainty, scaled) for one in members], directions
            )

        ends = joined_with(1.0 - _STEP), joined_with(1.0 + _STEP)
        return [
            _optimum_change(one, own, *ends) / (2.0 * _STEP * figure)
            for one, own in zip(points, point_forces, strict=True)
        ]

    values: dict[str, FloatArray] = {}
    unique: dict[str, NDArray[np.bool_]] = {}
    for name, figure in vars(uncertainty).items():
        given = np.asarray(figure, dtype=float)
        flat = given.reshape(-1)
        places: Sequence[int | None] = range(len(flat)) if given.ndim else [None]
        each = np.array(
            [figure_slopes(name, k, size) for k, size in zip(places, flat, strict=True)]
        )
        known = ~np.isnan(each[:, 0])
        same = np.zeros(len(flat), dtype=bool)
        same[known] = agreeing_entries(each[known, 0], *each[known, 1:].T)
        values[name] = read_only(each[:, 0].reshape(given.shape).copy())
        unique[name] = read_only(same.reshape(given.shape))
    return UncertaintyGradients(MappingProxyType(values), MappingProxyType(unique))


def _optimum_change(
    gradients: Gradients,
    forces: FloatArray,
    before: QuasistaticProblem,
    after: QuasistaticProblem,
) -> float:
    """Return the first-order change of the optimum between two data of a joined problem."""
    total = sum(
        float(np.vdot(getattr(gradients, name), _change(before, after, name))) for name in _DATA
    )
    # The gradient by a wrench matrix is the outer product of that by the load and the forces.
    return total + float(
        gradients.external_wrench @ _change(before, after, "wrench_matrix") @ forces.ravel()
    )


def _change(before: QuasistaticProblem, after: QuasistaticProblem, name: str) -> FloatArray:
    old, new = getattr(before, name), getattr(after, name)
    return np.where(np.isfinite(old), new, 0.0) - np.where(np.isfinite(old), old, 0.0)
