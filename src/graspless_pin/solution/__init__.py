"""What the algorithms return."""

from graspless_pin.solution.records import Algorithm, Certificate, Status, TorqueSolution

__all__ = ["Algorithm", "Certificate", "Status", "TorqueSolution"]
