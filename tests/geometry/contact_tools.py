"""Contacts of an object with hand links and supports, for the tests of contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactPoint
from graspless_pin.geometry.contact.finding import ContactLimits, contact_arrays


def find_contacts(
    made: CollisionBody | Sequence[CollisionBody],
    links: Sequence[CollisionBody],
    supports: Sequence[CollisionBody],
    **limits: Any,
) -> tuple[ContactPoint, ...]:
    """Contacts of an object, or its pieces, with links and then with supports."""
    pieces = [made] if isinstance(made, CollisionBody) else made
    own = ContactLimits(**limits)
    kinds = (links, BodyKind.HAND), (supports, BodyKind.SUPPORT)
    return tuple(one for bodies, kind in kinds for one in contact_arrays(pieces, bodies, kind, own))
