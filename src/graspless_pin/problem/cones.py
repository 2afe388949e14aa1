"""Tangents of point contacts, and the models of their friction cones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from graspless_pin.problem.checks import FloatArray, one_of, read_only
from graspless_pin.problem.cone_model import ConeModel, Section

_NEARLY_PARALLEL = 0.99


def default_tangents(normals: FloatArray) -> FloatArray:
    """Return deterministic tangents: t1 = normalize(n x e_y), t2 = n x t1.

    For a normal nearly parallel to the y axis (|n . e_y| > 0.99) the x axis is used instead.

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
        axes: (3,) directions of any length, world axes; if there are none, or all are nearly along
            the normal, the rule of `default_tangents` applies.

    Returns:
        (M, 3, 2) as `default_tangents`.
    """
    directions = [np.asarray(axis, dtype=np.float64).tolist() for axis in axes]
    # Plain floats: there are few contacts, and those of one patch share their normal.
    tangents_by_normal: dict[tuple[float, float, float], list[float]] = {}
    rows: list[float] = []
    for x, y, z in normals.tolist():
        tangents = tangents_by_normal.get((x, y, z))
        if tangents is None:
            tangents = tangents_by_normal[x, y, z] = _tangent_rows(x, y, z, directions)
        rows += tangents
    return np.array(rows, dtype=np.float64).reshape(-1, 3, 2)


def _tangent_rows(x: float, y: float, z: float, directions: list[list[float]]) -> list[float]:
    """Return the flat (3, 2) matrix [t1 t2] for the normal (x, y, z)."""
    for a, b, c in directions:
        dot = a * x + b * y + c * z
        if abs(dot) <= _NEARLY_PARALLEL * math.hypot(a, b, c):
            u, v, w = a - dot * x, b - dot * y, c - dot * z
            length = math.hypot(u, v, w)
            if length > 0.0:
                break
    else:
        u, v, w = (0.0, z, -y) if abs(y) > _NEARLY_PARALLEL else (-z, 0.0, x)
        length = math.hypot(u, v, w) or 1.0  # a normal of no length is refused elsewhere
    u, v, w = u / length, v / length, w / length
    return [u, y * w - z * v, v, z * u - x * w, w, x * v - y * u]


class Pyramid(ConeModel):
    """The paper's pyramids: edge m lies on Coulomb's cone at the angle 2 pi m / r from t1."""

    name, about = "edges", "pyramids of cone_edges edges"
    is_coulomb = regular = True

    def corners(self, edges: int) -> FloatArray:
        """Return equally spaced points of the unit circle."""
        angles = 2.0 * np.pi * np.arange(edges) / edges
        return np.column_stack([np.cos(angles), np.sin(angles)])

    def section(self, edges: int) -> Section:
        """Return the regular polygon inscribed in the unit circle."""
        return _regular_section(edges)

    def words(self, edges: int) -> str:
        """Return the number of edges."""
        return f"{edges} cone edges"

    def signature(self, edges: int) -> str:
        """Return the number of edges."""
        return str(edges)


class RoundCone(Pyramid):
    """Coulomb's cone itself, |f_t| <= mu f_n; pyramids approximate it in `C`, `H` and pictures."""

    name, about = "round", "Coulomb's round cones"
    second_order, regular = True, False

    def words(self, edges: int) -> str:
        """Return the name: the cones have no edges."""
        return f"{self.name} cones"

    def signature(self, edges: int) -> str:
        """Return the name: the number of edges concerns pictures only."""
        return self.name

    def surface_distances(self, forces: FloatArray, friction: FloatArray, edges: int) -> FloatArray:
        """Return (c,) (mu f_n - |f_t|) / sqrt(1 + mu^2), negative outside."""
        friction_size = np.sqrt(np.einsum("ij,ij->i", forces[:, 1:], forces[:, 1:]))
        return (friction * forces[:, 0] - friction_size) / np.sqrt(1.0 + friction**2)


@cache
def _regular_section(edges: int) -> Section:
    angles = 2.0 * np.pi * (np.arange(edges) + 0.5) / edges
    directions = read_only(np.stack([np.cos(angles), np.sin(angles)]))
    corners = read_only(Pyramid().corners(edges))
    return Section(corners, directions, read_only(np.full(edges, np.cos(np.pi / edges))))


CONE_MODELS: dict[str, ConeModel] = {
    model.name: model
    for model in (
        Pyramid(),
        RoundCone(),
    )
}
"""All friction cone models by their names as ``cone``: a new model is added to this list."""


def checked_cone(cone: str) -> str:
    """Return the name of a cone model.

    Raises:
        ArgumentError: If there is none of this name.
    """
    return one_of(CONE_MODELS, "cone", cone)
