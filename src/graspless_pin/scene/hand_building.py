"""From the hand's entry of a scene file to a `Hand`."""

from __future__ import annotations

from dataclasses import replace

from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.mounts import Mount
from graspless_pin.geometry.robots.description import FingerSpec
from graspless_pin.geometry.robots.files import describe_urdf, find_robot
from graspless_pin.scene.body_building import build_pose
from graspless_pin.scene.hand_schema import HandEntry, MountEntry
from graspless_pin.scene.locating import Locator
from graspless_pin.scene.parts import SceneParts
from graspless_pin.scene.yaml_source import Location


def build_hand(file: Locator, parts: SceneParts, entry: HandEntry) -> Hand:
    """Return the hand of a scene file, or what earlier scenes left of it.

    Args:
        file: The file.
        parts: What earlier scenes of the same folder left.
        entry: The hand's entry.

    Raises:
        SceneError: Naming the part of the file.
    """
    return file.at(("hand",), lambda: parts.hand(entry, lambda: _assembled(file, parts, entry)))


def _assembled(file: Locator, parts: SceneParts, entry: HandEntry) -> Hand:
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
            mounts, q=entry.q, control=entry.control, effort_limits=entry.effort_limits
        ),
        source,
    )


def _mount(
    file: Locator, parts: SceneParts, where: Location, prefix: str, entry: MountEntry
) -> Mount:
    robot = entry.robot
    if entry.urdf is not None:
        robot = file.path(entry.urdf)
    elif robot is not None and robot.endswith((".yaml", ".yml")):
        robot = file.path(robot)
    fingers = None
    if entry.fingers is not None:
        fingers = {
            name: FingerSpec(tuple(item.joints), tuple(item.links), item.tip)
            for name, item in entry.fingers.items()
        }
    assert robot is not None  # noqa: S101 - the schema asks for one of the two
    source = robot
    folders = [file.path(folder) for folder in entry.package_dirs]
    found = file.at(
        where,
        lambda: parts.robot(
            ("urdf" if entry.urdf else "robot", str(source), *map(str, folders)),
            lambda: describe_urdf(source, folders) if entry.urdf else find_robot(source, folders),
        ),
        ("robot",),
    )
    pose = build_pose(file, (*where, "base_pose"), entry.base_pose)
    given = {
        "convex": entry.convex,
        "concavity": entry.concavity,
        "decompose_time_limit": entry.decompose_time_limit,
    }
    own = {name: value for name, value in given.items() if value is not None}
    meshes = replace(found.meshes, **own) if own else None
    return Mount(found, pose, prefix, fingers, meshes=meshes)
