"""From the hand's entry of a scene file to a `Hand`, and the hands that scenes share."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, fields, replace

from graspless_pin.geometry.hand.configuration import joint_positions
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.mounts import Mount
from graspless_pin.geometry.robots.description import LinkMeshes, RobotDescription
from graspless_pin.geometry.robots.files import describe_urdf, find_robot
from graspless_pin.scene.body_building import build_pose
from graspless_pin.scene.hand_schema import HandEntry, MountEntry
from graspless_pin.scene.yaml_source import Location, YamlSource

_MOST_HANDS = 16
_NOT_OF_THE_HAND = {"q", "q_deg", "material", "count_own_weight", "hybrid_force_limit"}


@dataclass(eq=False)
class SceneParts:
    """Robots and hands of the scenes of one folder, kept for the next scene.

    A hand at other joint positions is the same kinematics and shapes; what is kept never changes
    what a scene becomes. Of hands, the sixteen that were used last are kept.

    Attributes:
        robots: Robot by name or path.
        hands: Hand by all of its entry but what leaves kinematics, shapes and limits alone.
    """

    robots: dict[tuple[str, ...], RobotDescription] = field(default_factory=dict)
    hands: OrderedDict[str, Hand] = field(default_factory=OrderedDict)


def build_hand(file: YamlSource, parts: SceneParts, entry: HandEntry) -> Hand:
    """Return the hand of a scene file, or what earlier scenes left of it.

    Args:
        file: The file.
        parts: What earlier scenes of the same folder left.
        entry: The hand's entry.

    Raises:
        SceneError: Naming the part of the file.
    """
    key = entry.model_dump_json(exclude=_NOT_OF_THE_HAND)
    known = parts.hands.get(key)
    if known is None:
        hand = _assembled(file, parts, entry)
    else:
        positions = file.at(("hand",), lambda: joint_positions(known.tree, entry.positions()))
        hand = replace(known, positions=positions)
    for name in entry.q_deg:
        if hand.tree.joint_kinds[hand.tree.joint_index[name]] == "prismatic":
            raise file.error(("hand", "q_deg", name), "is a linear joint; give metres under q")
    parts.hands[key] = hand
    parts.hands.move_to_end(key)
    while len(parts.hands) > _MOST_HANDS:
        parts.hands.popitem(last=False)
    return hand


def _assembled(file: YamlSource, parts: SceneParts, entry: HandEntry) -> Hand:
    mounts = []
    for index, (prefix, item) in enumerate(entry.mount_entries()):
        where: Location = ("hand", "mounts", index) if entry.mounts else ("hand",)
        mounts.append(_mount(file, parts, where, prefix, item))
    source: Location = ("mounts",)
    if not entry.mounts:
        source = ("robot",) if entry.urdf is None else ("urdf",)
    return file.at(
        ("hand",),
        lambda: Hand.assemble(
            mounts,
            q=entry.positions(),
            control=entry.control,
            effort_limits=entry.effort_limits,
            armature=entry.armature,
        ),
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
    pose = build_pose(file, (*where, "base_pose"), entry.base_pose)
    given = {item.name: getattr(entry, item.name) for item in fields(LinkMeshes)}
    own = {name: value for name, value in given.items() if value is not None}
    meshes = replace(found.meshes, **own) if own else None
    return Mount(found, pose, prefix, fingers, meshes=meshes, root_link=entry.root_link)


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
