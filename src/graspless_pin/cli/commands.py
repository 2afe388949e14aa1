"""All commands of ``graspless-pin``, one module per group."""

import platform
from typing import Annotated

import typer

from graspless_pin.cli.bearing import robustness_scene
from graspless_pin.cli.robots import inspect, robots
from graspless_pin.cli.showing import report, view_scene
from graspless_pin.cli.simulating import simulate_scene
from graspless_pin.cli.solving import schema, solve_scene, verify
from graspless_pin.cli.studying import study
from graspless_pin.versions import compiled_loops, versions

__all__ = ["app"]

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Robust joint torques for hands that push, slide, pivot or hold an object.",
)


def _print_version(asked: bool) -> None:
    if not asked:
        return
    typer.echo(f"graspless-pin {versions()['graspless-pin']}, Python {platform.python_version()}")
    none = "none, numpy does their work more slowly; install again where there is a C compiler"
    typer.echo(f"compiled loops: {', '.join(compiled_loops()) or none}")
    raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Print the version and which compiled loops run.",
        ),
    ] = False,
) -> None:
    pass


_COMMANDS = (
    solve_scene, robustness_scene, verify, report, view_scene, simulate_scene, study, robots,
    inspect, schema,
)  # fmt: skip
for _command in _COMMANDS:
    app.command(_command.__name__.removesuffix("_scene"))(_command)
