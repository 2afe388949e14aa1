"""A process of our own that computes calls and can be ended at any moment.

Native libraries hold their process while they compute, and a fault in one ends it. What may take
for ever or crash is therefore called in here: convex decomposition, the samples of a study, the
viewer's solutions. Such processes are kept ready: one for each thread that asks at a time. They may
share work: what all parts of it need is sent to each of them once.
"""

from __future__ import annotations

import atexit
import faulthandler
import math
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import IO, Any, Self, TypeVar
from uuid import uuid4

from graspless_pin.caching import Derived
from graspless_pin.errors import CrashError, GrasplessPinWarning, OverrunError

_PROGRAM = (
    "import sys; sys.path[:] = sys.argv[1:]; from graspless_pin.child_process import serve; serve()"
)
_LENGTH = struct.Struct("<Q")
_BEGUN, _ITEM, _END, _ERROR = range(4)
_ORPHAN_SLACK = 10.0
"""Seconds beyond its limit after which a child that nobody ends ends itself."""


class ChildProcess:
    """A process that computes calls, one after the other, until it is closed.

    It is started afresh and not forked, does not run the main script, ignores Ctrl-C and ends with
    its parent. Functions and values go there and back by pickle; what a call prints goes to
    standard error. Not to be shared between threads, but for `kill`.
    """

    def __init__(
        self, *, environment: Mapping[str, str] | None = None, idle_seconds: float | None = None
    ) -> None:
        """Start the process.

        Args:
            environment: Variables that it has beside those of this process.
            idle_seconds: After how long without a call it ends; None: never.
        """
        options = ["-P", "-c", _PROGRAM, *map(str, sys.path)]
        more = {} if idle_seconds is None else {_IDLE: str(idle_seconds)}
        self._process = subprocess.Popen(  # noqa: S603 - our own interpreter and program
            [sys.executable, *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **(environment or {}), **more},
            start_new_session=True,  # or Ctrl-C in a terminal would reach it
        )
        self._answers: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def is_running(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def call(
        self, function: Callable[..., Any], *arguments: Any, limit: float | None = None
    ) -> Any:
        """Compute one call.

        Args:
            function: A function that a module has under its name.
            *arguments: What it is called with.
            limit: Seconds that it may take; None: as many as it needs.

        Returns:
            What the function returns.

        Raises:
            CrashError: If the process ended.
            OverrunError: If the call took longer; the process was ended.
            Exception: What the function raises.
        """
        (result,) = self.iterate(_once, function, arguments, limit=limit)
        return result

    def iterate(
        self, function: Callable[..., Iterator[Any]], *arguments: Any, limit: float | None = None
    ) -> Iterator[Any]:
        """Run through what a function yields.

        Args:
            function: A generator function that a module has under its name.
            *arguments: What it is called with.
            limit: Seconds that each item may take; None: as many as it needs.

        Returns:
            The items, as they come. The function has begun: modules are loaded.

        Raises:
            CrashError: If the process ended, at once or at an item.
            OverrunError: If an item took longer; the process was ended.
            Exception: What the function raises.
        """
        last = None if limit is None else limit + _ORPHAN_SLACK
        request = pickle.dumps((function, arguments, last), pickle.HIGHEST_PROTOCOL)
        try:
            _send(self._stdin, request)
        except (OSError, ValueError):  # it has died, or has been closed
            raise self._crash() from None
        self._answer(None)
        return self._items(limit)

    def kill(self) -> None:
        """End the process at once. Safe in any thread, more than once."""
        self._process.kill()

    def close(self) -> None:
        """End the process and wait for it."""
        self.kill()
        self._process.wait()
        self._reader.join()
        # What was on its way to a process that died cannot be flushed.
        try:
            self._stdin.close()
        except OSError:
            return

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.close()

    @property
    def _stdin(self) -> IO[bytes]:
        assert self._process.stdin is not None  # noqa: S101 - it was asked for
        return self._process.stdin

    def _read(self) -> None:
        """Put answers into the queue as they come, at the end None."""
        assert self._process.stdout is not None  # noqa: S101 - it was asked for
        with self._process.stdout as stream:
            while (answer := _receive(stream)) is not None:
                self._answers.put(answer)
        self._answers.put(None)

    def _items(self, limit: float | None) -> Iterator[Any]:
        try:
            while True:
                kind, value = self._answer(limit)
                if kind == _END:
                    return
                yield value
        except GeneratorExit:
            self.close()  # or the rest would be taken for the answer to the next call
            raise

    def _answer(self, limit: float | None) -> tuple[int, Any]:
        try:
            answer = self._answers.get(timeout=limit)
        except queue.Empty:
            self.close()
            raise OverrunError(f"took longer than {limit:g} s") from None
        if answer is None:
            raise self._crash()
        kind, value = pickle.loads(answer)  # noqa: S301 - from our own process
        if kind == _ERROR:
            raise value
        return kind, value

    def _crash(self) -> CrashError:
        self._answers.put(None)  # for whoever asks again
        code = self._process.wait()
        if code >= 0:
            return CrashError(f"the process ended with exit code {code}")
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        return CrashError(f"the process was ended by {name}")


_IDLE = "GRASPLESS_PIN_IDLE_SECONDS"


def serve() -> None:
    """Be the child: answer what comes in on standard input until that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What is to be said of a scene, the parent says once.
    warnings.simplefilter("ignore", GrasplessPinWarning)
    stdin, stdout = os.dup(0), os.dup(1)
    # What libraries print must not come between the answers, nor may they read requests.
    os.dup2(2, 1)
    with open(os.devnull, "rb") as nothing:  # noqa: PTH123 - a descriptor is wanted
        os.dup2(nothing.fileno(), 0)
    idle = os.environ.pop(_IDLE, None)
    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(stdin, requests), daemon=True).start()
    with os.fdopen(stdout, "wb") as answers:
        while True:
            try:
                request = requests.get(timeout=None if idle is None else float(idle))
            except queue.Empty:
                return
            _answer_request(request, answers)


def _listen(stdin: int, requests: queue.SimpleQueue[bytes]) -> None:
    """Queue requests, and end this process when its parent does, even if that was killed."""
    with os.fdopen(stdin, "rb") as stream:
        while (request := _receive(stream)) is not None:
            requests.put(request)
    os._exit(1)


def _answer_request(request: bytes, answers: IO[bytes]) -> None:
    try:
        function, arguments, last = pickle.loads(request)  # noqa: S301 - from our own parent
        _send(answers, pickle.dumps((_BEGUN, None)))
        _end_after(last)
        for item in function(*arguments):
            _send(answers, pickle.dumps((_ITEM, item), pickle.HIGHEST_PROTOCOL))
            _end_after(last)
        _send(answers, pickle.dumps((_END, None)))
    except Exception as error:  # it is the caller's
        _send(answers, _pickled_error(error))
    finally:
        faulthandler.cancel_dump_traceback_later()


def _end_after(seconds: float | None) -> None:
    """End this process later on, even in a native call that lets nobody run.

    The parent does so earlier, if it has not been killed itself.
    """
    if seconds is not None:
        with open(os.devnull, "w") as nowhere:  # noqa: PTH123 - a descriptor is wanted
            faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)


def _pickled_error(error: Exception) -> bytes:
    """Return an error, or its text where it cannot be pickled."""
    try:
        answer = pickle.dumps((_ERROR, error))
        pickle.loads(answer)  # noqa: S301 - our own; some errors only fail here
    except Exception:
        return pickle.dumps((_ERROR, RuntimeError(f"{type(error).__name__}: {error}")))
    return answer


def _once(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Iterator[Any]:
    yield function(*arguments)


def _send(stream: IO[bytes], message: bytes) -> None:
    stream.write(_LENGTH.pack(len(message)))
    stream.write(message)
    stream.flush()


def _receive(stream: IO[bytes]) -> bytes | None:
    """Return the next message; None at the end of the stream, even in the middle of one."""
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(head)
    message = stream.read(length)
    return message if len(message) == length else None


_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "BLIS_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
}
_IDLE_SECONDS = 60.0


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class ChildProcesses:
    """Processes with one thread of linear algebra each, which wait for calls until they are ended.

    Attributes:
        stopped: Set once they were all ended.
    """

    def __init__(self, *, idle_seconds: float | None = None) -> None:
        """Start with none.

        Args:
            idle_seconds: After how long without work a process ends; None: never.
        """
        self._idle_seconds = idle_seconds
        self._lock = threading.Lock()
        self._idle: list[ChildProcess] = []
        self._busy: set[ChildProcess] = set()
        self.stopped = threading.Event()

    def taken(
        self, function: Callable[..., object], instead_of: ChildProcess | None = None
    ) -> ChildProcess:
        """Return a process that answers, to be given back.

        Args:
            function: What it will be asked to call; the modules that this needs are loaded now.
            instead_of: One that was taken and has died, or has to end; None: a further one.

        Raises:
            CrashError: If it does not start.
        """
        if instead_of is not None:
            self._drop(instead_of)
        with self._lock:
            was_idle = bool(self._idle) and instead_of is None
            if was_idle:
                child = self._idle.pop()
            else:
                child = ChildProcess(environment=_ONE_THREAD, idle_seconds=self._idle_seconds)
            self._busy.add(child)
        try:
            child.call(_loaded, function)
        except CrashError as error:
            if was_idle:
                return self.taken(function, child)
            self._drop(child)
            raise CrashError(f"the worker processes do not start ({error})") from None
        return child

    def give_back(self, child: ChildProcess) -> None:
        """Keep a process for the next call."""
        with self._lock:
            self._busy.discard(child)
            keep = not self.stopped.is_set()
            if keep:
                self._idle.append(child)
        if not keep:
            child.close()

    def stop(self) -> None:
        """End all processes, whatever they compute."""
        self.stopped.set()
        with self._lock:
            children = [*self._idle, *self._busy]
        for child in children:
            child.kill()
        with self._lock:
            idle, self._idle = self._idle, []
        for child in idle:
            child.close()

    def _drop(self, child: ChildProcess) -> None:
        with self._lock:
            self._busy.discard(child)
        child.close()


def _loaded(_function: Callable[..., object]) -> bool:
    """Answer: to be here the function was found in its module."""
    return True


def kept_processes() -> ChildProcesses:
    """Return the processes that this process keeps; each ends after a minute without work."""
    return _kept_by(os.getpid())


@cache
def _kept_by(_process: int) -> ChildProcesses:
    """One set for each process: those of a parent that has forked are not ours."""
    children = ChildProcesses(idle_seconds=_IDLE_SECONDS)
    atexit.register(children.stop)
    return children


_Part = TypeVar("_Part")
_Found = TypeVar("_Found")
_MOST_SHARED = 4
"""Things that a process keeps for the parts of work to come."""


def shared_work(
    compute: Callable[[Any, _Part], _Found],
    shared: object,
    parts: Sequence[_Part],
    workers: int,
    processes: ChildProcesses,
) -> Iterator[_Found]:
    """Yield what is found of parts of some work, in their order.

    Parts that were not begun when the caller stops are left out; those that were are waited for.

    Args:
        compute: Finds it, from what is shared and a part; a function that a module has under its
            name. It never returns None.
        shared: What all parts need; a process keeps it, with what it has learned, for the next.
        parts: The parts.
        workers: How many processes work at a time.
        processes: Where to take them from.

    Raises:
        CrashError: If a process dies.
        Exception: What the function raises.
    """
    token = _token_of(shared)

    def found(part: _Part) -> _Found:
        child = processes.taken(_found_there)
        try:
            there = child.call(_found_there, compute, token, None, part)
            if there is None:
                there = child.call(_found_there, compute, token, shared, part)
            return there
        finally:
            processes.give_back(child)

    with ThreadPoolExecutor(workers, thread_name_prefix="graspless-work") as threads:
        try:
            yield from threads.map(found, parts)
        finally:
            threads.shutdown(wait=True, cancel_futures=True)


_token_of: Derived[Any, str] = Derived(lambda _: uuid4().hex, most=math.inf)
"""What tells something from all else, in any process."""
_SHARED: dict[str, Any] = {}
"""What this process was sent, by token."""


def _found_there(
    compute: Callable[[Any, Any], Any], token: str, shared: object | None, part: Any
) -> Any:
    """Return what is found of a part in another process; None: what is shared is not there yet."""
    if shared is not None:
        if len(_SHARED) >= _MOST_SHARED:
            del _SHARED[next(iter(_SHARED))]
        _SHARED[token] = shared
    return compute(_SHARED[token], part) if token in _SHARED else None
