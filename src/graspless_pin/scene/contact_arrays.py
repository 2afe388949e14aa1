"""What touches a scene's object, looked for again only where something has moved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.errors import SceneError, StateError, StateFault
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactArrays
from graspless_pin.geometry.contact.finding import contact_arrays
from graspless_pin.geometry.contact.motion import checked_twist, classified, contacts_that_stay
from graspless_pin.scene.motion_and_contacts import (
    Motion,
    SceneContacts,
    body_velocities,
    given_arrays,
)
from graspless_pin.scene.scene_findings import nothing_touches

if TYPE_CHECKING:
    from graspless_pin.scene.scene import Scene


def touching_of(scene: Scene) -> ContactArrays:
    """Return all contacts before the motion, hand first.

    Raises:
        SceneError: If bodies overlap too deeply, or a shape cannot be used.
    """
    given, hand, kept = scene.given_contacts, scene.hand, scene._kept
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


def contacts_after_motion(scene: Scene, touching: ContactArrays) -> SceneContacts:
    """Return the contacts that carry force: those that the declared motion does not part.

    Args:
        scene: The scene.
        touching: All contacts before the motion.

    Raises:
        StateError: See `Scene.contacts`.
        SceneError: Likewise.
    """
    if not len(touching):
        raise StateError(StateFault.NO_CONTACT, f"{label_of(scene)}: {nothing_touches(scene)}")
    motion, supports = scene.motion, scene.supports
    moving = [one for one in supports if one.is_moving]
    if motion is None:
        if not moving:
            return SceneContacts(touching, np.zeros((len(touching), 3)))
        motion = Motion(np.zeros(6))
    center = scene.object.center_of_mass_world
    try:
        twist = checked_twist("object_twist", motion.object_twist)
        others = body_velocities(
            touching, scene.object, scene.hand, supports if moving else (), motion, twist
        )
        states = classified(touching, twist, center, others)
        kept = contacts_that_stay(touching, states, scene.object.name)
    except SceneError as error:
        raise error.at(f"{label_of(scene)}: motion") from error
    if len(kept) == len(touching):
        return SceneContacts(touching, states.sliding)
    if not kept:
        raise StateError(
            StateFault.PARTED,
            f"{label_of(scene)}: the declared motion parts object {scene.object.name!r} from "
            "everything that touches it; no contact is left",
        )
    return SceneContacts(touching.chosen(kept), states.sliding[kept])


def label_of(scene: Scene) -> str:
    """Return what messages call a scene."""
    return scene.name if scene.path is None else str(scene.path)
