"""Units of what varies: what a scene key is measured in, and what a study may say instead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.scene.yaml_source import Location

ANY = ""
"""The kind of a key that has no unit."""


@dataclass(frozen=True)
class Unit:
    """A unit.

    Attributes:
        name: As it stands in a study file.
        kind: What it measures.
        factor: SI units in one of it.
    """

    name: str
    kind: str
    factor: float

    @property
    def suffix(self) -> str:
        """What follows the name in a column, e.g. ``_deg``; empty without a unit."""
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
    )
}

_SI = {unit.kind: unit for unit in reversed(UNITS.values()) if unit.factor == 1.0}

_KINDS = {
    "position": ("length",),
    "size": ("length",),
    "radius": ("length",),
    "length": ("length",),
    "center_of_mass": ("length",),
    "contact_tolerance": ("length",),
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
}


def kinds_of(location: Location) -> tuple[str, ...]:
    """Return what a scene key may be measured in: several kinds where the joint's type decides."""
    for part in reversed(location):
        if part in _KINDS:
            return _KINDS[str(part)]
        if part in ("friction", "materials"):
            break
    return (ANY,)


def si_unit(kind: str) -> Unit:
    """Return the SI unit of a kind."""
    return _SI[kind]
