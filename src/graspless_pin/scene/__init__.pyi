from .load import load_scene
from .motion_and_contacts import GivenContact, HandMotion, Motion, SceneContacts
from .poses import (
    ClosedScene,
    PlacedScene,
    close_fingers,
    fingertip_contact,
    settle,
)
from .scene import Scene
from .scene_schema import scene_json_schema

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
