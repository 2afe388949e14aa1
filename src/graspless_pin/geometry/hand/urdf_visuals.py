"""Read what a URDF says about the looks of its links; only for drawing, so nothing here fails."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.geometry.bodies.shapes import SHAPES, Shape
from graspless_pin.geometry.hand.urdf_links import find_mesh, numbers
from graspless_pin.geometry.poses import pose_matrix


@dataclass(frozen=True, eq=False)
class LinkVisual:
    """One visual shape of a link.

    Attributes:
        link: Name of the link, with its prefix.
        shape: A primitive, or a mesh file.
        scale: Metres per unit of the file along x, y, z; 1 for a primitive.
        T_link_visual: (4, 4) pose in the link's frame.
    """

    link: str
    shape: Shape | Path
    scale: tuple[float, float, float]
    T_link_visual: NDArray[np.float64]


def let_visuals_collide(root: ET.Element) -> None:
    """Give each link without a collision shape its visual ones, in place.

    Args:
        root: The ``<robot>`` element.
    """
    for link in root.findall("link"):
        if link.find("collision") is None:
            for visual in link.findall("visual"):
                collision = ET.SubElement(link, "collision")
                collision.extend(deepcopy([*visual.findall("origin"), *visual.findall("geometry")]))


def read_visuals(
    path: Path, root: ET.Element, package_dirs: Sequence[Path]
) -> tuple[LinkVisual, ...]:
    """Read the visual shapes of all links, without their meshes.

    A link of which one shape is malformed or lacks its mesh has none: half a link would mislead
    more than its collision shapes do.

    Args:
        path: The URDF file.
        root: The ``<robot>`` element.
        package_dirs: Where ``package://`` addresses are looked up.
    """
    found: list[LinkVisual] = []
    for link in root.findall("link"):
        name = link.get("name", "")
        try:
            found += [_read(path, name, item, package_dirs) for item in link.findall("visual")]
        except (RobotError, ArgumentError):
            continue
    return tuple(found)


def _read(path: Path, link: str, visual: ET.Element, package_dirs: Sequence[Path]) -> LinkVisual:
    """Read one visual shape.

    Raises:
        RobotError: A number is malformed, or there is no usable shape.
        ArgumentError: A size is not positive.
    """
    where = f"{path}: visual of link {link!r}"
    origin = visual.find("origin")
    pose = {} if origin is None else origin.attrib
    T = pose_matrix(
        numbers(where, "origin xyz", pose.get("xyz", "0 0 0"), 3),
        numbers(where, "origin rpy", pose.get("rpy", "0 0 0"), 3),
    )
    element = visual.find("geometry/*")
    if element is None:
        raise RobotError(f"{where} has no shape")
    if element.tag == "mesh":
        file, _ = find_mesh(path, element.get("filename", ""), package_dirs)
        if file is None:
            raise RobotError(f"{where} has no mesh")
        x, y, z = numbers(where, "scale", element.get("scale", "1 1 1"), 3)
        if not (x and y and z):
            raise RobotError(f"{where} has a scale that is zero")
        return LinkVisual(link, file, (x, y, z), T)
    return LinkVisual(link, _primitive(where, element), (1.0, 1.0, 1.0), T)


def _primitive(where: str, element: ET.Element) -> Shape:
    if element.tag not in ("box", "sphere", "cylinder", "capsule"):
        raise RobotError(f"{where} has the unknown shape <{element.tag}>")
    shape = SHAPES[element.tag]
    sizes = (
        numbers(where, key, element.get(key, ""), count) for key, count in shape.lengths().items()
    )
    return shape(*(size[0] if len(size) == 1 else size for size in sizes))
