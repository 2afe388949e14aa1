"""The only package that calls solver libraries: solve a program and check the answer.

If a solver's answer fails the check, another solver is called.
"""

from graspless_pin.programs.answers import PRIMAL_TOLERANCE, Answer, Outcome
from graspless_pin.solvers.conic_backends import least_within
from graspless_pin.solvers.solving import ANY_SOLVER, available_solvers, check_solver, solve

__all__ = [
    "ANY_SOLVER",
    "PRIMAL_TOLERANCE",
    "Answer",
    "Outcome",
    "available_solvers",
    "check_solver",
    "least_within",
    "solve",
]
