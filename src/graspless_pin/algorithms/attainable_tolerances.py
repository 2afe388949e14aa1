"""How far each quantity may be off if torques are chosen for it, and the members in conflict then.

One vector of torques has to serve all values of a quantity up to some size: nested sets, of which
`largest_served` finds the largest. Balls are replaced by polytopes around them.

A set that is not served comes with members in conflict. The same members of a smaller set are a
small program, which tells down to which size they stay in conflict. The whole set is solved again
only at that size: it is served, or other members are in conflict. Mostly two or three whole sets
are solved, instead of one for each halving.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from math import cos, inf, nan, pi, sin
from typing import Unpack

import numpy as np
from scipy.linalg import null_space

from graspless_pin.algorithms.options import SolveKeywords, SolveOptions
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.robust_torques import Feedback, solve_robust, torques_for_members
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.uncertain_members import (
    Weight,
    member_at,
    members_of,
    nominal_member,
    scaled_member,
)
from graspless_pin.algorithms.uncertainty import MOST_TILT, Quantity, Uncertainty, polygon
from graspless_pin.modes.rules import Rules, StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.members import (
    Corner,
    Member,
    feedback_torques,
    join_members,
    motions_keeping_contact,
)
from graspless_pin.programs.objectives import Objective, Torque
from graspless_pin.records import Brief
from graspless_pin.solution import Status
from graspless_pin.tree_search import NO_LIMITS, Limits

_SHARE = 1e-3
_COULOMB = SolveOptions(rules=Rules(static_friction=StaticFriction.COULOMB))


@dataclass(frozen=True, eq=False, repr=False)
class ServedSize(Brief):
    """Bracket of the largest size of a set that torques serve.

    Attributes:
        served: The largest size that was found to be served.
        failing: The smallest size at which no torques were found.
        best: Solution at size `served`; None: nothing was solved for it.
        conflict: Members at size `failing` that no torques serve together; empty: none are known.
    """

    served: float
    failing: float
    best: RobustSolution | None
    conflict: tuple[Member, ...]


def largest_served(
    solve_size: Callable[[float], RobustSolution],
    failed: RobustSolution,
    sizes: tuple[float, float],
    *,
    near: float,
    relative: float = 0.0,
    limits: Limits,
) -> ServedSize:
    """Bracket the largest size of a set that torques serve, between two sizes.

    Args:
        solve_size: Returns the robust solution for the set of a size. Sets are nested, and contain
            the members of larger ones with all deviations times the ratio of the sizes.
        failed: The solution for the larger size: no torques.
        sizes: The smaller one is served, and the larger one is not.
        near: Largest difference of the two sizes that are returned.
        relative: The same over the larger size; the wider of the two counts.
        limits: When to stop.
    """
    (low, high), failed_size = sizes, sizes[1]
    best: RobustSolution | None = None
    halves = False

    def allowed_gap() -> float:
        return max(near, relative * high)

    while high - low > allowed_gap() and not limits.is_time_over:
        trial = 0.5 * (low + high)
        if failed.conflict:
            trial = low
            while high - trial > 0.5 * allowed_gap():
                middle = 0.5 * (trial + high)
                if _is_conflict_kept(failed, middle / failed_size):
                    high = middle
                else:
                    trial = middle
            if high - low <= allowed_gap():
                break
            # Other members may be in conflict there, again and again: every second time, bisect.
            trial = 0.5 * (low + trial) if halves and trial > low + allowed_gap() else trial
            halves = not halves
        found = solve_size(trial)
        if found.found:
            low, best = trial, found
        elif found.status is Status.NOT_FOUND_IN_LIMIT and limits.is_time_over:
            break
        else:
            high, failed_size, failed = trial, trial, found
    return ServedSize(low, high, best, tuple(smaller_conflict(failed, high / failed_size)))


def smaller_conflict(failed: RobustSolution, share: float) -> list[Member]:
    """Return the members in conflict with all deviations times a share, as in a smaller set.

    Args:
        failed: The solution for the larger set: no torques.
        share: Factor on the figures of the set, at most 1.
    """
    conflict = [failed.members[number] for number in failed.conflict]
    weight, uncertainty = failed.weight, failed.uncertainty
    if share == 1.0 or weight is None or uncertainty is None:
        return conflict
    return [
        scaled_member(one, weight, uncertainty, lambda _, value: share * np.asarray(value))
        for one in conflict
    ]


def _is_conflict_kept(failed: RobustSolution, share: float) -> bool:
    """Whether the members stay in conflict with all deviations times a share."""
    directions = feedback_torques(failed.members[0].problem, failed.feedback)
    together = join_members(smaller_conflict(failed, share), directions)
    found = solve_problem(together, failed.solution.objective, _COULOMB)
    return found.status is Status.INFEASIBLE_FORCES


def served_share(
    problem: QuasistaticProblem,
    objective: Objective,
    uncertainty: Uncertainty,
    *,
    feedback: Feedback | None = None,
    **options: Unpack[SolveKeywords],
) -> float:
    """Return the largest share of a set's figures, about the same middle, that torques serve.

    To a thousandth; members in conflict prove which smaller sets are not served either.

    Args:
        problem: The nominal one.
        objective: What is optimised.
        uncertainty: The set.
        feedback: Joint stiffness that adds to the torques, N m/rad (N/m), or a controller.
        options: See `SolveOptions.parse`.

    Returns:
        From 0 to 1; NaN where not even the nominal problem is served.

    Raises:
        ArgumentError: See `minimize_torque`.

    Examples:
        >>> from graspless_pin import Torque, Uncertainty, load_scene, served_share
        >>> problem = load_scene("examples/paper/sphere_on_slope.yaml").problem()
        >>> unknown = Uncertainty(mass=0.2, center_of_mass=0.01)  # m
        >>> share = served_share(problem, Torque(0.1), unknown, static_friction="coulomb")
        >>> print(f"{100.0 * share:.0f} %")
        85 %
    """
    how = SolveOptions.parse(**options)

    def solve_share(share: float) -> RobustSolution:
        return solve_robust(problem, objective, uncertainty.scaled(share), how, feedback=feedback)

    whole = solve_share(1.0)
    return 1.0 if whole.found else largest_share(solve_share, whole).served


def largest_share(
    solve_share: Callable[[float], RobustSolution],
    whole: RobustSolution,
    limits: Limits = NO_LIMITS,
) -> ServedSize:
    """Return the largest share of a set that is served, see `served_share`.

    Args:
        solve_share: Returns the robust solution for the set with its figures times a share.
        whole: The solution for the whole set: no torques.
        limits: When to stop.
    """
    found = largest_served(solve_share, whole, (0.0, 1.0), near=_SHARE, limits=limits)
    if found.served == 0.0 and not limits.is_time_over and not solve_share(0.0).found:
        return replace(found, served=nan)
    return found


_CLOSE = 0.003
"""Width of the final bracket, over the smallest size that is not served."""
_FARTHEST = 100.0
"""Largest size that is looked at, over the unit of the sets."""
_NEAR = 1e-4
"""Narrowest bracket, over the unit of the sets."""
_KEPT = 16
"""Number of members in conflict in earlier sets that the next search begins with."""
_LARGEST_SHRINKAGE = 0.999
"""Largest share by which friction or torques may shrink: at 1 nothing would be left of them."""
_SIDES = 32
"""Sides of the polygon around a circle, which is 0.5 % wider at its corners."""
_POINTS = 400
"""Vertices of the polytope around a ball, which is 0.9 % wider at its corners."""
_VARIES = 1e-8
"""Over force times length: power along a motion that differs by less is the same."""


@dataclass(frozen=True, eq=False, repr=False)
class AttainableTolerance(Brief):
    """How far one quantity may be off if torques are chosen for it, within their limits.

    One vector of torques serves all up to `balanced`. See the example of `tolerances`.

    Attributes:
        quantity: The quantity.
        balanced: Largest size that torques serve, in the unit of `Tolerance.balanced`. Proven under
            plain Coulomb friction.
        failing: Size from which on no torques were found; inf: there is none.
        torques: (L,) torques for `balanced`, N m (N); with feedback those of the nominal problem.
        conflict: Members that no torques serve together at `failing`; empty: it is not proven.
        complete: Whether the search was completed; else torques may serve more than `balanced`.
        free_motion: (P + L,) a motion [V; theta_dot] that no contact resists, along which these
            members need different torques; None: there is none, or feedback adds what they differ
            by.
    """

    quantity: Quantity
    balanced: float
    failing: float
    torques: FloatArray
    conflict: tuple[Member, ...] = ()
    complete: bool = True
    free_motion: FloatArray | None = None

    @property
    def why(self) -> str:
        """Why no torques serve larger sizes, in a few words."""
        if not self.complete:
            return "not decided in time"
        if self.free_motion is not None:
            return "free motion"
        count = len(self.conflict)
        return {0: "", 1: "1 member infeasible"}.get(count, f"{count} members in conflict")


@dataclass(frozen=True)
class _NestedSets:
    """Nested sets of a quantity, by size.

    Attributes:
        members: Returns the corners of the set of a size, with the nominal problem first.
        unit: The scale of sizes.
        most: The largest size that is looked at, over the unit.
        wide: Distance of the corners from the nominal value, over the size.
        figure: Name of the figure of an `Uncertainty` that the size is; empty: none.
    """

    members: Callable[[float], list[Member]]
    unit: float = 1.0
    most: float = _FARTHEST
    wide: float = 1.0
    figure: str = ""

    @property
    def largest(self) -> float:
        """The largest size that is looked at."""
        return self.unit * self.most


class AttainableSearch:
    """Finds the largest sets of each quantity that torques serve.

    Args:
        problem: The nominal one.
        weight: Which part of its load is weight.
        stiffness: (L,) joint stiffness that adds to torques, N m/rad (N/m); None: none.
        options: How problems are solved; the time limit is that of all quantities together.
    """

    def __init__(
        self,
        problem: QuasistaticProblem,
        weight: Weight,
        stiffness: FloatArray | None,
        options: SolveOptions,
    ) -> None:
        """Store the arguments; the time of all searches begins."""
        self.problem, self.weight, self.stiffness = problem, weight, stiffness
        self.options, self.limits = options, Limits.from_options(options)
        self.directions = feedback_torques(problem, stiffness)
        self.nominal = nominal_member(problem)
        zero, kinetic = np.zeros(3), np.zeros(problem.contact_count)
        self.nominal_corner = Corner(0.0, zero, weight.down, zero, zero, kinetic)

    def find(self, quantity: Quantity, known: float, torques: FloatArray) -> AttainableTolerance:
        """Return the attainable tolerance of a quantity.

        Args:
            quantity: The quantity.
            known: A size that the given torques serve.
            torques: (L,) the given torques, N m (N).
        """
        problem, sets = self.problem, self._nested_sets(quantity)
        low, high = problem.lower_torque, problem.upper_torque
        if not ((torques >= low) & (torques <= high)).all():
            known = 0.0
        if known >= sets.largest:
            return AttainableTolerance(quantity, known, inf, torques)
        found = self._served_size(sets, known)
        served = read_only(np.array(torques if found.best is None else found.best.torques))
        if self.limits.is_time_over:
            return AttainableTolerance(quantity, found.served, inf, served, complete=False)
        failing, conflict = sets.wide * found.failing, found.conflict
        if sets.figure == "tilt" and np.isfinite(failing):
            # The frustum around the tilts is wider, so what fails is looked for on the circle.
            turned = self._served_size(replace(sets, members=self._tilted_members), found.served)
            failing, conflict = turned.failing, turned.conflict
        return AttainableTolerance(
            quantity, found.served, failing, served, conflict,
            free_motion=self._free_motion(conflict),
        )  # fmt: skip

    def _served_size(self, sets: _NestedSets, served: float) -> ServedSize:
        """Bracket the largest size that torques serve, from a served size on."""
        begin: list[int] = []

        def solve_size(size: float) -> RobustSolution:
            members = sets.members(size)
            found = torques_for_members(
                members, Torque(0.0), self.options, self.limits, directions=self.directions,
                begin=[place for place in begin if place < len(members)],
            )  # fmt: skip
            # Corners have the same order in all sets, so those in conflict begin the next search.
            number = {id(one): place for place, one in enumerate(members)}
            fought = [number[id(found.members[place])] for place in found.conflict]
            begin[:] = dict.fromkeys([0, *fought, *begin][:_KEPT])
            stated = Uncertainty(**({sets.figure: size} if sets.figure else {}))
            return replace(found, uncertainty=stated, weight=self.weight, feedback=self.stiffness)

        found = solve_size(sets.largest)
        if found.found:
            return ServedSize(sets.largest, inf, found, ())
        return largest_served(
            solve_size, found, (served, sets.largest),
            near=_NEAR * sets.unit, relative=_CLOSE, limits=self.limits,
        )  # fmt: skip

    def _nested_sets(self, quantity: Quantity) -> _NestedSets:
        problem, weight, scales = self.problem, self.weight, self.problem.scales
        zeros = np.zeros(problem.joint_count)
        levers = problem.jacobian.any(axis=0)
        if quantity is Quantity.FRICTION:
            return _NestedSets(
                self._corners_of_figure("friction"), most=_LARGEST_SHRINKAGE, figure="friction"
            )
        if quantity is Quantity.TILT:
            return _NestedSets(self._corners_of_figure("tilt"), most=MOST_TILT, figure="tilt")
        if quantity in (Quantity.MASS_MORE, Quantity.MASS_LESS):
            sign, most = (1.0, _FARTHEST) if quantity is Quantity.MASS_MORE else (-1.0, 1.0)
            return _NestedSets(lambda size: self._load_members([{"mass": sign * size}]), most=most)
        if quantity is Quantity.CENTER:
            level = np.linalg.svd(weight.wrench(0.0, np.zeros(3), weight.down)[None, :3])[2][1:]
            around = polygon(_SIDES) @ level @ weight.axes
            return _NestedSets(
                lambda size: self._load_members(
                    [{"center_of_mass": size / cos(pi / _SIDES) * one} for one in around]
                ),
                scales.length,
                wide=1.0 / cos(pi / _SIDES),
            )
        if quantity in (Quantity.PUSH, Quantity.MOMENT):
            points, wide = _ball_polytope()
            name = "force" if quantity is Quantity.PUSH else "moment"
            unit = scales.force if quantity is Quantity.PUSH else scales.force * scales.length
            return _NestedSets(
                lambda size: self._load_members([{name: size * wide * one} for one in points]),
                unit,
                wide=wide,
            )
        if quantity is Quantity.JOINT:
            each = np.concatenate([np.eye(len(zeros))[levers], -np.eye(len(zeros))[levers]])
            return _NestedSets(
                lambda size: [
                    self.nominal,
                    *(self._with_errors(zeros, size * one) for one in each),
                ],
                float(scales.joints[levers].max()),
            )
        sign, most = (
            (1.0, _FARTHEST) if quantity is Quantity.TORQUE_MORE else (-1.0, _LARGEST_SHRINKAGE)
        )

        def all_torques(size: float) -> list[Member]:
            off = self._with_errors(np.where(levers, sign * size, 0.0), zeros)
            return [self.nominal, replace(off, words=f"all torques {100.0 * sign * size:+.3g} %")]

        return _NestedSets(all_torques, most=most)

    def _corners_of_figure(self, name: str) -> Callable[[float], list[Member]]:
        """Return a function from a size to the corners of an `Uncertainty` with that one figure."""
        return lambda size: [
            self.nominal,
            *members_of(self.problem, Uncertainty(**{name: size}), self.weight),
        ]

    def _tilted_members(self, size: float) -> list[Member]:
        """Return members with gravity tilted to all sides by an angle, rad."""
        across = np.linalg.svd(self.weight.down[None])[2][1:]
        ring = cos(size) * self.weight.down + sin(size) * polygon(_SIDES) @ across
        return self._load_members([{"down": one} for one in ring])

    def _load_members(self, changes: list[dict[str, float | FloatArray]]) -> list[Member]:
        """Return the nominal member, and one member for each change of the load."""
        zeros = np.zeros(self.problem.joint_count)
        corners = (replace(self.nominal_corner, **one) for one in changes)
        made = (member_at(self.problem, self.weight, one, zeros, zeros) for one in corners)
        return [self.nominal, *made]

    def _with_errors(self, factor: FloatArray, offset: FloatArray) -> Member:
        return member_at(self.problem, self.weight, self.nominal_corner, factor, offset)

    def _free_motion(self, conflict: tuple[Member, ...]) -> FloatArray | None:
        """Return a motion that no contact resists and along which members need other torques."""
        problem = self.problem
        if len(conflict) < 2 or self.directions is not None or problem.is_sliding.any():
            return None
        # Joints that move no contact carry their links by torques of their own.
        passive, levers = problem.passive_count, problem.jacobian.any(axis=0)
        found = motions_keeping_contact(problem)
        motions = (found @ null_space(found[passive:][~levers], rcond=_VARIES)).T
        if not len(motions) or any(np.ptp(one.factors[levers]) > 0.0 for one in conflict):
            return None
        # Power of the commands c along each motion: contacts do no work, v . W f = -q . J^T f for
        # W^T v + J q = 0, so q . c = needed for all members.
        needed = [
            (motions[:, passive:] @ (one.problem.gravity_torques - one.offsets)
             + motions[:, :passive] @ one.problem.external_wrench) / one.factors[levers][0]
            for one in conflict
        ]  # fmt: skip
        differ = np.ptp(needed, axis=0)
        most = int(differ.argmax())
        scale = problem.scales.force * problem.scales.length
        if differ[most] <= _VARIES * scale:
            return None
        return read_only(np.concatenate([motions[most, :passive], -motions[most, passive:]]))


@cache
def _ball_polytope() -> tuple[FloatArray, float]:
    """Return unit vectors (K, 3), and the factor by which their hull contains the unit ball."""
    from scipy.spatial import ConvexHull

    # Points on a spiral about an axis, each turned by the golden angle.
    number = np.arange(_POINTS) + 0.5
    height, angle = 1.0 - 2.0 * number / _POINTS, pi * (1.0 + 5.0**0.5) * number
    radius = np.sqrt(1.0 - height**2)
    points = np.array([radius * np.cos(angle), radius * np.sin(angle), height]).T
    return points, float(1.0 / -ConvexHull(points).equations[:, -1].max())
