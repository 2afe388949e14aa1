"""Shapes, poses and bodies as elements of MJCF, MuJoCo's own XML."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.bodies.shapes import shape_of
from graspless_pin.problem.checks import FloatArray


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
