"""Read a robot: a URDF, a xacro file or an MJCF, with the SRDF that stands beside it.

Files are inert data: XML's entities are refused, and a xacro file, which is a program, is expanded
in a process of its own. Why no other parser of URDFs is used: see docs/evidence/urdf.md.
"""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import CrashError, OverrunError, RobotError
from graspless_pin.geometry.hand.robot_model import (
    RobotModel,
    check_link_count,
    check_name_lengths,
)
from graspless_pin.geometry.hand.srdf import with_srdf
from graspless_pin.geometry.hand.urdf import robot_of_urdf
from graspless_pin.geometry.hand.xacro_call import run_xacro
from graspless_pin.intake.files import (
    FileKind,
    errors_of_text,
    kind_of_file,
    read_bytes,
    refuse_other_kind,
)
from graspless_pin.intake.text import parse_xml

URDF = FileKind("URDF", 16, RobotError)

_OTHER_XML = ("XML file", "SDF file", "MuJoCo model", "xacro file")
_SECONDS = 60.0


def read_robot(
    path: Path,
    *,
    prefix: str = "",
    package_dirs: Sequence[Path] = (),
    root_link: str | None = None,
    xacro_args: Mapping[str, str] = MappingProxyType({}),
    visuals_collide: bool = False,
    with_shapes: bool = True,
    srdf: Path | None = None,
) -> RobotModel:
    """Read and check one URDF, xacro or MJCF file.

    A floating or planar joint below the root link carries the whole robot; it is fixed at zero,
    because a hand stands where it is mounted.

    Args:
        path: The file. Relative mesh paths in it are relative to its folder.
        prefix: Put before the name of every link, joint and tendon.
        package_dirs: Where ``package://NAME/...`` is looked up: a folder that is called NAME or
            one that holds a folder called NAME. The folders above the file are tried last.
        root_link: Keep only this link and what hangs on it, e.g. the hand of a whole robot. Faults
            of other links and joints of a URDF do no harm then.
        xacro_args: Values of the ``<xacro:arg>`` of a xacro file.
        visuals_collide: Whether links without collision shapes collide with their visual ones.
        with_shapes: Whether the shapes of the links are read.
        srdf: Its SRDF; None: the one beside it, if there is one.

    Returns:
        The robot. Its meshes are not read yet, and may be missing.

    Raises:
        RobotError: If the file is missing, is no URDF or MJCF, declares a DOCTYPE or entities,
            repeats a name, lacks ``root_link``, or has a malformed link, joint or rotor or a joint
            of an unsupported type.
    """
    element = _element(path, package_dirs, xacro_args)
    named = {one.get("name", "") for one in element.iter()}
    if element.tag == "mujoco":
        from graspless_pin.geometry.hand.mjcf import robot_of_mjcf

        robot = robot_of_mjcf(path, visuals_collide=visuals_collide, with_shapes=with_shapes)
        named |= {one.name for part in (robot.links, robot.joints) for one in part}
        robot = robot if root_link is None else robot.below(root_link)
    else:
        robot = robot_of_urdf(
            path,
            element,
            package_dirs,
            root_link,
            visuals_collide=visuals_collide,
            with_shapes=with_shapes,
        )
    return with_srdf(robot.with_fixed_base(), path, srdf, named).prefixed(prefix)


def _element(path: Path, package_dirs: Sequence[Path], xacro_args: Mapping[str, str]) -> ET.Element:
    """Return the ``<robot>`` of a URDF or an expanded xacro file, or the ``<mujoco>`` of an MJCF.

    Raises:
        RobotError: If the file is missing, is none of them, declares a DOCTYPE or entities, or has
            too many links or too long a name, or if xacro cannot expand it.
    """
    content = read_bytes(path, URDF)
    found = kind_of_file(path, content)
    refuse_other_kind(path, URDF, None if found in _OTHER_XML else found)
    with errors_of_text(path, URDF):
        root = parse_xml(content)
        if path.suffix == ".xacro" or any(one.tag.startswith("xacro:") for one in root.iter()):
            root = parse_xml(_expanded(path, package_dirs, xacro_args))
    if root.tag == "sdf":
        raise RobotError(
            f"{path}: is an SDF, which is not read; write it as a URDF or as an MJCF, e.g. with "
            "sdformat2mjcf of the package sdformat-mjcf"
        )
    if root.tag not in ("robot", "mujoco"):
        raise RobotError(
            f"{path}: a URDF starts with <robot> and an MJCF with <mujoco>, this file with "
            f"<{root.tag}>"
        )
    check_link_count(str(path), len(root.findall("link")))
    for kind in ("link", "joint"):
        check_name_lengths(str(path), kind, (one.get("name", "") for one in root.findall(kind)))
    return root


def _expanded(path: Path, package_dirs: Sequence[Path], arguments: Mapping[str, str]) -> bytes:
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
