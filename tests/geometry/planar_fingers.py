"""Fingers whose closing can be worked out by hand, and bodies for them to touch."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.bodies.shapes import Box, Shape, Sphere
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.robots.description import FingerSpec
from graspless_pin.geometry.robots.files import load_robot

RADIUS = 0.01
UPPER = 0.08  # m, from the first joint to the second
LOWER = 0.06  # m, from the second joint to the tip
KNUCKLE = 0.07  # m, from the first joint to the sphere on the upper link


def _sphere(x: float) -> str:
    return (
        f'<collision><origin xyz="{x} 0 0"/><geometry><sphere radius="{RADIUS}"/></geometry>'
        "</collision>"
    )


def _revolute(name: str, parent: str, child: str, x: float, lower: float, upper: float) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="2" velocity="1"/></joint>'
    )


TWO_LINKS = (
    '<link name="base"/>'
    + _revolute("first", "base", "upper", 0.0, -1.5, 1.5)
    + f'<link name="upper">{_sphere(KNUCKLE)}</link>'
    + _revolute("second", "upper", "lower", UPPER, -2.0, 2.0)
    + f'<link name="lower">{_sphere(LOWER)}</link>'
)

_PAD = '<collision><geometry><box size="0.01 0.02 0.02"/></geometry></collision>'
# Two jaws that start 0.05 m to either side of the middle; positive positions close.
JAWS = (
    '<link name="base"/><joint name="left_slide" type="prismatic"><parent link="base"/>'
    '<child link="left"/><origin xyz="-0.055 0 0"/><axis xyz="1 0 0"/>'
    '<limit lower="0" upper="0.05" effort="2" velocity="1"/></joint>'
    f'<link name="left">{_PAD}</link>'
    '<joint name="right_slide" type="prismatic"><parent link="base"/><child link="right"/>'
    '<origin xyz="0.055 0 0"/><axis xyz="-1 0 0"/>'
    '<limit lower="0" upper="0.05" effort="2" velocity="1"/><mimic joint="left_slide"/></joint>'
    f'<link name="right">{_PAD}</link>'
)


def two_link_finger(folder: Path, **q: float) -> Hand:
    file = folder / "two_links.urdf"
    file.write_text(f'<robot name="two_links">{TWO_LINKS}</robot>')
    fingers = {"finger": FingerSpec(("first", "second"), tip="lower")}
    return Hand.from_urdf(file, fingers=fingers, q=q)


def jaws(folder: Path) -> Hand:
    file = folder / "jaws.urdf"
    file.write_text(f'<robot name="jaws">{JAWS}</robot>')
    fingers = {"left": FingerSpec(("left_slide",)), "right": FingerSpec(("right_slide",))}
    return Hand.from_urdf(file, fingers=fingers)


def lever(**q: float) -> Hand:
    """The paper's 0.15 m lever: its tip sphere's centre is at (0.15, RADIUS, 0) in its frame."""
    return Hand.assemble([Mount(load_robot("lever_150mm"))], q=q)


def allegro(**q: float) -> Hand:
    return Hand.assemble(
        [Mount(load_robot("allegro_right"))],
        q={f"{name}.0": value for name, value in q.items()},
    )


def body(shape: Shape, position=(0.0, 0.0, 0.0), rotation=None, name="object") -> ManipulatedObject:
    return ManipulatedObject(name, shape, 1.0, np.zeros(3), pose_matrix(position, rotation))


def plate_above(height: float) -> ManipulatedObject:
    """A wide plate whose underside is at y = height."""
    return body(Box((1.0, 0.02, 1.0)), (0.0, height + 0.01, 0.0), name="plate")


def ball(radius: float, position) -> ManipulatedObject:
    return body(Sphere(radius), position, name="ball")
