"""Read a URDF as inert data: refuse XML tricks, find its meshes, prefix its names.

Pinocchio gets the text only after this module has checked it: its own parser reports mistakes on
standard error only, drops malformed shapes and fails on relative mesh paths.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from graspless_pin.errors import RobotError
from graspless_pin.geometry.hand.urdf_links import (
    LinkMesh,
    check_link,
    check_origin,
    checked_number,
    numbers,
)
from graspless_pin.geometry.hand.urdf_rotors import rotor_inertias
from graspless_pin.geometry.hand.urdf_visuals import LinkVisual, let_visuals_collide, read_visuals
from graspless_pin.geometry.hand.xacro_text import expanded, is_xacro
from graspless_pin.geometry.robots.description import JointCoupling
from graspless_pin.intake.files import FileKind, errors_of_text, read_bytes, refuse_other_kind
from graspless_pin.intake.recognition import kind_of_file
from graspless_pin.intake.xml_text import parse_xml

URDF = FileKind("URDF", 16, RobotError)

MOST_LINKS = 1000
"""More links than any robot has."""
LONGEST_CHAIN = 200
"""More joints between root and tip than any robot has; Pinocchio's reader needs stack for each."""

UNBOUNDED = 1e30
"""Stands for ``inf`` in the text given to Pinocchio, whose parser rejects the word itself."""

MOVABLE_TYPES = ("revolute", "prismatic", "continuous")
FREE_TYPES = ("floating", "planar")
"""Joints that a hand has no motor for: fixed where they carry a base, refused elsewhere."""


@dataclass(frozen=True)
class UrdfDocument:
    """A checked URDF with prefixed names, and shapes that Pinocchio reads.

    Attributes:
        label: The file, for messages.
        text: The XML to give to Pinocchio.
        root: The root link.
        joints: The movable joints, in file order.
        mimics: The couplings, in file order; their leaders need not exist.
        meshes: The collision meshes, in file order.
        capsules: What Pinocchio calls the collision shapes that are capsules.
        visuals: How the links look.
        rotors: Inertia of a motor's rotor by joint, kg m^2 (kg), gear ratio squared included.
    """

    label: str
    text: str
    root: str
    joints: tuple[str, ...]
    mimics: tuple[JointCoupling, ...]
    meshes: tuple[LinkMesh, ...]
    capsules: frozenset[str] = frozenset()
    visuals: tuple[LinkVisual, ...] = ()
    rotors: Mapping[str, float] = field(default_factory=dict)


def read_urdf(
    path: Path,
    *,
    prefix: str = "",
    package_dirs: Sequence[Path] = (),
    root_link: str | None = None,
    xacro_args: Mapping[str, str] = MappingProxyType({}),
    visuals_collide: bool = False,
    with_meshes: bool = True,
) -> UrdfDocument:
    """Read, check and normalise one URDF, xacro or MJCF file.

    A floating or planar joint below the root link carries the whole robot; it is fixed at zero,
    because a hand stands where it is mounted.

    Args:
        path: The file. Relative mesh paths in it are relative to its folder.
        prefix: Put before the name of every link and joint.
        package_dirs: Where ``package://NAME/...`` is looked up: a folder that is called NAME or
            one that holds a folder called NAME. The folders above the file are tried last.
        root_link: Keep only this link and what hangs on it, e.g. the hand of a whole robot.
        xacro_args: Values of the ``<xacro:arg>`` of a xacro file.
        visuals_collide: Whether links without collision shapes collide with their visual ones.
        with_meshes: Whether the collision meshes must be there; without, shapes are dropped.

    Returns:
        The document.

    Raises:
        RobotError: If the file is missing, is no URDF or MJCF, declares a DOCTYPE or entities,
            repeats a name, lacks ``root_link``, or has a malformed link, joint or rotor or a joint
            of an unsupported type.
        MeshError: If a collision mesh cannot be found.
    """
    root = parse_robot(path, package_dirs, xacro_args)
    links = _names(path, root.findall("link"), "link")
    _names(path, root.findall("joint"), "joint")
    mimics = [_check_joint(path, joint, links) for joint in root.findall("joint")]
    top = _single_root(path, root, links)
    if root_link is not None:
        keep_below(path, root, root_link)
        top = root_link
    if visuals_collide:
        let_visuals_collide(root)
    _fix_base(path, root, top)
    joints = tuple(
        joint.get("name", "")
        for joint in root.findall("joint")
        if joint.get("type") in MOVABLE_TYPES
    )
    if not with_meshes:
        for link in root.findall("link"):
            for collision in link.findall("collision"):
                link.remove(collision)
    checked = [check_link(path, link, package_dirs) for link in root.findall("link")]
    meshes = [replace(m, link=prefix + m.link) for found, _ in checked for m in found]
    capsules = [prefix + name for _, found in checked for name in found]
    _add_prefix(root, prefix)
    visuals = read_visuals(path, root, package_dirs) if with_meshes else ()
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)  # Pinocchio's reader complains of odd ones on standard error
    return UrdfDocument(
        label=str(path),
        text=ET.tostring(root, encoding="unicode"),
        root=prefix + top,
        joints=tuple(prefix + joint for joint in joints),
        mimics=tuple(m.prefixed(prefix) for m in mimics if m is not None and m.joint in joints),
        meshes=tuple(meshes),
        capsules=frozenset(capsules),
        visuals=visuals,
        rotors={prefix + name: value for name, value in rotor_inertias(path, root).items()},
    )


_OTHER_XML = ("XML file", "SDF file", "MuJoCo model", "xacro file")


def parse_robot(
    path: Path,
    package_dirs: Sequence[Path] = (),
    xacro_args: Mapping[str, str] = MappingProxyType({}),
) -> ET.Element:
    """Return the ``<robot>`` element of a URDF, a xacro file or an MJCF, without XML's entities.

    Args:
        path: The file.
        package_dirs: Where a xacro file finds packages.
        xacro_args: Values of its ``<xacro:arg>``.

    Raises:
        RobotError: If the file is missing, is none of them, or declares a DOCTYPE or entities; see
            `mjcf_robot` and `expanded`, too.
    """
    content = read_bytes(path, URDF)
    found = kind_of_file(path, content)
    refuse_other_kind(path, URDF, None if found in _OTHER_XML else found)
    with errors_of_text(path, URDF):
        root = parse_xml(content)
        if path.suffix == ".xacro" or is_xacro(root):
            root = parse_xml(expanded(path, package_dirs, xacro_args))
    if root.tag == "mujoco":
        from graspless_pin.geometry.hand.mjcf import mjcf_robot

        root = mjcf_robot(path)
    if root.tag == "sdf":
        raise RobotError(
            f"{path}: is an SDF, which is not read; write it as a URDF or as an MJCF, e.g. with "
            "sdformat2mjcf of the package sdformat-mjcf"
        )
    if root.tag != "robot":
        raise RobotError(
            f"{path}: a URDF starts with <robot> and an MJCF with <mujoco>, this file with "
            f"<{root.tag}>"
        )
    if len(root.findall("link")) > MOST_LINKS:
        raise RobotError(
            f"{path}: has more than {MOST_LINKS} links, the most that a robot may have"
        )
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


def _check_joint(path: Path, joint: ET.Element, links: set[str]) -> JointCoupling | None:
    """Check one joint, rewrite unbounded limits and return its coupling, if it has one."""
    name, kind = joint.get("name", ""), joint.get("type")
    where = f"{path}: joint {name!r}"
    if kind not in (*MOVABLE_TYPES, *FREE_TYPES, "fixed"):
        raise RobotError(f"{where} has the unknown type {kind!r}")
    for end in ("parent", "child"):
        element = joint.find(end)
        link = None if element is None else element.get("link")
        if link not in links:
            raise RobotError(f"{where} names the {end} link {link!r}, which does not exist")
    check_origin(where, joint)
    if kind in MOVABLE_TYPES:
        _check_axis(where, joint)
    limit = joint.find("limit")
    if limit is None and kind in ("revolute", "prismatic"):
        raise RobotError(f"{where} is {kind} and has no <limit lower upper effort velocity>")
    if limit is not None:
        _bound_limit(where, limit)
    mimic = joint.find("mimic")
    if mimic is None:
        return None
    joint.remove(mimic)  # the coupling is applied by us, Pinocchio sees independent joints
    if kind not in MOVABLE_TYPES:
        return None
    factor = checked_number(where, "mimic multiplier", mimic.get("multiplier", "1"))
    offset = checked_number(where, "mimic offset", mimic.get("offset", "0"))
    return JointCoupling(name, {mimic.get("joint", ""): factor}, offset)


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
        value = checked_number(where, f"limit {key}", text, unlimited=True)
        if abs(value) > UNBOUNDED:
            limit.set(key, repr(UNBOUNDED if value > 0.0 else -UNBOUNDED))


def _single_root(path: Path, root: ET.Element, links: set[str]) -> str:
    """Return the link that is nobody's child; refuse forests and loops."""
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
    _check_chains(path, root, roots[0])
    return roots[0]


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


def _fix_base(path: Path, root: ET.Element, top: str) -> None:
    """Fix the floating or planar joint that carries the robot; refuse it anywhere else."""
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


def _add_prefix(root: ET.Element, prefix: str) -> None:
    """Put ``prefix`` before every link and joint name and every reference to one."""
    if not prefix:
        return
    for element in (*root.findall("link"), *root.findall("joint")):
        element.set("name", prefix + element.get("name", ""))
    for joint in root.findall("joint"):
        for end in (*joint.findall("parent"), *joint.findall("child")):
            end.set("link", prefix + end.get("link", ""))
