"""Open mesh files, and the files that these name, within bounds; say what is wrong with one."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

import trimesh
from trimesh.resolvers import Resolver

from graspless_pin.errors import MeshError, TextError
from graspless_pin.intake.files import FileKind, check_file, is_file, read_bytes
from graspless_pin.intake.xml_text import check_xml

MESH_FORMATS = (".stl", ".obj", ".dae", ".glb", ".gltf", ".ply", ".off")
MESH = FileKind("mesh file", 64, MeshError)
_NAMING = (".obj", ".dae", ".glb", ".gltf")  # formats that name other files or are XML
_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)


def unknown_format(path: Path) -> MeshError:
    """Return the error for a file whose ending is not one of `MESH_FORMATS`."""
    return MeshError(
        f"mesh file '{path}' has the unknown ending '{path.suffix}'; "
        f"use one of {', '.join(MESH_FORMATS)}"
    )


def parse_mesh(path: Path) -> Any:
    """Return what trimesh makes of a mesh file; it gets bytes and opens nothing itself.

    Raises:
        MeshError: If a file cannot be opened (see `read_bytes`), or XML breaks its bounds.
        Exception: Whatever the readers behind trimesh raise.
    """
    content = read_bytes(path, MESH)
    ending = path.suffix.lower()
    if ending == ".dae":
        _check_dae(path, content)
    resolver = _Beside(path) if ending == ".gltf" else None
    return trimesh.load_mesh(io.BytesIO(content), file_type=ending[1:], resolver=resolver)


def check_mesh_file(path: Path) -> None:
    """Check a mesh file that another library will open by its path, and the files that it names.

    Raises:
        MeshError: If one is no regular file or too large, is not beside the mesh, or XML breaks
            its bounds.
    """
    ending = path.suffix.lower()
    if ending not in MESH_FORMATS:
        raise unknown_format(path)
    check_file(path, MESH)
    if ending not in _NAMING:
        return
    content = read_bytes(path, MESH)
    if ending == ".dae":
        _check_dae(path, content)
        return
    if ending == ".obj":
        names = [name.decode("utf-8", "replace").strip() for name in _LIBRARY.findall(content)]
    else:
        names = _addresses(content[max(content.find(b"{"), 0) :])
    for name in names:
        file = _beside(path, name)
        if is_file(file):  # a missing library of colours is nobody's loss
            check_file(file, MESH)


class _Beside(Resolver):
    """Gives trimesh the files of a mesh's own folder, and of folders in it."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def get(self, key: str) -> bytes:
        return read_bytes(_beside(self._path, key), MESH)

    def keys(self) -> list[str]:
        return []

    def namespaced(self, namespace: str) -> _Beside:
        raise NotImplementedError(namespace)

    def write(self, name: str, data: Any) -> None:
        raise NotImplementedError(name)


def _beside(path: Path, name: str) -> Path:
    """Return the file that a mesh names, which must be in the mesh's own folder."""
    inside = PurePosixPath(unquote(name).replace("\\", "/"))
    if inside.is_absolute() or ".." in inside.parts or "\0" in name or ":" in name:
        raise MeshError(
            f"mesh file '{path}' names the file {name[:100]!r}; only files beside it are opened"
        )
    file = path.parent / inside
    if not is_file(file) and not _is_missing(file):
        raise MeshError(f"mesh file '{path}' names {name[:100]!r}, which is no regular file")
    return file


def _is_missing(file: Path) -> bool:
    try:
        return not file.exists()
    except OSError:
        return True


def _addresses(content: bytes) -> list[str]:
    """Return the files that the JSON of a glTF names; none if it cannot be read."""
    try:
        tree, _ = json.JSONDecoder().raw_decode(content.decode("utf-8", "replace"))
        items = [*tree.get("buffers", []), *tree.get("images", [])]
        found = [item.get("uri") for item in items]
    except (ValueError, AttributeError, TypeError, RecursionError):
        return []
    return [uri for uri in found if isinstance(uri, str) and not uri.startswith("data:")]


def _check_dae(path: Path, content: bytes) -> None:
    try:
        check_xml(content)
    except TextError as error:
        if "DOCTYPE" in str(error):
            raise MeshError(
                f"mesh file '{path}' declares XML entities; export it without a DOCTYPE"
            ) from None
        raise MeshError(f"mesh file '{path}' cannot be read as DAE: {error}") from None
