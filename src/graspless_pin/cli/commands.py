"""All commands of ``graspless-pin``, one module per group."""

import typer

from graspless_pin.cli.reporting import report
from graspless_pin.cli.robots import inspect, robots
from graspless_pin.cli.solving import schema, solve, verify
from graspless_pin.cli.studying import study
from graspless_pin.cli.viewing import view

__all__ = ["app"]

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Robust joint torques for hands that push, slide, pivot or hold an object.",
)

for _command in (solve, verify, report, view, study, robots, inspect, schema):
    app.command()(_command)
