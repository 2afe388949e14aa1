"""How much torque each margin costs: the whole trade-off between Algorithms 1 and 2.

t*(e0), the optimum of Algorithm 2, is for e0 from zero to Algorithm 1's margin the smallest of the
curves of single modes. A mode's curve is the boundary of a polyhedron's shadow: convex, piecewise
linear, rising, and it ends where the mode can keep no larger margin. Their lower envelope is
piecewise linear too, but it is neither convex nor continuous: modes take turns at kinks, and where
a mode ends it may jump up. `curve_search` finds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.curve_search import CurveSearch
from graspless_pin.algorithms.formulation import formulated
from graspless_pin.algorithms.limits import Limits
from graspless_pin.algorithms.options import SolveKeywords, SolveOptions
from graspless_pin.algorithms.torque import TorqueScale, torque_objective
from graspless_pin.brief import Brief
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, choice, finite_array, read_only
from graspless_pin.problem.joint_units import units_text
from graspless_pin.programs.analysis_objectives import Tradeoff
from graspless_pin.solution import Status


@dataclass(frozen=True, eq=False, repr=False)
class MarginTorqueCurve(Brief):
    """The smallest largest torque for each required margin, piece by piece.

    Piece k runs straight from (margins[k, 0], torques[k, 0]) to (margins[k, 1], torques[k, 1]);
    each begins where the one before it ends, at the same torque or, after a jump, at a larger one.
    ``margins.ravel()`` against ``torques.ravel()`` draws the curve with its jumps.

    See the example of `margin_torque_curve`.

    Attributes:
        status: OPTIMAL where every piece is proven over all modes; LIMIT_REACHED where a limit
            ended a search, and a mode may lie below; or why nothing is feasible.
        margins: (K, 2) begin and end of each piece, N.
        torques: (K, 2) largest |torque| there, in `torque_unit`.
        modes: K modes whose optimum each piece is; None with Coulomb friction.
        problem: The problem.
        scale: What the torques are measured by.
    """

    status: Status
    margins: FloatArray
    torques: FloatArray
    modes: tuple[SlidingMode | None, ...]
    problem: QuasistaticProblem
    scale: TorqueScale

    @property
    def found(self) -> bool:
        """Whether any margin is feasible."""
        return len(self.modes) > 0

    @property
    def torque_unit(self) -> str:
        """Unit of the torques in words: which joint is the largest may change along the curve."""
        if self.scale is TorqueScale.LIMITS:
            return "share of the limit"
        return units_text(self.problem.joint_units)

    @property
    def slopes(self) -> FloatArray:
        """(K,) torque, in `torque_unit`, per N of margin along each piece."""
        width = np.diff(self.margins)[:, 0]
        rise = np.diff(self.torques)[:, 0]
        return np.divide(rise, width, out=np.zeros_like(rise), where=width > 0.0)

    @property
    def largest_margin(self) -> float:
        """Algorithm 1's margin, N: the curve's end."""
        self._check_found()
        return float(self.margins[-1, 1])

    def torque_at(self, margin: ArrayLike) -> FloatArray:
        """Return t*(e0), interpolated; at a jump the smaller value, NaN beyond the largest margin.

        Args:
            margin: Required margins e0 >= 0, N, of any shape.

        Raises:
            NoSolutionError: If no margin is feasible.
            ArgumentError: If a margin is negative or no number.
        """
        self._check_found()
        wanted = finite_array("margin", np.ravel(margin), (None,))
        if (wanted < 0.0).any():
            raise ArgumentError("margin", f"is {wanted.min()}; a required margin is at least 0")
        piece = np.searchsorted(self.margins[:, 1], wanted, side="left")
        inside = np.minimum(piece, len(self.modes) - 1)
        torque = self.torques[inside, 0] + self.slopes[inside] * (wanted - self.margins[inside, 0])
        return np.where(piece < len(self.modes), torque, np.nan).reshape(np.shape(margin))

    def __str__(self) -> str:
        """Return one line."""
        if not self.found:
            return f"not found: {self.status.message}"
        return (
            f"margin 0 to {self.margins[-1, 1]:.4g} N for {self.torques[0, 0]:.4g} to "
            f"{self.torques[-1, 1]:.4g} of torque [{self.torque_unit}], "
            f"{len(self.modes)} pieces: {self.status.message}"
        )

    def _check_found(self) -> None:
        if not self.found:
            raise NoSolutionError(f"There is no curve to read ({self.status.message}).")


def margin_torque_curve(
    problem: QuasistaticProblem,
    *,
    scale: str = "absolute",
    **options: Unpack[SolveKeywords],
) -> MarginTorqueCurve:
    """Find Algorithm 2's optimum for every required margin, up to Algorithm 1's.

    All breakpoints are found, to the tolerance of the solver. Proven is that no mode lies below
    the curve by more than 5e-7 of the torque that the load makes on the longest lever (on pieces
    that rise slower than that torque per load; on steeper ones, by a shift of 5e-7 of the load).
    Behind a jump, other modes are looked for from 1e-6 of the load on.

    Args:
        problem: Contacts, wrench, joints and limits.
        scale: See `minimize_torque`.
        options: See `SolveOptions.parse`.

    Raises:
        ArgumentError: If an option is not known, for ``direction`` or ``strong``.
        SolverUnavailableError: If the solver is not installed.

    Examples:
        >>> from graspless_pin import load_scene, margin_torque_curve
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> curve = margin_torque_curve(problem)
        >>> print(f"{float(curve.torque_at(0.1)):.4f} N m for 0.1 N")
        0.9618 N m for 0.1 N
    """
    checked_problem(problem)
    how = SolveOptions.parse(**options)
    how.rules.need_signs("margin_torque_curve")
    what = "margin_torque_curve is of the best case"
    how.need_weak(what, "leave it out, or ask `minimize_torque` for each margin")
    torque_scale = choice(TorqueScale, "scale", scale)
    formulation = formulated(problem, Tradeoff(torque_objective(0.0, torque_scale)))
    search = CurveSearch(formulation, how, Limits.of(how))
    status, pieces = search.run()
    units = formulation.coordinates.force_scale, formulation.unit
    return MarginTorqueCurve(
        status,
        read_only(units[0] * np.array([[p.a, p.b] for p in pieces]).reshape(-1, 2)),
        read_only(units[1] * np.array([[p.t_a, p.t_b] for p in pieces]).reshape(-1, 2)),
        tuple(p.mode for p in pieces),
        problem,
        torque_scale,
    )
