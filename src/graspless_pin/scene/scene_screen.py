"""A scene in one line, and on one screen."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.errors import GrasplessPinError
from graspless_pin.geometry.bodies.shapes import Shape
from graspless_pin.problem.checks import FloatArray

if TYPE_CHECKING:
    from graspless_pin.scene.scene import Scene

_MOST = 8


def scene_line(scene: Scene) -> str:
    """Return a scene in one line: its name and sizes; nothing is computed for it."""
    joints = "no hand"
    if scene.hand is not None:
        joints = f"a hand of {_count(len(scene.hand.joint_names), 'joint')}"
    return (
        f"<Scene {scene.name!r}: {scene.object.name}, {scene.object.mass:g} kg, {joints}, "
        f"{_count(len(scene.supports), 'support')}>"
    )


def scene_screen(scene: Scene) -> str:
    """Return a scene on one screen: what there is, what touches, what is wrong."""
    made = scene.object
    lines = [scene.name if scene.path is None else f"{scene.name} ({scene.path})"]
    lines.append(
        f"object    {made.name}: {_shape(made.shape)}, {made.mass:g} kg, at "
        f"{_point(made.T_world_object[:3, 3])} m"
    )
    if scene.hand is None:
        lines.append("hand      none")
    else:
        hand = scene.hand
        fingers = ", ".join(hand.fingers) or "no fingers"
        lines.append(
            f"hand      {_shortened(fingers)}: {_count(len(hand.joint_names), 'joint')}, "
            f"{len(hand.actuated_joint_names)} under force control"
        )
    for support in scene.supports[:_MOST]:
        moves = ", moves" if support.is_moving else ""
        lines.append(f"support   {support.name}: {_shape(support.shape)}{moves}")
    if len(scene.supports) > _MOST:
        lines.append(f"          and {len(scene.supports) - _MOST} more")
    lines.append(f"contacts  {_contacts(scene)}")
    if scene.motion is None:
        lines.append("motion    none: at rest")
    else:
        twist = scene.motion.object_twist
        lines.append(f"motion    {_point(twist[:3])} m/s, {_point(twist[3:])} rad/s")
    findings = scene.findings
    lines += [f"{one.severity!s:<9} {one}" for one in findings[:_MOST]]
    if len(findings) > _MOST:
        lines.append(f"          and {len(findings) - _MOST} more in scene.findings")
    return "\n".join(lines)


def _contacts(scene: Scene) -> str:
    try:
        touching = scene.contacts
    except GrasplessPinError as error:
        return f"none: {error}"
    bodies = Counter(touching.bodies)
    each = ", ".join(f"{name} {count}" for name, count in list(bodies.items())[:_MOST])
    more = f" and {len(bodies) - _MOST} bodies more" if len(bodies) > _MOST else ""
    sliding = int(touching.sliding.any(axis=1).sum())
    return f"{len(touching.bodies)}, {sliding} sliding: {each}{more}"


def _shape(shape: Shape) -> str:
    figures = [
        f"{value:g}" for key in shape.lengths() for value in np.atleast_1d(getattr(shape, key))
    ]
    files = [f" {value.name}" for value in vars(shape).values() if isinstance(value, Path)]
    words = "".join([shape.kind.replace("_", "-"), *files])
    return f"{words} {' x '.join(figures)} m" if figures else words


def _point(values: FloatArray) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in (np.round(values, 9) + 0.0).tolist())}]"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."
