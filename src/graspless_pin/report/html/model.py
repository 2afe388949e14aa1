"""A picture as compact data for the page's own 3-D view."""

from __future__ import annotations

import base64
import gzip
from typing import Any

import numpy as np

from graspless_pin.problem.checks import FloatArray
from graspless_pin.visualization import Picture

_STEPS = 65535
_DIGITS = 7


def model_data(picture: Picture, points: FloatArray) -> dict[str, Any]:
    """Return a picture as plain data for `json.dumps`.

    Vertices are rounded to 1/65535 of their mesh's size. ``data`` is base64 of the gzipped bytes
    of all vertices (uint16 triples, mesh by mesh), filled up to a multiple of 4, then of all
    faces (uint32 triples).

    Args:
        picture: The picture.
        points: (M, 3) contact points, m, to be labelled with their numbers.
    """
    meshes, corners, faces = [], [], []
    for mesh in picture.meshes:
        low = mesh.vertices.min(axis=0)
        size = mesh.vertices.max(axis=0) - low
        steps = (mesh.vertices - low) / np.where(size > 0.0, size, 1.0)
        corners.append(np.round(_STEPS * steps).astype("<u2").tobytes())
        faces.append(np.ascontiguousarray(mesh.faces, dtype="<u4").tobytes())
        meshes.append(
            {
                "role": str(mesh.role),
                "opacity": mesh.opacity,
                "vertices": len(mesh.vertices),
                "faces": len(mesh.faces),
                "low": _rounded(low),
                "size": _rounded(size),
            }
        )
    first = b"".join(corners)
    first += bytes(-len(first) % 4)
    data = gzip.compress(first + b"".join(faces), compresslevel=9, mtime=0)
    return {
        "center": _rounded(picture.center),
        "radius": picture.radius,
        "up": _rounded(picture.up),
        "points": [_rounded(point) for point in points],
        "meshes": meshes,
        "data": base64.b64encode(data).decode("ascii"),
    }


def _rounded(values: FloatArray) -> list[float]:
    return [round(float(value), _DIGITS) for value in values]
