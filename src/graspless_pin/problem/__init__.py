"""The quasi-static problem as arrays, and the paper's matrices."""

from graspless_pin.problem.fingers import (
    ControlMode,
    FingerContacts,
    JointSpace,
    assemble_joint_space,
)
from graspless_pin.problem.quasistatic import QuasistaticProblem, checked_problem

__all__ = [
    "ControlMode",
    "FingerContacts",
    "JointSpace",
    "QuasistaticProblem",
    "assemble_joint_space",
    "checked_problem",
]
