"""``graspless-pin robots`` and ``inspect``: which hands there are, and audits of others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.cli.outcome import ExitCode, plain_errors
from graspless_pin.geometry.inspection.audit import audit_urdf
from graspless_pin.geometry.inspection.listing import list_robots
from graspless_pin.report.robots import audit_text, robot_text, robots_text


def robots(
    name: Annotated[str | None, typer.Argument(help="Show this robot in full.")] = None,
) -> None:
    """List the robots: fingers, joints and effort limits; one with where they come from."""
    with plain_errors():
        if name is None:
            typer.echo(robots_text(list_robots()))
        else:
            typer.echo(robot_text(list_robots([name])[0]))


def inspect(
    urdf: Annotated[str, typer.Argument(help="A URDF, a robot file or a robot's name.")],
    package_dir: Annotated[
        list[Path] | None, typer.Option(help="Where package:// addresses are looked up.")
    ] = None,
) -> None:
    """Audit a URDF: meshes, effort limits, mimic joints, limits; and say what to do.

    Exit code 0: it can be mounted as it is; 1: it cannot; 2: no such file or robot.
    """
    with plain_errors():
        report = audit_urdf(urdf, package_dir or [])
        typer.echo(audit_text(report))
    raise typer.Exit(ExitCode.FOUND if report.loads else ExitCode.INFEASIBLE)
