"""Robust joint torques for quasi-static graspless manipulation.

Which joint torques keep a push, slide, pivot or hold robust while the object also leans on its
surroundings, and how robust is it? The method is Makita and Maeda's *Joint Torque Optimization for
Quasi-static Graspless Manipulation*.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graspless_pin.algorithms.comparison import compare_rules, solve_each_mode
    from graspless_pin.algorithms.disturbances import disturbance_margin
    from graspless_pin.algorithms.explanation import explain
    from graspless_pin.algorithms.force_bounds import contact_force_bounds
    from graspless_pin.algorithms.gradients import optimum_gradients
    from graspless_pin.algorithms.margin_torque_curve import margin_torque_curve
    from graspless_pin.algorithms.minimum_friction import minimum_friction
    from graspless_pin.algorithms.options import SolveOptions
    from graspless_pin.algorithms.sensitivity import margin_sensitivity
    from graspless_pin.algorithms.torque import maximize_margin, minimize_torque, optimize
    from graspless_pin.errors import GrasplessPinError
    from graspless_pin.geometry.hand.model import Hand
    from graspless_pin.modes.enumeration import enumerate_modes
    from graspless_pin.modes.rules import SlidingMode
    from graspless_pin.planning import Evaluator, Waypoint, evaluate_path
    from graspless_pin.problem import (
        ControlMode,
        FingerContacts,
        JointSpace,
        QuasistaticProblem,
        assemble_joint_space,
    )
    from graspless_pin.problem.wrenches import force_first, moment_first
    from graspless_pin.programs.builder import ProgramBuilder
    from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
    from graspless_pin.scene import Scene, close_fingers, fingertip_contact, load_scene, settle
    from graspless_pin.solution import Status, TorqueSolution
    from graspless_pin.studies import load_study, read_results, run_study

__all__ = [
    "ControlMode",
    "Evaluator",
    "FingerContacts",
    "GrasplessPinError",
    "Hand",
    "JointSpace",
    "Margin",
    "Objective",
    "ProgramBuilder",
    "QuasistaticProblem",
    "Scene",
    "SlidingMode",
    "SolveOptions",
    "Status",
    "Torque",
    "TorqueShare",
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
    "optimize",
    "optimum_gradients",
    "read_results",
    "run_study",
    "settle",
    "solve_each_mode",
]

# Each name is loaded at first use: arrays need no Pinocchio, scenes no pandas, and the command line
# is there to answer Ctrl-C while all of them are loaded.
_SOURCES = {
    "ControlMode": "problem",
    "Evaluator": "planning",
    "FingerContacts": "problem",
    "GrasplessPinError": "errors",
    "Hand": "geometry.hand.model",
    "JointSpace": "problem",
    "Margin": "programs.objectives",
    "Objective": "programs.objectives",
    "ProgramBuilder": "programs.builder",
    "QuasistaticProblem": "problem",
    "Scene": "scene",
    "SlidingMode": "modes.rules",
    "SolveOptions": "algorithms.options",
    "Status": "solution",
    "Torque": "programs.objectives",
    "TorqueShare": "programs.objectives",
    "TorqueSolution": "solution",
    "Waypoint": "planning",
    "assemble_joint_space": "problem",
    "close_fingers": "scene",
    "compare_rules": "algorithms.comparison",
    "contact_force_bounds": "algorithms.force_bounds",
    "disturbance_margin": "algorithms.disturbances",
    "enumerate_modes": "modes.enumeration",
    "evaluate_path": "planning",
    "explain": "algorithms.explanation",
    "fingertip_contact": "scene",
    "force_first": "problem.wrenches",
    "load_scene": "scene",
    "load_study": "studies",
    "margin_sensitivity": "algorithms.sensitivity",
    "margin_torque_curve": "algorithms.margin_torque_curve",
    "maximize_margin": "algorithms.torque",
    "minimize_torque": "algorithms.torque",
    "minimum_friction": "algorithms.minimum_friction",
    "moment_first": "problem.wrenches",
    "optimize": "algorithms.torque",
    "optimum_gradients": "algorithms.gradients",
    "read_results": "studies",
    "run_study": "studies",
    "settle": "scene",
    "solve_each_mode": "algorithms.comparison",
}

_RENAMED = {"picture": "graspless_pin.visualization"}


def __getattr__(name: str) -> Any:
    """Load a public name from where it is defined."""
    if name in _RENAMED:
        raise AttributeError(f"{__name__}.{name} was renamed to {_RENAMED[name]}")
    if name not in _SOURCES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_SOURCES[name]}"), name)
    return value


def __dir__() -> list[str]:
    """List the public names too, those not loaded yet included."""
    return sorted({*globals(), *__all__})
