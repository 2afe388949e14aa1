"""Placed grips with soft bodies that twice the feedback does not hold: what the reason is.

The same run with bodies of a hardness between soft and stiff, with ten times the feedback, and how
far the object has gone when it is let go.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from tabulate import tabulate

from benchmarks.grip_runs import MARGIN
from graspless_pin import Controller, Scene
from graspless_pin.problem.checks import FloatArray
from graspless_pin.simulation import SimulatedRun, simulate
from graspless_pin.simulation.model import SOFT, ContactModel

BETWEEN = ContactModel("between", 3e-3, (0.97, 0.997))
SECONDS = 4.0
MORE = 10.0
"""Times the feedback."""
STILL = 0.1
"""Of the whole way: what goes less far in the second half of the run has settled."""


@dataclass(frozen=True)
class SoftCase:
    """A grip with soft bodies that twice the feedback that is needed does not hold.

    Attributes:
        grip: Hand, object and rank.
        algorithm: Whose torques.
        needed: Feedback that is said to be needed, N m/rad (N/m).
        outcome: With twice of it.
        way: How far the object goes in all, m.
        at_release: How far it has gone when it is let go, m.
        rotation: rad.
        settles: Whether it has come to rest after half of the run.
        between: The outcome with bodies harder than soft, and the same feedback.
        with_more: The outcome with ten times the feedback.
    """

    grip: str
    algorithm: str
    needed: float
    outcome: str
    way: float
    at_release: float
    rotation: float
    settles: bool
    between: str
    with_more: str

    @property
    def cause(self) -> str:
        """The reason in words."""
        if self.between != "held":
            return "not softness alone"
        if self.settles:
            return "goes along with bodies that sink in, and rests"
        return "soft contacts give way: more feedback is needed"

    def __str__(self) -> str:
        """Return it in one line."""
        return (
            f"{self.grip}, {self.algorithm}, needs {self.needed:.3g}: {self.outcome}, "
            f"{1e3 * self.way:.2f} mm ({1e3 * self.at_release:.2f} mm when it is let go), "
            f"{np.degrees(self.rotation):.2f} deg; harder bodies: {self.between}; ten times the "
            f"feedback: {self.with_more}; {self.cause}"
        )


def soft_cases(scene: Scene, grip: str, failed: Sequence[tuple[str, float]]) -> Iterator[SoftCase]:
    """Yield the reasons of one grip's failures.

    Args:
        scene: The grip.
        grip: Its name.
        failed: Algorithm and the feedback that is said to be needed.
    """
    for algorithm, needed in failed:
        more: dict[str, Any] = {"margin": MARGIN} if algorithm == "torque" else {}
        torques = scene.solve(algorithm, **more).torques

        def run(gain: float, model: ContactModel, torques: FloatArray = torques) -> SimulatedRun:
            held = scene.with_changes(controller=Controller(gain))
            (done,) = simulate(held, torques, seconds=SECONDS, contact_models=[model]).runs
            return done

        soft = run(2.0 * needed, SOFT)
        places = soft.T_world_object[:, :3, 3]
        ways = np.linalg.norm(places - places[0], axis=1)
        start = scene.object.T_world_object[:3, 3]
        late = float(np.abs(ways[len(ways) // 2 :] - ways[-1]).max())
        yield SoftCase(
            grip, algorithm, needed, str(soft.outcome), soft.displacement,
            float(np.linalg.norm(places[0] - start)), soft.rotation,
            late < STILL * soft.displacement,
            str(run(2.0 * needed, BETWEEN).outcome), str(run(2.0 * MORE * needed, SOFT).outcome),
        )  # fmt: skip


def soft_summary(found: Sequence[SoftCase]) -> str:
    """Return the table of causes, and each case."""
    causes = Counter((one.cause, one.between, one.with_more) for one in found)
    headers = ["cause", "harder bodies", "ten times the feedback", "cases"]
    rows = [[*key, count] for key, count in sorted(causes.items())]
    return "\n".join(
        [
            "Soft bodies, not held with twice the feedback:", "",
            tabulate(rows, headers, "github"), "", *(f"- {one}" for one in found),
        ]
    )  # fmt: skip
