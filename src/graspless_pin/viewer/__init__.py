"""An interactive page in the browser: a scene whose friction, mass, slope and joints can be moved.

The page itself needs the extra ``viewer``; what it shows is worked out without it.
"""

from typing import Any

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

_RENAMED = {"Evaluation": "SettingsAnswer", "evaluate": "answer_settings"}


def __getattr__(name: str) -> Any:
    """Say the successor of a name that was given up."""
    if name in _RENAMED:
        raise AttributeError(f"{__name__}.{name} was renamed to {_RENAMED[name]}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
