"""Keys in degrees: ``rpy_deg`` of poses and ``q_deg`` of hands, beside those in radians."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

IN_DEGREES = {"rpy_deg": "rpy", "q_deg": "q"}
"""What a key in degrees is called in radians."""


def in_radians(data: Any) -> Any:
    """Return a copy of a file's data without keys in degrees."""
    if isinstance(data, list):
        return [in_radians(item) for item in data]
    if not isinstance(data, dict):
        return data
    there = {name: in_radians(item) for name, item in data.items() if name not in IN_DEGREES}
    if data.get("rpy_deg") is not None:
        there["rpy"] = [math.radians(angle) for angle in data["rpy_deg"]]
    if data.get("q_deg"):
        there["q"] = merged_angles(data.get("q"), data["q_deg"])
    return there


def merged_angles(q: Mapping[str, float] | None, q_deg: Mapping[str, float]) -> dict[str, float]:
    """Return positions by joint from those in radians or metres and those in degrees."""
    return {**(q or {}), **{name: math.radians(angle) for name, angle in q_deg.items()}}


def parted_angles(
    q: Mapping[str, float], q_deg: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return positions in radians or metres, and in degrees those that ``q_deg`` has so.

    Degrees that mean what they meant keep their digits.
    """
    turned = {
        name: degrees if math.radians(degrees) == q[name] else degrees_of(q[name])
        for name, degrees in q_deg.items()
        if name in q
    }
    return {name: value for name, value in q.items() if name not in turned}, turned


def degrees_of(angle: float) -> float:
    """Return an angle (rad) in degrees, to the digits that a file shows."""
    return float(f"{math.degrees(angle):.13g}") + 0.0
