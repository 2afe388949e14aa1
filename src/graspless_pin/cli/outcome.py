"""What all commands share: exit codes, and how errors are shown."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from graspless_pin.errors import GrasplessPinError, GrasplessPinWarning

FOUND, INFEASIBLE, BAD_INPUT = 0, 1, 2


@contextmanager
def plain_errors() -> Iterator[None]:
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
