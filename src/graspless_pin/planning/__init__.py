"""Many states of one scene: evaluating them, paths through them, and gradients."""

from graspless_pin.planning.configuration_gradient import (
    ConfigurationGradient,
    configuration_gradient,
)
from graspless_pin.planning.edges import MotionFault, MotionMargins, StateValidity
from graspless_pin.planning.evaluation import Evaluation, StateStatus
from graspless_pin.planning.evaluator import Evaluator
from graspless_pin.planning.many_states import EvaluatedStates
from graspless_pin.planning.path import ContactChange, PathProfile, Waypoint, evaluate_path
from graspless_pin.planning.path_files import joint_trajectory, read_path_csv, write_path_csv
from graspless_pin.planning.path_timing import PathTiming, TimingLimit, fastest_timing
from graspless_pin.planning.pinned_contacts import Derivatives, PinnedState
from graspless_pin.planning.placing import HandPlacement, PlacedHand, place_hand
from graspless_pin.planning.placing_candidates import PlacingFault
from graspless_pin.planning.placing_plan import PlacingAim
from graspless_pin.planning.squeeze_window import (
    EndReason,
    OtherJoints,
    SqueezeWindow,
    WindowEnd,
    squeeze_window,
)

__all__ = [
    "ConfigurationGradient",
    "ContactChange",
    "Derivatives",
    "EndReason",
    "EvaluatedStates",
    "Evaluation",
    "Evaluator",
    "HandPlacement",
    "MotionFault",
    "MotionMargins",
    "OtherJoints",
    "PathProfile",
    "PathTiming",
    "PinnedState",
    "PlacedHand",
    "PlacingAim",
    "PlacingFault",
    "SqueezeWindow",
    "StateStatus",
    "StateValidity",
    "TimingLimit",
    "Waypoint",
    "WindowEnd",
    "configuration_gradient",
    "evaluate_path",
    "fastest_timing",
    "joint_trajectory",
    "place_hand",
    "read_path_csv",
    "squeeze_window",
    "write_path_csv",
]
