"""The text that ``graspless-pin simulate`` prints, and a simulated run as an HTML page.

The page shows the object at several times in one picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.force_bounds import ContactForceBounds
from graspless_pin.geometry import ManipulatedObject
from graspless_pin.holding.controller import CONSTANT_TORQUES
from graspless_pin.report.html.page import render, view_context
from graspless_pin.scene import Scene
from graspless_pin.scene.minimum_stiffness import controller_words
from graspless_pin.simulation import SimulatedOutcome, SimulatedRun, Simulation
from graspless_pin.simulation.protocol import change_of_pose
from graspless_pin.solution import Status
from graspless_pin.solution.tables import Table, decimals
from graspless_pin.visualization import Role
from graspless_pin.visualization.drawing import draw_bodies
from graspless_pin.visualization.picture import Mark


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
        """Return how far the force of one run is outside the range, N; 0 where the object moves."""
        force = self.simulated[run]
        return 0.0 if force is None else max(self.lower - force, force - self.upper, 0.0)


def body_forces(
    simulation: Simulation, bodies: Sequence[str], bounds: ContactForceBounds
) -> tuple[BodyForce, ...]:
    """Return simulated normal forces beside their ranges, by body: contact points may differ.

    Args:
        simulation: The simulation.
        bodies: (M,) names of the bodies at the problem's contacts.
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


_SAME_FORCE = 1e-2  # of the load: smaller differences are not reported


def simulation_text(
    simulation: Simulation, bodies: Sequence[str], bounds: ContactForceBounds
) -> str:
    """Return the outcome in words, a table of the runs and one of normal forces.

    Args:
        simulation: The simulation.
        bodies: (M,) names of the bodies at the problem's contacts.
        bounds: Force ranges for the same problem and torques.
    """
    headline, _, runs = str(simulation).partition("\n\n")
    parts = [headline, runs]
    for link, support in simulation.model.left_out:
        parts.append(f"note: link {link} overlaps support {support}: they do not collide here")
    if not bounds.found:
        return "\n\n".join([*parts, f"no force ranges: {bounds.message}"])
    forces = body_forces(simulation, bodies, bounds)
    parts[0] += _unloaded_bodies_text(simulation, forces)
    parts += [_force_table(simulation, forces, bounds), f"ranges go {bounds.covers}"]
    parts += [
        *filter(None, [bounds.squeeze_words(bodies)]),
        *_largest_excess_lines(simulation, forces),
    ]
    return "\n\n".join(parts)


def _unloaded_bodies_text(simulation: Simulation, forces: Sequence[BodyForce]) -> str:
    """Return which bodies end without a force although their proven ranges are above zero."""
    least = _SAME_FORCE * simulation.problem.scales.force
    clauses = []
    for k, run in enumerate(simulation.runs):
        lost = [one.body for one in forces if one.lower > least and one.simulated[k] == 0.0]
        if lost:
            verb = "carries" if len(lost) == 1 else "carry"
            clauses.append(f"{', '.join(lost)} {verb} no force ({run.contact_model.name} bodies)")
    return f"; but at the end {'; '.join(clauses)}" if clauses else ""


def _force_table(
    simulation: Simulation, forces: Sequence[BodyForce], bounds: ContactForceBounds
) -> str:
    load = simulation.problem.scales.force
    known = "proven" if bounds.status is Status.OPTIMAL else "reached"
    headers = ["normal force [N] on", *(run.contact_model.name for run in simulation.runs), known]
    rows: list[list[object]] = [
        [
            force.body,
            *("moves" if value is None else decimals(value, load) for value in force.simulated),
            f"{decimals(force.lower, load)} .. {decimals(force.upper, load)}",
        ]
        for force in forces
    ]
    return str(Table(rows, headers))


def _largest_excess_lines(simulation: Simulation, forces: Sequence[BodyForce]) -> list[str]:
    """Return a sentence on the largest excess over a range; none where the object always moves."""
    if all(run.outcome is SimulatedOutcome.MOVED for run in simulation.runs):
        return []
    excesses = [
        (force.excess(k), force.body, k) for k in range(len(simulation.runs)) for force in forces
    ]
    excess, body, run = max(excesses)
    if excess <= _SAME_FORCE * simulation.problem.scales.force:
        return ["no force is outside these ranges by more than 1 % of the load"]
    name = simulation.runs[run].contact_model.name
    return [f"largest force outside these ranges: {excess:.3g} N, on {body} ({name} bodies)"]


_MOST_TIMES = 6
_FAINT, _CLEAR = 0.15, 0.6  # opacity of the first and of the last pose
_TURN_LENGTH = 0.1  # m per radian, in the length of the object's path


def time_lapse_html(lapse: dict[str, Any]) -> str:
    """Return a simulation as a self-contained HTML page.

    Raises:
        GrasplessPinError: If Jinja2 or matplotlib is not installed.
    """
    return render("simulation.html", lambda: {"title": lapse["title"], "lapse": lapse})


def time_lapse(scene: Scene, simulation: Simulation, text: str) -> dict[str, Any]:
    """Return the page context of a simulation: of the run in which the object moves farthest.

    Args:
        scene: The simulated scene.
        simulation: The simulation.
        text: Its figures, see `simulation_text`.

    Returns:
        ``title`` of the scene, ``held`` (whether the object stays), ``outcome``, ``bodies`` (the
        contact model) and ``driven`` (the controller) in words, ``rows`` (time (s), displacement
        (mm) and rotation (deg) of each pose), ``text``, and the context of the 3-D ``view``.

    Raises:
        MeshError: A mesh file is missing or unreadable.
    """
    run = max(simulation.runs, key=lambda one: (one.displacement, one.rotation))
    chosen = _evenly_spaced_poses(simulation.model.object, run)
    picture = draw_bodies(scene)
    (first,) = picture.of(Role.OBJECT)
    shown = [replace(first, opacity=_FAINT)]
    for number, T in enumerate(run.T_world_object[chosen[1:]], start=1):
        (body,) = draw_bodies(
            scene.with_changes(object=scene.object.with_pose(T), hand=None, supports=())
        ).of(Role.OBJECT)
        share = number / (len(chosen) - 1)
        opacity = _FAINT + share * (_CLEAR - _FAINT)
        shown.append(replace(body, name=f"{body.name}/{number}", opacity=opacity))
    still_meshes = [mesh for mesh in picture.meshes if mesh.role is not Role.OBJECT]
    poses = run.T_world_object[chosen]
    centers = poses[:, :3, :3] @ scene.object.center_of_mass + poses[:, :3, 3]
    changes = [change_of_pose(simulation.model.object, T) for T in poses]
    rows = [
        (f"{time:.2f}", f"{1e3 * distance:.2f}", f"{np.degrees(angle):.2f}")
        for time, (distance, angle) in zip(run.times[chosen], changes, strict=True)
    ]
    marks = [
        Mark(str(index), Role.CONTACT, center, index,
             (f"after {row[0]} s", f"displacement {row[1]} mm", f"rotation {row[2]} deg"))
        for index, (center, row) in enumerate(zip(centers, rows, strict=True))
    ]  # fmt: skip
    return {
        "title": scene.name,
        "held": simulation.outcome is SimulatedOutcome.HELD,
        "outcome": simulation.outcome.value.capitalize(),
        "bodies": run.contact_model.name.capitalize(),
        "driven": controller_words(scene) or CONSTANT_TORQUES,
        "rows": rows,
        "text": text,
        "view": view_context(
            "lapse-view",
            "the simulation",
            replace(picture, meshes=(*still_meshes, *shown), marks=(*picture.marks, *marks)),
            f"Shows the hand, the supports, and the object {scene.object.name} at each time.",
            "time numbers",
        ),
    }


def _evenly_spaced_poses(start: ManipulatedObject, run: SimulatedRun) -> NDArray[np.intp]:
    """Return indices of poses evenly spaced along the object's path, first and last included."""
    changes = np.array([change_of_pose(start, T) for T in run.T_world_object])
    travel = np.maximum.accumulate(changes @ [1.0, _TURN_LENGTH])
    wanted = np.linspace(travel[0], travel[-1], _MOST_TIMES)
    return np.unique([0, *np.searchsorted(travel, wanted[1:-1]).tolist(), len(travel) - 1])
