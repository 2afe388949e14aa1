"""What the algorithms return."""

from graspless_pin.solution.records import (
    Certificate,
    ProofMultipliers,
    Status,
    TorqueSolution,
    checked_solution,
)

__all__ = ["Certificate", "ProofMultipliers", "Status", "TorqueSolution", "checked_solution"]
