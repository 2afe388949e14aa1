"""Tangents, friction-cone edges and faces of point contacts."""

from __future__ import annotations

import numpy as np

from graspless_pin.problem.checks import FloatArray

_NEARLY_PARALLEL = 0.99


def default_tangents(normals: FloatArray) -> FloatArray:
    """Return deterministic tangents: t1 = normalize(n x e_y), t2 = n x t1.

    Where a normal is nearly parallel to the y axis (|n . e_y| > 0.99) the x axis takes its place.

    Args:
        normals: (M, 3) unit normals, world axes.

    Returns:
        (M, 3, 2) unit tangents; ``[l, :, 0]`` is t1 and ``[l, :, 1]`` is t2, right-handed with n.
    """
    axis = np.zeros_like(normals)
    use_x = np.abs(normals[:, 1]) > _NEARLY_PARALLEL
    axis[use_x, 0] = 1.0
    axis[~use_x, 1] = 1.0
    first: FloatArray = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second: FloatArray = np.cross(normals, first)
    return np.stack([first, second], axis=2)


def cone_edges_local(friction: float, edges: int) -> FloatArray:
    """Return the unit edges of a polyhedral friction cone in (n, t1, t2) coordinates, eq. (4).

    The cone is inscribed in the Coulomb cone: edge m lies on it at the angle 2 pi m / r from t1.

    Returns:
        (3, r) columns c_m.
    """
    angles = 2.0 * np.pi * np.arange(edges) / edges
    columns = np.stack([np.ones(edges), friction * np.cos(angles), friction * np.sin(angles)])
    return columns / np.sqrt(1.0 + friction**2)


def cone_faces_local(friction: float, edges: int) -> FloatArray:
    """Return the unit outward side-face normals of that cone in (n, t1, t2) coordinates, eq. (38).

    Face m lies between the edges m and m + 1: a force f is inside when h_m^T f <= 0, and
    -h_m^T f is its distance to the face, in newton.

    Returns:
        (3, r) columns h_m.
    """
    angles = 2.0 * np.pi * (np.arange(edges) + 0.5) / edges
    slope = friction * np.cos(np.pi / edges)
    columns = np.stack([np.full(edges, -slope), np.cos(angles), np.sin(angles)])
    return columns / np.sqrt(1.0 + slope**2)
