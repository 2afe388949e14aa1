"""Units of scene keys, and conversion of figures with a unit to SI."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin.geometry.bodies.shapes import SHAPES
from graspless_pin.intake.yaml_source import FIGURE, Location

ANY = ""
"""The kind of a key without a unit."""


@dataclass(frozen=True)
class Unit:
    """A unit.

    Attributes:
        name: Its name in study files.
        kind: The quantity that it measures.
        factor: Its size in SI units.
    """

    name: str
    kind: str
    factor: float

    @property
    def suffix(self) -> str:
        """Suffix of the name of a column, e.g. ``_deg``; empty without a unit."""
        return f"_{self.name.replace('^', '').replace('/', '_per_')}" if self.kind else ""


UNITS = {
    unit.name: unit
    for unit in (
        Unit("1", ANY, 1.0),
        Unit("m", "length", 1.0),
        Unit("cm", "length", 0.01),
        Unit("mm", "length", 0.001),
        Unit("rad", "angle", 1.0),
        Unit("deg", "angle", float(np.pi / 180.0)),
        Unit("kg", "mass", 1.0),
        Unit("g", "mass", 0.001),
        Unit("kg/m^3", "density", 1.0),
        Unit("N", "force", 1.0),
        Unit("Nm", "torque", 1.0),
        Unit("mNm", "torque", 0.001),
        Unit("m/s", "velocity", 1.0),
        Unit("mm/s", "velocity", 0.001),
        Unit("rad/s", "angular velocity", 1.0),
        Unit("deg/s", "angular velocity", float(np.pi / 180.0)),
        Unit("m/s^2", "acceleration", 1.0),
        Unit("rad/s^2", "angular acceleration", 1.0),
    )
}

SI_UNITS = {unit.kind: unit for unit in reversed(UNITS.values()) if unit.factor == 1.0}
"""The SI unit of each kind."""

_KINDS = {key: ("length",) for shape in SHAPES.values() for key in shape.lengths()} | {
    "position": ("length",),
    "center_of_mass": ("length",),
    "contact_tolerance": ("length",),
    "max_penetration": ("length",),
    "rpy": ("angle",),
    "mass": ("mass",),
    "density": ("density",),
    "gravity": ("acceleration",),
    "max_normal_force": ("force",),
    "hybrid_force_limit": ("force",),
    "margin": ("force",),
    "linear": ("velocity",),
    "angular": ("angular velocity",),
    "q": ("angle", "length"),
    "effort_limits": ("torque", "force"),
    "joint_velocities": ("angular velocity", "velocity"),
    "force": ("force",),
    "moment": ("torque",),
    "field": ("acceleration",),
    "at": ("length",),
    "point": ("length",),
    "tilt": ("angle",),
    "torque_offset": ("torque", "force"),
    "angular_velocity": ("angular velocity",),
    "joint_accelerations": ("angular acceleration", "acceleration"),
}
_OF_UNCERTAINTY = {
    "mass": (ANY,), "mass_offset": ("mass",), "torque": (ANY,),
    "center_of_mass_radius": ("length",), "force_radius": ("force",), "moment_radius": ("torque",),
    "contact_position": ("length",),
}  # fmt: skip
_OFFSETS = {"mass": "mass_offset", "torque": "torque_offset"}
"""Keys of absolute deviations (SI) by key of the relative one."""
_OF_ACCELERATIONS = {"linear": ("acceleration",), "angular": ("angular acceleration",)}


def kinds_of(location: Location) -> tuple[str, ...]:
    """Return the kinds of quantity of a scene key: several where the type of joint decides."""
    for part in reversed(location):
        if location[0] == "acceleration" and part in _OF_ACCELERATIONS:
            return _OF_ACCELERATIONS[str(part)]
        if location[0] == "uncertainty" and part in _OF_UNCERTAINTY:
            return _OF_UNCERTAINTY[str(part)]
        if part in _KINDS:
            return _KINDS[str(part)]
        if part in ("friction", "materials"):
            break
    return (ANY,)


def offset_key(location: Location, unit: Unit | None) -> str | None:
    """Return the key for an absolute deviation, if a key for a relative one is given such a unit.

    Args:
        location: The given key.
        unit: The unit of its value, such as kg.
    """
    key = _OFFSETS.get(str(location[1])) if location[0] == "uncertainty" and location[1:] else None
    if key is None or unit is None or unit.kind not in kinds_of(("uncertainty", key)):
        return None
    return key


_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
_SPELLINGS = {"°": "deg", "degrees": "deg", "degree": "deg", "meters": "m", "metres": "m"}
_FURTHER = {
    unit.name: unit
    for unit in (
        Unit("km", "length", 1e3),
        Unit("um", "length", 1e-6),
        Unit("in", "length", 0.0254),
        Unit("inch", "length", 0.0254),
        Unit("mg", "mass", 1e-6),
        Unit("lb", "mass", 0.45359237),
        Unit("g/cm^3", "density", 1e3),
        Unit("mN", "force", 1e-3),
        Unit("kN", "force", 1e3),
        Unit("Nmm", "torque", 1e-3),
        Unit("Ncm", "torque", 1e-2),
        Unit("%", ANY, 0.01),
    )
}


def si_advice(text: str, location: Location) -> str:
    """Return advice on what to write instead of a text that is a figure; empty for other texts.

    Args:
        text: The text at a key that takes one number or several.
        location: The key.
    """
    figure = FIGURE.fullmatch(text)
    if figure is None:
        return ""
    value, unit_text = float(figure[1].replace(",", ".")), figure[2]
    if _THOUSANDS.fullmatch(figure[1]):
        unit = f" {unit_text}" if unit_text else ""
        return f"; write {value * 1000.0:.12g}{unit} or {value:.12g}{unit}, without the comma"
    if location == ("gravity",) and unit_text is None:
        return f"; if z points up, write [0, 0, {0.0 - abs(value):.12g}]"
    if unit_text is None:  # with a decimal point it is a number
        return f"; write {value:.12g}" if "," in figure[1] else ""
    name = re.sub(r"[\s*·]", "", unit_text).replace("µ", "u").replace("²", "2").replace("³", "3")
    name = re.sub(r"(?<=[ms])(?=[23]$)", "^", name)
    name = _SPELLINGS.get(name, name)
    unit = UNITS.get(name) or _FURTHER.get(name)
    offset = offset_key(location, unit)
    if offset is not None and unit is not None:
        si = SI_UNITS[unit.kind].name
        return f"; in {si}, write {offset}: {value * unit.factor:.12g} instead"
    kinds = kinds_of(location)
    in_degrees = any(str(part).endswith("_deg") for part in location)
    if in_degrees:
        kinds = ("angle",)
    wanted = " or ".join("deg" if in_degrees else SI_UNITS[kind].name for kind in kinds if kind)
    if unit is None or (unit.kind not in kinds and kinds != (ANY,)):
        expected = wanted and f" ({wanted})"
        return f"; give the number without {unit_text!r}: units are SI{expected}"
    value *= unit.factor * (180.0 / np.pi if in_degrees else 1.0)
    si = "deg" if in_degrees else unit.kind and SI_UNITS[unit.kind].name
    named = f" ({si})" if si and si != name else ""
    return f"; write {value:.12g}{named}, without {unit_text!r}: units are SI"


IN_DEGREES = {"rpy_deg": "rpy", "q_deg": "q"}
"""Keys in radians by key in degrees."""


def in_radians(data: Any) -> Any:
    """Return a copy of a file's data with keys in degrees converted to radians."""
    if isinstance(data, list):
        return [in_radians(item) for item in data]
    if not isinstance(data, dict):
        return data
    converted = {name: in_radians(item) for name, item in data.items() if name not in IN_DEGREES}
    if data.get("rpy_deg") is not None:
        converted["rpy"] = [math.radians(angle) for angle in data["rpy_deg"]]
    if data.get("q_deg"):
        converted["q"] = merged_angles(data.get("q"), data["q_deg"])
    return converted


def merged_angles(q: Mapping[str, float] | None, q_deg: Mapping[str, float]) -> dict[str, float]:
    """Return positions by joint, rad or m, from those in rad or m and those in degrees."""
    return {**(q or {}), **{name: math.radians(angle) for name, angle in q_deg.items()}}


def parted_angles(
    q: Mapping[str, float], q_deg: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Split positions into those in rad or m, and those that ``q_deg`` has in degrees.

    Unchanged angles in degrees keep their digits.
    """
    angles = {
        name: degrees if math.radians(degrees) == q[name] else degrees_of(q[name])
        for name, degrees in q_deg.items()
        if name in q
    }
    return {name: value for name, value in q.items() if name not in angles}, angles


def degrees_of(angle: float) -> float:
    """Return an angle (rad) in degrees, rounded to the digits of files."""
    return rounded_angle(math.degrees(angle))


def rounded_angle(angle: float) -> float:
    """Return an angle rounded to the digits of files."""
    return float(f"{angle:.13g}") + 0.0
