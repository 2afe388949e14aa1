"""An interactive page in the browser, with controls of a scene's friction, mass, slope and joints.

The page itself needs the extra ``viewer``; its content is computed without it.
"""

from graspless_pin.viewer.controls import Control, changed_scene, controls_of
from graspless_pin.viewer.page import Viewer, view
from graspless_pin.viewer.scene_process import (
    Settings,
    SettingsAnswer,
    answer_settings,
    initial_settings,
)

__all__ = [
    "Control",
    "Settings",
    "SettingsAnswer",
    "Viewer",
    "answer_settings",
    "changed_scene",
    "controls_of",
    "initial_settings",
    "view",
]
