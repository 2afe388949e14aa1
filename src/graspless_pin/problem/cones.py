"""Tangents, friction-cone edges and faces of point contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from functools import cache

import numpy as np

from graspless_pin.compiled import small_arrays
from graspless_pin.problem.checks import FloatArray, read_only

_NEARLY_PARALLEL = 0.99


class ConeModel(StrEnum):
    """What a friction cone is."""

    EDGES = "edges"
    """A pyramid of `cone_edges` edges inside Coulomb's cone, eq. (4)."""
    ROUND = "round"
    """Coulomb's cone itself, |f_t| <= mu f_n."""


def default_tangents(normals: FloatArray) -> FloatArray:
    """Return deterministic tangents: t1 = normalize(n x e_y), t2 = n x t1.

    Where a normal is nearly parallel to the y axis (|n . e_y| > 0.99) the x axis takes its place.

    Args:
        normals: (M, 3) unit normals, world axes.

    Returns:
        (M, 3, 2) unit tangents; ``[l, :, 0]`` is t1 and ``[l, :, 1]`` is t2, right-handed with n.
    """
    return projected_tangents(normals, ())


def projected_tangents(normals: FloatArray, axes: Sequence[FloatArray]) -> FloatArray:
    """Return tangents whose t1 is the projection of the first axis that is not along the normal.

    Args:
        normals: (M, 3) unit normals, world axes.
        axes: (3,) directions of any length, world axes; where none serves, or there is none, the
            rule of `default_tangents` does.

    Returns:
        (M, 3, 2) as `default_tangents`.
    """
    if small_arrays is not None:
        return small_arrays.tangents(normals, axes)
    directions = [np.asarray(axis, dtype=np.float64).tolist() for axis in axes]
    # Plain floats: there are few contacts, and those of one patch share their normal.
    known: dict[tuple[float, float, float], list[float]] = {}
    rows: list[float] = []
    for x, y, z in normals.tolist():
        pair = known.get((x, y, z))
        if pair is None:
            pair = known[x, y, z] = _tangents(x, y, z, directions)
        rows += pair
    return np.array(rows, dtype=np.float64).reshape(-1, 3, 2)


def _tangents(x: float, y: float, z: float, directions: list[list[float]]) -> list[float]:
    """Rows of [t1 t2] for the normal (x, y, z)."""
    for a, b, c in directions:
        along = a * x + b * y + c * z
        if abs(along) <= _NEARLY_PARALLEL * math.hypot(a, b, c):
            u, v, w = a - along * x, b - along * y, c - along * z
            length = math.hypot(u, v, w)
            if length > 0.0:
                break
    else:
        u, v, w = (0.0, z, -y) if abs(y) > _NEARLY_PARALLEL else (-z, 0.0, x)
        length = math.hypot(u, v, w) or 1.0  # a normal of no length is refused elsewhere
    u, v, w = u / length, v / length, w / length
    return [u, y * w - z * v, v, z * u - x * w, w, x * v - y * u]


def cone_edges_local(friction: float, edges: int) -> FloatArray:
    """Return the unit edges of a polyhedral friction cone in (n, t1, t2) coordinates, eq. (4).

    The cone is inscribed in the Coulomb cone: edge m lies on it at the angle 2 pi m / r from t1.

    Returns:
        (3, r) columns c_m.
    """
    angles = 2.0 * np.pi * np.arange(edges) / edges
    columns = np.stack([np.ones(edges), friction * np.cos(angles), friction * np.sin(angles)])
    return columns / np.sqrt(1.0 + friction**2)


def cone_faces_local(friction: float | FloatArray, edges: int) -> FloatArray:
    """Return the unit outward side-face normals of that cone in (n, t1, t2) coordinates, eq. (38).

    Face m lies between the edges m and m + 1: a force f is inside when h_m^T f <= 0, and
    -h_m^T f is its distance to the face, in newton.

    Args:
        friction: One coefficient, or (c,) of as many cones.
        edges: Number r of edges.

    Returns:
        (3, r) columns h_m; (c, 3, r) for c cones.
    """
    slope = np.asarray(friction * np.cos(np.pi / edges))[..., None]
    columns = np.empty((*slope.shape[:-1], 3, edges))
    columns[..., 0, :] = -slope
    columns[..., 1:, :] = face_directions(edges)
    columns /= np.sqrt(1.0 + slope[..., None] ** 2)
    return columns


def room_to_faces(forces: FloatArray, friction: FloatArray, edges: int) -> FloatArray:
    """Return the distance of forces to the nearest side face of their cones, min of -h_m^T f, N.

    Args:
        forces: (c, 3) along n, t1, t2, N.
        friction: (c,) coefficients.
        edges: Number r of edges.

    Returns:
        (c,), negative outside.
    """
    slope = friction * math.cos(math.pi / edges)
    outward = np.maximum.reduce(forces[:, 1:] @ face_directions(edges), axis=1)
    return (slope * forces[:, 0] - outward) / np.sqrt(1.0 + slope**2)


def room_to_round(forces: FloatArray, friction: FloatArray) -> FloatArray:
    """Return the distance of forces to the surface of their round cones, N.

    Args:
        forces: (c, 3) along n, t1, t2, N.
        friction: (c,) coefficients.

    Returns:
        (c,) (mu f_n - |f_t|) / sqrt(1 + mu^2), negative outside.
    """
    rubbing = np.sqrt(np.einsum("ij,ij->i", forces[:, 1:], forces[:, 1:]))
    return (friction * forces[:, 0] - rubbing) / np.sqrt(1.0 + friction**2)


@cache
def face_directions(edges: int) -> FloatArray:
    """(2, r) directions of the side faces in the plane of t1 and t2."""
    angles = 2.0 * np.pi * (np.arange(edges) + 0.5) / edges
    return read_only(np.stack([np.cos(angles), np.sin(angles)]))
