"""What is known of torques that were asked to have rest for their only outcome."""

from __future__ import annotations

from dataclasses import dataclass

from graspless_pin.holding.verdict import StabilityVerdict


@dataclass(frozen=True, eq=False)
class Guarantee:
    """What a search for torques of which rest is the only outcome has found.

    See the example of `stability`.

    Attributes:
        verdict: On the solution's torques; where none were found, on those of the best case. None
            in solutions that were read from documents.
        best_case: The best value of the objective over all forces that statics leave open, in its
            own unit; guaranteed torques are not better.
        gap: By how much the solution's value is worse, same unit; NaN where none was found. The
            gap to the best bound proven stands in the solution's `certificate`.
        tried: Sets of torques that verdicts were asked of.
    """

    verdict: StabilityVerdict | None
    best_case: float
    gap: float
    tried: int
