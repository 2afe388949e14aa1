"""Gaps, margin and torques of a state whose contacts are pinned, with their gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.dual_degeneracy import OptimalPoint, OptimalSet
from graspless_pin.algorithms.gradients import agreeing, gradients_at, optimum_gradients
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.contact.nearest_points import Rates
from graspless_pin.geometry.hand.joint_columns import JointColumns
from graspless_pin.planning.configuration_gradient import frame_turns
from graspless_pin.planning.evaluation import Evaluation, StateStatus
from graspless_pin.planning.pins import pin_rates, pinned_points
from graspless_pin.planning.problem_rates import ContactRates, ProblemRates, problem_rates
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.records import Brief
from graspless_pin.scene import Scene

if TYPE_CHECKING:
    from graspless_pin.planning.state_solver import StateSolver


@dataclass(frozen=True, eq=False, repr=False)
class Derivatives(Brief):
    """Derivatives of some figures by the hand's configuration and by the object's pose.

    Attributes:
        q: (..., a) by the joints of `Evaluator.joint_names`, per rad or m.
        pose: (..., 6) by the object's twist about its centre of mass, [linear; angular] in world
            axes, per m and rad.
        unique: (..., a + 6) where these are derivatives, q first; elsewhere the figure has or may
            have a kink, and they are one of several one-sided derivatives.

    Examples:
        >>> from graspless_pin import Evaluator, load_scene
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> pins = [("finger_1/tip", "object"), ("finger_6/tip", "object"), ("object", "slope")]
        >>> by_gaps = Evaluator(scene, pins=pins).pinned().by_gaps
        >>> by_gaps.q.shape, by_gaps.pose.shape
        ((6, 2), (6, 6))
    """

    q: FloatArray
    pose: FloatArray
    unique: NDArray[np.bool_]


@dataclass(frozen=True, eq=False, repr=False)
class PinnedState(Brief):
    """A state whose contacts are pinned; what an optimiser asks for.

    Attributes:
        evaluation: Status, margin, torques and forces of the state.
        bodies: P names of the links and supports that are pinned to the object, in the order of
            contacts.
        gaps: (P,) negative where bodies overlap, m.
        by_gaps: Derivatives of the gaps, (P, ...).

    Examples:
        >>> from graspless_pin import Evaluator, load_scene
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> pins = [*((f"finger_{k}_tip", "object") for k in (1, 2, 3)), ("object", "table")]
        >>> evaluator = Evaluator(scene, pins=pins)
        >>> opened = evaluator.pinned({"finger_1_distal": 0.85})  # rad
        >>> print(f"{opened.gaps[0]:.4f} m")
        0.0028 m
        >>> opened.by_gaps.q.shape, opened.by_optimum.pose.shape
        ((7, 9), (6,))
    """

    evaluation: Evaluation
    bodies: tuple[str, ...]
    gaps: FloatArray
    by_gaps: Derivatives
    _rates: ProblemRates | None = None
    _smooth: bool = True

    @property
    def margin(self) -> float:
        """The margin, N; -inf where there are no torques."""
        return self.evaluation.margin

    @property
    def torques(self) -> FloatArray:
        """(L,) motor torques.

        Raises:
            NoSolutionError: If there are none; with the reason.
        """
        return self.evaluation.torques

    @cached_property
    def optimum(self) -> float:
        """The largest margin, N, or the smallest torque, N m, or share; NaN where none is found."""
        if not self.evaluation.found:
            return np.nan
        solution = self.evaluation.solution
        return solution.value if solution.algorithm is Algorithm.TORQUE else solution.margin

    @cached_property
    def by_optimum(self) -> Derivatives:
        """Derivatives of the optimum, in its mode. Worked out when first asked for.

        Raises:
            NoSolutionError: If there are no torques; with the reason.
            ArgumentError: See `optimum_gradients`; or if contacts of the hand slide.
        """
        data = optimum_gradients(self.evaluation.solution)
        own, *others = self._each((data.point, *data.alternatives))
        return _derivatives(own, agreeing(own, *others) & self._smooth)

    @cached_property
    def by_torques(self) -> Derivatives:
        """Derivatives of the torques, (L, ...). Worked out when first asked for.

        Raises:
            NoSolutionError: As for `by_optimum`.
            ArgumentError: Likewise.
        """
        data = optimum_gradients(self.evaluation.solution)
        own, *others = map(self._each, OptimalSet(data.solution).torque_points())
        rows = [agreeing(*one) for one in zip(own, *others, strict=True)]
        return _derivatives(own, np.array(rows, dtype=bool).reshape(own.shape) & self._smooth)

    def _each(self, points: Sequence[OptimalPoint]) -> FloatArray:
        """(N, a + 6) what each of N choices of forces and multipliers gives."""
        rates = self._rates
        assert rates is not None  # noqa: S101 - there are torques
        found = [rates.of(gradients_at(self.evaluation.solution, at)) for at in points]
        return np.array(found).reshape(-1, rates.spins.shape[-1])


def pinned_state(solver: StateSolver, q: Any, T_world_object: Any, twist: Any) -> PinnedState:
    """Return a state with its gradients: see `Evaluator.pinned`."""
    pins = solver.configurations.pins
    if pins is None:
        raise ArgumentError("pins", "were not given to this evaluator: Evaluator(scene, pins=...)")
    evaluation = solver.evaluate(q, T_world_object, twist)
    if evaluation.status is StateStatus.OUTSIDE_LIMITS:
        raise ArgumentError("q", f"cannot be taken: {evaluation.reason}; clip it to joint_limits")
    scene = evaluation.scene
    hand = scene.hand
    columns = None if hand is None else JointColumns(hand)
    coupling = np.zeros((0, 0)) if hand is None else hand.tree.coupling.S
    points = pinned_points(scene, pins)
    rates = pin_rates(scene, columns, points)
    n = len(coupling)
    gaps = np.array([one.gap for one in rates])
    smooth = np.array([one.smooth for one in rates])
    by_gaps = Derivatives(
        read_only(gaps[:, :n] @ coupling),
        read_only(gaps[:, n:]),
        np.repeat(smooth[:, None], coupling.shape[1] + 6, axis=1),
    )
    bodies = tuple([one.contact.body for one in points])
    values = read_only(np.array([one.gap for one in points]))
    if not evaluation.found:
        return PinnedState(evaluation, bodies, values, by_gaps)
    kept = _carrying(evaluation, np.array([one.contact.position for one in points]))
    moving = [rates[k] for k in kept]
    turns = _turns(evaluation, moving)
    center = _center(n)
    contacts = ContactRates(
        np.array([one.middle for one in moving]), turns, center, np.roll(center, 3, axis=1)
    )
    count = len(evaluation.joint_names)
    data = problem_rates(scene, columns, count, contacts).reduced(coupling)
    smooth = all(one.smooth for one in moving)
    return PinnedState(evaluation, bodies, values, by_gaps, data, smooth)


def _carrying(evaluation: Evaluation, positions: FloatArray) -> list[int]:
    """Return the pins whose contacts the declared motion does not part."""
    found = evaluation.contacts.arrays.positions
    return [int(np.abs(positions - one).max(axis=1).argmin()) for one in found]


def _turns(evaluation: Evaluation, rates: Sequence[Rates]) -> FloatArray:
    """(P, 3, n + 6) how frames of contacts turn; a sliding one with its direction of sliding."""
    scene, problem = evaluation.scene, evaluation.solution.problem
    turns = []
    for k, rate in enumerate(rates):
        n = problem.normals[k]
        turn = frame_turns(n, rate.normal, scene.tangent_axes)
        if problem.is_sliding[k]:
            turn = np.cross(n, rate.normal.T).T + np.outer(n, _spin(scene, problem, k, rate))
        turns.append(turn)
    return np.array(turns)


def _spin(scene: Scene, problem: QuasistaticProblem, contact: int, rate: Rates) -> FloatArray:
    """(n + 6,) how the direction of sliding turns about the normal as the contact moves."""
    body = scene.contacts.bodies[contact]
    motion = scene.motion
    support = next((one for one in scene.supports if one.name == body), None)
    if support is None:
        raise ArgumentError(
            "twist",
            f"has contacts of the hand ({body!r}) slide; of such states there is no gradient",
        )
    spin = np.zeros(3) if motion is None else motion.object_twist[3:]
    center = np.zeros_like(rate.middle)
    center[:, -6:-3] = np.eye(3)
    change = np.cross(spin, (rate.middle - center).T) - np.cross(
        support.velocity[3:], rate.middle.T
    )
    n, slide = problem.normals[contact], problem.sliding[contact]
    return change @ np.cross(n, slide) / float(slide @ slide)


def _center(joint_count: int) -> FloatArray:
    """(3, n + 6) how the centre of mass moves."""
    return np.hstack([np.zeros((3, joint_count)), np.eye(3), np.zeros((3, 3))])


def _derivatives(values: FloatArray, unique: NDArray[np.bool_]) -> Derivatives:
    return Derivatives(read_only(values[..., :-6]), read_only(values[..., -6:]), unique)
