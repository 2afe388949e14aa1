"""Mesh files of links: read, or missing with what to do about it."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.errors import MeshError
from graspless_pin.geometry.bodies.meshes import scaled_mesh
from graspless_pin.geometry.hand.robot_model import LinkMesh
from graspless_pin.problem.checks import FloatArray
from graspless_pin.suggestions import first_of, nearest_name

if TYPE_CHECKING:
    import trimesh

_MOST_PLACES = 3
"""That a message names, of those where a mesh was looked for."""
_ALIKE = 0.75
"""How much names of files are, of which one was probably meant."""
FLATNESS = 1e-7
"""Thickness over length below which a mesh (single-precision vertices) has no volume."""


NEEDED_SCALE = 'needs scale="0.001 0.001 0.001" in the URDF'
"""What a mesh in millimetres needs."""


def load_link_mesh(label: str, link: str, mesh: LinkMesh) -> trimesh.Trimesh:
    """Read a link's collision mesh in metres; do not change what is returned.

    Args:
        label: The robot's file, for the message.
        link: The link.
        mesh: The mesh.

    Raises:
        MeshError: If it is missing or cannot be read.
    """
    if mesh.file is None:
        raise MeshError(
            f"{label}: link {link!r} needs the collision mesh {mesh.written!r}, which is missing "
            f"(looked for {looked_for(mesh)}); {what_to_do(mesh)}"
        )
    try:
        return scaled_mesh(mesh.file, mesh.scale, upright=False)
    except MeshError as error:
        raise MeshError(
            f"{label}: the collision mesh {mesh.file} of link {link!r}: {error}"
        ) from error


def looked_for(mesh: LinkMesh) -> str:
    """Return where a mesh was looked for, in words: the likeliest places."""
    return first_of([*map(str, mesh.looked)], _MOST_PLACES) or "nowhere"


def what_to_do(mesh: LinkMesh) -> str:
    """Return what to do about a mesh that is missing: the name that was probably meant, if any."""
    # Of each place what is not there: folders and the file; and the folder that holds them not.
    missing: list[tuple[tuple[str, ...], Path]] = []
    for place in mesh.looked:
        with suppress(OSError, ValueError):  # no file can have such a name
            folder = next(one for one in place.parents if one.is_dir())
            missing.append((place.relative_to(folder).parts, folder))
    for parts, folder in sorted(missing, key=lambda one: len(one[0])):
        with suppress(OSError):  # a folder that nobody may look into
            is_folder = len(parts) > 1
            known = [item.name for item in folder.iterdir() if item.is_dir() == is_folder]
            if near := nearest_name(parts[0], known, _ALIKE):
                return f"did you mean {near!r}?"
    scheme, _, address = mesh.written.partition("://")
    package = Path(address).parts
    if scheme == "package" and not any(len(parts) < len(package) for parts, _ in missing):
        return "give package_dirs, the folder that holds the package"
    return "put the file there or correct the path"


def is_flat(vertices: FloatArray) -> bool:
    """Return whether (V, 3) vertices lie in one plane; coal would crash on their hull."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return len(extents) < 3 or bool(extents[2] <= FLATNESS * extents[0])
