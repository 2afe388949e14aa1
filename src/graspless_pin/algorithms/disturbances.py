"""The largest balanced and the largest guaranteed disturbance, by direction in wrench space.

Balanced: by some admissible contact forces. Guaranteed: rest is the only outcome up to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.branch_and_bound import search_modes
from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.algorithms.options import SolveKeywords, SolveOptions
from graspless_pin.algorithms.robustness import LoadBracket, checked_limits, load_bracket
from graspless_pin.algorithms.search_state import SearchState
from graspless_pin.bounds import SMALLEST_LENGTH
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.holding.stability import stability
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only, real_number
from graspless_pin.problem.matrices import load_words
from graspless_pin.problem.scales import passive_levers
from graspless_pin.programs.analysis_objectives import Disturbance
from graspless_pin.records import Brief
from graspless_pin.solution import Status
from graspless_pin.solution.tables import brief_figure
from graspless_pin.solvers import Outcome
from graspless_pin.tree_search import Limits

_SOBOL_DIRECTIONS = 64
_SAME_MULTIPLE = 1e-6
"""Multiples closer than this, over the load F, are the same: adjacent intervals may join there."""


@dataclass(frozen=True, eq=False, repr=False)
class DisturbanceMargin(Brief):
    """The largest balanced disturbance in each direction.

    See the example of `disturbance_margin`.

    Attributes:
        status: OPTIMAL, LIMIT_REACHED where a limit ended the search, or why not even the
            undisturbed object is balanced.
        directions: (K, P) unit directions [force; moment / characteristic length].
        magnitudes: (K,) N: the largest t such that along direction d every disturbance
            s [d_f; characteristic_length * d_m] with 0 <= s <= t is balanced in some feasible
            mode. Finite, since normal-force limits are; NaN where the search ended without a
            proof.
        characteristic_length: m; converts moments to forces.
        problem: The problem.
    """

    status: Status
    directions: FloatArray
    magnitudes: FloatArray
    characteristic_length: float
    problem: QuasistaticProblem

    @property
    def found(self) -> bool:
        """Whether the undisturbed object is balanced and all directions are proven."""
        return self.status is Status.OPTIMAL

    @property
    def worst(self) -> int:
        """Index of the direction with the smallest magnitude.

        Raises:
            NoSolutionError: If not even the undisturbed object is balanced.
        """
        if not self.found:
            raise NoSolutionError(f"There is no disturbance margin ({self.status.message}).")
        return int(np.argmin(self.magnitudes))

    @property
    def worst_wrench(self) -> FloatArray:
        """(P,) the balanced disturbance of the smallest magnitude, [N; N m]."""
        d = self.directions[self.worst]
        levers = passive_levers(self.problem.passive_units, self.characteristic_length)
        return self.magnitudes[self.worst] * (levers * d)

    def __str__(self) -> str:
        """Return one line: the worst direction."""
        if not self.found:
            return f"not found: {self.status.message}"
        words = load_words(self.worst_wrench, self.problem.passive_units, joined=", ")
        return (
            f"smallest disturbance margin of {len(self.magnitudes)} directions: "
            f"{brief_figure(self.magnitudes[self.worst], self.problem.scales.force)} N ({words})"
        )


def disturbance_margin(
    problem: QuasistaticProblem,
    torques: ArrayLike | None = None,
    directions: ArrayLike | None = None,
    *,
    characteristic_length: float | None = None,
    **options: Unpack[SolveKeywords],
) -> DisturbanceMargin:
    """Find the largest disturbance that the contacts can still balance in each direction.

    The robustness test of Maeda and Makita's *A quantitative test for the robustness of graspless
    manipulation*: contact forces inside cones and normal-force limits, over all feasible modes.
    One mode balances one interval of the multiples of a disturbance. The union over all modes may
    have gaps, so a disturbance counts only where every smaller one in its direction is balanced
    too: the margin is the end of the connected part of the union that holds zero. Gaps narrower
    than 2e-6 of the load are not seen.

    Args:
        problem: Contacts, wrench, joints and limits.
        torques: (L,) motor torques that stay as they are; those of joints that move no contact do
            not count. None: any within the limits.
        directions: (K, P) loads over `characteristic_length` where they are in N m, [force; moment
            / characteristic_length] on one free object, of any length; None: both ways along all
            axes and 64 quasi-uniform directions (a Sobol sequence, the same every time).
        characteristic_length: m; None: the largest distance of a contact from the reference point,
            or the length scale beside a given wrench matrix.
        options: See `SolveOptions.parse`.

    Raises:
        ArgumentError: If a shape is wrong, a direction is zero, the length is not positive, an
            option is not known, the sign rule is ``direction`` or ``stability="strong"``.

    Examples:
        >>> from graspless_pin import load_scene, disturbance_margin
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> along_x = disturbance_margin(problem, directions=[[1, 0, 0, 0, 0, 0]])
        >>> print(f"{along_x.magnitudes[0]:.1f} N")
        22.3 N
    """
    checked_problem(problem)
    how = SolveOptions.parse(**options).need_weak(
        "disturbance_margin considers only the best admissible contact forces",
        "leave it out, or call `guaranteed_disturbance` with given torques",
    )
    how.rules.need_signs("disturbance_margin")
    limits = Limits.from_options(how)
    units, length = unit_disturbances(problem, directions, characteristic_length)
    fixed_torques = None
    if torques is not None:
        fixed_torques = finite_array("torques", torques, (problem.joint_count,))
    scale = passive_levers(problem.passive_units, length)
    magnitudes = np.full(len(units), np.nan)
    status = Status.OPTIMAL
    for index, unit in enumerate(units):
        formulation = formulate(problem, Disturbance(scale * unit, fixed_torques))
        if index == 0:
            # Whether some mode balances the undisturbed object; the direction has no influence.
            status = search_modes(SearchState(formulation.capped("multiple", 0.0), how, limits))
        if status is Status.OPTIMAL:
            status, magnitudes[index] = _connected_end(formulation, how, limits)
        if status in (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT):
            break
        if status is not Status.OPTIMAL:
            magnitudes[:] = np.nan
            break
    return DisturbanceMargin(status, units, read_only(magnitudes), length, problem)


def _connected_end(
    formulation: Formulation, how: SolveOptions, limits: Limits
) -> tuple[Status, float]:
    """Return the end (N) of the interval of balanced multiples of a disturbance that holds zero.

    Each mode balances one interval of multiples. This walks down from the largest balanced
    multiple, interval by interval, and starts over below each gap between them. Under plain Coulomb
    friction there is one interval, and it holds zero.
    """
    largest = begin = np.inf
    is_coulomb = how.rules.static_friction is StaticFriction.COULOMB
    while begin > _SAME_MULTIPLE:
        state = SearchState(formulation.capped("multiple", begin - _SAME_MULTIPLE), how, limits)
        status = search_modes(state)
        best, mode = state.best, state.mode
        if limits.is_time_over or status in (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT):
            return Status.LIMIT_REACHED, np.nan
        if status is not Status.OPTIMAL or best is None or mode is None:
            # Zero was found to be balanced: a search that finds nothing contradicts that.
            return Status.UNVERIFIED, np.nan
        end = -best.value
        if end < begin - 2.0 * _SAME_MULTIPLE:
            largest = end
        first = 0.0 if is_coulomb else _least_multiple(formulation, mode, how)
        if first is None:
            return Status.UNVERIFIED, np.nan
        begin = min(first, end)
    return Status.OPTIMAL, formulation.coordinates.force_scale * largest


def _least_multiple(formulation: Formulation, mode: SlidingMode, how: SolveOptions) -> float | None:
    """Return the smallest multiple that a mode balances; None: no solver answered.

    The mode balances all multiples from there to its largest one.
    """
    least = formulation.with_costs(-formulation.program.c)
    answer = least.solve(*least.bounds_of(mode), how.solver, cutoff=np.inf)
    return None if answer.outcome is Outcome.FAILED else answer.value


def unit_disturbances(
    problem: QuasistaticProblem, directions: ArrayLike | None, characteristic_length: float | None
) -> tuple[FloatArray, float]:
    """Return (K, P) unit directions, and the length (m) that converts moments to forces.

    Args:
        problem: The contacts.
        directions: (K, P) of any length; None: both ways along all axes and 64 others.
        characteristic_length: m; None: see `disturbance_margin`.

    Raises:
        ArgumentError: If a direction is zero or has another shape, or the length is not positive.
    """
    length, passive = characteristic_length, problem.passive_count
    if length is None and problem.wrench_matrix is None:
        length = float(np.linalg.norm(problem.positions, axis=1).max()) or 1.0
    elif length is None:
        length = problem.scales.length
    length = real_number("characteristic_length", length, SMALLEST_LENGTH)
    if directions is None:
        axes = np.vstack([np.eye(passive), -np.eye(passive)])
        if passive == 1:
            return read_only(axes), length
        from scipy.stats import norm, qmc

        spread = norm.ppf(
            qmc.Sobol(passive, scramble=False).random(2 * _SOBOL_DIRECTIONS)[_SOBOL_DIRECTIONS:]
        )
        given = np.vstack([axes, spread / np.linalg.norm(spread, axis=1, keepdims=True)])
        return read_only(given), length
    given = finite_array("directions", directions, (None, passive))
    lengths = np.linalg.norm(given, axis=1)
    if (lengths == 0.0).any():
        index = int(np.argmin(lengths))
        raise ArgumentError("directions", f"is zero at index {index}; each must be nonzero")
    return read_only(given / lengths[:, None]), float(length)


@dataclass(frozen=True, eq=False, repr=False)
class GuaranteedDisturbance(Brief):
    """Brackets of the disturbances up to which rest is proven to be the only outcome.

    Along direction d the disturbance of magnitude t is t [d_f; characteristic_length * d_m].

    See the example of `guaranteed_disturbance`.

    Attributes:
        verdict: Verdict on the torques without disturbance.
        directions: (K, P) unit directions [force; moment / characteristic length].
        brackets: K brackets of the magnitude with their proofs; none where rest is not the only
            outcome even without disturbance.
        characteristic_length: m; converts moments to forces.
        largest: Largest magnitude that was looked at, N.
    """

    verdict: StabilityVerdict
    directions: FloatArray
    brackets: tuple[LoadBracket, ...]
    characteristic_length: float
    largest: float

    @property
    def guaranteed(self) -> FloatArray:
        """(K,) N: rest is proven to be the only outcome of every magnitude from zero up to this.

        NaN where rest is not the only outcome without disturbance, and where `reached` is False.
        """
        return self._bracket_figures("guaranteed")

    @property
    def failing(self) -> FloatArray:
        """(K,) N: the smallest magnitude found at which the object may or must move.

        inf where none was found up to `largest`, NaN where `reached` is False. Between `guaranteed`
        and this nothing is decided.
        """
        return self._bracket_figures("failing")

    @property
    def possible(self) -> FloatArray:
        """(K,) N: the largest magnitude that forces in round cones without limits balance.

        At most `largest`: the best case. Beyond it rest is no outcome.
        """
        return self._bracket_figures("possible")

    @property
    def complete(self) -> NDArray[np.bool_]:
        """(K,) whether the search was completed; False where `time_limit` ended it before.

        Then the other figures are those proven and found by then.
        """
        return self._bracket_figures(
            "complete", without=self.verdict.status is not Stability.UNDECIDED
        )

    @property
    def reached(self) -> NDArray[np.bool_]:
        """(K,) whether a direction was searched; where not, its other figures are NaN."""
        return self._bracket_figures("reached", without=False)

    @property
    def failures(self) -> tuple[StabilityVerdict | None, ...]:
        """K verdicts at `failing`; None where that is inf."""
        return tuple(one.failure for one in self.brackets) or (None,) * len(self.directions)

    def _bracket_figures(self, name: str, *, without: float | bool = np.nan) -> NDArray[Any]:
        """Return (K,) an attribute of all brackets; `without` in all entries if there are none."""
        found = [getattr(one, name) for one in self.brackets]
        return read_only(np.array(found or [without] * len(self.directions)))

    @property
    def found(self) -> bool:
        """Whether rest is the only outcome without disturbance."""
        return self.verdict.status is Stability.STRONG

    @property
    def worst(self) -> int:
        """Index of the direction with the smallest guaranteed magnitude, of those reached.

        Raises:
            NoSolutionError: If rest is not guaranteed without disturbance, or none was reached.
        """
        if not self.found:
            raise NoSolutionError(f"Rest is not guaranteed without disturbance ({self.verdict}).")
        if not self.reached.any():
            raise NoSolutionError("The time limit ended the search before the first direction.")
        return int(np.nanargmin(self.guaranteed))

    def __str__(self) -> str:
        """Return one line: the direction with the smallest guaranteed magnitude."""
        if not self.found:
            return f"nothing guaranteed: {self.verdict}"
        if not self.reached.any():
            return (
                f"the time limit ended the search before the first of {len(self.directions)} "
                "directions"
            )
        at = self.worst
        units = self.verdict.problem.passive_units
        wrench = self.directions[at] * passive_levers(units, self.characteristic_length)
        missed = int(np.sum(~self.reached))
        short = int(np.sum(~self.complete)) - missed
        ended = f"; directions not completed in time: {short}" if short else ""
        ended += f"; directions not reached in time: {missed}" if missed else ""
        return (
            f"weakest of {len(self.directions)} directions, per newton of "
            f"{load_words(wrench, units, joined=' and ')}: {self.brackets[at].words('N')}{ended}"
        )


def guaranteed_disturbance(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    directions: ArrayLike | None = None,
    *,
    characteristic_length: float | None = None,
    largest: float | None = None,
    precision: float = 0.02,
    node_limit: int = 1000,
    acceleration_resolution: float = 1e-3,
    time_limit: float | None = None,
) -> GuaranteedDisturbance:
    """Bracket the largest disturbance up to which rest stays the only outcome, in each direction.

    `disturbance_margin` is for the best contact forces; this one is for any contact forces that may
    result. Each lower end is proven for all magnitudes up to it, not only for those that were
    tried; each upper end has a verdict that shows a motion, or that rest is no outcome.

    Args:
        problem: At rest, with `object_inertia` and `joint_inertia`.
        torques: (L,) the motors' torques, N m (N).
        directions: As of `disturbance_margin`; None: its 76, which may take minutes.
        characteristic_length: As of `disturbance_margin`, m.
        largest: Largest magnitude that is looked at, N; None: ten loads.
        precision: Relative width of the brackets at which the search ends, if it reaches it.
        node_limit: Sets of outcomes that each tree of a proof may look at; the default is a third
            of that of a single verdict, since each direction takes several.
        acceleration_resolution: As of `stability`; for the load without disturbance.
        time_limit: Seconds in all; None: any time. What is proven by then is returned, and
            `complete` tells which directions were completed.

    Raises:
        ArgumentError: If an argument is wrong.

    Examples:
        >>> import numpy as np
        >>> from graspless_pin import QuasistaticProblem, guaranteed_disturbance
        >>> feet = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]  # m
        >>> normals, weight = [[0.0, 0.0, 1.0]] * 3, [0.0, 0.0, -4.9, 0.0, 0.0, 0.0]
        >>> inertia = np.diag([0.5, 0.5, 0.5, 1e-3, 1e-3, 1e-3])
        >>> stool = QuasistaticProblem(feet, normals, weight, friction=0.5, object_inertia=inertia)
        >>> found = guaranteed_disturbance(stool, [], [[1, 0, 0, 0, 0, 0]], precision=0.1)
        >>> print(f"pushed along x it stays up to {found.guaranteed[0]:.1f} N at least")
        pushed along x it stays up to 2.4 N at least
    """
    limits = checked_limits(problem, precision, node_limit, time_limit)
    units, length = unit_disturbances(problem, directions, characteristic_length)
    most = 10.0 * problem.scales.force if largest is None else real_number("largest", largest, 0.0)
    verdict = stability(
        problem,
        torques,
        acceleration_resolution=acceleration_resolution,
        time_limit=limits.seconds_left,
    )
    brackets: tuple[LoadBracket, ...] = ()
    if verdict.status is Stability.STRONG:
        scale = passive_levers(problem.passive_units, length)
        still = np.zeros(problem.joint_count)
        brackets = tuple(
            load_bracket(verdict, np.concatenate([scale * unit, still]), most, precision, limits)
            for unit in units
        )
    return GuaranteedDisturbance(verdict, units, brackets, length, float(most))
