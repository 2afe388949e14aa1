"""Margins and torques along a path of hand configurations and object poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import as_pose
from graspless_pin.planning.configurations import Configuration
from graspless_pin.planning.evaluation import Evaluation
from graspless_pin.planning.evaluator import Evaluator
from graspless_pin.planning.screws import segment_twist
from graspless_pin.problem.checks import FloatArray, finite_array, read_only
from graspless_pin.scene import Scene

PATH_REGULARIZATION = 1e-4
"""Enough to make torques continuous; costs the paper's cuboid 1e-5 N of 1.65 N of margin."""


@dataclass(frozen=True, eq=False)
class Waypoint:
    """One state on a path; what is None is as in the scene.

    Attributes:
        q: Hand configuration as `Evaluator.evaluate` takes it, rad or m.
        T_world_object: (4, 4) pose of the object, m.
        time: When it is passed, s; None for all waypoints: one second for each segment.
    """

    q: Configuration | None = None
    T_world_object: ArrayLike | None = None
    time: float | None = None


@dataclass(frozen=True)
class ContactChange:
    """How the contacts of a waypoint differ from those of the one before.

    Torques may jump here, and only here.

    Attributes:
        waypoint: Index of the waypoint with the new contacts.
        gained: Hand links and supports, a name for each contact that was not there.
        lost: The same for contacts that are gone.
        starts_sliding: The same for contacts that slide now and did not.
        stops_sliding: The same for contacts that slid and do not now.
    """

    waypoint: int
    gained: tuple[str, ...]
    lost: tuple[str, ...]
    starts_sliding: tuple[str, ...]
    stops_sliding: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PathProfile:
    """What was found at the K waypoints of a path.

    Attributes:
        hand: The hand that moves, in the scene's configuration; None without one.
        times: (K,) s, strictly increasing.
        position_names: a joints of `positions`.
        positions: (K, a) of the hand's independent joints, rad or m.
        object_poses: (K, 4, 4) ``T_world_object``, m.
        twists: (K, 6) [v; omega] of the object about its centre of mass, m/s and rad/s, world axes:
            of the segment that begins at the waypoint; at the last one, of the one that ends.
        evaluations: K answers.
        torque_names: L names of all torques that occur.
        torques: (K, L) motor torques, N m (N for linear and hybrid joints and tendons); NaN where
            there are none.
        margins: (K,) N, -inf where there are no torques.
        contact_changes: Where contacts appear, vanish, begin or cease to slide.
    """

    hand: Hand | None
    times: FloatArray
    position_names: tuple[str, ...]
    positions: FloatArray
    object_poses: FloatArray
    twists: FloatArray
    evaluations: tuple[Evaluation, ...]
    torque_names: tuple[str, ...]
    torques: FloatArray
    margins: FloatArray
    contact_changes: tuple[ContactChange, ...]

    @property
    def found(self) -> bool:
        """Whether there are torques at every waypoint."""
        return all(evaluation.found for evaluation in self.evaluations)

    @property
    def smallest_margin(self) -> float:
        """The smallest margin of all waypoints, N; -inf if one has no torques."""
        return float(self.margins.min())

    @property
    def failures(self) -> tuple[int, ...]:
        """Waypoints without torques."""
        return tuple(k for k, evaluation in enumerate(self.evaluations) if not evaluation.found)

    def __str__(self) -> str:
        """Return a short account, a line for each thing that happens."""
        lines = [
            f"{len(self.times)} waypoints in {self.times[-1] - self.times[0]:g} s, "
            f"smallest margin {self.smallest_margin:.4g} N"
        ]
        for change in self.contact_changes:
            parts = [
                f"{verb} {_counted(names)}"
                for verb, names in (
                    ("gains", change.gained),
                    ("loses", change.lost),
                    ("begins to slide on", change.starts_sliding),
                    ("ceases to slide on", change.stops_sliding),
                )
                if names
            ]
            lines.append(f"at {self.times[change.waypoint]:g} s: {'; '.join(parts)}")
        lines += [
            f"at {self.times[k]:g} s: no torques, {self.evaluations[k].reason}"
            for k in self.failures
        ]
        return "\n".join(lines)


def evaluate_path(
    evaluator: Evaluator | Scene,
    waypoints: Sequence[Waypoint],
    *,
    regularization: float = PATH_REGULARIZATION,
) -> PathProfile:
    """Evaluate every waypoint of a path, moving as the path moves.

    The object's twist at a waypoint is that of the screw motion to the next waypoint, so contacts
    slide, stick and part as the path says; fingers move along with the object. A change from one
    kind of motion to another needs a waypoint of its own: there the motion that follows counts.

    Args:
        evaluator: An evaluator, or a scene for one with the scene's own options.
        waypoints: At least one.
        regularization: Epsilon of the QP, see `maximize_margin`; it replaces the evaluator's. Of
            equally good torques the QP picks those with the smallest contact forces, so that
            torques are continuous as long as the contacts are. 0 solves the bare LPs.

    Returns:
        The profile; a waypoint without torques is part of it.

    Raises:
        ArgumentError: If there is no waypoint, only some have a time, times do not increase, or a
            configuration or pose is wrong.
    """
    if isinstance(evaluator, Scene):
        evaluator = Evaluator(evaluator)
    evaluator = evaluator.with_regularization(regularization)
    if not len(waypoints):
        raise ArgumentError("waypoints", "is empty; a path has at least one")
    times = _times(waypoints)
    poses = np.array([_pose(evaluator.scene, k, item) for k, item in enumerate(waypoints)])
    twists = _twists(poses, times, evaluator.scene.object.center_of_mass)
    evaluations = tuple(
        evaluator.evaluate(item.q, pose, twist)
        for item, pose, twist in zip(waypoints, poses, twists, strict=True)
    )
    names = tuple(dict.fromkeys(name for item in evaluations for name in item.joint_names))
    torques = np.full((len(waypoints), len(names)), np.nan)
    for row, item in zip(torques, evaluations, strict=True):
        if item.found:
            row[[names.index(name) for name in item.joint_names]] = item.torques
    return PathProfile(
        hand=evaluator.scene.hand,
        times=read_only(times),
        position_names=evaluator.joint_names,
        positions=read_only(np.array([evaluator.configuration(item.q) for item in waypoints])),
        object_poses=read_only(poses),
        twists=read_only(twists),
        evaluations=evaluations,
        torque_names=names,
        torques=read_only(torques),
        margins=read_only(np.array([item.margin for item in evaluations])),
        contact_changes=_changes(evaluations),
    )


def _times(waypoints: Sequence[Waypoint]) -> FloatArray:
    given = [item.time for item in waypoints if item.time is not None]
    if not given:
        return np.arange(len(waypoints), dtype=float)
    if len(given) < len(waypoints):
        raise ArgumentError(
            "waypoints",
            f"{len(given)} of {len(waypoints)} have a time; give one to all of them or to none",
        )
    times = finite_array("waypoints", given, (len(given),)).copy()
    steps = np.diff(times)
    if (steps <= 0.0).any():
        k = int(np.argmax(steps <= 0.0))
        raise ArgumentError(
            "waypoints",
            f"have the times {times[k]:g} and {times[k + 1]:g} s at {k} and {k + 1}; times must "
            "increase",
        )
    return times


def _pose(scene: Scene, index: int, waypoint: Waypoint) -> FloatArray:
    if waypoint.T_world_object is None:
        return scene.object.T_world_object
    return as_pose(f"waypoints[{index}].T_world_object", waypoint.T_world_object)


def _twists(poses: FloatArray, times: FloatArray, center_of_mass: FloatArray) -> FloatArray:
    """(K, 6) twists of the segments after the waypoints, about the centre of mass."""
    twists = np.zeros((len(poses), 6))
    for k in range(len(poses) - 1):
        twists[k] = segment_twist(poses[k], poses[k + 1], times[k + 1] - times[k], center_of_mass)
    if len(poses) > 1:
        # The same screw motion backwards from the end.
        back = segment_twist(poses[-1], poses[-2], times[-1] - times[-2], center_of_mass)
        twists[-1] = -back
    return twists


def _changes(evaluations: Sequence[Evaluation]) -> tuple[ContactChange, ...]:
    changes = []
    before = _touching(evaluations[0])
    for k, evaluation in enumerate(evaluations[1:], start=1):
        now = _touching(evaluation)
        change = ContactChange(
            k,
            gained=_more(now[0], before[0]),
            lost=_more(before[0], now[0]),
            starts_sliding=_more(now[1], before[1]),
            stops_sliding=_more(before[1], now[1]),
        )
        if now != before:
            changes.append(change)
        before = now
    return tuple(changes)


def _touching(evaluation: Evaluation) -> tuple[Counter[str], Counter[str]]:
    """Contacts by body, and those of them that slide."""
    if not evaluation.has_contacts:
        return Counter(), Counter()
    contacts = evaluation.contacts
    sliding = [
        name
        for name, velocity in zip(contacts.bodies, contacts.sliding, strict=True)
        if velocity.any()
    ]
    return Counter(contacts.bodies), Counter(sliding)


def _more(some: Counter[str], others: Counter[str]) -> tuple[str, ...]:
    return tuple((some - others).elements())


def _counted(names: Sequence[str]) -> str:
    return ", ".join(
        name if count == 1 else f"{name} x {count}" for name, count in Counter(names).items()
    )
