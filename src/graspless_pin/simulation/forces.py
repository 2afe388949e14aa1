"""Simulated normal forces beside the ranges that are proven for the torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graspless_pin.algorithms.force_bounds import ContactForceBounds
from graspless_pin.simulation.protocol import SimulatedOutcome, Simulation


@dataclass(frozen=True)
class BodyForce:
    """The normal force between the object and one body.

    Attributes:
        body: Hand link or support.
        simulated: Mean force at the end of each run, N; None where the object moves.
        lower: Smallest sum of its contacts' proven ranges, N; 0 where it has no contact.
        upper: Largest such sum, N.
    """

    body: str
    simulated: tuple[float | None, ...]
    lower: float
    upper: float

    def excess(self, run: int) -> float:
        """Return how far the force of one run is outside the range, N; 0 where it moves."""
        force = self.simulated[run]
        return 0.0 if force is None else max(self.lower - force, force - self.upper, 0.0)


def body_forces(
    simulation: Simulation, bodies: Sequence[str], bounds: ContactForceBounds
) -> tuple[BodyForce, ...]:
    """Compare a simulation with force ranges, body by body: contact points may differ.

    Args:
        simulation: The simulation.
        bodies: (M,) names of what touches at the problem's contacts.
        bounds: Ranges for the same problem and torques, see `contact_force_bounds`.
    """
    settled = [
        run if run.outcome is not SimulatedOutcome.MOVED else None for run in simulation.runs
    ]
    touching = {body for run in settled if run is not None for body in run.normal_forces}
    names = np.array(bodies)
    return tuple(
        BodyForce(
            body,
            tuple(None if run is None else run.normal_forces.get(body, 0.0) for run in settled),
            float(bounds.lower[names == body, 0].sum()),
            float(bounds.upper[names == body, 0].sum()),
        )
        for body in dict.fromkeys([*bodies, *sorted(touching)])
    )
