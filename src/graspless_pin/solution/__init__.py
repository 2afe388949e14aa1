"""What the algorithms return."""

from graspless_pin.solution.certificate import (
    FOUND,
    UNDECIDED,
    Certificate,
    Evidence,
    Guarantee,
    Status,
)
from graspless_pin.solution.torque_solution import TorqueSolution, checked_solution

__all__ = [
    "FOUND",
    "UNDECIDED",
    "Certificate",
    "Evidence",
    "Guarantee",
    "Status",
    "TorqueSolution",
    "checked_solution",
]
