"""The links and joints of a URDF as one tree: checked, cut off above a link, and named."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

from graspless_pin.errors import RobotError
from graspless_pin.intake.text import fault_of_name

LONGEST_CHAIN = 200
"""More joints between root and tip than any robot has; Pinocchio's reader needs stack for each."""

FREE_TYPES = ("floating", "planar")
"""Joints that a hand has no motor for: fixed where they carry a base, refused elsewhere."""


def root_of_tree(path: Path, root: ET.Element) -> str:
    """Return the link that is nobody's child.

    Args:
        path: The URDF file.
        root: Its ``<robot>`` element.

    Raises:
        RobotError: If a name is missing or twice there, a joint hangs on no link, or the links form
            no tree, or one that is too deep.
    """
    links = _names(path, root.findall("link"), "link")
    _names(path, root.findall("joint"), "joint")
    for joint in root.findall("joint"):
        for end in ("parent", "child"):
            link = _end(joint, end)
            if link not in links:
                raise RobotError(
                    f"{path}: joint {joint.get('name')!r} names the {end} link {link or None!r}, "
                    "which does not exist"
                )
    children = [_end(joint, "child") for joint in root.findall("joint")]
    for link in children:
        if children.count(link) > 1:
            raise RobotError(f"{path}: link {link!r} is the child of two joints")
    roots = sorted(links - set(children))
    if len(roots) != 1:
        found = ", ".join(roots) if roots else "none (the links form a loop)"
        raise RobotError(f"{path}: a robot has one root link, found {found}")
    _check_chains(path, root, roots[0])
    return roots[0]


def check_name_lengths(path: Path, root: ET.Element) -> None:
    """Refuse names of links, joints and tendons that are too long.

    Raises:
        RobotError: One is.
    """
    for kind in ("link", "joint", "tendon"):
        for element in root.findall(kind):
            if fault := fault_of_name(element.get("name", "")):
                raise RobotError(f"{path}: a <{kind}> {fault}, its hand's prefix included")


def _names(path: Path, elements: Iterable[ET.Element], kind: str) -> set[str]:
    """Return the names of links or joints, which must exist and differ."""
    names: set[str] = set()
    for element in elements:
        name = element.get("name")
        if not name:
            raise RobotError(f"{path}: a <{kind}> has no name")
        if name in names:
            raise RobotError(f"{path}: two {kind}s are called {name!r}; rename one")
        names.add(name)
    if kind == "link" and not names:
        raise RobotError(f"{path}: the robot has no <link>")
    return names


def _check_chains(path: Path, root: ET.Element, top: str) -> None:
    """Refuse a chain of more joints than any robot has, and links that do not hang on the root."""
    below: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        below.setdefault(_end(joint, "parent"), []).append(_end(joint, "child"))
    level = [top]
    for _ in range(LONGEST_CHAIN + 1):
        level = [child for link in level for child in below.get(link, ())]
        if not level:
            return
    raise RobotError(
        f"{path}: more than {LONGEST_CHAIN} joints follow each other down to link {level[0]!r}; "
        "no robot has so many"
    )


def keep_below(path: Path, root: ET.Element, top: str) -> None:
    """Remove all links and joints but ``top`` and what hangs on it.

    Raises:
        RobotError: If there is no such link.
    """
    joints = root.findall("joint")
    ends = [(_end(joint, "parent"), _end(joint, "child")) for joint in joints]
    links = {link.get("name", ""): link for link in root.findall("link")}
    if top not in links:
        raise RobotError(f"{path}: there is no link {top!r} to start from")
    kept = {top}
    while below := {child for parent, child in ends if parent in kept} - kept:
        kept |= below
    for name, link in links.items():
        if name not in kept:
            root.remove(link)
    for joint, (parent, _) in zip(joints, ends, strict=True):
        if parent not in kept:
            root.remove(joint)


def fix_base(path: Path, root: ET.Element, top: str) -> None:
    """Fix the floating or planar joint that carries the robot.

    Raises:
        RobotError: If there is such a joint anywhere else.
    """
    first = [joint for joint in root.findall("joint") if _end(joint, "parent") == top]
    for joint in root.findall("joint"):
        kind = joint.get("type")
        if kind not in FREE_TYPES:
            continue
        if first != [joint]:
            raise RobotError(
                f"{path}: joint {joint.get('name')!r} is {kind} and does not carry the whole "
                "robot; use revolute, continuous, prismatic or fixed joints"
            )
        joint.set("type", "fixed")


def _end(joint: ET.Element, end: str) -> str:
    """Return the link at one end of a joint."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def add_prefix(root: ET.Element, prefix: str) -> None:
    """Put ``prefix`` before every link and joint name and every reference to one."""
    if not prefix:
        return
    for element in (*root.findall("link"), *root.findall("joint")):
        element.set("name", prefix + element.get("name", ""))
    for joint in root.findall("joint"):
        for end in (*joint.findall("parent"), *joint.findall("child")):
            end.set("link", prefix + end.get("link", ""))
