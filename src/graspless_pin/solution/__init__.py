"""What the algorithms return."""

from graspless_pin.solution.records import (
    Algorithm,
    Certificate,
    ProofMultipliers,
    Status,
    TorqueSolution,
    checked_solution,
)

__all__ = [
    "Algorithm",
    "Certificate",
    "ProofMultipliers",
    "Status",
    "TorqueSolution",
    "checked_solution",
]
