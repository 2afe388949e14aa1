"""How the largest margin changes with the data: a view of the gradients of its optimum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

from graspless_pin.algorithms.gradients import OptimumGradients, optimum_gradients
from graspless_pin.algorithms.options import SolveKeywords
from graspless_pin.algorithms.torque import maximize_margin
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Brief
from graspless_pin.solution import TorqueSolution


@dataclass(frozen=True, eq=False, repr=False)
class MarginSensitivity(Brief):
    """Derivatives of the largest margin in its optimal mode.

    Where the optimum is degenerate or the mode is about to change, they are one of several
    one-sided derivatives. See the example of `margin_sensitivity`.

    Attributes:
        gradients: By all that the problem is made of, with where they are not unique.
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
    """Differentiate the largest margin by its data.

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
