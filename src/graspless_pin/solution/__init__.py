"""What the algorithms return."""

from graspless_pin.solution.certificate import Certificate
from graspless_pin.solution.guarantee import Guarantee
from graspless_pin.solution.proof import Evidence
from graspless_pin.solution.status import FOUND, Status
from graspless_pin.solution.torque_solution import TorqueSolution, checked_solution

__all__ = [
    "FOUND",
    "Certificate",
    "Evidence",
    "Guarantee",
    "Status",
    "TorqueSolution",
    "checked_solution",
]
