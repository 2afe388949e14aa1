"""What ``graspless-pin simulate`` prints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graspless_pin.algorithms.force_bounds import ContactForceBounds
from graspless_pin.simulation import SimulatedOutcome, Simulation
from graspless_pin.solution import Status
from graspless_pin.solution.tables import Table, shown


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


_SAME = 1e-2  # of the load: a difference that says nothing
_WORDS = {
    SimulatedOutcome.HELD: "held: the object stays",
    SimulatedOutcome.SHIFTED: "shifted: the object moves, and then stays where it is",
    SimulatedOutcome.CREPT: "crept: the object neither stays nor moves away",
    SimulatedOutcome.MOVED: "moved: the object does not stay",
}
_RUNS = ["bodies", "outcome", "displacement [mm]", "rotation [deg]", "moved after [s]"]


def simulation_text(
    simulation: Simulation, bodies: Sequence[str], bounds: ContactForceBounds
) -> str:
    """Return the outcome in words, a table of the runs and one of normal forces.

    Args:
        simulation: The simulation.
        bodies: (M,) names of what touches at the problem's contacts.
        bounds: Force ranges for the same problem and torques.
    """
    parts = [_headline(simulation), str(Table(_runs(simulation), _RUNS))]
    for link, support in simulation.model.left_out:
        parts.append(f"note: link {link} stands in support {support}: the two do not meet")
    if not bounds.found:
        return "\n\n".join([*parts, f"no force ranges: {bounds.status.message}"])
    forces = body_forces(simulation, bodies, bounds)
    parts += [_force_table(simulation, forces, bounds), f"ranges go {bounds.covers}"]
    parts += [*filter(None, [bounds.squeeze_words(bodies)]), *_largest_excess(simulation, forces)]
    return "\n\n".join(parts)


def _headline(simulation: Simulation) -> str:
    """Return the outcome, and with which bodies it is another one."""
    others = [
        f"{run.contact_model.name} bodies: {run.outcome}"
        for run in simulation.runs
        if run.outcome is not simulation.outcome
    ]
    return _WORDS[simulation.outcome] + (f" ({', '.join(others)})" if others else "")


def _runs(simulation: Simulation) -> list[list[object]]:
    return [
        [
            run.contact_model.name,
            str(run.outcome),
            f"{run.displacement * 1e3:.3f}",
            f"{np.degrees(run.rotation):.3f}",
            "" if run.moved_after is None else f"{run.moved_after:.2f}",
        ]
        for run in simulation.runs
    ]


def _force_table(
    simulation: Simulation, forces: Sequence[BodyForce], bounds: ContactForceBounds
) -> str:
    load = simulation.problem.scales.force
    known = "proven" if bounds.status is Status.OPTIMAL else "reached"
    headers = ["normal force [N] on", *(run.contact_model.name for run in simulation.runs), known]
    rows: list[list[object]] = [
        [
            force.body,
            *("moves" if value is None else shown(value, load) for value in force.simulated),
            f"{shown(force.lower, load)} .. {shown(force.upper, load)}",
        ]
        for force in forces
    ]
    return str(Table(rows, headers))


def _largest_excess(simulation: Simulation, forces: Sequence[BodyForce]) -> list[str]:
    """Return what there is to say of forces outside their ranges, if the object stays anywhere."""
    if all(run.outcome is SimulatedOutcome.MOVED for run in simulation.runs):
        return []
    found = [
        (force.excess(k), force.body, k) for k in range(len(simulation.runs)) for force in forces
    ]
    excess, body, run = max(found)
    if excess <= _SAME * simulation.problem.scales.force:
        return ["no force is outside these ranges by more than 1 % of the load"]
    name = simulation.runs[run].contact_model.name
    return [f"largest force outside these ranges: {excess:.3g} N, on {body} ({name} bodies)"]
