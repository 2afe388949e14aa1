"""What contact forces given torques can end up with: the indeterminate forces, eq. (32)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.force_extremes import ForceExtremes
from graspless_pin.algorithms.options import SolveKeywords, SolveOptions
from graspless_pin.modes.rules import Rules, StaticFriction
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only
from graspless_pin.records import Brief
from graspless_pin.solution import FOUND, Status
from graspless_pin.solution.tables import (
    Table,
    brief_figure,
    force_rounding,
    paragraph,
    shown,
)

_DETERMINATE = 1e-6
_HEADERS = ["#", "f_n [N]", "f_t1 [N]", "f_t2 [N]"]
_REACHED = " *"
_NOTE = "* reached; no proof yet that these torques allow no wider range"


@dataclass(frozen=True, eq=False, repr=False)
class ContactForceBounds(Brief):
    """The range of every contact force over all feasible virtual-sliding modes.

    See the example of `contact_force_bounds`.

    Attributes:
        status: OPTIMAL where all is proven; LIMIT_REACHED where the time limit ended the search or
            no solver answered some program; or why there is no range.
        lower: (M, 3) smallest f_n, f_t1, f_t2, N; -inf where a free ray exists.
        upper: (M, 3) largest f_n, f_t1, f_t2, N; inf where a free ray exists.
        proven: (M, 3) whether no feasible mode leads beyond either end. Elsewhere `lower` and
            `upper` were reached by forces that a feasible mode holds, and the range may be wider.
        smallest_margin: Smallest margin (N) that the torques can end up with; -inf where a
            normal force is unbounded. With LIMIT_REACHED the smallest one reached.
        largest_margin: Largest margin that they can end up with, N: the optimum's best case. With
            LIMIT_REACHED the largest one reached.
        torques: (L,) the motor torques that were given.
        problem: The problem.
        rules: The rules on static friction that the forces keep.
    """

    status: Status
    lower: FloatArray
    upper: FloatArray
    proven: NDArray[np.bool_]
    smallest_margin: float
    largest_margin: float
    torques: FloatArray
    problem: QuasistaticProblem
    rules: Rules

    @property
    def found(self) -> bool:
        """Whether the torques can be held at all."""
        return self.status in FOUND

    @property
    def indeterminate(self) -> NDArray[np.bool_]:
        """(M, 3) components that the torques do not determine, as far as is known."""
        width = self.upper - self.lower
        return width > _DETERMINATE * self.problem.scales.force

    @property
    def covers(self) -> str:
        """Over which forces the ranges go, in words."""
        if self.rules.static_friction is not StaticFriction.COULOMB:
            return "over all admissible contact forces"
        cones = self.problem.cone_model.words(self.problem.cone_edges)
        return f"over all forces of rest ({cones})"

    def squeeze_words(self, bodies: Sequence[str] | None = None) -> str:
        """Return who may press with any force, because the torques do not limit it; empty: none.

        Args:
            bodies: (M,) names of what touches at each contact; None: not named.
        """
        free = np.flatnonzero(np.isinf(self.upper[:, 0])).tolist() if self.found else []
        if not free:
            return ""
        rows = self.problem.jacobian.reshape(len(self.upper), 3 * self.problem.joint_count)
        who = "contacts" if rows[free].any() else "the supports"
        if bodies is not None:
            who = " and ".join(dict.fromkeys(bodies[contact] for contact in free))
        listed = ", ".join(str(contact) for contact in free[:-1])
        listed += f" and {free[-1]}" if listed else str(free[-1])
        noun = "contact" if len(free) == 1 else "contacts"
        return f"{who} may squeeze the object with any force: {noun} {listed}"

    def __str__(self) -> str:
        """Return a readable table."""
        if not self.found:
            return f"not found: {self.status.message}"
        return f"{Table(self._rows(), _HEADERS)}\n\n{self._margins()}"

    def _repr_html_(self) -> str:
        """Return the table as HTML, for notebooks."""
        if not self.found:
            return paragraph(str(self))
        return Table(self._rows(), _HEADERS, self._margins()).html()

    def _rows(self) -> list[list[object]]:
        return [
            [contact, *(self._range(contact, component, left) for component in range(3))]
            for contact, left in enumerate(force_rounding(self.problem))
        ]

    def _range(self, contact: int, component: int, rounding: float) -> str:
        at, load = (contact, component), self.problem.scales.force
        mark = "" if self.proven[at] else _REACHED
        ends = (shown(float(one[at]), load, "+", rounding) for one in (self.lower, self.upper))
        return f"{' .. '.join(ends)}{mark}"

    def _margins(self) -> str:
        words = f"{self._margin_range()}, {self.covers}"
        squeezed = self.squeeze_words()
        return f"{words}\n{squeezed}" if squeezed else words

    def _margin_range(self) -> str:
        ends, load = (self.smallest_margin, self.largest_margin), self.problem.scales.force
        least, most = (brief_figure(end, load) for end in ends)
        if self.status is Status.OPTIMAL:
            return f"margin between {least} and {most} N with these torques"
        words = f"margin from {least} N or less to {most} N or more with these torques"
        return words if self.proven.all() else f"{_NOTE}\n{words}"


def contact_force_bounds(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    **options: Unpack[SolveKeywords],
) -> ContactForceBounds:
    """Bound the contact forces that given motor torques can end up with, eq. (32).

    Every component is minimised and maximised over all feasible modes by branch and bound. The
    force set (32) has no normal-force limit: a component is infinite where a direction exists that
    keeps balance, torques, cones and one feasible mode (a free ray, found and not presumed).

    With ``static_friction="coulomb"`` there is no virtual-sliding rule, and with round cones
    (``problem.with_changes(cone="round")``) the ranges are over all outcomes of rest.

    Args:
        problem: Contacts, wrench and joints.
        torques: (L,) motor torques J^T f + g, N m; for example `TorqueSolution.torques`.
        options: See `SolveOptions.parse`. A limit returns what was reached, with LIMIT_REACHED, or
            NOT_FOUND_IN_LIMIT if there was no time to hold the torques at all.

    Raises:
        ArgumentError: If the torques have the wrong shape, an option is not known, the time limit
            is negative, the sign rule is ``direction`` or ``stability="strong"``.

    Examples:
        >>> from graspless_pin import load_scene, contact_force_bounds, minimize_torque
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> torques = minimize_torque(problem, margin=0.1).torques
        >>> bounds = contact_force_bounds(problem, torques)
        >>> print(f"margins up to {bounds.largest_margin:.1f} N")
        margins up to 0.1 N
    """
    how = SolveOptions.parse(**options)
    how.rules.need_signs("contact_force_bounds")
    how.need_weak("contact_force_bounds takes torques as they are", "ask `stability` of them")
    checked_problem(problem)
    given = finite_array("torques", torques, (problem.joint_count,))
    search = ForceExtremes(problem, given, how)
    status = search.feasibility()
    count = problem.contact_count
    lower, upper = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    proven = np.zeros((count, 3), dtype=bool)
    margins = np.nan, np.nan
    if status in FOUND:
        # One search that is worth having before the many.
        largest = search.largest_margin()
        for contact in range(count):
            for component in range(3):
                at = contact, component
                direction = search.component(contact, component)
                least, most = search.largest(-direction), search.largest(direction)
                lower[at], upper[at] = -least.value, most.value
                proven[at] = least.proven and most.proven
        smallest = search.smallest_margin(lower, upper, proven)
        margins = smallest.value, largest.value
        complete = proven.all() and smallest.proven and largest.proven
        status = Status.OPTIMAL if complete else Status.LIMIT_REACHED
    return ContactForceBounds(
        status, read_only(lower), read_only(upper), read_only(proven), *margins, given, problem,
        how.rules,
    )  # fmt: skip
