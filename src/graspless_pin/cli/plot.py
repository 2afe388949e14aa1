"""``graspless-pin plot``: a picture of a study's results."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graspless_pin.cli.outcome import plain_errors
from graspless_pin.errors import ArgumentError, GrasplessPinError
from graspless_pin.plots import margin_heat_map, margin_plot, outcome_boundary
from graspless_pin.plots.canvas import fonts_without_remarks
from graspless_pin.studies import read_results

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PlotKind(StrEnum):
    """What is drawn of results."""

    LINE = "line"
    """A result over one variable."""
    MAP = "map"
    """A result over two variables."""
    BOUNDARY = "boundary"
    """Where the outcome changes, over two variables."""


def plot(
    results: Annotated[Path, typer.Argument(help="Table that study wrote: .parquet or .csv.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Picture to write: .png, .svg or .pdf.")
    ],
    kind: Annotated[
        PlotKind, typer.Option(help="A result over one or two variables, or where it changes.")
    ] = PlotKind.LINE,
    x: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="To the right; default: what varies first.")
    ] = None,
    y: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="Upward; default: what varies next.")
    ] = None,
    value: Annotated[
        str | None,
        typer.Option(metavar="COLUMN", help="Result; default: margin_N, of a boundary found."),
    ] = None,
) -> None:
    """Draw the results of a study: a line, a map, or the boundary of what is found.

    Exit code 0: drawn; 2: bad input.

    Examples:
        graspless-pin plot results.parquet -o margin.png
        graspless-pin plot results.parquet --kind boundary -o border.png
    """
    with plain_errors():
        table, figure = read_results(results), _figure()
        across = x or _varied(table, "x", ())
        if kind is PlotKind.LINE:
            margin_plot(table, across, figure.add_subplot(), value=value or "margin_N")
        else:
            up = y or _varied(table, "y", (across,))
            if kind is PlotKind.MAP:
                margin_heat_map(table, across, up, figure.add_subplot(), value=value or "margin_N")
            else:
                outcome_boundary(table, across, up, figure.add_subplot(), outcome=value or "found")
        try:
            output.parent.mkdir(parents=True, exist_ok=True)
            with fonts_without_remarks():
                figure.savefig(output, dpi=150)
        except (OSError, ValueError) as error:
            raise GrasplessPinError(f"{output}: cannot be written ({error})") from error
        typer.echo(f"wrote {output}")


def _varied(table: Any, option: str, taken: tuple[str, ...]) -> str:
    """Return the first column of numbers that vary in a study's table, but for some."""
    columns = table.columns[1 : table.columns.get_loc("status")]
    for name in columns:
        if name not in taken and table[name].dtype.kind in "if" and table[name].nunique() > 1:
            return name
    raise ArgumentError(f"--{option}", f"has nothing to show: no further column of {[*columns]}")


def _figure() -> Figure:
    """Return a figure that no window shows."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise GrasplessPinError(
            f"plots need matplotlib ({error}); install it with pip install 'graspless-pin[plots]'"
        ) from None
    return Figure(figsize=(6.4, 4.8), layout="constrained")
