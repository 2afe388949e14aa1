"""The gradient of an optimum by the hand's joint positions at a fixed pose of the object.

It follows by the chain rule from the derivatives of a problem's arrays by motions of contacts and
joints.

The Jacobian column of joint j at a point p of a link is v_j + omega_j x p with the joint's spatial
column (v_j, omega_j). A joint k at or above j carries that column along, d(v_j, omega_j) = (v_k,
omega_k) x (v_j, omega_j); and every joint that moves the contact point adds omega_j x dp.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.dual_degeneracy import agreeing_entries
from graspless_pin.algorithms.gradients import (
    Gradients,
    OptimumGradients,
    gradients_at,
    optimum_gradients,
)
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.geometry.contact.curvature import Velocities, nearest_rates, rates_over_face
from graspless_pin.geometry.contact.patches import Patch
from graspless_pin.geometry.hand.joint_columns import JointColumns
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.planning.evaluation import Evaluation
from graspless_pin.problem.checks import FloatArray, choice, read_only
from graspless_pin.problem.cones import projected_tangents
from graspless_pin.records import Brief
from graspless_pin.scene import Scene
from graspless_pin.scene.load_wrenches import load_rates
from graspless_pin.scene.stated import Accelerated


class ContactRates(NamedTuple):
    """Derivatives of M contacts by k motions, of which the first n are those of movable joints.

    Attributes:
        moves: (M, 3, k) translation of the points, m.
        turns: (M, 3, k) rotation of normal and tangents, rad.
        center: (3, k) translation of the object's centre of mass, m.
        turning: (3, k) rotation of the object, rad.
    """

    moves: FloatArray
    turns: FloatArray
    center: FloatArray
    turning: FloatArray


@dataclass(frozen=True, eq=False)
class ProblemRates:
    """First derivatives of a problem's data by k motions, with the names of `Gradients`."""

    positions: FloatArray
    normals: FloatArray
    spins: FloatArray
    external_wrench: FloatArray
    jacobian: FloatArray
    gravity_torques: FloatArray

    def by_independent_joints(self, coupling: FloatArray) -> ProblemRates:
        """Return the derivatives by the a independent joints, then those by the other motions.

        Args:
            coupling: (n, a) see `Coupling`.
        """
        n = len(coupling)
        parts = {
            name: np.concatenate([rates[..., :n] @ coupling, rates[..., n:]], axis=-1)
            for name, rates in vars(self).items()
        }
        return ProblemRates(**parts)

    def chain_rule(self, by: Gradients) -> FloatArray:
        """Return (k,) derivatives by the motions of a figure with derivatives ``by`` the data."""
        return sum(
            (
                np.tensordot(getattr(by, name), rates, rates.ndim - 1)
                for name, rates in vars(self).items()
            ),
            start=np.zeros(self.positions.shape[-1]),
        )


def problem_rates(
    scene: Scene, columns: JointColumns | None, joint_count: int, contacts: ContactRates
) -> ProblemRates:
    """Return the derivatives of the data of a scene's problem.

    Args:
        scene: The scene.
        columns: The joint columns of its hand; None: it has none.
        joint_count: Number of columns of the problem's Jacobian.
        contacts: Derivatives of its contacts.

    Raises:
        ArgumentError: If its acceleration turns or moves joints.
    """
    if scene.acceleration is not None and not scene.acceleration.is_translation:
        raise ArgumentError(
            "evaluation",
            "is of a scene whose acceleration is not only 'linear': derivatives of the inertial "
            "forces by the joints are not available; state 'linear' only, or no acceleration",
        )
    arrays, hand = scene.contacts.arrays, scene.hand
    normals, (moves, turns, center, turning) = arrays.normals, contacts
    turned = np.cross(turns, normals[:, :, None], axis=1)
    count, k = len(normals), moves.shape[-1]
    jacobian, weights = np.zeros((count, 3, joint_count, k)), np.zeros((joint_count, k))
    if hand is not None and columns is not None:
        to_actuators = hand.actuation.from_joints
        actuators = hybrid = to_actuators.shape[1]
        for row in range(arrays.hand_count):
            link = hand.tree.link_joints[arrays.bodies[row]]
            change = columns.change_of_columns(link, arrays.positions[row], moves[row])
            jacobian[row, :, :actuators] = np.einsum("ijk,jl->ilk", change, to_actuators)
            if hand.is_hybrid(arrays.bodies[row]):
                # The commanded force of a hybrid finger has the normal for its column.
                jacobian[row, :, hybrid] = turned[row]
                hybrid += 1
        if scene.count_own_weight:
            acceleration, pulling = scene.acceleration, scene.gravity
            if acceleration is not None and acceleration.of is Accelerated.BASE:
                pulling = pulling - acceleration.linear
            rates = hand.tree.gravity_rates(hand.positions, pulling)
            weights[:actuators, : len(rates)] = to_actuators.T @ rates
    return ProblemRates(
        moves - center,
        turned,
        np.einsum("mi,mik->mk", normals, turns),
        load_rates(scene, turning),
        jacobian.reshape(3 * count, joint_count, k),
        weights,
    )


_TURN_STEP = 1e-6


class Follows(StrEnum):
    """How a contact of the hand moves when the joints move."""

    SURFACE = "surface"
    """It stays where link and object are nearest: a rounded tip slides and rolls over the object,
    whose surface there is flat or a sphere. Contacts that are found again move like this."""
    LINK = "link"
    """It is fixed to the link, and its normal and tangents turn with the link."""


def moving_contacts(
    scene: Scene, hand: Hand, columns: JointColumns, follows: Follows
) -> tuple[ContactRates, FloatArray]:
    """Differentiate the contacts of a scene's hand by all n movable joints.

    Args:
        scene: A scene with a hand.
        hand: The hand.
        columns: Its joint columns.
        follows: How contacts move.

    Returns:
        The derivatives of all contacts, zero for those with supports; and (H, n) derivatives of the
        gaps between link and object of the H contacts with the hand, m per rad or m.
    """
    count, points = len(columns.linear), scene.contacts.points
    gaps = np.zeros((scene.contacts.arrays.hand_count, count))
    moves, turns = np.zeros((2, len(points), 3, count))
    zeros = np.zeros((3, count))
    fixed = Velocities(zeros, zeros)
    for index, contact in enumerate(points[: len(gaps)]):
        link = hand.tree.link_joints[contact.body]
        n, p, gap = contact.normal, contact.position, contact.distance
        if follows is Follows.LINK:
            moves[index], turns[index] = columns.velocity(link, p), columns.rotation(link)
            continue
        own = Velocities(columns.velocity(link, p - 0.5 * gap * n), columns.rotation(link))
        pieces = [body for body in hand.placed_bodies if body.name == contact.body]
        if pieces:
            patch = Patch(n, p[None], [gap])
            rates = nearest_rates(pieces, scene.object.placed_bodies, patch, (own, fixed))
        else:  # a given contact
            rates = rates_over_face(n, gap, own, fixed)
        gaps[index], moves[index] = rates.gap, rates.middle
        turns[index] = frame_turns(n, rates.normal, scene.tangent_axes)
    return ContactRates(moves, turns, zeros, zeros), gaps


def frame_turns(
    normal: FloatArray, change: FloatArray, tangent_axes: tuple[FloatArray, ...]
) -> FloatArray:
    """Return the (3, n) rotation rates of a contact's frame from the derivatives of its normal.

    Its tangents follow the scene's rule.

    Args:
        normal: (3,) unit.
        change: (3, n) derivatives of the normal, tangential.
        tangent_axes: See `Scene`.
    """
    if not change.any():
        return np.zeros_like(change)
    shortest = np.cross(normal, change.T).T
    second = projected_tangents(normal[None], tangent_axes)[0, :, 1]
    spins = []
    for step in change.T:
        ends = normal + _TURN_STEP * np.array([step, -step])
        ends /= np.linalg.norm(ends, axis=1, keepdims=True)
        beside = projected_tangents(ends, tangent_axes)[:, :, 0]
        spins.append(second @ (beside[0] - beside[1]) / (2.0 * _TURN_STEP))
    return shortest + np.outer(normal, spins)


@dataclass(frozen=True, eq=False, repr=False)
class ConfigurationGradient(Brief):
    """The gradient of the largest margin or smallest torque by the hand's configuration.

    See the example of `configuration_gradient`.

    Attributes:
        joint_names: a independent joints, those of `Evaluator.joint_names`.
        values: (a,) N or N m per rad (per m for prismatic joints).
        unique: (a,) mask of the entries on which all optimal forces and multipliers agree.
        contacts: H indices of the hand's contacts among those of the scene.
        gaps: (H,) gap between link and object, negative where they overlap, m.
        gap_gradient: (H, a) of the gaps, m per rad or m: motions along which it vanishes keep the
            hand touching. Zero where contacts follow the link.
        data: The gradients by the problem's data that these come from.
    """

    joint_names: tuple[str, ...]
    values: FloatArray
    unique: NDArray[np.bool_]
    contacts: tuple[int, ...]
    gaps: FloatArray
    gap_gradient: FloatArray
    data: OptimumGradients

    @property
    def degenerate(self) -> bool:
        """Whether any entry is not unique."""
        return not bool(self.unique.all())


def configuration_gradient(
    evaluation: Evaluation, *, follows: str = "surface"
) -> ConfigurationGradient:
    """Differentiate the optimum of a state by the hand's joint positions.

    The object's pose, its contacts with supports, the coefficients of friction, the limits, the
    mode and the set of touching links are held fixed. Contact points, lever arms and the torques of
    the links' own weight change with the joints.

    Args:
        evaluation: A state with torques, from an evaluator without regularisation.
        follows: ``surface``: a contact stays where link and object are nearest, for links that are
            rounded there (spheres, capsules) or have a corner, on an object that is flat there or a
            sphere; ``link``: it stays at its place on the link: see `Follows`.

    Returns:
        The gradient, with a mask of unique entries; the others are one of several values.

    Raises:
        NoSolutionError: If the state has no torques.
        ArgumentError: If the scene has no hand or accelerates otherwise than as one, the evaluator
            has a regularisation or an uncertainty, contacts slide by another law than Coulomb's, or
            ``follows`` is not known.

    Examples:
        >>> from graspless_pin import Evaluator, load_scene
        >>> from graspless_pin.planning import configuration_gradient
        >>> evaluator = Evaluator(load_scene("examples/trihand_pivot_box.yaml"))
        >>> gradient = configuration_gradient(evaluator.evaluate())
        >>> gradient.joint_names[0], gradient.values.shape
        ('finger_1_spread', (9,))
    """
    rule = choice(Follows, "follows", follows)
    scene = evaluation.scene
    if not evaluation.found:
        raise NoSolutionError(f"This state has no torques ({evaluation.reason}), so no gradient.")
    if scene.hand is None:
        raise ArgumentError("evaluation", "is of a scene without a hand: no joint can move")
    if evaluation.robust is not None:
        raise ArgumentError(
            "evaluation",
            "is of an evaluator with an uncertainty, for which gradients by the joints are not "
            "available; leave the uncertainty out",
        )
    problem = evaluation.solution.problem
    if problem.is_sliding.any() and not problem.cone_model.is_coulomb:
        raise ArgumentError(
            "evaluation",
            f"has sliding contacts with the cone {problem.cone!r}; for these, gradients by the "
            "joints require Coulomb's law ('edges' or 'round')",
        )
    data = optimum_gradients(evaluation.solution)
    columns = JointColumns(scene.hand)
    contacts, gaps = moving_contacts(scene, scene.hand, columns, rule)
    coupling = scene.hand.tree.coupling
    rates = problem_rates(scene, columns, problem.joint_count, contacts)
    values, *others = [
        rates.chain_rule(gradients_at(data.solution, point)) @ coupling.S
        for point in (data.point, *data.alternatives)
    ]
    distances = np.array(scene.contacts.arrays.distances[: len(gaps)])
    return ConfigurationGradient(
        joint_names=tuple(scene.hand.joint_names[leader] for leader in coupling.leaders),
        values=read_only(values),
        unique=agreeing_entries(values, *others),
        contacts=tuple(range(len(gaps))),
        gaps=read_only(distances),
        gap_gradient=read_only(gaps @ coupling.S),
        data=data,
    )
