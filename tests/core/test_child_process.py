"""A process of our own: what it answers, how it dies, and that it never stays behind."""

import os
import re
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import (
    ArgumentError,
    CrashError,
    GrasplessPinWarning,
    OverrunError,
    StateError,
    StateFault,
)

PATIENCE = 300.0


class Stubborn(Exception):  # noqa: N818 - what it is called does not matter
    """Cannot be made again from its arguments."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def squares(count):
    yield from (number**2 for number in range(count))


def fails(error):
    raise error


def fails_stubbornly():
    raise Stubborn(1, 2)


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


@pytest.fixture
def child():
    with ChildProcess() as made:
        yield made


def is_running(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def wait_for_end(process):
    deadline = time.monotonic() + PATIENCE
    while is_running(process):
        assert time.monotonic() < deadline, "the process stays"
        time.sleep(0.02)


def test_calls_one_after_the_other(child):
    where = child.call(os.getpid)
    assert where != os.getpid()
    assert list(child.iterate(squares, 4)) == [0, 1, 4, 9]
    big = bytes(3_000_000)
    assert child.call(bytes.__add__, big, big) == big + big
    assert child.call(os.getpid) == where and child.is_running


def test_errors_are_those_of_the_call(child):
    with pytest.raises(ArgumentError, match="mass: is negative"):
        child.call(fails, ArgumentError("mass", "is negative"))
    with pytest.raises(StateError) as caught:
        child.call(fails, StateError(StateFault.PARTED, "gone"))
    assert caught.value.kind is StateFault.PARTED
    with pytest.raises(RuntimeError, match="Stubborn: 1 and 2"):
        child.call(fails_stubbornly)
    assert child.call(len, "four") == 4


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGKILL])
def test_a_process_that_dies_is_an_error(child, number):
    items = child.iterate(yields_then, dies, number)
    assert next(items) == "first"
    with pytest.raises(CrashError, match=f"the process was ended by {number.name}"):
        next(items)
    assert not child.is_running
    with pytest.raises(CrashError, match=number.name):
        child.call(len, "gone")


def test_an_exit_is_an_error(child):
    with pytest.raises(CrashError, match="the process ended with exit code 3"):
        child.call(os._exit, 3)
    with pytest.raises(CrashError, match="the process ended with exit code 4"), ChildProcess() as o:
        o.call(sys.exit, 4)


@pytest.mark.parametrize("hang", [(holds_the_process,), (time.sleep, PATIENCE)])
def test_a_limit_holds_for_each_item_and_in_native_calls(child, hang):
    items = child.iterate(yields_then, *hang, limit=0.3)
    assert next(items) == "first"
    begin = time.monotonic()
    with pytest.raises(OverrunError, match=r"took longer than 0\.3 s"):
        next(items)
    assert 0.25 < time.monotonic() - begin < PATIENCE
    assert not child.is_running


def test_loading_does_not_count_for_the_limit(child):
    """Modules are imported before the time begins."""
    from graspless_pin.problem.checks import all_finite

    assert child.call(all_finite, (), limit=0.2) is True


def test_what_it_prints_is_no_answer(capfd):
    with ChildProcess() as child:
        assert child.call(prints) == ""
        assert child.call(len, "four") == 4
    seen = capfd.readouterr()
    assert seen.out == "" and "to the descriptor" in seen.err
    assert "noise" not in seen.err


def test_a_dropped_iteration_ends_it(child):
    items = child.iterate(squares, 4)
    next(items)
    items.close()
    assert not child.is_running


def test_it_is_killed_from_another_thread(child):
    items = child.iterate(yields_then, time.sleep, PATIENCE)
    assert next(items) == "first"
    child.kill()
    with pytest.raises(CrashError, match="SIGKILL"):
        next(items)
    for _ in range(2):
        child.close()
        with pytest.raises(CrashError, match="SIGKILL"):
            child.call(len, "closed")


def test_it_ends_when_idle():
    with ChildProcess(idle_seconds=0.3) as child:
        where = child.call(os.getpid)
        wait_for_end(where)
        with pytest.raises(CrashError):
            child.call(len, "late")


def test_its_environment_is_given():
    with ChildProcess(environment={"OMP_NUM_THREADS": "1"}) as child:
        assert child.call(os.getenv, "OMP_NUM_THREADS") == "1"
        assert child.call(os.getenv, "HOME") == os.getenv("HOME")


ORPHAN = """
import sys, time
sys.path.insert(0, sys.argv[1])
from graspless_pin import child_process
from test_child_process import holds_the_process
child_process._ORPHAN_SLACK = 0.1
child = child_process.ChildProcess()
print(child._process.pid, flush=True)
if sys.argv[2] == "sleeps":
    child.call(time.sleep, 60.0)
else:
    child.call(holds_the_process, limit=2.0)
"""


@pytest.mark.parametrize("what", ["sleeps", "holds"])
def test_it_does_not_outlive_a_killed_parent(what):
    folder = str(Path(__file__).parent)
    arguments = [sys.executable, "-c", ORPHAN, folder, what]
    parent = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)  # noqa: S603
    assert parent.stdout is not None
    where = int(parent.stdout.readline())
    time.sleep(1.0)
    parent.kill()
    parent.communicate()
    wait_for_end(where)
