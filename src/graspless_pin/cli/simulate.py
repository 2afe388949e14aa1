"""``graspless-pin simulate``: a scene's rest simulated with MuJoCo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from graspless_pin.algorithms.force_bounds import contact_force_bounds
from graspless_pin.algorithms.options import AIMS, RequiredStability
from graspless_pin.cli.outcome import (
    ControllerOption,
    ExitCode,
    plain_errors,
    three_numbers,
)
from graspless_pin.cli.outputs import MODEL_MARK, OutputKind, OverwriteOption, check_output
from graspless_pin.cli.solve import solved_scene, with_objective_options
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.stability import stability
from graspless_pin.holding.verdict import StabilityVerdict
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.progress import waiting_for
from graspless_pin.report.document import write_text
from graspless_pin.report.provenance import same_problem
from graspless_pin.report.simulation import simulation_text, time_lapse, time_lapse_html
from graspless_pin.scene import Scene
from graspless_pin.scene.problem_data import rest_problem
from graspless_pin.scene.scene_stability import hand_support_contacts, solution_verdict
from graspless_pin.simulation import LoadingProtocol, SimulatedOutcome, Simulation, simulate
from graspless_pin.simulation.protocol import checked_figures
from graspless_pin.simulation.video import write_video
from graspless_pin.solution import TorqueSolution

_RANGES_TIME = 10.0  # s; by then most ranges are proven


@with_objective_options
def simulate_scene(
    scene: Annotated[Path, typer.Argument(help="Scene file (YAML), without a motion.")],
    algorithm: Annotated[
        str | None, typer.Option(help=f"Default: that of the scene file. {AIMS}.")
    ] = None,
    required: Annotated[
        RequiredStability | None,
        typer.Option("--stability", help="strong: torques under which rest is the only outcome."),
    ] = None,
    controller: ControllerOption = None,
    push: Annotated[
        str, typer.Option(metavar="FX,FY,FZ", help="Extra force on the centre of mass, N.")
    ] = "0,0,0",
    friction_factor: Annotated[
        float, typer.Option(metavar="X", help="Multiply all coefficients of friction by this.")
    ] = 1.0,
    seconds: Annotated[float, typer.Option(metavar="S", help="Time after the release, s.")] = 2.0,
    protocol: Annotated[
        LoadingProtocol,
        typer.Option(
            help="fixture: hold the object while the torques grow; step: apply all loads at once."
        ),
    ] = LoadingProtocol.FIXTURE,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write a time-lapse page (.html), or a video (.mp4) if a renderer and an encoder "
            "are found.",
        ),
    ] = None,
    export: Annotated[
        Path | None, typer.Option(metavar="FILE|-", help="Write the MuJoCo model (MJCF).")
    ] = None,
    overwrite: OverwriteOption = False,
    **figures: Any,
) -> None:
    """Simulate a scene's rest with MuJoCo: does the object stay under its torques?

    The object is held in a fixture while the torques grow, and then released. With --protocol step
    there is no fixture, and everything acts at once.

    Exit code 0: held; 1: shifted, moved or crept, or no torques were found; 2: bad input;
    4: held, and something serious is wrong with the scene.

    Examples:
        graspless-pin simulate scene.yaml
        graspless-pin simulate scene.yaml --push 1,0,0 --save lapse.html
    """
    with plain_errors():
        force = three_numbers("--push", push)
        if save is not None and save.suffix.lower() not in (".html", ".mp4"):
            raise ArgumentError(
                "--save", f"found '{save}'; needs a file that ends with .html or .mp4"
            )
        as_page = save is not None and save.suffix.lower() == ".html"
        check_output(
            "--save", save, OutputKind.PAGE if as_page else OutputKind.PICTURE, overwrite=overwrite
        )
        check_output("--export", export, OutputKind.MODEL, overwrite=overwrite)
        if save is not None and save == export:
            raise ArgumentError(
                "--export", f"is the same file as --save, '{save}'; choose another name"
            )
        checked_figures(friction_factor, seconds)
        loaded, solution = solved_scene(scene, algorithm, controller, stability=required, **figures)
        with waiting_for("simulating"):
            outcome = simulate(
                loaded,
                solution.torques,
                push=force,
                friction_factor=friction_factor,
                seconds=seconds,
                protocol=protocol,
            )
        if export is not None:
            write_text(MODEL_MARK + outcome.model.xml, export, kind="model")
        if str(export) != "-" or as_page:
            verdict = _torque_verdict(loaded, solution, outcome)
            text = f"{simulation_summary(loaded, outcome)}\n\nverdict: {verdict}"
            if str(export) != "-":
                typer.echo(text)
            if save is not None and as_page:
                write_text(time_lapse_html(time_lapse(loaded, outcome, text)), save, kind="page")
        if save is not None and not as_page:
            write_video(outcome, save)
    raise typer.Exit(
        ExitCode.FOUND if outcome.outcome is SimulatedOutcome.HELD else ExitCode.INFEASIBLE
    )


def simulation_summary(scene: Scene, simulation: Simulation) -> str:
    """Return the simulated outcome as text, beside the contact force bounds of the same torques."""
    bounds = contact_force_bounds(
        rest_problem(scene, simulation.problem, simulation.torques),
        simulation.torques,
        static_friction=StaticFriction.COULOMB,
        time_limit=_RANGES_TIME,
    )
    return simulation_text(simulation, scene.contacts.bodies, bounds)


def _torque_verdict(
    scene: Scene, solution: TorqueSolution, simulation: Simulation
) -> StabilityVerdict:
    # The scene has hand-support contacts and rolling contacts, but not the push of the simulation.
    if hand_support_contacts(scene) or same_problem(scene.problem(), simulation.problem):
        return solution_verdict(scene, solution)
    return stability(simulation.problem, simulation.torques)
