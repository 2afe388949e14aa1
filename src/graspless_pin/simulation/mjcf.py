"""Shapes, poses and bodies as elements of MJCF, MuJoCo's own XML.

It writes object, supports and friction of a scene, and raises errors for scenes that MuJoCo cannot
simulate.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
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

HAND: Mapping[str, int] = MappingProxyType({"priority": 1, "contype": 2, "conaffinity": 1})
"""Contact attributes of links: of two bodies the one with higher priority defines the friction;
``contype`` has a body's own kinds, as bits, and ``conaffinity`` the kinds that it can touch."""
_SUPPORT = MappingProxyType({"priority": 1, "contype": 0, "conaffinity": 3})
_OBJECT = MappingProxyType({"priority": 0, "contype": 1, "conaffinity": 0})


class Mjcf:
    """An MJCF document under construction; meshes are added to its assets."""

    def __init__(self, name: str) -> None:
        """Start an empty document."""
        self.root = ET.Element("mujoco", model=name)

    def section(self, name: str) -> ET.Element:
        """Return the root's child element of a name, which is added if there is none."""
        element = self.root.find(name)
        return ET.SubElement(self.root, name) if element is None else element

    def add_body(self, parent: ET.Element, name: str, T_parent_body: FloatArray) -> ET.Element:
        """Add a body at a (4, 4) pose in its parent's frame."""
        return add(parent, "body", name=name, **_pose(T_parent_body))

    def add_shape(
        self,
        body: ET.Element,
        name: str,
        geometry: Any,
        T_body_shape: FloatArray,
        friction: float,
        meets: Mapping[str, int],
    ) -> None:
        """Add a shape to a body.

        Args:
            body: The body's element.
            name: Name of the shape.
            geometry: A collision geometry.
            T_body_shape: (4, 4) pose in the body's frame, m.
            friction: Coulomb's coefficient.
            meets: Contact attributes, see `HAND`.
        """
        form = shape_of(geometry).mjcf_geom()
        if "vertex" in form:
            hulls = self.section("asset")
            form["mesh"] = f"hull_{len(hulls) + 1}"
            add(hulls, "mesh", name=form["mesh"], vertex=form.pop("vertex").ravel())
        add(
            body,
            "geom",
            name=name,
            **form,
            **_pose(T_body_shape),
            friction=[friction, 0.0, 0.0],
            condim=3 if friction > 0.0 else 1,
            **meets,
        )

    def text(self) -> str:
        """Return the document."""
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"


def add(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Add an element with some attributes."""
    words = {key: _attribute_text(value) for key, value in attributes.items()}
    return ET.SubElement(parent, tag, words)


def add_tendon(document: Mjcf, name: str, arms: Mapping[str, float]) -> None:
    """Add a fixed tendon with its moment arm (m) at each of some joints."""
    tendon = add(document.section("tendon"), "fixed", name=name)
    for joint, arm in arms.items():
        add(tendon, "joint", joint=joint, coef=arm)


def add_mass(body: ET.Element, mass: float, center: FloatArray, inertia: FloatArray) -> None:
    """Add a body's mass (kg), centre of mass (3,) and inertia (3, 3) about it, in its frame."""
    if not inertia.any():  # of a point; MuJoCo refuses zeros as fullinertia
        add(body, "inertial", mass=mass, pos=center, diaginertia=np.zeros(3))
        return
    Ixx, Ixy, Ixz, Iyy, Iyz, Izz = inertia[np.triu_indices(3)].tolist()
    add(body, "inertial", mass=mass, pos=center, fullinertia=[Ixx, Iyy, Izz, Ixy, Ixz, Iyz])


def _pose(T: FloatArray) -> dict[str, object]:
    turn = Rotation.from_matrix(T[:3, :3])
    return {"pos": T[:3, 3], "quat": turn.as_quat(canonical=True, scalar_first=True)}


def _attribute_text(value: object) -> str:
    """Return the text of an attribute's value; numbers are read back exactly."""
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


def check_at_rest(scene: Scene) -> None:
    """Check that a scene declares no motion.

    Raises:
        SceneError: If it declares one, or a support moves.
    """
    where = label_of(scene)
    if scene.motion is not None:
        raise SceneError(
            f"{where}: motion: is not supported by the simulation, which checks whether an object "
            "stays at rest; leave the key out"
        )
    for support in scene.supports:
        if support.velocity.any():
            raise SceneError(
                f"{where}: support {support.name!r} moves, but the simulation checks whether an "
                "object stays at rest; leave its velocity out"
            )


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
        body = document.add_body(document.section("worldbody"), name, support.T_world_support)
        friction = friction_factor * friction_at(scene, "supports", support.name)
        for number, (piece, T) in enumerate(placed_pieces(support)):
            document.add_shape(body, f"{name}/{number}", piece, T, friction, _SUPPORT)
            yield f"{name}/{number}", support.name


def write_object(
    document: Mjcf, scene: Scene, manipulated: ManipulatedObject, name: str = OBJECT
) -> None:
    """Write the object at its pose, with a free joint and its payloads."""
    body = document.add_body(document.section("worldbody"), name, manipulated.T_world_object)
    add(body, "freejoint", name=name)
    add_mass(body, manipulated.mass, manipulated.center_of_mass, manipulated.own_inertia)
    for load in scene.loads:
        if load.mass:
            at = manipulated.center_of_mass if load.at is None else load.at
            payload = document.add_body(body, f"load/{load.name}", rigid(at))
            add_mass(payload, load.mass, np.zeros(3), np.zeros((3, 3)))
    for number, (piece, T) in enumerate(placed_pieces(manipulated)):
        # The other body's coefficient is used.
        document.add_shape(body, f"{name}/{number}", piece, T, 1.0, _OBJECT)
