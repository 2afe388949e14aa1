from .algorithms.comparison import RuleComparison, compare_rules, solve_each_mode
from .algorithms.disturbances import DisturbanceMargin, disturbance_margin
from .algorithms.explanation import Explanation, Suggestion, explain
from .algorithms.force_bounds import ContactForceBounds, contact_force_bounds
from .algorithms.gradients import Gradients, OptimumGradients, optimum_gradients
from .algorithms.guaranteed_disturbance import GuaranteedDisturbance, guaranteed_disturbance
from .algorithms.margin_torque_curve import MarginTorqueCurve, margin_torque_curve
from .algorithms.minimum_friction import MinimumFriction, minimum_friction
from .algorithms.options import SolveOptions
from .algorithms.robustness import Robustness, robustness
from .algorithms.sensitivity import MarginSensitivity, margin_sensitivity
from .algorithms.torque import maximize_margin, minimize_torque, optimize
from .algorithms.what_would_hold import HoldingChange, HoldingChanges, what_would_hold
from .errors import GrasplessPinError
from .findings import Finding, FindingCode, Severity
from .geometry.hand.model import Hand
from .holding.free_motions import free_motions
from .holding.stability import stability
from .holding.verdict import (
    ContactState,
    DynamicOutcome,
    RestProof,
    Stability,
    StabilityVerdict,
)
from .modes.enumeration import enumerate_modes
from .modes.rules import Rules, SignRule, SlidingMode, SlidingRule, StaticFriction
from .planning.evaluator import Evaluator
from .planning.path import Waypoint, evaluate_path
from .planning.placing import place_hand
from .problem.fingers import ControlMode, FingerContacts, JointSpace, assemble_joint_space
from .problem.joint_units import JointUnit
from .problem.quasistatic import QuasistaticProblem
from .problem.wrenches import force_first, moment_first
from .programs.builder import ProgramBuilder
from .programs.forces import ForceCoordinates, ForceRows
from .programs.objectives import Margin, Objective, Torque, TorqueShare
from .scene.load import load_scene
from .scene.minimum_stiffness import MinimumStiffness, minimum_stiffness
from .scene.poses import close_fingers, fingertip_contact, settle
from .scene.scene import Scene
from .solution.certificate import Certificate
from .solution.guarantee import Guarantee
from .solution.status import Status
from .solution.torque_solution import TorqueSolution
from .solvers.solving import available_solvers
from .studies.results import read_results
from .studies.run import run_study
from .studies.study import load_study

__all__ = [
    "Certificate",
    "ContactForceBounds",
    "ContactState",
    "ControlMode",
    "DisturbanceMargin",
    "DynamicOutcome",
    "Evaluator",
    "Explanation",
    "Finding",
    "FindingCode",
    "FingerContacts",
    "ForceCoordinates",
    "ForceRows",
    "Gradients",
    "GrasplessPinError",
    "Guarantee",
    "GuaranteedDisturbance",
    "Hand",
    "HoldingChange",
    "HoldingChanges",
    "JointSpace",
    "JointUnit",
    "Margin",
    "MarginSensitivity",
    "MarginTorqueCurve",
    "MinimumFriction",
    "MinimumStiffness",
    "Objective",
    "OptimumGradients",
    "ProgramBuilder",
    "QuasistaticProblem",
    "RestProof",
    "Robustness",
    "RuleComparison",
    "Rules",
    "Scene",
    "Severity",
    "SignRule",
    "SlidingMode",
    "SlidingRule",
    "SolveOptions",
    "Stability",
    "StabilityVerdict",
    "StaticFriction",
    "Status",
    "Suggestion",
    "Torque",
    "TorqueShare",
    "TorqueSolution",
    "Waypoint",
    "assemble_joint_space",
    "available_solvers",
    "close_fingers",
    "compare_rules",
    "contact_force_bounds",
    "disturbance_margin",
    "enumerate_modes",
    "evaluate_path",
    "explain",
    "fingertip_contact",
    "force_first",
    "free_motions",
    "guaranteed_disturbance",
    "load_scene",
    "load_study",
    "margin_sensitivity",
    "margin_torque_curve",
    "maximize_margin",
    "minimize_torque",
    "minimum_friction",
    "minimum_stiffness",
    "moment_first",
    "optimize",
    "optimum_gradients",
    "place_hand",
    "read_results",
    "robustness",
    "run_study",
    "settle",
    "solve_each_mode",
    "stability",
    "what_would_hold",
]
