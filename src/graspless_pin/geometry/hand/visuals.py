"""What a hand looks like: triangles of its links at its configuration."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np

from graspless_pin.errors import MeshError
from graspless_pin.geometry.bodies.meshes import file_state, load_mesh
from graspless_pin.geometry.bodies.triangles import (
    Triangles,
    geometry_triangles,
    shape_triangles,
    simplified,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.urdf_visuals import LinkVisual

_REMEMBERED = 256


def hand_triangles(hand: Hand, *, max_faces: int = 1500) -> Iterator[tuple[str, Triangles]]:
    """Yield the link and the triangles of each of a hand's shapes, world frame, m.

    A link looks as the URDF's visual shapes say; one that has none, or none that can be read, as
    its collision shapes.

    Args:
        hand: The hand at its configuration.
        max_faces: Most triangles of one shape; finer meshes are simplified.
    """
    visuals: dict[str, list[LinkVisual]] = {}
    for visual in hand.tree.visuals:
        visuals.setdefault(visual.link, []).append(visual)
    drawn: set[str] = set()
    for link, items in visuals.items():
        try:
            surfaces = [_visual_triangles(item, max_faces) for item in items]
        except MeshError:
            continue  # the collision shapes will do
        drawn.add(link)
        T = hand.link_pose(link)
        yield from ((link, surface.moved(T)) for surface in surfaces)
    for body in hand.collision_bodies():
        if body.name not in drawn:
            triangles = simplified(geometry_triangles(body.geometry), max_faces)
            yield body.name, triangles.moved(body.T_world_geometry)


def _visual_triangles(visual: LinkVisual, max_faces: int) -> Triangles:
    """Return the triangles of one visual shape in its link's frame."""
    if isinstance(visual.shape, Path):
        state = file_state(visual.shape)
        surface = _file_triangles(visual.shape, visual.scale, max_faces, state)
    else:
        surface = shape_triangles(visual.shape)
    return surface.moved(visual.T_link_visual)


@lru_cache(maxsize=_REMEMBERED)
def _file_triangles(
    path: Path, scale: tuple[float, float, float], max_faces: int, _state: tuple[str, int, int]
) -> Triangles:
    """Read a mesh file; a scale that mirrors it turns its triangles round."""
    mesh = load_mesh(path)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    faces = np.array(mesh.faces)
    faces = faces[:, ::-1] if np.prod(scale) < 0.0 else faces
    return simplified(Triangles(np.array(mesh.vertices) * np.array(scale), faces), max_faces)
