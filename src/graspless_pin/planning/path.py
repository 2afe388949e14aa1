"""Margins and torques along a path of hand configurations and object poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import as_pose
from graspless_pin.holding.verdict import StabilityKeywords, StabilityVerdict
from graspless_pin.planning.configurations import Configuration
from graspless_pin.planning.edges import segment_twist
from graspless_pin.planning.evaluation import Evaluation, StateStatus
from graspless_pin.planning.evaluator import Evaluator
from graspless_pin.planning.many_states import state_positions
from graspless_pin.problem.checks import FloatArray, JointUnit, finite_array, read_only
from graspless_pin.records import Brief
from graspless_pin.scene import Scene
from graspless_pin.solution.tables import brief_figure, with_noun

PATH_REGULARIZATION = 1e-4
"""Makes torques continuous; costs the paper's cuboid 1e-5 N of 1.65 N of margin."""
_SAME_MOTION = 1e-6
"""Twists whose directions differ by less are the same: the step between two poses is rounded."""


@dataclass(frozen=True, eq=False)
class Waypoint:
    """One state on a path; values that are None are as in the scene.

    Attributes:
        q: Hand configuration as `Evaluator.evaluate` takes it, rad or m.
        T_world_object: (4, 4) pose of the object, m.
        time: Time at which it is passed, s; None for all waypoints: one second for each segment.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> profile.found, profile.margins.round(3).tolist()
        (True, [1.131, 1.131])
    """

    q: Configuration | None = None
    T_world_object: ArrayLike | None = None
    time: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class PathProfile(Brief):
    """Margins and torques at the K waypoints of a path. See the example of `evaluate_path`.

    Attributes:
        hand: The hand that moves, in the scene's configuration; None without one.
        times: (K,) s, strictly increasing.
        position_names: a joints of `positions`.
        positions: (K, a) of the hand's independent joints, rad or m.
        object_poses: (K, 4, 4) ``T_world_object``, m.
        twists: (K, 6) [v; omega] of the object about its centre of mass, m/s and rad/s, world axes:
            of the segment that begins at the waypoint; at the last one, of the one that ends.
        evaluations: K answers with these twists.
        arrivals: K answers with the twists of the segments that end at the waypoints; those of
            ``evaluations`` where the direction does not change, or the motion ends by touching.
        torque_names: L names of all torques that occur.
        torque_units: L units.
        torques: (K, L) motor torques, N m (N for prismatic and hybrid joints, tendons); NaN where
            there are none.
        margins: (K,) N, -inf where there are no torques.
        arrival_margins: (K,) the same of ``arrivals``.
        contact_changes: Where contacts appear, vanish, start or stop sliding.
    """

    hand: Hand | None
    times: FloatArray
    position_names: tuple[str, ...]
    positions: FloatArray
    object_poses: FloatArray
    twists: FloatArray
    evaluations: tuple[Evaluation, ...]
    arrivals: tuple[Evaluation, ...]
    torque_names: tuple[str, ...]
    torque_units: tuple[JointUnit, ...]
    torques: FloatArray
    margins: FloatArray
    arrival_margins: FloatArray
    contact_changes: tuple[ContactChange, ...]

    @property
    def found(self) -> bool:
        """Whether there are torques at every waypoint, in both motions that meet there."""
        return not self.failures

    @property
    def smallest_margin(self) -> float:
        """The smallest margin of all waypoints and both motions, N; -inf if one has no torques."""
        return float(min(self.margins.min(), self.arrival_margins.min()))

    @property
    def failures(self) -> tuple[int, ...]:
        """Waypoints that are not feasible in one of the motions that meet there.

        There are no torques, or the state has a serious finding, see `Evaluator`.
        """
        both = zip(self.evaluations, self.arrivals, strict=True)
        return tuple(k for k, pair in enumerate(both) if not all(item.found for item in pair))

    def failure_reason(self, waypoint: int) -> str:
        """Return why a waypoint has no torques; empty if it has some."""
        return self.arrivals[waypoint].reason or self.evaluations[waypoint].reason

    def verdicts(self, **options: Unpack[StabilityKeywords]) -> tuple[StabilityVerdict | None, ...]:
        """Return a verdict for each waypoint; None where there are no torques.

        Args:
            options: Of `graspless_pin.stability`.
        """
        return tuple(item.stability(**options) if item.found else None for item in self.evaluations)

    def __str__(self) -> str:
        """Return a summary, with a line for each contact change and each failure."""
        summary = "not feasible"
        if self.found:
            largest = float(np.abs(self.margins).max())
            summary = f"smallest margin {brief_figure(self.smallest_margin, largest)} N"
        points = with_noun(len(self.times), "waypoint")
        lines = [f"a path of {self.times[-1] - self.times[0]:g} s, {points}, {summary}"]
        for change in self.contact_changes:
            parts = [
                f"{verb} {_counted_names(names)}"
                for verb, names in (
                    ("gains", change.gained),
                    ("loses", change.lost),
                    ("starts to slide on", change.starts_sliding),
                    ("stops sliding on", change.stops_sliding),
                )
                if names
            ]
            lines.append(f"at {self.times[change.waypoint]:g} s: {'; '.join(parts)}")
        lines += [
            f"at {self.times[k]:g} s: no torques at waypoint {k}, {self.failure_reason(k)}"
            for k in self.failures
        ]
        return "\n".join(lines)


def evaluate_path(
    evaluator: Evaluator | Scene,
    waypoints: Sequence[Waypoint | Configuration],
    *,
    regularization: float = PATH_REGULARIZATION,
) -> PathProfile:
    """Evaluate every waypoint of a path, moving as the path moves.

    The object's twist at a waypoint is that of the screw motion to the next waypoint, which decides
    which contacts slide, stick and part; fingers move along with the object. A change of the motion
    needs a waypoint of its own, which is solved for both motions: torques are those of the one that
    follows, the smallest margin is the smaller of both.

    Args:
        evaluator: An evaluator, or a scene for one with the scene's own options.
        waypoints: At least one; a configuration stands for a waypoint without a time.
        regularization: Epsilon of the QP, see `maximize_margin`; it replaces the evaluator's. Of
            equally good torques the QP picks those with the smallest contact forces, so that
            torques are continuous as long as the contacts are. 0 solves the bare LPs.

    Returns:
        The profile; a waypoint without torques is part of it.

    Raises:
        ArgumentError: If there is no waypoint, only some have a time, times do not increase, or a
            configuration or pose is wrong.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> profile.found, profile.margins.round(3).tolist()
        (True, [1.131, 1.131])
    """
    if isinstance(evaluator, Scene):
        evaluator = Evaluator(evaluator)
    if not isinstance(evaluator, Evaluator):
        raise ArgumentError("evaluator", f"needs an Evaluator or a Scene, got {evaluator!r:.60}")
    if evaluator.attached_to is not None:
        raise ArgumentError(
            "evaluator",
            f"is attached_to link {evaluator.attached_to!r}, which paths do not support; call its "
            "evaluate_many with the path's configurations",
        )
    evaluator = evaluator.with_regularization(regularization)
    if isinstance(waypoints, Mapping | str) or not np.iterable(waypoints):
        raise ArgumentError("waypoints", f"must be a list of waypoints, got {waypoints!r:.60}")
    if not len(waypoints):
        raise ArgumentError("waypoints", "is empty; give at least one")
    waypoints = [item if isinstance(item, Waypoint) else Waypoint(item) for item in waypoints]
    times = _waypoint_times(waypoints)
    own = evaluator.scene.object.T_world_object
    given = [own if item.T_world_object is None else item.T_world_object for item in waypoints]
    poses = np.array([as_pose(f"waypoints[{k}].T_world_object", T) for k, T in enumerate(given)])
    named = [(f"waypoints[{k}].q", item.q) for k, item in enumerate(waypoints)]
    positions = np.array([state_positions(evaluator.configuration, *pair) for pair in named])
    arriving, twists = _waypoint_twists(poses, times, evaluator.scene.object.center_of_mass)
    evaluations, arrivals = [], []
    for item, pose, before, after in zip(waypoints, poses, arriving, twists, strict=True):
        arrival = evaluator.evaluate(item.q, pose, before)
        goes_on = _is_same_motion(before, after)
        departure = arrival if goes_on else evaluator.evaluate(item.q, pose, after)
        evaluations.append(departure)
        # A motion that ends by touching a body is not driven into it.
        arrivals.append(departure if arrival.status is StateStatus.BLOCKED else arrival)
    units = {name: unit for item in evaluations for name, unit in item.joint_units.items()}
    names = tuple(units)
    torques = np.full((len(waypoints), len(names)), np.nan)
    for row, item in zip(torques, evaluations, strict=True):
        if item.found:
            row[[names.index(name) for name in item.joint_names]] = item.torques
    return PathProfile(
        hand=evaluator.scene.hand,
        times=read_only(times),
        position_names=evaluator.joint_names,
        positions=read_only(positions),
        object_poses=read_only(poses),
        twists=read_only(twists),
        evaluations=tuple(evaluations),
        arrivals=tuple(arrivals),
        torque_names=names,
        torque_units=tuple(units.values()),
        torques=read_only(torques),
        margins=read_only(np.array([item.margin for item in evaluations])),
        arrival_margins=read_only(np.array([item.margin for item in arrivals])),
        contact_changes=contact_changes(evaluations),
    )


def _waypoint_times(waypoints: Sequence[Waypoint]) -> FloatArray:
    given = [item.time for item in waypoints if item.time is not None]
    if not given:
        return np.arange(len(waypoints), dtype=float)
    if len(given) < len(waypoints):
        raise ArgumentError(
            "waypoints",
            f"{len(given)} of {len(waypoints)} have a time; give times for all of them or none",
        )
    times = finite_array("waypoints", given, (len(given),)).copy()
    steps = np.diff(times)
    if (steps <= 0.0).any():
        k = int(np.argmax(steps <= 0.0))
        raise ArgumentError(
            "waypoints",
            f"{k} and {k + 1} have the times {times[k]:g} and {times[k + 1]:g} s; times must "
            "increase",
        )
    return times


def _waypoint_twists(
    poses: FloatArray, times: FloatArray, center_of_mass: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (K, 6) twists before and (K, 6) after the waypoints, about the centre of mass.

    Both are the same at the first and at the last waypoint.
    """
    before, after = np.zeros((2, len(poses), 6))
    for k in range(len(poses) - 1):
        duration = times[k + 1] - times[k]
        after[k] = segment_twist(poses[k], poses[k + 1], duration, center_of_mass)
        # The same screw motion backwards from its end.
        before[k + 1] = -segment_twist(poses[k + 1], poses[k], duration, center_of_mass)
    before[0], after[-1] = after[0], before[-1]
    return before, after


def _is_same_motion(before: FloatArray, after: FloatArray) -> bool:
    """Return whether two twists have the same direction up to rounding, or both are zero."""
    sizes = np.linalg.norm(before), np.linalg.norm(after)
    if not all(sizes):
        return not any(sizes)
    return bool(np.abs(before / sizes[0] - after / sizes[1]).max() <= _SAME_MOTION)


def _counted_names(names: Sequence[str]) -> str:
    return ", ".join(
        name if count == 1 else f"{name} x {count}" for name, count in Counter(names).items()
    )


@dataclass(frozen=True)
class ContactChange:
    """The difference of the contacts at a waypoint from those at the one before.

    Torques may jump here, and only here. See the example of `evaluate_path`.

    Attributes:
        waypoint: Index of the waypoint with the new contacts.
        gained: Hand links and supports, one name for each new contact.
        lost: The same for each contact that no longer exists.
        starts_sliding: The same for each contact that starts sliding.
        stops_sliding: The same for each contact that stops sliding.
    """

    waypoint: int
    gained: tuple[str, ...]
    lost: tuple[str, ...]
    starts_sliding: tuple[str, ...]
    stops_sliding: tuple[str, ...]


def contact_changes(evaluations: Sequence[Evaluation]) -> tuple[ContactChange, ...]:
    """Return the changes of contacts between waypoints that follow each other."""
    changes = []
    before = _contact_counts(evaluations[0])
    for k, evaluation in enumerate(evaluations[1:], start=1):
        now = _contact_counts(evaluation)
        if now != before:
            changes.append(
                ContactChange(
                    k,
                    gained=_surplus_names(now[0], before[0]),
                    lost=_surplus_names(before[0], now[0]),
                    starts_sliding=_surplus_names(now[1], before[1]),
                    stops_sliding=_surplus_names(before[1], now[1]),
                )
            )
        before = now
    return tuple(changes)


def _contact_counts(evaluation: Evaluation) -> tuple[Counter[str], Counter[str]]:
    """Return the numbers of contacts by body, and of those that slide."""
    if not evaluation.has_contacts:
        return Counter(), Counter()
    contacts = evaluation.contacts
    sliding = [
        name
        for name, velocity in zip(contacts.bodies, contacts.sliding, strict=True)
        if velocity.any()
    ]
    return Counter(contacts.bodies), Counter(sliding)


def _surplus_names(some: Counter[str], others: Counter[str]) -> tuple[str, ...]:
    return tuple((some - others).elements())
