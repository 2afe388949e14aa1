"""How far each thing may be off if torques are chosen for it, and who is in conflict beyond that.

One vector of torques has to serve all that a quantity may be up to some size: nested sets, of which
`largest_served` finds the largest. Balls are looked at by polytopes around them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from math import cos, inf, pi, sin

import numpy as np
from scipy.linalg import null_space

from graspless_pin.algorithms.options import Limits, SolveOptions
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.robust_torques import torques_for_members
from graspless_pin.algorithms.served_share import ServedSize, largest_served
from graspless_pin.algorithms.uncertain_members import (
    Weight,
    member_at,
    members_of,
    nominal_member,
)
from graspless_pin.algorithms.uncertainty import MOST_TILT, Quantity, Uncertainty
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.members import (
    Corner,
    Member,
    feedback_torques,
    motions_without_force,
)
from graspless_pin.programs.objectives import Torque
from graspless_pin.records import Brief

_CLOSE = 0.003
"""Of the smallest size that is not served: how near the largest one has to be that is."""
_FARTHEST = 100.0
"""Of what there is: larger sizes are not looked at."""
_NEAR = 1e-4
"""Of what there is: no bracket is made narrower."""
_KEPT = 16
"""Members that were in conflict in earlier sets and that the next search begins with."""
_LAST = 0.999
"""Of a largest size at which nothing would be left of friction or torques."""
_SIDES = 32
"""Of the polygon around a circle, which is 0.5 % wider at its corners."""
_POINTS = 400
"""Of the polytope around a ball, which is 0.9 % wider at its corners."""
_VARIES = 1e-8
"""Of force times length: power along a motion that differs by less is the same."""


@dataclass(frozen=True, eq=False, repr=False)
class AttainableTolerance(Brief):
    """How far one quantity may be off if torques are chosen for it, within their limits.

    One vector of torques serves all up to `borne`. See the example of `tolerances`.

    Attributes:
        quantity: Which.
        borne: In the unit of `Tolerance.borne`. Proven under plain Coulomb friction.
        failing: From here on no torques were found; inf where there is no such size.
        torques: (L,) torques that bear `borne`, N m (N); with feedback those as it is meant to be.
        conflict: Members that no torques serve together at `failing`; empty: it is not proven.
        in_time: Whether the search went to its end; else torques may bear more than `borne`.
        free_motion: (P + L,) a motion that no contact resists, along which these members need
            different torques; None: there is none, or feedback adds what they differ by.
    """

    quantity: Quantity
    borne: float
    failing: float
    torques: FloatArray
    conflict: tuple[Member, ...] = ()
    in_time: bool = True
    free_motion: FloatArray | None = None

    @property
    def why(self) -> str:
        """Why no torques bear more, in a few words."""
        if not self.in_time:
            return "left open by time"
        if self.free_motion is not None:
            return "free motion"
        count = len(self.conflict)
        return f"{count} member{'s' if count > 1 else ''}" if count else ""


@dataclass(frozen=True)
class _Sets:
    """Nested sets of a quantity.

    Attributes:
        members: Corners of the set of a size, with the nominal problem first.
        unit: What sizes are compared to.
        most: The largest size that is looked at, over that.
        wide: How far the corners are off, over the size.
        of_tilt: Whether the size is an angle of gravity.
    """

    members: Callable[[float], list[Member]]
    unit: float = 1.0
    most: float = _FARTHEST
    wide: float = 1.0
    of_tilt: bool = False

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
        options: How; their time is that of all quantities together.
    """

    def __init__(
        self,
        problem: QuasistaticProblem,
        weight: Weight,
        stiffness: FloatArray | None,
        options: SolveOptions,
    ) -> None:
        """Take the arguments as they are."""
        self.problem, self.weight, self.stiffness = problem, weight, stiffness
        self.options, self.limits = options, Limits.of(options)
        self.directions = None if stiffness is None else feedback_torques(problem, stiffness)
        self.nominal = nominal_member(problem)
        still = np.zeros(3)
        self.still = Corner(0.0, still, weight.down, still, still, np.zeros(problem.contact_count))

    def of(self, quantity: Quantity, known: float, torques: FloatArray) -> AttainableTolerance:
        """Return how far a quantity may be off.

        Args:
            quantity: Which.
            known: A size that torques bear, and
            torques: (L,) these, N m (N).
        """
        problem, sets = self.problem, self._sets(quantity)
        low, high = problem.lower_torque, problem.upper_torque
        within = bool(((torques >= low) & (torques <= high)).all())
        known = known if within else 0.0
        if known >= sets.largest:
            return AttainableTolerance(quantity, known, inf, torques)
        found = self._largest(sets, known)
        served = read_only(np.array(torques if found.best is None else found.best.torques))
        if self.limits.passed:
            return AttainableTolerance(quantity, found.served, inf, served, in_time=False)
        failing, conflict = sets.wide * found.failing, found.conflict
        if sets.of_tilt and np.isfinite(failing):
            # The prism around the tilts is wider: of what fails, gravity is turned by so much.
            turned = self._largest(replace(sets, members=self._tilted), found.served)
            failing, conflict = turned.failing, turned.conflict
        return AttainableTolerance(
            quantity, found.served, failing, served, conflict,
            free_motion=self._free_motion(conflict),
        )  # fmt: skip

    def _largest(self, sets: _Sets, served: float) -> ServedSize:
        """Return how large a set may be, from a size that is served on."""
        begin: list[int] = []

        def solved(size: float) -> RobustSolution:
            members = sets.members(size)
            found = torques_for_members(
                members, Torque(0.0), self.options, self.limits, directions=self.directions,
                begin=[place for place in begin if place < len(members)],
            )  # fmt: skip
            # Sets have their corners in one order: who was in conflict may be so in the next, too.
            number = {id(one): place for place, one in enumerate(members)}
            fought = [number[id(found.members[place])] for place in found.conflict]
            begin[:] = dict.fromkeys([0, *fought, *begin][:_KEPT])
            stated = Uncertainty(tilt=size if sets.of_tilt else 0.0)
            return replace(found, uncertainty=stated, weight=self.weight, feedback=self.stiffness)

        found = solved(sets.largest)
        if found.found:
            return ServedSize(sets.largest, inf, found, ())
        return largest_served(
            self.problem, solved, found, (served, sets.largest),
            near=_NEAR * sets.unit, relative=_CLOSE, limits=self.limits,
        )  # fmt: skip

    def _sets(self, quantity: Quantity) -> _Sets:
        problem, weight, scales = self.problem, self.weight, self.problem.scales
        none = np.zeros(problem.joint_count)
        levers = problem.jacobian.any(axis=0)
        if quantity is Quantity.FRICTION:
            return _Sets(self._uncertain("friction"), most=_LAST)
        if quantity is Quantity.TILT:
            return _Sets(self._uncertain("tilt"), most=MOST_TILT, of_tilt=True)
        if quantity in (Quantity.MASS_MORE, Quantity.MASS_LESS):
            sign, most = (1.0, _FARTHEST) if quantity is Quantity.MASS_MORE else (-1.0, 1.0)
            return _Sets(lambda size: self._off([{"mass": sign * size}]), most=most)
        if quantity is Quantity.CENTER:
            level = np.linalg.svd(weight.wrench(0.0, np.zeros(3), weight.down)[None, :3])[2][1:]
            around = _polygon() @ level @ weight.axes
            return _Sets(
                lambda size: self._off(
                    [{"center_of_mass": size / cos(pi / _SIDES) * one} for one in around]
                ),
                scales.length,
                wide=1.0 / cos(pi / _SIDES),
            )
        if quantity in (Quantity.PUSH, Quantity.MOMENT):
            points, wide = _polytope()
            name = "force" if quantity is Quantity.PUSH else "moment"
            unit = scales.force if quantity is Quantity.PUSH else scales.force * scales.length
            return _Sets(
                lambda size: self._off([{name: size * wide * one} for one in points]),
                unit,
                wide=wide,
            )
        if quantity is Quantity.JOINT:
            each = np.concatenate([np.eye(len(none))[levers], -np.eye(len(none))[levers]])
            return _Sets(
                lambda size: [self.nominal, *(self._with_errors(none, size * one) for one in each)],
                float(scales.joints[levers].max()),
            )
        sign, most = (1.0, _FARTHEST) if quantity is Quantity.TORQUE_MORE else (-1.0, _LAST)

        def all_torques(size: float) -> list[Member]:
            off = self._with_errors(np.where(levers, sign * size, 0.0), none)
            return [self.nominal, replace(off, words=f"all torques {100.0 * sign * size:+.3g} %")]

        return _Sets(all_torques, most=most)

    def _uncertain(self, name: str) -> Callable[[float], list[Member]]:
        """Return what makes the corners of an `Uncertainty` of one figure."""
        return lambda size: [
            self.nominal,
            *members_of(self.problem, Uncertainty(**{name: size}), self.weight),
        ]

    def _tilted(self, size: float) -> list[Member]:
        """Return members with gravity turned to all sides by an angle, rad."""
        across = np.linalg.svd(self.weight.down[None])[2][1:]
        ring = cos(size) * self.weight.down + sin(size) * _polygon() @ across
        return self._off([{"down": one} for one in ring])

    def _off(self, changes: list[dict[str, float | FloatArray]]) -> list[Member]:
        """Return the nominal member, and those with changes of their load."""
        none = np.zeros(self.problem.joint_count)
        corners = (replace(self.still, **one) for one in changes)
        made = (member_at(self.problem, self.weight, one, none, none) for one in corners)
        return [self.nominal, *made]

    def _with_errors(self, factor: FloatArray, offset: FloatArray) -> Member:
        return member_at(self.problem, self.weight, self.still, factor, offset)

    def _free_motion(self, conflict: tuple[Member, ...]) -> FloatArray | None:
        """Return a motion that no contact resists and for which members need other torques."""
        problem = self.problem
        if len(conflict) < 2 or self.directions is not None or problem.is_sliding.any():
            return None
        # Joints that bear no contact carry their links by torques of their own.
        passive, levers = problem.passive_count, problem.jacobian.any(axis=0)
        found = motions_without_force(problem)
        motions = (found @ null_space(found[passive:][~levers], rcond=_VARIES)).T
        if not len(motions) or any(np.ptp(one.factors[levers]) > 0.0 for one in conflict):
            return None
        # What the commands c have to do along each: motion_q . c = needed, for all members.
        needed = [
            (motions[:, passive:] @ (one.problem.gravity_torques - one.offsets)
             - motions[:, :passive] @ one.problem.external_wrench) / one.factors[levers][0]
            for one in conflict
        ]  # fmt: skip
        differ = np.ptp(needed, axis=0)
        most = int(differ.argmax())
        scale = problem.scales.force * problem.scales.length
        return read_only(motions[most]) if differ[most] > _VARIES * scale else None


def _polygon() -> FloatArray:
    """Return unit vectors (K, 2) to the corners of a polygon."""
    angles = 2.0 * pi * np.arange(_SIDES) / _SIDES
    return np.array([np.cos(angles), np.sin(angles)]).T


@cache
def _polytope() -> tuple[FloatArray, float]:
    """Return unit vectors (K, 3), and how much larger their hull has to be to contain the ball."""
    from scipy.spatial import ConvexHull

    # Points on a spiral about an axis, each turned by the golden angle.
    number = np.arange(_POINTS) + 0.5
    height, angle = 1.0 - 2.0 * number / _POINTS, pi * (1.0 + 5.0**0.5) * number
    radius = np.sqrt(1.0 - height**2)
    points = np.array([radius * np.cos(angle), radius * np.sin(angle), height]).T
    return points, float(1.0 / -ConvexHull(points).equations[:, -1].max())
