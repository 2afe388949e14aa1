"""Numbers of a robot that suggest another unit: lengths, masses, inertias and angles.

A finding states one number of a kind and the count of the others: a file in millimetres has many.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.meshes import LARGEST_MESH
from graspless_pin.geometry.bodies.shape import Shape
from graspless_pin.geometry.hand.robot_model import RobotLink, RobotModel
from graspless_pin.problem.checks import FloatArray

HIGHEST_DENSITY = 30_000.0
"""Largest plausible density, more than that of osmium, kg/m^3."""
_LEAST_MASS = 1.0
"""Mass below which densities are not checked, kg: shapes of small links may be placeholders."""
_LEAST_REACH = 1.0
"""Least distance of a centre of mass outside the shapes that is reported, m."""
_LEAST_SHARE = 1e-4
"""Share of the robot's mass below which a link's inertia is not checked."""
_ROUNDED_GYRATION = 1e-9
"""Rounding error of moments of inertia per mass, m^2."""
_OVER_REACH = 30.0
"""Largest moment of inertia over that of the same mass at the other end of the robot.

Shapes and masses of small links are often placeholders; kg mm^2 for kg m^2 makes a million.
"""
_OVER_SUM = 1.5
"""Largest moment of inertia over the sum of the others: at most 1, but files are rounded."""
_MOST_TURNS = 2.0
"""Turns from which on a limit in radians, if fewer turns in degrees, is taken for degrees."""
_SAME_FACTOR = 0.003
"""Relative deviation up to which a multiplier equals the factor between two units."""

Doubts = Sequence[tuple[str, str]]
"""(message, advice) of each doubtful number."""


def summary_finding(code: FindingCode, label: str, kind: str, doubts: Doubts) -> Iterator[Finding]:
    """Yield one finding for all doubtful numbers of a kind, if there are any.

    Args:
        code: Code of the finding.
        label: The robot's file.
        kind: Words for the others, which are only counted: "such lengths".
        doubts: The doubtful numbers; the first one is stated.
    """
    if doubts:
        message, advice = doubts[0]
        others = f", and {len(doubts) - 1} more {kind}" if len(doubts) > 1 else ""
        yield Finding(code, label, f"{label}: {message}{others}", advice, ("hand",))


def unit_findings(robot: RobotModel, boxes: Mapping[str, FloatArray]) -> Iterator[Finding]:
    """Find numbers of a robot that suggest another unit, or that no rigid body can have.

    Args:
        robot: The robot.
        boxes: (2, 3) lowest and highest corner of the collision shapes' bounding box, in the
            link's frame, m, by link that has any.
    """
    boxes = _boxes_with_joints(robot, boxes)
    longest = sum(float(np.linalg.norm(high - low)) for low, high in boxes.values())
    for code, kind, doubts in (
        (FindingCode.UNLIKELY_SIZE, "such lengths", _unlikely_lengths(robot, boxes, longest)),
        (FindingCode.UNLIKELY_DENSITY, "such links", _unlikely_masses(robot, boxes)),
        (FindingCode.UNLIKELY_INERTIA, "such links", _unlikely_inertias(robot, boxes, longest)),
        (FindingCode.ANGLE_IN_DEGREES, "such limits", _limits_in_degrees(robot)),
        (FindingCode.ANGLE_IN_DEGREES, "such multipliers", _converting_multipliers(robot)),
    ):
        yield from summary_finding(code, robot.label, kind, doubts)


def _boxes_with_joints(robot: RobotModel, boxes: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return bounding boxes of the shapes, the link's origin and the joints on the link."""
    points = {link: [*box, np.zeros(3)] for link, box in boxes.items()}
    for joint in robot.joints:
        if joint.parent in points:
            points[joint.parent].append(joint.T_parent_joint[:3, 3])
    return {link: np.array([np.min(own, 0), np.max(own, 0)]) for link, own in points.items()}


def _unlikely_lengths(robot: RobotModel, boxes: Mapping[str, FloatArray], longest: float) -> Doubts:
    """Find joints and shapes far from their links, too large shapes, and centres of mass outside.

    Args:
        robot: The robot.
        boxes: Bounding boxes of its links, see `unit_findings`.
        longest: Total length of all links, m.
    """
    doubts = [
        (length, f"joint {joint.name!r} is {{}} m from the origin of link {joint.parent!r}")
        for joint in robot.joints
        if (length := float(np.linalg.norm(joint.T_parent_joint[:3, 3]))) > LARGEST_MESH
    ]
    for link in robot.links:
        for item in link.collisions:
            away = float(np.linalg.norm(item.T_link_shape[:3, 3]))
            if away > LARGEST_MESH:
                doubts.append((away, f"a shape of link {link.name!r} is {{}} m from its origin"))
            shape = item.shape
            if isinstance(shape, Shape):
                doubts += [
                    (length, f"the {shape.kind} of link {link.name!r} is {{}} m long or wide")
                    for key in shape.lengths()
                    for length in np.atleast_1d(getattr(shape, key)).tolist()
                    if length > LARGEST_MESH
                ]
        low, high = boxes.get(link.name, np.full((2, 3), link.center_of_mass))
        center = link.center_of_mass
        outside, away = float(np.maximum(low - center, center - high).max()), np.linalg.norm(center)
        if outside > max(longest, _LEAST_REACH) or away > LARGEST_MESH:
            what = f"the centre of mass of link {link.name!r} is {{}} m from its origin"
            doubts.append((float(away), what))
    return [
        (
            message.format(f"{length:.4g}"),
            f"lengths are metres: in a file in millimetres this is {1e-3 * length:.3g} m",
        )
        for length, message in doubts
    ]


def _unlikely_masses(robot: RobotModel, boxes: Mapping[str, FloatArray]) -> Doubts:
    """Find links whose density exceeds that of any metal."""
    doubts = []
    for link in robot.links:
        if link.name not in boxes or link.mass < _LEAST_MASS:
            continue
        size = np.ptp(boxes[link.name], axis=0)
        density = link.mass / float(size.prod())
        if density > HIGHEST_DENSITY:
            lengths = " x ".join(f"{1e3 * length:.3g}" for length in size.tolist())
            doubts.append((
                f"link {link.name!r} has {link.mass:.4g} kg in a box of {lengths} mm, which is "
                f"{density:.3g} kg/m^3, more than any metal",
                f"masses are kilograms: in a file in grams this is {1e-3 * link.mass:.3g} kg",
            ))  # fmt: skip
    return doubts


def _unlikely_inertias(
    robot: RobotModel, boxes: Mapping[str, FloatArray], longest: float
) -> Doubts:
    """Find inertias that no rigid body can have, or none of the robot's size.

    A mass at the distance of the total length of all links has the moment ``mass * longest**2``.

    Args:
        robot: The robot.
        boxes: Bounding boxes of its links, see `unit_findings`.
        longest: Total length of all links, m.
    """
    least_mass = _LEAST_SHARE * sum(link.mass for link in robot.links)
    doubts = []
    for link in (candidate for candidate in robot.links if candidate.mass > least_mass):
        moments = np.linalg.eigvalsh(link.inertia).astype(np.float64)
        if fault := _inertia_fault(link, moments, longest if link.name in boxes else math.inf):
            listed = ", ".join(f"{moment:.3g}" for moment in moments)
            doubts.append((
                f"link {link.name!r} of {link.mass:.3g} kg has the moments of inertia {listed} "
                f"kg m^2: {fault}",
                "give them about the centre of mass in kg m^2; 1 kg mm^2 is 1e-6, and 1 g mm^2 is "
                "1e-9 kg m^2",
            ))  # fmt: skip
    return doubts


def _inertia_fault(link: RobotLink, moments: FloatArray, longest: float) -> str:
    """Return the fault of a link's moments of inertia (ascending) as a text, empty without one."""
    rounded = _ROUNDED_GYRATION * link.mass
    if moments[0] < -rounded:
        return "none may be negative"
    if moments[2] > _OVER_REACH * link.mass * longest**2:
        times = moments[2] / (link.mass * longest**2)
        return f"the largest is {times:.2g} times that of this mass at the other end of the robot"
    if moments[2] > _OVER_SUM * (moments[0] + moments[1]) + rounded:
        return "the largest exceeds the sum of the others, which is impossible"
    return ""


def _limits_in_degrees(robot: RobotModel) -> Doubts:
    """Find limits of revolute joints that seem to be in degrees."""
    largest_angle = _MOST_TURNS * 2.0 * math.pi
    doubts = []
    for joint in (candidate for candidate in robot.joints if candidate.kind == "revolute"):
        ends = joint.lower, joint.upper
        if largest_angle < max(map(abs, ends)) <= math.degrees(largest_angle):
            radians = ", ".join(f"{math.radians(end):.4g}" for end in ends)
            limits = f"[{ends[0]:g}, {ends[1]:g}]"
            doubts.append((
                f"the limits {limits} rad of joint {joint.name!r} are more than "
                f"{_MOST_TURNS:g} turns",
                f"give angles in radians: {limits} degrees are [{radians}] rad",
            ))  # fmt: skip
    return doubts


def _converting_multipliers(robot: RobotModel) -> Doubts:
    """Find multipliers of coupled joints that convert degrees into radians or back."""
    turning = {one.name for one in robot.joints if one.kind in ("revolute", "continuous")}
    factors = {"180/pi": math.degrees(1.0), "pi/180": math.radians(1.0)}
    return [
        (
            f"joint {one.joint!r} follows joint {leader!r} times {multiplier:g}, which is {name}",
            "a multiplier is in radians per radian: 1 if both joints turn by the same angle",
        )
        for one in robot.couplings
        for leader, multiplier in one.follows.items()
        for name, factor in factors.items()
        if {one.joint, leader} <= turning and abs(abs(multiplier) / factor - 1.0) <= _SAME_FACTOR
    ]
