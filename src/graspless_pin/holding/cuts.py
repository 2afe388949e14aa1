"""Planes around friction cones, and around the forces and slips of an arc: rows of programs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray

_INSIDE = 1e-8
"""Share of the friction by which tangents of cones lie inside: the points on them are outcomes."""


def around(count: int) -> FloatArray:
    """Return ``count`` unit vectors (count, 2), evenly spaced."""
    angles = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angles), np.sin(angles)])


def cone_planes(friction: FloatArray | float, directions: FloatArray) -> FloatArray:
    """Return rows (k, 3) r with r.f <= 0: d.f_t <= mu f_n for each direction d (k, 2)."""
    normal = np.broadcast_to(-np.asarray(friction), len(directions))
    return np.column_stack([normal, directions])


def cone_tangents(
    forces: FloatArray, friction: FloatArray, among: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the tangents of cones beside forces outside them.

    Args:
        forces: (M, 3).
        friction: (M,).
        among: (M,) contacts whose forces are looked at.

    Returns:
        The k contacts, and rows (k, 3) as of `cone_planes`.
    """
    sides, most = np.hypot(forces[:, 1], forces[:, 2]), friction * np.maximum(forces[:, 0], 0.0)
    outside = np.flatnonzero(among & (sides > most + 0.1 * _INSIDE * sides))
    toward = forces[outside, 1:] / sides[outside, None]
    return outside, cone_planes((1.0 - _INSIDE) * friction[outside], toward)


def arc_rows(center: float, half_width: float, friction: float) -> tuple[FloatArray, FloatArray]:
    """Return what a slip in an arc of at most pi says of itself and of the force.

    Args:
        center: Angle of the arc's middle, rad.
        half_width: At most pi / 2, rad.
        friction: Coefficient.

    Returns:
        Rows (2, 2) e with e.u_t >= 0, and rows (3, 3) r with r.f <= 0: the force is opposite.
    """
    low, high = center - half_width, center + half_width
    edges = np.array([[-np.sin(low), np.cos(low)], [np.sin(high), -np.cos(high)]])
    faces = np.zeros((3, 3))
    faces[:2, 1:] = edges
    faces[2] = friction * np.cos(half_width), np.cos(center), np.sin(center)
    return edges, faces
