"""YAML scenes and the way from bodies to a problem."""

from graspless_pin.scene.load import load_scene
from graspless_pin.scene.motion_and_contacts import GivenContact, HandMotion, Motion, SceneContacts
from graspless_pin.scene.poses import (
    ClosedScene,
    PlacedScene,
    close_fingers,
    fingertip_contact,
    settle,
)
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.scene_schema import scene_json_schema

__all__ = [
    "ClosedScene",
    "GivenContact",
    "HandMotion",
    "Motion",
    "PlacedScene",
    "Scene",
    "SceneContacts",
    "close_fingers",
    "fingertip_contact",
    "load_scene",
    "scene_json_schema",
    "settle",
]
