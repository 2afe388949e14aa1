"""What a hand looks like: triangles of its links at its configuration."""

from __future__ import annotations

from collections.abc import Iterator

from graspless_pin.geometry.bodies.triangles import Triangles, geometry_triangles, simplified
from graspless_pin.geometry.hand.model import Hand


def hand_triangles(hand: Hand, *, max_faces: int = 1500) -> Iterator[tuple[str, Triangles]]:
    """Yield the link and the triangles of each of a hand's shapes, world frame, m.

    Args:
        hand: The hand at its configuration.
        max_faces: Most triangles of one shape; finer meshes are simplified.
    """
    for body in hand.collision_bodies():
        triangles = simplified(geometry_triangles(body.geometry), max_faces)
        yield body.name, triangles.moved(body.T_world_geometry)
