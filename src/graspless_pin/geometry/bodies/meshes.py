"""Mesh files: reading them, their convex hulls, and what their size says about their unit.

Dense ones get hulls of few corners within a tolerance, and surfaces of fewer triangles. Shapes and
collision geometries are drawn as meshes, too: `Triangles`, metres, outward faces.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.bounds import LARGEST_LENGTH, SMALLEST_LENGTH
from graspless_pin.errors import MeshError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.bodies.polytopes import hull_of, qhull
from graspless_pin.intake.files import note_read
from graspless_pin.problem.checks import FloatArray, read_only

if TYPE_CHECKING:
    import trimesh


DENSE_MESH = 20_000
"""Vertices up to which a hull keeps all its corners."""
HULL_TOLERANCE = 2e-4
"""How far a corner of a denser mesh stands out that its hull leaves out, as a share of its size."""

DENSE_CUT = 10_000
"""Triangles up to which a mesh is cut into convex pieces as it is."""

_SIMPLIFIED_SIZE = 100.0  # fast_simplification's thresholds are absolute, and made for such lengths
_VERTICES_AT_ONCE = 20_000  # vertices
_NEAREST_TRIANGLES = 4  # triangles
_DOT_RADIUS = 1e-9  # m


def hull_corners(vertices: FloatArray, what: str) -> tuple[FloatArray, tuple[Finding, ...]]:
    """Return the corners (K, 3) of the convex hull of (V, 3) vertices, and what is to be told.

    Args:
        vertices: In metres.
        what: What messages call the mesh.

    Returns:
        The corners, some of the vertices. Of more than `DENSE_MESH` vertices, those that stand out
        by less than `HULL_TOLERANCE` of the mesh's size are left out; the finding has how far the
        mesh then stands out of the hull, measured at all vertices.

    Raises:
        MeshError: All vertices lie in one plane.
    """
    if len(vertices) <= DENSE_MESH:
        return hull_of(vertices, what).vertices, ()

    size = float(np.ptp(vertices, axis=0).max())
    # Qhull takes no point for a corner that is less than this above a face.
    hull = qhull(vertices, what, f"Qt W{HULL_TOLERANCE * size:.17g}")
    corners = vertices[hull.vertices]
    # Each vertex is measured to the triangles near it, which is never too little, and where that is
    # not within the tolerance, to the hull.
    points = coal.StdVec_Vec3s()
    points.extend(corners)
    solid = coal.Convex.convexHull(points, False, "Qt")  # noqa: FBT003 - no triangles
    triangles, planes = hull.points[hull.simplices], hull.equations
    omitted = _farthest(vertices, triangles, solid, HULL_TOLERANCE * size, planes)
    found = Finding(
        FindingCode.SIMPLIFIED_HULL,
        what,
        f"{what} has {len(vertices)} vertices: the {len(corners)} corners of the hull that stands "
        f"for it leave out up to {1e3 * omitted:.2g} mm",
        "give a mesh of fewer vertices where contacts have to be nearer than that",
    )
    return corners, (found,)


def with_fewer_triangles(
    vertices: FloatArray, faces: NDArray[np.integer[Any]], most: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return vertices and faces of a surface that is simplified by quadric errors.

    Args:
        vertices: (V, 3) m.
        faces: (F, 3) indices.
        most: Triangles that are aimed at.
    """
    import fast_simplification

    low, scale = vertices.min(axis=0), np.ptp(vertices, axis=0).max() / _SIMPLIFIED_SIZE
    scaled = np.ascontiguousarray((vertices - low) / scale)
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    found = fast_simplification.simplify(scaled, corners, target_count=most)
    return low + scale * np.asarray(found[0], dtype=np.float64), np.asarray(found[1], np.int64)


def simplified_for_cutting(
    vertices: FloatArray, faces: NDArray[np.integer[Any]], what: str
) -> tuple[FloatArray, NDArray[np.integer[Any]], tuple[Finding, ...]]:
    """Return vertices and faces of a mesh to cut into convex pieces, and what is to be told.

    Args:
        vertices: (V, 3) m.
        faces: (F, 3) indices.
        what: What messages call the mesh.

    Returns:
        The mesh itself up to `DENSE_CUT` triangles, else one of about as many; the finding has how
        far the mesh's vertices are from it.
    """
    if len(faces) <= DENSE_CUT:
        return vertices, faces, ()
    points, triangles = with_fewer_triangles(vertices, faces, DENSE_CUT)
    surface: Any = coal.BVHModelOBBRSS()
    surface.beginModel(len(triangles), len(points))
    surface.addVertices(points)
    surface.addTriangles(triangles)
    surface.endModel()
    enough = HULL_TOLERANCE * float(np.ptp(vertices, axis=0).max())
    off = _farthest(vertices, points[triangles], surface, enough)
    found = Finding(
        FindingCode.SIMPLIFIED_HULL,
        what,
        f"{what} has {len(faces)} triangles: {len(triangles)} stand for it where it is cut into "
        f"convex pieces, up to {1e3 * off:.2g} mm away from its vertices",
        "give a mesh of fewer triangles where contacts have to be nearer than that",
    )
    return points, triangles, (found,)


def turned_outward(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a closed mesh with its parts' triangles counterclockwise when seen from outside.

    A part in the box around another is turned as that is: so hollows stay hollows.
    """
    import trimesh

    corners = mesh.triangles - mesh.bounds.mean(axis=0)
    parts = trimesh.graph.connected_component_labels(mesh.face_adjacency, len(corners))
    volumes = np.bincount(parts, np.linalg.det(corners))
    low = np.full((len(volumes), 3), np.inf)
    high = -low
    np.minimum.at(low, parts, corners.min(axis=1))
    np.maximum.at(high, parts, corners.max(axis=1))
    sizes = np.prod(high - low, axis=1)
    around = [
        int(np.where(((low <= own[0]) & (high >= own[1])).all(axis=1), sizes, -1.0).argmax())
        for own in zip(low, high, strict=True)
    ]
    inward = (volumes[around] < 0.0)[parts]
    faces = np.where(inward[:, None], mesh.faces[:, ::-1], mesh.faces)
    return trimesh.Trimesh(mesh.vertices, faces, process=False) if inward.any() else mesh


def _farthest(
    vertices: FloatArray,
    triangles: FloatArray,
    surface: Any,
    enough: float,
    planes: FloatArray | None = None,
) -> float:
    """Return how far vertices (V, 3) are from a surface, m, or a little more.

    Args:
        vertices: m.
        triangles: (F, 3, 3) corners of the surface's triangles, m.
        surface: Its coal geometry, asked for what is not within enough of the triangles near it.
        enough: m.
        planes: (F, 4) outward normals and offsets of a hull's faces: vertices inside do not count;
            None: all do.
    """
    from scipy.spatial import KDTree
    from trimesh.triangles import closest_point

    centers = KDTree(triangles.mean(axis=1))
    farthest = 0.0
    for points in np.array_split(vertices, 1 + len(vertices) // _VERTICES_AT_ONCE):
        rows = np.asarray(centers.query(points, k=_NEAREST_TRIANGLES)[1])
        if planes is not None:
            over = np.einsum("vnx,vx->vn", planes[rows, :3], points) + planes[rows, 3]
            rows, points = rows[over.max(axis=1) > 0.0], points[over.max(axis=1) > 0.0]
        feet = closest_point(triangles[rows.ravel()], np.repeat(points, _NEAREST_TRIANGLES, axis=0))
        gaps = np.linalg.norm(
            feet.reshape(-1, _NEAREST_TRIANGLES, 3) - points[:, None], axis=2
        ).min(axis=1)
        for index in np.flatnonzero(gaps > enough):
            gaps[index] = _gap(surface, points[index])
        farthest = max(farthest, float(gaps.max(initial=0.0)))
    return farthest


def _gap(surface: Any, point: FloatArray) -> float:
    """Return how far a (3,) point is from a coal geometry, m."""
    at = coal.Transform3s(np.eye(3), point)
    return (
        coal.distance(
            surface,
            coal.Transform3s(),
            coal.Sphere(_DOT_RADIUS),
            at,
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        + _DOT_RADIUS
    )


MeshScale = float | tuple[float, float, float]

LARGEST_MESH = 5.0
SMALLEST_MESH = 1e-3

_REMEMBERED = 32  # meshes
_JOINED = 8
"""Decimals of a metre within which corners are one, in meshes from 1 mm to 10 000 km."""
_COARSEST, _FINEST = 5, 15
"""Significant digits that tell corners of other meshes apart: trimesh compares 64-bit integers."""


def load_mesh(path: Path, *, upright: bool = True) -> trimesh.Trimesh:
    """Read all parts of a mesh file as one mesh, in the file's units; in metres if it states one.

    Args:
        path: The file.
        upright: Whether the axis that a DAE says is up becomes z, as for an object; Pinocchio, RViz
            and MoveIt leave links' meshes as they are.

    Raises:
        MeshError: The file is missing, of an unknown format, unreadable or without faces, names
            vertices that it does not have, or has some that are not finite.
    """
    import trimesh

    from graspless_pin.geometry.bodies.mesh_files import MESH_FORMATS, parse_mesh

    file_state(path)
    if path.suffix.lower() not in MESH_FORMATS:
        raise MeshError(
            f"mesh file '{path}' has the unknown ending '{path.suffix}'; "
            f"use one of {', '.join(MESH_FORMATS)}"
        )
    try:
        mesh = parse_mesh(path, upright=upright)
    except MeshError:
        raise
    except Exception as error:  # the readers behind trimesh raise whatever comes up
        raise MeshError(
            f"mesh file '{path}' cannot be read as {path.suffix[1:].upper()}: {error}"
        ) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0 or len(mesh.vertices) == 0:
        raise MeshError(f"mesh file '{path}' has no faces; export it as a triangle mesh")
    # Not all readers behind trimesh look.
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise MeshError(f"mesh file '{path}' has faces of vertices that it does not have")
    if not np.isfinite(mesh.vertices).all():
        raise MeshError(f"mesh file '{path}' has vertices that are not finite numbers")
    _check_extent(path, mesh)
    return mesh


def _check_extent(path: Path, mesh: trimesh.Trimesh) -> None:
    if not np.abs(mesh.vertices).max() <= LARGEST_LENGTH:
        raise MeshError(f"mesh file '{path}' has vertices beyond ±{LARGEST_LENGTH:g} m")


def scaled_mesh(path: Path, scale: MeshScale, *, upright: bool = True) -> trimesh.Trimesh:
    """Read a mesh file in metres.

    A file is read again only if it has changed; do not change what is returned.

    Args:
        path: See `load_mesh`.
        scale: Metres per unit of the file, or of what it states; one number, or three along x, y,
            z.
        upright: See `load_mesh`.

    Returns:
        The mesh, with vertices that have the same place joined.

    Raises:
        MeshError: See `load_mesh`.
    """
    return _scaled_mesh(path, scale, upright, file_state(path))


def file_state(path: Path) -> tuple[str, int, int]:
    """Return what tells one state of a file from another: its place, time and size.

    Raises:
        MeshError: The file is missing.
    """
    try:
        status = path.stat()
    except (OSError, ValueError):
        raise MeshError(
            f"mesh file '{path}' does not exist; check the path and what it is relative to"
        ) from None
    note_read(path, status)
    return str(path.absolute()), status.st_mtime_ns, status.st_size


@lru_cache(maxsize=_REMEMBERED)
def _scaled_mesh(
    path: Path, scale: MeshScale, upright: bool, _state: tuple[str, int, int]
) -> trimesh.Trimesh:
    mesh = load_mesh(path, upright=upright)
    mesh.apply_scale(np.broadcast_to(np.asarray(scale, dtype=float), 3))
    _check_extent(path, mesh)
    # Colours and normals per corner keep corners apart that are one.
    order = math.floor(math.log10(max(np.abs(mesh.vertices).max(), SMALLEST_LENGTH)))
    digits = min(max(_JOINED, _COARSEST - order), _FINEST - order)
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=digits)
    # Triangles that joined corners leave without area, or that are stated twice, close nothing.
    kept = (np.diff(np.sort(mesh.faces, axis=1)) > 0).all(axis=1) & mesh.unique_faces()
    if kept.any():
        mesh.update_faces(kept)
    return mesh


def hull_points(path: Path, scale: MeshScale) -> FloatArray:
    """Corners (V, 3) of the convex hull of a mesh file, m, read-only.

    Raises:
        MeshError: See `load_mesh`; or all vertices lie in one plane.

    Warns:
        GrasplessPinWarning: The mesh is larger than 5 m or smaller than 1 mm, or so dense that its
            hull is simplified.
    """
    points, found = _hull_points(path, scale, file_state(path))
    emit(*found)
    named = f"mesh '{path}' with scale {scale}"
    emit(*scale_findings(named, named, points, "needs scale 0.001"))
    return points


def scale_findings(subject: str, what: str, points: FloatArray, remedy: str) -> Iterator[Finding]:
    """Find that the size of a mesh says that its unit is not the metre: over 5 m, below 1 mm.

    Args:
        subject: What the finding is about.
        what: What the message calls the mesh.
        points: (V, 3) its vertices, m.
        remedy: What a file in millimetres needs.
    """
    extent = float(np.ptp(points, axis=0).max())
    if not SMALLEST_MESH <= extent <= LARGEST_MESH:
        yield Finding(
            FindingCode.MESH_SCALE,
            subject,
            f"{what} is {extent:.3g} m large",
            f"lengths are metres: a file in millimetres {remedy}",
        )


@lru_cache(maxsize=_REMEMBERED)
def _hull_points(
    path: Path, scale: MeshScale, _state: tuple[str, int, int]
) -> tuple[FloatArray, tuple[Finding, ...]]:
    from graspless_pin.geometry.bodies.mesh_files import UP_AXIS

    mesh = scaled_mesh(path, scale)
    points, found = hull_corners(np.array(mesh.vertices, dtype=float), f"mesh file '{path}'")
    if UP_AXIS in mesh.metadata:
        up = mesh.metadata[UP_AXIS]
        turned = Finding(
            FindingCode.MESH_AXES,
            str(path),
            f"mesh file '{path}' says {up}: its {up[0].lower()} axis is the object's z axis",
            "write <up_axis>Z_UP</up_axis> into it, or turn the object, if z was up all along",
        )
        found = (*found, turned)
    return read_only(points), found


_SURFACES_KEPT = 256

MOST_FACES = 4000
"""Of a surface that is drawn, if nothing else is said."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """A surface of triangles, counterclockwise when seen from outside.

    Attributes:
        vertices: (V, 3) read-only, m.
        faces: (F, 3) read-only indices of vertices.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name, dtype in (("vertices", np.float64), ("faces", np.int64)):
            array = np.array(getattr(self, name), dtype=dtype).reshape(-1, 3)
            object.__setattr__(self, name, read_only(array))

    def moved(self, T: ArrayLike) -> Triangles:
        """Return the surface at a (4, 4) pose."""
        pose = np.asarray(T, dtype=float)
        return Triangles(self.vertices @ pose[:3, :3].T + pose[:3, 3], self.faces)


def slab_triangles(center: ArrayLike, half_width: float, thickness: float) -> Triangles:
    """Return a square slab whose top is the plane of a half-space, in the half-space's frame.

    Args:
        center: (2,) middle of the top, m.
        half_width: Half the edge of the square, m.
        thickness: How far the slab goes down, m.
    """
    x, y = np.asarray(center, dtype=float).tolist()
    slab = unit_surface("box", (2.0 * half_width, 2.0 * half_width, thickness))
    return Triangles(slab.vertices + np.array([x, y, -0.5 * thickness]), slab.faces)


def simplified(triangles: Triangles, max_faces: int) -> Triangles:
    """Return a surface of about so many triangles, or the same if it has no more.

    Good for looking at, not for computing with.
    """
    if len(triangles.faces) <= max_faces:
        return triangles
    return Triangles(*with_fewer_triangles(triangles.vertices, triangles.faces, max_faces))


@lru_cache(maxsize=_SURFACES_KEPT)
def unit_surface(
    name: str,
    factors: float | tuple[float, ...],
    *sizes: float,
    lowered: float = 0.0,
    **options: Any,
) -> Triangles:
    """Make a primitive at unit size first: trimesh drops triangles that it finds too small.

    Args:
        name: Of a function of `trimesh.creation`.
        factors: What its vertices are scaled by, one number or three along x, y, z, m.
        sizes: What the function takes.
        lowered: How far the vertices are moved down before they are scaled.
        options: What else the function takes.
    """
    import trimesh

    unit = getattr(trimesh.creation, name)(*sizes, **options)
    unit.apply_translation((0.0, 0.0, -lowered))
    return Triangles(np.array(unit.vertices) * np.asarray(factors), unit.faces)


def file_triangles(
    path: Path, scale: MeshScale, max_faces: int, *, upright: bool = True
) -> Triangles:
    """Return the surface of a mesh file, the same as long as the file does not change.

    Args:
        path: See `scaled_mesh`.
        scale: See `scaled_mesh`; one that mirrors turns the triangles round.
        max_faces: A mesh with more triangles is simplified, see `simplified`.
        upright: See `load_mesh`.

    Raises:
        MeshError: The file is missing or unreadable.
    """
    return _file_triangles(path, scale, max_faces, upright, file_state(path))


@lru_cache(maxsize=_SURFACES_KEPT)
def _file_triangles(
    path: Path, scale: MeshScale, max_faces: int, upright: bool, _state: tuple[str, int, int]
) -> Triangles:
    mesh = scaled_mesh(path, scale, upright=upright)
    return simplified(Triangles(mesh.vertices, mesh.faces), max_faces)
