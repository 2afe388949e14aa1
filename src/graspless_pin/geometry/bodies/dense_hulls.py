"""Dense meshes: hulls of few corners within a tolerance, and surfaces of fewer triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import NDArray

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.polytopes import hull_of, qhull
from graspless_pin.problem.checks import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

DENSE_MESH = 20_000
"""Vertices up to which a hull keeps all its corners."""
HULL_TOLERANCE = 2e-4
"""How far a corner of a denser mesh stands out that its hull leaves out, as a share of its size."""

DENSE_CUT = 10_000
"""Triangles up to which a mesh is cut into convex pieces as it is."""

_SIMPLIFIED_SIZE = 100.0  # fast_simplification's thresholds are absolute, and made for such lengths
_AT_ONCE = 20_000  # vertices
_NEAR = 4  # triangles
_DOT = 1e-9  # m


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
    left_out = _standing_out(vertices, hull, HULL_TOLERANCE * size)
    found = Finding(
        FindingCode.SIMPLIFIED_HULL,
        what,
        f"{what} has {len(vertices)} vertices: the {len(corners)} corners of the hull that stands "
        f"for it leave out up to {1e3 * left_out:.2g} mm",
        "give a mesh of fewer vertices where contacts have to be nearer than that",
    )
    return corners, (found,)


def _standing_out(vertices: FloatArray, hull: ConvexHull, enough: float) -> float:
    """Return how far vertices (V, 3) stand out of the hull of some of them, m, or a little more.

    Each is measured to the triangles near it, which is never too little, and where that is not
    within what is enough, to the hull.
    """
    normals, offsets = np.split(hull.equations, [3], 1)
    corners = coal.StdVec_Vec3s()
    corners.extend(hull.points[hull.vertices])
    solid = coal.Convex.convexHull(corners, False, "Qt")  # noqa: FBT003 - no triangles
    return _farthest(vertices, hull.points[hull.simplices], solid, enough, normals, offsets[:, 0])


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


def _farthest(
    vertices: FloatArray,
    triangles: FloatArray,
    surface: Any,
    enough: float,
    normals: FloatArray | None = None,
    offsets: FloatArray | None = None,
) -> float:
    """Return how far vertices (V, 3) are from a surface, m, or a little more.

    Args:
        vertices: m.
        triangles: (F, 3, 3) corners of the surface's triangles, m.
        surface: Its coal geometry, asked for what is not within enough of the triangles near it.
        enough: m.
        normals: (F, 3) outward, of a hull: vertices inside do not count; None: all do.
        offsets: (F,) of the hull's planes.
    """
    from scipy.spatial import KDTree
    from trimesh.triangles import closest_point

    centers = KDTree(triangles.mean(axis=1))
    farthest = 0.0
    for points in np.array_split(vertices, 1 + len(vertices) // _AT_ONCE):
        near = np.asarray(centers.query(points, k=_NEAR)[1])
        if normals is not None and offsets is not None:
            over = np.einsum("vnx,vx->vn", normals[near], points) + offsets[near]
            near, points = near[over.max(axis=1) > 0.0], points[over.max(axis=1) > 0.0]
        feet = closest_point(triangles[near.ravel()], np.repeat(points, _NEAR, axis=0))
        gaps = np.linalg.norm(feet.reshape(-1, _NEAR, 3) - points[:, None], axis=2).min(axis=1)
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
            coal.Sphere(_DOT),
            at,
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        + _DOT
    )
