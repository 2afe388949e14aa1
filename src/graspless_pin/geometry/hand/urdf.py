"""Read a URDF as inert data: refuse XML tricks, find its meshes, prefix its names.

Pinocchio gets the text only after this module has checked it: its own parser reports mistakes on
standard error only, drops malformed shapes and fails on relative mesh paths. Why no other parser
stands before the checks: see docs/evidence/urdf.md.

Which links may be in each other, as the SRDF that stands beside a URDF says.

Rotor inertias that the transmissions of a URDF state, as Drake writes them.

Expand a xacro file in a process of its own: it is a program, and may take for ever.
"""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import CrashError, OverrunError, RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.urdf_links import (
    LinkMesh,
    check_link,
    check_origin,
    checked_number,
    numbers,
)
from graspless_pin.geometry.hand.urdf_tendons import DrawnTendon, read_tendons
from graspless_pin.geometry.hand.urdf_tree import (
    FREE_TYPES,
    add_prefix,
    check_name_lengths,
    fix_base,
    keep_below,
    root_of_tree,
)
from graspless_pin.geometry.hand.urdf_visuals import LinkVisual, let_visuals_collide, read_visuals
from graspless_pin.geometry.hand.xacro_call import run_xacro
from graspless_pin.geometry.robots.description import JointCoupling
from graspless_pin.intake.files import (
    FileKind,
    errors_of_text,
    is_file,
    kind_of_file,
    read_bytes,
    refuse_other_kind,
)
from graspless_pin.intake.text import parse_xml

_SECONDS = 60.0


def is_xacro(root: ET.Element) -> bool:
    """Return whether elements of a ``<robot>`` are xacro's."""
    return any(element.tag.startswith("xacro:") for element in root.iter())


def expanded(path: Path, package_dirs: Sequence[Path], arguments: Mapping[str, str]) -> bytes:
    """Return the URDF that a xacro file makes.

    Args:
        path: The file.
        package_dirs: Where ``$(find NAME)`` is looked up, as ``package://NAME`` is.
        arguments: Values of its ``<xacro:arg>``.

    Raises:
        RobotError: If xacrodoc is not installed, or the file cannot be expanded in a minute.
    """
    if importlib.util.find_spec("xacrodoc") is None:
        raise RobotError(
            f"{path} is a xacro file, which needs xacrodoc; install it with pip install "
            "'graspless-pin[xacro]', or expand it: xacro FILE > hand.urdf"
        )
    try:
        with ChildProcess() as child:
            text = child.call(
                run_xacro,
                str(path.resolve()),
                _packages(path, package_dirs),
                dict(arguments),
                limit=_SECONDS,
            )
    except ValueError as error:
        message = " ".join(str(error).split())
        hint = "; values of its <xacro:arg> go under xacro_args in a robot file"
        raise RobotError(f"{path}: xacro cannot expand this file ({message}){hint}") from None
    except OverrunError:
        raise RobotError(f"{path}: xacro did not expand this file in {_SECONDS:g} s") from None
    except CrashError as error:
        raise RobotError(f"{path}: xacro ended over this file ({error})") from None
    return text.encode()


def _packages(path: Path, package_dirs: Sequence[Path]) -> dict[str, str]:
    """Return folders by the names that packages have: those above the file, given ones, inside."""
    found = {folder.name: str(folder) for folder in reversed(path.resolve().parents)}
    for folder in (item.resolve() for item in package_dirs if item.is_dir()):
        inside = sorted(item for item in folder.iterdir() if item.is_dir())
        found |= {item.name: str(item) for item in (*inside, folder)}
    return found


def rotor_inertias(path: Path, root: ET.Element) -> dict[str, float]:
    """Return the inertia of each rotor at its joint: times the gear ratio squared.

    A transmission holds ``rotor_inertia`` (kg m^2, or kg) and ``gear_ratio`` as attributes called
    ``value``, with any prefix; without a gear ratio ``mechanicalReduction`` counts, else 1.

    Args:
        path: The URDF file.
        root: Its ``<robot>`` element.

    Returns:
        kg m^2 (kg for linear joints) by joint.

    Raises:
        RobotError: If a figure is no number, or an inertia negative.
    """
    rotors: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        where = f"{path}: transmission {transmission.get('name')!r}"
        texts = {
            element.tag.rpartition(":")[2]: element.get("value") or element.text or ""
            for element in transmission.iter()
        }
        joints = transmission.findall("joint")
        if "rotor_inertia" not in texts or len(joints) != 1:
            continue
        inertia = checked_number(where, "rotor_inertia", texts["rotor_inertia"])
        if inertia < 0.0:
            raise RobotError(f"{where} has the negative rotor_inertia {inertia:g} kg m^2")
        ratio = texts.get("gear_ratio", texts.get("mechanicalReduction", "1"))
        factor = checked_number(where, "gear_ratio", ratio)
        rotors[joints[0].get("name", "")] = inertia * factor**2
    return rotors


_SRDF = FileKind("SRDF", 16, RobotError)


def disabled_pairs(urdf: Path, prefix: str = "") -> frozenset[frozenset[str]]:
    """Return the pairs of links between which an SRDF disables collisions.

    The SRDF has the URDF's name and stands beside it, or in the folder ``srdf`` beside its folder.
    None of the answers about a hand but its overlaps depends on it: one that cannot be read is
    told, and left out.

    Args:
        urdf: The URDF's file.
        prefix: Put before the name of every link.

    Warns:
        GrasplessPinWarning: If it cannot be read.
    """
    own = f"{urdf.stem}.srdf"
    for file in (urdf.with_name(own), urdf.parent.parent / "srdf" / own):
        if is_file(file):
            break
    else:
        return frozenset()
    try:
        with errors_of_text(file, _SRDF):
            root = parse_xml(read_bytes(file, _SRDF))
    except RobotError as error:
        emit(
            Finding(
                FindingCode.READER_REMARK,
                urdf.stem,
                str(error),
                "until it can be read, the pairs of links that it disables count as overlaps",
            )
        )
        return frozenset()
    return frozenset(
        frozenset((prefix + one.get("link1", ""), prefix + one.get("link2", "")))
        for one in root.findall("disable_collisions")
    )


URDF = FileKind("URDF", 16, RobotError)

MOST_LINKS = 1000
"""More links than any robot has."""

UNBOUNDED = 1e30
"""Stands for ``inf`` in the text given to Pinocchio, whose parser rejects the word itself."""

MOVABLE_TYPES = ("revolute", "prismatic", "continuous")


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
        tendons: The tendons that motors of an MJCF pull.
        disabled_pairs: Pairs of links that may be in each other, as its SRDF says.
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
    tendons: Mapping[str, DrawnTendon] = field(default_factory=dict)
    disabled_pairs: frozenset[frozenset[str]] = frozenset()


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
    top = root_of_tree(path, root)
    if root_link is not None:
        keep_below(path, root, root_link)
        top = root_link
    mimics = [_check_joint(path, joint) for joint in root.findall("joint")]
    if visuals_collide:
        let_visuals_collide(root)
    fix_base(path, root, top)
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
    add_prefix(root, prefix)
    check_name_lengths(path, root)
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
        tendons=read_tendons(root, joints, prefix),
        disabled_pairs=disabled_pairs(path, prefix) if with_meshes else frozenset(),
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
        RobotError: If the file is missing, is none of them, declares a DOCTYPE or entities, or has
            too many links or too long a name; see `mjcf_robot` and `expanded`, too.
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
    check_name_lengths(path, root)
    return root


def _check_joint(path: Path, joint: ET.Element) -> JointCoupling | None:
    """Check one joint, rewrite unbounded limits and return its coupling, if it has one."""
    name, kind = joint.get("name", ""), joint.get("type")
    where = f"{path}: joint {name!r}"
    if kind not in (*MOVABLE_TYPES, *FREE_TYPES, "fixed"):
        raise RobotError(f"{where} has the unknown type {kind!r}")
    check_origin(where, joint)
    if kind in MOVABLE_TYPES:
        _check_axis(where, joint)
    limit = joint.find("limit")
    if limit is None and kind in ("revolute", "prismatic"):
        raise RobotError(f"{where} is {kind} and has no <limit lower upper effort velocity>")
    if limit is not None:
        _bound_limit(where, limit)
        low, high = (limit.get(key, "0") for key in ("lower", "upper"))
        if kind in ("revolute", "prismatic") and float(low) > float(high):
            raise RobotError(
                f"{where} has the lower limit {low} above the upper limit {high}, so that it can "
                "stand nowhere; exchange them"
            )
    follows: dict[str, float] = {}
    offset = 0.0
    for mimic in joint.findall("mimic"):  # several of what was an MJCF: their sum
        joint.remove(mimic)  # the coupling is applied by us, Pinocchio sees independent joints
        factor = checked_number(where, "mimic multiplier", mimic.get("multiplier", "1"))
        follows[mimic.get("joint", "")] = factor
        offset += checked_number(where, "mimic offset", mimic.get("offset", "0"))
    return JointCoupling(name, follows, offset) if follows and kind in MOVABLE_TYPES else None


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
