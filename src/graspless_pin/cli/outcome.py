"""What all commands share: exit codes, and how errors are shown."""

from __future__ import annotations

import math
import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graspless_pin.cli.outputs import check_inputs_stay
from graspless_pin.errors import ArgumentError, GrasplessPinError
from graspless_pin.findings import Finding, Severity, capture, causes_first, emit
from graspless_pin.intake.text import printable
from graspless_pin.progress import waiting_for
from graspless_pin.solution.certificate import UNDECIDED

if TYPE_CHECKING:
    from graspless_pin.scene import Scene
    from graspless_pin.solution import TorqueSolution


class ExitCode(IntEnum):
    """What the command line ends with."""

    FOUND = 0
    INFEASIBLE = 1
    BAD_INPUT = 2
    NOT_PROVEN = 3
    DOUBTFUL = 4
    """Found or done, and something serious is wrong: the answer is one to another question."""


_MOST_LINES = 8
_ERROR_BYTES = 950
_NOTE_BYTES = 200
_WIDEST = 100  # columns; longer lines are hard to read
_ELLIPSIS = " [...] "


@contextmanager
def plain_errors() -> Iterator[None]:
    """Show findings and errors of this package as one message each, without a traceback.

    It names an option where an error names the argument that this becomes.
    """
    with capture() as found:
        token = _PRINTED.set(_Printed(found))
        try:
            yield
        except GrasplessPinError as error:
            argument, colon, rest = str(error).partition(": ")
            option = GIVEN_OPTIONS.get({}).get(argument, argument)
            echo_error(f"{option}{colon}{rest}")
            raise typer.Exit(ExitCode.BAD_INPUT) from None
        except MemoryError:
            echo_error("there is not enough memory for this input")
            raise typer.Exit(ExitCode.BAD_INPUT) from None
        finally:
            show_findings()
            EMITTED.get([]).extend(found)
            _PRINTED.reset(token)


GIVEN_OPTIONS: ContextVar[Mapping[str, str]] = ContextVar("given_options")
"""Options of the command line by the argument that each becomes."""


EMITTED: ContextVar[list[Finding]] = ContextVar("emitted")
"""What was found so far by the command that runs."""


def loaded_scene(path: Path, *, findings: bool = True) -> Scene:
    """Load a scene, and say so where it takes long: a mesh may have a million triangles.

    Args:
        path: The scene file.
        findings: Whether those of the scene are emitted: not where its state is about to change.

    Raises:
        ArgumentError: If an output of the command is a file that the scene reads.
    """
    from graspless_pin.scene import load_scene

    with waiting_for(f"loading {path}"):
        loaded = load_scene(path)
    check_inputs_stay(path)
    if findings:
        emit(*loaded.findings)
    return loaded


ControllerOption = Annotated[
    str | None,
    typer.Option(
        "--controller",
        metavar="K",
        help="Stiffness of position feedback at the joints beside the torques, N m/rad, over "
        "(0.1 m)^2 where joints slide; 'torque': constant torques; 'position': joints stand still; "
        "'any': tell the least that is needed; default: the file's.",
    ),
]


def with_controller(scene: Scene, stiffness: str | None) -> Scene:
    """Return a scene under another controller.

    Args:
        scene: The scene.
        stiffness: Of joint feedback, see `ControllerOption`; its damping stays. None: the file's.

    Raises:
        ArgumentError: If it is no stiffness.
    """
    if stiffness is None:
        return scene
    try:
        gain: float | str = float(stiffness)
    except ValueError:
        gain = stiffness
    try:
        controller = replace(scene.controller, stiffness=gain)
    except ArgumentError as error:
        raise ArgumentError("--controller", error.message) from None
    return scene.with_changes(controller=controller)


def exit_code(solution: TorqueSolution) -> ExitCode:
    """Return what a command ends with that has looked for torques."""
    if solution.found:
        return ExitCode.FOUND
    return ExitCode.NOT_PROVEN if solution.status in UNDECIDED else ExitCode.INFEASIBLE


@dataclass
class _Printed:
    """What a command has found, what of that it has said on standard error, and in how many bytes.

    Attributes:
        found: What was emitted.
        shown: What of that was printed.
        room: How many bytes more there may be.
    """

    found: list[Finding]
    shown: set[Finding] = field(default_factory=set)
    room: int = 1700  # a note may come after findings


def number_of(option: str, text: str) -> float:
    """Return the number that an option, or a part of one, is.

    Raises:
        ArgumentError: If it is none.
    """
    try:
        return float(text)
    except ValueError:
        raise ArgumentError(option, f"found {text!r}; needs a number") from None


def three_numbers(option: str, text: str) -> list[float]:
    """Return the numbers of an option such as ``1,0,0``.

    Raises:
        ArgumentError: If they are not three finite ones.
    """
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise ArgumentError(option, f"needs three numbers with commas: 1,0,0; got {text!r}")
    return numbers


_PRINTED: ContextVar[_Printed] = ContextVar("printed")


def echo_error(message: str) -> None:
    """Print an error on standard error, cut to a few lines, below the findings that explain it."""
    text = f"error: {shortened(message, _ERROR_BYTES)}"
    _PRINTED.get().room -= len(text.encode())
    show_findings()
    typer.echo(text, err=True)


def echo_note(message: str) -> None:
    """Print a note on standard error, cut to a few lines."""
    typer.echo(f"note: {shortened(message, _NOTE_BYTES)}", err=True)


def shortened(message: str, most: int) -> str:
    """Return a message of at most some bytes and a few lines, with what cannot be printed named.

    Messages quote what was found, and a file may hold a megabyte of it.
    """
    lines = printable(message).splitlines()
    text = "\n".join(lines[:_MOST_LINES])
    if len(lines) > _MOST_LINES:
        text += f"\n... and {len(lines) - _MOST_LINES} lines more"
    content = text.encode()
    if len(content) <= most:
        return text
    half = (most - len(_ELLIPSIS)) // 2
    # What is wrong may stand before or after what was found.
    ends = (content[:half].decode(errors="ignore"), content[-half:].decode(errors="ignore"))
    return _ELLIPSIS.join(ends)


def show_findings() -> None:
    """Print on standard error what was emitted so far, the gravest first, each once a command.

    `plain_errors` does so at the end; commands that print or wait for long call it before.

    A line each, as wide as it comes; on a terminal in colour and within its width.
    """
    printed = _PRINTED.get()
    remaining = [one for one in causes_first(printed.found) if one not in printed.shown]
    printed.shown.update(remaining)
    wide = sys.stderr.isatty()
    for index, one in enumerate(remaining):
        text = f"{shortened(str(one), _ERROR_BYTES)} [{one.code}]"
        printed.room -= len(text.encode()) + len("warning: ") + 1
        if printed.room < 0:
            echo_note(f"{len(remaining) - index} findings more, see scene.findings")
            return
        if wide:
            width = min(shutil.get_terminal_size().columns, _WIDEST) - 1
            text = textwrap.fill(
                f"{one.severity}: {text}", width, subsequent_indent="  ", break_on_hyphens=False
            )
            text = text.removeprefix(f"{one.severity}: ")
        typer.echo(f"{typer.style(f'{one.severity}:', **_STYLES[one.severity])} {text}", err=True)


_STYLES: dict[Severity, Any] = {
    Severity.SERIOUS: {"fg": "red", "bold": True},
    Severity.WARNING: {"fg": "yellow", "bold": True},
    Severity.NOTE: {"bold": True},
}
