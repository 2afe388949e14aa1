"""Build a `Scene` from a YAML scene file; errors name file, line, key and the value found.

`build_scene` builds hand, supports and object, then data that refer to them, then the figures.
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
"""Keys of a hand on which its assembled robots do not depend; each mount is a source itself."""


def build_scene(
    kind: type[AnyScene], source: YamlSource, parts: SceneParts | None = None
) -> AnyScene:
    """Build the scene of a parsed file.

    Args:
        kind: The class of scene to build.
        source: The file, perhaps with changed content.
        parts: Cache from earlier scenes of the same folder; None: no cache.

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
    with capture() as emitted:
        main_sources = entry.object, entry.hand, entry.materials, entry.contacts, entry.motion
        further_sources = entry.controller, entry.acceleration, entry.uncertainty, *entry.supports
        bodies = parts.run_stage(
            "bodies", (*main_sources, *further_sources), lambda: _build_bodies(source, parts, entry)
        )
        _check_weight(source, entry, bodies.fields["object"])
        scene = _scene_with_figures(kind, source, parts, entry, bodies)
    hand_findings = () if scene.hand is None else scene.hand.findings
    placed = [one if one in hand_findings else source.with_place(one) for one in emitted]
    emit(*placed)
    vars(scene)["load_findings"] = tuple(one for one in placed if one not in hand_findings)
    vars(scene)["_source"] = StatedFields(replace(source, data=None))
    if entry.warnings == "error":
        refused = [one for one in findings_of(scene) if one.severity is not Severity.NOTE]
        placed = [source.with_place(one) for one in refused]
        lines = [one if one.place else replace(one, place=source.where(())) for one in placed]
        if lines:
            reason = "(an error because of 'warnings: error' in the scene)"
            raise SceneError("\n".join(f"{one} {reason}" for one in lines))
    return scene


class Bodies(NamedTuple):
    """The bodies of a scene.

    Attributes:
        names: Names of supports and links.
        fields: Fields of a scene that depend on its bodies, by name.
    """

    names: tuple[str, ...]
    fields: Mapping[str, Any]


def _build_bodies(file: YamlSource, parts: SceneParts, entry: SceneEntry) -> Bodies:
    """Build hand, supports and object, then the data that refer to them; emit findings."""
    hand = None if entry.hand is None else build_hand(file, parts, ("hand",), entry.hand)
    supports = tuple(
        build_support(file, parts, ("supports", index), item)
        for index, item in enumerate(entry.supports)
    )
    supports = parts.latest.value("supports", supports, lambda made=supports: made)
    links = () if hand is None else hand.link_names
    names = tuple([support.name for support in supports])
    with file.errors_at(()):
        check_body_names(entry.object.name, names, links)
    target = build_object(file, parts, ("object",), entry.object)
    materials = _build_materials(file, parts, entry)
    bodies, has_controller = (*names, *links), "controller" in entry.model_fields_set

    def stated(key: str, make: Callable[[Any], Any], *others: Any) -> Any:
        """Return the object made from a key, cached by its value, the hand's tree and others."""
        value, sources = getattr(entry, key), (None if hand is None else hand.tree, *others)
        if value is None:
            return None
        return parts.latest.value(f"stated {key}", (value, *sources), lambda: make(value))

    fields_by_name = {
        "object": target,
        "hand": hand,
        "supports": supports,
        "materials": materials,
        "hand_material": None if entry.hand is None else entry.hand.material,
        "given_contacts": stated("contacts", partial(_build_contacts, file, bodies), *bodies),
        "motion": stated("motion", partial(_build_motion, file, hand)),
        "acceleration": stated("acceleration", partial(_build_acceleration, file, hand)),
        "controller": stated("controller", partial(_build_controller, file, hand, has_controller)),
        "uncertainty": stated(
            "uncertainty",
            partial(_build_uncertainty, file, hand, names, materials, target.name),
            materials,
            target.name,
            *names,
        ),
        "count_own_weight": entry.hand is None or entry.hand.count_own_weight,
        "hybrid_force_limit": None if entry.hand is None else entry.hand.hybrid_force_limit,
    }
    emit(*entry_findings(entry, materials))
    return Bodies(bodies, fields_by_name)


@cached_by_entry
def build_hand(file: YamlSource, parts: SceneParts, where: Location, entry: HandEntry) -> Hand:
    """Build the hand of a scene file.

    Robots are read and assembled once for each description. Base poses, effort limits and joint
    positions are applied afterwards.

    Args:
        file: The file.
        parts: Cache from earlier scenes of the same folder.
        where: The key of the hand.
        entry: The hand's entry.
    """
    common = [value for name, value in entry if name not in _NOT_OF_ROBOTS]
    sources = [one if isinstance(one, BaseModel) else repr(one) for one in (*common, *entry.mounts)]
    mounts = parts.run_stage("mounts", (*sources,), lambda: _build_mounts(file, parts, entry))
    tree = mounts.joined.tree
    with file.errors_at(where):
        named = named_positions(tree.group_states, entry.group_states, tree.missing)
        q = named | merged_angles(entry.q, entry.q_deg)
        for name, kind in zip(tree.joint_names, tree.joint_kinds, strict=True):
            if kind == "prismatic" and name in entry.q_deg:
                message = "is a prismatic joint; give metres under q"
                raise file.error((*where, "q_deg", name), message)
        positions = parts.latest.value(
            "hand positions", (tree, repr(q)), lambda: joint_positions(tree, q)
        )
        return hand_of(mounts, entry.effort_limits, positions)


def _build_mounts(file: YamlSource, parts: SceneParts, entry: HandEntry) -> AssembledMounts:
    """Return the assembled robots at their base poses."""
    mounted: list[tuple[Location, str, MountEntry]] = [(("hand",), "", entry)]
    if entry.mounts:
        each = enumerate(entry.mounts)
        mounted = [(("hand", "mounts", index), one.prefix, one) for index, one in each]
    key = entry.model_dump_json(exclude=_NOT_OF_ROBOTS | _POSE_KEYS)
    key += "".join([item.model_dump_json(exclude=_POSE_KEYS) for item in entry.mounts])
    assembled = parts.hands.get(key)
    if assembled is None:
        mounts = [_build_mount(file, *place) for place in mounted]
        name = "mounts" if entry.mounts else "robot" if entry.urdf is None else "urdf"
        with file.errors_at(("hand",), (name,)):
            assembled = assembled_mounts(mounts, entry.control, entry.armature)
        parts.hands[key] = assembled
    else:
        emit(*assembled.findings)
    return assembled.at_bases(
        [build_pose(file, parts, (*where, "base_pose"), one.base_pose) for where, _, one in mounted]
    )


def _build_mount(file: YamlSource, where: Location, prefix: str, entry: MountEntry) -> Mount:
    """Return the mount of an entry: its robot with the entry's options."""
    fingers = (
        None
        if entry.fingers is None
        else {name: item.spec() for name, item in entry.fingers.items()}
    )
    folders, name = [file.file(folder) for folder in entry.package_dirs], str(entry.robot)
    with file.errors_at(where, ("robot",)):
        if entry.urdf is not None:
            robot = describe_urdf(file.file(entry.urdf), folders)
        else:
            is_file = name.endswith((".yaml", ".yml"))
            robot = find_robot(str(file.file(name)) if is_file else name, folders)
    if entry.visuals_collide is not None:
        robot = replace(robot, visuals_collide=entry.visuals_collide)
    values = {item.name: getattr(entry, item.name) for item in fields(LinkMeshes)}
    stated = {name: value for name, value in values.items() if value is not None}
    meshes = replace(robot.meshes, **stated) if stated else None
    srdf = None if entry.srdf is None else file.file(entry.srdf)
    return Mount(robot, None, prefix, fingers, meshes=meshes, root_link=entry.root_link, srdf=srdf)


def _controller_of_robots(hand: Hand) -> Controller:
    """Return the controller that the robot files of a hand state.

    A gain under a robot's ``default``, or for all its joints, applies to each of its fingers; for a
    robot without a prefix to all joints. Without any gains the controller is the default one.

    Raises:
        RobotError: If a file states gains for an unknown joint or finger.
    """
    robots = [(mount.prefix, mount.robot()) for mount in hand.mounts]
    if all(robot.stiffness is None for _, robot in robots):
        return Controller()
    names = [*hand.actuation.names, *hand.fingers]
    for prefix, robot in robots:
        robot.check_gains([one.removeprefix(prefix) for one in names if one.startswith(prefix)])
    gains: dict[str, dict[str, float]] = {"stiffness": {}, "damping": {}}
    for kind, collected in gains.items():
        for prefix, robot in robots:
            stated = getattr(robot, kind)
            own = dict(stated) if isinstance(stated, Mapping) else {DEFAULT_GAIN: stated}
            default = own.pop(DEFAULT_GAIN, None)
            if default is not None and not prefix:
                collected[DEFAULT_GAIN] = default
            elif default is not None:
                collected |= {name: default for name in hand.fingers if name.startswith(prefix)}
            collected |= {prefix + name: gain for name, gain in own.items()}
    return Controller(gains["stiffness"], gains["damping"] or DAMPING)


def _build_controller(
    file: YamlSource, hand: Hand | None, is_stated: bool, stated: ControllerEntry | str | float
) -> Controller:
    if is_stated and not isinstance(stated, ControllerEntry):
        controller = Controller(stated)
    else:
        controller = Controller()
        if hand is not None:
            with file.errors_at(("hand",), ("robot",)):
                controller = _controller_of_robots(hand)
        if isinstance(stated, ControllerEntry):
            stated_gains = {name: getattr(stated, name) for name in stated.model_fields_set}
            controller = replace(controller, **stated_gains)
    joints, fingers = ((), ()) if hand is None else (hand.actuation.names, (*hand.fingers,))
    with file.errors_at(("controller",)):
        controller.check(joints, fingers)
    return controller


def _build_uncertainty(
    file: YamlSource,
    hand: Hand | None,
    supports: Sequence[str],
    materials: Materials,
    object_name: str,
    stated: UncertaintyEntry,
) -> Uncertainty:
    with file.errors_at(("uncertainty",)):
        uncertainty = Uncertainty(**dict(stated))
        check_uncertain_names(uncertainty, hand, supports, materials.names, object_name)
    return uncertainty


def _scene_with_figures(
    kind: type[AnyScene], file: YamlSource, parts: SceneParts, entry: SceneEntry, bodies: Bodies
) -> AnyScene:
    """Return the scene of given bodies with the figures of the file; only changes are made anew."""
    last, same_entries = parts.last, {}
    if last is not None and last.scene.path != file.path:
        last = None
    if last is not None and (last.bodies is bodies or last.bodies.names == bodies.names):
        same_entries = vars(last.entry)
    changes = {
        field: make(file, getattr(entry, key), bodies.names)
        for key, (field, make) in _PLAIN.items()
        if not (key in same_entries and same_entries[key] is getattr(entry, key))
    }
    if last is None or last.bodies is not bodies:
        changes |= bodies.fields
    if last is None:
        scene = kind(path=file.path, **changes)
        vars(scene)["_cache"] = parts.latest
    else:
        scene = last.scene._with_fields(changes)
    parts.last = LastScene(entry, bodies, scene)
    return scene


def _build_friction(file: YamlSource, value: Any, names: tuple[str, ...]) -> Mapping[str, float]:
    with file.errors_at(()):
        return friction_by_name(value, names)


_PLAIN: Mapping[str, tuple[str, Callable[[YamlSource, Any, tuple[str, ...]], Any]]] = {
    "name": ("name", lambda file, value, _: value or file.path.stem[:LONGEST_NAME]),
    "gravity": ("gravity", lambda _file, value, _: np.array(value)),
    "friction": ("friction", _build_friction),
    "loads": ("loads", lambda file, value, _: _build_loads(file, value)),
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
    """Refuse a weight too small for double precision, or too large against max_normal_force."""
    weight = target.mass * math.hypot(*entry.gravity)
    if 0.0 < weight < SMALLEST_LOAD:
        raise file.error(
            ("gravity",),
            f"is {list(entry.gravity)}, so the object weighs {weight:g} N; its weight must be 0 "
            f"or at least {SMALLEST_LOAD:g} N",
        )
    heaviest = LARGEST_LOAD_OVER_LIMIT * entry.max_normal_force
    if weight > heaviest:
        raise file.error(
            ("max_normal_force",),
            f"is {entry.max_normal_force:g} N, but the object weighs {weight:g} N; its weight may "
            f"be at most {LARGEST_LOAD_OVER_LIMIT:g} times max_normal_force, {heaviest:g} N",
        )


def _build_materials(file: YamlSource, parts: SceneParts, entry: SceneEntry) -> Materials:
    with file.errors_at(()):
        table = parts.latest.value(
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
            with file.errors_at(location):
                table.check([name])
    return table


def _build_contacts(
    file: YamlSource, bodies: Sequence[str], entries: Sequence[ContactEntry]
) -> tuple[GivenContact, ...]:
    contacts: list[GivenContact] = []
    for index, item in enumerate(entries):
        with file.errors_at(("contacts", index)):
            check_contact_body("body", item.body, bodies)
        normal = np.array(item.normal) / np.linalg.norm(item.normal)
        contacts.append(GivenContact(item.body, np.array(item.position), normal))
    return tuple(contacts)


def _build_motion(file: YamlSource, hand: Hand | None, entry: MotionEntry) -> Motion:
    moved = None
    if entry.hand is not None:
        if hand is None:
            raise file.error(("motion", "hand"), "requires a hand, and the scene has none")
        moved = HandMotion(twist_of(entry.hand.base_twist), dict(entry.hand.joint_velocities))
        with file.errors_at(("motion", "hand")):
            hand.point_velocities((), np.zeros((0, 3)), moved.joint_velocities, moved.base_twist)
    return Motion(twist_of(entry.object_twist), moved)


def _build_loads(file: YamlSource, entries: Sequence[LoadEntry]) -> tuple[Load, ...]:
    with file.errors_at(()):
        check_load_names([entry.name for entry in entries])
    return tuple(Load(**dict(entry)) for entry in entries)


def _build_acceleration(
    file: YamlSource, hand: Hand | None, entry: AccelerationEntry
) -> Acceleration:
    with file.errors_at(("acceleration",)):
        for argument in ("joint_velocities", "joint_accelerations"):
            named = getattr(entry, argument)
            if named and hand is None:
                raise ArgumentError(argument, "requires a hand, and the scene has none")
            if hand is not None:
                independent_rates(hand.tree, named, argument)
        return Acceleration(**dict(entry))
