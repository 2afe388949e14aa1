"""Whether a scene's hand stands where its torques mean nothing: off the object, or in something.

`Scene.findings`, evaluators, studies and paths all ask here.
"""

from __future__ import annotations

from typing import NamedTuple

from graspless_pin.errors import StateError, StateFault
from graspless_pin.findings import Finding, FindingCode, gravest_first
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.geometry.posing.overlaps import Overlap, unwanted_overlaps
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.fields import SceneFields


class StateChecks(NamedTuple):
    """What is looked for in a state.

    Attributes:
        collisions: Whether links may not be deeper than ``max_penetration`` in a support or in each
            other, see `unwanted_overlaps`.
        need_hand: Whether the hand has to touch the object.
    """

    collisions: bool = True
    need_hand: bool = True


ALL_CHECKS = StateChecks()


def state_findings(scene: SceneFields, checks: StateChecks = ALL_CHECKS) -> tuple[Finding, ...]:
    """Return the serious findings that depend on where bodies are, the gravest first.

    Args:
        scene: The scene.
        checks: What is looked for.

    Raises:
        SceneError: If the hand has to touch, and the contacts cannot be found for another reason
            than that nothing touches.
    """
    if scene.hand is None:
        return ()
    found = [_of_overlap(one) for one in hand_overlaps(scene)] if checks.collisions else []
    if checks.need_hand and not _hand_touches(scene):
        found.append(
            Finding(
                FindingCode.HAND_TOUCHES_NOTHING,
                scene.object.name,
                f"no link of the hand touches object '{scene.object.name}'",
                "move the hand (base_pose, in metres and radians), have it placed (graspless-pin "
                "place), or close its fingers (graspless-pin close)",
                ("hand", "base_pose"),
            )
        )
    return gravest_first(found) if len(found) > 1 else tuple(found)


def hand_overlaps(scene: SceneFields) -> tuple[Overlap, ...]:
    """Return where the hand is in itself or in a support deeper than ``max_penetration``."""
    hand, deepest = scene.hand, scene.max_penetration
    if hand is None:
        return ()
    supports = [support.placed_bodies for support in scene.supports]
    sources = hand.positions, hand.tree, *supports, deepest
    overlaps = scene._kept.get("overlaps", sources)
    if overlaps is None:
        overlaps = unwanted_overlaps(hand, scene.supports, tolerance=deepest)
        scene._kept.put("overlaps", sources, overlaps)
    return overlaps


def _hand_touches(scene: SceneFields) -> bool:
    try:
        return contacts_of(scene).arrays.hand_count > 0
    except StateError as error:
        if error.kind is StateFault.NO_CONTACT:
            return False
        raise


def _of_overlap(one: Overlap) -> Finding:
    on_support = one.kind is BodyKind.SUPPORT
    return Finding(
        FindingCode.HAND_THROUGH_SUPPORT if on_support else FindingCode.HAND_THROUGH_ITSELF,
        one.link,
        str(one),
        "move the hand (base_pose, q): it cannot stand there"
        if on_support
        else "change q; if only the collision shapes are too wide, disable the pair in an SRDF",
        ("hand",),
    )
