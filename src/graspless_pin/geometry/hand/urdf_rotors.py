"""Rotor inertias that the transmissions of a URDF state, as Drake writes them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from graspless_pin.errors import RobotError
from graspless_pin.geometry.hand.urdf_links import checked_number


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
