"""The gradient of an optimum by the hand's joint positions, the object held where it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.dual_degeneracy import OptimalPoint
from graspless_pin.algorithms.gradients import (
    OptimumGradients,
    agreeing,
    gradients_at,
    optimum_gradients,
)
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.planning.evaluation import Evaluation
from graspless_pin.planning.moving_contacts import (
    Follows,
    JointColumns,
    MovingContacts,
    moving_contacts,
)
from graspless_pin.problem.checks import FloatArray, choice, read_only
from graspless_pin.scene import Scene


@dataclass(frozen=True, eq=False)
class ConfigurationGradient:
    """The gradient of the largest margin or smallest torque by the hand's configuration.

    See the example of `configuration_gradient`.

    Attributes:
        joint_names: a independent joints, those of `Evaluator.joint_names`.
        values: (a,) N or N m per rad (per m for linear joints).
        unique: (a,) which entries all optimal forces and multipliers agree on.
        contacts: H indices of the hand's contacts among those of the scene.
        gaps: (H,) gap between link and object, negative where they overlap, m.
        gap_gradient: (H, a) of the gaps, m per rad or m: motions that leave them alone keep the
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

    Held fixed are the object's pose, its contacts with supports, the coefficients of friction, the
    limits and the mode; which links touch does not change. Contact points, lever arms and the
    links' own weight move with the joints.

    Args:
        evaluation: A state with torques, from an evaluator without regularisation.
        follows: ``surface``: a contact stays where link and object are nearest, for links that are
            rounded there (spheres, capsules) or have a corner, on an object that is flat there or a
            sphere; ``link``: it stays at its place on the link: see `Follows`.

    Returns:
        The gradient; entries of which it is only one of several are marked.

    Raises:
        NoSolutionError: If the state has no torques.
        ArgumentError: If the scene has no hand, the evaluator a regularisation, or ``follows`` is
            not known.

    Examples:
        >>> from graspless_pin import Evaluator, load_scene
        >>> from graspless_pin.planning import configuration_gradient
        >>> evaluator = Evaluator(load_scene("examples/trihand_pivot_box.yaml"))
        >>> gradient = configuration_gradient(evaluator.evaluate())
        >>> gradient.joint_names[0], gradient.values.shape
        ('finger_1_spread', (9,))
    """
    way = choice(Follows, "follows", follows)
    scene = evaluation.scene
    if not evaluation.found:
        raise NoSolutionError(f"This state has no torques ({evaluation.reason}); nothing changes.")
    if scene.hand is None:
        raise ArgumentError("evaluation", "is of a scene without a hand: no joint can move")
    data = optimum_gradients(evaluation.solution)
    columns = JointColumns(scene.hand)
    contacts = moving_contacts(scene, columns, way)
    coupling = scene.hand.tree.coupling
    values, *others = [
        _by_joints(scene, scene.hand, data, point, columns, contacts) @ coupling.S
        for point in (data.point, *data.alternatives)
    ]
    points = scene.contacts.points
    return ConfigurationGradient(
        joint_names=tuple(scene.hand.joint_names[leader] for leader in coupling.leaders),
        values=read_only(values),
        unique=agreeing(values, *others),
        contacts=contacts.indices,
        gaps=read_only(np.array([points[index].distance for index in contacts.indices])),
        gap_gradient=read_only(contacts.gaps @ coupling.S),
        data=data,
    )


def _by_joints(
    scene: Scene,
    hand: Hand,
    data: OptimumGradients,
    point: OptimalPoint,
    columns: JointColumns,
    contacts: MovingContacts,
) -> FloatArray:
    """(n,) by all movable joints, couplings not yet counted."""
    by = gradients_at(data.solution, point)
    normals = data.solution.problem.normals
    actuators = len(hand.actuation.names)
    # J = J_all F: what an entry of the actuators' Jacobian counts, the joints' entries count.
    jacobian = by.jacobian[:, :actuators] @ hand.actuation.from_joints.T
    total = np.zeros(len(columns.linear))
    hybrid = actuators
    for row, index in enumerate(contacts.indices):
        move, turn, n = contacts.moves[row], contacts.turns[row], normals[index]
        turned = np.cross(turn.T, n)
        total += by.positions[index] @ move + turned @ by.normals[index]
        total += by.spins[index] * (n @ turn)
        block = slice(3 * index, 3 * index + 3)
        total += columns.by_lever_arms(
            contacts.links[row], contacts.points[row], move, jacobian[block]
        )
        if hand.is_hybrid(scene.contacts.bodies[index]):
            # The commanded force of a hybrid finger has the normal for its column.
            total += turned @ by.jacobian[block, hybrid]
            hybrid += 1
    if scene.count_own_weight and actuators:
        weights = by.gravity_torques[:actuators] @ hand.actuation.from_joints.T
        masses, centers = hand.tree.masses
        for link in range(1, len(masses)):
            T = columns.T_world_joint[link]
            center = T[:3, :3] @ centers[link] + T[:3, 3]
            move = columns.velocity(link, center)
            pull = -masses[link] * np.outer(scene.gravity, weights)
            total += columns.by_lever_arms(link, center, move, pull)
    return total
