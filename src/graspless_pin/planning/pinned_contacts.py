"""Gaps, margin and torques of a state with pinned contacts, and their gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.dual_degeneracy import OptimalPoint, OptimalSet, agreeing_entries
from graspless_pin.algorithms.gradients import (
    Gradients,
    gradients_at,
    optimum_gradients,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.contact.curvature import Rates
from graspless_pin.geometry.hand.joint_columns import JointColumns
from graspless_pin.planning.configuration_gradient import (
    ContactRates,
    ProblemRates,
    frame_turns,
    problem_rates,
)
from graspless_pin.planning.configurations import PinnedPoint, pin_rates, pinned_point
from graspless_pin.planning.evaluation import Evaluation, StateStatus
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.records import Brief, changed
from graspless_pin.scene import Scene
from graspless_pin.scene.load_wrenches import object_wrench

if TYPE_CHECKING:
    from graspless_pin.planning.state_solver import StateSolver


@dataclass(frozen=True, eq=False, repr=False)
class Derivatives(Brief):
    """Derivatives of some figures by configuration, pose, friction and mass.

    Attributes:
        q: (..., a) by the joints of `Evaluator.joint_names`, per rad or m.
        pose: (..., 6) by the object's twist about its centre of mass, [linear; angular] in world
            axes, per m and rad.
        friction: (..., B) by the coefficients of the B bodies, each once in the order of
            `PinnedState.bodies`, per unit.
        mass: (..., 1) by the object's mass, per kg.
        unique: (..., a + 6 + B + 1) mask of entries that are derivatives, in this order; elsewhere
            the figure has or may have a kink, and they are one of several one-sided derivatives.

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
    friction: FloatArray
    mass: FloatArray
    unique: NDArray[np.bool_]


class _Rates(NamedTuple):
    """Derivatives of a state's problem by configuration, pose, friction and mass.

    Attributes:
        moving: By the a joints and the object's twist.
        surfaces: (M, B) one where a contact has the coefficient of a body, else zero.
        weight: (6,) wrench per kg of the object.
        smooth: Whether no contact is at a kink.
    """

    moving: ProblemRates
    surfaces: FloatArray
    weight: FloatArray
    smooth: bool

    def chain_rule(self, by: Gradients) -> FloatArray:
        """Return (a + 6 + B + 1,) derivatives of a figure with derivatives ``by`` the data."""
        weight = by.external_wrench @ self.weight
        return np.concatenate([self.moving.chain_rule(by), by.friction @ self.surfaces, [weight]])


@dataclass(frozen=True, eq=False, repr=False)
class PinnedState(Brief):
    """A state with pinned contacts, and the derivatives that optimisers need.

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
    _rates: _Rates | None = None

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
        """The largest margin, N, or the smallest torque, N m, or share; NaN without torques."""
        if not self.evaluation.found:
            return np.nan
        solution = self.evaluation.solution
        return solution.value if solution.algorithm is Algorithm.TORQUE else solution.margin

    @cached_property
    def by_optimum(self) -> Derivatives:
        """Derivatives of the optimum, in its mode. Computed when they are first read.

        Raises:
            NoSolutionError: If there are no torques; with the reason.
            ArgumentError: See `optimum_gradients`; or if contacts of the hand slide.
        """
        data = optimum_gradients(self.evaluation.solution)
        own, *others = self._figure_gradients((data.point, *data.alternatives))
        return self._derivatives(own, agreeing_entries(own, *others))

    @cached_property
    def by_torques(self) -> Derivatives:
        """Derivatives of the torques, (L, ...). Computed when they are first read.

        Raises:
            NoSolutionError: As for `by_optimum`.
            ArgumentError: Likewise.
        """
        data = optimum_gradients(self.evaluation.solution)
        own, *others = map(self._figure_gradients, OptimalSet(data.solution).torque_points())
        rows = [agreeing_entries(*row) for row in zip(own, *others, strict=True)]
        return self._derivatives(own, np.array(rows, dtype=bool).reshape(own.shape))

    def _figure_gradients(self, points: Sequence[OptimalPoint]) -> FloatArray:
        """Return (N, a + 6 + B + 1) derivatives at each of N choices of forces and multipliers."""
        rates = self._known_rates
        rows = [rates.chain_rule(gradients_at(self.evaluation.solution, at)) for at in points]
        size = rates.moving.spins.shape[-1] + rates.surfaces.shape[1] + 1
        return np.array(rows).reshape(-1, size)

    def _derivatives(self, values: FloatArray, unique: NDArray[np.bool_]) -> Derivatives:
        count = self.by_gaps.q.shape[-1]
        q, pose, friction, mass = np.split(values, [count, count + 6, -1], axis=-1)
        unique = unique & self._known_rates.smooth
        return Derivatives(
            read_only(q), read_only(pose), read_only(friction), read_only(mass), unique
        )

    @property
    def _known_rates(self) -> _Rates:
        assert self._rates is not None  # noqa: S101 - there are torques
        return self._rates


def pinned_state(
    solver: StateSolver, q: Any, T_world_object: Any, twist: Any, friction: Any, mass: Any
) -> PinnedState:
    """Return a state with its gradients: see `Evaluator.pinned`."""
    pins = solver.configurations.pins
    if pins is None:
        raise ArgumentError(
            "pins", "this evaluator has none; create it with Evaluator(scene, pins=...)"
        )
    if friction is not None or mass is not None:
        solver = solver.with_scene(_with_surfaces(solver.configurations.scene, friction, mass))
    evaluation = solver.evaluate(q, T_world_object, twist)
    if evaluation.status is StateStatus.OUTSIDE_LIMITS:
        raise ArgumentError("q", f"is not valid: {evaluation.reason}; clip it to joint_limits")
    scene = evaluation.scene
    hand = scene.hand
    columns = None if hand is None else JointColumns(hand)
    coupling = np.zeros((0, 0)) if hand is None else hand.tree.coupling.S
    points = [pinned_point(scene, pin) for pin in pins]
    rates = [pin_rates(scene, columns, point) for point in points]
    n = len(coupling)
    gaps = np.array([rate.gap for rate in rates])
    smooth = np.array([rate.smooth for rate in rates])
    bodies = tuple([point.contact.body for point in points])
    surfaces = np.array([[own == body for body in dict.fromkeys(bodies)] for own in bodies], float)
    zeros = np.zeros((len(points), surfaces.shape[1] + 1))
    by_gaps = Derivatives(
        read_only(gaps[:, :n] @ coupling),
        read_only(gaps[:, n:]),
        read_only(zeros[:, :-1]),
        read_only(zeros[:, -1:]),
        np.repeat(smooth[:, None], coupling.shape[1] + 6 + zeros.shape[1], axis=1),
    )
    values = read_only(np.array([point.gap for point in points]))
    if not evaluation.found:
        return PinnedState(evaluation, bodies, values, by_gaps)
    kept = _pins_of_contacts(evaluation, points)
    moving = [rates[k] for k in kept]
    center = np.hstack([np.zeros((3, n)), np.eye(3), np.zeros((3, 3))])
    middles, turns = np.array([rate.middle for rate in moving]), _contact_turns(evaluation, moving)
    contacts = ContactRates(middles, turns, center, np.roll(center, 3, axis=1))
    count = len(evaluation.joint_names)
    moving_rates = problem_rates(scene, columns, count, contacts).by_independent_joints(coupling)
    # The wrench is linear in the mass.
    heavier = scene.with_changes(object=scene.object.with_mass(scene.object.mass + 1.0))
    weight = object_wrench(heavier) - object_wrench(scene)
    rates = _Rates(moving_rates, surfaces[kept], weight, all(rate.smooth for rate in moving))
    return PinnedState(evaluation, bodies, values, by_gaps, rates)


def _pins_of_contacts(evaluation: Evaluation, points: Sequence[PinnedPoint]) -> list[int]:
    """Return the index of the pinned point of each contact: the declared motion may part some.

    One corner of the object may be on two bodies, such as a floor and a wall, or on two faces.
    """
    bodies = np.array([point.contact.body for point in points])
    places = np.array([[point.contact.position, point.contact.normal] for point in points])
    arrays = evaluation.contacts.arrays
    kept = []
    for body, *place in zip(arrays.bodies, arrays.positions, arrays.normals, strict=True):
        off = np.abs(places - place).max(axis=(1, 2))
        kept.append(int(np.where(bodies == body, off, np.inf).argmin()))
    return kept


def _with_surfaces(scene: Scene, friction: Any, mass: Any) -> Scene:
    """Return a scene with other coefficients of friction of its given contacts and another mass."""
    own, supports, table = scene.object, scene.supports, scene.friction
    if mass is not None:
        own = own.with_mass(mass)
    if friction is None:
        return scene.with_changes(object=own)
    given = scene.given_contacts or ()
    bodies = tuple(dict.fromkeys(contact.body for contact in given))
    values = finite_array("friction", friction, (len(bodies),)).tolist()
    each = dict(zip(bodies, values, strict=True))
    return scene.with_changes(
        object=changed(own, material=None),
        hand_material=None,
        friction={**table, **each},
        supports=tuple(
            [changed(body, friction=each.get(body.name, body.friction)) for body in supports]
        ),
    )


def _contact_turns(evaluation: Evaluation, rates: Sequence[Rates]) -> FloatArray:
    """Return (P, 3, n + 6) rotations of contact frames; those of sliding ones with the sliding."""
    scene, problem = evaluation.scene, evaluation.solution.problem
    turns = []
    for k, rate in enumerate(rates):
        n = problem.normals[k]
        turn = frame_turns(n, rate.normal, scene.tangent_axes)
        if problem.is_sliding[k]:
            turn = np.cross(n, rate.normal.T).T + np.outer(n, _slide_turn(scene, problem, k, rate))
        turns.append(turn)
    return np.array(turns)


def _slide_turn(scene: Scene, problem: QuasistaticProblem, contact: int, rate: Rates) -> FloatArray:
    """Return (n + 6,) rotation of the sliding direction about the normal as the contact moves."""
    body = scene.contacts.bodies[contact]
    motion = scene.motion
    support = next((own for own in scene.supports if own.name == body), None)
    if support is None:
        raise ArgumentError(
            "twist",
            f"makes contacts of the hand ({body!r}) slide; such states have no gradient",
        )
    spin = np.zeros(3) if motion is None else motion.object_twist[3:]
    center = np.zeros_like(rate.middle)
    center[:, -6:-3] = np.eye(3)
    change = np.cross(spin, (rate.middle - center).T) - np.cross(
        support.velocity[3:], rate.middle.T
    )
    n, slide = problem.normals[contact], problem.sliding[contact]
    return change @ np.cross(n, slide) / float(slide @ slide)
