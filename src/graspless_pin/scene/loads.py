"""What a scene's problem is made of: contacts with the joints there, and what bears on them.

Loads, friction and limits may change while the contacts stay. `JointedContacts` is the same object
then, which tells that one loop may solve many such scenes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from graspless_pin.errors import SceneError
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.cones import projected_tangents
from graspless_pin.scene.friction import FrictionTable
from graspless_pin.scene.joints import (
    ControlledJoints,
    joint_columns,
    torque_limits,
    weight_torques,
)
from graspless_pin.scene.motion_and_contacts import SceneContacts
from graspless_pin.scene.touching import label_of

if TYPE_CHECKING:
    from graspless_pin.scene.scene import Scene


class JointedContacts(NamedTuple):
    """The contacts of a scene and the joints there.

    Attributes:
        contacts: M contacts.
        positions: (M, 3) about the object's centre of mass, world axes, m.
        tangents: (M, 3, 2), world axes.
        joints: L joints.
    """

    contacts: SceneContacts
    positions: FloatArray
    tangents: FloatArray
    joints: ControlledJoints


class Loads(NamedTuple):
    """What bears on the contacts of a scene, and what they and its joints take.

    Attributes:
        wrench: (6,) of the object's weight about its centre of mass, world axes.
        friction: (M,) coefficients.
        limits: (lower, upper), each (L,), N m or N.
        gravity_torques: (L,) g(q).
        max_normal_force: Of each contact, N.
    """

    wrench: FloatArray
    friction: FloatArray
    limits: tuple[FloatArray, FloatArray]
    gravity_torques: FloatArray
    max_normal_force: float

    def row(self) -> FloatArray:
        """Return them one after the other, as `compiled.loaded_states` takes them."""
        most = np.full(len(self.friction), self.max_normal_force)
        return np.concatenate(
            (self.friction, self.wrench, *self.limits, self.gravity_torques, most)
        )


def jointed_contacts(scene: Scene) -> JointedContacts:
    """Return contacts and joints of a scene: the same object as before if they are the same.

    Raises:
        SceneError: See `Scene.contacts`; or if a hybrid finger touches at several points.
    """
    hand, center = scene.hand, scene.object.center_of_mass_world
    of_hand = () if hand is None else (hand.positions, hand.tree, hand.actuation, hand.control)

    def made() -> JointedContacts:
        contacts = scene.contacts
        touching = contacts.arrays
        tangents = projected_tangents(touching.normals, scene.tangent_axes)
        try:
            joints = joint_columns(hand, touching)
        except SceneError as error:
            raise error.at(label_of(scene)) from error
        return JointedContacts(contacts, touching.positions - center, tangents, joints)

    sources = scene._touching, center.tobytes(), scene.tangent_axes, scene.motion, scene.supports
    return scene._kept.of("jointed contacts", (*sources, *of_hand), made)


def loads_of(scene: Scene, state: JointedContacts) -> Loads:
    """Return what bears on the contacts of a scene, and what they and its joints take.

    Args:
        scene: The scene.
        state: Its contacts and joints.

    Raises:
        SceneError: If a body that touches has no coefficient of friction.
    """
    mass, gravity, most, kept = (
        scene.object.mass, scene.gravity, scene.max_normal_force, scene._kept,
    )  # fmt: skip
    materials = scene.hand_material, scene.object.material, scene.materials
    rubbing = scene.supports, scene.friction, *materials
    table = kept.of("friction", rubbing, lambda: FrictionTable(*rubbing))
    try:
        coefficients = table.coefficients(state.contacts.arrays)
    except SceneError as error:
        raise error.at(label_of(scene)) from error
    hand, hybrid = scene.hand, state.joints.hybrid_count
    carried = gravity if scene.count_own_weight else None
    return Loads(
        kept.of("weight", (mass, gravity), lambda: np.concatenate([mass * gravity, np.zeros(3)])),
        coefficients,
        torque_limits(hand, hybrid, scene.hybrid_force_limit or most),
        kept.of("carried", (state, carried), lambda: weight_torques(hand, hybrid, carried)),
        most,
    )
