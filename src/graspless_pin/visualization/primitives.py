"""Surfaces of arrows, bars, balls and cones; world axes, gravity and the scale of forces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.cones import default_tangents
from graspless_pin.visualization.picture import ForceScale, Mark, Mesh, Picture, Role

BALL_RINGS = 6
_SECTIONS = 12  # of an arrow's circles
Solid = tuple[FloatArray, NDArray[np.int64]]
"""(V, 3) vertices and (F, 3) faces."""


def arrow_surface(start: ArrayLike, along: ArrayLike, radius: float) -> Solid:
    """Return an arrow: a shaft and a head whose tip is at the end.

    Args:
        start: (3,) the foot, m.
        along: (3,) from the foot to the tip, m; not zero.
        radius: Radius of the shaft, m; the head is wider, and both are slimmer on a short arrow.
    """
    vector = np.asarray(along, dtype=float)
    length = float(np.linalg.norm(vector))
    shaft = min(radius, 0.12 * length)
    head = min(5.0 * shaft, 0.45 * length)
    profile = [(0.0, 0.0), (shaft, 0.0), (shaft, length - head), (2.2 * shaft, length - head)]
    return _surface_of_revolution([*profile, (0.0, length)], start, vector / length)


def bar_surface(start: FloatArray, end: FloatArray, radius: float) -> Solid:
    """Return a round bar between two points (3,), m."""
    length = float(np.linalg.norm(end - start))
    profile = [(0.0, 0.0), (radius, 0.0), (radius, length), (0.0, length)]
    axis = (end - start) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    return _surface_of_revolution(profile, start, axis)


def ball_surface(center: ArrayLike, radius: float, rings: int = BALL_RINGS) -> Solid:
    """Return a ball about (3,) ``center``, m; with two rings a diamond."""
    angles = np.linspace(0.0, np.pi, rings + 1)
    profile = [(radius * np.sin(angle), -radius * np.cos(angle)) for angle in angles]
    profile[0], profile[-1] = (0.0, -radius), (0.0, radius)
    return _surface_of_revolution(profile, center, np.array([0.0, 0.0, 1.0]))


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


def _surface_of_revolution(
    profile: list[tuple[float, float]], start: ArrayLike, axis: FloatArray
) -> Solid:
    """Return the surface of revolution of a profile of (radius, height) that ends on the axis."""
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


# Lengths as shares of the size of the object.
_ASIDE, _BEFORE = 1.15, 1.0
_HEIGHT = 0.45
_ARM = 0.3
_DOWN = 0.38
_LETTER = 1.25
_CLEAR = 0.05
_SHAFT = 0.018
_LONGEST = 0.55
_STEPS = (1, 2, 5, 10, 20, 50, 100)


def with_bearings(
    picture: Picture, size: float, gravity: ArrayLike | None, planes: FloatArray
) -> Picture:
    """Return a picture with the directions of the world axes and of gravity beside the object.

    They are drawn away from the hand, towards the camera, in front of all planes.

    Args:
        picture: The picture.
        size: Radius of the object, m.
        gravity: (3,) m/s^2; None or zero: it is not drawn.
        planes: (K, 4) planes (n, d): the arrows stay in n^T x > d.
    """
    up = picture.up
    right = np.cross(up, picture.view_from)
    right /= np.linalg.norm(right)
    before = np.cross(right, up)
    bodies = picture.of(Role.OBJECT) or picture.meshes
    corners = np.vstack([mesh.vertices for mesh in bodies]) if bodies else picture.center[None]
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    hand = [mesh.vertices - middle for mesh in picture.of(Role.HAND)]
    nearby = [vertices[np.linalg.norm(vertices, axis=1) < 3.0 * size] for vertices in hand]
    reach = float(np.vstack(nearby).mean(axis=0) @ right) if any(map(len, nearby)) else 0.0
    aside = -1.0 if reach >= 0.0 else 1.0
    foot = middle + size * (aside * _ASIDE * right + _BEFORE * before)
    foot += (float((corners @ up).min()) - foot @ up) * up
    for plane in planes:
        normal, along = plane[:3], up if plane[:3] @ up > _CLEAR else plane[:3]
        shortfall = plane[3] + _CLEAR * size - normal @ foot
        foot = foot + max(shortfall, 0.0) / (normal @ along) * along
    start = foot + _HEIGHT * size * up
    meshes, marks = [], []
    vectors = dict(zip("xyz", _ARM * np.eye(3), strict=True))
    acceleration = np.zeros(3) if gravity is None else np.asarray(gravity, dtype=float)
    if acceleration.any():
        vectors["g"] = _DOWN * acceleration / np.linalg.norm(acceleration)
    for name, vector in vectors.items():
        role = Role.GRAVITY if name == "g" else Role.AXES
        arrow = arrow_surface(start, size * vector, _SHAFT * size)
        meshes.append(Mesh(f"{role}/{name}", role, *arrow))
        beside = _LETTER * vector if role is Role.AXES else 0.6 * vector - 0.12 * right
        marks.append(Mark(name, role, read_only(start + size * beside)))
    return replace(picture, meshes=(*picture.meshes, *meshes), marks=(*picture.marks, *marks))


def with_force_scale(picture: Picture, metres_per_newton: float, size: float) -> Picture:
    """Return a picture that states the scale of its forces, with an arrow of a round force.

    Args:
        picture: A picture with axes; the arrow starts below these.
        metres_per_newton: The scale; 0: there are no forces.
        size: Radius of the object, m.
    """
    if metres_per_newton <= 0.0:
        return picture
    scale = ForceScale.fitting(metres_per_newton, size)
    times = max((k for k in _STEPS if k * scale.length <= _LONGEST * size), default=1)
    right = np.cross(picture.up, picture.view_from)
    right /= np.linalg.norm(right)
    start = picture.of(Role.AXES)[0].vertices[0] - 1.3 * _HEIGHT * size * picture.up
    along = times * scale.length * right
    arrow = arrow_surface(start - 0.5 * along, along, _SHAFT * size)
    words = str(scale._replace(force=times * scale.force)).partition(" = ")[2]
    mark = Mark(words, Role.FORCE_SCALE, read_only(start - 0.1 * size * picture.up))
    mesh = Mesh(str(Role.FORCE_SCALE), Role.FORCE_SCALE, *arrow)
    return replace(
        picture,
        meshes=(*picture.meshes, mesh),
        marks=(*picture.marks, mark),
        force_scale=scale,
    )
