"""Poses of a scene: close fingers, place fingertips, settle the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from graspless_pin.errors import SceneError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.closing import ClosingResult, close_hand
from graspless_pin.geometry.posing.fingertips import FingertipPlacement, place_fingertips
from graspless_pin.geometry.posing.overlaps import Overlap, unwanted_overlaps
from graspless_pin.geometry.posing.settling import settle_object
from graspless_pin.scene.fields import checked_scene, label_of, place_of
from graspless_pin.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class ClosedScene:
    """A scene after its fingers were closed. See the example of `close_fingers`.

    Attributes:
        scene: The scene with the closed hand.
        closing: What each finger touched and what stopped at a limit.
        overlaps: Hand links that overlap each other or a support.
    """

    scene: Scene
    closing: ClosingResult
    overlaps: tuple[Overlap, ...]


@dataclass(frozen=True, eq=False)
class PlacedScene:
    """A scene after its fingertips were placed. See the example of `fingertip_contact`.

    Attributes:
        scene: The scene with the moved hand.
        placement: Remaining distance of each fingertip from its point.
        overlaps: Hand links that overlap each other or a support.
    """

    scene: Scene
    placement: FingertipPlacement
    overlaps: tuple[Overlap, ...]


def close_fingers(
    scene: Scene,
    *,
    fingers: Sequence[str] | None = None,
    wrap: bool = False,
    rates: Mapping[str, float] | None = None,
) -> ClosedScene:
    """Close fingers until they touch the scene's object or reach their limits.

    Args:
        scene: A scene with a hand.
        fingers: Fingers to close; None closes all.
        wrap: Whether joints beyond a touching link of a finger go on closing.
        rates: Rate by joint: see `graspless_pin.geometry.posing.closing.close_hand`.

    Raises:
        SceneError: If the scene has no hand, or a finger starts inside the object.
        ArgumentError: If a finger or joint is unknown.

    Examples:
        >>> from graspless_pin import load_scene, close_fingers
        >>> scene = load_scene("examples/allegro_box_on_slope.yaml")
        >>> closed = close_fingers(scene, fingers=["index"])
        >>> print(closed.closing)
        index: touches with link_3.0_tip
    """
    result = close_hand(_hand_of(scene), scene.object, fingers=fingers, wrap=wrap, rates=rates)
    return ClosedScene(
        scene.with_changes(hand=result.hand),
        result,
        unwanted_overlaps(result.hand, scene.supports),
    )


def fingertip_contact(
    scene: Scene, goals: Mapping[str, tuple[ArrayLike, ArrayLike]]
) -> PlacedScene:
    """Move fingers so that their tips touch the scene's object at given points.

    Args:
        scene: A scene with a hand.
        goals: By finger, the (3,) point on the object's surface and the (3,) normal there into the
            object, world frame, m.

    Raises:
        SceneError: If the scene has no hand.
        ArgumentError: If a finger is unknown, or a point is not on the surface.

    Examples:
        >>> from graspless_pin import load_scene, fingertip_contact
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> point = scene.contacts.points[0]
        >>> placed = fingertip_contact(scene, {"finger_1": (point.position, point.normal)})
        >>> placed.overlaps
        ()
    """
    result = place_fingertips(_hand_of(scene), scene.object, goals)
    return PlacedScene(
        scene.with_changes(hand=result.hand),
        result,
        unwanted_overlaps(result.hand, scene.supports),
    )


def settle(scene: Scene) -> Scene:
    """Move the object along gravity until it rests on the scene's supports without overlap.

    Raises:
        SceneError: If nothing falls, or the object meets no support on its way.

    Examples:
        >>> from graspless_pin import load_scene, settle
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> settle(scene).object.T_world_object[2, 3].round(3).item()  # m
        0.05
    """
    checked_scene(scene)
    if not scene.gravity.any():
        where = place_of(scene, "gravity")
        raise SceneError(
            f"{where}: is zero, so the object does not settle; give gravity, or the object's pose"
        )
    moved = settle_object(scene.object, scene.supports, scene.gravity)
    return scene.with_changes(object=moved)


def _hand_of(scene: Scene) -> Hand:
    checked_scene(scene)
    if scene.hand is None:
        raise SceneError(f"{label_of(scene)}: this requires a hand, and the scene has none")
    return scene.hand
