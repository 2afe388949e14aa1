"""``graspless-pin tolerances``: how far mass, pushes, friction and torques may be off."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

import typer

from graspless_pin.algorithms.options import AIMS
from graspless_pin.algorithms.tolerance_tables import Tolerances
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.cli.outcome import ControllerOption, ExitCode, plain_errors
from graspless_pin.cli.outputs import OutputKind, OverwriteOption, check_output
from graspless_pin.cli.solve import solved_scene, with_objective_options
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.progress import waiting_for
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution

ATTAINABLE_TIME = 60.0  # s


@with_objective_options
def tolerances_of_scene(
    scene: Annotated[Path, typer.Argument(help="Scene file (YAML).")],
    algorithm: Annotated[
        str | None, typer.Option(help=f"Default: that of the scene file. {AIMS}.")
    ] = None,
    controller: ControllerOption = None,
    attainable: Annotated[
        bool,
        typer.Option(
            "--attainable",
            help="Also report how far each may be off with torques chosen for it alone, as far as "
            f"found in {ATTAINABLE_TIME:g} s.",
        ),
    ] = False,
    json_file: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE|-", help="Write torques and tolerances as JSON, SI."),
    ] = None,
    overwrite: OverwriteOption = False,
    **figures: Any,
) -> None:
    """Report how far mass, pushes, friction and torques may be off, each by itself.

    The torques are those that solve finds, for the whole uncertainty if the scene has one. They do
    not change; contact forces are the best that plain Coulomb friction allows. --attainable adds
    how far each quantity may be off with torques chosen for it alone.

    Exit code 0: the tolerances are printed; 1: no torques were found; 2: bad input; 4:
    printed, and something serious is wrong with the scene.

    Examples:
        graspless-pin tolerances scene.yaml
        graspless-pin tolerances scene.yaml --algorithm torque --controller 1
        graspless-pin tolerances scene.yaml --attainable
    """
    with plain_errors():
        check_output("--json", json_file, OutputKind.TOLERANCES, overwrite=overwrite)
        loaded, solution = solved_scene(scene, algorithm, controller, **figures)
        result = tolerances_under(loaded, solution, attainable=attainable)
        if json_file is not None:
            from graspless_pin.report import write_document
            from graspless_pin.report.robust import tolerances_data

            data = {
                "torques": dict(solution.torques_by_joint),
                "tolerances": tolerances_data(result),
            }
            write_document(data, json_file)
        if json_file == "-":
            raise typer.Exit(ExitCode.FOUND)
        typer.echo(str(result))
        if result.feedback is None or not result.feedback.any():
            typer.echo(
                "These torques are constant: along a motion that no contact resists they tolerate "
                "no error. With --controller K joint stiffness adds torques there."
            )
    raise typer.Exit(ExitCode.FOUND)


def tolerances_under(
    scene: Scene,
    solution: TorqueSolution,
    quantities: Collection[Quantity] = tuple(Quantity),
    *,
    attainable: bool = False,
) -> Tolerances:
    """Return the tolerances of a solution's torques under plain Coulomb friction.

    Args:
        scene: The scene.
        solution: Its solution.
        quantities: Which quantities.
        attainable: Whether to compute, too, how far each may be off if torques are chosen for it.
    """
    with waiting_for("computing tolerances"):
        return scene.tolerances(
            solution.torques,
            quantities=quantities,
            attainable=attainable,
            static_friction=StaticFriction.COULOMB,
            time_limit=ATTAINABLE_TIME if attainable else None,
        )
