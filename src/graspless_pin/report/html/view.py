"""What all pages have: their template, and a 3-D view with layers and the picture as plain data."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.errors import optional_import
from graspless_pin.problem.checks import FloatArray
from graspless_pin.visualization import DARK, LIGHT, Picture, Role
from graspless_pin.visualization.motion import MovingPicture
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST

FILES = Path(__file__).with_name("files")
"""Templates, styles and scripts of pages."""
_MODEL_STEPS = 65535
_MODEL_DIGITS = 7
_BEARINGS = (Role.AXES, Role.GRAVITY, Role.FORCE_SCALE)


def view_context(
    name: str,
    label: str,
    picture: Picture,
    words: str,
    numbered: str,
    moving: MovingPicture | None = None,
    *,
    played: str = "",
) -> dict[str, Any]:
    """Return what a 3-D view of a page is filled with.

    Args:
        name: Its id, unique in the page.
        label: What it is a view of.
        picture: What there is to see.
        words: The same, for those who do not see it.
        numbered: What the numbers in the picture are.
        moving: How the picture moves; its numbers go with the object. None: it stands still.
        played: What moves, where that is played only when it is asked to; empty: a motion, which
            plays at once.
    """
    return {
        "name": name,
        "label": label,
        "words": words,
        "legend": _legend(picture),
        "fingers": picture.fingers,
        "force_scale": picture.force_scale,
        "model": _embedded(model_data(picture, moving) | {"plays": not played}),
        "numbered": numbered,
        "moves": (played or "motion") if moving is not None else "",
    }


def _legend(picture: Picture) -> list[dict[str, Any]]:
    """Return the layers of a picture in the order of `Role`; what tells directions is one."""
    found = [
        {"roles": role, "label": role.label, "swatch": role, "shown": role not in HIDDEN_AT_FIRST}
        for role in Role
        if picture.of(role) and role not in _BEARINGS
    ]
    bearings = [role for role in _BEARINGS if picture.of(role)]
    labels = ", ".join(role.label for role in bearings)
    words = {"roles": " ".join(bearings), "label": labels, "swatch": Role.AXES, "shown": True}
    return [*found, words]


def _embedded(data: Any) -> str:
    """JSON that no ``</script>`` inside a name can end early."""
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")


def model_data(picture: Picture, moving: MovingPicture | None = None) -> dict[str, Any]:
    """Return a picture as plain data for `json.dumps`.

    Vertices are rounded to 1/65535 of their mesh's size. ``data`` is base64 of the gzipped bytes
    of all vertices (uint16 triples, mesh by mesh), filled up to a multiple of 4, then of all
    faces (uint32 triples).

    Args:
        picture: The picture.
        moving: How its meshes move, if they do: ``paths`` of poses, three rows of four numbers
            each, and each mesh's ``path`` among them.
    """
    meshes, corners, faces = [], [], []
    for mesh in picture.meshes:
        low = mesh.vertices.min(axis=0)
        size = mesh.vertices.max(axis=0) - low
        steps = (mesh.vertices - low) / np.where(size > 0.0, size, 1.0)
        corners.append(np.round(_MODEL_STEPS * steps).astype("<u2").tobytes())
        faces.append(np.ascontiguousarray(mesh.faces, dtype="<u4").tobytes())
        moves = {} if moving is None else {"path": moving.path_of.get(mesh.name)}
        meshes.append(
            {
                **moves,
                "role": str(mesh.role),
                "framed": mesh.role not in HIDDEN_AT_FIRST,
                "opacity": mesh.opacity,
                "contact": mesh.contact,
                "finger": None if mesh.finger is None else mesh.finger % len(LIGHT.fingers),
                "vertices": len(mesh.vertices),
                "faces": len(mesh.faces),
                "low": _rounded(low),
                "size": _rounded(size),
            }
        )
    first = b"".join(corners)
    first += bytes(-len(first) % 4)
    data = gzip.compress(first + b"".join(faces), compresslevel=9, mtime=0)
    motion = {}
    if moving is not None:
        paths = [[_rounded(pose[:3].ravel()) for pose in path] for path in moving.paths]
        motion = {"seconds": float(moving.times[-1]), "paths": paths}
    return {
        **motion,
        "center": _rounded(picture.center),
        "radius": picture.radius,
        "up": _rounded(picture.up),
        "views": {
            "fit": _rounded(picture.view_from),
            **{name: _rounded(way) for name, way in picture.views.items()},
        },
        "floors": [_rounded(plane) for plane in picture.floors],
        "marks": [
            {
                "text": mark.text,
                "role": mark.role,
                "at": _rounded(mark.position),
                "contact": mark.contact,
                "words": mark.words,
            }
            for mark in picture.marks
        ],
        "meshes": meshes,
        "data": base64.b64encode(data).decode("ascii"),
    }


def _rounded(values: FloatArray) -> list[float]:
    return [round(float(value), _MODEL_DIGITS) for value in values]


def render(template: str, context: Callable[[], dict[str, Any]]) -> str:
    """Return a page: a template filled with what it needs of its own, and what all have.

    Args:
        template: Its file.
        context: Makes what it needs of its own; called once all that is needed is installed.

    Raises:
        GrasplessPinError: If Jinja2 or matplotlib is not installed.
    """
    with optional_import("reports need Jinja2 and matplotlib", "report"):
        import matplotlib  # noqa: F401
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
    environment = Environment(
        loader=FileSystemLoader(FILES),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    common = {
        "palettes": {"light": LIGHT, "dark": DARK},
        "style": (FILES / "style.css").read_text(encoding="utf-8"),
        "script": (FILES / "view.js").read_text(encoding="utf-8"),
    }
    return environment.get_template(template).render(common | context())
