"""All commands of ``graspless-pin``; what a command needs is loaded when it is called."""

from __future__ import annotations

import platform
from importlib import import_module
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperGroup

from graspless_pin.cli import INTERNAL_ERROR, INTERRUPTED, INTERRUPTION, begin

__all__ = ["app"]


class _Command(NamedTuple):
    """A command: where it is, what the list of all says of it, and how it is called."""

    place: str
    help: str
    examples: tuple[str, ...]


_COMMANDS = {
    "solve": _Command(
        "solve.solve_scene",
        "Solve a scene: which joint torques, how robust, and does it hold.",
        (
            "graspless-pin solve scene.yaml",
            "graspless-pin solve scene.yaml --algorithm torque --margin 0.2",
            "graspless-pin solve scene.yaml --json solution.json",
        ),
    ),
    "robustness": _Command(
        "robustness.robustness_scene",
        "Report which torque errors and lost contacts rest survives, or what would help.",
        ("graspless-pin robustness scene.yaml",),
    ),
    "verify": _Command(
        "verify.verify",
        "Check solutions from their JSON with numpy alone: each figure, and the whole proof.",
        ("graspless-pin verify solution.json", "graspless-pin verify proofs/*.json"),
    ),
    "report": _Command(
        "report.report",
        "Write a solution as one HTML page that fetches nothing: 3-D view, torques, proof.",
        (
            "graspless-pin report scene.yaml -o report.html",
            "graspless-pin report solution.json --scene scene.yaml",
        ),
    ),
    "view": _Command(
        "view.view_scene",
        "Show a scene on an interactive page until it is interrupted (Ctrl-C).",
        ("graspless-pin view scene.yaml",),
    ),
    "simulate": _Command(
        "simulate.simulate_scene",
        "Simulate a scene's rest with MuJoCo: does the object stay under constant torques?",
        (
            "graspless-pin simulate scene.yaml",
            "graspless-pin simulate scene.yaml --push 1,0,0 --save lapse.html",
        ),
    ),
    "study": _Command(
        "study.study",
        "Compute a study, or go on with one that was interrupted or killed.",
        ("graspless-pin study study.yaml -o results.parquet",),
    ),
    "plot": _Command(
        "plot.plot",
        "Draw the results of a study: a line, a map, or the boundary of what is found.",
        (
            "graspless-pin plot results.parquet -o margin.png",
            "graspless-pin plot results.parquet --kind boundary -o border.png",
        ),
    ),
    "robots": _Command(
        "robots.robots",
        "List the robots: fingers, joints and effort limits; one with where they come from.",
        ("graspless-pin robots", "graspless-pin robots allegro_right"),
    ),
    "inspect": _Command(
        "robots.inspect",
        "Audit a URDF: meshes, effort limits, mimic joints, limits; and say what to do.",
        ("graspless-pin inspect my_hand.urdf",),
    ),
    "new": _Command(
        "new.new",
        "Write a first scene of a robot and an object, complete and commented.",
        (
            "graspless-pin new hand.urdf box:0.06,0.04,0.06 --effort 0.5 -o scene.yaml",
            "graspless-pin new allegro_right mug.stl --mass 0.3 --support slope:20deg",
        ),
    ),
    "place": _Command(
        "place.place",
        "Find where the hand holds the object, and write that scene.",
        (
            "graspless-pin place scene.yaml -o placed.yaml",
            "graspless-pin place scene.yaml -o placed.yaml --approach 0,0,-1 --seed 1",
        ),
    ),
    "close": _Command(
        "posing.close_scene",
        "Close fingers until they touch the object or reach their limits, and write that scene.",
        (
            "graspless-pin close scene.yaml -o closed.yaml",
            "graspless-pin close scene.yaml -o closed.yaml --finger index --wrap",
        ),
    ),
    "settle": _Command(
        "posing.settle_scene",
        "Move the object along gravity until it rests on a support, and write that scene.",
        ("graspless-pin settle scene.yaml -o settled.yaml",),
    ),
    "example": _Command(
        "example.example",
        "Copy an example scene or study with its files to the current folder, or list all.",
        ("graspless-pin example", "graspless-pin example allegro_box_on_slope"),
    ),
    "schema": _Command(
        "schema.schema",
        "Print the JSON schema of a scene file, or of a study file.",
        (
            "graspless-pin schema > scene.schema.json",
            "graspless-pin schema --study > study.schema.json",
        ),
    ),
}


class _LoadedWhenCalled(TyperGroup):
    """A group whose list of commands loads none of them."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; say so where it is interrupted."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            typer.echo(INTERRUPTION, err=True, nl=False)
            raise typer.Exit(INTERRUPTED) from None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the arguments name, loaded now."""
        name, listed, rest = super().resolve_command(ctx, args)
        return name, listed and _loaded(str(name)), rest


def _loaded(name: str) -> Any:
    """Return a command as its module has it, with examples below its help."""
    module, function = _COMMANDS[name].place.split(".")
    examples = ("Examples:", *_COMMANDS[name].examples)
    called = getattr(import_module(f"graspless_pin.cli.{module}"), function)
    begin()
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command(name, epilog="\n\n".join(examples))(called)
    return typer.main.get_command(alone)


app = typer.Typer(
    cls=_LoadedWhenCalled,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Robust joint torques for hands that push, slide, pivot or hold an object.",
    epilog="graspless-pin COMMAND --help shows a command's options, exit codes and examples.\n\n"
    f"Exit code {INTERNAL_ERROR}: an error inside graspless-pin; please report it.",
)


def _print_version(asked: bool) -> None:
    if not asked:
        return
    from graspless_pin.versions import compiled_loops, versions

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


def _only_listed() -> None:
    """Stand for a command in the list of all."""


for _name, _listed in _COMMANDS.items():
    app.command(_name, help=_listed.help)(_only_listed)
