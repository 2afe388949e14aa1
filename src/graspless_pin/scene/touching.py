"""All that touches a scene's object, looked for again only where something has moved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from graspless_pin.derived import Latest
from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactArrays
from graspless_pin.geometry.contact.finding import contact_arrays
from graspless_pin.scene.motion_and_contacts import given_arrays

if TYPE_CHECKING:
    from graspless_pin.scene.scene import Scene


def touching_of(scene: Scene, kept: Latest) -> ContactArrays:
    """Return all contacts before the motion, hand first.

    Args:
        scene: The scene.
        kept: What was found last.

    Raises:
        SceneError: If bodies overlap too deeply, or a shape cannot be used.
    """
    given, hand = scene.given_contacts, scene.hand
    if given is not None:
        links = () if hand is None else hand.link_names
        return kept.of("given", (given, *links), lambda: given_arrays(given, links))
    limits = scene.contact_tolerance, scene.max_penetration, scene.points_per_patch
    placed = scene.object.placed_bodies

    def found(bodies: Sequence[CollisionBody], kind: BodyKind) -> ContactArrays:
        tolerance, overlap, points = limits
        try:
            return contact_arrays(
                placed,
                bodies,
                kind,
                tolerance=tolerance,
                max_penetration=overlap,
                max_points=points,
            )
        except SceneError as error:
            raise error.at(label_of(scene)) from error

    each = [support.placed_bodies for support in scene.supports]

    def found_on_supports() -> ContactArrays:
        bodies = kept.of("support bodies", (*each,), lambda: PlacedBodies.joined(each))
        return found(bodies, BodyKind.SUPPORT)

    on_supports = kept.of("on supports", (placed, *each, *limits), found_on_supports)
    if hand is None:
        return found((), BodyKind.HAND).followed_by(on_supports)
    return kept.of(
        "touching",
        (hand.positions, hand.tree, placed, on_supports, *limits),
        lambda: found(hand.placed_bodies, BodyKind.HAND).followed_by(on_supports),
    )


def label_of(scene: Scene) -> str:
    """Return what messages call a scene."""
    return scene.name if scene.path is None else str(scene.path)
