"""Mesh files: reading them, their convex hulls, and sizes that suggest another unit.

Dense meshes get hulls with few vertices within a tolerance, and surfaces with fewer triangles.
`Triangles` (metres, outward faces) is the form in which shapes and hands are drawn.
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
from graspless_pin.geometry.bodies.polytopes import hull_polytope, qhull
from graspless_pin.intake.files import note_read
from graspless_pin.problem.checks import FloatArray, read_only

if TYPE_CHECKING:
    import trimesh


DENSE_MESH = 20_000
"""Number of vertices up to which a hull keeps all of its vertices."""
HULL_TOLERANCE = 2e-4
"""Distance of a dense mesh's vertex outside its simplified hull, as a share of its size."""

DENSE_CUT = 10_000
"""Number of triangles up to which a mesh is cut into convex pieces as it is."""

_SIMPLIFIED_SIZE = 100.0  # fast_simplification's thresholds are absolute, for such lengths
_VERTICES_AT_ONCE = 20_000  # vertices
_NEAREST_TRIANGLES = 4  # triangles
_DOT_RADIUS = 1e-9  # m


def hull_corners(vertices: FloatArray, label: str) -> tuple[FloatArray, tuple[Finding, ...]]:
    """Return the vertices (K, 3) of the convex hull of (V, 3) vertices, and findings.

    Args:
        vertices: In metres.
        label: The name of the mesh in messages.

    Returns:
        The hull's vertices, a subset of the given ones. Above `DENSE_MESH` vertices, those that
        protrude by less than `HULL_TOLERANCE` of the mesh's size are omitted; the finding states
        how far the mesh then protrudes from the hull, measured at all vertices.

    Raises:
        MeshError: All vertices lie in one plane.
    """
    if len(vertices) <= DENSE_MESH:
        return hull_polytope(vertices, label).vertices, ()

    size = float(np.ptp(vertices, axis=0).max())
    # Qhull makes no vertex of a point that is less than this above a face.
    hull = qhull(vertices, label, f"Qt W{HULL_TOLERANCE * size:.17g}")
    corners = vertices[hull.vertices]
    # The distance to the triangles near a vertex is an upper bound; where it exceeds the tolerance,
    # the distance to the hull is computed.
    points = coal.StdVec_Vec3s()
    points.extend(corners)
    solid = coal.Convex.convexHull(points, False, "Qt")  # noqa: FBT003 - no triangles
    triangles, planes = hull.points[hull.simplices], hull.equations
    omitted = _largest_vertex_distance(vertices, triangles, solid, HULL_TOLERANCE * size, planes)
    finding = Finding(
        FindingCode.SIMPLIFIED_HULL,
        label,
        f"{label} has {len(vertices)} vertices; it is replaced by a convex hull of "
        f"{len(corners)} vertices, which leaves out up to {1e3 * omitted:.2g} mm",
        "give a mesh of fewer vertices if contacts must be more accurate",
    )
    return corners, (finding,)


def decimated_surface(
    vertices: FloatArray, faces: NDArray[np.integer[Any]], target_count: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return vertices and faces of a surface decimated by quadric error metrics.

    Args:
        vertices: (V, 3) m.
        faces: (F, 3) indices.
        target_count: Target number of triangles.
    """
    import fast_simplification

    low, scale = vertices.min(axis=0), np.ptp(vertices, axis=0).max() / _SIMPLIFIED_SIZE
    scaled = np.ascontiguousarray((vertices - low) / scale)
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    result = fast_simplification.simplify(scaled, corners, target_count=target_count)
    return low + scale * np.asarray(result[0], dtype=np.float64), np.asarray(result[1], np.int64)


def simplified_for_cutting(
    vertices: FloatArray, faces: NDArray[np.integer[Any]], label: str
) -> tuple[FloatArray, NDArray[np.integer[Any]], tuple[Finding, ...]]:
    """Return vertices and faces of a mesh to cut into convex pieces, and findings.

    Args:
        vertices: (V, 3) m.
        faces: (F, 3) indices.
        label: The name of the mesh in messages.

    Returns:
        The mesh itself up to `DENSE_CUT` triangles, else a decimated one of about that many; the
        finding states the largest distance of the mesh's vertices from it.
    """
    if len(faces) <= DENSE_CUT:
        return vertices, faces, ()
    points, triangles = decimated_surface(vertices, faces, DENSE_CUT)
    surface: Any = coal.BVHModelOBBRSS()
    surface.beginModel(len(triangles), len(points))
    surface.addVertices(points)
    surface.addTriangles(triangles)
    surface.endModel()
    tolerance = HULL_TOLERANCE * float(np.ptp(vertices, axis=0).max())
    distance = _largest_vertex_distance(vertices, points[triangles], surface, tolerance)
    finding = Finding(
        FindingCode.SIMPLIFIED_HULL,
        label,
        f"{label} has {len(faces)} triangles; for the cut into convex pieces it is replaced by "
        f"{len(triangles)} triangles, up to {1e3 * distance:.2g} mm away from its vertices",
        "give a mesh of fewer triangles if contacts must be more accurate",
    )
    return points, triangles, (finding,)


def with_outward_faces(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a closed mesh whose triangles are counterclockwise when seen from outside.

    A connected part inside the bounding box of another is flipped together with it, so that
    hollows stay hollows.
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
    enclosing = [
        int(np.where(((low <= box[0]) & (high >= box[1])).all(axis=1), sizes, -1.0).argmax())
        for box in zip(low, high, strict=True)
    ]
    is_inward = (volumes[enclosing] < 0.0)[parts]
    faces = np.where(is_inward[:, None], mesh.faces[:, ::-1], mesh.faces)
    return trimesh.Trimesh(mesh.vertices, faces, process=False) if is_inward.any() else mesh


def _largest_vertex_distance(
    vertices: FloatArray,
    triangles: FloatArray,
    surface: Any,
    tolerance: float,
    planes: FloatArray | None = None,
) -> float:
    """Return an upper bound on the largest distance of vertices (V, 3) from a surface, m.

    Args:
        vertices: m.
        triangles: (F, 3, 3) vertices of the surface's triangles, m.
        surface: coal geometry of the surface, for vertices farther than the tolerance from the
            triangles near them.
        tolerance: Distance up to which the bound is not refined, m.
        planes: (F, 4) outward normals and offsets of a hull's faces: vertices inside the hull are
            ignored; None: no vertex is.
    """
    from scipy.spatial import KDTree
    from trimesh.triangles import closest_point

    centers = KDTree(triangles.mean(axis=1))
    farthest = 0.0
    for points in np.array_split(vertices, 1 + len(vertices) // _VERTICES_AT_ONCE):
        rows = np.asarray(centers.query(points, k=_NEAREST_TRIANGLES)[1])
        if planes is not None:
            heights = np.einsum("vnx,vx->vn", planes[rows, :3], points) + planes[rows, 3]
            rows, points = rows[heights.max(axis=1) > 0.0], points[heights.max(axis=1) > 0.0]
        feet = closest_point(triangles[rows.ravel()], np.repeat(points, _NEAREST_TRIANGLES, axis=0))
        gaps = np.linalg.norm(
            feet.reshape(-1, _NEAREST_TRIANGLES, 3) - points[:, None], axis=2
        ).min(axis=1)
        for index in np.flatnonzero(gaps > tolerance):
            gaps[index] = _point_distance(surface, points[index])
        farthest = max(farthest, float(gaps.max(initial=0.0)))
    return farthest


def _point_distance(surface: Any, point: FloatArray) -> float:
    """Return the distance of a point (3,) from a coal geometry, m."""
    T_point = coal.Transform3s(np.eye(3), point)
    return (
        coal.distance(
            surface,
            coal.Transform3s(),
            coal.Sphere(_DOT_RADIUS),
            T_point,
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        + _DOT_RADIUS
    )


MeshScale = float | tuple[float, float, float]

LARGEST_MESH = 5.0
SMALLEST_MESH = 1e-3

_MOST_CACHED_MESHES = 32  # meshes
_MERGED_DECIMALS = 8
"""Decimals of a metre to which vertices are merged, in meshes from 1 mm to 10 000 km."""
_LEAST_DIGITS, _MOST_DIGITS = 5, 15
"""Significant digits compared in other meshes: trimesh compares 64-bit integers."""


def load_mesh(path: Path, *, upright: bool = True) -> trimesh.Trimesh:
    """Read all parts of a mesh file as one mesh, in the file's unit; in metres if it states one.

    Args:
        path: The file.
        upright: Whether the up axis that a DAE states becomes z, as for an object; Pinocchio, RViz
            and MoveIt do not rotate the meshes of links.

    Raises:
        MeshError: The file is missing, of an unknown format, unreadable or without faces, has
            vertex indices out of range, or vertices that are not finite.
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
    except Exception as error:  # trimesh's readers raise any exception
        raise MeshError(
            f"mesh file '{path}' cannot be read as {path.suffix[1:].upper()}: {error}"
        ) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0 or len(mesh.vertices) == 0:
        raise MeshError(f"mesh file '{path}' has no faces; export it as a triangle mesh")
    # Not all readers that trimesh uses check this.
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise MeshError(f"mesh file '{path}' has faces with vertices that do not exist")
    if not np.isfinite(mesh.vertices).all():
        raise MeshError(f"mesh file '{path}' has vertices that are not finite numbers")
    _check_extent(path, mesh)
    return mesh


def _check_extent(path: Path, mesh: trimesh.Trimesh) -> None:
    if not np.abs(mesh.vertices).max() <= LARGEST_LENGTH:
        raise MeshError(f"mesh file '{path}' has vertices beyond ±{LARGEST_LENGTH:g} m")


def scaled_mesh(path: Path, scale: MeshScale, *, upright: bool = True) -> trimesh.Trimesh:
    """Read a mesh file in metres.

    The result is cached until the file changes; do not modify it.

    Args:
        path: See `load_mesh`.
        scale: Metres per unit of the file, or per the unit that it states; one number, or three
            along x, y, z.
        upright: See `load_mesh`.

    Returns:
        The mesh, with coincident vertices merged.

    Raises:
        MeshError: See `load_mesh`.
    """
    return _scaled_mesh(path, scale, upright, file_state(path))


def file_state(path: Path) -> tuple[str, int, int]:
    """Return the absolute path, modification time (ns) and size of a file, as a cache key.

    Raises:
        MeshError: The file is missing.
    """
    try:
        status = path.stat()
    except (OSError, ValueError):
        raise MeshError(
            f"mesh file '{path}' does not exist; check the path and the folder that it is relative "
            "to"
        ) from None
    note_read(path, status)
    return str(path.absolute()), status.st_mtime_ns, status.st_size


@lru_cache(maxsize=_MOST_CACHED_MESHES)
def _scaled_mesh(
    path: Path, scale: MeshScale, upright: bool, _state: tuple[str, int, int]
) -> trimesh.Trimesh:
    mesh = load_mesh(path, upright=upright)
    mesh.apply_scale(np.broadcast_to(np.asarray(scale, dtype=float), 3))
    _check_extent(path, mesh)
    # Colours and normals per vertex would keep coincident vertices separate.
    magnitude = math.floor(math.log10(max(np.abs(mesh.vertices).max(), SMALLEST_LENGTH)))
    digits = min(max(_MERGED_DECIMALS, _LEAST_DIGITS - magnitude), _MOST_DIGITS - magnitude)
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=digits)
    # Degenerate and duplicate triangles would make a closed surface look open.
    is_proper = (np.diff(np.sort(mesh.faces, axis=1)) > 0).all(axis=1) & mesh.unique_faces()
    if is_proper.any():
        mesh.update_faces(is_proper)
    return mesh


def hull_points(path: Path, scale: MeshScale) -> FloatArray:
    """Return the vertices (V, 3) of the convex hull of a mesh file, m, read-only.

    Raises:
        MeshError: See `load_mesh`; or all vertices lie in one plane.

    Warns:
        GrasplessPinWarning: The mesh is larger than 5 m or smaller than 1 mm, or so dense that its
            hull is simplified.
    """
    points, findings = _hull_points(path, scale, file_state(path))
    emit(*findings)
    description = f"mesh '{path}' with scale {scale}"
    emit(*scale_findings(description, description, points, "needs scale 0.001"))
    return points


def scale_findings(subject: str, label: str, points: FloatArray, remedy: str) -> Iterator[Finding]:
    """Yield a finding if a mesh is over 5 m or below 1 mm large: its unit may not be the metre.

    Args:
        subject: Subject of the finding.
        label: The name of the mesh in the message.
        points: (V, 3) vertices, m.
        remedy: What a file in millimetres needs.
    """
    extent = float(np.ptp(points, axis=0).max())
    if not SMALLEST_MESH <= extent <= LARGEST_MESH:
        yield Finding(
            FindingCode.MESH_SCALE,
            subject,
            f"{label} is {extent:.3g} m large",
            f"lengths are metres: a file in millimetres {remedy}",
        )


@lru_cache(maxsize=_MOST_CACHED_MESHES)
def _hull_points(
    path: Path, scale: MeshScale, _state: tuple[str, int, int]
) -> tuple[FloatArray, tuple[Finding, ...]]:
    from graspless_pin.geometry.bodies.mesh_files import UP_AXIS

    mesh = scaled_mesh(path, scale)
    points, findings = hull_corners(np.array(mesh.vertices, dtype=float), f"mesh file '{path}'")
    if UP_AXIS in mesh.metadata:
        up = mesh.metadata[UP_AXIS]
        axes_finding = Finding(
            FindingCode.MESH_AXES,
            str(path),
            f"mesh file '{path}' states {up}: its {up[0].lower()} axis becomes the object's z axis",
            "if z is up in the file, write <up_axis>Z_UP</up_axis> into it, or turn the object",
        )
        findings = (*findings, axes_finding)
    return read_only(points), findings


_MOST_CACHED_SURFACES = 256

MOST_FACES = 4000
"""Default limit on the triangles of a surface that is drawn."""


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
        thickness: Height of the slab, below its top, m.
    """
    x, y = np.asarray(center, dtype=float).tolist()
    slab = unit_surface("box", (2.0 * half_width, 2.0 * half_width, thickness))
    return Triangles(slab.vertices + np.array([x, y, -0.5 * thickness]), slab.faces)


def simplified(triangles: Triangles, max_faces: int) -> Triangles:
    """Return a surface decimated to about ``max_faces`` triangles, or the same if it has no more.

    For display, not for computation.
    """
    if len(triangles.faces) <= max_faces:
        return triangles
    return Triangles(*decimated_surface(triangles.vertices, triangles.faces, max_faces))


@lru_cache(maxsize=_MOST_CACHED_SURFACES)
def unit_surface(
    name: str,
    factors: float | tuple[float, ...],
    *sizes: float,
    lowered: float = 0.0,
    **options: Any,
) -> Triangles:
    """Return a primitive made at unit size and then scaled: trimesh drops very small triangles.

    Args:
        name: Name of a function of `trimesh.creation`.
        factors: Scale of the vertices, one number or three along x, y, z, m.
        sizes: Positional arguments of the function.
        lowered: Shift of the vertices along -z before they are scaled.
        options: Keyword arguments of the function.
    """
    import trimesh

    unit = getattr(trimesh.creation, name)(*sizes, **options)
    unit.apply_translation((0.0, 0.0, -lowered))
    return Triangles(np.array(unit.vertices) * np.asarray(factors), unit.faces)


def file_triangles(
    path: Path, scale: MeshScale, max_faces: int, *, upright: bool = True
) -> Triangles:
    """Return the surface of a mesh file, cached until the file changes.

    Args:
        path: See `scaled_mesh`.
        scale: See `scaled_mesh`; a mirroring scale reverses the triangles.
        max_faces: A mesh with more triangles is simplified, see `simplified`.
        upright: See `load_mesh`.

    Raises:
        MeshError: The file is missing or unreadable.
    """
    return _file_triangles(path, scale, max_faces, upright, file_state(path))


@lru_cache(maxsize=_MOST_CACHED_SURFACES)
def _file_triangles(
    path: Path, scale: MeshScale, max_faces: int, upright: bool, _state: tuple[str, int, int]
) -> Triangles:
    mesh = scaled_mesh(path, scale, upright=upright)
    return simplified(Triangles(mesh.vertices, mesh.faces), max_faces)
