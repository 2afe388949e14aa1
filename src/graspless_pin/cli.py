"""The command line: ``graspless-pin solve SCENE`` and its sisters."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from graspless_pin.errors import GrasplessPinError, GrasplessPinWarning, SceneError
from graspless_pin.geometry.robots.audit import audit_urdf
from graspless_pin.geometry.robots.listing import list_robots
from graspless_pin.modes.rules import SignRule, SlidingRule, StaticFriction
from graspless_pin.report import scene_solution_text, solution_document, write_document
from graspless_pin.report.robots import audit_text, robot_text, robots_text
from graspless_pin.report.verify import verify_document
from graspless_pin.scene import load_scene, scene_json_schema
from graspless_pin.solution import Algorithm

FOUND, INFEASIBLE, BAD_INPUT = 0, 1, 2

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Robust joint torques for hands that push, slide, pivot or hold an object.",
)


class Scale(StrEnum):
    """What Algorithm 2 minimises."""

    ABSOLUTE = "absolute"
    LIMITS = "limits"


@app.command()
def solve(
    scene: Annotated[Path, typer.Argument(help="Scene file (YAML).")],
    algorithm: Annotated[
        Algorithm | None,
        typer.Option(help="margin: Algorithm 1, largest margin; torque: Algorithm 2."),
    ] = None,
    margin: Annotated[
        float | None, typer.Option(help="Required margin e0 of Algorithm 2, N.")
    ] = None,
    json_file: Annotated[
        str | None, typer.Option("--json", metavar="FILE|-", help="Write the solution as JSON.")
    ] = None,
    sign_rule: Annotated[
        SignRule | None, typer.Option(help="Rule on virtual-sliding signs.")
    ] = None,
    sliding_rule: Annotated[
        SlidingRule | None, typer.Option(help="Whether sliding contacts are constrained.")
    ] = None,
    static_friction: Annotated[
        StaticFriction | None, typer.Option(help="coulomb drops the virtual-sliding rule.")
    ] = None,
    scale: Annotated[Scale | None, typer.Option(help="What Algorithm 2 minimises.")] = None,
    solver: Annotated[str | None, typer.Option(help="piqp, proxqp, highs, clarabel, ...")] = None,
) -> None:
    """Solve a scene: which joint torques, and how robust.

    Exit code 0: found; 1: infeasible; 2: bad input.
    """
    with _plain_errors():
        loaded = load_scene(scene)
        given: dict[str, Any] = {
            "margin": margin,
            "sign_rule": sign_rule,
            "sliding_rule": sliding_rule,
            "static_friction": static_friction,
            "scale": scale,
            "solver": solver,
        }
        options = {name: value for name, value in given.items() if value is not None}
        solution = loaded.solve(algorithm, **options)
        if json_file is not None:
            write_document(solution_document(solution, loaded), json_file)
        if json_file != "-":
            typer.echo(scene_solution_text(loaded, solution))
    raise typer.Exit(FOUND if solution.found else INFEASIBLE)


@app.command()
def verify(
    file: Annotated[Path, typer.Argument(help="Solution document (JSON) written by solve.")],
) -> None:
    """Check a solution from its JSON with numpy alone.

    Exit code 0: every check passed; 1: one failed; 2: not a document of a found solution.
    """
    with _plain_errors():
        try:
            checked = verify_document(json.loads(file.read_text(encoding="utf-8")))
        except (OSError, ValueError, RecursionError) as error:
            raise SceneError(f"{file}: {error}") from error
    typer.echo(str(checked))
    raise typer.Exit(FOUND if checked.passed else INFEASIBLE)


@app.command()
def robots(
    name: Annotated[str | None, typer.Argument(help="Show this robot in full.")] = None,
) -> None:
    """List the robots: fingers, joints, effort limits and where they come from."""
    with _plain_errors():
        if name is None:
            typer.echo(robots_text(list_robots()))
        else:
            typer.echo(robot_text(list_robots([name])[0]))


@app.command()
def inspect(
    urdf: Annotated[str, typer.Argument(help="A URDF, a robot file or a robot's name.")],
    package_dir: Annotated[
        list[Path] | None, typer.Option(help="Where package:// addresses are looked up.")
    ] = None,
) -> None:
    """Audit a URDF: meshes, effort limits, mimic joints, limits; and say what to do.

    Exit code 0: it can be mounted as it is; 1: it cannot; 2: no such file or robot.
    """
    with _plain_errors():
        report = audit_urdf(urdf, package_dir or [])
        typer.echo(audit_text(report))
    raise typer.Exit(FOUND if report.loads else INFEASIBLE)


@app.command()
def schema() -> None:
    """Print the JSON schema of a scene file."""
    typer.echo(json.dumps(scene_json_schema(), indent=2))


def main() -> None:
    """Run the command line."""
    app()


@contextmanager
def _plain_errors() -> Iterator[None]:
    """Show warnings and errors of this package as one message each, without a traceback."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", GrasplessPinWarning)
        try:
            yield
        except GrasplessPinError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(BAD_INPUT) from None
        finally:
            for message in dict.fromkeys(str(item.message) for item in caught):
                typer.echo(f"warning: {message}", err=True)


if __name__ == "__main__":
    sys.exit(main())
