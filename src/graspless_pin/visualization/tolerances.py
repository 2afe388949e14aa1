"""The centre of mass, and where it may be, drawn in the object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graspless_pin.algorithms.tolerances import Tolerance, Tolerances
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.visualization.picture import Mesh, Picture, Role, across_gravity
from graspless_pin.visualization.primitives import Solid, ball_surface, bar_surface

_COUNT = 72
_LEVEL = 1e-6  # of a change
# Lengths as shares of the size of the object.
_BALL = 0.045
_RIM = 0.012
_FARTHEST = 1.1
_LEAST = 1e-3
_OPACITY = 0.85


def level_boundary(one: Tolerance, level: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how large a change may be all around a plane: (K,) angles, rad, and (K,) sizes.

    Args:
        one: A tolerance with a boundary.
        level: (2, 3) unit vectors that span the plane, the first at angle 0.
    """
    angles = 2.0 * np.pi * np.arange(_COUNT) / _COUNT
    if one.boundary is not None:  # each corner that lies in the plane, too
        along = one.boundary @ level.T
        sizes = np.linalg.norm(one.boundary, axis=1)
        corners = along[(sizes > 0.0) & (np.linalg.norm(along, axis=1) > (1.0 - _LEVEL) * sizes)]
        turned = np.arctan2(corners[:, 1], corners[:, 0]) % (2.0 * np.pi)
        angles = np.unique(np.append(angles, turned).round(9))
    return angles, one.along(_ways(angles, level))


def with_tolerances(
    picture: Picture, tolerances: Tolerances, origin: FloatArray, size: float
) -> Picture:
    """Return a picture with the centre of mass, and the level region in which it may lie.

    The region has a rim but where it goes beyond the object, and none if it is a point.

    Args:
        picture: The picture.
        tolerances: They tell of the centre of mass, or nothing is added.
        origin: (3,) the object's centre of mass in the picture, m.
        size: Radius of the object, m.
    """
    found = [one for one in tolerances.each if one.quantity is Quantity.CENTER]
    if not found:
        return picture
    role = Role.CENTER_OF_MASS
    meshes = [Mesh(str(role), role, *ball_surface(origin, _BALL * size))]
    level = across_gravity(tolerances.weight)
    angles, radii = level_boundary(found[0], level)
    if float(radii.max()) > _LEAST * size:
        role, within = Role.CENTER_REGION, radii < _FARTHEST * size
        ends = origin + np.minimum(radii, _FARTHEST * size)[:, None] * _ways(angles, level)
        meshes.append(Mesh(f"{role}/inside", role, *_fan(origin, ends), _OPACITY))
        rim = [
            bar_surface(ends[k - 1], ends[k], _RIM * size)
            for k in np.flatnonzero(within & np.roll(within, 1)).tolist()
        ]
        if rim:
            meshes.append(Mesh(f"{role}/rim", role, *_joined(rim)))
    return replace(picture, meshes=(*picture.meshes, *meshes))


def _ways(angles: FloatArray, level: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(angles), np.sin(angles)]) @ level


def _fan(middle: FloatArray, ends: FloatArray) -> Solid:
    """Return the triangles between a point and neighbouring ends all around it."""
    here = np.arange(1, len(ends) + 1)
    faces = np.column_stack([np.zeros_like(here), here, np.roll(here, -1)])
    return read_only(np.vstack([middle, ends])), faces.astype(np.int64)


def _joined(solids: list[Solid]) -> Solid:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in solids[:-1])])
    faces = [faces + start for (_, faces), start in zip(solids, starts, strict=True)]
    return read_only(np.vstack([vertices for vertices, _ in solids])), np.vstack(faces)
