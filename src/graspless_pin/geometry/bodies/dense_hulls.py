"""Corners of convex hulls: all, or of a dense mesh those that keep it within a tolerance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.polytopes import hull_of
from graspless_pin.problem.checks import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

DENSE_MESH = 20_000
"""Vertices up to which a hull keeps all its corners."""
HULL_TOLERANCE = 2e-4
"""How far a corner of a denser mesh stands out that its hull leaves out, as a share of its size."""

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
        scipy.spatial.QhullError: All vertices lie in one plane.
    """
    if len(vertices) <= DENSE_MESH:
        return hull_of(vertices).vertices, ()
    from scipy.spatial import ConvexHull

    size = float(np.ptp(vertices, axis=0).max())
    # Qhull takes no point for a corner that is less than this above a face.
    hull = ConvexHull(vertices, qhull_options=f"Qt W{HULL_TOLERANCE * size:.17g}")
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
    from scipy.spatial import KDTree
    from trimesh.triangles import closest_point

    triangles, normals, offsets = hull.points[hull.simplices], *np.split(hull.equations, [3], 1)
    centers = KDTree(triangles.mean(axis=1))
    corners = coal.StdVec_Vec3s()
    corners.extend(hull.points[hull.vertices])
    solid = coal.Convex.convexHull(corners, False, "Qt")  # noqa: FBT003 - no triangles
    farthest = 0.0
    for points in np.array_split(vertices, 1 + len(vertices) // _AT_ONCE):
        near = np.asarray(centers.query(points, k=_NEAR)[1])
        over = np.einsum("vnx,vx->vn", normals[near], points) + offsets[near, 0]
        near, points = near[over.max(axis=1) > 0.0], points[over.max(axis=1) > 0.0]
        feet = closest_point(triangles[near.ravel()], np.repeat(points, _NEAR, axis=0))
        gaps = np.linalg.norm(feet.reshape(-1, _NEAR, 3) - points[:, None], axis=2).min(axis=1)
        for index in np.flatnonzero(gaps > enough):
            gaps[index] = _gap(solid, points[index])
        farthest = max(farthest, float(gaps.max(initial=0.0)))
    return farthest


def _gap(solid: Any, point: FloatArray) -> float:
    """Return how far a (3,) point is from a convex hull, m."""
    at = coal.Transform3s(np.eye(3), point)
    return (
        coal.distance(
            solid,
            coal.Transform3s(),
            coal.Sphere(_DOT),
            at,
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        + _DOT
    )
