"""Objects whose size or mass looks like another unit: millimetres, grams, g/cm^3."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.contact.broad_phase import solids_of
from graspless_pin.problem.checks import FloatArray

_DENSITIES = 1.0, 30_000.0  # kg/m^3; a balloon, more than osmium
_LARGEST = 5.0  # m, of what hands move


def unit_findings(made: ManipulatedObject, *, beside_hand: bool) -> Iterator[Finding]:
    """Find a density that no material has, and a size that no hand holds.

    Args:
        made: The object.
        beside_hand: Whether there is a hand.
    """
    low, high = box_around(made)
    size = high - low
    density = made.mass / made.shape.filling().volume
    if beside_hand and size.max() > _LARGEST:
        yield Finding(
            FindingCode.UNLIKELY_SIZE,
            made.name,
            f"object '{made.name}' is {_lengths(size)} m large, beside a hand",
            f"give lengths in metres: it looks like millimetres, {_lengths(1e-3 * size)} m?",
            ("object", "shape"),
        )
    if not _DENSITIES[0] <= density <= _DENSITIES[1]:
        heavy = density > _DENSITIES[1]
        yield Finding(
            FindingCode.UNLIKELY_DENSITY,
            made.name,
            f"object '{made.name}' has {density:.3g} kg/m^3, which is "
            + ("more than any metal has" if heavy else "less than air has"),
            f"give the mass in kilograms and lengths in metres{_meant(made, density, size)}",
            ("object", "mass"),
        )


def box_around(made: ManipulatedObject) -> tuple[FloatArray, FloatArray]:
    """Return the (3,) lowest and highest corner of the box around an object, its own axes, m."""
    solids = solids_of(made.shapes)
    low = (solids.centers - solids.half_extents).min(axis=0)
    return low, (solids.centers + solids.half_extents).max(axis=0)


def _meant(made: ManipulatedObject, density: float, size: FloatArray) -> str:
    """Return which other unit would make a density possible, and what it would be then."""
    said = {
        1e-3: f"the mass looks like grams, {1e-3 * made.mass:.3g} kg?",
        1e9: f"the size looks like millimetres, {_lengths(1e-3 * size)} m?",
        1e3: f"the density looks like g/cm^3, {1e3 * density:.3g} kg/m^3?",
        1e6: f"it looks like millimetres and grams, {_lengths(1e-3 * size)} m and "
        f"{1e-3 * made.mass:.3g} kg?",
    }
    for factor, words in said.items():
        if _DENSITIES[0] <= factor * density <= _DENSITIES[1]:
            return f": {words}"
    return ""


def _lengths(size: FloatArray) -> str:
    return " x ".join(f"{length:.3g}" for length in np.asarray(size).tolist())
