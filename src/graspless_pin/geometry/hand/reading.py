"""Read a robot: a URDF, a xacro file or an MJCF, with the SRDF beside it.

Files are treated as inert data: XML entities are refused, and a xacro file, which is a program, is
expanded in a child process. Why no other URDF parser is used: see docs/evidence/urdf.md. An SRDF
states groups of joints, named states, and pairs of links whose overlaps are ignored.
"""

from __future__ import annotations

import importlib.util
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from pathlib import Path

from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import ArgumentError, CrashError, OverrunError, RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.robot_model import RobotModel
from graspless_pin.geometry.hand.urdf import robot_of_urdf
from graspless_pin.geometry.outside_calls import run_xacro
from graspless_pin.geometry.robots.description import RobotDescription
from graspless_pin.intake.files import (
    FileKind,
    errors_of_text,
    is_file,
    kind_of_file,
    note_read,
    read_bytes,
    refuse_other_kind,
)
from graspless_pin.intake.text import parse_xml
from graspless_pin.suggestions import first_of, names_in_words, nearest_name

URDF = FileKind("URDF", 16, RobotError)

_OTHER_XML = ("XML file", "SDF file", "MuJoCo model", "xacro file")
_XACRO_SECONDS = 60.0


def read_robot(
    described: RobotDescription, prefix: str = "", *, with_shapes: bool = True
) -> RobotModel:
    """Read and check the URDF, xacro or MJCF file of a robot, or return the given `RobotModel`.

    A floating or planar joint below the root link carries the whole robot; it is fixed at zero,
    because a hand is fixed where it is mounted. ``package://NAME/...`` is a folder of the
    description that is called NAME or one in it; the folders above the file are tried last. With a
    root link, faults of links and joints outside its subtree in a URDF are ignored.

    Args:
        described: The description of the robot.
        prefix: Prefix for the name of every link, joint and tendon.
        with_shapes: Whether the shapes of the links are read.

    Returns:
        The robot. Its meshes are not read yet, and may be missing.

    Raises:
        RobotError: If the file is missing, is no URDF or MJCF, declares a DOCTYPE or entities,
            repeats a name, lacks the root link, or has a malformed link, joint or rotor or a joint
            of an unsupported type.
    """
    path, root_link = described.urdf_path, described.root_link
    if described.read is not None:
        robot = described.read if root_link is None else described.read.subtree(root_link)
        return robot.with_fixed_base().prefixed(prefix)
    root_element = _root_element(described)
    file_names = {item.get("name", "") for item in root_element.iter()}
    if root_element.tag == "mujoco":
        from graspless_pin.geometry.hand.mjcf import robot_of_source
        from graspless_pin.geometry.hand.mjcf_source import read_mjcf

        robot = robot_of_source(
            read_mjcf(path), visuals_collide=described.visuals_collide, with_shapes=with_shapes
        )
        file_names |= {item.name for part in (robot.links, robot.joints) for item in part}
        robot = robot if root_link is None else robot.subtree(root_link)
    else:
        robot = robot_of_urdf(described, root_element, with_shapes=with_shapes)
    return with_srdf(robot.with_fixed_base(), path, described.srdf, file_names).prefixed(prefix)


def _root_element(described: RobotDescription) -> ET.Element:
    """Return the ``<robot>`` of a URDF or an expanded xacro file, or the ``<mujoco>`` of an MJCF.

    Raises:
        RobotError: If the file is missing, is none of these, declares a DOCTYPE or entities, or
            xacro cannot expand it.
    """
    path = described.urdf_path
    content = read_bytes(path, URDF)
    kind = kind_of_file(path, content)
    refuse_other_kind(path, URDF, None if kind in _OTHER_XML else kind)
    with errors_of_text(path, URDF):
        root = parse_xml(content)
        is_xacro = path.suffix.lower() == ".xacro"
        if is_xacro or any(element.tag.startswith("xacro:") for element in root.iter()):
            root = parse_xml(_expanded_xacro(described))
    if root.tag == "sdf":
        raise RobotError(
            f"{path}: is an SDF, which is not supported; convert it to URDF or MJCF, e.g. with "
            "sdformat2mjcf of the package sdformat-mjcf"
        )
    if root.tag not in ("robot", "mujoco"):
        raise RobotError(
            f"{path}: a URDF starts with <robot> and an MJCF with <mujoco>, but this file with "
            f"<{root.tag}>"
        )
    return root


def _expanded_xacro(described: RobotDescription) -> bytes:
    """Return the URDF that a xacro file expands to.

    ``$(find NAME)`` is resolved like ``package://NAME``.

    Raises:
        RobotError: If xacrodoc is not installed, or the file cannot be expanded in a minute.
    """
    path = described.urdf_path
    if importlib.util.find_spec("xacrodoc") is None:
        raise RobotError(
            f"{path} is a xacro file, which needs xacrodoc; install it with pip install "
            "'graspless-pin[xacro]', or expand it: xacro FILE > hand.urdf"
        )
    try:
        with ChildProcess() as child:
            text, included = child.call(
                run_xacro,
                str(path.resolve()),
                _package_folders(path, described.package_dirs),
                dict(described.xacro_args),
                limit=_XACRO_SECONDS,
            )
    except ValueError as error:
        message = " ".join(str(error).split())
        hint = "; give values of its <xacro:arg> under xacro_args in a robot file"
        raise RobotError(f"{path}: xacro cannot expand this file ({message}){hint}") from None
    except OverrunError:
        raise RobotError(
            f"{path}: xacro did not expand this file in {_XACRO_SECONDS:g} s"
        ) from None
    except CrashError as error:
        raise RobotError(f"{path}: xacro crashed on this file ({error})") from None
    for file in [file_included for file_included in included if is_file(file_included)]:
        note_read(file, file.stat())
    return text.encode()


def _package_folders(path: Path, package_dirs: Sequence[Path]) -> dict[str, str]:
    """Return folders by package name; given folders win over those above the file."""
    folders = {folder.name: str(folder) for folder in reversed(path.resolve().parents)}
    for folder in (item.resolve() for item in package_dirs if item.is_dir()):
        inside = sorted(item for item in folder.iterdir() if item.is_dir())
        folders |= {item.name: str(item) for item in (*inside, folder)}
    return folders


_MOST_NAMED = 8
_SRDF = FileKind("SRDF", 16, RobotError)


def with_srdf(
    robot: RobotModel, urdf: Path, srdf: Path | None, named: AbstractSet[str]
) -> RobotModel:
    """Return a robot with the pairs, groups and states of its SRDF.

    Names in the SRDF that the robot does not have are ignored with a warning. Without a path the
    SRDF has the URDF's name and is beside it, or in the folder ``srdf`` beside its folder, or there
    is none. Such an SRDF is ignored with a warning if it cannot be read.

    Args:
        robot: The robot, without a prefix.
        urdf: The robot's file.
        srdf: The SRDF; None: it is looked for.
        named: All names in the robot's file, such as links and joints above its root link.

    Raises:
        RobotError: If the given SRDF cannot be read.

    Warns:
        GrasplessPinWarning: If an SRDF that was looked for cannot be read, or the SRDF names joints
            or links that the robot does not have.
    """
    if srdf is not None:
        return _with_srdf_file(robot, srdf, named)
    name = f"{urdf.stem}.srdf"
    for file in (urdf.with_name(name), urdf.parent.parent / "srdf" / name):
        if is_file(file):
            break
    else:
        return robot
    try:
        return _with_srdf_file(robot, file, named)
    except RobotError as error:
        emit(
            Finding(
                FindingCode.READER_REMARK,
                urdf.stem,
                str(error),
                "until it can be read, pairs of links that it disables count as overlaps, and its "
                "groups and states are unknown",
            )
        )
        return robot


def named_positions(
    states: Mapping[str, Mapping[str, float]],
    names: list[str],
    lacking: Mapping[str, str],
) -> dict[str, float]:
    """Return the joint positions of named SRDF states; later states override earlier ones.

    Args:
        states: Positions by state, ``GROUP/STATE`` with the mount's prefix.
        names: Names of states, or ``STATE`` alone for all groups that have it.
        lacking: See `RobotModel.missing`.

    Raises:
        ArgumentError: If there is no such state, it sets a joint that the robot does not have, or
            groups contradict each other about a joint.
    """
    positions: dict[str, float] = {}
    for name in names:
        matches = [key for key in states if key == name or key.endswith(f"/{name}")]
        if not matches:
            raise ArgumentError(
                "group_states", f"unknown state {name!r} of an SRDF; {names_in_words(name, states)}"
            )
        refuse_incomplete("group_states", matches, lacking)
        if not any(states[key] for key in matches):
            raise ArgumentError(
                "group_states", f"{name!r} of an SRDF gives no position of a joint of this robot; "
                f"use a state of its joints, {names_in_words(name, states)}"
            )  # fmt: skip
        state_positions: dict[str, float] = {}
        for key in matches:
            for joint, value in states[key].items():
                if state_positions.setdefault(joint, value) != value:
                    raise ArgumentError(
                        "group_states",
                        f"{name!r} stands for {', '.join(matches)}, which put joint {joint!r} at "
                        f"{state_positions[joint]:g} and {value:g}; give one of these states",
                    )
        positions |= state_positions
    return positions


def refuse_incomplete(argument: str, names: Iterable[str], lacking: Mapping[str, str]) -> None:
    """Refuse groups and states of SRDFs with joints or links that the robot does not have.

    Args:
        argument: The argument that names them.
        names: Names of the groups and states.
        lacking: See `RobotModel.missing`.

    Raises:
        ArgumentError: If one of the names is in ``lacking``.
    """
    for name in names:
        if name in lacking:
            raise ArgumentError(
                argument,
                f"{name!r} of an SRDF has names that the robot does not have: {lacking[name]}; "
                "correct the SRDF, or leave this name out",
            )


def _with_srdf_file(robot: RobotModel, file: Path, named: AbstractSet[str]) -> RobotModel:
    with errors_of_text(file, _SRDF):
        root = parse_xml(read_bytes(file, _SRDF))
    if root.tag != "robot":
        raise RobotError(f"{file}: an SRDF starts with <robot>, but this file with <{root.tag}>")
    groups = _SrdfGroups(robot, file, root)
    pair_texts, lacking = _unknown_names(robot, root, named)
    items = [*pair_texts, *(f"{text} ({name!r})" for name, text in lacking.items())]
    if items:
        emit(
            Finding(
                FindingCode.READER_REMARK,
                robot.root,
                f"{file} names what the robot does not have: {first_of(items, _MOST_NAMED, '; ')}",
                "correct these names: until then, such pairs are not disabled, and such groups and "
                "states cannot be used",
            )
        )
    return replace(
        robot,
        disabled_pairs=frozenset(
            frozenset((one.get("link1", ""), one.get("link2", "")))
            for one in root.findall("disable_collisions")
        ),
        # The SRDF of a whole robot may be beside the URDF of its hand alone.
        groups={name: own for name in groups.elements if (own := groups.joints(name))},
        group_states=_group_states(robot, file, root),
        missing={name: f"{file}: {text}" for name, text in lacking.items()},
    )


def _unknown_names(
    robot: RobotModel, root: ET.Element, named: AbstractSet[str]
) -> tuple[list[str], dict[str, str]]:
    """Return texts on the unknown links of pairs, and on unknown names by group or state."""
    known = {
        "link": [link.name for link in robot.links],
        "joint": [joint.name for joint in robot.joints],
    }
    # The joint of a floating base is no joint of the robot model.
    passed = {one.get("name", "") for one in root.findall("virtual_joint")} | {"root_joint", *named}

    def unknowns(kind: str, names: Iterable[str]) -> list[str]:
        texts = []
        for name in dict.fromkeys(names):
            if name not in passed and name not in known[kind]:
                match = nearest_name(name, known[kind])
                texts.append(f"{kind} {name!r}" + ("" if match is None else f", meant {match!r}?"))
        return texts

    pairs = root.findall("disable_collisions")
    of_pairs = unknowns("link", (one.get(key, "") for one in pairs for key in ("link1", "link2")))
    lacking: dict[str, str] = {}
    for element in (*root.findall("group"), *root.findall("group_state")):
        name = element.get("name", "")
        if element.tag == "group_state":
            name = f"{element.get('group', '')}/{name}"
        member_texts = [
            text
            for kind in known
            for text in unknowns(kind, (
                part.get("name", "") for part in element.findall(kind)
                if len(part.get("value", "").split()) <= 1
            ))
        ]  # fmt: skip
        if member_texts:
            lacking[name] = first_of(member_texts, _MOST_NAMED)
    return [f"{one} (disable_collisions)" for one in of_pairs], lacking


class _SrdfGroups:
    """The groups of an SRDF, which may contain each other."""

    def __init__(self, robot: RobotModel, file: Path, root: ET.Element) -> None:
        self.elements = {one.get("name", ""): one for one in root.findall("group")}
        self._file, self._groups_in_progress = file, set[str]()
        self._above = {joint.child: joint for joint in robot.joints}
        self._movable = set(robot.movable_joints)

    def joints(self, name: str) -> tuple[str, ...]:
        """Return the movable joints of a group, nested groups included."""
        if name in self._groups_in_progress:
            raise RobotError(f"{self._file}: the group {name!r} contains itself; remove it there")
        self._groups_in_progress.add(name)
        names: list[str] = []
        for part in self.elements[name]:
            item = part.get("name", "")
            match part.tag:
                case "joint":
                    names.append(item)
                case "link" if item in self._above:
                    names.append(self._above[item].name)
                case "chain":
                    names += self._chain(name, part.get("base_link", ""), part.get("tip_link", ""))
                case "group" if item in self.elements:
                    names += self.joints(item)
                case "group":
                    raise RobotError(
                        f"{self._file}: the group {name!r} contains {item!r}, which is no group; "
                        f"{names_in_words(item, self.elements)}"
                    )
        self._groups_in_progress.remove(name)
        return tuple(joint for joint in dict.fromkeys(names) if joint in self._movable)

    def _chain(self, name: str, base: str, tip: str) -> list[str]:
        chain: list[str] = []
        link = tip
        while link != base:
            if link not in self._above:
                raise RobotError(
                    f"{self._file}: the group {name!r} has a chain from link {base!r} to {tip!r}, "
                    "but the robot has no joints between them; correct the names"
                )
            chain.append(self._above[link].name)
            link = self._above[link].parent
        return chain[::-1]


def _group_states(robot: RobotModel, file: Path, root: ET.Element) -> dict[str, dict[str, float]]:
    """Return positions by state, of joints that the robot has; else see `_unknown_names`."""
    movable, states = set(robot.movable_joints), {}
    for state in root.findall("group_state"):
        name = f"{state.get('group', '')}/{state.get('name', '')}"
        positions = {}
        for joint in state.findall("joint"):
            own, text = joint.get("name", ""), joint.get("value", "")
            if own not in movable:
                continue
            try:
                positions[own] = float(text)
            except ValueError:
                positions[own] = math.nan
            if not math.isfinite(positions[own]):
                raise RobotError(
                    f"{file}: the state {name!r} puts joint {own!r} at {text!r}; give a number"
                )
        states[name] = positions
    return states
