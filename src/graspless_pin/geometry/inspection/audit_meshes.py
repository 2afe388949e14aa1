"""The part of an audit that looks at the meshes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import trimesh

from graspless_pin.errors import MeshError, RobotError
from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.mesh_files import MESH, dae_frame
from graspless_pin.geometry.bodies.meshes import LARGEST_MESH, SMALLEST_MESH
from graspless_pin.geometry.hand.link_shapes import is_flat, load_link_mesh
from graspless_pin.geometry.hand.urdf_links import LinkMesh, find_mesh, looked_for, numbers
from graspless_pin.geometry.robots.description import RobotDescription
from graspless_pin.intake.files import read_bytes

_HOLLOW = 2.0  # hull over mesh in volume: below, cutting a link rarely changes what it touches


def audit_meshes(robot: RobotDescription, root: ET.Element) -> Iterator[Finding]:
    """Find meshes that are missing, of a strange size, unusable or far from convex.

    Args:
        robot: The robot, for its paths.
        root: Its ``<robot>`` element.

    Yields:
        The findings, link by link.
    """
    relative: list[str] = []
    for link in root.findall("link"):
        for use in ("collision", "visual"):
            for mesh in link.findall(f"{use}/geometry/mesh"):
                yield from _audit_mesh(robot, link.get("name", ""), use, mesh)
                written = mesh.get("filename", "")
                if "://" not in written and not Path(written).is_absolute():
                    relative.append(written)
    if relative:
        count, example = len(relative), relative[0]
        yield Finding(
            FindingCode.RELATIVE_MESH,
            "robot",
            f"paths of meshes are relative to the URDF's folder: {count}, such as {example!r}",
            "nothing to do here; Pinocchio alone and most ROS tools need package:// or file://",
        )
    yield from _audit_axes(robot, root.findall("link/collision/geometry/mesh"))


def _audit_axes(robot: RobotDescription, meshes: Sequence[ET.Element]) -> Iterator[Finding]:
    """Find DAEs of which another axis than z is up: one finding for all."""
    said = {}
    for mesh in meshes:
        file, _ = find_mesh(robot.urdf_path, mesh.get("filename", ""), robot.package_dirs)
        if file is not None and file.suffix.lower() == ".dae":
            with suppress(MeshError):  # found already
                said[file.name] = dae_frame(file, read_bytes(file, MESH))[1]
    turned = [f"{name} ({up})" for name, up in said.items() if up not in ("", "Z_UP")]
    if turned:
        more = f" and {len(turned) - 3} more" if len(turned) > 3 else ""
        yield Finding(
            FindingCode.MESH_AXES,
            "robot",
            f"collision meshes say that another axis than z is up: {', '.join(turned[:3])}{more}",
            "nothing to do if the robot looks right: readers of URDF leave its meshes as they are, "
            "and so does this one",
        )


def _audit_mesh(
    robot: RobotDescription, link: str, use: str, mesh: ET.Element
) -> Iterator[Finding]:
    """Audit one mesh of a link."""
    written = mesh.get("filename", "")
    where = f"link {link}, {use}"
    file, looked = find_mesh(robot.urdf_path, written, robot.package_dirs)
    if file is None:
        grave = "the robot cannot be loaded" if use == "collision" else "only drawing needs it"
        yield Finding(
            FindingCode.MISSING_MESH if use == "collision" else FindingCode.MISSING_VISUAL,
            where,
            f"{written!r} is missing (looked for {looked_for(looked)}); {grave}",
            "give package_dirs, the folder that holds the package"
            if written.startswith("package://")
            else "put the file there or correct the path",
        )
        return
    if use == "visual":
        return
    try:
        x, y, z = numbers(where, "scale", mesh.get("scale", "1 1 1"), 3)
        loaded = load_link_mesh(LinkMesh(link, 0, file, (x, y, z)), str(robot.urdf_path))
        vertices = np.array(loaded.vertices)
    except (MeshError, RobotError) as error:
        yield Finding(FindingCode.UNUSABLE_MESH, where, str(error), "export the mesh again as STL")
        return
    extent = float(np.ptp(vertices, axis=0).max())
    if not SMALLEST_MESH <= extent <= LARGEST_MESH:
        yield Finding(
            FindingCode.MESH_SCALE,
            where,
            f"{file.name} with scale {mesh.get('scale', '1 1 1')} is {extent:.3g} m large",
            'lengths are metres: a mesh in millimetres needs scale="0.001 0.001 0.001"',
        )
    if is_flat(vertices):
        yield Finding(
            FindingCode.UNUSABLE_MESH,
            where,
            f"{file.name} lies in one plane and has no volume",
            "give it a thickness or use a box",
        )
    elif not _is_cut(robot, link):
        yield from _audit_hollows(where, link, file.name, loaded)


def _is_cut(robot: RobotDescription, link: str) -> bool:
    """Return whether the robot file has a link's meshes cut into convex pieces."""
    convex = robot.meshes.convex
    return (convex.get(link) if isinstance(convex, Mapping) else convex) == "decompose"


def _audit_hollows(where: str, link: str, name: str, mesh: trimesh.Trimesh) -> Iterator[Finding]:
    """Find a mesh that its hull fills out by far; only of a closed one the volume is known."""
    if not (mesh.is_watertight and mesh.is_winding_consistent and mesh.volume != 0.0):
        return
    ratio = float(mesh.convex_hull.volume / abs(mesh.volume))
    if ratio > _HOLLOW:
        yield Finding(
            FindingCode.HOLLOW_MESH,
            where,
            f"the convex hull of {name}, which stands for it, has {ratio:.1f} times its volume",
            f"if its hollows matter, give 'convex: {{{link}: decompose}}' in the scene's hand or "
            "in a robot file",
        )
