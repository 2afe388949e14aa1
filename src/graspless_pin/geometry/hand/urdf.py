"""The record of a robot from a URDF: each figure is checked where it is read.

Pinocchio's own parser is not used: it reports mistakes on standard error only, leaves malformed
shapes and capsules out, opens what files name and crashes on some meshes that are broken.
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
    limit_of,
    links_below,
    root_of_tree,
)
from graspless_pin.geometry.hand.robot_units import gathered
from graspless_pin.geometry.poses import rigid, rotation_matrix
from graspless_pin.geometry.robots.description import JointCoupling, RobotDescription
from graspless_pin.intake.files import is_file
from graspless_pin.problem.checks import FloatArray
from graspless_pin.suggestions import names_in_words

_PRIMITIVES = ("box", "sphere", "cylinder", "capsule")
_MOST_ANGLE = 6.3
"""A turn as files round it, rad; larger angles are taken for degrees."""


def robot_of_urdf(
    described: RobotDescription, root: ET.Element, *, with_shapes: bool = True
) -> RobotModel:
    """Return the robot that a URDF describes, or what hangs on the root link of its description.

    Args:
        described: The robot. Relative mesh paths in its file are relative to the file's folder.
        root: The file's ``<robot>`` element.
        with_shapes: Whether the shapes of the links are read.

    Raises:
        RobotError: If its links form no tree or lack the root link, or a link, joint, shape or
            rotor that is kept is malformed.

    Warns:
        GrasplessPinWarning: A collision shape of size zero is left out. Angles are more than a
            turn, or masses have no inertia.
    """
    path, root_link = described.urdf_path, described.root_link
    links, joints = root.findall("link"), root.findall("joint")
    ends = [(_end(joint, "parent"), _end(joint, "child")) for joint in joints]
    names = [link.get("name", "") for link in links]
    top = root_of_tree(str(path), names, [joint.get("name", "") for joint in joints], ends)
    if root_link is not None:
        top, kept = root_link, links_below(str(path), names, ends, root_link)
        links = [link for link in links if link.get("name") in kept]
        joints = [joint for joint, (parent, _) in zip(joints, ends, strict=True) if parent in kept]
    kept_joints = {joint.get("name", "") for joint in joints}
    rotors = _rotor_inertias(path, root, kept_joints)
    of_joints = tuple(_joint(path, joint, rotors) for joint in joints)
    of_links = tuple(_link(described, link, with_shapes=with_shapes) for link in links)
    if with_shapes:
        emit(*_doubtful(str(path), links, joints))
    return RobotModel(str(path), top, of_links, of_joints)


def _doubtful(
    label: str, links: Sequence[ET.Element], joints: Sequence[ET.Element]
) -> Iterator[Finding]:
    """Find angles in degrees, and masses without an inertia beside others that have one.

    Args:
        label: The file.
        links: Those that are kept, whose figures have been read.
        joints: Likewise.
    """
    turned = []
    for one in (*links, *joints):
        for origin in one.iter("origin"):
            angles = [float(word) for word in origin.get("rpy", "0").split()]
            if max(map(abs, angles)) > _MOST_ANGLE:
                given = ", ".join(f"{angle:g}" for angle in angles)
                radians = ", ".join(f"{math.radians(angle):.5g}" for angle in angles)
                turned.append((
                    f"the angles [{given}] rad of {one.tag} {one.get('name')!r} are more than a "
                    "turn",
                    f"give angles in radians: [{given}] degrees are [{radians}] rad",
                ))  # fmt: skip
    yield from gathered(FindingCode.ANGLE_IN_DEGREES, label, "such angles", turned)
    stated = [link for link in links if link.find("inertial/inertia") is not None]
    lacking = [
        (
            f"link {link.get('name')!r} has a mass and no <inertia>, and others have one",
            "add it, kg m^2: where the link turns, it counts as a point",
        )
        for link in links
        if stated and link.find("inertial/mass") is not None and link not in stated
    ]
    yield from gathered(FindingCode.UNLIKELY_INERTIA, label, "such links", lacking)


def _end(joint: ET.Element, end: str) -> str:
    """Return the link at one end of a joint."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _joint(path: Path, joint: ET.Element, rotors: Mapping[str, float]) -> RobotJoint:
    """Read one joint."""
    name, kind = joint.get("name", ""), joint.get("type", "")
    where = f"{path}: joint {name!r}"
    known = (*MOVABLE_KINDS, *FREE_KINDS, "fixed")
    if kind not in known:
        raise RobotError(f"{where} has the unknown type {kind!r}; {names_in_words(kind, known)}")
    T, axis = _origin(where, joint), np.array([1.0, 0.0, 0.0])
    element = joint.find("axis")
    if kind in MOVABLE_KINDS and element is not None:
        axis = np.array(_numbers(where, "axis xyz", element.get("xyz", "1 0 0"), 3))
        if not axis.any():
            raise RobotError(
                f"{where} has the axis {element.get('xyz')!r}; give one that is not zero"
            )
    lower, upper, effort, velocity = _limits(where, kind, joint.find("limit"))
    follows: dict[str, float] = {}
    offset = 0.0
    for mimic in joint.findall("mimic"):
        factor = _number(where, "mimic multiplier", mimic.get("multiplier", "1"))
        follows[mimic.get("joint", "")] = factor
        offset += _number(where, "mimic offset", mimic.get("offset", "0"))
    return RobotJoint(
        name, kind, _end(joint, "parent"), _end(joint, "child"), T, axis, lower, upper, effort,
        velocity, rotors.get(name, 0.0), JointCoupling(name, follows, offset) if follows else None,
    )  # fmt: skip


def _limits(where: str, kind: str, limit: ET.Element | None) -> tuple[float, float, float, float]:
    """Return lowest and highest position, effort and velocity; infinite where none is limited."""
    is_limited = kind in ("revolute", "prismatic")
    if limit is None:
        if is_limited:
            raise RobotError(f"{where} is {kind} and has no <limit lower upper effort velocity>")
        return -np.inf, np.inf, np.inf, np.inf
    found = {"lower": 0.0, "upper": 0.0, "effort": np.inf, "velocity": 0.0} | {
        key: _number(where, f"limit {key}", text, unlimited=True)
        for key, text in limit.attrib.items()
    }
    for key in ("effort", "velocity") if kind in MOVABLE_KINDS else ():
        if found[key] < 0.0:
            raise RobotError(
                f"{where} has the limit {key}={limit.get(key)!r}, which is negative; give the most "
                "that it has both ways, or leave it out"
            )
    # Files that know of no limit state a velocity of 0.
    most = limit_of(found["effort"]), limit_of(found["velocity"]) or np.inf
    if not is_limited:
        return -np.inf, np.inf, *most
    if found["lower"] > found["upper"]:
        low, high = (limit.get(key, "0") for key in ("lower", "upper"))
        raise RobotError(
            f"{where} has the lower limit {low} above the upper limit {high}, so that it can "
            "stand nowhere; exchange them"
        )
    return limit_of(found["lower"]), limit_of(found["upper"]), *most


def _rotor_inertias(path: Path, root: ET.Element, joints: Collection[str]) -> dict[str, float]:
    """Return the inertia of each rotor at its joint: times the gear ratio squared.

    A transmission holds ``rotor_inertia`` (kg m^2, or kg) and ``gear_ratio`` as attributes called
    ``value``, with any prefix; without a gear ratio ``mechanicalReduction`` counts, else 1.

    Args:
        path: The URDF file.
        root: Its ``<robot>`` element.
        joints: Those of which rotors are looked for.

    Returns:
        kg m^2 (kg for prismatic joints) by joint.

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
        own = [joint.get("name", "") for joint in transmission.findall("joint")]
        if "rotor_inertia" not in texts or len(own) != 1 or own[0] not in joints:
            continue
        inertia = _number(where, "rotor_inertia", texts["rotor_inertia"])
        if inertia < 0.0:
            raise RobotError(f"{where} has the negative rotor_inertia {inertia:g} kg m^2")
        ratio = texts.get("gear_ratio", texts.get("mechanicalReduction", "1"))
        factor = _number(where, "gear_ratio", ratio)
        rotors[own[0]] = inertia * factor**2
    return rotors


def _link(described: RobotDescription, link: ET.Element, *, with_shapes: bool) -> RobotLink:
    """Read one link."""
    name = link.get("name", "")
    where = f"{described.urdf_path}: link {name!r}"
    of_collisions, of_visuals = (
        link.findall(use) if with_shapes else [] for use in ("collision", "visual")
    )
    if described.visuals_collide and not of_collisions:
        of_collisions = of_visuals
    collisions = [_shape(described, where, one, leave_out_empty=True) for one in of_collisions]
    try:
        visuals = [_shape(described, where, one, leave_out_empty=False) for one in of_visuals]
    except RobotError:  # drawn only: half a link would mislead more than its collision shapes do
        visuals = []
    shapes = (tuple(filter(None, found)) for found in (collisions, visuals))
    return RobotLink(name, *_inertial(where, link), *shapes)


def _inertial(where: str, link: ET.Element) -> tuple[float, FloatArray, FloatArray]:
    """Return mass, its centre and the inertia about it; zeros where statics needs none."""
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    T = _origin(where, inertial)
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    text = "" if mass is None else mass.get("value", "")
    value = _number(where, "mass", text)
    if value < 0.0:
        raise RobotError(f"{where} has the negative mass {text} kg")
    stated = {} if inertia is None else inertia.attrib
    xx, xy, xz, yy, yz, zz = (
        _number(where, f"inertia {key}", stated.get(key, "0"))
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    R, own = T[:3, :3], np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return value, T[:3, 3].copy(), R @ own @ R.T


def _shape(
    described: RobotDescription, where: str, element: ET.Element, *, leave_out_empty: bool
) -> LinkShape | None:
    """Read one shape; None: it has no size, and was left out.

    Raises:
        RobotError: It is malformed.
    """
    T, shape = _origin(where, element), element.find("geometry/*")
    if shape is None:
        raise RobotError(f"{where} has a <{element.tag}> without a shape in its <geometry>")
    if shape.tag == "mesh":
        x, y, z = _numbers(where, "mesh scale", shape.get("scale", "1 1 1"), 3)
        if not (x and y and z):
            raise RobotError(f"{where} has a mesh scale of {shape.get('scale')!r}")
        written = shape.get("filename", "")
        looked = tuple(_candidates(described.urdf_path, written, described.package_dirs))
        file = next((one.resolve() for one in looked if is_file(one)), None)
        return LinkShape(LinkMesh(written, file, looked, (x, y, z)), T)
    if shape.tag not in _PRIMITIVES:
        known = ", ".join((*_PRIMITIVES, "mesh"))
        raise RobotError(f"{where} has the unknown shape <{shape.tag}>; known: {known}")
    kind = SHAPES[shape.tag]
    sizes = []
    for key, count in kind.lengths().items():
        what = f"{shape.tag} {key}"
        size = _numbers(where, what, shape.get(key, ""), count)
        if min(size) < 0.0:
            raise RobotError(f"{where} has {what}={shape.get(key)!r}, which is negative")
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
        raise RobotError(f"{where} has a {kind.kind} that cannot be: {error}") from error


def _origin(where: str, element: ET.Element) -> FloatArray:
    """Return the (4, 4) pose that the ``<origin>`` of a joint, shape or mass states."""
    origin = element.find("origin")
    stated = {} if origin is None else origin.attrib
    what = f"{element.tag} origin"
    position = _numbers(where, f"{what} xyz", stated.get("xyz", "0 0 0"), 3)
    angles = _numbers(where, f"{what} rpy", stated.get("rpy", "0 0 0"), 3)
    return rigid(position, rotation_matrix(np.array(angles)))


def _number(where: str, what: str, text: str, *, unlimited: bool = False) -> float:
    """Parse one number; see `_numbers`."""
    return _numbers(where, what, text, 1, unlimited=unlimited)[0]


def _numbers(
    where: str, what: str, text: str, count: int, *, unlimited: bool = False
) -> list[float]:
    """Parse ``count`` numbers, none of them NaN and, unless they are limits, all within ±1e12."""
    try:
        values = [] if "_" in text else [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or any(value != value for value in values):
        needed = "a number" if count == 1 else f"{count} numbers"
        raise RobotError(f"{where} has {what}={text!r}, which is not {needed}")
    if not unlimited and any(abs(value) > LARGEST_LENGTH for value in values):
        raise RobotError(f"{where} has {what}={text!r}; it must be within ±{LARGEST_LENGTH:g}")
    return values


def _candidates(path: Path, written: str, package_dirs: Sequence[Path]) -> Iterable[Path]:
    """Yield the files that a mesh's ``filename`` may mean, the likeliest first."""
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
        above = path.resolve().parents
        yield from (folder / inside for folder in above if folder.name == package)
        yield from (folder / package / inside for folder in above)
