"""Evaluators for the planners of OMPL: valid states and motions, and objectives of margins.

Needs the extra ``ompl``. OMPL's seed, ``ompl.util.RNG.setSeed``, takes effect only if it is set
before any of OMPL's objects exists.
"""

from __future__ import annotations

import atexit
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from threading import Lock
from typing import Any
from weakref import WeakSet

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.caching import Bounded
from graspless_pin.errors import ArgumentError, optional_import
from graspless_pin.planning.configurations import Configuration
from graspless_pin.planning.edges import RESOLUTION, required_margin
from graspless_pin.planning.evaluator import Evaluator
from graspless_pin.problem.checks import FloatArray, real_number, unknown_name

with optional_import("this interface requires OMPL", "ompl", ImportError):
    from ompl import base

__all__ = ["EvaluatedSpace", "MarginShortfall", "SmallestMargin", "attach_evaluator", "joint_space"]

ToState = Callable[[Any], tuple[Configuration | None, ArrayLike | None] | None]
"""Function from a state of OMPL to a configuration and the object's pose; None: no such state."""
Breakpoints = Callable[[Any, Any], Sequence[float]]
"""Function from two states of OMPL to fractions of the motion between them."""

_MOST_MOTIONS = 100_000


class EvaluatedSpace:
    """A state space of OMPL with its evaluator: see `attach_evaluator`, which returns it.

    With a ``to_state``, a motion of OMPL is cut into pieces by OMPL's resolution
    (``setStateValidityCheckingResolution``). The ends of each piece are states of the evaluator,
    which checks the piece by `Evaluator.first_invalid`. Results are kept by motion for OMPL's later
    queries. See the example of `attach_evaluator`.

    Attributes:
        information: OMPL's ``SpaceInformation``.
        evaluator: The evaluator of states and motions.
        margin: The required margin, N; -inf: none.
    """

    def __init__(
        self,
        information: Any,
        evaluator: Evaluator,
        to_state: ToState | None = None,
        *,
        margin: float | None = None,
        resolution: tuple[float, float] = RESOLUTION,
        breakpoints: Breakpoints | None = None,
    ) -> None:
        """Set up the space from the arguments of `attach_evaluator`.

        Raises:
            ArgumentError: If the margin is negative.
        """
        self.information = information
        self.evaluator = evaluator
        self.margin = required_margin(margin, evaluator.required_margin)
        self._to_state, self._resolution, self._breakpoints = to_state, resolution, breakpoints
        # An object attached to a link rests in the hand, and has no twist of its own.
        self._rest = np.zeros(6) if evaluator.attached_to is None else None
        self._space = information.getStateSpace()
        self._places = range(len(evaluator.joint_names))
        self._between, self._one_at_a_time = information.allocState(), Lock()
        self._valid: dict[Any, bool] = Bounded(_MOST_MOTIONS)
        self._margins: dict[Any, tuple[FloatArray, FloatArray]] = Bounded(_MOST_MOTIONS)
        _SPACES.add(self)

    @property
    def object_stays(self) -> bool:
        """Whether states are configurations only: then a motion and its reverse cost the same."""
        return self._to_state is None

    def state(self, state: Any) -> tuple[FloatArray, ArrayLike | None] | None:
        """Return the configuration and the object's pose in a state of OMPL; None: no such state.

        Args:
            state: A state of a ``RealVectorStateSpace`` with a value for each of the evaluator's
                joints, unless `attach_evaluator` got a ``to_state``.
        """
        if self._to_state is None:
            return np.array([*map(state.__getitem__, self._places)]), None
        found = self._to_state(state)
        return None if found is None else (self.evaluator.configuration(found[0]), found[1])

    def is_valid(self, state: Any) -> bool:
        """Return whether a state is valid at rest."""
        q_and_pose = self.state(state)
        if q_and_pose is None:
            return False
        q, T = q_and_pose
        return self.evaluator.is_feasible(q, T, self._rest, margin=self.margin)

    def margin_at_rest(self, state: Any) -> float:
        """Return the largest margin of a state at rest, N; -inf if it is not valid."""
        q_and_pose = self.state(state)
        if q_and_pose is None:
            return -np.inf
        validity = self.evaluator.validity(*q_and_pose, self._rest, margin=0.0)
        return validity.margin if validity.valid else -np.inf

    def is_valid_motion(self, start: Any, end: Any) -> bool:
        """Return whether a motion between two states is valid; its last piece is checked first."""
        key = self._motion_key(start, end)
        if key is None:
            return False
        is_valid = self._valid.get(key)
        if is_valid is None:
            pieces = list(self._motion_pieces(start, end))
            is_valid = self._valid[key] = all(
                piece is not None
                and self.evaluator.is_valid_motion(
                    *piece, margin=self.margin, resolution=self._resolution
                )
                for _, piece in [pieces[-1], *pieces[:-1]]
            )
        return is_valid

    def last_valid(self, start: Any, end: Any) -> float:
        """Return the fraction of a motion up to which it is valid, 1 if all of it is.

        It is 0 if the first state is not valid.
        """
        for (begin, finish), piece in self._motion_pieces(start, end):
            fault = None if piece is None else self.evaluator.first_invalid(
                *piece, margin=self.margin, resolution=self._resolution
            )  # fmt: skip
            if piece is None or fault is not None:
                own = 0.0 if fault is None or fault.last_valid is None else fault.last_valid
                return begin + own * (finish - begin)
        return 1.0

    def margins(self, start: Any, end: Any) -> tuple[FloatArray, FloatArray]:
        """Return the largest margins along a motion.

        Returns:
            (K,) fractions of the motion from 0 to 1, repeated where pieces meet; and (K,)
            margins, N, the last one -inf if the motion is not valid.
        """
        key = self._motion_key(start, end)
        cached = None if key is None else self._margins.get(key)
        if cached is not None:
            return cached
        fractions, margins = np.zeros(0), np.zeros(0)
        for (begin, finish), piece in self._motion_pieces(start, end):
            shares, own, smallest = np.zeros(1), [-np.inf], -np.inf
            if piece is not None:
                along = self.evaluator.motion_margins(*piece, resolution=self._resolution)
                shares, own, smallest = along.fractions, along.margins, along.smallest
            fractions = np.append(fractions, begin + shares * (finish - begin))
            margins = np.append(margins, own)
            if smallest == -np.inf:
                break
        if key is not None:
            self._margins[key] = fractions, margins
        return fractions, margins

    def _motion_pieces(self, start: Any, end: Any) -> Iterator[Any]:
        """Yield the ends of each piece of a motion, as fractions of it, and (q0, q1, T0, T1).

        The latter is None if one of the states does not exist.
        """
        fractions = np.array([0.0, 1.0])
        if not self.object_stays:
            # OMPL's own count of segments is available only after its setup.
            share = self._space.getLongestValidSegmentFraction()
            longest = share * self.information.getMaximumExtent()
            count = max(1, math.ceil(self.information.distance(start, end) / longest))
            fractions = np.linspace(0.0, 1.0, count + 1)
            if self._breakpoints is not None:
                fractions = np.union1d(fractions, self._breakpoints(start, end))
        before = self.state(start)
        for begin, finish in pairwise(fractions.tolist()):
            after = (
                self.state(end) if finish == 1.0 else self._interpolated_state(start, end, finish)
            )
            piece = None
            if before is not None and after is not None:
                piece = before[0], after[0], before[1], after[1]
            yield (begin, finish), piece
            before = after

    def _interpolated_state(self, start: Any, end: Any, fraction: float) -> Any:
        with self._one_at_a_time:
            self._space.interpolate(start, end, fraction, self._between)
            return self.state(self._between)

    def _motion_key(self, start: Any, end: Any) -> Any:
        """Return a key that identifies a motion; None if one of its ends is no state."""
        ends = self.state(start), self.state(end)
        if ends[0] is None or ends[1] is None:
            return None
        return tuple(np.asarray(part, dtype=float).tobytes() for one in ends if one for part in one)


_SPACES: WeakSet[EvaluatedSpace] = WeakSet()


@atexit.register
def _clear_spaces() -> None:
    """Break the reference cycles with OMPL's objects, which its bindings would report as leaks."""
    for space in list(_SPACES):
        vars(space).clear()


class _MotionValidator(base.MotionValidator):
    """Validates motions for OMPL by an `EvaluatedSpace`."""

    def __init__(self, space: EvaluatedSpace) -> None:
        super().__init__(space.information)
        self._space = space

    def checkMotion(self, s1: Any, s2: Any) -> bool:  # called by OMPL
        return self._space.is_valid_motion(s1, s2)


def attach_evaluator(
    setup: Any,
    evaluator: Evaluator,
    to_state: ToState | None = None,
    *,
    margin: float | None = None,
    resolution: tuple[float, float] = RESOLUTION,
    breakpoints: Breakpoints | None = None,
) -> EvaluatedSpace:
    """Let an evaluator decide for OMPL which states and motions are valid.

    A state is valid if the object can be held at rest, see `Evaluator.is_feasible`; a motion if
    `Evaluator.is_valid_motion` holds in the direction of the motion. OMPL keeps the objects that it
    gets here alive.

    OMPL 2.0 asks Python objects only whether a motion is valid, and takes 0 for the last valid
    fraction of one that is not: planners that would continue from there, such as KPIECE1, start
    again. `EvaluatedSpace.last_valid` returns that fraction.

    Args:
        setup: OMPL's ``SimpleSetup`` or ``SpaceInformation``.
        evaluator: The evaluator.
        to_state: Function from a state of OMPL to (q, T_world_object), as for `Evaluator.evaluate`,
            or to None if there is no such state, for example out of reach. None: a state has the
            positions of the evaluator's joints, and the object stays.
        margin: The required margin, N; None: the evaluator's; -inf: none.
        resolution: See `Evaluator.first_invalid`.
        breakpoints: Function from two states of OMPL to the fractions of the motion between them at
            which the object's motion changes, in ascending order, for example from sliding to
            pivoting. None: the motion does not change.

    Returns:
        The space, for `SmallestMargin` and `MarginShortfall`.

    Raises:
        ArgumentError: If the margin is negative, or states have other values than joints and
            there is no ``to_state``.

    Examples:
        >>> from ompl import geometric
        >>> from graspless_pin import Evaluator, load_scene
        >>> from graspless_pin.interfaces.ompl import attach_evaluator, joint_space
        >>> evaluator = Evaluator(load_scene("examples/box_between_walls.yaml"), need_hand=False)
        >>> setup = geometric.SimpleSetup(joint_space(evaluator))
        >>> space = attach_evaluator(setup, evaluator, margin=0.0)
        >>> state = setup.getStateSpace().allocState()
        >>> state[0], state[1] = 0.0, 0.0  # rad
        >>> space.is_valid(state), setup.getSpaceInformation().isValid(state)
        (True, True)
    """
    information = setup.getSpaceInformation() if hasattr(setup, "getSpaceInformation") else setup
    values, joints = information.getStateDimension(), len(evaluator.joint_names)
    if to_state is None and values != joints:
        raise ArgumentError(
            "to_state",
            f"is required, as a state of the space has {values} values, but the evaluator has "
            f"{joints} joints; give a function from a state to (q, T_world_object)",
        )
    space = EvaluatedSpace(
        information,
        evaluator,
        to_state,
        margin=margin,
        resolution=resolution,
        breakpoints=breakpoints,
    )
    information.setStateValidityChecker(space.is_valid)
    information.setMotionValidator(_MotionValidator(space))
    return space


def joint_space(evaluator: Evaluator, joints: Sequence[str] | None = None) -> Any:
    """Return a state space of OMPL: joints between their limits.

    See the example of `attach_evaluator`.

    Args:
        evaluator: An evaluator with these joints.
        joints: Names of its joints in the order of a state's values; None: all, as in
            `Evaluator.joint_names`.

    Returns:
        A ``RealVectorStateSpace``, rad and m.

    Raises:
        ArgumentError: If a joint is unknown or has no limits.
    """
    names = evaluator.joint_names if joints is None else tuple(joints)
    space, bounds = base.RealVectorStateSpace(len(names)), base.RealVectorBounds(len(names))
    for place, name in enumerate(names):
        if name not in evaluator.joint_names:
            raise unknown_name("joints", "joint", name, evaluator.joint_names)
        low, high = (
            float(ends[evaluator.joint_names.index(name)]) for ends in evaluator.joint_limits
        )
        if not (np.isfinite(low) and np.isfinite(high)):
            raise ArgumentError(
                "joints", f"joint {name!r} has no limits; create a space with bounds of your own"
            )
        bounds.setLow(place, low)
        bounds.setHigh(place, high)
    space.setBounds(bounds)
    return space


class _MarginObjective(base.OptimizationObjective):
    """Base class of the objectives of margins."""

    def __init__(self, space: EvaluatedSpace) -> None:
        """Set up the objective for a space from `attach_evaluator`."""
        super().__init__(space.information)
        self._space = space

    def isSymmetric(self) -> bool:
        """Return whether a motion costs as much as its reverse."""
        return self._space.object_stays

    def motionCostHeuristic(self, s1: Any, s2: Any) -> Any:  # noqa: ARG002
        """Return a bound on the cost of a motion: the cost of no motion."""
        return self.identityCost()


class SmallestMargin(_MarginObjective):
    """An objective for OMPL: maximise the smallest margin along a path, N.

    If the object moves, the costs of a motion and its reverse differ, and ``isSymmetric`` is false.
    See the example of `attach_evaluator`.
    """

    def stateCost(self, state: Any) -> Any:
        """Return the margin of a state at rest."""
        return base.Cost(self._space.margin_at_rest(state))

    def motionCost(self, s1: Any, s2: Any) -> Any:
        """Return the smallest margin along a motion."""
        return base.Cost(float(self._space.margins(s1, s2)[1].min()))

    def combineCosts(self, c1: Any, c2: Any) -> Any:
        """Return the cost of two consecutive motions."""
        return base.Cost(min(c1.value(), c2.value()))

    def isCostBetterThan(self, c1: Any, c2: Any) -> bool:
        """Return whether the first margin is larger."""
        return c1.value() > c2.value()

    def identityCost(self) -> Any:
        """Return the cost of no motion."""
        return base.Cost(np.inf)

    def infiniteCost(self) -> Any:
        """Return the worst cost."""
        return base.Cost(-np.inf)


class MarginShortfall(_MarginObjective):
    """An objective for OMPL: the integral of the shortfall of the margin along a path.

    It integrates max(c - margin, 0) over the path, N times OMPL's distance, by the trapezoidal rule
    between evaluated states. Paths whose margins are all above c are equally good: add a length by
    OMPL's ``MultiOptimizationObjective``. ``isSymmetric`` as for `SmallestMargin`. See the example
    of `attach_evaluator`.
    """

    def __init__(self, space: EvaluatedSpace, margin: float) -> None:
        """Set up the objective for a space from `attach_evaluator` and the margin c, N.

        Raises:
            ArgumentError: If the margin is negative or not finite.
        """
        super().__init__(space)
        self._wanted = real_number("margin", margin, 0.0)

    def stateCost(self, state: Any) -> Any:
        """Return the shortfall of a state at rest."""
        return base.Cost(max(self._wanted - self._space.margin_at_rest(state), 0.0))

    def motionCost(self, s1: Any, s2: Any) -> Any:
        """Return the integrated shortfall of a motion; infinite if it is not valid."""
        fractions, margins = self._space.margins(s1, s2)
        if np.isinf(margins[-1]):
            return base.Cost(np.inf)
        shortfall = np.trapezoid(np.maximum(self._wanted - margins, 0.0), fractions)
        return base.Cost(float(shortfall * self._space.information.distance(s1, s2)))
