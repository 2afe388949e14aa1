"""A scene as a complete MJCF, for MuJoCo: all joints of the hand, their limits and motors.

`simulation_model` writes a different one, of a scene under given torques: only the joints that move
there, with the gaps to the object closed.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import SceneError
from graspless_pin.geometry.hand.joint_columns import (
    JointedBody,
    PlacedLink,
    jointed_bodies,
    placed_links,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import invert
from graspless_pin.intake.yaml_source import plain
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import Scene
from graspless_pin.scene.fields import label_of
from graspless_pin.scene.problem_data import friction_at
from graspless_pin.scene.serialization import hand_entry, scene_entry
from graspless_pin.simulation.mjcf import (
    HAND,
    Mjcf,
    add,
    add_mass,
    add_tendon,
    check_at_rest,
    write_object,
    write_supports,
)
from graspless_pin.simulation.model import STIFF, write_options

CUSTOM_TEXT = "graspless_pin"
"""Name of the text under ``<custom>`` with the fields that MJCF cannot state."""
KEYFRAME = "scene"
"""Name of the keyframe that holds the scene's configuration."""
NO_WORD_FOR = (
    "max_normal_force", "cone_edges", "cone", "contact_tolerance", "max_penetration",
    "points_per_patch", "tangent_axes", "count_own_weight", "hybrid_force_limit", "solve_options",
)  # fmt: skip
"""Fields of a scene that are written to this text."""

_LIGHTEST = 1e-9, 1e-12
"""kg and kg m^2: written for a moving body without mass, which MuJoCo refuses."""


def scene_to_mjcf(scene: Scene) -> str:
    """Return a scene as an MJCF that `scene_from_mjcf` reads back to the same problem.

    Links and joints keep their names; the keyframe ``scene`` has the configuration. A link's
    shapes are those used to find contacts: a mesh is written as its convex hull. Motors have the
    effort limits as ``ctrlrange``. Fields that MJCF cannot state (control modes, fingers, the
    largest normal force, tolerances) are in a text under ``<custom>`` that MuJoCo does not read.

    Args:
        scene: The scene, at rest and without given contacts.

    Raises:
        SceneError: If a body moves or accelerates, contacts are given, a body has no coefficient of
            friction, or there is a load that is no payload.

    Examples:
        >>> import mujoco
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.interfaces.mujoco import scene_from_mjcf, scene_to_mjcf
        >>> scene = load_scene("examples/paper/sphere_on_slope.yaml")
        >>> model = mujoco.MjModel.from_xml_string(scene_to_mjcf(scene))
        >>> again = scene_from_mjcf(model)
        >>> bool(abs(again.solve().margin - scene.solve().margin) < 1e-6)
        True
    """
    check_at_rest(scene)
    _check_expressible(scene)
    document = Mjcf(scene.name)
    write_options(document, scene, STIFF)
    for compiler in document.root.iter("compiler"):
        for bound in ("boundmass", "boundinertia"):
            del compiler.attrib[bound]
        compiler.set("inertiafromgeom", "false")  # links without mass have none
    list(write_supports(document, scene, prefix=""))
    positions = {}
    custom: dict[str, Any] = {"object": scene.object.name}
    if scene.hand is not None:
        _write_hand(document, scene, scene.hand)
        _write_couplings(document, scene.hand)
        _write_motors(document, scene.hand)
        positions = dict(scene.hand.q)
        custom["hand"] = _custom_hand_fields(scene.hand)
    write_object(document, scene, scene.object, scene.object.name)
    stated = scene_entry(scene, str)
    custom |= {name: stated[name] for name in NO_WORD_FOR if name in stated}
    custom |= {"count_own_weight": scene.count_own_weight, "solve_options": stated["solve"]}
    custom |= {"hybrid_force_limit": scene.hybrid_force_limit, "controller": vars(scene.controller)}
    if stated["uncertainty"] is not None:
        figures = stated["uncertainty"].items()
        custom["uncertainty"] = {name: value for name, value in figures if value is not None}
    add(document.section("custom"), "text", name=CUSTOM_TEXT, data=json.dumps(plain(custom)))
    qpos = _keyframe_coordinates(document.root, positions, scene.object.T_world_object)
    add(document.section("keyframe"), "key", name=KEYFRAME, qpos=qpos)
    return document.text()


def _check_expressible(scene: Scene) -> None:
    """Check that an MJCF can express the scene.

    Raises:
        SceneError: If it cannot.
    """
    where = label_of(scene)
    if scene.given_contacts is not None:
        raise SceneError(f"{where}: contacts: are given, but MuJoCo finds its own; leave them out")
    if scene.acceleration is not None:
        raise SceneError(f"{where}: acceleration: an MJCF cannot state one; leave it out")
    for load in scene.loads:
        if load.force.any() or load.moment.any() or load.field.any():
            raise SceneError(
                f"{where}: loads: {load.name!r} has a force, moment or field; an MJCF can only "
                "state payloads; leave it out and set MjData.xfrc_applied"
            )


def _write_hand(document: Mjcf, scene: Scene, hand: Hand) -> None:
    """Write links as bodies, with joints at zero."""
    tree, bodies = hand.tree, jointed_bodies(hand)
    links = {link.name: link for link in placed_links(hand)}
    elements: dict[str | None, ET.Element] = {None: document.section("worldbody")}
    for link in links.values():
        element = document.add_body(
            elements[link.parent], _body_name(link.name), link.T_parent_link
        )
        elements[link.name] = element
        if not scene.count_own_weight:
            element.set("gravcomp", "1")
        if link.joint is not None:
            _write_joint(element, hand, link, bodies[link.joint])
    shapes = zip(tree.shapes.names, tree.shapes.geometries, strict=True)
    for number, (link, geometry) in enumerate(shapes):
        T = invert(links[link].T_joint_link) @ tree.shape_placements[1][number]
        friction = friction_at(scene, "hand", link)
        document.add_shape(elements[link], f"{link}/{number}", geometry, T, friction, HAND)


def _write_joint(element: ET.Element, hand: Hand, link: PlacedLink, body: JointedBody) -> None:
    """Write the joint that carries a link, and the mass of all bodies fixed to the link."""
    tree, index = hand.tree, link.joint
    low, high = float(tree.lower[index]), float(tree.upper[index])
    limits: dict[str, Any] = {"limited": False}
    if np.isfinite([low, high]).all() and low < high:
        limits = {"range": [low, high], "limited": True}
    add(
        element,
        "joint",
        name=body.joint,
        type="slide" if body.linear else "hinge",
        axis=body.T_world_body[:3, :3].T @ body.axis,
        armature=body.rotor_inertia,
        **limits,
    )
    mass, inertia = max(body.mass, _LIGHTEST[0]), body.inertia
    if not inertia.any():
        inertia = np.eye(3) * _LIGHTEST[1]
    add_mass(element, mass, body.center_of_mass, inertia)


def _write_couplings(document: Mjcf, hand: Hand) -> None:
    """Couple joints that follow others to their leaders."""
    coupling, names = hand.tree.coupling, hand.joint_names
    for index in sorted(set(range(len(names))) - set(coupling.leaders)):
        factors = {
            names[leader]: float(factor)
            for leader, factor in zip(coupling.leaders, coupling.S[index], strict=True)
            if factor
        }
        offset = float(coupling.offset[index])
        if len(factors) < 2:  # without a leader it stays at the offset
            ends = dict(zip(("joint1", "joint2"), (names[index], *factors), strict=False))
            add(document.section("equality"), "joint", **ends,
                polycoef=[offset, *factors.values(), 0.0, 0.0, 0.0])  # fmt: skip
            continue
        arms = {names[index]: 1.0} | {leader: -factor for leader, factor in factors.items()}
        add_tendon(document, f"coupling/{names[index]}", arms)
        add(document.section("equality"), "tendon", tendon1=f"coupling/{names[index]}",
            polycoef=[offset, 0.0, 0.0, 0.0, 0.0])  # fmt: skip


def _write_motors(document: Mjcf, hand: Hand) -> None:
    """Write a motor for each tendon, and for each leading joint without a tendon."""
    actuation, leaders = hand.actuation, tuple(hand.control.joints)
    limits = dict(zip(actuation.names, zip(*hand.effort_limits, strict=True), strict=True))
    columns = [actuation.names.index(name) for name in actuation.tendons]
    arms = np.linalg.pinv(actuation.from_independent[:, columns])  # of A = R^T (R R^T)^-1
    pulled: set[str] = set()
    for name, row in zip(actuation.tendons, arms, strict=True):
        pairs = zip(leaders, row.tolist(), strict=True)
        joint_arms = {joint: arm for joint, arm in pairs if abs(arm) > _NO_ARM}
        pulled |= joint_arms.keys()
        add_tendon(document, name, joint_arms)
        _write_motor(document, name, limits[name], tendon=name)
    for joint in leaders:
        if joint not in pulled:
            _write_motor(document, joint, limits.get(joint), joint=joint)


_NO_ARM = 1e-12
"""m: shorter moment arms are rounding."""


def _write_motor(document: Mjcf, name: str, limits: Any, **target: str) -> None:
    attributes: dict[str, Any] = {}
    if limits is not None and np.isfinite(limits).all() and limits[0] < limits[1]:
        attributes = {"ctrlrange": [*map(float, limits)]}
    add(document.section("actuator"), "motor", name=name, **target, **attributes)


def _custom_hand_fields(hand: Hand) -> dict[str, Any]:
    """Return fields that MJCF cannot state: control modes, fingers, some effort limits."""
    limits = zip(hand.actuation.names, *hand.effort_limits, strict=True)
    return {
        "control": hand_entry(hand, str)["control"],
        "fingers": {
            name: {
                "joints": finger.joints,
                "links": [_body_name(link) for link in finger.links],
                "tip": finger.tip,
            }
            for name, finger in hand.fingers.items()
        },
        "effort_limits": {
            name: [float(low), float(high)]
            for name, low, high in limits
            if name in hand.control.joints and (low != -high or low == high)
        },
    }


def _body_name(link: str) -> str:
    """Return the name of a link's body; ``world`` is reserved by MuJoCo."""
    return "world_link" if link == "world" else link


def _keyframe_coordinates(
    root: ET.Element, positions: dict[str, float], T_world_object: FloatArray
) -> list[float]:
    """Return MuJoCo's coordinates, in the order of the document."""
    x, y, z, w = Rotation.from_matrix(T_world_object[:3, :3]).as_quat(canonical=True).tolist()
    worldbody = root.find("worldbody")
    qpos: list[float] = []
    for element in () if worldbody is None else worldbody.iter():
        if element.tag == "freejoint":
            qpos += [*T_world_object[:3, 3].tolist(), w, x, y, z]
        elif element.tag == "joint":
            qpos.append(positions[element.attrib["name"]])
    return qpos
