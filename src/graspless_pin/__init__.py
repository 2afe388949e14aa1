"""Robust joint torques for quasi-static graspless manipulation.

Which joint torques keep a push, slide, pivot or hold robust while the object also leans on its
surroundings, and how robust is it? The method is Makita and Maeda's *Joint Torque Optimization for
Quasi-static Graspless Manipulation*.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from graspless_pin.algorithms.comparison import compare_rules, solve_each_mode
from graspless_pin.algorithms.disturbances import disturbance_margin
from graspless_pin.algorithms.explanation import explain
from graspless_pin.algorithms.force_bounds import contact_force_bounds
from graspless_pin.algorithms.gradients import optimum_gradients
from graspless_pin.algorithms.margin_torque_curve import margin_torque_curve
from graspless_pin.algorithms.minimum_friction import minimum_friction
from graspless_pin.algorithms.sensitivity import margin_sensitivity
from graspless_pin.algorithms.torque import maximize_margin, minimize_torque
from graspless_pin.errors import GrasplessPinError
from graspless_pin.modes.enumeration import enumerate_modes
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem import (
    ControlMode,
    FingerContacts,
    JointSpace,
    QuasistaticProblem,
    assemble_joint_space,
)
from graspless_pin.problem.wrenches import force_first, moment_first
from graspless_pin.solution import Status, TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.geometry.hand.model import Hand
    from graspless_pin.planning import Evaluator, Waypoint, evaluate_path
    from graspless_pin.scene import Scene, close_fingers, fingertip_contact, load_scene, settle
    from graspless_pin.studies import load_study, read_results, run_study

__all__ = [
    "ControlMode",
    "Evaluator",
    "FingerContacts",
    "GrasplessPinError",
    "Hand",
    "JointSpace",
    "QuasistaticProblem",
    "Scene",
    "SlidingMode",
    "Status",
    "TorqueSolution",
    "Waypoint",
    "assemble_joint_space",
    "close_fingers",
    "compare_rules",
    "contact_force_bounds",
    "disturbance_margin",
    "enumerate_modes",
    "evaluate_path",
    "explain",
    "fingertip_contact",
    "force_first",
    "load_scene",
    "load_study",
    "margin_sensitivity",
    "margin_torque_curve",
    "maximize_margin",
    "minimize_torque",
    "minimum_friction",
    "moment_first",
    "optimum_gradients",
    "read_results",
    "run_study",
    "settle",
    "solve_each_mode",
]

# Pinocchio, coal and pandas are loaded when something asks for them: arrays do not need them.
_LAZY = {
    "Evaluator": "graspless_pin.planning",
    "Hand": "graspless_pin.geometry.hand.model",
    "Scene": "graspless_pin.scene",
    "Waypoint": "graspless_pin.planning",
    "close_fingers": "graspless_pin.scene",
    "fingertip_contact": "graspless_pin.scene",
    "settle": "graspless_pin.scene",
    "evaluate_path": "graspless_pin.planning",
    "load_scene": "graspless_pin.scene",
    "load_study": "graspless_pin.studies",
    "read_results": "graspless_pin.studies",
    "run_study": "graspless_pin.studies",
}


def __getattr__(name: str) -> Any:
    """Load the names that need large libraries at first use."""
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
