"""Tolerances of given torques to deviations of each quantity: records, and their table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from tabulate import tabulate

from graspless_pin.algorithms.attainable_tolerances import AttainableTolerance
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.errors import NoSolutionError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, JointUnit, finite_array, one_of, units_text
from graspless_pin.records import Brief

_FAR = 0.02  # rad or m
_ROUGH = (
    f"where joints deflect by more than {_FAR:g} rad (m), contacts move, which is not considered: "
    "less may be tolerated"
)
_WHERE = "at contact, joint"
_LEAST_DEFLECTION = 1e-6  # rad or m


@dataclass(frozen=True, eq=False, repr=False)
class Tolerance(Brief):
    """How far one quantity may be off, all others at their nominal values.

    See the example of `tolerances`.

    Attributes:
        quantity: The quantity.
        balanced: Deviation up to which contact forces balance: a share of mass, friction or
            torques, m, rad, N or N m. Proven under plain Coulomb friction; under other rules only
            tested. Inf where feedback compensates any.
        failing: The smallest deviation that was found to fail; inf: none was.
        direction: (3,) unit vector of the deviation that fails, world axes; of torques (L,);
            None where there is only one.
        contacts: The contacts that limit the margin there.
        joints: The joints whose torque, with feedback, is at its limit there.
        deflection: Largest deflection of a joint there that produces the feedback, rad (m); 0
            without feedback, inf if any deviation is balanced, NaN where it was not computed. Where
            it is not small, contacts have moved by then.
        boundary: (K, 3) largest balanced deviations, one in each direction that was looked at, in
            the unit of `balanced`; all of their convex hull is balanced.
    """

    quantity: Quantity
    balanced: float
    failing: float
    direction: FloatArray | None = None
    contacts: tuple[int, ...] = ()
    deflection: float = 0.0
    boundary: FloatArray | None = None
    joints: tuple[int, ...] = ()

    def along(self, directions: ArrayLike) -> FloatArray:
        """Return (K,) the extent of the hull of `boundary` along each unit vector (K, 3).

        Zero where the hull has no extent, as across the plane of a flat one.

        Args:
            directions: World axes.

        Raises:
            NoSolutionError: If the quantity has no boundary.
        """
        from scipy.optimize import linprog

        if self.boundary is None:
            raise NoSolutionError(f"The {self.quantity} has no boundary.")
        corners, rays = self.boundary, finite_array("directions", directions, (None, 3))
        size = float(np.abs(corners).max())
        if size == 0.0:
            return np.zeros(len(rays))
        # The largest r with r times the direction a mean of the corners and zero.
        most = np.append(np.zeros(len(corners)), -1.0)
        mean = np.append(np.ones(len(corners)), 0.0)[None]
        found = [
            linprog(most, mean, [1.0], np.column_stack([corners.T / size, -ray]), np.zeros(3))
            for ray in rays
        ]
        return size * np.array([max(answer.x[-1], 0.0) for answer in found])


@dataclass(frozen=True, eq=False, repr=False)
class Tolerances(Brief):
    """Tolerances of given torques to deviations of all quantities, one at a time.

    See the example of `tolerances`.

    Attributes:
        problem: The problem.
        torques: (L,) N m (N).
        each: One tolerance for each quantity that the problem states.
        weight: (3,) the part of the load that counts as weight, N, world axes.
        feedback: (L,) joint stiffness that adds to the torques, N m/rad (N/m); None: torques are
            constant.
        coulomb: Whether contact forces are those of Coulomb friction, without virtual sliding.
        attainable: How far the same quantities may be off if torques are chosen for each; empty:
            not requested.
    """

    problem: QuasistaticProblem
    torques: FloatArray
    each: tuple[Tolerance, ...]
    weight: FloatArray
    feedback: FloatArray | None
    coulomb: bool
    attainable: tuple[AttainableTolerance, ...] = ()

    def of(self, quantity: Quantity | str) -> Tolerance:
        """Return the tolerance of a quantity.

        Raises:
            ArgumentError: If there is none of that quantity.
        """
        known = {str(one.quantity): one for one in self.each}
        return known[one_of(known, "quantity", str(quantity))]

    def __str__(self) -> str:
        """Return a table: the balanced deviation, the direction that fails first, and where.

        Attainable tolerances replace the columns of direction and contacts.
        """
        headers, rows = self.table()
        omitted = ("direction", _WHERE) if self.attainable else ()
        kept = [place for place, name in enumerate(headers) if name not in omitted]
        kept_rows = [[row[place] for place in kept] for row in rows]
        table = tabulate(kept_rows, headers=[headers[place] for place in kept])
        forces = f"contact forces are the best that {self.law} allows"
        forces += "; robustness considers all" if self.problem.cone_model.is_coulomb else ""
        return f"{table}\n{forces}\n{self.remark}".rstrip()

    @property
    def law(self) -> str:
        """What restricts friction, in words."""
        if not self.coulomb:
            return "friction that opposes virtual sliding"
        model = self.problem.cone_model
        return "Coulomb friction" if model.is_coulomb else f"the cone '{model.name}'"

    @property
    def remark(self) -> str:
        """Remark where some joint deflects so far that contacts move; else empty."""
        return _ROUGH if any(one.deflection > _FAR for one in self.each) else ""

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return headers and rows of that table, with figures in %, cm, degrees, N and N m."""
        rows: list[tuple[str, ...]] = []
        kinds = dict.fromkeys(self.problem.joint_units)
        unit = " or ".join("m" if one is JointUnit.FORCE else "rad" for one in kinds)
        for one in self.each:
            names = [self.problem.joint_names[joint] for joint in one.joints]
            where = ", ".join([*map(str, one.contacts), *names])
            deflected = f"{one.deflection:.2g} {unit}" if one.deflection > _LEAST_DEFLECTION else ""
            figures = self._figure_texts(one)
            rows.append((one.quantity, *figures, self._direction_text(one), where, deflected))
        headers = ("quantity", "balanced", "fails at", "direction", _WHERE, "deflection")
        given = len(headers) - (not any(row[-1] for row in rows))
        headers, rows = headers[:given], [row[:given] for row in rows]
        if not self.attainable:
            return headers, rows
        chosen = [(*self._figure_texts(one), one.why) for one in self.attainable]
        rows = [(*row, *more) for row, more in zip(rows, chosen, strict=True)]
        return (*headers, "attainable", "none from", "why"), rows

    def _direction_text(self, one: Tolerance) -> str:
        if one.direction is None:
            return ""
        if one.quantity is Quantity.JOINT:
            joint = int(np.abs(one.direction).argmax())
            more = "larger" if one.direction[joint] > 0.0 else "smaller"
            return f"{self.problem.joint_names[joint]} {more}"
        return f"[{', '.join(f'{x:+.2f}' for x in one.direction.tolist())}]"

    def _figure_texts(self, one: Tolerance | AttainableTolerance) -> tuple[str, str]:
        """Return the balanced and the failing deviation, in the usual unit of the quantity."""
        scale, unit = one.quantity.scale, one.quantity.unit
        if one.quantity is Quantity.JOINT:
            units = self.problem.joint_units
            if isinstance(one, Tolerance) and one.direction is not None:  # of the joint that fails
                units = [units[int(np.abs(one.direction).argmax())]]
            unit = units_text(units)
        balanced, fails = (
            f"{_three_digits(scale * figure)} {unit}" if np.isfinite(figure) else word
            for figure, word in ((one.balanced, "any"), (one.failing, "none found"))
        )
        return balanced, fails


def _three_digits(value: float) -> str:
    """Return a value to three digits, up to a million without a power of ten."""
    return f"{float(f'{value:.3g}'):.6g}"
