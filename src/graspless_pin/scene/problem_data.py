"""Data of a scene's problem: contacts and joints, and the loads, friction and limits there.

The joints are columns of J: those under force control, then hybrid fingers. Where only loads,
friction or limits change, `JointedContacts` stays the same object: one loop may then solve many
such scenes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import compress
from operator import is_not
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.caching import Derived
from graspless_pin.errors import SceneError, StateError, StateFault
from graspless_pin.geometry.contact.contact_points import ContactArrays
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, JointUnit, read_only
from graspless_pin.problem.cones import projected_tangents
from graspless_pin.problem.derived_inertias import with_derived_inertias
from graspless_pin.problem.own_arrays import problem_of_own_arrays
from graspless_pin.scene.contact_arrays import SceneContacts, contacts_of, touching_of
from graspless_pin.scene.fields import SceneFields, label_of
from graspless_pin.scene.load_wrenches import inertial_torques, object_inertia, object_wrench


class ControlledJoints(NamedTuple):
    """The L joints that are columns of J.

    Attributes:
        jacobian: (3M, L) J of eq. (12), world axes.
        names: L names.
        units: L units of their torques.
        hybrid_count: Number of hybrid fingers, which come last.
    """

    jacobian: FloatArray
    names: tuple[str, ...]
    units: tuple[JointUnit, ...]
    hybrid_count: int = 0


class JointedContacts(NamedTuple):
    """The contacts of a scene and the joints that act there.

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
    """Loads, friction and limits of a scene's problem.

    Attributes:
        wrench: (6,) of weight and loads about the object's centre of mass, world axes, N and N m.
        friction: (M,) coefficients.
        limits: (lower, upper) torque limits, each (L,), N m or N.
        gravity_torques: (L,) g(q) and the torques that accelerate the links, N m or N.
        max_normal_force: Limit at each contact, N.
    """

    wrench: FloatArray
    friction: FloatArray
    limits: tuple[FloatArray, FloatArray]
    gravity_torques: FloatArray
    max_normal_force: float

    def row(self) -> FloatArray:
        """Return all figures concatenated in the order that `compiled.core` takes."""
        force_limits = np.full(len(self.friction), self.max_normal_force)
        return np.concatenate(
            (self.friction, self.wrench, *self.limits, self.gravity_torques, force_limits)
        )


def rest_problem(
    scene: SceneFields, problem: QuasistaticProblem, torques: FloatArray
) -> QuasistaticProblem:
    """Return the problem of rest under the scene's controller, which may hold all joints.

    Args:
        scene: The scene.
        problem: Its problem.
        torques: (L,) motor torques, N m (N).
    """
    if not scene.controller.holds_joints:
        return problem
    # Imported here: scenes that are solved without a verdict do not need it.
    from graspless_pin.holding.dynamics import with_joints_held

    return with_joints_held(problem, torques, np.arange(problem.joint_count))


def problem_of(scene: SceneFields) -> QuasistaticProblem:
    """Return the problem of a scene: see `Scene.problem`.

    Cached: scenes that differ only in `_NOT_OF_PROBLEMS` share one problem.
    """
    sources = [value for name, value in vars(scene).items() if name not in _NOT_OF_PROBLEMS]
    return scene._cache.value(
        "problem", (*sources,), lambda: problem_at(scene, jointed_contacts(scene))
    )


def problem_at(scene: SceneFields, state: JointedContacts) -> QuasistaticProblem:
    """Return a new problem of a scene from its contacts and joints.

    Args:
        scene: The scene.
        state: What `jointed_contacts` returns for it.

    Raises:
        SceneError: See `loads_of`.
    """
    contacts, joints, loads = state.contacts, state.joints, loads_of(scene, state)
    # Stated contacts have to be checked; found ones are valid.
    make_problem = problem_of_own_arrays if scene.given_contacts is None else QuasistaticProblem
    problem = make_problem(
        state.positions,
        contacts.arrays.normals,
        loads.wrench,
        joints.jacobian,
        friction=loads.friction,
        tangents=state.tangents,
        sliding=contacts.sliding,
        torque_limits=loads.limits,
        max_normal_force=loads.max_normal_force,
        cone_edges=scene.cone_edges,
        cone=scene.cone,
        joint_names=joints.names,
        joint_units=joints.units,
        gravity_torques=loads.gravity_torques,
    )
    joint_inertia = partial(column_inertia, scene.hand, len(joints.names))
    sources = {"object_inertia": partial(object_inertia, scene), "joint_inertia": joint_inertia}
    return with_derived_inertias(problem, sources)


def jointed_contacts(scene: SceneFields) -> JointedContacts:
    """Return contacts and joints of a scene; the same object while they do not change.

    Raises:
        SceneError: See `Scene.contacts`; or if a hybrid finger touches at several points.
    """
    hand, center, all_contacts = scene.hand, scene.object.center_of_mass_world, touching_of(scene)
    hand_data = () if hand is None else (hand.positions, hand.tree, hand.actuation, hand.control)
    contact_data = all_contacts, center.tobytes(), scene.tangent_axes, scene.motion, scene.supports
    sources = *contact_data, *hand_data
    return scene._cache.value("jointed contacts", sources, lambda: _find_jointed_contacts(scene))


def _find_jointed_contacts(scene: SceneFields) -> JointedContacts:
    contacts = contacts_of(scene)
    touching = contacts.arrays
    tangents = projected_tangents(touching.normals, scene.tangent_axes)
    try:
        joints = joint_columns(scene.hand, touching)
    except SceneError as error:
        raise error.at(label_of(scene)) from error
    levers = touching.positions - scene.object.center_of_mass_world
    return JointedContacts(contacts, levers, tangents, joints)


def loads_of(scene: SceneFields, state: JointedContacts) -> Loads:
    """Return loads, friction and limits of a scene's problem.

    Args:
        scene: The scene.
        state: Its contacts and joints.

    Raises:
        SceneError: If a touching body has no coefficient of friction.
    """
    return Loads(
        object_wrench(scene),
        _friction_coefficients(scene, state),
        _torque_limits(scene, state),
        _gravity_torques(scene, state),
        scene.max_normal_force,
    )


def updated_load_row(
    scene: SceneFields, state: JointedContacts, before: SceneFields, row: FloatArray
) -> FloatArray | None:
    """Return the row of a scene that may have the same contacts and joints as an earlier one.

    A field counts as replaced if it is another object, as changed scenes share unchanged fields.

    Args:
        scene: The scene.
        state: Contacts and joints of the earlier scene.
        before: The earlier scene.
        row: Its row, see `Loads.row`.

    Returns:
        The row; None if a field was replaced that contacts or joints may depend on.

    Raises:
        SceneError: See `loads_of`.
    """
    new, old = vars(scene), vars(before)
    renewed = {*compress(new, map(is_not, new.values(), map(old.get, new)))} - _NO_LOADS
    if not renewed <= _BEARING:
        return None
    count, joints = len(state.positions), len(state.joints.names)
    limits = count + 6
    row = row.copy()
    if not renewed.isdisjoint(_OF_FRICTION):
        row[:count] = _friction_coefficients(scene, state)
    if not renewed.isdisjoint(_OF_LOADS):
        row[count:limits] = object_wrench(scene)
        row[limits + 2 * joints : limits + 3 * joints] = _gravity_torques(scene, state)
    if not renewed.isdisjoint(_OF_LIMITS):
        row[limits : limits + 2 * joints] = np.concatenate(_torque_limits(scene, state))
        row[limits + 3 * joints :] = scene.max_normal_force
    return row


_OF_FRICTION = frozenset({"friction", "materials", "hand_material"})
_OF_LIMITS = frozenset({"max_normal_force", "hybrid_force_limit"})
_OF_LOADS = frozenset({"gravity", "loads", "acceleration"})
_NOT_OF_PROBLEMS = frozenset({
    "name", "path", "controller", "uncertainty", "solve_options", "load_findings", "contacts",
    "findings", "_source", "_cache",
})  # fmt: skip
"""Fields and cached values on which a problem does not depend."""
_BEARING = _OF_FRICTION | _OF_LIMITS | _OF_LOADS
"""Fields of a scene on which neither its contacts nor its joints depend."""
_NO_LOADS = frozenset({"name", "load_findings", "contacts", "findings", "_source"})
"""Descriptions of a scene, and values derived from its fields."""


def _friction_coefficients(scene: SceneFields, state: JointedContacts) -> FloatArray:
    """Return (M,) coefficients of friction, read-only."""
    bodies, body_index = _touched_bodies(state.contacts.arrays)
    by_body = [friction_at(scene, group, body) for group, body in bodies]
    return read_only(np.array(by_body, dtype=np.float64)[body_index])


@Derived
def _touched_bodies(contacts: ContactArrays) -> tuple[Sequence[tuple[str, str]], NDArray[np.int_]]:
    """Return (group, name) of each touching body, for `friction_at`, and (M,) its index."""
    count = contacts.hand_count
    sides = [("hand" if k < count else "supports", name) for k, name in enumerate(contacts.bodies)]
    bodies = [*dict.fromkeys(sides)]
    return bodies, np.array([bodies.index(side) for side in sides], dtype=np.int_)


def friction_at(scene: SceneFields, group: str, body: str) -> float:
    """Return the friction coefficient of a body: a support's own, else by materials, else by name.

    Args:
        scene: The scene.
        group: ``hand`` or ``supports``.
        body: The hand link or support.

    Raises:
        SceneError: If it has none.
    """
    material = scene.hand_material
    for support in scene.supports if group == "supports" else ():
        if support.name == body:
            if support.friction is not None:
                return support.friction
            material = support.material
            break
    object_material = scene.object.material
    if material is not None and object_material is not None:
        return scene.materials.friction(material, object_material)
    for key in (body, group, "default"):
        if key in scene.friction:
            return scene.friction[key]
    raise SceneError(
        f"{label_of(scene)}: friction: has no coefficient for {body!r}; add {body!r}, {group!r} "
        "or 'default'"
    )


def _torque_limits(scene: SceneFields, state: JointedContacts) -> tuple[FloatArray, FloatArray]:
    """Return the torque limits (lower, upper), each (L,), N m or N."""
    hybrid = state.joints.hybrid_count
    if scene.hand is None:
        return np.zeros(0), np.zeros(0)
    lower, upper = scene.hand.effort_limits
    if not hybrid:
        return lower, upper
    limit = scene.hybrid_force_limit
    hybrid_limits = np.full(hybrid, scene.max_normal_force if limit is None else limit)
    return np.concatenate([lower, np.zeros(hybrid)]), np.concatenate([upper, hybrid_limits])


def _gravity_torques(scene: SceneFields, state: JointedContacts) -> FloatArray:
    """Return (L,) joint torques against the links' weight, and for their acceleration."""
    hand, hybrid = scene.hand, state.joints.hybrid_count
    gravity = scene.gravity if scene.count_own_weight else None

    def link_torques() -> FloatArray:
        torques = np.zeros(len(state.joints.names))
        motors = len(torques) - hybrid
        if hand is not None and gravity is not None and motors:
            torques[:motors] = hand.gravity_torques(gravity)
        return torques

    carried = scene._cache.value("carried", (state, gravity), link_torques)
    if gravity is None or scene.acceleration is None:
        return carried
    return carried + np.concatenate([inertial_torques(scene), np.zeros(hybrid)])


def joint_columns(hand: Hand | None, touching: ContactArrays) -> ControlledJoints:
    """Return the columns of J: force-controlled joints, then hybrid fingers.

    Args:
        hand: The hand at its configuration; None: no columns.
        touching: M contacts, hand first.

    Raises:
        StateError: If a hybrid finger touches at several points.
    """
    if hand is None:
        return ControlledJoints(np.zeros((3 * len(touching), 0)), (), ())
    count = touching.hand_count
    links = (*touching.bodies[:count], *(None,) * (len(touching.bodies) - count))
    jacobian = hand.contact_jacobian(links, touching.positions)
    joints = ControlledJoints(jacobian, hand.actuated_joint_names, hand.effort_units)
    return _with_hybrid_fingers(joints, hand, touching) if hand.control.hybrid_fingers else joints


def possible_columns(hand: Hand | None) -> dict[str, JointUnit]:
    """Return the units, by name, of all columns that `joint_columns` may have for any contacts."""
    if hand is None:
        return {}
    forces = dict.fromkeys(map(_column_name, hand.control.hybrid_fingers), JointUnit.FORCE)
    return dict(zip(hand.actuated_joint_names, hand.effort_units, strict=True)) | forces


def column_inertia(hand: Hand | None, count: int) -> FloatArray:
    """Return the (L, L) inertia of the columns of J: zero for hybrid fingers.

    Args:
        hand: The hand at its configuration; None: no columns.
        count: L, the number of columns.
    """
    inertia = np.zeros((count, count))
    if hand is not None:
        own = hand.joint_inertia()
        inertia[: len(own), : len(own)] = own
    return inertia


def fingers_of_motors(hand: Hand) -> dict[str, str]:
    """Return the finger of each motor that moves links of one finger only."""
    moved: dict[str, set[str | None]] = {}
    for link, carrier in hand.tree.link_joints.items():
        own = np.abs(hand.actuation.from_joints[hand.tree.supports[carrier]]).sum(axis=0)
        for column in np.flatnonzero(own):
            moved.setdefault(hand.actuation.names[column], set()).add(hand.finger_of(link))
    return {
        name: finger
        for name, fingers in moved.items()
        if len(fingers - {None}) == 1
        for finger in fingers
        if finger is not None
    }


def _with_hybrid_fingers(
    joints: ControlledJoints, hand: Hand, touching: ContactArrays
) -> ControlledJoints:
    """Return joints with a column n added for the one contact of each hybrid finger (Sec. II-A)."""
    names = list(joints.names)
    hybrid = [
        index
        for index, link in enumerate(touching.bodies[: touching.hand_count])
        if hand.is_hybrid(link)
    ]
    columns = np.zeros((len(joints.jacobian), len(hybrid)))
    for column, index in enumerate(hybrid):
        columns[3 * index : 3 * index + 3, column] = touching.normals[index]
        finger = hand.finger_of(touching.bodies[index])
        name = _column_name(finger)
        if name in names:
            raise StateError(
                StateFault.AMBIGUOUS,
                f"hybrid finger {finger!r} touches the object at several points; a hybrid finger "
                "must have exactly one contact: give its contact, or use control: force for it",
            )
        names.append(name)
    units = (*joints.units, *(JointUnit.FORCE for _ in hybrid))
    jacobian = np.hstack([joints.jacobian, columns])
    return ControlledJoints(jacobian, tuple(names), units, len(hybrid))


def _column_name(finger: str | None) -> str:
    """Return the name of a hybrid finger's column."""
    return f"{finger}.normal_force"
