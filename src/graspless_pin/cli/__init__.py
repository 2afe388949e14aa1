"""The command line ``graspless-pin COMMAND``; each command imports what it needs.

A command runs in a child process, so that a crash of a library is reported as a message. This
module imports the standard library alone and forks before anything else is imported, which takes
about a millisecond. On systems other than Linux there is no child process.
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
    """Run the command line; a crash of a library is reported as a message.

    Importing the libraries of a command takes most of a second, in which Ctrl-C ends the process,
    too. The garbage collector is off meanwhile: nearly all objects that imports make are permanent.

    Args:
        guarded: Whether the work is done in a child process, see `guard`.
    """
    if guarded:
        guard()
    gc.disable()
    # Matrices are small here: several threads on one of them would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A shell may have told the process to ignore Ctrl-C.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # No exception: some libraries catch a KeyboardInterrupt of their import, and fail later.
        signal.signal(signal.SIGINT, quit_at_once)
    try:
        from graspless_pin.cli.commands import app

        app()
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _DISK_FULL and error.filename is None:
            _end_without_output(error)
        if os.environ.get(_TRACEBACK):
            sys.excepthook(type(error), error, error.__traceback__)
        sys.stderr.write(f"error: {_bug_report(error)}\n")
        sys.exit(INTERNAL_ERROR)


def _end_without_output(error: OSError) -> NoReturn:
    """Report that standard output cannot be written, and exit without flushing it again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    reason = os.strerror(error.errno or 0)
    sys.stderr.write(
        f"error: standard output cannot be written ({reason}); redirect it to another disk\n"
    )
    sys.exit(CRASHED)


def _bug_report(error: Exception) -> str:
    """Return one line for an internal error: its type and place, and what to report."""
    from graspless_pin.errors import internal_error
    from graspless_pin.intake.text import printable

    return (
        f"{printable(internal_error(error))}; please report it with this command, the files it "
        f"reads and what graspless-pin --version prints ({_TRACEBACK}=1 in the environment shows "
        "the traceback)"
    )


CRASHED = 2
"""Exit code after a crash of a library or on a full disk: the same as for bad input."""
INTERNAL_ERROR = 70
"""Exit code after an unexpected exception, as in ``sysexits.h``."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells."""
INTERRUPTION = "interrupted\n"
"""Message after Ctrl-C."""

_DISK_FULL = errno.ENOSPC, errno.EDQUOT
_CRASHES = ("SIGSEGV", "SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSYS", "SIGTRAP", "SIGKILL")
_PASSED_ON = ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2")
_SENT_BY_A_TERMINAL = 0x80  # SI_KERNEL: the child receives it, too
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG


def guard() -> None:
    """Continue in a child process; this process exits as the child does and never returns.

    Signals are passed on to the child, and the child does not outlive this process.
    """
    if sys.platform != "linux":
        return
    signals = {signal.SIGCHLD, *(getattr(signal, name) for name in _PASSED_ON)}
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    old_mask = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        _die_with_parent(parent)
        signal.pthread_sigmask(signal.SIG_SETMASK, old_mask)
        return
    _exit_like_child(_child_exit_code(child, signals), old_mask)


def _child_exit_code(child: int, signals: set[int]) -> int:
    """Wait for the child and pass signals on; return its exit code, or minus its signal number."""
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        # The timeout is for a lost SIGCHLD.
        received = signal.sigtimedwait(signals, 1.0)
        if received is None or received.si_signo == signal.SIGCHLD:
            continue
        if received.si_code != _SENT_BY_A_TERMINAL:
            os.kill(child, received.si_signo)


def _exit_like_child(exit_code: int, mask: set[int]) -> NoReturn:
    if exit_code >= 0:
        sys.exit(exit_code)
    name = signal.Signals(-exit_code).name
    if name in _CRASHES:
        sys.stderr.write(f"error: {_crash_message(name)}; nothing more was done\n")
        sys.exit(CRASHED)
    signal.signal(-exit_code, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    os.kill(os.getpid(), -exit_code)
    sys.exit(CRASHED)  # where the signal does not end a process


def _crash_message(name: str) -> str:
    if name == "SIGKILL":
        return "the process was killed from outside (SIGKILL), perhaps because memory ran out"
    return (
        f"a library crashed on this input ({name}); graspless-pin should have refused the input: "
        "please report it"
    )


def _die_with_parent(parent: int) -> None:
    """Have the kernel end this process when its parent ends for any reason."""
    import ctypes

    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(CRASHED)


def begin() -> None:
    """Restore after imports: Ctrl-C raises KeyboardInterrupt, and garbage is collected again."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
    if signal.getsignal(signal.SIGINT) is quit_at_once:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def quit_at_once(*_: object) -> None:
    """End the process at once on Ctrl-C while libraries are imported; nothing needs a cleanup."""
    os.write(2, INTERRUPTION.encode())
    os._exit(INTERRUPTED)
