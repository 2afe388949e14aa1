"""What `test_child_process` calls in other processes, which load nothing else with it."""

import os
import re
import sys
import time
import warnings
from pathlib import Path

from graspless_pin.errors import GrasplessPinWarning

PATIENCE = 300.0


class StubbornError(Exception):
    """Cannot be made again from its arguments."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def squares(count):
    yield from (number**2 for number in range(count))


def fails(error):
    raise error


def fails_stubbornly():
    raise StubbornError(1, 2)


def yields_then(action, *arguments):
    yield "first"
    yield action(*arguments)


def dies(number):
    os.kill(os.getpid(), number)
    time.sleep(PATIENCE)


def holds_the_process():
    """A call in C that lets no other thread run, for years."""
    return re.match(r"(a+)+$", 60 * "a" + "b")


def prints():
    print("to Python's standard output")
    os.write(1, b"to the descriptor\n")
    warnings.warn("noise", GrasplessPinWarning, stacklevel=1)
    return sys.stdin.read()


def is_running(process):
    """Whether a process runs, and not just waits to be asked how it ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
