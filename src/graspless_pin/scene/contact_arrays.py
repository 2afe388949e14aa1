"""The contacts of a scene's object; they are found anew only where something has moved."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from graspless_pin.caching import Latest
from graspless_pin.errors import SceneError, StateError, StateFault
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.contact_points import (
    BodyKind,
    ContactArrays,
    ContactPoint,
    contacts_that_stay,
    support_velocities,
    velocities_at,
)
from graspless_pin.geometry.contact.finding import ContactLimits, contact_arrays
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Brief, changed
from graspless_pin.scene.fields import AnyScene, SceneFields, label_of, place_of
from graspless_pin.scene.stated import GivenContact, Motion


@dataclass(frozen=True, eq=False, repr=False)
class SceneContacts(Brief):
    """The contacts of a scene that carry force. See the example of `load_scene`.

    Attributes:
        arrays: M contacts, hand first.
        sliding: (M, 3) velocity of the object relative to the other body, zero where it sticks.
    """

    arrays: ContactArrays
    sliding: FloatArray

    @cached_property
    def points(self) -> tuple[ContactPoint, ...]:
        """The M contacts as single records."""
        return tuple(self.arrays)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the hand link or support at each of the M contacts."""
        return self.arrays.bodies


def touching_of(scene: SceneFields) -> ContactArrays:
    """Return all contacts, hand first, including those that the declared motion parts.

    Raises:
        SceneError: If bodies overlap too deeply, or a shape cannot be used.
    """
    given, hand, cache = scene.given_contacts, scene.hand, scene._cache
    if given is not None:
        links = () if hand is None else hand.link_names
        return cache.value("given", (given, *links), lambda: stated_contact_arrays(given, links))
    support_sources, all_sources = _contact_dependencies(scene)
    on_supports = cache.value(
        "on supports",
        support_sources,
        lambda: _contacts_with(scene, support_bodies(scene), BodyKind.SUPPORT),
    )
    hand_bodies = () if hand is None else hand.placed_bodies
    return cache.value(
        "touching",
        (*all_sources, on_supports),
        lambda: _contacts_with(scene, hand_bodies, BodyKind.HAND).followed_by(on_supports),
    )


def support_bodies(scene: SceneFields) -> PlacedBodies:
    """Return the convex pieces of all supports."""
    placed = [support.placed_bodies for support in scene.supports]
    return scene._cache.value("support bodies", (*placed,), lambda: PlacedBodies.joined(placed))


def pieces_by_body(scene: SceneFields) -> Mapping[str, list[CollisionBody]]:
    """Return the convex pieces of each support and hand link by name; none for other names."""
    hand_bodies = () if scene.hand is None else scene.hand.placed_bodies
    pieces: defaultdict[str, list[CollisionBody]] = defaultdict(list)
    for body in (*support_bodies(scene), *hand_bodies):
        pieces[body.name].append(body)
    return pieces


def _contacts_with(
    scene: SceneFields, bodies: Sequence[CollisionBody], kind: BodyKind
) -> ContactArrays:
    """Return the contacts of a scene's object with given bodies, all of one kind."""
    try:
        limits = ContactLimits(
            scene.contact_tolerance, scene.max_penetration, scene.points_per_patch
        )
        return contact_arrays(scene.object.placed_bodies, bodies, kind, limits)
    except StateError as error:
        raise error.at(place_of(scene, "object", "pose")) from error
    except SceneError as error:
        raise error.at(label_of(scene)) from error


def stated_contact_arrays(given: Sequence[GivenContact], links: Sequence[str]) -> ContactArrays:
    """Return stated contacts as arrays, those on hand links first."""
    kinds = [BodyKind.HAND if contact.body in links else BodyKind.SUPPORT for contact in given]
    points = [
        ContactPoint(contact.body, kind, contact.position, contact.normal, 0.0)
        for contact, kind in zip(given, kinds, strict=True)
    ]
    return ContactArrays.of(sorted(points, key=lambda point: point.kind is BodyKind.SUPPORT))


def with_touching(scene: AnyScene, touching: ContactArrays) -> AnyScene:
    """Return a scene with known contacts, which are not looked for until bodies move.

    Args:
        scene: The scene, with a hand.
        touching: All contacts, none of them with a support.
    """
    new_scene = changed(scene, *scene._DERIVED, _cache=Latest())
    support_sources, all_sources = _contact_dependencies(new_scene)
    no_contacts = new_scene._cache.put("on supports", support_sources, ContactArrays.of(()))
    new_scene._cache.put("touching", (*all_sources, no_contacts), touching)
    return new_scene


def _contact_dependencies(scene: SceneFields) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return the data that support contacts depend on, and the further data of all contacts."""
    hand, placed = scene.hand, scene.object.placed_bodies
    limits = scene.contact_tolerance, scene.max_penetration, scene.points_per_patch
    supports = [support.placed_bodies for support in scene.supports]
    hand_sources = () if hand is None else (hand.positions, hand.tree)
    return (placed, *supports, *limits), (*hand_sources, placed, *limits)


def contacts_of(scene: SceneFields) -> SceneContacts:
    """Return the contacts that carry force: without those that the declared motion parts.

    Raises:
        StateError: See `Scene.contacts`.
        SceneError: Likewise.
    """
    touching = touching_of(scene)
    sources = touching, scene.motion, scene.supports, scene.object, scene.hand
    # Cached in addition to `Scene.contacts`, as checks and problems of one state call this.
    return scene._cache.value("contacts", sources, lambda: _contacts_after_motion(scene, touching))


def _contacts_after_motion(scene: SceneFields, touching: ContactArrays) -> SceneContacts:
    if not len(touching):
        nothing = f"nothing touches object {scene.object.name!r}"
        advice = (
            f" within {scene.contact_tolerance:g} m; move the hand or the object, or raise "
            "contact_tolerance"
        )
        if scene.given_contacts is not None:
            advice = "; contacts is an empty list: fill it, or leave it out to have them found"
        raise StateError(StateFault.NO_CONTACT, f"{label_of(scene)}: {nothing}{advice}")
    if scene.motion is None and not any(support.is_moving for support in scene.supports):
        return SceneContacts(touching, np.zeros((len(touching), 3)))
    motion, center = scene.motion or Motion(np.zeros(6)), scene.object.center_of_mass_world
    try:
        body_velocities = _body_velocities(scene, touching, motion)
        staying, sliding = contacts_that_stay(
            touching, motion.object_twist, center, body_velocities, scene.object.name
        )
    except SceneError as error:
        raise error.at(f"{label_of(scene)}: motion") from error
    if len(staying) == len(touching):
        return SceneContacts(touching, sliding)
    if not staying:
        raise StateError(
            StateFault.PARTED,
            f"{label_of(scene)}: the declared motion separates object {scene.object.name!r} from "
            "all bodies that touch it; no contact is left",
        )
    return SceneContacts(touching.at_indices(staying), sliding[staying])


def _body_velocities(scene: SceneFields, touching: ContactArrays, motion: Motion) -> FloatArray:
    """Return (M, 3) velocities of the bodies at the contacts, m/s; a hand follows by default.

    Args:
        scene: The scene.
        touching: M contacts, hand first.
        motion: The declared motion.
    """
    count, center = touching.hand_count, scene.object.center_of_mass_world
    velocities = np.zeros((len(touching), 3))
    if any(support.is_moving for support in scene.supports):
        velocities = support_velocities(touching, scene.supports)
    if motion.hand is None:
        points = touching.positions[:count]
        velocities[:count] = velocities_at(motion.object_twist, center, points)
    elif scene.hand is not None:
        velocities[:count] = scene.hand.point_velocities(
            touching.bodies[:count],
            touching.positions[:count],
            motion.hand.joint_velocities,
            motion.hand.base_twist,
        )
    return velocities
