"""The command line: ``graspless-pin solve SCENE`` and its sisters; the commands load all else."""

import gc
import os
import signal
import sys

from graspless_pin.cli.guard import (
    INTERNAL_ERROR,
    INTERRUPTED,
    INTERRUPTION,
    begin,
    guarded,
    quit_at_once,
)

__all__ = ["INTERNAL_ERROR", "INTERRUPTED", "INTERRUPTION", "begin", "main", "run"]

_TRACEBACK = "GRASPLESS_PIN_TRACEBACK"


def main() -> None:
    """Run the command line; a library that crashes ends in a message (see `guard`)."""
    guarded(run)


def run() -> None:
    """Run the command line in this process.

    Loading what a command needs takes most of a second, in which Ctrl-C counts, too. It makes
    objects that stay, through which a search for garbage goes again and again: there is none.
    """
    gc.disable()
    # Matrices are small here: threads that share one only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A shell may have told the process to ignore Ctrl-C.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # No exception: some libraries catch what interrupts their import, and fail later.
        signal.signal(signal.SIGINT, quit_at_once)
    try:
        from graspless_pin.cli.commands import app

        app()
    except Exception as error:
        if os.environ.get(_TRACEBACK):
            sys.excepthook(type(error), error, error.__traceback__)
        sys.stderr.write(f"error: {_report_of(error)}\n")
        sys.exit(INTERNAL_ERROR)


def _report_of(error: Exception) -> str:
    """Return one line: what was raised and where, and what to send."""
    from graspless_pin.errors import internal_error
    from graspless_pin.intake.text import printable

    return (
        f"{printable(internal_error(error))}; please report it with this command, the files it "
        f"reads and what graspless-pin --version prints ({_TRACEBACK}=1 in the environment shows "
        "the traceback)"
    )
