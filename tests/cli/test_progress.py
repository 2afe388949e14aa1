"""What takes more than a second says so on a terminal, and nowhere else."""

import os
import pty
import subprocess
import sys
import time

import pytest

from graspless_pin import progress

SCRIPT = """
import time
import rich.console, rich.text  # which may take longer than the work on a busy machine
from graspless_pin import progress
progress._SHOWN_AFTER = {patience}
with progress.waiting_for("doing the work"), progress.waiting_for("its [half]"):
    time.sleep({work})
print("done")
"""


def terminal(patience: float, work: float) -> str:
    """Run the script with a terminal as standard error; return what it shows."""
    ours, theirs = pty.openpty()
    process = subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", SCRIPT.format(patience=patience, work=work)],
        stdout=subprocess.PIPE, stderr=theirs, check=True, env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    os.close(theirs)
    assert process.stdout == b"done\n"
    shown = b""
    try:
        while chunk := os.read(ours, 65536):
            shown += chunk
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    return shown.decode()


def test_what_takes_long_is_said_on_a_terminal() -> None:
    assert "doing the work: its [half] (Ctrl-C ends it)" in terminal(0.1, 1.5)


def test_nothing_is_said_of_what_is_quick_or_where_nobody_looks(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert terminal(600.0, 0.1) == ""
    with progress.waiting_for("doing the work"):
        time.sleep(0.01)
    assert capsys.readouterr().err == ""
