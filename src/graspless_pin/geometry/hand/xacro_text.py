"""Expand a xacro file in a process of its own: it is a program, and may take for ever."""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import CrashError, OverrunError, RobotError
from graspless_pin.geometry.hand.xacro_call import run_xacro

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
        said = " ".join(str(error).split())
        hint = "; values of its <xacro:arg> go under xacro_args in a robot file"
        raise RobotError(f"{path}: xacro cannot expand this file ({said}){hint}") from None
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
