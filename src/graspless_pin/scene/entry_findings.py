"""Findings on a scene file that could not be made from the built scene any more."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Materials
from graspless_pin.geometry.contact.distances import solids_of
from graspless_pin.geometry.hand.robot_units import HIGHEST_DENSITY
from graspless_pin.geometry.poses import transformed
from graspless_pin.intake.yaml_source import Location
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.body_schema import PoseEntry
from graspless_pin.scene.scene_schema import SceneEntry

MOST_ANGLE = 2.0 * math.pi + 1e-9
"""Larger angles (rad) are probably in degrees."""
_SHARES = math.pi / 12.0 * np.array([2.0, 3.0, 4.0, 6.0, 8.0, 9.0, 10.0, 12.0, 18.0, 24.0])
"""Angles in degrees with one of these values are probably in radians."""
_ROUNDED = 1e-3  # rad
_IDENTITY_W_FIRST = [1.0, 0.0, 0.0, 0.0]
"""The identity in the order w, x, y, z; half a turn about x in ours."""


def entry_findings(entry: SceneEntry, table: Materials) -> Iterator[Finding]:
    """Find angles and quaternions in another convention, and materials without effect.

    Args:
        entry: Content of the file.
        table: Its table of materials.
    """
    for location, subject, pose in _pose_entries(entry):
        yield from _degree_findings(location, subject, pose)
        yield from _radian_findings(location, subject, pose)
        yield from _quaternion_findings(location, subject, pose)
    yield from _material_findings(entry, table)


def _pose_entries(entry: SceneEntry) -> Iterator[tuple[Location, str, PoseEntry]]:
    yield ("object", "pose"), entry.object.name, entry.object.pose
    for index, support in enumerate(entry.supports):
        yield ("supports", index, "pose"), support.name, support.pose
    if entry.hand is None:
        return
    yield ("hand", "base_pose"), "hand", entry.hand.base_pose
    for index, mount in enumerate(entry.hand.mounts):
        yield ("hand", "mounts", index, "base_pose"), mount.prefix, mount.base_pose


def _degree_findings(location: Location, subject: str, pose: PoseEntry) -> Iterator[Finding]:
    angles = pose.rpy or ()
    if any(abs(angle) > MOST_ANGLE for angle in angles):
        angle_list = ", ".join(f"{angle:g}" for angle in angles)
        large = [f"{angle:g}" for angle in angles if abs(angle) > MOST_ANGLE]
        radians = ", ".join(
            f"{math.radians(angle):.5g}" if abs(angle) > MOST_ANGLE else f"{angle:.10g}"
            for angle in angles
        )
        correction = f"[{angle_list}] degrees are [{radians}] rad"
        if len(large) < sum(map(bool, angles)):
            verb = "is" if len(large) == 1 else "are"
            correction = f"if {' and '.join(large)} alone {verb} in degrees, it is [{radians}] rad"
        yield Finding(
            FindingCode.ANGLE_IN_DEGREES,
            subject,
            f"the angles [{angle_list}] rad of '{subject}' are more than a turn",
            f"give angles in radians, or all of them under rpy_deg: {correction}",
            (*location, "rpy"),
        )


def _radian_findings(location: Location, subject: str, pose: PoseEntry) -> Iterator[Finding]:
    angles = pose.rpy_deg or ()
    nonzero = np.abs([angle for angle in angles if angle])
    if len(nonzero) and (np.abs(nonzero[:, None] - _SHARES).min(axis=1) <= _ROUNDED).all():
        angle_list = ", ".join(f"{angle:g}" for angle in angles)
        degrees = ", ".join(f"{math.degrees(angle):.4g}" for angle in angles)
        yield Finding(
            FindingCode.ANGLE_IN_RADIANS,
            subject,
            f"the angles [{angle_list}] degrees of '{subject}' look like radians",
            f"give them under rpy, or [{degrees}] under rpy_deg",
            (*location, "rpy_deg"),
        )


def _quaternion_findings(location: Location, subject: str, pose: PoseEntry) -> Iterator[Finding]:
    """Find half a turn about x of a body; hands are often mounted so."""
    entries = np.abs(pose.quaternion or ())
    if (
        location[0] != "hand"
        and entries.size
        and np.allclose(entries, _IDENTITY_W_FIRST, atol=1e-6)
    ):
        yield Finding(
            FindingCode.QUATERNION_ORDER,
            subject,
            f"the quaternion of '{subject}' is half a turn about x",
            "if no rotation is meant, give [0, 0, 0, 1]: the order is x, y, z, w",
            (*location, "quaternion"),
        )


def _material_findings(entry: SceneEntry, table: Materials) -> Iterator[Finding]:
    """Find probably misspelt names in the table, and a table of which no pair is used.

    Other unused pairs are fine, as scenes may share a table. So is a table in a scene without
    materials of bodies.
    """
    own, others = entry.object.material, other_materials(entry)
    used = {name for name in (own, *others) if name is not None}
    for name, likely_name in table.misspelt(used).items():
        pair = next((a, b) for a, row in entry.materials.items() for b in row if name in (a, b))
        yield Finding(
            FindingCode.MISSPELT_MATERIAL,
            name,
            f"no body has the material {name!r}",
            f"did you mean {likely_name!r}?",
            ("materials", *pair),
        )
    if used and not any(frozenset((own, other)) in table.coefficients for other in others):
        yield Finding(
            FindingCode.UNUSED_MATERIALS,
            "materials",
            f"no pair of materials has an effect, as {materials_in_words(own, others)}",
            "add the pair of these materials, or the missing key 'material' of a body",
            ("materials",),
        )


def other_materials(entry: SceneEntry) -> tuple[str | None, ...]:
    """Return the materials of hand and supports; None for one that is not given."""
    hand = () if entry.hand is None else (entry.hand.material,)
    return (*hand, *(support.material for support in entry.supports))


def materials_in_words(own: str | None, others: Iterable[str | None]) -> str:
    """Return, for messages, which materials the object and the other bodies have."""
    names = sorted({repr(name) for name in others if name is not None})
    return (
        f"the object is of {'no material' if own is None else repr(own)}, hand and supports are of "
        f"{', '.join(names) or 'no material'}"
    )


_POSSIBLE_DENSITIES = 1.0, HIGHEST_DENSITY  # kg/m^3; the first is that of a balloon
LARGEST_OBJECT = 5.0
"""Size above which an object beside a hand is doubtful, m."""
_USUAL_OBJECT = 0.1  # m, of most objects
_LARGEST_TOLERANCE = 0.1
"""Relative to the object's smallest extent."""


def unit_findings(target: ManipulatedObject, *, beside_hand: bool) -> Iterator[Finding]:
    """Find an impossible density, a size too large for a hand, and an impossible inertia.

    Args:
        target: The object.
        beside_hand: Whether the scene has a hand.
    """
    low, high = box_around(target)
    size = high - low
    density = target.mass / target.shape.filling().volume
    if beside_hand and size.max() > LARGEST_OBJECT:
        yield Finding(
            FindingCode.UNLIKELY_SIZE,
            target.name,
            f"object '{target.name}' is {_size_text(size)} m large, which is unlikely for a hand",
            f"give lengths in metres: it looks like {_size_guess(size)}?",
            ("object", "shape"),
        )
    if not _POSSIBLE_DENSITIES[0] <= density <= _POSSIBLE_DENSITIES[1]:
        is_heavy = density > _POSSIBLE_DENSITIES[1]
        yield Finding(
            FindingCode.UNLIKELY_DENSITY,
            target.name,
            f"object '{target.name}' has {density:.3g} kg/m^3, which is "
            + ("more than any metal" if is_heavy else "less than air"),
            f"give the mass in kilograms and lengths in metres{_unit_guess(target, density, size)}",
            ("object", "mass"),
        )

    if target.inertia is not None:
        moment = float(np.linalg.eigvalsh(target.inertia)[2])
        largest = target.mass * object_radius_bound(target) ** 2
        if moment > largest:
            yield Finding(
                FindingCode.UNLIKELY_INERTIA,
                target.name,
                f"the inertia of object '{target.name}' has a moment of {moment:.3g} kg m^2, but "
                f"{target.mass:g} kg inside its shape have at most {largest:.3g} kg m^2",
                "give it about the centre of mass in kg m^2 (1 g mm^2 is 1e-9 kg m^2), or leave "
                "it out: it then follows from shape and mass",
                ("object", "inertia"),
            )


def tolerance_findings(
    target: ManipulatedObject, tolerances: Mapping[str, float]
) -> Iterator[Finding]:
    """Find contact tolerances that are not small against the object; defaults are accepted.

    Args:
        target: The object.
        tolerances: Lengths by key of the scene, m.
    """
    low, high = box_around(target)
    smallest = float((high - low).min())
    for key, length in tolerances.items():
        is_given = length != SceneEntry.model_fields[key].default
        if is_given and length > _LARGEST_TOLERANCE * smallest:
            yield Finding(
                FindingCode.UNLIKELY_SIZE,
                target.name,
                f"{key} is {length:g} m, but the smallest extent of object '{target.name}' is "
                f"{smallest:.3g} m",
                f"give it in metres: {length:g} mm are {1e-3 * length:g} m",
                (key,),
            )


def box_around(target: ManipulatedObject) -> tuple[FloatArray, FloatArray]:
    """Return the (3,) lowest and highest corner of the box around an object, its own axes, m."""
    solids = solids_of(target.shapes)
    low = (solids.centers - solids.half_extents).min(axis=0)
    return low, (solids.centers + solids.half_extents).max(axis=0)


def object_radius_bound(target: ManipulatedObject) -> float:
    """Return a bound on the distance of the object's points from its centre of mass, m."""
    pieces, center = target.placed_bodies, target.center_of_mass_world
    solids = solids_of(pieces.shapes)
    return max(
        float(np.linalg.norm(transformed(T, piece_center) - center) + reach)
        for T, piece_center, reach in zip(pieces.poses, solids.centers, solids.reaches, strict=True)
    )


def _unit_guess(target: ManipulatedObject, density: float, size: FloatArray) -> str:
    """Return, for messages, the unit of mass or length that would make a density possible."""
    words_by_factor = {
        1e-3: f"the mass looks like grams, {1e-3 * target.mass:.3g} kg?",
        1e9: f"the size looks like millimetres, {_size_text(1e-3 * size)} m?",
        1e3: f"the density looks like g/cm^3, {1e3 * density:.3g} kg/m^3?",
        1e6: f"it looks like centimetres, {_size_text(1e-2 * size)} m, or millimetres and grams, "
        f"{_size_text(1e-3 * size)} m and {1e-3 * target.mass:.3g} kg?",
    }
    for factor, words in words_by_factor.items():
        if _POSSIBLE_DENSITIES[0] <= factor * density <= _POSSIBLE_DENSITIES[1]:
            return f": {words}"
    return ""


def likely_lengths(lengths: FloatArray, longest: FloatArray) -> str:
    """Return, for messages, lengths in metres if they were given in mm or cm by mistake.

    Args:
        lengths: (3,) the stated lengths, m.
        longest: (3,) largest plausible lengths, m.
    """
    units = {"centimetres": 1e-2, "millimetres": 1e-3}
    fitting = [
        f"{unit} are [{', '.join(f'{length:.3g}' for length in (factor * lengths).tolist())}] m"
        for unit, factor in units.items()
        if (np.abs(factor * lengths) <= longest).all()
    ]
    return f": {', '.join(fitting)}" if fitting else ""


def _size_guess(size: FloatArray) -> str:
    """Return, for messages, a size read in mm and in cm, the likelier unit first."""
    units = {"millimetres": 1e-3, "centimetres": 1e-2}
    likely = sorted(
        units.items(), key=lambda unit: abs(math.log(unit[1] * size.max() / _USUAL_OBJECT))
    )
    return ", or ".join(f"{unit}, {_size_text(factor * size)} m" for unit, factor in likely)


def _size_text(size: FloatArray) -> str:
    return " x ".join(f"{length:.3g}" for length in np.asarray(size).tolist())
