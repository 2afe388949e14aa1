"""Figures of robots that look like another unit: lengths, masses, inertias and angles.

A finding names one figure of a kind and the number of others: a file in millimetres has many.
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
"""More than osmium has, kg/m^3."""
_LEAST_MASS = 1.0
"""kg: below, the shapes of a link may be placeholders, smaller than what has the mass."""
_LEAST_REACH = 1.0
"""m: shapes may stand for parts of small links alone."""
_LEAST_SHARE = 1e-4
"""Of a robot's mass: what has less is a frame with a mass because some program wanted one."""
_ROUNDED_GYRATION = 1e-9
"""m^2: moments of inertia per mass that are less apart differ by rounding."""
_OVER_REACH = 30.0
"""Largest moment of inertia over that of the same mass at the other end of the robot: shapes and
masses of small links are often placeholders; kg mm^2 for kg m^2 makes a million.
"""
_OVER_SUM = 1.5
"""Largest moment of inertia over the sum of the others: 1 is the most, and files are rounded."""
_MOST_TURNS = 2.0
"""Of limits; more than these in radians, and no more in degrees, are degrees."""
_SAME_FACTOR = 0.003
"""By how much of itself a multiplier may be off the factor between two units."""

Found = Sequence[tuple[str, str]]
"""What is found, each with what to do about it."""


def gathered(code: FindingCode, label: str, kind: str, found: Found) -> Iterator[Finding]:
    """Yield one finding for all of a kind, if there are any.

    Args:
        code: What it is.
        label: The robot's file.
        kind: What else is counted: "such lengths".
        found: What is found; the first one is told.
    """
    if found:
        words, advice = found[0]
        more = f", and {len(found) - 1} more {kind}" if len(found) > 1 else ""
        yield Finding(code, label, f"{label}: {words}{more}", advice, ("hand",))


def unit_findings(robot: RobotModel, boxes: Mapping[str, FloatArray]) -> Iterator[Finding]:
    """Find figures of a robot that look like another unit, or that no rigid body has.

    Args:
        robot: The robot.
        boxes: (2, 3) lowest and highest corner of the box around the collision shapes, in the
            link's frame, m, by link that has any.
    """
    boxes = _with_joints(robot, boxes)
    longest = sum(float(np.linalg.norm(high - low)) for low, high in boxes.values())
    for code, kind, found in (
        (FindingCode.UNLIKELY_SIZE, "such lengths", _lengths(robot, boxes, longest)),
        (FindingCode.UNLIKELY_DENSITY, "such links", _masses(robot, boxes)),
        (FindingCode.UNLIKELY_INERTIA, "such links", _inertias(robot, boxes, longest)),
        (FindingCode.ANGLE_IN_DEGREES, "such limits", _limits(robot)),
        (FindingCode.ANGLE_IN_DEGREES, "such multipliers", _multipliers(robot)),
    ):
        yield from gathered(code, robot.label, kind, found)


def _with_joints(robot: RobotModel, boxes: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the boxes around shapes, the link's origin and the joints that hang on the link."""
    points = {link: [*box, np.zeros(3)] for link, box in boxes.items()}
    for joint in robot.joints:
        if joint.parent in points:
            points[joint.parent].append(joint.T_parent_joint[:3, 3])
    return {link: np.array([np.min(own, 0), np.max(own, 0)]) for link, own in points.items()}


def _lengths(robot: RobotModel, boxes: Mapping[str, FloatArray], longest: float) -> Found:
    """Find joints and shapes far from their links, shapes too large, and masses far outside.

    Args:
        robot: The robot.
        boxes: Around its links, see `unit_findings`.
        longest: All links one after the other, m.
    """
    found = [
        (length, f"joint {joint.name!r} is {{}} m from the origin of link {joint.parent!r}")
        for joint in robot.joints
        if (length := float(np.linalg.norm(joint.T_parent_joint[:3, 3]))) > LARGEST_MESH
    ]
    for link in robot.links:
        for item in link.collisions:
            away = float(np.linalg.norm(item.T_link_shape[:3, 3]))
            if away > LARGEST_MESH:
                found.append((away, f"a shape of link {link.name!r} is {{}} m from its origin"))
            shape = item.shape
            if isinstance(shape, Shape):
                found += [
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
            found.append((float(away), what))
    return [
        (
            words.format(f"{length:.4g}"),
            f"lengths are metres: in a file in millimetres this is {1e-3 * length:.3g} m",
        )
        for length, words in found
    ]


def _masses(robot: RobotModel, boxes: Mapping[str, FloatArray]) -> Found:
    """Find links that are heavier than any metal of their size."""
    found = []
    for link in robot.links:
        if link.name not in boxes or link.mass < _LEAST_MASS:
            continue
        size = np.ptp(boxes[link.name], axis=0)
        density = link.mass / float(size.prod())
        if density > HIGHEST_DENSITY:
            lengths = " x ".join(f"{1e3 * length:.3g}" for length in size.tolist())
            found.append((
                f"link {link.name!r} has {link.mass:.4g} kg in a box of {lengths} mm, which is "
                f"{density:.3g} kg/m^3, more than any metal has",
                f"masses are kilograms: in a file in grams this is {1e-3 * link.mass:.3g} kg",
            ))  # fmt: skip
    return found


def _inertias(robot: RobotModel, boxes: Mapping[str, FloatArray], longest: float) -> Found:
    """Find inertias that no rigid body has, or none of the robot's size.

    A mass as far away as all links are long together has the moment ``mass * longest**2``.

    Args:
        robot: The robot.
        boxes: Around its links, see `unit_findings`.
        longest: All links one after the other, m.
    """
    least = _LEAST_SHARE * sum(link.mass for link in robot.links)
    found = []
    for link in (one for one in robot.links if one.mass > least):
        moments = np.linalg.eigvalsh(link.inertia).astype(np.float64)
        if wrong := _impossible(link, moments, longest if link.name in boxes else math.inf):
            named = ", ".join(f"{moment:.3g}" for moment in moments)
            found.append((
                f"link {link.name!r} of {link.mass:.3g} kg has the moments of inertia {named} "
                f"kg m^2: {wrong}",
                "give them about the centre of mass in kg m^2; 1 kg mm^2 is 1e-6, and 1 g mm^2 is "
                "1e-9 kg m^2",
            ))  # fmt: skip
    return found


def _impossible(link: RobotLink, moments: FloatArray, longest: float) -> str:
    """Return what is wrong with a link's moments of inertia, lowest first; empty: nothing."""
    rounded = _ROUNDED_GYRATION * link.mass
    if moments[0] < -rounded:
        return "no body has a negative one"
    if moments[2] > _OVER_REACH * link.mass * longest**2:
        times = moments[2] / (link.mass * longest**2)
        return f"the largest is {times:.2g} times that of this mass at the other end of the robot"
    if moments[2] > _OVER_SUM * (moments[0] + moments[1]) + rounded:
        return "the largest is more than the sum of the others, which no body has"
    return ""


def _limits(robot: RobotModel) -> Found:
    """Find limits of revolute joints in degrees."""
    most = _MOST_TURNS * 2.0 * math.pi
    found = []
    for joint in (one for one in robot.joints if one.kind == "revolute"):
        ends = joint.lower, joint.upper
        if most < max(map(abs, ends)) <= math.degrees(most):
            radians = ", ".join(f"{math.radians(end):.4g}" for end in ends)
            limits = f"[{ends[0]:g}, {ends[1]:g}]"
            found.append((
                f"the limits {limits} rad of joint {joint.name!r} are more than "
                f"{_MOST_TURNS:g} turns",
                f"give angles in radians: {limits} degrees are [{radians}] rad",
            ))  # fmt: skip
    return found


def _multipliers(robot: RobotModel) -> Found:
    """Find multipliers of followers that turn degrees into radians or back."""
    turning = {one.name for one in robot.joints if one.kind in ("revolute", "continuous")}
    factors = {"180/pi": math.degrees(1.0), "pi/180": math.radians(1.0)}
    return [
        (
            f"joint {one.joint!r} follows joint {leader!r} times {multiplier:g}, which is {name}",
            "a multiplier is radians per radian: 1 where both joints turn alike",
        )
        for one in robot.couplings
        for leader, multiplier in one.follows.items()
        for name, factor in factors.items()
        if {one.joint, leader} <= turning and abs(abs(multiplier) / factor - 1.0) <= _SAME_FACTOR
    ]
