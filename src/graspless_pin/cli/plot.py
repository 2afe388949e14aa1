"""``graspless-pin plot``: a picture of a study's results, a squeeze window or tolerances."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from graspless_pin.atomic_write import make_folder_of
from graspless_pin.cli.outcome import ControllerOption, plain_errors
from graspless_pin.cli.outputs import OutputKind, check_output
from graspless_pin.cli.solve import solved_scene
from graspless_pin.cli.tolerances import tolerances_under
from graspless_pin.errors import ArgumentError, GrasplessPinError, optional_import
from graspless_pin.planning import squeeze_window
from graspless_pin.plots import (
    margin_heat_map,
    margin_plot,
    outcome_boundary,
    squeeze_plot,
    tolerance_plot,
)
from graspless_pin.plots.canvas import fonts_without_remarks
from graspless_pin.plots.solutions import DIRECTED
from graspless_pin.progress import waiting_for
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution
from graspless_pin.studies import read_results

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PlotKind(StrEnum):
    """Kinds of plots."""

    LINE = "line"
    """A result over one variable."""
    MAP = "map"
    """A result over two variables."""
    BOUNDARY = "boundary"
    """Boundary between outcomes, over two variables."""
    SQUEEZE = "squeeze"
    """The squeeze window of a scene's hand."""
    TOLERANCES = "tolerances"
    """Tolerances of a scene: centre of mass, pushes and moments by direction."""


def plot(
    results: Annotated[
        Path,
        typer.Argument(
            metavar="TABLE|SCENE",
            help="Table that graspless-pin study wrote (.parquet or .csv). For --kind squeeze and "
            "tolerances: a scene file.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Picture to write: .png, .svg or .pdf.")
    ],
    kind: Annotated[
        PlotKind,
        typer.Option(
            help="line, map: a result over one or two variables; boundary: where an outcome "
            "changes; squeeze: how hard a scene's hand may squeeze; tolerances: how far the centre "
            "of mass may be off and which pushes the torques withstand, by direction."
        ),
    ] = PlotKind.LINE,
    x: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Horizontal axis. Default: the first variable that varies."
        ),
    ] = None,
    y: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Vertical axis. Default: the next variable that varies."
        ),
    ] = None,
    value: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="Result to draw. Default: margin_N, or the largest torque if a margin was "
            "required; for --kind boundary: found.",
        ),
    ] = None,
    controller: ControllerOption = None,
) -> None:
    """Draw the results of a study, or the squeeze window or tolerances of a scene.

    From a study: a line, a map, or the boundary between outcomes. From a scene: how hard its hand
    may squeeze, or which pushes and which shifts of the centre of mass its torques withstand.

    Exit code 0: drawn; 1: no torques were found; 2: bad input; 4: drawn, and something serious is
    wrong with the scene.

    Examples:
        graspless-pin plot results.parquet -o margin.png
        graspless-pin plot results.parquet --kind boundary -o border.png
        graspless-pin plot scene.yaml --kind squeeze --controller 1 -o squeeze.png
        graspless-pin plot scene.yaml --kind tolerances -o tolerances.png
    """
    with plain_errors():
        of_scene = kind in (PlotKind.SQUEEZE, PlotKind.TOLERANCES)
        if controller is not None and not of_scene:
            raise ArgumentError(
                "--controller", "has an effect only with --kind squeeze or tolerances"
            )
        for option, column in {"--x": x, "--y": y, "--value": value}.items():
            if column is not None and of_scene:
                raise ArgumentError(option, "has an effect only with the table of a study")
        if y is not None and kind is PlotKind.LINE:
            raise ArgumentError("--y", "has an effect only with --kind map or boundary")
        if not of_scene and results.suffix.lower() in (".yaml", ".yml"):
            raise ArgumentError(
                "TABLE|SCENE",
                f"{results} is not a table; for a scene choose --kind squeeze or tolerances, for a "
                "study give the table that graspless-pin study wrote",
            )
        figure = _new_figure()
        pictures = figure.canvas.get_supported_filetypes()
        if output.suffix.lower().removeprefix(".") not in pictures:
            raise ArgumentError("--output", f"{output} must end with .png, .svg or .pdf")
        check_output("--output", output, OutputKind.PICTURE)
        if kind is PlotKind.SQUEEZE:
            _draw_squeeze(*solved_scene(results, controller=controller), figure)
        elif kind is PlotKind.TOLERANCES:
            _draw_tolerances(*solved_scene(results, controller=controller), figure)
        else:
            _draw_study(results, kind, (x, y, value), figure)
        try:
            make_folder_of(output)
            with fonts_without_remarks():
                figure.savefig(output, dpi=150)
        except (OSError, ValueError) as error:
            raise GrasplessPinError(f"{output}: cannot be written ({error})") from error
        typer.echo(f"wrote {output}")


def _draw_tolerances(scene: Scene, solution: TorqueSolution, figure: Figure) -> None:
    """Draw and print the tolerances that depend on a direction: pushes, moments, centre of mass."""
    tolerances = tolerances_under(scene, solution, quantities=DIRECTED)
    count = len(tolerances.each)
    figure.set_size_inches(4.2 * count, 5.2)  # titles and legends are whole
    panels = figure.subplots(1, count, subplot_kw={"projection": "polar"}, squeeze=False)[0]
    for tolerance, axes in zip(tolerances.each, panels, strict=True):
        tolerance_plot(tolerances, tolerance.quantity, axes)
    typer.echo(str(tolerances))


def _draw_squeeze(scene: Scene, solution: TorqueSolution, figure: Figure) -> None:
    """Draw margin, growth and normal forces over the squeeze, and print the squeeze window."""
    with waiting_for("searching for the squeeze window"):
        window = squeeze_window(scene, solution.torques)
    figure.set_figheight(6.6)
    panels = figure.subplots(3, 1, sharex=True)
    for axes, value in zip(panels, ("margin", "growth", "normal_force"), strict=True):
        squeeze_plot(window, axes, value=value)
    for axes in panels[:-1]:
        axes.set_xlabel("")
    for axes in panels[1:]:
        axes.get_legend().remove()
    typer.echo(str(window))


def _draw_study(
    results: Path,
    kind: PlotKind,
    columns: tuple[str | None, str | None, str | None],
    figure: Figure,
) -> None:
    """Draw a column (x, y, value) of a study's table."""
    x, y, value = columns
    table = read_results(results)
    x_name = x or _first_varied_column(table, "x", ())
    if kind is PlotKind.LINE:
        margin_plot(table, x_name, figure.add_subplot(), value=value or _result_column(table))
        return
    y_name = y or _first_varied_column(table, "y", (x_name,))
    if kind is PlotKind.MAP:
        margin_heat_map(
            table, x_name, y_name, figure.add_subplot(), value=value or _result_column(table)
        )
    else:
        outcome_boundary(table, x_name, y_name, figure.add_subplot(), outcome=value or "found")


def _result_column(table: Any) -> str:
    """Return the column to draw: the largest torque where all margins are required ones, else e."""
    solved = table[table["found"]]
    margins = solved["margin_N"]
    required = solved["solve.margin_N"] if "solve.margin_N" in solved else margins.median()
    is_required = len(solved) > 1 and np.allclose(margins, required, rtol=1e-6, atol=0.0)
    torques = [name for name in ("max_torque_Nm", "max_torque_N") if name in solved]
    return torques[0] if is_required and torques else "margin_N"


def _first_varied_column(table: Any, option: str, used: tuple[str, ...]) -> str:
    """Return the first unused column of a study's variables with several numeric values."""
    columns = table.columns[1 : table.columns.get_loc("status")]
    for name in columns:
        if name not in used and table[name].dtype.kind in "if" and table[name].nunique() > 1:
            return name
    raise ArgumentError(
        f"--{option}", f"has no default: no other column of {[*columns]} has several numeric values"
    )


def _new_figure() -> Figure:
    """Return an empty figure without a window."""
    with optional_import("plots need matplotlib", "plots"):
        from matplotlib.figure import Figure
    return Figure(figsize=(6.4, 4.8), layout="constrained")
