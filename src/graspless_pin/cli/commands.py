"""All commands of ``graspless-pin``; the module of a command is imported when it is called.

The help text of a command is the docstring of its function, examples last.
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
"""Module and function of each command. A new command is added here."""


class _LazyCommandGroup(TyperGroup):
    """A group of commands that lists them without importing their modules."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; exit with code 4 instead of 0 after a serious finding.

        Report an interruption, and add the nearest choice to the message of a wrong value.
        """
        from graspless_pin.cli.outcome import EMITTED, ExitCode
        from graspless_pin.findings import is_serious

        token = EMITTED.set(emitted := [])
        try:
            super().invoke(ctx)
        except typer.Exit as exit_request:
            if exit_request.exit_code != ExitCode.FOUND:
                raise
        except typer.BadParameter as error:
            error.message = _with_closest_choice(error.message)
            raise
        except KeyboardInterrupt:
            typer.echo(INTERRUPTION, err=True, nl=False)
            raise typer.Exit(INTERRUPTED) from None
        finally:
            EMITTED.reset(token)
        raise typer.Exit(ExitCode.DOUBTFUL if is_serious(emitted) else ExitCode.FOUND)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands, with the first line of help set for each."""
        for name, command in self.commands.items():
            command.help = _command_summary(name)
        return super().list_commands(ctx)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the arguments name, its module imported."""
        name, listed, rest = super().resolve_command(ctx, args)
        return name, listed and _load_command(str(name)), rest


def _with_closest_choice(message: str) -> str:
    """Return the message about a wrong value, with the choice nearest to it."""
    from graspless_pin.suggestions import nearest_name

    text = message.removeprefix("Value error, ")
    given, is_choice, choices = text.partition(" is not one of ")
    nearest = nearest_name(given.strip("'"), re.findall(r"'(.*?)'", choices)) if is_choice else None
    return text if nearest is None else f"{text} Did you mean {nearest!r}?"


class _TrackedCommand(TyperCommand):
    """A command that records the options that were given and the files that it reads and writes."""

    def make_context(self, *args: Any, **further: Any) -> Any:
        """Parse the arguments, and keep the given options until the command has ended."""
        from graspless_pin.cli.outcome import GIVEN_OPTIONS
        from graspless_pin.cli.outputs import files_of_command

        context = super().make_context(*args, **further)
        given = {
            f"{param.name}{'s' * param.multiple}": name if name.startswith("-") else name.upper()
            for param, name in ((param, param.opts[0]) for param in self.params)
            if (source := context.get_parameter_source(param.name)) and source.name == "COMMANDLINE"
        }
        context.call_on_close(partial(GIVEN_OPTIONS.reset, GIVEN_OPTIONS.set(given)))
        context.with_resource(files_of_command())
        return context


def _command_summary(name: str) -> str:
    """Return the first line of a command's docstring; its module is parsed, not imported."""
    module, function = _COMMANDS[name].split(".")
    source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    (definition,) = [
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.FunctionDef) and node.name == function
    ]
    return (ast.get_docstring(definition) or "").partition("\n")[0]


def _load_command(name: str) -> Any:
    """Import and return a command; the examples of its docstring are the epilog of its help."""
    module, function = _COMMANDS[name].split(".")
    command = getattr(import_module(f"graspless_pin.cli.{module}"), function)
    begin()
    description, title, examples = (inspect.getdoc(command) or "").partition("Examples:\n")
    epilog = "\n\n".join([title.strip(), *map(str.strip, examples.splitlines())])
    group = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    group.command(name, cls=_TrackedCommand, help=description, epilog=epilog)(command)
    return typer.main.get_command(group)


app = typer.Typer(
    cls=_LazyCommandGroup,
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
    without = "none, numpy is used instead and is slower; reinstall where there is a C compiler"
    typer.echo(f"compiled loops: {'yes' if has_compiled_loops() else without}")
    raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Print the version, and whether compiled loops are used.",
        ),
    ] = False,
) -> None:
    pass


def _placeholder_command() -> None:
    """Stand in for a command until it is imported."""


for _name in _COMMANDS:
    app.command(_name)(_placeholder_command)
