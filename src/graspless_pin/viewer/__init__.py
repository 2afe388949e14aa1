"""An interactive page in the browser: a scene whose friction, mass, slope and joints can be moved.

The page itself needs the extra ``viewer``; what it shows is worked out without it.
"""

from graspless_pin.viewer.controls import Control, changed_scene, controls_of
from graspless_pin.viewer.evaluation import Evaluation, Settings, evaluate, initial_settings
from graspless_pin.viewer.page import Viewer, view

__all__ = [
    "Control",
    "Evaluation",
    "Settings",
    "Viewer",
    "changed_scene",
    "controls_of",
    "evaluate",
    "initial_settings",
    "view",
]
