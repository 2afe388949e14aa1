"""What all commands share: exit codes, and how errors are shown."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum

import typer

from graspless_pin.errors import GrasplessPinError, GrasplessPinWarning
from graspless_pin.intake.text import printable


class ExitCode(IntEnum):
    """What the command line ends with."""

    FOUND = 0
    INFEASIBLE = 1
    BAD_INPUT = 2
    NOT_PROVEN = 3


_MOST_LINES = 8
_ERROR_BYTES = 950
_WARNING_BYTES = 1000
_LEFT_OUT = " [...] "


@contextmanager
def plain_errors() -> Iterator[None]:
    """Show warnings and errors of this package as one message each, without a traceback."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", GrasplessPinWarning)
        try:
            yield
        except GrasplessPinError as error:
            echo_error(str(error))
            raise typer.Exit(ExitCode.BAD_INPUT) from None
        except MemoryError:
            echo_error("there is not enough memory for this input")
            raise typer.Exit(ExitCode.BAD_INPUT) from None
        finally:
            _echo_warnings([*dict.fromkeys(str(item.message) for item in caught)])


def echo_error(message: str) -> None:
    """Print an error on standard error, cut to a few lines."""
    typer.echo(f"error: {shortened(message, _ERROR_BYTES)}", err=True)


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
    half = (most - len(_LEFT_OUT)) // 2
    # What is wrong may stand before or after what was found.
    ends = (content[:half].decode(errors="ignore"), content[-half:].decode(errors="ignore"))
    return _LEFT_OUT.join(ends)


def _echo_warnings(messages: list[str]) -> None:
    left = _WARNING_BYTES
    for index, message in enumerate(messages):
        text = f"warning: {shortened(message, _ERROR_BYTES)}"
        left -= len(text.encode()) + 1
        if left < 0:
            typer.echo(f"warning: {len(messages) - index} more", err=True)
            return
        typer.echo(text, err=True)
