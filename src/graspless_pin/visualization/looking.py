"""Which way is up, from where to look, and from how far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST, Picture, Role

_FORWARD, _HEIGHT = 0.35, 0.5
_TOO_SHORT = 1e-9
_LOW, _STEP = np.radians(10.0), np.radians(1.0)
# Only what is nearer to the middle than this is framed, in radii: of hands, whose arms are context,
# and of all else; the slab of a half-space, 1.3 of the object's radii to each side, lies within.
_HAND_FRAMED, _FRAMED = 1.05, 2.3
_ROOM = 1.08


def up_against(force: FloatArray) -> FloatArray:
    """(3,) unit vector against gravity or weight; z where there is none."""
    length = float(np.linalg.norm(force))
    if length <= _TOO_SHORT:
        return read_only(np.array([0.0, 0.0, 1.0]))
    return read_only(0.0 - force / length)  # without negative zeros


def look_across(away: FloatArray, up: FloatArray, walls: Sequence[FloatArray] = ()) -> FloatArray:
    """(3,) unit vector to where object and hand are seen side by side, from somewhat above.

    Args:
        away: (3,) from the object to the hand, m; anything without a horizontal part means no
            hand.
        up: (3,) unit.
        walls: (3,) outward normals of planes, to be seen from outside rather than from behind.
    """
    level = _level(away, up)
    side = np.cross(level, up)
    choices = [
        across * side + forward * level + _HEIGHT * up
        for forward in (_FORWARD, -_FORWARD)
        for across in (1.0, -1.0)
    ]
    best = max(choices, key=lambda way: min((0.0, *(float(way @ wall) for wall in walls))))
    return read_only(best / np.linalg.norm(best))


def _level(away: FloatArray, up: FloatArray) -> FloatArray:
    """Return the unit horizontal part of a vector, or of an axis where it has none."""
    level = away - (away @ up) * up
    if np.linalg.norm(level) <= _TOO_SHORT + 0.1 * np.linalg.norm(away):
        level = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
        level -= (level @ up) * up
    return level / np.linalg.norm(level)


def preset_views(
    away: FloatArray, up: FloatArray, walls: Sequence[FloatArray], floors: FloatArray
) -> Mapping[str, FloatArray]:
    """Return unit vectors to where object and hand are seen from the front, a side and the top.

    The front is where the object is seen before the hand, or the hand before it if a wall stands
    there. None of them is below a floor.

    Args:
        away: (3,) from the object to the hand, m, see `look_across`.
        up: (3,) unit.
        walls: (3,) outward normals of planes, to be seen from outside rather than from behind.
        floors: (K, 4) of `Picture.floors`.
    """
    level = _level(away, up)
    side = np.cross(level, up)
    found = {}
    for name, way in (("front", -level), ("side", side)):
        seen = max((way, -way), key=lambda one: min((0.0, *(float(one @ wall) for wall in walls))))
        found[name] = read_only(_raised(seen, up, floors))
    # Not quite from above, so that up stays up.
    found["top"] = read_only(_raised(found["side"], up, floors, np.radians(88.0)))
    return found


def _raised(
    level: FloatArray, up: FloatArray, floors: FloatArray, tilt: float = _LOW
) -> FloatArray:
    """Return a direction at an angle above the level, or as far above as is in front of floors."""
    level = level - (level @ up) * up
    level /= np.linalg.norm(level)
    while True:
        way = np.cos(tilt) * level + np.sin(tilt) * up
        if tilt >= 0.5 * np.pi or (floors[:, :3] @ way >= np.sin(_LOW)).all():
            return way
        tilt += _STEP


def framing(
    picture: Picture, field_of_view: float, aspect: float, toward: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Where a camera looks, and from how far, to see all that matters.

    Args:
        picture: The picture.
        field_of_view: Vertical, rad.
        aspect: Width over height of the drawing.
        toward: (3,) unit vector to the camera; None: ``view_from``.

    Returns:
        (3,) point to look at and the camera's distance from it, m.
    """
    toward, up = picture.view_from if toward is None else toward, picture.up
    right = np.cross(up, toward)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(toward, right), toward])
    near = []
    for mesh in picture.meshes:
        if mesh.role not in HIDDEN_AT_FIRST:
            reach = _HAND_FRAMED if mesh.role is Role.HAND else _FRAMED
            vertices = mesh.vertices - picture.center
            near.append(vertices[np.linalg.norm(vertices, axis=1) < reach * picture.radius])
    seen = np.vstack(near) @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * [1.0, 1.0, 0.0]
    x, y, z = (seen - middle).T
    slope = np.tan(0.5 * field_of_view)
    distance = float(np.max(np.maximum(np.abs(x) / aspect, np.abs(y)) * _ROOM / slope + z))
    return picture.center + middle @ axes, distance
