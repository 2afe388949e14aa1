"""A simulated run as a page: the object at some times in one picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.geometry import ManipulatedObject
from graspless_pin.report.html.view import render, view_context
from graspless_pin.scene import Scene
from graspless_pin.simulation import SimulatedOutcome, SimulatedRun, Simulation
from graspless_pin.simulation.protocol import change_of_pose
from graspless_pin.visualization import Role
from graspless_pin.visualization.drawing import draw_bodies
from graspless_pin.visualization.picture import Mark

_MOST_TIMES = 6
_FAINT, _CLEAR = 0.15, 0.6  # opacity of the first and of the last pose
_TURN_LENGTH = 0.1  # m: what a radian counts for where poses are spread along the way


@dataclass(frozen=True)
class TimeLapse:
    """A simulation as pages show it: the run in which the object goes farthest.

    Attributes:
        title: Of the scene.
        held: Whether the object stays.
        outcome: Capitalised.
        bodies: How hard they are.
        rows: Time (s), displacement (mm) and rotation (deg) of each pose.
        text: Its figures, see `simulation_text`.
        view: What its 3-D view is filled with.
    """

    title: str
    held: bool
    outcome: str
    bodies: str
    rows: list[tuple[str, str, str]]
    text: str
    view: dict[str, Any]


def time_lapse_html(lapse: TimeLapse) -> str:
    """Return a simulation as a page of its own; it fetches nothing.

    Raises:
        GrasplessPinError: If Jinja2 or matplotlib is not installed.
    """
    return render("simulation.html", lambda: {"title": lapse.title, "lapse": lapse})


def time_lapse(scene: Scene, simulation: Simulation, text: str) -> TimeLapse:
    """Return a simulation as pages show it.

    Args:
        scene: The simulated scene.
        simulation: The simulation.
        text: Its figures, see `simulation_text`.

    Raises:
        MeshError: A mesh file is missing or unreadable.
    """
    run = max(simulation.runs, key=lambda one: (one.displacement, one.rotation))
    chosen = _spread(simulation.model.object, run)
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
    rest = [mesh for mesh in picture.meshes if mesh.role is not Role.OBJECT]
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
    return TimeLapse(
        scene.name,
        simulation.outcome is SimulatedOutcome.HELD,
        simulation.outcome.value.capitalize(),
        run.contact_model.name.capitalize(),
        rows,
        text,
        view_context(
            "lapse-view",
            "the simulation",
            replace(picture, meshes=(*rest, *shown), marks=(*picture.marks, *marks)),
            f"Shows hand and supports, and the object {scene.object.name} at each time.",
            "numbers of the times",
        ),
    )


def _spread(start: ManipulatedObject, run: SimulatedRun) -> NDArray[np.intp]:
    """Return looks at the object that are spread evenly along its way, the first and last, too."""
    changes = np.array([change_of_pose(start, T) for T in run.T_world_object])
    way = np.maximum.accumulate(changes @ [1.0, _TURN_LENGTH])
    wanted = np.linspace(way[0], way[-1], _MOST_TIMES)
    return np.unique([0, *np.searchsorted(way, wanted[1:-1]).tolist(), len(way) - 1])
