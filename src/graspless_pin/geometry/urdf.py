"""Read a URDF as inert data: refuse XML tricks, find its meshes, prefix its names.

Pinocchio gets the text only after this module has checked it: its own parser reports mistakes on
standard error only, drops malformed shapes and fails on relative mesh paths.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from graspless_pin.errors import RobotError
from graspless_pin.geometry.urdf_links import check_link, check_origin, number, numbers

UNBOUNDED = 1e30
"""Stands for ``inf`` in the text given to Pinocchio, whose parser rejects the word itself."""

_MOVABLE_TYPES = ("revolute", "prismatic", "continuous")
_UNSUPPORTED_TYPES = ("floating", "planar")


@dataclass(frozen=True)
class Mimic:
    """A coupled joint: ``q[joint] = multiplier * q[leader] + offset`` (radians or metres)."""

    joint: str
    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfDocument:
    """A checked URDF with prefixed names and absolute mesh paths.

    Attributes:
        label: The file, for messages.
        text: The XML to give to Pinocchio.
        mimics: The couplings, in file order; their leaders need not exist.
        meshes: The collision meshes as (link, file), in file order.
    """

    label: str
    text: str
    mimics: tuple[Mimic, ...]
    meshes: tuple[tuple[str, Path], ...]


def read_urdf(path: Path, *, prefix: str = "", package_dirs: Sequence[Path] = ()) -> UrdfDocument:
    """Read, check and normalise one URDF file.

    Args:
        path: The file. Relative mesh paths in it are relative to its folder.
        prefix: Put before the name of every link and joint.
        package_dirs: Where ``package://NAME/...`` is looked up: a folder that is called NAME or
            one that holds a folder called NAME. The folders above the file are tried last.

    Returns:
        The document.

    Raises:
        RobotError: If the file is missing, is not a URDF, declares a DOCTYPE or entities, repeats
            a name, or has a malformed link or joint or one of an unsupported type.
        MeshError: If a collision mesh cannot be found.
    """
    root = _parse(path)
    links = _names(path, root.findall("link"), "link")
    _names(path, root.findall("joint"), "joint")
    mimics = [_check_joint(path, joint, links) for joint in root.findall("joint")]
    _check_single_root(path, root, links)
    meshes = [
        (link.get("name", ""), mesh)
        for link in root.findall("link")
        for mesh in check_link(path, link, package_dirs)
    ]
    _add_prefix(root, prefix)
    return UrdfDocument(
        label=str(path),
        text=ET.tostring(root, encoding="unicode"),
        mimics=tuple(
            Mimic(prefix + m.joint, prefix + m.leader, m.multiplier, m.offset) for m in mimics if m
        ),
        meshes=tuple((prefix + link, file) for link, file in meshes),
    )


def _parse(path: Path) -> ET.Element:
    """Return the ``<robot>`` element of a file without expanding anything."""
    if not path.is_file():
        raise RobotError(f"{path}: there is no such URDF file")
    content = path.read_bytes()

    def refuse(*_: object) -> None:
        raise RobotError(
            f"{path}: the file declares a DOCTYPE or XML entities; a URDF needs neither, "
            "remove the declaration"
        )

    scanner = expat.ParserCreate()
    scanner.StartDoctypeDeclHandler = refuse
    scanner.EntityDeclHandler = refuse
    try:
        scanner.Parse(content, True)  # noqa: FBT003 - final, a positional-only flag
        root = ET.fromstring(content)  # noqa: S314 - declarations were refused above
    except (expat.ExpatError, ET.ParseError) as error:
        raise RobotError(f"{path}: not well-formed XML ({error})") from error
    if root.tag != "robot":
        raise RobotError(f"{path}: a URDF starts with <robot>, this file with <{root.tag}>")
    return root


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


def _check_joint(path: Path, joint: ET.Element, links: set[str]) -> Mimic | None:
    """Check one joint, rewrite unbounded limits and return its coupling, if it has one."""
    name, kind = joint.get("name", ""), joint.get("type")
    where = f"{path}: joint {name!r}"
    if kind in _UNSUPPORTED_TYPES:
        raise RobotError(f"{where} is {kind}; use revolute, continuous, prismatic or fixed joints")
    if kind not in (*_MOVABLE_TYPES, "fixed"):
        raise RobotError(f"{where} has the unknown type {kind!r}")
    for end in ("parent", "child"):
        element = joint.find(end)
        link = None if element is None else element.get("link")
        if link not in links:
            raise RobotError(f"{where} names the {end} link {link!r}, which does not exist")
    check_origin(where, joint)
    if kind != "fixed":
        _check_axis(where, joint)
    limit = joint.find("limit")
    if limit is None and kind in ("revolute", "prismatic"):
        raise RobotError(f"{where} is {kind} and has no <limit lower upper effort velocity>")
    if limit is not None:
        _bound_limit(where, limit)
    mimic = joint.find("mimic")
    if mimic is None or kind == "fixed":
        return None
    joint.remove(mimic)  # the coupling is applied by us, Pinocchio sees independent joints
    return Mimic(
        name,
        mimic.get("joint", ""),
        number(where, "mimic multiplier", mimic.get("multiplier", "1")),
        number(where, "mimic offset", mimic.get("offset", "0")),
    )


def _check_axis(where: str, joint: ET.Element) -> None:
    """Refuse an axis of length zero, which Pinocchio would turn into NaN."""
    axis = joint.find("axis")
    if axis is None:
        return
    if not any(numbers(where, "axis xyz", axis.get("xyz", "1 0 0"), 3)):
        raise RobotError(f"{where} has the axis {axis.get('xyz')!r}; give one that is not zero")


def _bound_limit(where: str, limit: ET.Element) -> None:
    """Write what is unbounded or missing in a ``<limit>`` as large finite numbers."""
    for key in ("effort", "velocity"):
        limit.attrib.setdefault(key, "inf")
    for key, text in list(limit.attrib.items()):
        value = number(where, f"limit {key}", text)
        if abs(value) > UNBOUNDED:
            limit.set(key, repr(UNBOUNDED if value > 0.0 else -UNBOUNDED))


def _check_single_root(path: Path, root: ET.Element, links: set[str]) -> None:
    """Refuse forests and loops: exactly one link is nobody's child."""
    children = [
        element.get("link", "") for j in root.findall("joint") for element in j.findall("child")
    ]
    for link in children:
        if children.count(link) > 1:
            raise RobotError(f"{path}: link {link!r} is the child of two joints")
    roots = sorted(links - set(children))
    if len(roots) != 1:
        found = ", ".join(roots) if roots else "none (the links form a loop)"
        raise RobotError(f"{path}: a robot has one root link, found {found}")


def _add_prefix(root: ET.Element, prefix: str) -> None:
    """Put ``prefix`` before every link and joint name and every reference to one."""
    if not prefix:
        return
    for element in (*root.findall("link"), *root.findall("joint")):
        element.set("name", prefix + element.get("name", ""))
    for joint in root.findall("joint"):
        for end in (*joint.findall("parent"), *joint.findall("child")):
            end.set("link", prefix + end.get("link", ""))
