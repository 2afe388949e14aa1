"""From a YAML scene to a `Scene`, with errors that name file, line, key and what was found.

From the hand's entry of a scene file to a `Hand`.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar

import numpy as np
from pydantic import BaseModel

from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.bounds import LARGEST_LOAD_OVER_LIMIT, LONGEST_NAME, SMALLEST_LOAD
from graspless_pin.errors import SceneError
from graspless_pin.findings import Finding, Severity, capture, emit
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Materials
from graspless_pin.geometry.hand.assembly import AssembledMounts, Mount, assembled_mounts, fields_of
from graspless_pin.geometry.hand.configuration import independent_rates, joint_positions
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.reading import named_positions
from graspless_pin.geometry.robots.description import LinkMeshes, RobotDescription
from graspless_pin.geometry.robots.files import describe_urdf, find_robot
from graspless_pin.holding.controller import Controller
from graspless_pin.records import changed
from graspless_pin.scene.body_building import build_object, build_pose, build_support, twist_of
from graspless_pin.scene.build_cache import Last, SceneParts
from graspless_pin.scene.entry_findings import entry_findings
from graspless_pin.scene.fields import SceneFields, StatedFields, friction_by_name
from graspless_pin.scene.hand_schema import HandEntry, MountEntry
from graspless_pin.scene.joints import gains_of_robots
from graspless_pin.scene.loads import Acceleration, Load
from graspless_pin.scene.motion_and_contacts import GivenContact, HandMotion, Motion
from graspless_pin.scene.scene_findings import findings_of
from graspless_pin.scene.scene_schema import (
    PLAIN_FIGURES,
    AccelerationEntry,
    ControllerEntry,
    LoadEntry,
    MotionEntry,
    SceneEntry,
)
from graspless_pin.scene.uncertain_figures import check_names
from graspless_pin.scene.yaml_source import Location, YamlSource
from graspless_pin.suggestions import names_in_words

_Scene = TypeVar("_Scene", bound=SceneFields)
_ANYWHERE = {"base_pose"}
_NOT_OF_THE_MOUNTS = {
    "group_states",
    "q",
    "q_deg",
    "effort_limits",
    "material",
    "count_own_weight",
    "hybrid_force_limit",
    "mounts",
}
"""Keys of the hand; each mount is told by itself."""


def build_hand(file: YamlSource, parts: SceneParts, entry: HandEntry) -> Hand:
    """Return the hand of a scene file, or what is the same of the scenes before.

    Robots are read and assembled once for each description, wherever they are mounted. Poses,
    effort limits and positions come after that.

    Args:
        file: The file.
        parts: What earlier scenes of the same folder left.
        entry: The hand's entry.
    """
    return parts.stage("hand", (entry,), lambda: _hand(file, parts, entry))


def _hand(file: YamlSource, parts: SceneParts, entry: HandEntry) -> Hand:
    places = [
        (("hand", "mounts", index) if entry.mounts else ("hand",), prefix, item)
        for index, (prefix, item) in enumerate(entry.mount_entries())
    ]
    common = [value for name, value in entry if name not in _NOT_OF_THE_MOUNTS]
    sources = [one if isinstance(one, BaseModel) else repr(one) for one in (*common, *entry.mounts)]
    mounts = parts.stage("mounts", (*sources,), lambda: _mounts(file, parts, entry, places))
    tree = mounts.joined.tree
    named = file.at(
        ("hand",), lambda: named_positions(tree.group_states, entry.group_states, tree.lacking)
    )
    q = named | entry.positions()
    positions = parts.stage(
        "hand positions",
        (tree, repr(q)),
        lambda: file.at(("hand",), lambda: joint_positions(tree, q)),
    )
    for name in entry.q_deg:
        if tree.joint_kinds[tree.joint_index[name]] == "prismatic":
            raise file.error(("hand", "q_deg", name), "is a linear joint; give metres under q")
    limits = file.at(("hand",), lambda: mounts.effort_limits(entry.effort_limits))
    hand = parts.stage(
        "hand of the mounts",
        (mounts, positions),
        lambda: Hand(**fields_of(mounts, limits[0], positions, ())),
    )
    return changed(hand, effort_limits=limits[0], findings=(*hand.findings, *limits[1]))


def _mounts(
    file: YamlSource,
    parts: SceneParts,
    entry: HandEntry,
    places: Sequence[tuple[Location, str, MountEntry]],
) -> AssembledMounts:
    """Return the robots where they are mounted."""
    key = entry.model_dump_json(exclude=_NOT_OF_THE_MOUNTS | _ANYWHERE)
    key += "".join([item.model_dump_json(exclude=_ANYWHERE) for item in entry.mounts])
    mounts = parts.hand(key, lambda: _assembled(file, parts, entry, places))
    poses = [build_pose(file, (*where, "base_pose"), item.base_pose) for where, _, item in places]
    return mounts.at_bases(poses)


def _assembled(
    file: YamlSource,
    parts: SceneParts,
    entry: HandEntry,
    places: Sequence[tuple[Location, str, MountEntry]],
) -> AssembledMounts:
    """Return the robots, each mounted at the world's origin."""
    mounts = [_mount(file, parts, *place) for place in places]
    source: Location = ("mounts",)
    if not entry.mounts:
        source = ("robot",) if entry.urdf is None else ("urdf",)
    return file.at(
        ("hand",),
        lambda: assembled_mounts(mounts, entry.control, entry.armature),
        source,
    )


def _mount(
    file: YamlSource, parts: SceneParts, where: Location, prefix: str, entry: MountEntry
) -> Mount:
    fingers = None
    if entry.fingers is not None:
        fingers = {name: item.spec() for name, item in entry.fingers.items()}
    found = file.at(where, lambda: _robot(file, parts, entry), ("robot",))
    if entry.visuals_collide is not None:
        found = replace(found, visuals_collide=entry.visuals_collide)
    given = {item.name: getattr(entry, item.name) for item in fields(LinkMeshes)}
    own = {name: value for name, value in given.items() if value is not None}
    meshes = replace(found.meshes, **own) if own else None
    srdf = None if entry.srdf is None else file.file(entry.srdf)
    return Mount(found, None, prefix, fingers, meshes=meshes, root_link=entry.root_link, srdf=srdf)


def _robot(file: YamlSource, parts: SceneParts, entry: MountEntry) -> RobotDescription:
    """Return the robot that an entry names, read if it is new."""
    source = str(entry.robot) if entry.urdf is None else str(file.file(entry.urdf))
    if entry.urdf is None and source.endswith((".yaml", ".yml")):
        source = str(file.file(source))
    folders = [file.file(folder) for folder in entry.package_dirs]
    key = ("robot" if entry.urdf is None else "urdf", source, *map(str, folders))
    if key not in parts.robots:
        read = find_robot if entry.urdf is None else describe_urdf
        parts.robots[key] = read(source, folders)
    return parts.robots[key]


def build_scene(kind: type[_Scene], source: YamlSource, parts: SceneParts | None = None) -> _Scene:
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
        scene = _scene(kind, source, parts, entry)
    of_hand = () if scene.hand is None else scene.hand.findings
    placed = [one if one in of_hand else source.placed(one) for one in found]
    emit(*placed)
    vars(scene)["load_findings"] = tuple(one for one in placed if one not in of_hand)
    vars(scene)["_stated"] = StatedFields.of(source)
    if entry.warnings == "error":
        _refuse(source, findings_of(scene))
    return scene


def _refuse(file: YamlSource, findings: Sequence[Finding]) -> None:
    """Refuse a scene with which something is wrong."""
    wrong = [file.placed(one) for one in findings if one.severity is not Severity.NOTE]
    if wrong:
        lines = [one if one.place else replace(one, place=file.where(())) for one in wrong]
        raise SceneError(
            "\n".join(f"{one} (an error, as the scene says 'warnings: error')" for one in lines)
        )


class _Built(NamedTuple):
    """What is built of the bodies of a scene file.

    Attributes:
        names: Of supports and links.
        others: Fields of a scene by name.
    """

    names: tuple[str, ...]
    object: ManipulatedObject
    others: Mapping[str, Any]


def _scene(kind: type[_Scene], file: YamlSource, parts: SceneParts, entry: SceneEntry) -> _Scene:
    entries = entry.object, entry.hand, entry.materials, entry.contacts, entry.motion
    sources = (*entries, entry.controller, entry.acceleration, entry.uncertainty, *entry.supports)
    built = parts.stage("built", sources, lambda: _built(file, parts, entry))
    _check_weight(file, entry, built.object)
    last, known = parts.last, {}
    if last is not None and last.scene.path != file.path:
        last = None
    if last is not None and (last.built is built or last.built.names == built.names):
        known = vars(last.entry)
    new = {
        field: make(file, value, built.names)
        for (key, (field, make)), value in zip(_PLAIN.items(), _plain(entry), strict=True)
        if not (key in known and known[key] is value)
    }
    if last is None or last.built is not built:
        new |= {"object": built.object, **built.others}
    if last is None:
        scene = kind(path=file.path, **new)
        vars(scene)["_kept"] = parts.latest
    else:
        scene = last.scene._changed(new)
    parts.last = Last(entry, built, scene)
    return scene


def _friction(file: YamlSource, value: Any, names: tuple[str, ...]) -> Mapping[str, float]:
    return file.at((), lambda: friction_by_name(value, names))


_PLAIN: Mapping[str, tuple[str, Callable[[YamlSource, Any, tuple[str, ...]], Any]]] = {
    "name": ("name", lambda file, value, _: value or file.path.stem[:LONGEST_NAME]),
    "gravity": ("gravity", lambda _file, value, _: np.array(value)),
    "friction": ("friction", _friction),
    "loads": ("loads", lambda file, value, _: _loads(file, value)),
    "tangent_axes": ("tangent_axes", lambda _file, value, _: tuple(map(np.array, value))),
    "solve": ("solve_options", lambda _file, value, _: value.model_dump()),
    **{name: (name, lambda _file, value, _: value) for name in PLAIN_FIGURES},
}
"""Of keys that no body depends on: the field of a scene, and what makes it of the file, what the
key holds, and the names of supports and links."""
_plain = attrgetter(*_PLAIN)
_BESIDE_OTHERS = ("gravity", "loads", "max_normal_force", "tangent_axes")
"""Those that are checked beside the object's mass, or turn with bodies."""
FIELDS_BY_KEY = {key: field for key, (field, _) in _PLAIN.items() if key not in _BESIDE_OTHERS}
"""Keys of which one field of a scene is made that nothing else in the file counts for."""


def _built(file: YamlSource, parts: SceneParts, entry: SceneEntry) -> _Built:
    """Build the bodies of a scene file, and tell what looks wrong with what it says of them."""
    hand = None
    if entry.hand is not None:
        hand = build_hand(file, parts, entry.hand)
    supports = tuple(
        build_support(file, parts, ("supports", index), item)
        for index, item in enumerate(entry.supports)
    )
    links, tree = ((), None) if hand is None else (hand.link_names, hand.tree)
    names = tuple([support.name for support in supports])
    bodies = [*names, *links]
    _check_names(file, entry, links)
    made = build_object(file, parts, entry.object)
    materials = _materials(file, parts, entry)
    others = {
        "hand": hand,
        "supports": parts.latest.of("supports", supports, lambda: supports),
        "materials": materials,
        "hand_material": None if entry.hand is None else entry.hand.material,
        "given_contacts": parts.latest.of(
            "contacts", (entry.contacts, tree, *names), lambda: _contacts(file, entry, bodies)
        ),
        "motion": parts.latest.of(
            "motion", (entry.motion, tree), lambda: _motion(file, entry.motion, hand)
        ),
        "acceleration": parts.latest.of(
            "acceleration",
            (entry.acceleration, tree),
            lambda: _acceleration(file, entry.acceleration, hand),
        ),
        "controller": parts.latest.of(
            "controller", (entry.controller, tree), lambda: _controller(file, entry, hand)
        ),
        "uncertainty": parts.latest.of(
            "uncertainty",
            (entry.uncertainty, tree, materials, entry.object.name, *names),
            lambda: _uncertainty(file, entry, hand, names, materials),
        ),
        "count_own_weight": entry.hand is None or entry.hand.count_own_weight,
        "hybrid_force_limit": None if entry.hand is None else entry.hand.hybrid_force_limit,
    }
    emit(*entry_findings(entry, materials))
    return _Built(tuple(bodies), made, others)


def _controller(file: YamlSource, entry: SceneEntry, hand: Hand | None) -> Controller:
    stated = entry.controller
    if "controller" in entry.model_fields_set and not isinstance(stated, ControllerEntry):
        controller = Controller(stated)
    else:
        controller = Controller()
        if hand is not None:
            controller = file.at(("hand",), lambda: gains_of_robots(hand), ("robot",))
        if isinstance(stated, ControllerEntry):
            own = {name: getattr(stated, name) for name in stated.model_fields_set}
            controller = replace(controller, **own)
    joints, fingers = ((), ()) if hand is None else (hand.actuation.names, (*hand.fingers,))
    file.at(("controller",), lambda: controller.check(joints, fingers))
    return controller


def _uncertainty(
    file: YamlSource,
    entry: SceneEntry,
    hand: Hand | None,
    supports: Sequence[str],
    materials: Materials,
) -> Uncertainty | None:
    stated, made = entry.uncertainty, entry.object.name
    if stated is None:
        return None
    uncertainty = file.at(("uncertainty",), lambda: Uncertainty(**dict(stated)))
    named = uncertainty, hand, supports, materials.names, made
    file.at(("uncertainty",), lambda: check_names(*named))
    return uncertainty


def _check_weight(file: YamlSource, entry: SceneEntry, made: ManipulatedObject) -> None:
    """Refuse an object whose weight no double holds, or not beside the force that must bear it."""
    weight = made.mass * math.hypot(*entry.gravity)
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
    table = parts.latest.of(
        "table of materials",
        (repr(entry.materials),),
        lambda: file.at((), lambda: Materials.from_table(entry.materials)),
    )
    named: list[tuple[Location, str | None]] = [(("object", "material"), entry.object.material)]
    if entry.hand is not None:
        named.append((("hand", "material"), entry.hand.material))
    named += [(("supports", i, "material"), item.material) for i, item in enumerate(entry.supports)]
    for location, name in named:
        if name is not None:
            file.at(location, lambda name=name: table.check([name]))
    return table


def _check_names(file: YamlSource, entry: SceneEntry, links: Sequence[str]) -> None:
    """Refuse a body that is called like another one: contacts are told by these names."""
    taken = set(links)
    bodies: list[tuple[Location, str]] = [(("object", "name"), entry.object.name)]
    bodies += [(("supports", i, "name"), item.name) for i, item in enumerate(entry.supports)]
    for location, name in bodies:
        if name in taken:
            raise file.error(location, f"{name!r} names another body too; names must differ")
        taken.add(name)


def _contacts(
    file: YamlSource, entry: SceneEntry, bodies: list[str]
) -> tuple[GivenContact, ...] | None:
    if entry.contacts is None:
        return None
    contacts: list[GivenContact] = []
    for index, item in enumerate(entry.contacts):
        if item.body not in bodies:
            raise file.error(
                ("contacts", index, "body"),
                f"{item.body!r} is no hand link or support; {names_in_words(item.body, bodies)}",
            )
        normal = np.array(item.normal) / np.linalg.norm(item.normal)
        contacts.append(GivenContact(item.body, np.array(item.position), normal))
    return tuple(contacts)


def _motion(file: YamlSource, entry: MotionEntry | None, hand: Hand | None) -> Motion | None:
    if entry is None:
        return None
    own = None
    if entry.hand is not None:
        if hand is None:
            raise file.error(("motion", "hand"), "the scene has no hand that could move")
        own = HandMotion(twist_of(entry.hand.base_twist), dict(entry.hand.joint_velocities))
        file.at(
            ("motion", "hand"),
            lambda: hand.point_velocities(
                (), np.zeros((0, 3)), own.joint_velocities, own.base_twist
            ),
        )
    return Motion(twist_of(entry.object_twist), own)


def _loads(file: YamlSource, entries: Sequence[LoadEntry]) -> tuple[Load, ...]:
    names = [entry.name for entry in entries]
    for index, name in enumerate(names):
        if name in names[:index]:
            raise file.error(
                ("loads", index, "name"), f"{name!r} names another load too; names must differ"
            )
    return tuple(Load(**dict(entry)) for entry in entries)


def _acceleration(
    file: YamlSource, entry: AccelerationEntry | None, hand: Hand | None
) -> Acceleration | None:
    if entry is None:
        return None
    for argument in ("joint_velocities", "joint_accelerations"):
        named = getattr(entry, argument)
        if named and hand is None:
            raise file.error(("acceleration", argument), "the scene has no hand that could move")
        if hand is not None:
            file.at(
                ("acceleration",),
                lambda named=named, argument=argument: independent_rates(
                    hand.tree, named, argument
                ),
            )
    return file.at(("acceleration",), lambda: Acceleration(**dict(entry)))
