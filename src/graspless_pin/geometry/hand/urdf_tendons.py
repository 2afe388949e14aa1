"""Tendons that motors pull over several joints: what an MJCF says of them, beside its URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from typing import NamedTuple


class DrawnTendon(NamedTuple):
    """A tendon.

    Attributes:
        arms: Torque per newton of tension by joint, m.
        lower: Lowest tension, N.
        upper: Highest tension, N.
    """

    arms: Mapping[str, float]
    lower: float
    upper: float


def write_tendon(root: ET.Element, name: str, tendon: DrawnTendon) -> None:
    """Add a tendon to a ``<robot>``."""
    ends = {"lower": repr(tendon.lower), "upper": repr(tendon.upper)}
    element = ET.SubElement(root, "tendon", name=name, attrib=ends)
    for joint, arm in tendon.arms.items():
        ET.SubElement(element, "joint", name=joint, arm=repr(arm))


def read_tendons(
    root: ET.Element, joints: Collection[str], prefix: str = ""
) -> dict[str, DrawnTendon]:
    """Return the tendons of a ``<robot>`` by name, as `write_tendon` has added them.

    Args:
        root: The element.
        joints: Joints that are there; a tendon over others, too, is left out.
        prefix: Put before the names of tendons and joints.
    """
    found: dict[str, DrawnTendon] = {}
    for element in root.findall("tendon"):
        own = {item.get("name", ""): float(item.get("arm", "0")) for item in element}
        if all(joint in joints for joint in own):
            arms = {prefix + joint: arm for joint, arm in own.items()}
            ends = (float(element.get(key, "inf")) for key in ("lower", "upper"))
            found[prefix + element.get("name", "")] = DrawnTendon(arms, *ends)
    return found
