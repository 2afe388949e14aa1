"""The command line: ``graspless-pin solve SCENE`` and its sisters; the commands load all else."""

import os
import signal
import sys

from graspless_pin.cli.guard import guarded

__all__ = ["INTERRUPTED", "main", "run"]

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""
_MESSAGE = "interrupted\n"


def main() -> None:
    """Run the command line; a library that crashes ends in a message (see `guard`)."""
    guarded(run)


def run() -> None:
    """Run the command line in this process.

    Loading the libraries takes a second, in which Ctrl-C counts, too.
    """
    usual = signal.default_int_handler
    # A shell may have told the process to ignore Ctrl-C.
    listens = signal.getsignal(signal.SIGINT) is usual
    try:
        if listens:
            # No exception: some libraries catch what interrupts their import, and fail later.
            signal.signal(signal.SIGINT, _quit)
        from graspless_pin.cli.commands import app

        if listens:
            signal.signal(signal.SIGINT, usual)
        app()
    except KeyboardInterrupt:
        sys.stderr.write(_MESSAGE)
        sys.exit(INTERRUPTED)


def _quit(*_: object) -> None:
    """End the process at once: while libraries are loaded there is nothing to put in order."""
    os.write(2, _MESSAGE.encode())
    os._exit(INTERRUPTED)
