"""``graspless-pin robots`` and ``inspect``: which hands there are, and audits of others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.cli.outcome import ExitCode, plain_errors
from graspless_pin.findings import is_serious
from graspless_pin.geometry.inspection.audit import audit_urdf
from graspless_pin.geometry.inspection.listing import list_robots
from graspless_pin.report.robots import audit_text, robot_text, robots_text


def robots(
    name: Annotated[str | None, typer.Argument(help="Show this robot in full.")] = None,
) -> None:
    """List the robots: fingers, joints and effort limits; one with where they come from.

    Examples:
        graspless-pin robots
        graspless-pin robots allegro_right
    """
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
    root_link: Annotated[
        str | None, typer.Option(help="Keep only this link and what hangs on it.")
    ] = None,
) -> None:
    """Audit a URDF: meshes, effort limits, mimic joints, limits; and say what to do.

    Exit code 0: it can be mounted as it is; 1: it cannot; 2: no such file or robot; 4: it can, and
    something serious is wrong.

    Examples:
        graspless-pin inspect my_hand.urdf
    """
    with plain_errors():
        report = audit_urdf(urdf, package_dir or [], root_link)
        typer.echo(audit_text(report))
    found = ExitCode.DOUBTFUL if is_serious(report.findings) else ExitCode.FOUND
    raise typer.Exit(found if report.loads else ExitCode.INFEASIBLE)
