"""Parse mesh files, and the files that they name, within bounds; errors name the fault."""

from __future__ import annotations

import gc
import io
import logging
import re
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

import numpy as np
import trimesh
from trimesh.resolvers import Resolver

from graspless_pin.bounds import LARGEST_LENGTH, SMALLEST_LENGTH
from graspless_pin.errors import MeshError, TextError
from graspless_pin.intake.files import FileKind, is_file, read_bytes
from graspless_pin.intake.text import parse_xml

MESH_FORMATS = (".stl", ".obj", ".dae", ".glb", ".gltf", ".ply", ".off")
_PARTIAL_READS = ("failed to populate", "placeholder zeros")  # trimesh only logs these faults
_LARGE_FILE = 4 << 20  # bytes
_UNIT = re.compile(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']")
_UP_AXIS = re.compile(rb"<up_axis>\s*([XYZ]_UP)\s*</up_axis>")
_NUMBER = re.compile(r"\s*\+?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?\s*")
_TO_Z_UP = {
    "X_UP": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}
UP_AXIS = "up_axis"
"""Key in the metadata of a rotated mesh: the up axis that its file states."""
MESH = FileKind("mesh file", 64, MeshError)


def parse_mesh(path: Path, *, upright: bool) -> Any:
    """Return the mesh that trimesh parses from a file's bytes; trimesh opens no file itself.

    Args:
        path: The file.
        upright: Whether the up axis that a DAE states becomes z.

    Raises:
        MeshError: If a file cannot be opened (see `read_bytes`), XML exceeds its bounds, or a DAE
            states an invalid unit.
        Exception: Any exception of trimesh's readers.
    """
    content = read_bytes(path, MESH)
    ending = path.suffix.lower()
    if ending == ".dae":
        _check_dae(path, content)
    resolver = _FolderResolver(path) if ending == ".gltf" else None
    # Unprocessed: trimesh would remove faulty vertices, which are to be reported.
    captured = _CapturedMessages()
    trimesh.util.log.addFilter(captured)
    try:
        # trimesh warns of far coordinates; `load_mesh` refuses them.
        with np.errstate(invalid="ignore", over="ignore"):
            mesh = trimesh.load_mesh(
                io.BytesIO(content), file_type=ending[1:], resolver=resolver, process=False
            )
    finally:
        trimesh.util.log.removeFilter(captured)
    if len(content) > _LARGE_FILE:
        gc.collect()  # trimesh leaves three times the file's size in cycles
    for message in captured.messages:
        if any(fault in message for fault in _PARTIAL_READS):
            raise MeshError(f"mesh file '{path}' can only be read in part ({message})")
    if ending == ".dae" and isinstance(mesh, trimesh.Trimesh):
        meter, up = dae_frame(path, content)
        T = np.diag([meter, meter, meter, 1.0])
        if upright and up in _TO_Z_UP:
            T[:3, :3] = meter * _TO_Z_UP[up]
            mesh.metadata[UP_AXIS] = up
        mesh.apply_transform(T)
    return mesh


def dae_frame(path: Path, content: bytes) -> tuple[float, str]:
    """Return a DAE's unit, m, and up axis, such as ``Y_UP``; 1 and an empty text if not stated.

    Raises:
        MeshError: If the unit is not a positive number.
    """
    unit, up = _UNIT.search(content), _UP_AXIS.search(content)
    text = "1" if unit is None else unit[1].decode(errors="replace")
    meter = float(text) if _NUMBER.fullmatch(text) else 0.0
    if not SMALLEST_LENGTH <= meter <= LARGEST_LENGTH:
        raise MeshError(
            f"mesh file '{path}' states the unit {text[:40]!r}; it must be a length in metres"
        )
    return meter, "" if up is None else up[1].decode()


class _CapturedMessages(logging.Filter):
    """Collects trimesh's log messages instead of logging them; some report missing vertices."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[str] = []

    def filter(self, record: logging.LogRecord) -> bool:
        self.messages.append(record.getMessage())
        return False


class _FolderResolver(Resolver):
    """Resolves files that a mesh names, in the mesh's own folder or below."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def get(self, key: str) -> bytes:
        return read_bytes(_resolved_file(self._path, key), MESH)

    def keys(self) -> list[str]:
        return []

    def namespaced(self, namespace: str) -> _FolderResolver:
        raise NotImplementedError(namespace)

    def write(self, name: str, data: Any) -> None:
        raise NotImplementedError(name)


def _resolved_file(path: Path, name: str) -> Path:
    """Return the file that a mesh names, which must be in the mesh's own folder or below."""
    relative = PurePosixPath(unquote(name).replace("\\", "/"))
    if relative.is_absolute() or ".." in relative.parts or "\0" in name or ":" in name:
        raise MeshError(
            f"mesh file '{path}' names the file {name[:100]!r}; only files in its own folder "
            "are opened"
        )
    file = path.parent / relative
    if not is_file(file) and not _is_missing(file):
        raise MeshError(f"mesh file '{path}' names {name[:100]!r}, which is not a regular file")
    return file


def _is_missing(file: Path) -> bool:
    try:
        return not file.exists()
    except OSError:
        return True


def _check_dae(path: Path, content: bytes) -> None:
    try:
        parse_xml(content)
    except TextError as error:
        if "DOCTYPE" in str(error):
            raise MeshError(
                f"mesh file '{path}' declares XML entities; export it without a DOCTYPE"
            ) from None
        raise MeshError(f"mesh file '{path}' cannot be read as DAE: {error}") from None
