"""The shapes of an MJCF's bodies as a URDF has them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from graspless_pin.errors import RobotError
from graspless_pin.geometry.hand.mjcf_source import (
    MjcfSource,
    add_origin,
    rotation_and_position,
    words,
)
from graspless_pin.problem.checks import FloatArray


def add_geom(source: MjcfSource, link: ET.Element, kind: str, geom: int) -> None:
    """Add a geom to a link.

    Args:
        source: The file.
        link: The ``<link>``.
        kind: ``collision`` or ``visual``.
        geom: Its index.

    Raises:
        RobotError: If a collision shape is none that a URDF can have, or a mesh has no file.
    """
    model, kinds = source.model, source.mujoco.mjtGeom
    R, p = rotation_and_position(model.geom_quat[geom], model.geom_pos[geom])
    shape, size = model.geom_type[geom], model.geom_size[geom]
    radius, length = repr(float(size[0])), repr(2.0 * float(size[1]))
    if shape == kinds.mjGEOM_MESH:
        attributes, turned, moved = _mesh(source, int(model.geom_dataid[geom]))
        R, p = R @ turned, p + R @ moved
    elif shape == kinds.mjGEOM_BOX:
        attributes = "box", {"size": words(2.0 * size)}
    elif shape == kinds.mjGEOM_SPHERE:
        attributes = "sphere", {"radius": radius}
    elif shape == kinds.mjGEOM_CYLINDER:
        attributes = "cylinder", {"radius": radius, "length": length}
    elif shape == kinds.mjGEOM_CAPSULE:
        attributes = "capsule", {"radius": radius, "length": length}
    elif kind == "visual":
        return
    else:
        word = kinds(shape).name.removeprefix("mjGEOM_").lower()
        raise RobotError(
            f"{source.path}: body {link.get('name')!r} has the collision shape {word!r}; use "
            "boxes, spheres, cylinders, capsules or meshes"
        )
    element = ET.SubElement(link, kind)
    add_origin(element, R, p)
    ET.SubElement(ET.SubElement(element, "geometry"), attributes[0], attrib=attributes[1])


def _mesh(
    source: MjcfSource, mesh: int
) -> tuple[tuple[str, dict[str, str]], FloatArray, FloatArray]:
    """Return a mesh's element, and the pose of its file's frame in MuJoCo's own for it."""
    model = source.model
    name = model.mesh(mesh).name
    asset = source.spec.mesh(name)
    scale, (about, origin) = (
        np.array(asset.scale),
        rotation_and_position(asset.refquat, asset.refpos),
    )
    if not asset.file:
        raise RobotError(
            f"{source.path}: the mesh {name!r} has no file; write its vertices into one"
        )
    if np.ptp(scale) > 0.0 and not np.allclose(about, np.eye(3)):
        raise RobotError(
            f"{source.path}: the mesh {name!r} is turned and then scaled by {asset.scale}, "
            "different along its axes; turn its file instead"
        )
    # MuJoCo's vertex is R_m^T (S R_ref^T (v - p_ref) - p_m) of the file's v.
    turned, moved = rotation_and_position(model.mesh_quat[mesh], model.mesh_pos[mesh])
    folder = Path(source.spec.modelfiledir or source.path.parent)
    file = folder / source.spec.compiler.meshdir / asset.file
    attributes = {"filename": str(file.resolve()), "scale": words(scale)}
    return (
        ("mesh", attributes),
        turned.T @ about.T,
        -turned.T @ (scale * (about.T @ origin) + moved),
    )
