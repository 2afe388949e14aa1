"""Shapes, poses and bodies as elements of MJCF, MuJoCo's own XML.

Object, supports and friction of a scene are written so; what a scene in MuJoCo may not have is
refused.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import SceneError
from graspless_pin.geometry import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import shape_of
from graspless_pin.geometry.poses import rigid
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import Scene
from graspless_pin.scene.fields import label_of
from graspless_pin.scene.problem_data import friction_at


@dataclass(frozen=True)
class Surface:
    """How the surface of a body meets others.

    Attributes:
        friction: Coulomb's coefficient; of two bodies the one of higher priority states it.
        priority: Of two equals the larger coefficient counts.
        contype: Kinds of bodies that it is, as bits.
        conaffinity: Kinds of bodies that it meets, as bits.
    """

    friction: float
    priority: int
    contype: int
    conaffinity: int


class Mjcf:
    """An MJCF document that is being written; meshes go to its assets."""

    def __init__(self, name: str) -> None:
        """Begin a document."""
        self.root = ET.Element("mujoco", model=name)
        self._sections: dict[str, ET.Element] = {}
        self._meshes = 0

    def section(self, name: str) -> ET.Element:
        """Return the one element of a name below the root."""
        if name not in self._sections:
            self._sections[name] = ET.SubElement(self.root, name)
        return self._sections[name]

    def body(self, parent: ET.Element, name: str, T_parent_body: FloatArray) -> ET.Element:
        """Add a body at a (4, 4) pose in its parent's frame."""
        return add(parent, "body", name=name, **_pose(T_parent_body))

    def shape(
        self,
        body: ET.Element,
        name: str,
        geometry: Any,
        T_body_shape: FloatArray,
        surface: Surface,
    ) -> None:
        """Add a shape to a body.

        Args:
            body: The body's element.
            name: Name of the shape.
            geometry: What collision bodies are made of.
            T_body_shape: (4, 4) pose in the body's frame, m.
            surface: How it meets others.
        """
        form = shape_of(geometry).mjcf_geom()
        if "vertex" in form:
            self._meshes += 1
            form["mesh"] = f"hull_{self._meshes}"
            add(
                self.section("asset"),
                "mesh",
                name=form["mesh"],
                vertex=form.pop("vertex").ravel(),
            )
        add(
            body,
            "geom",
            name=name,
            **form,
            **_pose(T_body_shape),
            friction=[surface.friction, 0.0, 0.0],
            condim=3 if surface.friction > 0.0 else 1,
            priority=surface.priority,
            contype=surface.contype,
            conaffinity=surface.conaffinity,
        )

    def text(self) -> str:
        """Return the document."""
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"


def add(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Add an element with some attributes."""
    words = {key: _words(value) for key, value in attributes.items()}
    return ET.SubElement(parent, tag, words)


def add_tendon(document: Mjcf, name: str, arms: Mapping[str, float]) -> None:
    """Add a fixed tendon with its moment arm (m) at each of some joints."""
    tendon = add(document.section("tendon"), "fixed", name=name)
    for joint, arm in arms.items():
        add(tendon, "joint", joint=joint, coef=arm)


def add_mass(body: ET.Element, mass: float, center: FloatArray, inertia: FloatArray) -> None:
    """State a body's mass (kg), centre of mass (3,) and inertia (3, 3) about it, in its frame."""
    Ixx, Ixy, Ixz, Iyy, Iyz, Izz = inertia[np.triu_indices(3)].tolist()
    add(body, "inertial", mass=mass, pos=center, fullinertia=[Ixx, Iyy, Izz, Ixy, Ixz, Iyz])


def _pose(T: FloatArray) -> dict[str, object]:
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True).tolist()
    return {"pos": T[:3, 3], "quat": [w, x, y, z]}


def _words(value: object) -> str:
    """Return an attribute's value; numbers are read back exactly."""
    match value:
        case str():
            return value
        case bool():
            return str(value).lower()
        case Iterable():
            return " ".join(repr(float(number)) for number in value)
    return str(value)


OBJECT = "object"
"""Name of the manipulated object's body."""

_HAND, _SUPPORT = 2, 0  # contype; the object's is 1
_MEETS_OBJECT, _MEETS_BOTH = 1, 3  # conaffinity


def check_at_rest(scene: Scene) -> None:
    """Refuse a scene in which something moves.

    Raises:
        SceneError: If it does.
    """
    where = label_of(scene)
    if scene.motion is not None:
        raise SceneError(
            f"{where}: motion: declares a motion, and the simulation tells whether rest lasts; "
            "leave the key out to ask for rest"
        )
    for support in scene.supports:
        if support.velocity.any():
            raise SceneError(
                f"{where}: support {support.name!r} moves, and the simulation tells whether rest "
                "lasts; leave its velocity out"
            )


def hand_surface(scene: Scene, link: str, friction_factor: float = 1.0) -> Surface:
    """Return how a link meets the object, and supports.

    Raises:
        SceneError: If it has no coefficient of friction.
    """
    friction = friction_factor * friction_at(scene, "hand", link)
    return Surface(friction, 1, _HAND, _MEETS_OBJECT)


def placed_pieces(body: ManipulatedObject | Support) -> Iterator[tuple[Any, FloatArray]]:
    """Yield the convex pieces of a body, each with its (4, 4) pose in the body's frame."""
    poses = body.shape.placements()
    for number, piece in enumerate(body.shapes.geometries):
        yield piece, np.eye(4) if poses is None else poses[number]


def write_supports(
    document: Mjcf, scene: Scene, *, prefix: str, friction_factor: float = 1.0
) -> Iterator[tuple[str, str]]:
    """Write the supports; yield the name of each shape, and the support's.

    Raises:
        SceneError: If a support has no coefficient of friction.
    """
    for support in scene.supports:
        name = f"{prefix}{support.name}"
        body = document.body(document.section("worldbody"), name, support.T_world_support)
        friction = friction_factor * friction_at(scene, "supports", support.name)
        surface = Surface(friction, 1, _SUPPORT, _MEETS_BOTH)
        for number, (piece, T) in enumerate(placed_pieces(support)):
            document.shape(body, f"{name}/{number}", piece, T, surface)
            yield f"{name}/{number}", support.name


def write_object(
    document: Mjcf, scene: Scene, manipulated: ManipulatedObject, name: str = OBJECT
) -> None:
    """Write the object at its pose, with a free joint and its payloads."""
    body = document.body(document.section("worldbody"), name, manipulated.T_world_object)
    add(body, "freejoint", name=name)
    add_mass(body, manipulated.mass, manipulated.center_of_mass, manipulated.own_inertia)
    for load in scene.loads:
        if load.mass:
            at = manipulated.center_of_mass if load.at is None else load.at
            payload = document.body(body, f"load/{load.name}", rigid(at))
            add_mass(payload, load.mass, np.zeros(3), np.zeros((3, 3)))
    surface = Surface(1.0, 0, 1, 0)  # the other body's friction counts
    for number, (piece, T) in enumerate(placed_pieces(manipulated)):
        document.shape(body, f"{name}/{number}", piece, T, surface)
