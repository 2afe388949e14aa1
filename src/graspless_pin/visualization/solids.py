"""Arrows, balls and pyramids as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.cones import default_tangents

BALL_RINGS = 6
_SECTIONS = 12  # of an arrow's circles
Solid = tuple[FloatArray, NDArray[np.int64]]
"""(V, 3) vertices and (F, 3) faces."""


def arrow_surface(start: ArrayLike, along: ArrayLike, radius: float) -> Solid:
    """Return an arrow: a shaft and a head whose tip is at the end.

    Args:
        start: (3,) where it starts, m.
        along: (3,) from its start to its tip, m; not zero.
        radius: Radius of the shaft, m; the head is wider, and both are slimmer on a short arrow.
    """
    vector = np.asarray(along, dtype=float)
    length = float(np.linalg.norm(vector))
    shaft = min(radius, 0.12 * length)
    head = min(5.0 * shaft, 0.45 * length)
    profile = [(0.0, 0.0), (shaft, 0.0), (shaft, length - head), (2.2 * shaft, length - head)]
    return _turned([*profile, (0.0, length)], start, vector / length)


def ball_surface(center: ArrayLike, radius: float, rings: int = BALL_RINGS) -> Solid:
    """Return a ball about (3,) ``center``, m; of two rings: a diamond."""
    angles = np.linspace(0.0, np.pi, rings + 1)
    profile = [(radius * np.sin(angle), -radius * np.cos(angle)) for angle in angles]
    profile[0], profile[-1] = (0.0, -radius), (0.0, radius)
    return _turned(profile, center, np.array([0.0, 0.0, 1.0]))


def pyramid_surface(apex: ArrayLike, edges: FloatArray) -> Solid:
    """Return the cone between an apex and the ends of its edges.

    Args:
        apex: (3,) m.
        edges: (r, 3) from the apex to the corners of the base, m, in the order that turns
            right-handed about the axis from the apex to the base.
    """
    tip = np.asarray(apex, dtype=float)
    count = len(edges)
    vertices = np.vstack([tip, tip + edges, tip + edges.mean(axis=0)])
    here = np.arange(1, count + 1)
    following = np.roll(here, -1)
    sides = np.column_stack([np.zeros(count, dtype=int), following, here])
    base = np.column_stack([np.full(count, count + 1), here, following])
    return vertices, np.vstack([sides, base]).astype(np.int64)


def _turned(profile: list[tuple[float, float]], start: ArrayLike, axis: FloatArray) -> Solid:
    """Turn a profile of (radius, height) about an axis; it begins and ends on the axis."""
    t1, t2 = default_tangents(axis[None])[0].T
    origin = np.asarray(start, dtype=float)
    angles = 2.0 * np.pi * np.arange(_SECTIONS) / _SECTIONS
    circle = np.cos(angles)[:, None] * t1 + np.sin(angles)[:, None] * t2
    rings = [radius * circle + height * axis for radius, height in profile[1:-1]]
    ends = [profile[0][1] * axis, profile[-1][1] * axis]
    vertices = origin + np.vstack([ends[0], *rings, ends[1]])
    here = np.arange(_SECTIONS)
    following = np.roll(here, -1)
    last = len(vertices) - 1
    faces = [np.column_stack([np.zeros_like(here), 1 + following, 1 + here])]
    for ring in range(len(rings) - 1):
        low, high = 1 + ring * _SECTIONS, 1 + (ring + 1) * _SECTIONS
        faces.append(np.column_stack([low + here, low + following, high + following]))
        faces.append(np.column_stack([low + here, high + following, high + here]))
    top = last - _SECTIONS
    faces.append(np.column_stack([top + here, top + following, np.full_like(here, last)]))
    return vertices, np.vstack(faces).astype(np.int64)
