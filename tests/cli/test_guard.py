"""The command line outlives a library that crashes, and passes on what is asked of it."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.core.child_calls import is_running

from graspless_pin.cli.outcome import shortened

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the guard needs Linux")

SCRIPT = """
import os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from graspless_pin.cli import guard

guard()
{work}
"""
# In short sleeps: Python acts on a signal between two steps of a program, and one that comes just
# before the system call of a sleep waits until that sleep ends.
WAITING = "print(os.getpid(), flush=True); [time.sleep(0.05) for _ in range(100_000)]"
PATIENCE = 300.0


def start(work: str) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", SCRIPT.format(work=work)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.mark.parametrize("name", ["SIGABRT", "SIGFPE", "SIGBUS", "SIGILL"])
@pytest.mark.sampled(1)
def test_a_crash_is_one_message(name):
    process = start(f"os.kill(os.getpid(), signal.{name})")
    output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, output) == (2, "")
    assert errors.startswith(f"error: a library crashed on this input ({name}); graspless")
    assert len(errors.splitlines()) == 1


def test_a_real_crash():
    process = start("import ctypes; ctypes.string_at(0)")
    assert "a library crashed on this input (SIGSEGV)" in process.communicate(timeout=PATIENCE)[1]
    assert process.returncode == 2


@pytest.mark.parametrize("code", [0, 7])
def test_exit_codes_pass_through(code):
    process = start(f"print('said'); sys.exit({code})")
    assert process.communicate(timeout=PATIENCE) == ("said\n", "")
    assert process.returncode == code


# Each error is raised in a command of its own, and its exit code follows what is said of it.
FAULTY = """
import os, sys
import graspless_pin.cli.outcome as outcome

def broken(*_, **__):
    raise error

outcome.loaded_scene = broken
import graspless_pin.cli.solve
from graspless_pin.cli import main

parent = os.getpid()
sys.argv[1:] = ["solve", "examples/box_between_walls.yaml"]
for error in (
    ValueError("a\\nb\\x1b[2J"), RecursionError(9999 * "x"), MemoryError(), SystemExit(7),
    AssertionError(),
):
    if isinstance(error, AssertionError):
        os.environ["GRASPLESS_PIN_TRACEBACK"] = "1"
    try:
        main()
    except SystemExit as end:
        if os.getpid() != parent:
            raise
        sys.stderr.write(f"exit code {end.code}\\n")
"""


def test_an_exception_that_is_none_of_ours_is_one_line_that_asks_for_a_report():
    """Ends on purpose keep their exit code, and the traceback is there for those who ask."""
    done = subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", FAULTY],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )
    value, recursion, memory, own, shown, rest = re.split(r"exit code (\d+)\n", done.stderr)[::2]
    assert (done.returncode, done.stdout, rest) == (0, "", "")
    assert re.findall(r"exit code (\d+)\n", done.stderr) == ["70", "70", "2", "7", "70"]
    for said, words in (
        (value, "ValueError: a b<U+001B>[2J; "),
        (recursion, f"RecursionError: {200 * 'x'} [...]; "),
    ):
        (line,) = said.splitlines()
        assert line.startswith("error: internal error in solve.py, line ") and words in line
        assert "please report it with this command" in line and "graspless-pin --version" in line
    assert memory.startswith("error: ") and own == ""
    assert shown.startswith("Traceback")
    last = shown.splitlines()[-1]
    assert last.startswith("error: internal error in solve.py, line ")
    assert "AssertionError; " in last


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has it")
@pytest.mark.parametrize("command", [["robots"], ["--help"]])
def test_output_that_takes_no_more_ends_with_one_line(command):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
            [sys.executable, "-m", "graspless_pin", *command],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=PATIENCE,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("error: standard output cannot be written (No space left")
    assert len(done.stderr.splitlines()) == 1


def gone(number: int) -> bool:
    deadline = time.monotonic() + PATIENCE
    while is_running(number) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not is_running(number)


def started() -> tuple[subprocess.Popen[str], int]:
    process = start(WAITING)
    assert process.stdout is not None
    return process, int(process.stdout.readline())


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGKILL"])
def test_what_ends_the_parent_ends_the_child(name):
    process, child = started()
    assert child != process.pid and is_running(child)
    number = getattr(signal, name)
    process.send_signal(number)
    assert process.wait(timeout=PATIENCE) == -number
    assert gone(child)
    process.communicate()


def test_an_interrupt_reaches_the_child_once():
    process, child = started()
    process.send_signal(signal.SIGINT)
    errors = process.communicate(timeout=PATIENCE)[1]
    assert gone(child) and process.returncode != 0
    assert errors.count("KeyboardInterrupt") == 1


def test_a_child_that_is_killed():
    process, child = started()
    os.kill(child, signal.SIGKILL)
    errors = process.communicate(timeout=PATIENCE)[1]
    assert "killed from outside (SIGKILL), perhaps because memory ran out" in errors
    assert process.returncode == 2


def test_long_messages_are_cut():
    cut = shortened("before " + 100_000 * "\u00e9" + " after", 950)
    assert len(cut.encode()) <= 950
    assert cut.startswith("before ") and cut.endswith(" after") and " [...] " in cut
    lines = shortened("\n".join(f"line {i}" for i in range(100)), 950).splitlines()
    assert lines == [*(f"line {i}" for i in range(8)), "... and 92 more lines"]
    assert shortened("a\x1b[2Jb\ud800", 950) == "a<U+001B>[2Jb<U+D800>"
