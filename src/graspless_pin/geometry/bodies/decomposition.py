"""Convex decomposition of meshes, cached on disk.

CoACD cuts a mesh until each piece is nearly convex, in a child process that is ended after a time
limit: for some small or open meshes it would take minutes. The pieces are cached in
``$XDG_CACHE_HOME/graspless_pin/convex`` (by default below ``~/.cache``) under a hash of the mesh's
triangles and the settings of the decomposition, so that a changed file is cut again. The folder
can be deleted at any time.
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
    with_outward_faces,
)
from graspless_pin.geometry.bodies.polytopes import hull_polytope
from graspless_pin.geometry.outside_calls import ITERATIONS, SEED, run_coacd
from graspless_pin.intake.fields import Seconds, no_truth_value
from graspless_pin.problem.checks import FloatArray, read_only, real_number, whole_number
from graspless_pin.progress import waiting_for

if TYPE_CHECKING:
    import trimesh

DEFAULT_CONCAVITY = 0.02
"""Largest depth of a hollow that a piece may fill over half the mesh's largest extent."""

DEFAULT_TIME_LIMIT = 60.0
"""Time limit of the decomposition of one mesh, s."""

MOST_PIECES = 1000
"""Upper bound of ``max_pieces``."""

Convex = Literal["hull", "decompose"]
WAYS = get_args(Convex)
"""The ways of making a mesh convex."""
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
    Seconds, Field(description="[s] time limit for cutting each mesh into convex pieces")
]
MaxPieces = Annotated[
    int,
    Field(
        ge=1,
        le=MOST_PIECES,
        description="largest number of convex pieces of each mesh; default: no limit",
    ),
    BeforeValidator(no_truth_value),
]

_CONVEX_SHARE = 1.0 - 1e-6  # volume of a mesh over that of its hull from which on it is convex
_READ_ERRORS = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True)
class Cut:
    """Settings of the convex decomposition of a mesh.

    Attributes:
        concavity: Largest depth of a hollow that a piece may fill, as a share of half the mesh's
            largest extent; CoACD takes 0.01 to 1.
        time_limit: Time limit of the decomposition of one mesh, s, at most 1e6.
        max_pieces: Largest number of pieces of one mesh, 1 to 1000: pieces are merged, and more
            hollows filled, until there are no more; None: no limit but the concavity.
    """

    concavity: float = DEFAULT_CONCAVITY
    time_limit: float = DEFAULT_TIME_LIMIT
    max_pieces: int | None = None

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ArgumentError: A number is outside its range; named as in scenes and robot files.
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
    """Cut a mesh into convex pieces, or read them from the cache.

    Args:
        mesh: Triangle mesh.
        label: The name of the mesh in messages.
        cut: Settings of the decomposition.

    Returns:
        Vertices (V, 3) of each piece's convex hull; one piece if the mesh is convex. Read-only.

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
    hull, findings = hull_corners(vertices, label)
    if _is_convex(mesh):
        emit(*findings)
        return (read_only(hull),)
    vertices, faces, findings = simplified_for_cutting(vertices, faces, label)
    if findings:
        emit(*findings)
        mesh = trimesh.Trimesh(vertices, faces, process=False)
    if not mesh.is_watertight:
        emit(
            Finding(
                FindingCode.OPEN_MESH,
                label,
                f"{label} is not watertight: its convex pieces are those of a closed surface "
                "around it, up to about 1 % of its size away",
                "repair it, or use its convex hull",
            )
        )
    file = _cache_folder() / f"{_cache_key(vertices, faces, cut)}.npz"
    cached = _read(file)
    if cached is not None:
        return cached
    time_words = f"for {cut.time_limit:g} s at most"
    with waiting_for(f"cutting {label} into convex pieces, {time_words}", everywhere=True):
        pieces = _cut_pieces(mesh, label, cut)
    _write(file, pieces)
    return pieces


def _is_convex(mesh: trimesh.Trimesh) -> bool:
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        return False
    return abs(mesh.volume) >= _CONVEX_SHARE * mesh.convex_hull.volume


def _cut_pieces(mesh: trimesh.Trimesh, label: str, cut: Cut) -> tuple[FloatArray, ...]:
    pieces: list[FloatArray] = []
    for corners in _piece_corners(mesh, label, cut):
        with suppress(MeshError):  # a sliver without volume: the other pieces cover its contacts
            pieces.append(read_only(hull_polytope(corners).vertices))
    if not pieces:
        raise MeshError(
            f"{label} cannot be cut into convex pieces; repair it, or use its convex hull"
        )
    return tuple(pieces)


def _piece_corners(mesh: trimesh.Trimesh, label: str, cut: Cut) -> Iterator[FloatArray]:
    """Yield the vertices (V, 3) of the convex pieces of all connected solids."""
    end = time.monotonic() + cut.time_limit
    solids = _connected_solids(mesh)
    # CoACD takes -1 for no limit; each solid keeps at least one piece.
    spare_pieces = None if cut.max_pieces is None else cut.max_pieces - len(solids)
    if spare_pieces is not None and spare_pieces < 0:
        raise MeshError(
            f"{label} has {len(solids)} unconnected parts, more than max_pieces "
            f"({cut.max_pieces}); raise max_pieces, or use its convex hull"
        )
    with ChildProcess() as child:
        for solid in solids:
            if _is_convex(solid):
                yield np.array(solid.vertices, dtype=np.float64)
                continue
            max_pieces = -1 if spare_pieces is None else spare_pieces + 1
            arguments = np.array(solid.vertices), np.array(solid.faces), cut.concavity, max_pieces
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
            spare_pieces = None if spare_pieces is None else spare_pieces + 1 - len(pieces)
            yield from pieces


def _connected_solids(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Return the connected solids of a mesh; the whole mesh if it is open or has hollows.

    CoACD would wrap touching solids in a common skin, which is off by a hundredth of their size.
    """
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        return [mesh]
    mesh = with_outward_faces(mesh)
    parts = [mesh] if mesh.body_count == 1 else list(mesh.split())
    return [mesh] if any(part.volume < 0.0 for part in parts) else parts  # there are hollows


def _cache_folder() -> Path:
    cache_home = os.environ.get("XDG_CACHE_HOME", "")
    # The XDG standard requires that a relative path is ignored.
    base = Path(cache_home) if Path(cache_home).is_absolute() else Path("~/.cache").expanduser()
    return base / "graspless_pin" / "convex"


def _cache_key(vertices: FloatArray, faces: NDArray[np.integer[Any]], cut: Cut) -> str:
    version = importlib.metadata.version("coacd")
    settings = f"coacd {version} {cut.concavity!r} {ITERATIONS} {SEED} {len(vertices)}"
    if cut.max_pieces is not None:
        settings += f" {cut.max_pieces}"
    digest = hashlib.sha256(settings.encode())
    digest.update(vertices.tobytes())
    digest.update(faces.tobytes())
    return digest.hexdigest()


def _read(file: Path) -> tuple[FloatArray, ...] | None:
    """Return the pieces cached in a file; None if there is no file or it is damaged."""
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as archive:
            points = np.asarray(archive["points"], dtype=np.float64)
            counts = np.asarray(archive["counts"], dtype=np.int32)
    except _READ_ERRORS:
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
    """Write pieces atomically: no other process sees an incomplete file."""
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
