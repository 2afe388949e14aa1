"""Shared by all commands: exit codes, loading of scenes, and how errors and findings are shown."""

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

if TYPE_CHECKING:
    from graspless_pin.scene import Scene
    from graspless_pin.solution import TorqueSolution


class ExitCode(IntEnum):
    """Exit codes of the command line."""

    FOUND = 0
    INFEASIBLE = 1
    BAD_INPUT = 2
    NOT_PROVEN = 3
    DOUBTFUL = 4
    """Found or done, but with a serious finding: the answer may be to another question."""


_MOST_LINES = 8
_ERROR_BYTES = 950
_NOTE_BYTES = 200
_WIDEST = 100  # columns; longer lines are hard to read
_ELLIPSIS = " [...] "


@contextmanager
def plain_errors() -> Iterator[None]:
    """Show findings and errors of this package as one message each, without a traceback.

    An error that names an argument is shown with the command-line option of that argument.
    """
    with capture() as findings:
        token = _PRINTED.set(_PrintedFindings(findings))
        try:
            yield
        except GrasplessPinError as error:
            argument, colon, message = str(error).partition(": ")
            option = GIVEN_OPTIONS.get({}).get(argument, argument)
            echo_error(f"{option}{colon}{message}")
            raise typer.Exit(ExitCode.BAD_INPUT) from None
        except MemoryError:
            echo_error("there is not enough memory for this input")
            raise typer.Exit(ExitCode.BAD_INPUT) from None
        finally:
            show_findings()
            EMITTED.get([]).extend(findings)
            _PRINTED.reset(token)


GIVEN_OPTIONS: ContextVar[Mapping[str, str]] = ContextVar("given_options")
"""Command-line options that were given, by the name of the argument."""


EMITTED: ContextVar[list[Finding]] = ContextVar("emitted")
"""Findings of the running command so far."""


def loaded_scene(path: Path, *, findings: bool = True) -> Scene:
    """Load a scene, with a progress line where it takes long (large meshes).

    Args:
        path: The scene file.
        findings: Whether to emit the scene's findings; not where its state is about to change.

    Raises:
        ArgumentError: If an output of the command is a file that was read for the scene.
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
        help="Stiffness gain of the position feedback that is added to the torques, N m/rad "
        "(prismatic joints: divided by (0.1 m)^2, N/m). 'torque': constant torques without "
        "feedback; 'position': the joints keep their positions; 'any': not decided, and verdicts "
        "report the smallest gain that holds. Default: the scene file's.",
    ),
]


def with_controller(scene: Scene, stiffness: str | None) -> Scene:
    """Return a scene with another joint stiffness of its controller.

    Args:
        scene: The scene.
        stiffness: Of joint feedback, see `ControllerOption`; the damping stays. None: unchanged.

    Raises:
        ArgumentError: If it is not a valid stiffness.
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
    """Return the exit code of a command for the status of a solution."""
    # Imported here: commands that solve nothing do not need it.
    from graspless_pin.solution import UNDECIDED

    if solution.found:
        return ExitCode.FOUND
    return ExitCode.NOT_PROVEN if solution.status in UNDECIDED else ExitCode.INFEASIBLE


@dataclass
class _PrintedFindings:
    """Findings of a command, and which of them were printed on standard error.

    Attributes:
        found: Findings that were emitted.
        shown: Those of them that were printed.
        room: Bytes left for further output on standard error.
    """

    found: list[Finding]
    shown: set[Finding] = field(default_factory=set)
    room: int = 1700  # a note may come after findings


def number_of(option: str, text: str) -> float:
    """Return an option, or a part of one, as a number.

    Raises:
        ArgumentError: If it is not a number.
    """
    try:
        return float(text)
    except ValueError:
        raise ArgumentError(option, f"found {text!r}; needs a number") from None


def three_numbers(option: str, text: str) -> list[float]:
    """Return the numbers of an option such as ``1,0,0``.

    Raises:
        ArgumentError: If they are not three finite numbers.
    """
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise ArgumentError(option, f"found {text!r}; needs three numbers such as 1,0,0")
    return numbers


_PRINTED: ContextVar[_PrintedFindings] = ContextVar("printed")


def echo_error(message: str) -> None:
    """Print an error on standard error, cut to a few lines, below the findings that explain it."""
    text = f"error: {shortened(message, _ERROR_BYTES)}"
    _PRINTED.get().room -= len(text.encode())
    show_findings()
    typer.echo(text, err=True)


def echo_note(message: str) -> None:
    """Print a note on standard error, cut to a few lines."""
    typer.echo(f"note: {shortened(message, _NOTE_BYTES)}", err=True)


def shortened(message: str, byte_limit: int) -> str:
    """Return a message cut to a number of bytes and a few lines, unprintable characters as codes.

    Messages quote input, which may be a megabyte long.
    """
    lines = printable(message).splitlines()
    text = "\n".join(lines[:_MOST_LINES])
    if len(lines) > _MOST_LINES:
        text += f"\n... and {len(lines) - _MOST_LINES} more lines"
    content = text.encode()
    if len(content) <= byte_limit:
        return text
    half = (byte_limit - len(_ELLIPSIS)) // 2
    # The fault may be named before or after the quoted input.
    ends = (content[:half].decode(errors="ignore"), content[-half:].decode(errors="ignore"))
    return _ELLIPSIS.join(ends)


def show_findings() -> None:
    """Print the findings emitted so far on standard error, the gravest first, each only once.

    `plain_errors` calls it at the end; commands call it before they print or compute for long.

    One line per finding; on a terminal coloured and wrapped to its width.
    """
    printed = _PRINTED.get()
    remaining = [finding for finding in causes_first(printed.found) if finding not in printed.shown]
    printed.shown.update(remaining)
    is_terminal = sys.stderr.isatty()
    for index, finding in enumerate(remaining):
        text = f"{shortened(str(finding), _ERROR_BYTES)} [{finding.code}]"
        printed.room -= len(text.encode()) + len("warning: ") + 1
        if printed.room < 0:
            echo_note(f"{len(remaining) - index} more findings: see scene.findings in Python")
            return
        if is_terminal:
            width = min(shutil.get_terminal_size().columns, _WIDEST) - 1
            text = textwrap.fill(
                f"{finding.severity}: {text}", width, subsequent_indent="  ", break_on_hyphens=False
            )
            text = text.removeprefix(f"{finding.severity}: ")
        typer.echo(
            f"{typer.style(f'{finding.severity}:', **_STYLES[finding.severity])} {text}", err=True
        )


_STYLES: dict[Severity, Any] = {
    Severity.SERIOUS: {"fg": "red", "bold": True},
    Severity.WARNING: {"fg": "yellow", "bold": True},
    Severity.NOTE: {"bold": True},
}
