"""The command line: ``graspless-pin solve SCENE`` and its sisters; the commands load all else.

It runs in a child process, so that a library that crashes ends in a message. This module imports
the standard library alone and forks before anything else is loaded: that costs about a millisecond.
Elsewhere than on Linux the work is done in one process, as it would be without.
"""

from __future__ import annotations

import errno
import gc
import os
import signal
import sys
from typing import NoReturn

__all__ = ["CRASHED", "INTERNAL_ERROR", "INTERRUPTED", "INTERRUPTION", "begin", "guard", "main"]

_TRACEBACK = "GRASPLESS_PIN_TRACEBACK"


def main(*, guarded: bool = True) -> None:
    """Run the command line; a library that crashes ends in a message.

    Loading what a command needs takes most of a second, in which Ctrl-C counts, too. It makes
    objects that stay, through which a search for garbage goes again and again: there is none.

    Args:
        guarded: Whether the work is done in a child process, see `guard`.
    """
    if guarded:
        guard()
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
        if isinstance(error, OSError) and error.errno in _DISK_FULL and error.filename is None:
            _end_without_output(error)
        if os.environ.get(_TRACEBACK):
            sys.excepthook(type(error), error, error.__traceback__)
        sys.stderr.write(f"error: {_report_of(error)}\n")
        sys.exit(INTERNAL_ERROR)


def _end_without_output(error: OSError) -> NoReturn:
    """Say that standard output takes no more, and end: Python would try again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    why = os.strerror(error.errno or 0)
    sys.stderr.write(f"error: standard output cannot be written ({why}); send it elsewhere\n")
    sys.exit(CRASHED)


def _report_of(error: Exception) -> str:
    """Return one line: what was raised and where, and what to send."""
    from graspless_pin.errors import internal_error
    from graspless_pin.intake.text import printable

    return (
        f"{printable(internal_error(error))}; please report it with this command, the files it "
        f"reads and what graspless-pin --version prints ({_TRACEBACK}=1 in the environment shows "
        "the traceback)"
    )


CRASHED = 2
"""Exit code after a library has crashed, or for want of room: that of what cannot be used."""
INTERNAL_ERROR = 70
"""Exit code after an exception that nobody foresaw, as ``sysexits.h`` has it."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""
INTERRUPTION = "interrupted\n"
"""What is said then."""

_DISK_FULL = errno.ENOSPC, errno.EDQUOT
_CRASHES = ("SIGSEGV", "SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSYS", "SIGTRAP", "SIGKILL")
_PASSED_ON = ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2")
_SENT_BY_A_TERMINAL = 0x80  # SI_KERNEL: the child has got it, too
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG


def guard() -> None:
    """Go on in a child process: this process ends as the child does, and returns nothing.

    Signals are passed on to the child, and the child does not outlive this process.
    """
    if sys.platform != "linux":
        return
    waited_for = {signal.SIGCHLD, *(getattr(signal, name) for name in _PASSED_ON)}
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, waited_for)
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        _die_with(parent)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return
    _end_as(_outcome(child, waited_for), before)


def _outcome(child: int, waited_for: set[int]) -> int:
    """Wait for the child and pass signals on; return its exit code, or minus its signal."""
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        # The time is for a SIGCHLD that got lost.
        seen = signal.sigtimedwait(waited_for, 1.0)
        if seen is None or seen.si_signo == signal.SIGCHLD:
            continue
        if seen.si_code != _SENT_BY_A_TERMINAL:
            os.kill(child, seen.si_signo)


def _end_as(outcome: int, mask: set[int]) -> NoReturn:
    if outcome >= 0:
        sys.exit(outcome)
    name = signal.Signals(-outcome).name
    if name in _CRASHES:
        sys.stderr.write(f"error: {_what_happened(name)}; nothing more was done\n")
        sys.exit(CRASHED)
    signal.signal(-outcome, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    os.kill(os.getpid(), -outcome)
    sys.exit(CRASHED)  # a signal that ends nothing


def _what_happened(name: str) -> str:
    if name == "SIGKILL":
        return "the process was killed from outside, perhaps for want of memory (SIGKILL)"
    return (
        f"a library crashed over this input ({name}), which this package should have refused: "
        "please report it"
    )


def _die_with(parent: int) -> None:
    """Have the kernel end this process when its parent ends, however that comes about."""
    import ctypes

    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(CRASHED)


def begin() -> None:
    """Begin a command that is loaded: from now on Ctrl-C is an exception, and garbage is found."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
    if signal.getsignal(signal.SIGINT) is quit_at_once:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def quit_at_once(*_: object) -> None:
    """End the process at once: while libraries are loaded there is nothing to put in order."""
    os.write(2, INTERRUPTION.encode())
    os._exit(INTERRUPTED)
