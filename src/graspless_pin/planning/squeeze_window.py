"""How hard a hand may squeeze: from where it slips to where it buckles, or a limit is reached.

Torques of joints without a part in the direction change as little as balance allows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from itertools import groupby, pairwise
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.stability import stability
from graspless_pin.holding.verdict import BRIEF_NODE_LIMIT, Holding, StabilityVerdict
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import (
    FloatArray,
    JointUnit,
    check_known,
    choice,
    finite_array,
    motor_torques,
    read_only,
    real_number,
    whole_number,
)
from graspless_pin.problem.quasistatic import checked_problem
from graspless_pin.programs.analysis_objectives import AtTorques, LeastChange
from graspless_pin.programs.objectives import Margin
from graspless_pin.records import Brief
from graspless_pin.scene import Scene
from graspless_pin.solution.tables import from_to

_REST = SolveOptions.parse(static_friction=StaticFriction.COULOMB)
_NO_SQUEEZE = 1e-6
"""Relative to the contact forces: smaller internal forces are no squeeze."""
_LIMIT_SLACK = 1e-6
"""Relative to a limit, or to the load: tolerance of torques at limits, and of negative margins."""
_FRICTION_USED = 0.9
"""Share of the friction coefficients that torques which follow may use, if balance allows it."""
_SHARE_HALVINGS = 8
_MOST_NAMED = 3
_FARTHEST_AMOUNT = 100.0
"""Largest multiple of the direction where no effort limit is reached before."""
_ROUNDING = 1e-3  # of the width, the default precision of ends
_FINEST_END = 1e-6
"""Finest precision of ends, as a share of the range of amounts, however narrow the window is."""


class OtherJoints(StrEnum):
    """Torques of joints that a direction leaves out. See the example of `squeeze_window`."""

    FOLLOW = "follow"
    """Their torques change as little as balance admits."""
    FIXED = "fixed"
    """Their torques stay as they are."""


class EndReason(StrEnum):
    """Why a window of squeeze ends. See the example of `squeeze_window`."""

    LIMIT = "limit"
    """A joint reaches its effort limit, or contact forces theirs."""
    SLIPS = "slips"
    """No contact forces within friction balance the torques."""
    FINGER_MOVES = "finger_moves"
    """A joint moves by itself, in an outcome in which the object stays."""
    MAY_SLIP = "may_slip"
    """Rest is not the only outcome any more."""
    GROWS = "grows"
    """A small motion grows under the controller."""
    UNDECIDED = "undecided"
    """No verdict."""
    SEARCH = "search"
    """It holds in the whole range of amounts."""


_REASONS = {
    Holding.FAILS: EndReason.SLIPS,
    Holding.FINGER_MOVES: EndReason.FINGER_MOVES,
    Holding.MAY_FAIL: EndReason.MAY_SLIP,
    Holding.NEEDS_FEEDBACK: EndReason.GROWS,
    Holding.UNDECIDED: EndReason.UNDECIDED,
}


@dataclass(frozen=True, eq=False)
class WindowEnd:
    """One end of a window of squeeze. See the example of `squeeze_window`.

    Attributes:
        amount: Multiple of the direction up to which the object holds.
        torques: (L,) the motors' torques there, N m (N).
        normal_force: Sum of normal forces there, N: see `SqueezeWindow.normal_forces`.
        reason: Why it ends.
        message: The same in words: the message of the verdict just beyond.
    """

    amount: float
    torques: FloatArray
    normal_force: float
    reason: EndReason
    message: str


@dataclass(frozen=True, eq=False, repr=False)
class SqueezeWindow(Brief):
    """How hard a hand may squeeze. See the example of `squeeze_window`.

    Attributes:
        direction: (L,) change of torques, N m (N).
        lower: The end with less squeeze; None: the given torques do not hold.
        upper: The end with more squeeze; None as above.
        others: Further intervals of amounts in which samples hold, (low, high) each.
        amounts: (K,) multiples of the direction that were sampled, ascending.
        torques: (K, L) the motors' torques there, N m (N).
        normal_forces: (K,) sum of the normal forces of the contacts that joints act on, N; NaN
            where no forces within limits balance the torques. Where torques leave forces open,
            those with the largest margin are used.
        holding: K answers under the controller.
        margins: (K,) margin of these torques, N; NaN where no forces within limits balance them.
        growth: (K,) rate at which a small motion grows, 1/s; NaN where it is not known.
        controller: The controller in words; empty: it is not stated, and the torques are constant.
        message: The message of the verdict on the given torques.
        joint_names: L names of the joints.
        joint_units: L units of their torques.
        of_internal_forces: Whether the direction is that of the internal contact forces.
    """

    direction: FloatArray
    lower: WindowEnd | None
    upper: WindowEnd | None
    others: tuple[tuple[float, float], ...]
    amounts: FloatArray
    torques: FloatArray
    normal_forces: FloatArray
    holding: tuple[Holding, ...]
    margins: FloatArray
    growth: FloatArray
    controller: str
    message: str
    joint_names: tuple[str, ...]
    joint_units: tuple[JointUnit, ...]
    of_internal_forces: bool = False

    @property
    def squeezed(self) -> tuple[int, ...]:
        """Joints of the direction, or if they are many the one with the largest change."""
        moved = np.flatnonzero(self.direction).tolist()
        return (*moved,) if len(moved) <= _MOST_NAMED else (int(np.abs(self.direction).argmax()),)

    @property
    def ends_words(self) -> str:
        """Normal forces and the squeezed joints' torques at both ends in words; empty: none."""
        if self.lower is None or self.upper is None:
            return ""
        pressed = f"{from_to(self.lower.normal_force, self.upper.normal_force, _ROUNDING)} N"
        most = ", which changes most," if np.count_nonzero(self.direction) > _MOST_NAMED else ""
        has = [
            f"joint {self.joint_names[joint]!r}{most} has "
            f"{from_to(self.lower.torques[joint], self.upper.torques[joint], _ROUNDING, '+')} "
            f"{self.joint_units[joint]}"
            for joint in self.squeezed
        ]
        return "; ".join([f"the hand presses with {pressed} (sum of normal forces)", *has])

    def __str__(self) -> str:
        """Return the window, and why it ends."""
        with_what = f" with {self.controller}" if self.controller else ""
        if self.lower is None or self.upper is None:
            lines = [f"the given torques do not hold{with_what}: {self.message}"]
        else:
            unit = "the given direction"
            if self.of_internal_forces:
                unit = "those of the internal forces\n(-1 takes the squeeze away, +1 doubles it)"
            amounts = from_to(self.lower.amount, self.upper.amount, _ROUNDING, "+")
            lines = [
                f"holds{with_what} while torques change by {amounts} times {unit}",
                self.ends_words,
                f"with less: {self.lower.message}",
                f"with more: {self.upper.message}",
            ]
        too = "" if self.lower is None else ", too"
        lines += [f"samples hold from {a:+.3g} to {b:+.3g}{too}" for a, b in self.others]
        return "\n".join(lines)


def squeeze_window(
    subject: Scene | QuasistaticProblem,
    torques: ArrayLike | Mapping[str, float],
    direction: ArrayLike | Mapping[str, float] | None = None,
    *,
    other_joints: OtherJoints | str = OtherJoints.FOLLOW,
    samples: int | Sequence[float] = 12,
    precision: float = 1e-3,
    node_limit: int = BRIEF_NODE_LIMIT,
) -> SqueezeWindow:
    """Find how hard a hand may squeeze at least and at most, and what fails first at either end.

    Torques change along a direction from the given ones. Samples are evaluated first, then each end
    of the window around the given torques is bisected. Every sample has a whole verdict under the
    scene's controller. For a problem made from arrays small motions are known only where contacts
    leave none.

    Args:
        subject: A scene, or a problem; at rest.
        torques: (L,) the motors' torques, or by joint, N m (N).
        direction: (L,) change of torques, or by the names of joints; None: the torques of the
            internal contact forces, those of the rest's forces that balance each other, so that
            the amount -1 takes the squeeze away and 1 doubles it.
        other_joints: Torques of joints without a part in the direction: ``follow`` changes them as
            little as balance admits: the sum of squares, each over the joint's limit, is least,
            with friction up to 0.9 of its coefficient where that is enough; ``fixed`` does not.
            Without a given direction all joints follow.
        samples: Their number on either side of the given torques, or the amounts themselves.
        precision: Of the ends, as a share of the window's width; 1: ends are samples.
        node_limit: Most sets of outcomes that each verdict searches.

    Raises:
        ArgumentError: If an argument is wrong, or there is no internal force and no direction.
        SceneError: See `Scene.contacts`.

    Examples:
        >>> from graspless_pin import Controller, load_scene, squeeze_window
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> torques = scene.solve("torque", margin=0.1).torques
        >>> held = scene.with_changes(controller=Controller(1.0))
        >>> window = squeeze_window(held, torques, samples=4, precision=0.01)
        >>> str(window.lower.reason), str(window.upper.reason)
        ('slips', 'grows')
    """
    problem = subject.problem() if isinstance(subject, Scene) else checked_problem(subject)
    given = motor_torques(problem.joint_names, torques)
    how = choice(OtherJoints, "other_joints", other_joints)
    share = real_number("precision", precision, 0.0)

    @cache
    def verdict_on(changed: tuple[float, ...]) -> StabilityVerdict:
        if isinstance(subject, Scene):
            return subject.stability(changed, node_limit=node_limit)
        return stability(problem, changed, node_limit=node_limit)

    if isinstance(subject, Scene) and subject.controller.holds_joints:
        raise ArgumentError(
            "subject", "has the controller 'position': joint torques have no effect; set it to "
            "'torque' or a stiffness (N m/rad)"
        )  # fmt: skip
    first = verdict_on((*given.tolist(),))
    change = _squeeze_direction(problem, direction, first)
    kept = np.zeros(len(change), dtype=bool) if direction is None else change != 0.0
    if how is OtherJoints.FIXED:
        kept = np.ones(len(change), dtype=bool)
    line = _TorqueLine(problem, given, change, kept, verdict_on)
    low, high = line.amount_range(lowest=-1.0 if direction is None else -np.inf)
    amounts = _sampled_amounts(samples, low, high)
    points = [line.sample_at(amount) for amount in amounts.tolist()]
    middle = int(np.searchsorted(amounts, 0.0))
    lower = upper = None
    if points[middle].holds:
        brackets = [_first_bracket(points[middle::-1]), _first_bracket(points[middle:])]
        lower, upper = _bisected_ends(line, brackets, share, _FINEST_END * (high - low))
    return SqueezeWindow(
        read_only(change),
        lower,
        upper,
        tuple(_other_stretches(points, middle)),
        read_only(amounts),
        read_only(np.array([point.torques for point in points])),
        read_only(np.array([point.normal_force for point in points])),
        tuple(point.verdict.holding for point in points),
        read_only(np.array([point.margin for point in points])),
        read_only(np.array([point.verdict.growth_rate for point in points])),
        first.controller,
        points[middle].failure[1] if not points[middle].holds else first.message,
        problem.joint_names,
        problem.joint_units,
        of_internal_forces=direction is None,
    )


def _sampled_amounts(samples: int | Sequence[float], low: float, high: float) -> FloatArray:
    """Return the amounts to be sampled, ascending, including 0 for the given torques."""
    if not isinstance(samples, Sequence | np.ndarray):
        count = whole_number("samples", samples, 1) + 1
        return np.unique([np.linspace(low, 0.0, count), np.linspace(0.0, high, count)])
    given = finite_array("samples", samples, (len(samples),))
    beyond = given[(given < low) | (given > high)]
    if len(beyond):
        raise ArgumentError(
            "samples", f"has {beyond[0]:g}; effort limits allow amounts from {low:g} to {high:g}"
        )
    return np.unique(np.append(given, 0.0))


@dataclass(frozen=True, eq=False)
class _Sample:
    """One amount, with its torques, verdict and margin."""

    amount: float
    torques: FloatArray
    verdict: StabilityVerdict
    margin: float
    normal_force: float

    @property
    def holds(self) -> bool:
        return self.verdict.holding is Holding.HOLDS and self.margin >= 0.0

    @property
    def failure(self) -> tuple[EndReason, str]:
        """Why it does not hold, and the same in words."""
        if self.verdict.holding is Holding.HOLDS:
            return EndReason.LIMIT, "no contact forces up to max_normal_force balance the torques"
        return _REASONS[self.verdict.holding], self.verdict.message


class _Bracket(NamedTuple):
    """One end of a window: the last sample that holds, and the next, which does not; None: none."""

    good: _Sample
    bad: _Sample | None

    @property
    def width(self) -> float:
        return 0.0 if self.bad is None else abs(self.bad.amount - self.good.amount)


@dataclass(frozen=True, eq=False)
class _TorqueLine:
    """Torques along a direction, evaluated by verdict and margin."""

    problem: QuasistaticProblem
    torques: FloatArray
    direction: FloatArray
    held: NDArray[np.bool_]
    verdict_on: Callable[[tuple[float, ...]], StabilityVerdict]

    def amount_range(self, lowest: float) -> tuple[float, float]:
        """Return the least and the largest amount within the limits of the direction's joints."""
        moves = self.direction != 0.0
        change, torque = self.direction[moves], self.torques[moves]
        lower, upper = self.problem.lower_torque[moves], self.problem.upper_torque[moves]
        amounts = np.concatenate([(upper - torque) / change, (lower - torque) / change])
        high = float(amounts[amounts >= 0.0].min(initial=_FARTHEST_AMOUNT))
        low = float(amounts[amounts <= 0.0].max(initial=-_FARTHEST_AMOUNT))
        return max(low, lowest), high

    def sample_at(self, amount: float) -> _Sample:
        """Evaluate an amount."""
        torques = self.torques + amount * self.direction
        if not self.held.all() and amount != 0.0:
            torques = _torques_that_follow(self.problem, torques, self.held, self.direction)
        # The limits are those of `amount_range`.
        unlimited = self.problem.with_changes(torque_limits=(-np.inf, np.inf))
        best = solve_problem(unlimited, AtTorques(Margin(), torques), _REST)
        margin, pressed = best.margin, np.nan
        if best.found:
            by_joints = self.problem.jacobian.reshape(-1, 3, len(torques)).any(axis=(1, 2))
            normal = (self.problem.normals * best.contact_forces).sum(axis=1)
            pressed = float(normal[by_joints].sum())
        # Torques that follow may be at the boundary of balance: their margin is 0 up to rounding.
        if -_LIMIT_SLACK * self.problem.scales.force < margin < 0.0:
            margin = 0.0
        return _Sample(amount, torques, self.verdict_on((*torques.tolist(),)), margin, pressed)

    def limiting_joint(self, amount: float) -> str:
        """Return the joint that is at its limit at an amount; empty: none is."""
        torques = self.torques + amount * self.direction
        for name, torque, low, high, change in zip(
            self.problem.joint_names, torques, self.problem.lower_torque,
            self.problem.upper_torque, self.direction, strict=True,
        ):  # fmt: skip
            limit = high if amount * change > 0.0 else low
            if change and isfinite(limit) and abs(torque - limit) <= _LIMIT_SLACK * abs(limit):
                return name
        return ""


def _torques_that_follow(
    problem: QuasistaticProblem, torques: FloatArray, kept: NDArray[np.bool_], direction: FloatArray
) -> FloatArray:
    """Return the nearest torques that balance, with some torques kept; unchanged if none balance.

    The least change alone would use up the friction of some contact: a reserve is kept if possible.

    Args:
        problem: The problem; its torque limits are kept.
        torques: (L,) to be changed, N m (N).
        kept: (L,) mask of joints whose torques stay.
        direction: (L,) to which changes are orthogonal, in the norm scaled by the limits.
    """
    lower, upper = problem.lower_torque.copy(), problem.upper_torque.copy()
    lower[kept] = upper[kept] = torques[kept]
    least = LeastChange((*torques.tolist(),), (*direction.tolist(),))

    def with_friction_share(share: float) -> FloatArray | None:
        friction = share * problem.friction
        changed = problem.with_changes(torque_limits=(lower, upper), friction=friction)
        solution = solve_problem(changed, least, _REST)
        return np.where(kept, torques, solution.torques) if solution.found else None

    balanced = with_friction_share(_FRICTION_USED)
    if balanced is not None:
        return balanced
    balanced, (low, high) = with_friction_share(1.0), (_FRICTION_USED, 1.0)
    if balanced is None:
        return torques
    for _ in range(_SHARE_HALVINGS):  # the least share, so that torques do not jump
        middle = 0.5 * (low + high)
        nearer = with_friction_share(middle)
        low, high = (middle, high) if nearer is None else (low, middle)
        balanced = balanced if nearer is None else nearer
    return balanced


def _squeeze_direction(
    problem: QuasistaticProblem,
    given: ArrayLike | Mapping[str, float] | None,
    verdict: StabilityVerdict,
) -> FloatArray:
    """Return the given direction (L,), checked, or the torques of the internal forces."""
    if isinstance(given, Mapping):
        check_known("direction", "joint", given, problem.joint_names)
        given = [given.get(name, 0.0) for name in problem.joint_names]
    if given is not None:
        change = finite_array("direction", given, (problem.joint_count,))
        if not change.any():
            raise ArgumentError("direction", "is zero; give a change of torques")
        return change
    if verdict.rest_forces is None:
        raise ArgumentError(
            "torques",
            f"have no known forces of rest to scale ({verdict.message}); give a direction",
        )
    forces = verdict.rest_forces.ravel()
    inner = forces - np.linalg.lstsq(problem.W, problem.W @ forces, rcond=None)[0]
    change = problem.jacobian.T @ inner
    if np.linalg.norm(inner) <= _NO_SQUEEZE * np.linalg.norm(forces) or not change.any():
        raise ArgumentError("direction", "the contact forces do not squeeze the object; give one")
    return change


def _first_bracket(points: Sequence[_Sample]) -> _Bracket:
    """Return the last sample of the first ones that hold, and the one after it."""
    for last, point in pairwise(points):
        if not point.holds:
            return _Bracket(last, point)
    return _Bracket(points[-1], None)


def _bisected_ends(
    line: _TorqueLine, brackets: list[_Bracket], share: float, finest: float
) -> list[WindowEnd]:
    """Return both ends of a window, bisected to a share of its width.

    Args:
        line: The torques along the direction.
        brackets: Brackets of the lower and the upper end; they are narrowed.
        share: Of the window's width; from 1 on brackets stay as they are.
        finest: Least width of a bracket, however narrow the window is.
    """
    while share < 1.0:
        # The window grows while its ends are bisected: the wider bracket first.
        side = max(range(len(brackets)), key=lambda index: brackets[index].width)
        good, bad = brackets[side].good, brackets[side].bad
        inside = brackets[1].good.amount - brackets[0].good.amount
        if bad is None or brackets[side].width <= max(share * inside, finest):
            break
        middle = line.sample_at(0.5 * (good.amount + bad.amount))
        brackets[side] = _Bracket(middle, bad) if middle.holds else _Bracket(good, middle)
    return [_window_end(line, bracket) for bracket in brackets]


def _window_end(line: _TorqueLine, bracket: _Bracket) -> WindowEnd:
    """Return the end of a window from its bracket."""
    last, ends = bracket.good, (EndReason.SEARCH, "holds in the whole range searched")
    if bracket.bad is not None:
        ends = bracket.bad.failure
    elif joint := line.limiting_joint(last.amount):
        ends = EndReason.LIMIT, f"joint {joint!r} is at its effort limit"
    return WindowEnd(last.amount, read_only(last.torques), last.normal_force, *ends)


def _other_stretches(points: list[_Sample], middle: int) -> list[tuple[float, float]]:
    """Return the intervals in which samples hold, without that around the given torques."""
    runs = groupby(range(len(points)), key=lambda index: points[index].holds)
    stretches = [[*run] for holds, run in runs if holds]
    return [
        (points[run[0]].amount, points[run[-1]].amount) for run in stretches if middle not in run
    ]
