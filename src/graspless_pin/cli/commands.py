"""All commands of ``graspless-pin``; what a command needs is loaded when it is called.

What the command line says of a command is the docstring of its function, examples last.
"""

from __future__ import annotations

import ast
import inspect
import platform
import re
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from graspless_pin.cli import INTERNAL_ERROR, INTERRUPTED, INTERRUPTION, begin

__all__ = ["app"]


_COMMANDS = {
    "solve": "solve.solve_scene",
    "robustness": "robustness.robustness_scene",
    "tolerances": "tolerances.tolerances_of_scene",
    "verify": "verify.verify",
    "report": "report.report",
    "view": "view.view_scene",
    "simulate": "simulate.simulate_scene",
    "study": "study.study",
    "plot": "plot.plot",
    "robots": "robots.robots",
    "inspect": "robots.inspect",
    "new": "new.new",
    "place": "place.place",
    "close": "posing.close_scene",
    "settle": "posing.settle_scene",
    "example": "example.example",
    "schema": "schema.schema",
}
"""Module and function of each command: a new one is added to this list."""


class _LoadedWhenCalled(TyperGroup):
    """A group whose list of commands loads none of them."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command: it does not end as if all were well where a finding is serious.

        Say so where it is interrupted, and what a wrong choice is near to.
        """
        from graspless_pin.cli.outcome import EMITTED, ExitCode
        from graspless_pin.findings import is_serious

        token = EMITTED.set(found := [])
        try:
            super().invoke(ctx)
        except typer.Exit as end:
            if end.exit_code != ExitCode.FOUND:
                raise
        except typer.BadParameter as error:
            error.message = _with_closest_choice(error.message)
            raise
        except KeyboardInterrupt:
            typer.echo(INTERRUPTION, err=True, nl=False)
            raise typer.Exit(INTERRUPTED) from None
        finally:
            EMITTED.reset(token)
        raise typer.Exit(ExitCode.DOUBTFUL if is_serious(found) else ExitCode.FOUND)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all, and read what is said of each."""
        for name, command in self.commands.items():
            command.help = _summary(name)
        return super().list_commands(ctx)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the arguments name, loaded now."""
        name, listed, rest = super().resolve_command(ctx, args)
        return name, listed and _loaded(str(name)), rest


def _with_closest_choice(message: str) -> str:
    """Return what is said of a wrong value, with the choice that was probably meant."""
    from graspless_pin.suggestions import nearest_name

    plain = message.removeprefix("Value error, ")
    given, is_choice, choices = plain.partition(" is not one of ")
    nearest = nearest_name(given.strip("'"), re.findall(r"'(.*?)'", choices)) if is_choice else None
    return plain if nearest is None else f"{plain} Did you mean {nearest!r}?"


class _Command(TyperCommand):
    """A command that knows which options were given, and which files it reads and writes."""

    def make_context(self, *args: Any, **further: Any) -> Any:
        """Read the arguments, and remember the options until the command has ended."""
        from graspless_pin.cli.outcome import GIVEN_OPTIONS
        from graspless_pin.cli.outputs import files_of_command

        context = super().make_context(*args, **further)
        given = {
            f"{one.name}{'s' * one.multiple}": name if name.startswith("-") else name.upper()
            for one, name in ((one, one.opts[0]) for one in self.params)
            if (source := context.get_parameter_source(one.name)) and source.name == "COMMANDLINE"
        }
        context.call_on_close(partial(GIVEN_OPTIONS.reset, GIVEN_OPTIONS.set(given)))
        context.with_resource(files_of_command())
        return context


def _summary(name: str) -> str:
    """Return the first line of a command's docstring: its module is parsed, not loaded."""
    module, function = _COMMANDS[name].split(".")
    source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    (found,) = [
        one
        for one in ast.parse(source).body
        if isinstance(one, ast.FunctionDef) and one.name == function
    ]
    return (ast.get_docstring(found) or "").partition("\n")[0]


def _loaded(name: str) -> Any:
    """Return a command as its module has it, with the examples of its docstring below its help."""
    module, function = _COMMANDS[name].split(".")
    called = getattr(import_module(f"graspless_pin.cli.{module}"), function)
    begin()
    description, title, examples = (inspect.getdoc(called) or "").partition("Examples:\n")
    shown = "\n\n".join([title.strip(), *map(str.strip, examples.splitlines())])
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command(name, cls=_Command, help=description, epilog=shown)(called)
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
    from graspless_pin.versions import has_compiled_loops, versions

    typer.echo(f"graspless-pin {versions()['graspless-pin']}, Python {platform.python_version()}")
    none = "none, numpy does their work more slowly; install again where there is a C compiler"
    typer.echo(f"compiled loops: {'yes' if has_compiled_loops() else none}")
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


for _name in _COMMANDS:
    app.command(_name)(_only_listed)
