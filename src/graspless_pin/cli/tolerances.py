"""``graspless-pin tolerances``: how far what is not known exactly may be off."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.algorithms.named_objectives import AIMS
from graspless_pin.cli.objective_options import asking_by_name
from graspless_pin.cli.outcome import ExitCode, echo_findings, loaded_scene, plain_errors
from graspless_pin.cli.solve import solved
from graspless_pin.findings import emit
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.progress import waiting_for
from graspless_pin.scene.uncertain import feedback_in


@asking_by_name
def tolerances_of_scene(
    scene: Annotated[Path, typer.Argument(help="Scene file (YAML).")],
    algorithm: Annotated[str | None, typer.Option(help=f"Whose torques. {AIMS}.")] = None,
    feedback: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Joint stiffness that adds to the torques, N m/rad; default: the controller's.",
        ),
    ] = None,
    json_file: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE|-", help="Write the torques and figures as JSON, SI."),
    ] = None,
) -> None:
    """Report how far mass, pushes, friction and torques may be off, each by itself.

    The torques are those that solve finds: for all that the scene says is not known, if it does.
    They stay as they are; contact forces are the best under plain Coulomb friction.

    Exit code 0: each figure is told; 1: there are no torques; 2: bad input.

    Examples:
        graspless-pin tolerances scene.yaml
        graspless-pin tolerances scene.yaml --algorithm torque --feedback 1
    """
    with plain_errors():
        loaded = loaded_scene(scene)
        emit(*loaded.findings)
        solution, _ = solved(loaded, algorithm)
        echo_findings(solution.findings)
        if not solution.found:
            typer.echo(f"nothing to tell: {solution.status.message}")
            raise typer.Exit(ExitCode.INFEASIBLE)
        with waiting_for("looking how far each may be off"):
            off = loaded.tolerances(
                solution.torques, feedback=feedback, static_friction=StaticFriction.COULOMB
            )
        if json_file is not None:
            from graspless_pin.report import write_document
            from graspless_pin.report.robust import tolerances_data

            told = {"torques": dict(solution.torques_by_joint), "tolerances": tolerances_data(off)}
            write_document(told, json_file)
        if json_file == "-":
            raise typer.Exit(ExitCode.FOUND)
        typer.echo(str(off))
        if feedback is None and feedback_in(loaded) is None:
            typer.echo(
                "Torques are constant: --feedback tells what joint stiffness adds to them, where a "
                "motion that no contact resists bears nothing."
            )
    raise typer.Exit(ExitCode.FOUND)
