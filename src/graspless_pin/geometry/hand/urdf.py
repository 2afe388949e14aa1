"""The `RobotModel` of a URDF: each number is checked when it is read.

Pinocchio's own parser is not used: it reports errors on standard error only, omits malformed shapes
and capsules, opens the files that the URDF names, and crashes on some broken meshes.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from graspless_pin.bounds import LARGEST_LENGTH
from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.bodies.shapes import SHAPES
from graspless_pin.geometry.hand.robot_model import (
    FREE_KINDS,
    MOVABLE_KINDS,
    LinkMesh,
    LinkShape,
    RobotJoint,
    RobotLink,
    RobotModel,
    links_below,
    parsed_limit,
    root_of_tree,
)
from graspless_pin.geometry.hand.robot_units import summary_finding
from graspless_pin.geometry.poses import rigid, rotation_matrix
from graspless_pin.geometry.robots.description import JointCoupling, RobotDescription
from graspless_pin.intake.files import is_file
from graspless_pin.problem.checks import FloatArray
from graspless_pin.suggestions import names_in_words

_PRIMITIVES = ("box", "sphere", "cylinder", "capsule")
_LARGEST_ANGLE = 6.3
"""A full turn, rounded up, rad; larger angles are taken for degrees."""


def robot_of_urdf(
    described: RobotDescription, root: ET.Element, *, with_shapes: bool = True
) -> RobotModel:
    """Return the robot that a URDF describes, or the subtree of the description's root link.

    Args:
        described: The description of the robot. Relative mesh paths are relative to the file's
            folder.
        root: The file's ``<robot>`` element.
        with_shapes: Whether the shapes of the links are read.

    Raises:
        RobotError: If its links form no tree or lack the root link, or a link, joint, shape or
            rotor of the subtree is malformed.

    Warns:
        GrasplessPinWarning: A collision shape of size zero is left out. Angles exceed a full turn,
            or masses have no inertia.
    """
    path, root_link = described.urdf_path, described.root_link
    links, joints = root.findall("link"), root.findall("joint")
    ends = [(_end_link(joint, "parent"), _end_link(joint, "child")) for joint in joints]
    names = [link.get("name", "") for link in links]
    root_name = root_of_tree(str(path), names, [joint.get("name", "") for joint in joints], ends)
    if root_link is not None:
        root_name, kept = root_link, links_below(str(path), names, ends, root_link)
        links = [link for link in links if link.get("name") in kept]
        joints = [joint for joint, (parent, _) in zip(joints, ends, strict=True) if parent in kept]
    kept_joints = {joint.get("name", "") for joint in joints}
    rotors = _rotor_inertias(path, root, kept_joints)
    robot_joints = tuple(_robot_joint(path, joint, rotors) for joint in joints)
    robot_links = tuple(_robot_link(described, link, with_shapes=with_shapes) for link in links)
    if with_shapes:
        emit(*_doubtful_units(str(path), links, joints))
    return RobotModel(str(path), root_name, robot_links, robot_joints)


def _doubtful_units(
    label: str, links: Sequence[ET.Element], joints: Sequence[ET.Element]
) -> Iterator[Finding]:
    """Find angles in degrees, and masses without an inertia if other links have one.

    Args:
        label: The file.
        links: The links of the subtree, whose numbers have been read.
        joints: The joints of the subtree, likewise.
    """
    large_angles = []
    for item in (*links, *joints):
        for origin in item.iter("origin"):
            angles = [float(word) for word in origin.get("rpy", "0").split()]
            if max(map(abs, angles)) > _LARGEST_ANGLE:
                given = ", ".join(f"{angle:g}" for angle in angles)
                radians = ", ".join(f"{math.radians(angle):.5g}" for angle in angles)
                large_angles.append((
                    f"the angles [{given}] rad of {item.tag} {item.get('name')!r} are more than a "
                    "turn",
                    f"give angles in radians: [{given}] degrees are [{radians}] rad",
                ))  # fmt: skip
    yield from summary_finding(FindingCode.ANGLE_IN_DEGREES, label, "such angles", large_angles)
    with_inertia = [link for link in links if link.find("inertial/inertia") is not None]
    without_inertia = [
        (
            f"link {link.get('name')!r} has a mass but no <inertia>, which other links have",
            "add it, in kg m^2; without it, the link counts as a point mass",
        )
        for link in links
        if with_inertia and link.find("inertial/mass") is not None and link not in with_inertia
    ]
    yield from summary_finding(FindingCode.UNLIKELY_INERTIA, label, "such links", without_inertia)


def _end_link(joint: ET.Element, end: str) -> str:
    """Return the link at one end of a joint."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _robot_joint(path: Path, joint: ET.Element, rotors: Mapping[str, float]) -> RobotJoint:
    """Read one joint."""
    name, kind = joint.get("name", ""), joint.get("type", "")
    where = f"{path}: joint {name!r}"
    kinds = (*MOVABLE_KINDS, *FREE_KINDS, "fixed")
    if kind not in kinds:
        raise RobotError(f"{where} has the unknown type {kind!r}; {names_in_words(kind, kinds)}")
    T, axis = _origin_pose(where, joint), np.array([1.0, 0.0, 0.0])
    element = joint.find("axis")
    if kind in MOVABLE_KINDS and element is not None:
        axis = np.array(_parsed_numbers(where, "axis xyz", element.get("xyz", "1 0 0"), 3))
        if not axis.any():
            raise RobotError(
                f"{where} has the axis {element.get('xyz')!r}; give one that is not zero"
            )
    lower, upper, effort, velocity = _joint_limits(where, kind, joint.find("limit"))
    follows: dict[str, float] = {}
    offset = 0.0
    for mimic in joint.findall("mimic"):
        factor = _parsed_number(where, "mimic multiplier", mimic.get("multiplier", "1"))
        follows[mimic.get("joint", "")] = factor
        offset += _parsed_number(where, "mimic offset", mimic.get("offset", "0"))
    return RobotJoint(
        name, kind, _end_link(joint, "parent"), _end_link(joint, "child"), T, axis, lower, upper,
        effort, velocity, rotors.get(name, 0.0),
        JointCoupling(name, follows, offset) if follows else None,
    )  # fmt: skip


def _joint_limits(
    where: str, kind: str, limit: ET.Element | None
) -> tuple[float, float, float, float]:
    """Return lowest and highest position, effort and velocity; infinite if not limited."""
    is_limited = kind in ("revolute", "prismatic")
    if limit is None:
        if is_limited:
            raise RobotError(f"{where} is {kind} but has no <limit lower upper effort velocity>")
        return -np.inf, np.inf, np.inf, np.inf
    limits = {"lower": 0.0, "upper": 0.0, "effort": np.inf, "velocity": 0.0} | {
        key: _parsed_number(where, f"limit {key}", text, unlimited=True)
        for key, text in limit.attrib.items()
    }
    for key in ("effort", "velocity") if kind in MOVABLE_KINDS else ():
        if limits[key] < 0.0:
            raise RobotError(
                f"{where} has the limit {key}={limit.get(key)!r}, which is negative; give the "
                "largest absolute value, or leave it out"
            )
    # Files without a velocity limit state a velocity of 0.
    largest = parsed_limit(limits["effort"]), parsed_limit(limits["velocity"]) or np.inf
    if not is_limited:
        return -np.inf, np.inf, *largest
    if limits["lower"] > limits["upper"]:
        low, high = (limit.get(key, "0") for key in ("lower", "upper"))
        raise RobotError(
            f"{where} has the lower limit {low} above the upper limit {high}; correct "
            "or exchange them"
        )
    return parsed_limit(limits["lower"]), parsed_limit(limits["upper"]), *largest


def _rotor_inertias(path: Path, root: ET.Element, joints: Collection[str]) -> dict[str, float]:
    """Return the rotor inertias reflected to the joints: times the gear ratio squared.

    A transmission has the elements ``rotor_inertia`` (kg m^2, or kg) and ``gear_ratio``, with any
    prefix and an attribute ``value``; the default ratio is ``mechanicalReduction``, else 1.

    Args:
        path: The URDF file.
        root: Its ``<robot>`` element.
        joints: The joints whose rotors are read.

    Returns:
        kg m^2 (kg for prismatic joints) by joint.

    Raises:
        RobotError: If a value is not a number, or an inertia is negative.
    """
    rotors: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        where = f"{path}: transmission {transmission.get('name')!r}"
        texts = {
            element.tag.rpartition(":")[2]: element.get("value") or element.text or ""
            for element in transmission.iter()
        }
        driven = [joint.get("name", "") for joint in transmission.findall("joint")]
        if "rotor_inertia" not in texts or len(driven) != 1 or driven[0] not in joints:
            continue
        inertia = _parsed_number(where, "rotor_inertia", texts["rotor_inertia"])
        if inertia < 0.0:
            raise RobotError(f"{where} has the negative rotor_inertia {inertia:g} kg m^2")
        ratio = texts.get("gear_ratio", texts.get("mechanicalReduction", "1"))
        gear_ratio = _parsed_number(where, "gear_ratio", ratio)
        rotors[driven[0]] = inertia * gear_ratio**2
    return rotors


def _robot_link(described: RobotDescription, link: ET.Element, *, with_shapes: bool) -> RobotLink:
    """Read one link."""
    name = link.get("name", "")
    where = f"{described.urdf_path}: link {name!r}"
    of_collisions, of_visuals = (
        link.findall(use) if with_shapes else [] for use in ("collision", "visual")
    )
    if described.visuals_collide and not of_collisions:
        of_collisions = of_visuals
    collisions = [
        _link_shape(described, where, item, leave_out_empty=True) for item in of_collisions
    ]
    try:
        visuals = [
            _link_shape(described, where, item, leave_out_empty=False) for item in of_visuals
        ]
    except RobotError:  # for drawing only: a partly drawn link would mislead
        visuals = []
    shapes = (tuple(filter(None, found)) for found in (collisions, visuals))
    return RobotLink(name, *_mass_properties(where, link), *shapes)


def _mass_properties(where: str, link: ET.Element) -> tuple[float, FloatArray, FloatArray]:
    """Return mass, centre of mass and inertia about it, link axes; zeros without <inertial>."""
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    T = _origin_pose(where, inertial)
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    text = "" if mass is None else mass.get("value", "")
    mass_value = _parsed_number(where, "mass", text)
    if mass_value < 0.0:
        raise RobotError(f"{where} has the negative mass {text} kg")
    attributes = {} if inertia is None else inertia.attrib
    xx, xy, xz, yy, yz, zz = (
        _parsed_number(where, f"inertia {key}", attributes.get(key, "0"))
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    R, inertia_matrix = T[:3, :3], np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return mass_value, T[:3, 3].copy(), R @ inertia_matrix @ R.T


def _link_shape(
    described: RobotDescription, where: str, element: ET.Element, *, leave_out_empty: bool
) -> LinkShape | None:
    """Read one shape; None: its size is zero, and it is left out.

    Raises:
        RobotError: If it is malformed.
    """
    T, shape = _origin_pose(where, element), element.find("geometry/*")
    if shape is None:
        raise RobotError(f"{where} has a <{element.tag}> without a shape in its <geometry>")
    if shape.tag == "mesh":
        x, y, z = _parsed_numbers(where, "mesh scale", shape.get("scale", "1 1 1"), 3)
        if not (x and y and z):
            raise RobotError(
                f"{where} has the mesh scale {shape.get('scale')!r}; no factor may be 0"
            )
        written = shape.get("filename", "")
        candidates = tuple(_candidate_paths(described.urdf_path, written, described.package_dirs))
        file = next((path.resolve() for path in candidates if is_file(path)), None)
        return LinkShape(LinkMesh(written, file, candidates, (x, y, z)), T)
    if shape.tag not in _PRIMITIVES:
        known_shapes = ", ".join((*_PRIMITIVES, "mesh"))
        raise RobotError(f"{where} has the unknown shape <{shape.tag}>; known: {known_shapes}")
    kind = SHAPES[shape.tag]
    sizes = []
    for key, count in kind.lengths().items():
        quantity = f"{shape.tag} {key}"
        size = _parsed_numbers(where, quantity, shape.get(key, ""), count)
        if min(size) < 0.0:
            raise RobotError(f"{where} has {quantity}={shape.get(key)!r}, which is negative")
        if min(size) == 0.0 and leave_out_empty:
            emit(
                Finding(
                    FindingCode.EMPTY_SHAPE,
                    where.partition(": ")[2].replace("'", ""),
                    f"{where} has a {shape.tag} of {key} {shape.get(key, '')}, which is left out: "
                    "nothing touches it",
                    "give it a size if the link may touch the object",
                    ("hand",),
                )
            )
            return None
        sizes.append(size[0] if count == 1 else tuple(size))
    try:
        return LinkShape(kind(*sizes), T)
    except ArgumentError as error:
        raise RobotError(f"{where} has an impossible {kind.kind}: {error}") from error


def _origin_pose(where: str, element: ET.Element) -> FloatArray:
    """Return the (4, 4) pose that the ``<origin>`` of a joint, shape or inertial states."""
    origin = element.find("origin")
    attributes = {} if origin is None else origin.attrib
    quantity = f"{element.tag} origin"
    position = _parsed_numbers(where, f"{quantity} xyz", attributes.get("xyz", "0 0 0"), 3)
    angles = _parsed_numbers(where, f"{quantity} rpy", attributes.get("rpy", "0 0 0"), 3)
    return rigid(position, rotation_matrix(np.array(angles)))


def _parsed_number(where: str, quantity: str, text: str, *, unlimited: bool = False) -> float:
    """Parse one number; see `_parsed_numbers`."""
    return _parsed_numbers(where, quantity, text, 1, unlimited=unlimited)[0]


def _parsed_numbers(
    where: str, quantity: str, text: str, count: int, *, unlimited: bool = False
) -> list[float]:
    """Parse ``count`` numbers, none of them NaN and, unless ``unlimited``, all within ±1e12."""
    try:
        values = [] if "_" in text else [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or any(value != value for value in values):
        needed = "a number" if count == 1 else f"{count} numbers"
        raise RobotError(f"{where} has {quantity}={text!r}, which is not {needed}")
    if not unlimited and any(abs(value) > LARGEST_LENGTH for value in values):
        raise RobotError(f"{where} has {quantity}={text!r}; it must be within ±{LARGEST_LENGTH:g}")
    return values


def _candidate_paths(path: Path, written: str, package_dirs: Sequence[Path]) -> Iterable[Path]:
    """Yield the paths that a mesh's ``filename`` may denote, the likeliest first."""
    scheme, separator, address = written.partition("://")
    if not separator:
        if written:
            yield path.parent / written
    elif scheme == "file":
        yield Path(address)
    else:
        package, _, inside = address.partition("/")
        for folder in package_dirs:
            yield folder / package / inside
            if folder.name == package:
                yield folder / inside
        parents = path.resolve().parents
        yield from (folder / inside for folder in parents if folder.name == package)
        yield from (folder / package / inside for folder in parents)
