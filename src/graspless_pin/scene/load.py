"""From a YAML scene to a `Scene`, with errors that name file, line, key and what was found.

`build_scene` builds hand, supports and object, then what is said of them, then the figures.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel

from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.bounds import LARGEST_LOAD_OVER_LIMIT, LONGEST_NAME, SMALLEST_LOAD
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.findings import Severity, capture, emit
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Materials
from graspless_pin.geometry.hand.assembly import AssembledMounts, Mount, assembled_mounts
from graspless_pin.geometry.hand.configuration import independent_rates, joint_positions
from graspless_pin.geometry.hand.model import Hand, hand_of
from graspless_pin.geometry.hand.reading import named_positions
from graspless_pin.geometry.robots.description import LinkMeshes
from graspless_pin.geometry.robots.files import describe_urdf, find_robot
from graspless_pin.holding.controller import DAMPING, Controller
from graspless_pin.intake.yaml_source import Location, YamlSource
from graspless_pin.problem.fingers import DEFAULT_GAIN
from graspless_pin.scene.body_building import (
    LastScene,
    SceneParts,
    build_object,
    build_pose,
    build_support,
    cached_by_entry,
    twist_of,
)
from graspless_pin.scene.body_schema import HandEntry, MountEntry
from graspless_pin.scene.entry_findings import entry_findings
from graspless_pin.scene.fields import (
    AnyScene,
    StatedFields,
    check_body_names,
    check_contact_body,
    check_load_names,
    friction_by_name,
)
from graspless_pin.scene.scene_findings import findings_of
from graspless_pin.scene.scene_schema import (
    PLAIN_FIGURES,
    AccelerationEntry,
    ContactEntry,
    ControllerEntry,
    LoadEntry,
    MotionEntry,
    SceneEntry,
    UncertaintyEntry,
)
from graspless_pin.scene.stated import Acceleration, GivenContact, HandMotion, Load, Motion
from graspless_pin.scene.uncertain_figures import check_uncertain_names
from graspless_pin.scene.units import merged_angles

_POSE_KEYS = {"base_pose"}
_NOT_OF_ROBOTS = {
    "group_states",
    "q",
    "q_deg",
    "effort_limits",
    "material",
    "count_own_weight",
    "hybrid_force_limit",
    "mounts",
}
"""Keys of a hand on which its assembled robots do not depend; mounts are looked at one by one."""


def build_scene(
    kind: type[AnyScene], source: YamlSource, parts: SceneParts | None = None
) -> AnyScene:
    """Build the scene of a parsed file.

    Args:
        kind: The class of scenes.
        source: The file, perhaps with changed content.
        parts: What earlier scenes of the same folder left; None: nothing is shared.

    Raises:
        SceneError: See `load_scene`.
    """
    if not isinstance(source.data, dict):
        raise SceneError(
            f"{source.where(())}: found {reprlib.repr(source.data)}; a scene is a mapping with the "
            "keys object, friction, hand, supports, ..."
        )
    parts = parts or SceneParts()
    entry = parts.validated(source)
    with capture() as found:
        parted = entry.object, entry.hand, entry.materials, entry.contacts, entry.motion
        others = entry.controller, entry.acceleration, entry.uncertainty, *entry.supports
        bodies = parts.run_stage(
            "bodies", (*parted, *others), lambda: _bodies(source, parts, entry)
        )
        _check_weight(source, entry, bodies.fields["object"])
        scene = _with_figures(kind, source, parts, entry, bodies)
    of_hand = () if scene.hand is None else scene.hand.findings
    placed = [one if one in of_hand else source.placed(one) for one in found]
    emit(*placed)
    vars(scene)["load_findings"] = tuple(one for one in placed if one not in of_hand)
    vars(scene)["_stated"] = StatedFields(replace(source, data=None))
    if entry.warnings == "error":
        wrong = [one for one in findings_of(scene) if one.severity is not Severity.NOTE]
        placed = [source.placed(one) for one in wrong]
        lines = [one if one.place else replace(one, place=source.where(())) for one in placed]
        if lines:
            reason = "(an error, as the scene says 'warnings: error')"
            raise SceneError("\n".join(f"{one} {reason}" for one in lines))
    return scene


class Bodies(NamedTuple):
    """What is built of the bodies of a scene file.

    Attributes:
        names: Of supports and links.
        fields: Those of a scene that are made of them, by name.
    """

    names: tuple[str, ...]
    fields: Mapping[str, Any]


def _bodies(file: YamlSource, parts: SceneParts, entry: SceneEntry) -> Bodies:
    """Build hand, supports and object, and then what is said of them; tell what looks wrong."""
    hand = None if entry.hand is None else build_hand(file, parts, ("hand",), entry.hand)
    supports = tuple(
        build_support(file, parts, ("supports", index), item)
        for index, item in enumerate(entry.supports)
    )
    supports = parts.latest.made("supports", supports, lambda made=supports: made)
    links = () if hand is None else hand.link_names
    names = tuple([support.name for support in supports])
    with file.at(()):
        check_body_names(entry.object.name, names, links)
    moved = build_object(file, parts, ("object",), entry.object)
    materials = _materials(file, parts, entry)
    bodies, own_controller = (*names, *links), "controller" in entry.model_fields_set

    def stated(key: str, make: Callable[[Any], Any], *others: Any) -> Any:
        """Return what is made of a key, the same while it, the hand's tree and others are."""
        value, sources = getattr(entry, key), (None if hand is None else hand.tree, *others)
        if value is None:
            return None
        return parts.latest.made(f"stated {key}", (value, *sources), lambda: make(value))

    fields_by_name = {
        "object": moved,
        "hand": hand,
        "supports": supports,
        "materials": materials,
        "hand_material": None if entry.hand is None else entry.hand.material,
        "given_contacts": stated("contacts", partial(_contacts, file, bodies), *bodies),
        "motion": stated("motion", partial(_motion, file, hand)),
        "acceleration": stated("acceleration", partial(_acceleration, file, hand)),
        "controller": stated("controller", partial(_controller, file, hand, own_controller)),
        "uncertainty": stated(
            "uncertainty",
            partial(_uncertainty, file, hand, names, materials, moved.name),
            materials,
            moved.name,
            *names,
        ),
        "count_own_weight": entry.hand is None or entry.hand.count_own_weight,
        "hybrid_force_limit": None if entry.hand is None else entry.hand.hybrid_force_limit,
    }
    emit(*entry_findings(entry, materials))
    return Bodies(bodies, fields_by_name)


@cached_by_entry
def build_hand(file: YamlSource, parts: SceneParts, where: Location, entry: HandEntry) -> Hand:
    """Return the hand of a scene file, or what is the same of the scenes before.

    Robots are read and assembled once for each description, wherever they are mounted. Poses,
    effort limits and positions come after that.

    Args:
        file: The file.
        parts: What earlier scenes of the same folder left.
        where: The key of the hand.
        entry: The hand's entry.
    """
    common = [value for name, value in entry if name not in _NOT_OF_ROBOTS]
    sources = [one if isinstance(one, BaseModel) else repr(one) for one in (*common, *entry.mounts)]
    mounts = parts.run_stage("mounts", (*sources,), lambda: _mounts(file, parts, entry))
    tree = mounts.joined.tree
    with file.at(where):
        named = named_positions(tree.group_states, entry.group_states, tree.lacking)
        q = named | merged_angles(entry.q, entry.q_deg)
        for name, kind in zip(tree.joint_names, tree.joint_kinds, strict=True):
            if kind == "prismatic" and name in entry.q_deg:
                message = "is a prismatic joint; give metres under q"
                raise file.error((*where, "q_deg", name), message)
        positions = parts.latest.made(
            "hand positions", (tree, repr(q)), lambda: joint_positions(tree, q)
        )
        return hand_of(mounts, entry.effort_limits, positions)


def _mounts(file: YamlSource, parts: SceneParts, entry: HandEntry) -> AssembledMounts:
    """Return the robots where they are mounted."""
    mounted: list[tuple[Location, str, MountEntry]] = [(("hand",), "", entry)]
    if entry.mounts:
        each = enumerate(entry.mounts)
        mounted = [(("hand", "mounts", index), one.prefix, one) for index, one in each]
    key = entry.model_dump_json(exclude=_NOT_OF_ROBOTS | _POSE_KEYS)
    key += "".join([item.model_dump_json(exclude=_POSE_KEYS) for item in entry.mounts])
    assembled = parts.hands.get(key)
    if assembled is None:
        mounts = [_mount(file, *place) for place in mounted]
        name = "mounts" if entry.mounts else "robot" if entry.urdf is None else "urdf"
        with file.at(("hand",), (name,)):
            assembled = assembled_mounts(mounts, entry.control, entry.armature)
        parts.hands[key] = assembled
    else:
        emit(*assembled.findings)
    return assembled.at_bases(
        [build_pose(file, parts, (*where, "base_pose"), one.base_pose) for where, _, one in mounted]
    )


def _mount(file: YamlSource, where: Location, prefix: str, entry: MountEntry) -> Mount:
    """Return the robot that an entry names, as it is mounted."""
    fingers = (
        None
        if entry.fingers is None
        else {name: item.spec() for name, item in entry.fingers.items()}
    )
    folders, name = [file.file(folder) for folder in entry.package_dirs], str(entry.robot)
    with file.at(where, ("robot",)):
        if entry.urdf is not None:
            found = describe_urdf(file.file(entry.urdf), folders)
        else:
            is_file = name.endswith((".yaml", ".yml"))
            found = find_robot(str(file.file(name)) if is_file else name, folders)
    if entry.visuals_collide is not None:
        found = replace(found, visuals_collide=entry.visuals_collide)
    given = {item.name: getattr(entry, item.name) for item in fields(LinkMeshes)}
    own = {name: value for name, value in given.items() if value is not None}
    meshes = replace(found.meshes, **own) if own else None
    srdf = None if entry.srdf is None else file.file(entry.srdf)
    return Mount(found, None, prefix, fingers, meshes=meshes, root_link=entry.root_link, srdf=srdf)


def _gains_of_robots(hand: Hand) -> Controller:
    """Return what the robot files of a hand say of the feedback at its joints.

    Gains of one robot's ``default``, or of all its joints, are those of each of its fingers; with
    one robot without a prefix, of all joints. Where no file states any, it is not decided.

    Raises:
        RobotError: If a file states gains of what is no joint or finger.
    """
    robots = [(mount.prefix, mount.robot()) for mount in hand.mounts]
    if all(robot.stiffness is None for _, robot in robots):
        return Controller()
    known = [*hand.actuation.names, *hand.fingers]
    for prefix, robot in robots:
        robot.check_gains([one.removeprefix(prefix) for one in known if one.startswith(prefix)])
    gains: dict[str, dict[str, float]] = {"stiffness": {}, "damping": {}}
    for kind, found in gains.items():
        for prefix, robot in robots:
            stated = getattr(robot, kind)
            own = dict(stated) if isinstance(stated, Mapping) else {DEFAULT_GAIN: stated}
            rest = own.pop(DEFAULT_GAIN, None)
            if rest is not None and not prefix:
                found[DEFAULT_GAIN] = rest
            elif rest is not None:
                found |= {name: rest for name in hand.fingers if name.startswith(prefix)}
            found |= {prefix + name: gain for name, gain in own.items()}
    return Controller(gains["stiffness"], gains["damping"] or DAMPING)


def _controller(
    file: YamlSource, hand: Hand | None, is_stated: bool, stated: ControllerEntry | str | float
) -> Controller:
    if is_stated and not isinstance(stated, ControllerEntry):
        controller = Controller(stated)
    else:
        controller = Controller()
        if hand is not None:
            with file.at(("hand",), ("robot",)):
                controller = _gains_of_robots(hand)
        if isinstance(stated, ControllerEntry):
            own = {name: getattr(stated, name) for name in stated.model_fields_set}
            controller = replace(controller, **own)
    joints, fingers = ((), ()) if hand is None else (hand.actuation.names, (*hand.fingers,))
    with file.at(("controller",)):
        controller.check(joints, fingers)
    return controller


def _uncertainty(
    file: YamlSource,
    hand: Hand | None,
    supports: Sequence[str],
    materials: Materials,
    of_object: str,
    stated: UncertaintyEntry,
) -> Uncertainty:
    with file.at(("uncertainty",)):
        uncertainty = Uncertainty(**dict(stated))
        check_uncertain_names(uncertainty, hand, supports, materials.names, of_object)
    return uncertainty


def _with_figures(
    kind: type[AnyScene], file: YamlSource, parts: SceneParts, entry: SceneEntry, bodies: Bodies
) -> AnyScene:
    """Return the scene: its bodies, and the figures of the file, those that changed made anew."""
    last, known = parts.last, {}
    if last is not None and last.scene.path != file.path:
        last = None
    if last is not None and (last.bodies is bodies or last.bodies.names == bodies.names):
        known = vars(last.entry)
    new = {
        field: make(file, getattr(entry, key), bodies.names)
        for key, (field, make) in _PLAIN.items()
        if not (key in known and known[key] is getattr(entry, key))
    }
    if last is None or last.bodies is not bodies:
        new |= bodies.fields
    if last is None:
        scene = kind(path=file.path, **new)
        vars(scene)["_kept"] = parts.latest
    else:
        scene = last.scene._changed(new)
    parts.last = LastScene(entry, bodies, scene)
    return scene


def _friction(file: YamlSource, value: Any, names: tuple[str, ...]) -> Mapping[str, float]:
    with file.at(()):
        return friction_by_name(value, names)


_PLAIN: Mapping[str, tuple[str, Callable[[YamlSource, Any, tuple[str, ...]], Any]]] = {
    "name": ("name", lambda file, value, _: value or file.path.stem[:LONGEST_NAME]),
    "gravity": ("gravity", lambda _file, value, _: np.array(value)),
    "friction": ("friction", _friction),
    "loads": ("loads", lambda file, value, _: _loads(file, value)),
    "tangent_axes": ("tangent_axes", lambda _file, value, _: tuple(map(np.array, value))),
    "solve": ("solve_options", lambda _file, value, _: value.model_dump()),
    **{name: (name, lambda _file, value, _: value) for name in PLAIN_FIGURES},
}
"""For each key that no body depends on: the field of a scene, and the function of file, value and
names of supports and links that returns the field's value."""
_CHECKED_WITH_OTHER_KEYS = ("gravity", "loads", "max_normal_force", "tangent_axes")
FIELDS_BY_KEY = {
    key: field for key, (field, _) in _PLAIN.items() if key not in _CHECKED_WITH_OTHER_KEYS
}
"""The scene field of each key whose value depends on no other key of the file, and on which no
other field depends."""


def _check_weight(file: YamlSource, entry: SceneEntry, target: ManipulatedObject) -> None:
    """Refuse a weight that double precision cannot hold, alone or beside the largest force."""
    weight = target.mass * math.hypot(*entry.gravity)
    if 0.0 < weight < SMALLEST_LOAD:
        raise file.error(
            ("gravity",),
            f"is {list(entry.gravity)}, and the object weighs {weight:g} N; it must weigh nothing "
            f"or at least {SMALLEST_LOAD:g} N",
        )
    most = LARGEST_LOAD_OVER_LIMIT * entry.max_normal_force
    if weight > most:
        raise file.error(
            ("max_normal_force",),
            f"is {entry.max_normal_force:g} N, and the object weighs {weight:g} N; it may "
            f"weigh at most {LARGEST_LOAD_OVER_LIMIT:g} times as much, {most:g} N",
        )


def _materials(file: YamlSource, parts: SceneParts, entry: SceneEntry) -> Materials:
    with file.at(()):
        table = parts.latest.made(
            "table of materials",
            (repr(entry.materials),),
            lambda: Materials.from_table(entry.materials),
        )
    named: list[tuple[Location, str | None]] = [(("object", "material"), entry.object.material)]
    if entry.hand is not None:
        named.append((("hand", "material"), entry.hand.material))
    named += [(("supports", i, "material"), item.material) for i, item in enumerate(entry.supports)]
    for location, name in named:
        if name is not None:
            with file.at(location):
                table.check([name])
    return table


def _contacts(
    file: YamlSource, bodies: Sequence[str], entries: Sequence[ContactEntry]
) -> tuple[GivenContact, ...]:
    made: list[GivenContact] = []
    for index, item in enumerate(entries):
        with file.at(("contacts", index)):
            check_contact_body("body", item.body, bodies)
        normal = np.array(item.normal) / np.linalg.norm(item.normal)
        made.append(GivenContact(item.body, np.array(item.position), normal))
    return tuple(made)


def _motion(file: YamlSource, hand: Hand | None, entry: MotionEntry) -> Motion:
    own = None
    if entry.hand is not None:
        if hand is None:
            raise file.error(("motion", "hand"), "the scene has no hand that could move")
        own = HandMotion(twist_of(entry.hand.base_twist), dict(entry.hand.joint_velocities))
        with file.at(("motion", "hand")):
            hand.point_velocities((), np.zeros((0, 3)), own.joint_velocities, own.base_twist)
    return Motion(twist_of(entry.object_twist), own)


def _loads(file: YamlSource, entries: Sequence[LoadEntry]) -> tuple[Load, ...]:
    with file.at(()):
        check_load_names([entry.name for entry in entries])
    return tuple(Load(**dict(entry)) for entry in entries)


def _acceleration(file: YamlSource, hand: Hand | None, entry: AccelerationEntry) -> Acceleration:
    with file.at(("acceleration",)):
        for argument in ("joint_velocities", "joint_accelerations"):
            named = getattr(entry, argument)
            if named and hand is None:
                raise ArgumentError(argument, "the scene has no hand that could move")
            if hand is not None:
                independent_rates(hand.tree, named, argument)
        return Acceleration(**dict(entry))
