"""A scene as a MuJoCo model (MJCF): the same shapes, poses, inertias, friction and motors.

Also which joints of a hand move in a simulation, and the commands of their motors.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from graspless_pin.errors import SceneError
from graspless_pin.geometry import BodyKind, ManipulatedObject, unwanted_overlaps
from graspless_pin.geometry.hand.joint_columns import JointedBody, jointed_bodies
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import invert, turned_about
from graspless_pin.geometry.posing.finger_joints import hand_with_moved_actuators
from graspless_pin.holding.controller import ARMATURE, Controller, gain_shares
from graspless_pin.holding.dynamics import contact_jacobian
from graspless_pin.problem import ControlMode, QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, motor_torques
from graspless_pin.records import Record
from graspless_pin.scene import Scene, SceneContacts
from graspless_pin.scene.fields import label_of
from graspless_pin.scene.load_wrenches import ActingForce, acting_forces, hand_motion
from graspless_pin.scene.problem_data import fingers_of_motors, friction_at
from graspless_pin.simulation.mjcf import (
    HAND,
    OBJECT,
    Mjcf,
    add,
    add_mass,
    add_tendon,
    check_at_rest,
    write_object,
    write_supports,
)


class Axis(NamedTuple):
    """The axis of a joint that moves.

    Attributes:
        name: Name of the joint; for a hybrid finger, ``FINGER.normal_force``.
        linear: Whether it is prismatic.
        direction: (3,) unit vector, world axes.
        hybrid: Whether it represents a hybrid finger, which moves along its contact's normal.
    """

    name: str
    linear: bool
    direction: FloatArray
    hybrid: bool


@dataclass(frozen=True, eq=False)
class DrivenJoints:
    """The moving joints of a hand of n joints, and their motors.

    Attributes:
        axes: Joint axes by the index of the body that each moves.
        motors: Names of the joints that have a motor.
        commands: (k,) torque or force of each motor, N m or N.
        idle: (k,) commands without contacts, which carry the hand's own weight.
        carried: (n,) whether a body's weight is carried by a hybrid finger's position control.
    """

    axes: Mapping[int, Axis]
    motors: tuple[str, ...]
    commands: FloatArray
    idle: FloatArray
    carried: NDArray[np.bool_]


NOTHING_DRIVEN = DrivenJoints({}, (), np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool))
"""The moving joints of a scene without a hand."""


def driven_joints(
    hand: Hand,
    bodies: Sequence[JointedBody],
    contacts: SceneContacts,
    torques: FloatArray,
    gravity_torques: FloatArray,
) -> DrivenJoints:
    """Return the joints that move: force-controlled ones of touching links, and hybrid fingers.

    Joints on common tendons move together.

    Args:
        hand: The hand.
        bodies: Its n bodies.
        contacts: The scene's contacts.
        torques: (L,) the motors' torques: actuators, then commands of hybrid fingers.
        gravity_torques: (L,) the part of the torques that carries the hand's own weight.
    """
    tree, coupling = hand.tree, hand.tree.coupling
    count = len(hand.actuated_joint_names)
    touching = contacts.arrays.bodies[: contacts.arrays.hand_count]
    moves = tree.supports[[tree.link_joints[link] for link in touching]].any(axis=0)
    forced = np.array([mode is ControlMode.FORCE for mode in hand.control.joints.values()])
    free = forced & (coupling.S[moves] != 0.0).any(axis=0)
    acts = hand.actuation.from_independent != 0.0
    free |= acts[:, acts[free].any(axis=0)].any(axis=1)
    axes = {
        index: Axis(bodies[index].joint, bodies[index].linear, bodies[index].axis, hybrid=False)
        for index in np.flatnonzero((coupling.S[:, free] != 0.0).any(axis=1)).tolist()
    }
    motors = [bodies[index].joint for index in np.array(coupling.leaders)[free].tolist()]
    carried = np.zeros(len(bodies), dtype=bool)
    for index, axis in _hybrid_axes(hand, contacts):
        axes[index] = axis
        motors.append(axis.name)
        carried |= tree.supports[1:, index]
    # The joint torques that correspond to the actuators' efforts, see `Actuation`.
    of_efforts = np.linalg.pinv(hand.actuation.from_independent.T)[free]
    commands, idle = (
        np.concatenate([of_efforts @ efforts[:count], efforts[count:]])
        for efforts in (torques, gravity_torques)
    )
    return DrivenJoints(axes, tuple(motors), commands, idle, carried)


def _hybrid_axes(hand: Hand, contacts: SceneContacts) -> Iterator[tuple[int, Axis]]:
    """Yield the first body and the axis of each touching hybrid finger, in the order of J."""
    touching, tree = contacts.arrays, hand.tree
    for link, normal in zip(touching.bodies[: touching.hand_count], touching.normals, strict=False):
        finger = hand.finger_of(link)
        if finger in hand.control.hybrid_fingers:
            own = [tree.joint_index[joint] for joint in hand.fingers[finger].joints]
            first = min(index for index in own if tree.supports[tree.link_joints[link], index])
            yield first, Axis(f"{finger}.normal_force", linear=True, direction=normal, hybrid=True)


TIME_STEP = 5e-4
"""s."""
HOLDING_GAIN = 1e2
"""N m/rad: feedback that keeps joints in place."""
_OUT_OF_REACH = 1e-3
"""Relative to the largest singular value: gaps that need large rotations to close stay open."""
_LEVER, _TURN = 0.05, 0.1
"""m, and weight of the object's rotation relative to joints, which close gaps first."""
_NEWTON_STEPS, _CLOSED = 5, 1e-6
"""Largest number of steps that close gaps, and the step size at which they end, rad and m."""
_START_OVERLAP = 1e-6
"""m: initial overlap of moving links and the object, more than the gap that closing leaves."""
FIXTURE = "fixture"
"""Name of the weld that holds the object before its release."""


@dataclass(frozen=True)
class ContactModel:
    """Stiffness of contacts, which are never rigid in a simulator.

    See the example of `simulate`.

    Attributes:
        name: ``stiff`` or ``soft``.
        time_constant: Time constant of the decay of an overlap, s (solref).
        impedance: Share of a contact's acceleration that its constraint takes, at no overlap and
            at 1 mm (solimp).
    """

    name: str
    time_constant: float
    impedance: tuple[float, float]


STIFF = ContactModel("stiff", 1e-3, (0.99, 0.999))
SOFT = ContactModel("soft", 1e-2, (0.9, 0.99))


@dataclass(frozen=True, eq=False)
class SimulationModel(Record):
    """The MuJoCo model of a scene with its torques.

    See the example of `simulation_model`.

    Attributes:
        xml: The MJCF document; its key frame ``torques`` has the motors' commands.
        motors: Names of the motors: joints, and the normal force of hybrid fingers.
        commands: (k,) torque or force of each motor, N m or N.
        idle: (k,) commands without contacts, which carry the hand's own weight.
        links: Name of the hand link or support by the name of its shape in the document.
        left_out: Pairs of a link and a support that overlap at the start: contacts between the two
            are left out.
        joints: Names of the k joints that move.
        joint_rates: (k, L) their rates per rate of the problem's joints; zero for hybrid fingers.
        closing: (k,) joint motions from the scene's configuration that close the gaps of contacts,
            with a micrometre of overlap of moving links, rad or m.
        object: The object, moved from its pose in the scene for the same reason.
        loads: Forces on it besides gravity.
        link_wrenches: (6,) inertial [force; moment] about the centre of mass of each body of the
            hand that accelerates, world axes, N and N m, by its name in the document.
    """

    xml: str
    motors: tuple[str, ...]
    commands: FloatArray
    idle: FloatArray
    links: dict[str, str]
    left_out: tuple[tuple[str, str], ...]
    joints: tuple[str, ...]
    joint_rates: FloatArray
    closing: FloatArray
    object: ManipulatedObject
    loads: tuple[ActingForce, ...]
    link_wrenches: Mapping[str, FloatArray]


def simulation_model(
    scene: Scene,
    torques: ArrayLike | Mapping[str, float],
    *,
    controller: Controller | float | None = None,
    friction_factor: float = 1.0,
    contact_model: ContactModel = STIFF,
) -> SimulationModel:
    """Return the MuJoCo model of a scene at rest.

    It has all collision shapes of object, hand and supports. Contacts among hand links are left
    out: collision shapes of neighbours overlap. Joints that are position-controlled, or move no
    link that touches the object, are fixed; a hybrid finger slides along its contact's normal.
    Joint coordinates are relative to the scene's configuration.

    Args:
        scene: The scene, without a declared motion.
        torques: (L,) the motors' torques, as solutions of the scene's problem give them, or by
            joint (`torques_by_joint`), N m (N).
        controller: Controller of the free joints in addition to the torques, or the stiffness of
            its position feedback, N m/rad; None: the scene's. Joints keep their own damping.
        friction_factor: Factor of all coefficients of friction.
        contact_model: Stiffness of contacts.

    Raises:
        ArgumentError: If the torques have the wrong shape.
        SceneError: If the scene declares a motion, has a body without a coefficient of friction or
            a cone model other than Coulomb's law, or see `Scene.contacts`.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.simulation import simulation_model
        >>> scene = load_scene("examples/paper/sphere_on_slope.yaml")
        >>> model = simulation_model(scene, scene.solve().torques)
        >>> type(model).__name__
        'SimulationModel'
    """
    check_at_rest(scene)
    problem = scene.problem()
    if not problem.cone_model.is_coulomb:
        raise SceneError(
            f"{label_of(scene)}: cone: is {problem.cone!r}, but the simulation requires Coulomb's "
            "law; use 'edges' or 'round'"
        )
    tau = motor_torques(problem.joint_names, torques)
    feedback = (
        scene.controller if controller is None else Controller.parse("controller", controller)
    )
    document = Mjcf(scene.name)
    write_options(document, scene, contact_model)
    links = dict(
        write_supports(document, scene, prefix="support/", friction_factor=friction_factor)
    )
    left_out: tuple[tuple[str, str], ...] = ()
    joints, wrenches = NOTHING_DRIVEN, dict[str, FloatArray]()
    hand = scene.hand
    if hand is not None:
        bodies = jointed_bodies(hand)
        joints = driven_joints(hand, bodies, scene.contacts, tau, problem.gravity_torques)
        elements = _write_hand(document, scene, bodies, joints, feedback)
        links |= _write_links(document, scene, hand, elements, friction_factor)
        _write_couplings(document, hand, joints)
        left_out = _write_exclusions(document, scene, hand)
        wrenches = _link_wrenches(scene, hand, joints)
    rates = _joint_rates(hand, joints, problem.joint_count)
    travel, manipulated = _with_closed_gaps(scene, rates)
    write_object(document, scene, manipulated)
    add(document.section("equality"), "weld", name=FIXTURE, body1=OBJECT)
    _write_motors(document, joints)
    return SimulationModel(
        document.text(),
        joints.motors,
        joints.commands,
        joints.idle,
        links,
        left_out,
        tuple(axis.name for axis in joints.axes.values()),
        rates,
        travel,
        manipulated,
        tuple(force for force in acting_forces(scene) if not force.of_gravity),
        wrenches,
    )


def _link_wrenches(scene: Scene, hand: Hand, joints: DrivenJoints) -> dict[str, FloatArray]:
    """Return the inertial wrench, about its centre of mass, of each body whose weight counts."""
    motions = hand_motion(scene)
    if motions is None or not scene.count_own_weight:
        return {}
    bodies = zip(hand.joint_names, joints.carried, motions.inertial_wrenches(hand)[1:], strict=True)
    return {f"hand/{joint}": wrench for joint, carried, wrench in bodies if not carried}


def _joint_rates(hand: Hand | None, joints: DrivenJoints, count: int) -> FloatArray:
    """Return the (k, L) rates of the joints that move per rate of the problem's joints."""
    rates = np.zeros((len(joints.axes), count))
    if hand is not None:
        own = hand.actuation.from_joints[[*joints.axes]]
        rates[:, : own.shape[1]] = own
        rates[[axis.hybrid for axis in joints.axes.values()]] = 0.0
    return rates


def _with_closed_gaps(scene: Scene, rates: FloatArray) -> tuple[FloatArray, ManipulatedObject]:
    """Return the (k,) joint motions that close the gaps of contacts, and the object then.

    Fingers that cross a gap under torques would bend on the way, and shift the object if one of
    them arrives first. If friction bears most of a torque, a tip without contact may even slide
    along the object and off it. Gaps are closed by Newton's method, as tips move on curves.
    """
    is_moving, travel = np.any(rates != 0.0, axis=0), np.zeros(len(rates))
    moved_scene, hand, manipulated = scene, scene.hand, scene.object
    for _ in range(_NEWTON_STEPS):
        step = _closing_step(moved_scene.contacts, moved_scene.problem(), is_moving)
        travel += rates @ step[6:]
        manipulated = _displaced_object(manipulated, step[:6])
        if np.abs(step).max() < _CLOSED:
            break
        try:
            hand = None if hand is None else hand_with_moved_actuators(hand, step[6:])
            moved_scene = moved_scene.with_changes(object=manipulated, hand=hand)
            has_all = moved_scene.problem().joint_count == len(is_moving)
        except SceneError:  # a joint beyond its limits, which the simulation does not have
            has_all = False
        if not has_all:
            break
    return travel, manipulated


def _closing_step(
    contacts: SceneContacts, problem: QuasistaticProblem, moves: NDArray[np.bool_]
) -> FloatArray:
    """Return the least motion (6 + L,) of the object and the moving joints that closes gaps.

    The object moves if joints cannot close a gap.
    """
    share = np.concatenate([np.full(3, _TURN * _LEVER), np.full(3, _TURN), moves.astype(float)])
    approach = contact_jacobian(problem)[:, 0] * share
    gaps = -np.array(contacts.arrays.distances)
    gaps[approach[:, 6:].any(axis=1)] -= _START_OVERLAP
    steps, *_ = np.linalg.lstsq(approach, gaps, rcond=_OUT_OF_REACH)
    return share * np.asarray(steps, dtype=float)


def _displaced_object(manipulated: ManipulatedObject, motion: FloatArray) -> ManipulatedObject:
    """Return the object after a motion (6,): translation, m, and rotation about its centre, rad."""
    R = Rotation.from_rotvec(motion[3:]).as_matrix()
    move = turned_about(manipulated.center_of_mass_world, R, motion[:3])
    return manipulated.with_pose(move @ manipulated.T_world_object)


def write_options(document: Mjcf, scene: Scene, contact_model: ContactModel) -> None:
    """Write the options of MuJoCo's solver, and the contact model."""
    add(document.root, "compiler", angle="radian", boundmass=1e-6, boundinertia=1e-9,
        balanceinertia=True)  # fmt: skip
    # Defaults (pyramidal cones, impratio 1) creep at 1.3 times the critical friction.
    option = add(document.root, "option", timestep=TIME_STEP, gravity=scene.gravity,
        integrator="implicitfast", cone="elliptic", impratio=1000.0, noslip_iterations=30,
        iterations=100, tolerance=1e-10)  # fmt: skip
    # The default estimate of a contact's inertia omits armature: light links would be soft. The
    # default detector rotates normals of meshes by degrees if bodies overlap by nanometres.
    add(option, "flag", diagexact="enable", nativeccd="disable")
    add(document.section("visual"), "headlight", ambient=[0.4] * 3, diffuse=[0.6] * 3)
    geom = add(document.section("default"), "geom")
    soft = add(document.section("default"), "equality")
    low, high = contact_model.impedance
    for element in (geom, soft):
        element.set("solref", f"{contact_model.time_constant} 1")
        element.set("solimp", f"{low} {high} 0.001 0.5 2")


def _write_hand(
    document: Mjcf,
    scene: Scene,
    bodies: Sequence[JointedBody],
    joints: DrivenJoints,
    controller: Controller,
) -> list[ET.Element]:
    """Write the hand's bodies and joints; return the base's element, then those of the bodies."""
    fingers = {} if scene.hand is None else fingers_of_motors(scene.hand)
    moving = [*joints.axes.values()]
    shares = gain_shares([axis.linear for axis in moving])
    stiffness, damping = controller.gains([axis.name for axis in moving], shares, fingers)
    if controller.holds_joints:
        stiffness = HOLDING_GAIN * shares
    figures = np.column_stack([stiffness, damping, ARMATURE * shares])
    figures_by_body = dict(zip(joints.axes, figures.tolist(), strict=True))
    poses: list[FloatArray] = [np.eye(4)]
    elements = [document.add_body(document.section("worldbody"), "hand", np.eye(4))]
    for index, body in enumerate(bodies):
        parent = 0 if body.parent is None else body.parent + 1
        poses.append(body.T_world_body)
        T = invert(poses[parent]) @ body.T_world_body
        element = document.add_body(elements[parent], f"hand/{body.joint}", T)
        elements.append(element)
        add_mass(element, body.mass, body.center_of_mass, body.inertia)
        if joints.carried[index] or not scene.count_own_weight:
            element.set("gravcomp", "1")
        axis = joints.axes.get(index)
        if axis is not None:
            add(
                element,
                "joint",
                name=axis.name,
                type="slide" if axis.linear else "hinge",
                axis=body.T_world_body[:3, :3].T @ axis.direction,
                damping=figures_by_body[index][1],
                armature=max(body.rotor_inertia, figures_by_body[index][2]),
                stiffness=0.0 if axis.hybrid else figures_by_body[index][0],
            )
    return elements


def _write_links(
    document: Mjcf,
    scene: Scene,
    hand: Hand,
    elements: Sequence[ET.Element],
    friction_factor: float,
) -> Iterator[tuple[str, str]]:
    """Write the links' shapes; yield the name of each, and the link's."""
    carriers, placements = hand.tree.shape_placements
    shapes = zip(hand.tree.shapes.names, hand.tree.shapes.geometries, strict=True)
    for number, (link, geometry) in enumerate(shapes):
        name = f"hand/{link}/{number}"
        element = elements[int(carriers[number])]
        friction = friction_factor * friction_at(scene, "hand", link)
        document.add_shape(element, name, geometry, placements[number], friction, HAND)
        yield name, link


def _write_couplings(document: Mjcf, hand: Hand, joints: DrivenJoints) -> None:
    """Couple joints that follow others to their leaders, by tendons of constant length."""
    coupling = hand.tree.coupling
    for index in sorted(joints.axes.keys() - set(coupling.leaders)):
        name, *_ = joints.axes[index]
        arms = {
            joints.axes[leader].name: -float(factor)
            for leader, factor in zip(coupling.leaders, coupling.S[index], strict=True)
            if factor and leader in joints.axes
        }
        add_tendon(document, f"coupling/{name}", {name: 1.0} | arms)
        add(document.section("equality"), "tendon", tendon1=f"coupling/{name}")


def _write_exclusions(document: Mjcf, scene: Scene, hand: Hand) -> tuple[tuple[str, str], ...]:
    """Exclude contacts between links and the supports that they overlap; return these pairs."""
    names = ("hand", *(f"hand/{joint}" for joint in hand.joint_names))
    pairs = [
        (overlap.link, overlap.other)
        for overlap in unwanted_overlaps(hand, scene.supports)
        if overlap.kind is BodyKind.SUPPORT
    ]
    bodies = {(names[hand.tree.link_joints[link]], support) for link, support in pairs}
    for body, support in sorted(bodies):
        add(document.section("contact"), "exclude", body1=body, body2=f"support/{support}")
    return tuple(pairs)


def _write_motors(document: Mjcf, joints: DrivenJoints) -> None:
    for name in joints.motors:
        add(document.section("actuator"), "motor", name=name, joint=name)
    if joints.motors:
        add(document.section("keyframe"), "key", name="torques", ctrl=joints.commands)
