"""``graspless-pin robustness``: disturbances that rest survives, or changes that make it hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from graspless_pin.algorithms.force_bounds import contact_force_bounds
from graspless_pin.algorithms.options import AIMS
from graspless_pin.algorithms.robustness import Robustness, robustness
from graspless_pin.algorithms.what_would_hold import what_would_hold
from graspless_pin.cli.outcome import ControllerOption, ExitCode, plain_errors
from graspless_pin.cli.solve import solved_scene, with_objective_options
from graspless_pin.errors import SceneError
from graspless_pin.holding.verdict import Stability
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.progress import waiting_for
from graspless_pin.scene import Scene
from graspless_pin.scene.fields import label_of
from graspless_pin.scene.scene_stability import no_verdict_reason, verdict_with_scene_data
from graspless_pin.solution import TorqueSolution
from graspless_pin.tree_search import Limits

_TOUCHING_GAP = 1e-9  # m; smaller gaps count as touching
_RANGES_TIME = 10.0  # s; by then most free rays are found


@with_objective_options
def robustness_scene(
    scene: Annotated[Path, typer.Argument(help="Scene file (YAML), at rest.")],
    algorithm: Annotated[
        str | None, typer.Option(help=f"Default: that of the scene file. {AIMS}.")
    ] = None,
    controller: ControllerOption = None,
    nodes: Annotated[
        int, typer.Option(min=0, help="Node limit (sets of outcomes) of each proof.")
    ] = 300,
    time_limit: Annotated[
        float | None,
        typer.Option(min=0.0, help="Time limit of the search, s; reports what is proven by then."),
    ] = None,
    **figures: Any,
) -> None:
    """Report under which torque errors and lost contacts rest stays proven, or what would help.

    Exit code 0: rest is the only outcome; 1: it is not, or no torques were found; 2: bad input;
    3: undecided; 4: rest is the only outcome, but something serious is wrong with the scene.

    Examples:
        graspless-pin robustness scene.yaml
        graspless-pin robustness scene.yaml --algorithm torque --margin 0.2
    """
    with plain_errors():
        loaded, solution = solved_scene(scene, algorithm, controller, **figures)
        if reason := no_verdict_reason(loaded):
            typer.echo(reason)
            raise typer.Exit(ExitCode.NOT_PROVEN)
        if solution.problem.is_sliding.any():
            raise SceneError(
                f"{label_of(loaded)}: motion: contacts slide in the declared motion; robustness is "
                "only available for rest: leave the key out to analyse rest"
            )
        with waiting_for("trying torque errors, and rest without each contact"):
            limits = Limits.from_now(nodes, time_limit)
            result = robustness(
                solution.problem, solution.torques, node_limit=nodes, time_limit=limits.seconds_left
            )
        result = replace(result, verdict=verdict_with_scene_data(loaded, result.verdict))
        status = result.verdict.status
        is_strong = status is Stability.STRONG
        typer.echo(str(result))
        for line in (
            _gap_lines(loaded, result)
            if is_strong
            else _remedy_lines(loaded, solution, nodes, limits)
        ):
            typer.echo(line)
    if is_strong:
        raise typer.Exit(ExitCode.FOUND)
    is_open = status is Stability.UNDECIDED
    raise typer.Exit(ExitCode.NOT_PROVEN if is_open else ExitCode.INFEASIBLE)


def _gap_lines(scene: Scene, result: Robustness) -> list[str]:
    """Return a line for each contact that rest relies on across a gap, widest gap first."""
    points = scene.contacts.points
    gapped = [contact for contact in result.relies_on if points[contact].distance > _TOUCHING_GAP]
    return [
        f"contact {contact} ({points[contact].body}) must first close its gap of "
        f"{1e3 * points[contact].distance:.3g} mm"
        for contact in sorted(gapped, key=lambda contact: -points[contact].distance)
    ]


def _remedy_lines(scene: Scene, solution: TorqueSolution, nodes: int, limits: Limits) -> list[str]:
    """Return lines on which bodies may squeeze the object, and on changes that make it hold."""
    problem = solution.problem
    with waiting_for("searching for changes that make it hold"):
        bounds = contact_force_bounds(
            problem.with_changes(cone="round"),
            solution.torques,
            static_friction=StaticFriction.COULOMB,
            time_limit=_RANGES_TIME
            if limits.seconds_left is None
            else min(_RANGES_TIME, limits.seconds_left),
        )
        remedies = what_would_hold(
            problem, solution.torques, node_limit=nodes, time_limit=limits.seconds_left
        )
    squeeze_text = bounds.squeeze_words(scene.contacts.bodies)
    return [*filter(None, [squeeze_text]), str(remedies)]
