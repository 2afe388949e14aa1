"""The accelerations along a path that the contact forces of a carried object allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, motor_torques
from graspless_pin.solution.active_limits import contact_rooms
from graspless_pin.solvers.simplex import Simplex

MARGIN_SLACK = 1e-6
"""In loads: tolerance of margins and of the balance."""
_NEAR_SIDE = 1e-3
"""Relative to the ranges of u and x: corners nearer to a side are left out of the polygon."""
_SAME_CORNER = 1e-9
"""Relative to these ranges: nearer corners count as one."""
_MOST_HALVINGS = 8
"""Halvings of a side of a polygon."""
_MOST_ACCELERATION = 1e4
"""Largest |u| where nothing else limits it, rad/s^2."""


class ContactProgram:
    """The linear program in contact forces, (u, x) and the margin e, reused for all points.

    Forces with the margin e are in cones that are shifted inwards: f = C k + e a, k >= 0, with a
    along the normals.
    """

    def __init__(
        self, problem: QuasistaticProblem, limits: tuple[FloatArray, FloatArray], margin: float
    ) -> None:
        """Add the rows of the largest normal forces; the variables are k in N, u, x and e.

        Args:
            problem: A problem with the contacts and J of all points of the path.
            limits: (lower, upper) of the motors' torques, each (L,).
            margin: Required margin of contact forces, N.
        """
        self._problem, self._limits, self._margin = problem, limits, margin
        # All faces of a cone have one slope: the distance to each grows alike along the normal.
        slopes = -(problem.H.T @ problem.N).min(axis=0)
        depths = np.where(problem.has_cone, 1.0 / np.where(problem.has_cone, slopes, 1.0), 1.0)
        self._forces = np.column_stack(
            [problem.C, np.zeros((len(problem.C), 2)), problem.N @ depths]
        )
        size = self._forces.shape[1]
        self._low = np.concatenate([np.zeros(size - 3), np.full(3, -np.inf)])
        self._high = np.full(size, np.inf)
        self._simplex = Simplex(np.zeros(size), self._low, self._high)
        pressed = problem.N.T @ self._forces
        pressed[:, -1] += 1.0
        no_lower = np.full(len(pressed), -np.inf)
        self._simplex.add_rows(pressed, no_lower, problem.max_normal_force)
        self._rows = self._simplex.row_count

    def polygon(
        self, wrench: FloatArray, torques: FloatArray, most: float
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return rows A (k, 2) and sides b (k,): A (u, x) <= b is where contact forces exist.

        It is an inner approximation: the convex hull of extreme points, off by a thousandth of the
        ranges of u and x at most. None: there are no contact forces for any (u, x).

        Args:
            wrench: (6, 3) coefficients of (1, u, x) in the external and inertial wrench, in the
                problem's axes.
            torques: (L, 3) those in the motors' torques without contact forces, likewise.
            most: Largest x.
        """
        low, high = [-_MOST_ACCELERATION, 0.0], [_MOST_ACCELERATION, most]
        self._set_point(wrench, torques, low, high, self._margin)
        axes = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        ends = [corner for axis in axes if (corner := self._farthest_corner(axis)) is not None]
        if len(ends) < len(axes):
            return None
        box = np.ptp(ends, axis=0)
        corners = list[FloatArray]()
        for first, second in zip(ends, [*ends[1:], ends[0]], strict=True):
            corners += [first, *self._corners_between(first, second, np.where(box > 0.0, box, 1.0))]
        steps = np.roll(corners, -1, axis=0) - corners
        out = np.column_stack([steps[:, 1], -steps[:, 0]])
        rows = np.vstack(
            [axes, out[np.linalg.norm(steps / np.maximum(box, 1e-300), axis=1) > _SAME_CORNER]]
        )
        return rows, (rows @ np.array(corners).T).max(axis=1)

    def margin(
        self, wrench: FloatArray, torques: FloatArray, u: float, x: float
    ) -> tuple[float, tuple[int, ...]]:
        """Return the largest margin at (u, x), N, and the contacts whose slack is that margin.

        The first two arguments are those of `polygon`.
        """
        problem = self._problem
        self._set_point(wrench, torques, [u, x], [u, x], -np.inf)
        cost = np.zeros(len(self._low))
        cost[-1] = -1.0
        self._simplex.set_cost(cost)
        answer = self._simplex.solve()
        if not answer.is_optimal:
            return -np.inf, ()
        forces, load = self._forces @ answer.x, wrench @ [1.0, u, x]
        scale = problem.scales.force
        units = np.concatenate([np.ones(3), np.full(3, problem.scales.length)])
        unbalanced = np.abs(problem.W @ forces + load) / units
        if unbalanced.max() > MARGIN_SLACK * max(scale, float(np.abs(load / units).max())):
            return -np.inf, ()
        slacks = contact_rooms(problem, forces.reshape(-1, 3)).min(axis=1)
        margin = float(slacks.min())
        return margin, tuple(np.flatnonzero(slacks <= margin + MARGIN_SLACK * scale).tolist())

    def _corners_between(
        self, first: FloatArray, second: FloatArray, box: FloatArray, depth: int = _MOST_HALVINGS
    ) -> list[FloatArray]:
        """Return the corners between two neighbouring ones, counterclockwise."""
        side = (second - first) / box
        length = float(np.linalg.norm(side))
        if length <= _NEAR_SIDE or not depth:
            return []
        out = np.array([side[1], -side[0]]) / length
        corner = self._farthest_corner(out / box)
        if corner is None or out @ ((corner - first) / box) <= _NEAR_SIDE:
            return []
        return [
            *self._corners_between(first, corner, box, depth - 1),
            corner,
            *self._corners_between(corner, second, box, depth - 1),
        ]

    def _farthest_corner(self, d: FloatArray) -> FloatArray | None:
        """Return the feasible (u, x) that is farthest along a direction; None: there is none."""
        cost = np.zeros(len(self._low))
        cost[-3:-1] = -d / np.linalg.norm(d)
        self._simplex.set_cost(cost)
        answer = self._simplex.solve()
        return answer.x[-3:-1] if answer.is_optimal else None

    def _set_point(
        self,
        wrench: FloatArray,
        torques: FloatArray,
        least: Sequence[float],
        most: Sequence[float],
        margin: float,
    ) -> None:
        """Replace the balance and the bounds by those of a point of the path.

        Args:
            wrench: See `polygon`.
            torques: See there.
            least: Lower bounds of (u, x).
            most: Upper bounds of (u, x).
            margin: Smallest margin of the forces, N.
        """
        problem = self._problem
        self._simplex.drop_rows(self._rows, self._simplex.row_count)
        lower, upper = self._limits
        rows = np.vstack([problem.W, problem.J.T]) @ self._forces
        rows[:, -3:-1] = np.vstack([wrench[:, 1:], torques[:, 1:]])
        low = np.concatenate([-wrench[:, 0], lower - torques[:, 0]])
        high = np.concatenate([-wrench[:, 0], upper - torques[:, 0]])
        self._simplex.add_rows(rows, low, high)
        lb, ub = self._low.copy(), self._high.copy()
        lb[-3:], ub[-3:-1] = [*least, margin], most
        self._simplex.set_bounds(lb, ub)


def motor_limits(
    problem: QuasistaticProblem, torques: ArrayLike | Mapping[str, float] | None
) -> tuple[FloatArray, FloatArray]:
    """Return (lower, upper), each (L,), of the motors' torques; both are the given ones if any.

    Raises:
        ArgumentError: Naming the motors.
    """
    if torques is None:
        return problem.lower_torque, problem.upper_torque
    names = problem.joint_names
    constant = motor_torques(names, torques)
    for name, torque, low, high in zip(
        names, constant, problem.lower_torque, problem.upper_torque, strict=True
    ):
        if not low <= torque <= high:
            raise ArgumentError(
                f"torques[{name!r}]", f"is {torque:g}, outside its limits [{low:g}, {high:g}]"
            )
    return constant, constant
