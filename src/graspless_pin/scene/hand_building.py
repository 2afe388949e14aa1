"""From the hand's entry of a scene file to a `Hand`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from pydantic import BaseModel

from graspless_pin.geometry.hand.assembly import AssembledMounts, assembled_mounts, fields_of
from graspless_pin.geometry.hand.configuration import joint_positions
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.mounts import Mount
from graspless_pin.geometry.robots.description import LinkMeshes, RobotDescription
from graspless_pin.geometry.robots.files import describe_urdf, find_robot
from graspless_pin.scene.body_building import build_pose
from graspless_pin.scene.hand_schema import HandEntry, MountEntry
from graspless_pin.scene.stages import SceneParts
from graspless_pin.scene.yaml_source import Location, YamlSource

_ANYWHERE = {"base_pose"}
_NOT_OF_THE_MOUNTS = {
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
    said = [value for name, value in entry if name not in _NOT_OF_THE_MOUNTS]
    sources = [one if isinstance(one, BaseModel) else repr(one) for one in (*said, *entry.mounts)]
    mounts = parts.stage("mounts", (*sources,), lambda: _mounts(file, parts, entry, places))
    tree, q = mounts.joined.tree, entry.positions()
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
    limited = object.__new__(Hand)  # its arrays are read-only already
    told = (*hand.findings, *limits[1])
    vars(limited).update(vars(hand), effort_limits=limits[0], findings=told)
    return limited


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
    return Mount(found, None, prefix, fingers, meshes=meshes, root_link=entry.root_link)


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
