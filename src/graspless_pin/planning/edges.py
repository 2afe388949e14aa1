"""Validity of states, and of motions between two states: the edges of a planner.

Between two poses the object follows a screw motion: a rotation about an axis with a translation
along it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.bounds import LARGEST
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.poses import as_pose, rigid, screw_twist, transformed, twist_transform
from graspless_pin.geometry.posing.overlaps import least_clearance
from graspless_pin.planning.attached_states import AttachedConfigurations
from graspless_pin.planning.configurations import Configuration
from graspless_pin.planning.evaluation import StateStatus
from graspless_pin.planning.state_solver import PosedScene, StateSolver
from graspless_pin.problem.checks import FloatArray, finite_array, read_only, real_number
from graspless_pin.records import Brief
from graspless_pin.scene.entry_findings import object_radius_bound

_NO_BODIES = PlacedBodies.of(())


@dataclass(frozen=True, eq=False, repr=False)
class StateValidity(Brief):
    """Whether a state is valid, with margin, clearance and distances to joint limits.

    Attributes:
        reasons: All reasons why the state is not valid; none where it is.
        message: The same in words, with names and figures, a line for each reason.
        margin: The largest margin within the torque limits, N; -inf where no torques hold the
            object, NaN where no margin is required.
        clearance: Least distance of bodies that shall not touch, m, negative where they overlap;
            infinite where there are no such bodies. See `Evaluator.validity`.
        closest: The names of these two bodies; empty where there are none.
        joint_names: The a joints of a configuration.
        joint_units: ``rad`` or ``m`` of each.
        joint_distances: (a,) distance of each joint from its nearer limit, rad or m; negative
            outside, infinite without limits.

    Examples:
        >>> from graspless_pin import Evaluator, load_scene
        >>> evaluator = Evaluator(load_scene("examples/allegro_box_on_slope.yaml"))
        >>> print(evaluator.validity({"joint_1.0": 1.7}, margin=0.2))  # rad
        not valid:
        q['joint_1.0']: is 1.7, outside the joint's limits [-0.196, 1.61] rad (-11.23 to 92.25 deg)
        margin 0.7166 N
        clearance 2.39 mm, 'palm_link' and 'link_1.0'
        joint 'joint_1.0' is nearest to its limits, -0.09 rad
    """

    reasons: tuple[StateStatus, ...]
    message: str
    margin: float
    clearance: float
    closest: tuple[str, ...]
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    joint_distances: FloatArray

    @property
    def valid(self) -> bool:
        """Whether there is no reason against the state."""
        return not self.reasons

    def __str__(self) -> str:
        """Return whether it is valid, why not, and the figures."""
        lines = ["valid"] if self.valid else ["not valid:", self.message]
        if not np.isnan(self.margin):
            lines.append(f"margin {self.margin:.4g} N")
        if self.closest:
            names = " and ".join(map(repr, self.closest))
            lines.append(f"clearance {1e3 * self.clearance:.2f} mm between {names}")
        if len(self.joint_names):
            nearest = int(np.argmin(self.joint_distances))
            lines.append(
                f"joint {self.joint_names[nearest]!r} is nearest to its limits, "
                f"distance {self.joint_distances[nearest]:.4g} {self.joint_units[nearest]}"
            )
        return "\n".join(lines)


def required_margin(margin: float | None, own: float) -> float:
    """Return the required margin, N; None: the evaluator's own; -inf: none is required.

    Raises:
        ArgumentError: If it is negative or no number.
    """
    if margin is None:
        return own
    if type(margin) is float and 0.0 <= margin <= LARGEST:  # of each state of a planner
        return margin
    return -np.inf if margin == -np.inf else real_number("margin", margin, 0.0)


def state_validity(
    solver: StateSolver, q: Any, T_world_object: Any, twist: Any, required: float
) -> StateValidity:
    """Return the validity of a state: see `Evaluator.validity`."""
    at, needs_margin = solver.configurations, required >= 0.0
    scene, problem, first_faults = solver.posed_scene(
        q, T_world_object, twist, solve=needs_margin, whole=True
    )
    faults, margin = list(first_faults), -np.inf if needs_margin else np.nan
    if problem is not None:
        margin, status = solver.margin_of(scene, problem, required)
        if status is StateStatus.BELOW_MARGIN:
            text = f"the largest margin is {margin:.4g} N, below the required {required:.4g} N"
            faults.append((status, text))
        elif status is not StateStatus.FOUND:
            faults.append((status, status.message))
    # With given contacts the object's clearance is not computed.
    moved = scene.object.placed_bodies if scene.given_contacts is None else _NO_BODIES
    depth, gap = scene.max_penetration, scene.contact_tolerance
    nearest = least_clearance(scene.hand, scene.supports, moved, depth, gap)
    values, (lower, upper) = at.array({} if q is None else q), at.joint_limits
    return StateValidity(
        reasons=tuple(dict.fromkeys(status for status, _ in faults)),
        message="\n".join(text for _, text in faults),
        margin=margin,
        clearance=nearest.distance,
        closest=nearest.bodies,
        joint_names=at.joint_names,
        joint_units=at.joint_units,
        joint_distances=read_only(np.minimum(values - lower, upper - values)),
    )


_STILL_STEP = 1e-9
"""Steps shorter than this, m and rad, are rounding."""


class ScrewMotion(NamedTuple):
    """The screw motion of a body between two poses, in one second.

    Attributes:
        T_from: (4, 4) pose at the start, m.
        T_to: (4, 4) pose at the end.
        center_of_mass: (3,) in the body's frame, m.
        start_twist: (6,) [v; omega] at the start, see `segment_twist`.
    """

    T_from: FloatArray
    T_to: FloatArray
    center_of_mass: FloatArray
    start_twist: FloatArray

    @classmethod
    def between(
        cls, T_from: FloatArray, T_to: FloatArray, center_of_mass: FloatArray
    ) -> ScrewMotion:
        """Return the motion between two poses, see `segment_twist`."""
        twist = segment_twist(T_from, T_to, 1.0, center_of_mass)
        return cls(T_from, T_to, center_of_mass, twist)

    @property
    def lengths(self) -> tuple[float, float]:
        """Length of the twist's translation of the centre of mass, m, and its rotation, rad."""
        velocity, turn = np.split(self.start_twist, 2)
        return float(np.linalg.norm(velocity)), float(np.linalg.norm(turn))

    def pose_and_twist(self, fraction: float) -> tuple[FloatArray, FloatArray]:
        """Return the (4, 4) pose and the (6,) twist at a fraction of the way.

        Args:
            fraction: 0 at the start, 1 at the end.
        """
        moved = twist_transform(fraction * self.start_twist)
        R, step = moved[:3, :3], moved[:3, 3]
        velocity, turn = np.split(self.start_twist, 2)
        twist = np.concatenate([velocity + np.cross(turn, step), turn])
        if fraction in (0.0, 1.0):
            return (self.T_to if fraction else self.T_from), twist
        R = R @ self.T_from[:3, :3]
        center = transformed(self.T_from, self.center_of_mass) + step
        return rigid(center - R @ self.center_of_mass, R), twist


def segment_twist(
    T_from: FloatArray, T_to: FloatArray, duration: float, center_of_mass: FloatArray
) -> FloatArray:
    """Return the twist at the start of the screw motion from one pose to another.

    Poses on one turn about a fixed axis, such as an edge, give exactly that turn.

    Args:
        T_from: (4, 4) pose at the start, m.
        T_to: (4, 4) pose at the end; turned by less than half a turn.
        duration: s, > 0.
        center_of_mass: (3,) in the body's frame, m.

    Returns:
        (6,) [v; omega] about the centre of mass where it is at the start, world axes, m/s and
        rad/s; zeros if the body stays where it is.
    """
    R = T_to[:3, :3] @ T_from[:3, :3].T
    # Displacement of the centre of mass: the screw seen from there.
    step = transformed(T_to, center_of_mass) - transformed(T_from, center_of_mass)
    twist = screw_twist(rigid(step, R))
    if max(np.linalg.norm(step), np.linalg.norm(twist[3:])) <= _STILL_STEP:
        return np.zeros(6)
    return twist / duration


RESOLUTION = 1e-3, 0.01
"""m, rad."""
_COARSE_STEP = 8
"""Distance of states in resolutions where contacts are the same."""


@dataclass(frozen=True, eq=False, repr=False)
class MotionFault(Brief):
    """The first invalid state of a motion between two states, see `Evaluator.first_invalid`.

    Attributes:
        fraction: Its fraction of the motion, 0 to 1.
        validity: Its validity, with the twist of the motion there.
        last_valid: Fraction of the last valid state, at most the resolution before; None: the first
            state of the motion is not valid.

    Examples:
        >>> import numpy as np
        >>> from graspless_pin import Evaluator, load_scene
        >>> evaluator = Evaluator(load_scene("examples/trihand_push_box.yaml"))
        >>> ahead = evaluator.scene.object.T_world_object + np.eye(4, k=3) * 0.02  # m along x
        >>> fault = evaluator.first_invalid(T1_world_object=ahead, margin=0.1)
        >>> print(f"{fault.fraction:.2f}: {fault.validity.message.splitlines()[0]}")
        0.08: no link of the hand touches object 'box'
    """

    fraction: float
    validity: StateValidity
    last_valid: float | None

    def __str__(self) -> str:
        """Return where the motion is not valid, and why."""
        before = "" if self.last_valid is None else f", valid up to {self.last_valid:.3g}"
        return f"at {self.fraction:.3g} of the way{before}: {self.validity}"


@dataclass(frozen=True, eq=False, repr=False)
class MotionMargins(Brief):
    """Margins along a motion between two states, see `Evaluator.motion_margins`.

    See the example of `MotionFault`.

    Attributes:
        fractions: (K,) of the motion, increasing from 0; the last is 1 where the motion is valid; 0
            alone where nothing moves.
        margins: (K,) largest margins there, N; the last is -inf where the motion is not valid.
    """

    fractions: FloatArray
    margins: FloatArray

    @property
    def smallest(self) -> float:
        """The smallest margin, N; -inf where the motion is not valid."""
        return float(self.margins.min())


class EdgeState(NamedTuple):
    """A state on an edge.

    Attributes:
        fraction: Of the motion, 0 to 1.
        valid: Whether it is valid.
        contacts: Key of the touching bodies and of which contacts slide: equal only if the contacts
            are the same.
        query: The arguments of `Evaluator.evaluate` for this state.
        posed: Its scene and problem; None for an object that moves with a link: its contacts are
            constant, and only the validity is computed.
    """

    fraction: float
    valid: bool
    contacts: tuple[Any, ...]
    query: tuple[FloatArray, FloatArray | None, FloatArray | None]
    posed: PosedScene | None = None


class Edge:
    """The motion between two states, with the states on it that have been evaluated.

    Attributes:
        narrow: The resolution as a share of the motion, infinite where nothing moves.
    """

    def __init__(
        self,
        solver: StateSolver,
        configurations: tuple[Configuration | None, Configuration | None],
        poses: tuple[Any, Any],
        required: float,
        resolution: tuple[float, float],
    ) -> None:
        """Prepare the motion: see `Evaluator.first_invalid`.

        Args:
            solver: Evaluates states.
            configurations: At the start and at the end.
            poses: Likewise.
            required: The required margin, N; -inf: none.
            resolution: m and rad.
        """
        self._solver, self._required = solver, required
        at, moved = solver.configurations, solver.configurations.scene.object
        self._start, end = (at.array({} if q is None else q) for q in configurations)
        self._move = end - self._start
        first, last = poses
        self._carried = isinstance(at, AttachedConfigurations)
        for given in poses:
            if self._carried and given is not None:
                at.scene_at(None, given, None)  # raises an error: q alone determines the pose
        T0 = moved.T_world_object if first is None else as_pose("T0_world_object", first)
        T1 = T0 if last is None else as_pose("T1_world_object", last)
        self._screw = ScrewMotion.between(T0, T1, moved.center_of_mass)
        steps = finite_array("resolution", resolution, (2,))
        if (steps <= 0.0).any():
            raise ArgumentError(
                "resolution", f"is {steps}; it must be two positive numbers, m and rad"
            )
        units = np.where(np.array(at.joint_units) == "m", *steps) if at.joint_units else 1.0
        shares = np.concatenate([np.array(self._screw.lengths) / steps, np.abs(self._move) / units])
        self._count = math.ceil(shares.max() / _COARSE_STEP)
        self.narrow = 1.0 / shares.max() if self._count else np.inf
        self._seen: dict[float, EdgeState] = {}

    def state(self, fraction: float) -> EdgeState:
        """Return the state at a fraction of the motion; each is evaluated once."""
        state = self._seen.get(fraction)
        if state is None:
            state = self._seen[fraction] = self._evaluated_state(fraction)
        return state

    def states(self) -> Iterator[EdgeState]:
        """Yield states in order, up to the first that is not valid.

        They are closer together where contacts change, and before the first invalid state.
        """
        before = self.state(0.0)
        yield before
        for step in range(1, self._count + 1):
            if not before.valid:
                return
            for state in self._states_up_to(before, self.state(step / self._count)):
                before = state
                yield state

    def _states_up_to(self, before: EdgeState, after: EdgeState) -> Iterator[EdgeState]:
        """Yield states after a valid one up to ``after``, or up to the first that is not valid."""
        alike = after.valid and before.contacts == after.contacts
        if alike or after.fraction - before.fraction <= self.narrow:
            yield after
            return
        middle = self.state(0.5 * (before.fraction + after.fraction))
        yield from self._states_up_to(before, middle)
        if middle.valid:
            yield from self._states_up_to(middle, after)

    def fault(self) -> MotionFault | None:
        """Return the first invalid state of the motion; None: it is valid."""
        before = None
        for state in self.states():
            if not state.valid:
                validity = state_validity(self._solver, *state.query, self._required)
                return MotionFault(state.fraction, validity, before)
            before = state.fraction
        return None

    def margins(self) -> MotionMargins:
        """Return the largest margins along the motion, up to its first invalid state."""
        pairs = [(state.fraction, self._margin(state)) for state in self.states()]
        fractions, margins = np.array(pairs).T
        return MotionMargins(read_only(fractions.copy()), read_only(margins.copy()))

    def _margin(self, state: EdgeState) -> float:
        if not state.valid:
            return -np.inf
        scene, problem, _ = state.posed or self._solver.posed_scene(*state.query)
        if problem is None:
            return -np.inf
        return self._solver.margin_of(scene, problem, self._required)[0]

    def _evaluated_state(self, fraction: float) -> EdgeState:
        q, solver, solve = self._start + fraction * self._move, self._solver, self._required >= 0.0
        if self._carried:
            reached = solver.is_feasible(q, None, None, self._required)
            return EdgeState(fraction, reached, (), (q, None, None))
        query = q, *self._screw.pose_and_twist(fraction)
        posed = solver.posed_scene(*query, solve=solve)
        if self._ends_by_touching(fraction, posed):
            query = *query[:2], np.zeros(6)
            posed = solver.posed_scene(*query, solve=solve)
        contacts = ()
        if posed.problem is not None:
            carrying = posed.scene.contacts
            contacts = carrying.bodies, carrying.sliding.any(axis=1).tobytes()
        return EdgeState(
            fraction, solver.is_feasible_scene(posed, self._required), contacts, query, posed
        )

    def _ends_by_touching(self, fraction: float, posed: PosedScene) -> bool:
        """Return whether a blocked state is so near the end that the motion ends by touching."""
        if not posed.faults or posed.faults[0][0] is not StateStatus.BLOCKED:
            return False
        velocity, turn = self._screw.lengths
        remaining = (1.0 - fraction) * (velocity + self._object_reach * turn)
        return remaining <= self._solver.configurations.scene.contact_tolerance

    @cached_property
    def _object_reach(self) -> float:
        """Upper bound on the distance of the object's points from its centre of mass, m."""
        return object_radius_bound(self._solver.configurations.scene.object)
