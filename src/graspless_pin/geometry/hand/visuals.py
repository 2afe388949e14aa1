"""What a hand looks like: triangles of its links at its configuration."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from graspless_pin.errors import MeshError
from graspless_pin.geometry.bodies.shapes import shape_of
from graspless_pin.geometry.bodies.triangles import Triangles, file_triangles, simplified
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.urdf_visuals import LinkVisual


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
            triangles = simplified(shape_of(body.geometry).surface(), max_faces)
            yield body.name, triangles.moved(body.T_world_geometry)


def _visual_triangles(visual: LinkVisual, max_faces: int) -> Triangles:
    """Return the triangles of one visual shape in its link's frame."""
    surface = (
        file_triangles(visual.shape, visual.scale, max_faces, upright=False)
        if isinstance(visual.shape, Path)
        else visual.shape.surface()
    )
    return surface.moved(visual.T_link_visual)
