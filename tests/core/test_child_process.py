"""A process of our own: what it answers, how it dies, and that it never stays behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from child_calls import (
    PATIENCE,
    dies,
    fails,
    fails_stubbornly,
    holds_the_process,
    is_running,
    prints,
    squares,
    yields_then,
)

from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import (
    ArgumentError,
    CrashError,
    OverrunError,
    StateError,
    StateFault,
)


@pytest.fixture
def child():
    with ChildProcess() as made:
        yield made


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
    with pytest.raises(RuntimeError, match="StubbornError: 1 and 2"):
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


@pytest.mark.parametrize("leave", [os._exit, sys.exit])
def test_an_exit_is_an_error(child, leave):
    with pytest.raises(CrashError, match="the process ended with exit code 3"):
        child.call(leave, 3)


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
    """Modules are imported before the time begins: numpy's alone take longer."""
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
from child_calls import holds_the_process
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
