"""Non-convex meshes as several convex pieces, remembered on disk.

CoACD cuts a mesh until each piece is nearly convex, in a process of its own that is ended when its
time is up: for some small or open meshes it would take minutes. Its pieces are kept in
``$XDG_CACHE_HOME/graspless_pin/convex`` (by default below ``~/.cache``), named after the mesh's
triangles and the way it was cut: a changed file is another mesh. The folder can be deleted at any
time.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import io
import os
import time
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from graspless_pin.atomic_write import draft_of
from graspless_pin.bounds import LONGEST_TIME
from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import (
    ArgumentError,
    CrashError,
    MeshError,
    OverrunError,
)
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.bodies.meshes import (
    hull_corners,
    simplified_for_cutting,
    turned_outward,
)
from graspless_pin.geometry.bodies.polytopes import hull_of
from graspless_pin.geometry.outside_calls import ITERATIONS, SEED, run_coacd
from graspless_pin.intake.fields import Seconds, no_truth_value
from graspless_pin.problem.checks import FloatArray, read_only, real_number, whole_number
from graspless_pin.progress import waiting_for

if TYPE_CHECKING:
    import trimesh

DEFAULT_CONCAVITY = 0.02
"""Deepest hollow that a piece may fill, as a share of half the mesh's largest extent."""

DEFAULT_TIME_LIMIT = 60.0
"""Seconds that the cut of one mesh may take."""

MOST_PIECES = 1000
"""More convex pieces than any mesh needs."""

Convex = Literal["hull", "decompose"]
WAYS = get_args(Convex)
"""How meshes are made convex."""
Concavity = Annotated[
    float,
    Field(
        ge=0.01,
        le=1.0,
        description="[1] coarseness of the cut into convex pieces: smaller is finer",
    ),
    BeforeValidator(no_truth_value),
]
DecomposeTimeLimit = Annotated[
    Seconds, Field(description="[s] time that the cut of each mesh may take")
]
MaxPieces = Annotated[
    int,
    Field(ge=1, le=MOST_PIECES, description="most convex pieces of each mesh; default: no limit"),
    BeforeValidator(no_truth_value),
]

_CONVEX = 1.0 - 1e-6  # share of its hull that a mesh fills if it is convex
_UNREADABLE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True)
class Cut:
    """How a mesh is cut.

    Attributes:
        concavity: Deepest hollow that a piece may fill, as a share of half the mesh's largest
            extent; CoACD takes 0.01 to 1.
        time_limit: Seconds that the cut of one mesh may take, at most 1e6.
        max_pieces: Most pieces of one mesh, 1 to 1000: pieces are merged, and more hollows filled,
            until there are no more; None: as many as the concavity takes.
    """

    concavity: float = DEFAULT_CONCAVITY
    time_limit: float = DEFAULT_TIME_LIMIT
    max_pieces: int | None = None

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ArgumentError: One is outside its range; named as scenes and robot files name it.
        """
        if not 0.01 <= real_number("concavity", self.concavity, -np.inf) <= 1.0:
            raise ArgumentError("concavity", f"needs 0.01 to 1, got {self.concavity!r}")
        seconds = real_number("decompose_time_limit", self.time_limit, -np.inf)
        if not 0.0 < seconds <= LONGEST_TIME:
            raise ArgumentError(
                "decompose_time_limit",
                f"needs seconds above 0, at most {LONGEST_TIME:g}, got {self.time_limit!r}",
            )
        if self.max_pieces is not None:
            whole_number("max_pieces", self.max_pieces, 1, MOST_PIECES)


def convex_pieces(mesh: trimesh.Trimesh, label: str, cut: Cut = Cut()) -> tuple[FloatArray, ...]:
    """Cut a mesh into convex pieces, or look up how it was cut before.

    Args:
        mesh: Triangle mesh.
        label: What messages call it.
        cut: How it is cut.

    Returns:
        Corners (V, 3) of each piece's convex hull; one piece if the mesh is convex. Read-only.

    Raises:
        MeshError: The mesh encloses no volume, or CoACD finds no piece, takes longer than the time
            limit or crashes.

    Warns:
        GrasplessPinWarning: The mesh is not watertight, or so dense that it is simplified, or the
            pieces cannot be kept on disk.
    """
    import trimesh

    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    hull, simplified = hull_corners(vertices, label)
    if _is_convex(mesh):
        emit(*simplified)
        return (read_only(hull),)
    vertices, faces, simplified = simplified_for_cutting(vertices, faces, label)
    if simplified:
        emit(*simplified)
        mesh = trimesh.Trimesh(vertices, faces, process=False)
    if not mesh.is_watertight:
        emit(
            Finding(
                FindingCode.OPEN_MESH,
                label,
                f"{label} is not watertight: its convex pieces are those of a skin around it, "
                "which may be off by a hundredth of its size",
                "repair it, or use its convex hull",
            )
        )
    file = _cache_folder() / f"{_key(vertices, faces, cut)}.npz"
    known = _read(file)
    if known is not None:
        return known
    how_long = f"for {cut.time_limit:g} s at most"
    with waiting_for(f"cutting {label} into convex pieces, {how_long}", everywhere=True):
        pieces = _cut(mesh, label, cut)
    _write(file, pieces)
    return pieces


def _is_convex(mesh: trimesh.Trimesh) -> bool:
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        return False
    return abs(mesh.volume) >= _CONVEX * mesh.convex_hull.volume


def _cut(mesh: trimesh.Trimesh, label: str, cut: Cut) -> tuple[FloatArray, ...]:
    pieces: list[FloatArray] = []
    for corners in _corners(mesh, label, cut):
        with suppress(MeshError):  # a sliver without volume touches nothing that others do not
            pieces.append(read_only(hull_of(corners).vertices))
    if not pieces:
        raise MeshError(
            f"{label} cannot be cut into convex pieces; repair it, or use its convex hull"
        )
    return tuple(pieces)


def _corners(mesh: trimesh.Trimesh, label: str, cut: Cut) -> Iterator[FloatArray]:
    """Corners of the pieces of all parts."""
    end = time.monotonic() + cut.time_limit
    parts = _parts(mesh)
    # Of what CoACD calls a limit none is -1; each part keeps at least one piece.
    spare = None if cut.max_pieces is None else cut.max_pieces - len(parts)
    if spare is not None and spare < 0:
        raise MeshError(
            f"{label} has {len(parts)} parts that are not connected, more than max_pieces, "
            f"{cut.max_pieces}; raise it, or use its convex hull"
        )
    with ChildProcess() as child:
        for part in parts:
            if _is_convex(part):
                yield np.array(part.vertices, dtype=np.float64)
                continue
            most = -1 if spare is None else spare + 1
            arguments = np.array(part.vertices), np.array(part.faces), cut.concavity, most
            seconds = max(end - time.monotonic(), 0.0)
            try:
                pieces = child.call(run_coacd, *arguments, limit=seconds)
            except OverrunError:
                raise MeshError(
                    f"{label} is not cut into convex pieces after {cut.time_limit:g} s; simplify "
                    "or repair it, raise 'concavity' or 'decompose_time_limit', or use its convex "
                    "hull"
                ) from None
            except CrashError as error:
                raise MeshError(
                    f"{label} cannot be cut into convex pieces: {error}; repair it, or use its "
                    "convex hull"
                ) from None
            spare = None if spare is None else spare + 1 - len(pieces)
            yield from pieces


def _parts(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Solids of a mesh that are not connected; the whole mesh if it is open or has hollows.

    CoACD would wrap solids that touch in a common skin, which is off by a hundredth of their size.
    """
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        return [mesh]
    mesh = turned_outward(mesh)
    parts = [mesh] if mesh.body_count == 1 else list(mesh.split())
    return [mesh] if any(part.volume < 0.0 for part in parts) else parts  # there are hollows


def _cache_folder() -> Path:
    given = os.environ.get("XDG_CACHE_HOME", "")
    # The standard says that a relative path is to be ignored.
    base = Path(given) if Path(given).is_absolute() else Path("~/.cache").expanduser()
    return base / "graspless_pin" / "convex"


def _key(vertices: FloatArray, faces: NDArray[np.integer[Any]], cut: Cut) -> str:
    version = importlib.metadata.version("coacd")
    settings = f"coacd {version} {cut.concavity!r} {ITERATIONS} {SEED} {len(vertices)}"
    if cut.max_pieces is not None:
        settings += f" {cut.max_pieces}"
    digest = hashlib.sha256(settings.encode())
    digest.update(vertices.tobytes())
    digest.update(faces.tobytes())
    return digest.hexdigest()


def _read(file: Path) -> tuple[FloatArray, ...] | None:
    """Pieces in a file; None if there is none or it is damaged."""
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as archive:
            points = np.asarray(archive["points"], dtype=np.float64)
            counts = np.asarray(archive["counts"], dtype=np.int32)
    except _UNREADABLE:
        return None
    is_valid = (
        points.ndim == 2
        and points.shape[1] == 3
        and counts.ndim == 1
        and len(counts) > 0
        and int(counts.min()) >= 4
        and int(counts.sum()) == len(points)
        and bool(np.isfinite(points).all())
    )
    return tuple(map(read_only, np.split(points, np.cumsum(counts)[:-1]))) if is_valid else None


def _write(file: Path, pieces: tuple[FloatArray, ...]) -> None:
    """Write pieces so that no other process ever sees half a file."""
    counts = np.array([len(piece) for piece in pieces])
    try:
        with draft_of(file) as draft, draft.open("wb") as stream:
            np.savez(stream, points=np.concatenate(pieces), counts=counts)
    except OSError as error:
        emit(
            Finding(
                FindingCode.NO_CACHE,
                str(file.parent),
                f"convex pieces cannot be kept in '{file.parent}' ({error}) and will be cut again "
                "next time",
                "set XDG_CACHE_HOME to a folder that can be written",
            )
        )
