"""Child processes that compute calls and can be killed at any moment.

Native libraries block their process while they compute, and a fault in one ends it. Work that may
never end or may crash is therefore called here: convex decomposition, the samples of a study, the
viewer's solutions. Such processes are kept ready: one for each thread that uses one at a time. They
may share work: data that all parts of it need are sent to each process once.
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
"""Seconds beyond its limit after which a child ends itself if its parent has not killed it."""


class ChildProcess:
    """A process that computes calls, one after the other, until it is closed.

    It is a new interpreter, not a fork, does not run the main script, ignores Ctrl-C and ends with
    its parent. Functions and values are transferred by pickle; what a call prints goes to standard
    error. Threads must not share it, except for `kill`.
    """

    def __init__(
        self, *, environment: Mapping[str, str] | None = None, idle_seconds: float | None = None
    ) -> None:
        """Start the process.

        Args:
            environment: Environment variables in addition to those of this process.
            idle_seconds: Time without a call after which it ends; None: never.
        """
        options = ["-P", "-c", _PROGRAM, *map(str, sys.path)]
        idle = {} if idle_seconds is None else {_IDLE: str(idle_seconds)}
        self._process = subprocess.Popen(  # noqa: S603 - our own interpreter and program
            [sys.executable, *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **(environment or {}), **idle},
            start_new_session=True,  # or Ctrl-C in a terminal would reach it
        )
        self._answers: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def is_running(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def call(
        self, function: Callable[..., Any], *arguments: Any, limit: float | None = None
    ) -> Any:
        """Compute one call.

        Args:
            function: A function that can be pickled, by its name in a module.
            *arguments: Its arguments.
            limit: Seconds that it may take; None: no limit.

        Returns:
            The function's result.

        Raises:
            CrashError: If the process ended.
            OverrunError: If the call took longer; the process was ended.
            Exception: The function's error.
        """
        (result,) = self.iterate(_single_call, function, arguments, limit=limit)
        return result

    def iterate(
        self, function: Callable[..., Iterator[Any]], *arguments: Any, limit: float | None = None
    ) -> Iterator[Any]:
        """Iterate over the items of a generator function.

        Args:
            function: A generator function that can be pickled, by its name in a module.
            *arguments: Its arguments.
            limit: Seconds that each item may take; None: no limit.

        Returns:
            The items, as they arrive. The function has started: modules are loaded.

        Raises:
            CrashError: If the process ended, at once or at an item.
            OverrunError: If an item took longer; the process was ended.
            Exception: The function's error.
        """
        last = None if limit is None else limit + _ORPHAN_SLACK
        request = pickle.dumps((function, arguments, last), pickle.HIGHEST_PROTOCOL)
        try:
            _send(self._stdin, request)
        except (OSError, ValueError):  # it has died, or has been closed
            raise self._crash_error() from None
        self._next_answer(None)
        return self._answer_items(limit)

    def kill(self) -> None:
        """End the process at once. It may be called in any thread, and repeatedly."""
        self._process.kill()

    def close(self) -> None:
        """End the process and wait for it."""
        self.kill()
        self._process.wait()
        self._reader.join()
        # Data still buffered for a dead process cannot be flushed.
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
        """Queue the answers as they arrive, and None at the end."""
        assert self._process.stdout is not None  # noqa: S101 - it was asked for
        with self._process.stdout as stream:
            while (answer := _receive(stream)) is not None:
                self._answers.put(answer)
        self._answers.put(None)

    def _answer_items(self, limit: float | None) -> Iterator[Any]:
        try:
            while True:
                kind, value = self._next_answer(limit)
                if kind == _END:
                    return
                yield value
        except GeneratorExit:
            self.close()  # else remaining items would be taken for answers to the next call
            raise

    def _next_answer(self, limit: float | None) -> tuple[int, Any]:
        try:
            answer = self._answers.get(timeout=limit)
        except queue.Empty:
            self.close()
            raise OverrunError(f"took longer than {limit:g} s") from None
        if answer is None:
            raise self._crash_error()
        kind, value = pickle.loads(answer)  # noqa: S301 - from our own process
        if kind == _ERROR:
            raise value
        return kind, value

    def _crash_error(self) -> CrashError:
        self._answers.put(None)  # for later calls
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
    """Run the child: answer the requests on standard input until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The parent emits the findings on a scene once.
    warnings.simplefilter("ignore", GrasplessPinWarning)
    stdin, stdout = os.dup(0), os.dup(1)
    # Libraries must not print into the answers, nor read requests.
    os.dup2(2, 1)
    with open(os.devnull, "rb") as nothing:  # noqa: PTH123 - a descriptor is wanted
        os.dup2(nothing.fileno(), 0)
    idle = os.environ.pop(_IDLE, None)
    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_queue_requests, args=(stdin, requests), daemon=True).start()
    with os.fdopen(stdout, "wb") as answers:
        while True:
            try:
                request = requests.get(timeout=None if idle is None else float(idle))
            except queue.Empty:
                return
            _answer_request(request, answers)


def _queue_requests(stdin: int, requests: queue.SimpleQueue[bytes]) -> None:
    """Queue requests, and end this process when its parent ends, even if that was killed."""
    with os.fdopen(stdin, "rb") as stream:
        while (request := _receive(stream)) is not None:
            requests.put(request)
    os._exit(1)


def _answer_request(request: bytes, answers: IO[bytes]) -> None:
    try:
        function, arguments, last = pickle.loads(request)  # noqa: S301 - from our own parent
        _send(answers, pickle.dumps((_BEGUN, None)))
        _end_process_after(last)
        for item in function(*arguments):
            _send(answers, pickle.dumps((_ITEM, item), pickle.HIGHEST_PROTOCOL))
            _end_process_after(last)
        _send(answers, pickle.dumps((_END, None)))
    except Exception as error:  # it is the caller's
        _send(answers, _pickled_error(error))
    finally:
        faulthandler.cancel_dump_traceback_later()


def _end_process_after(seconds: float | None) -> None:
    """End this process after some time, even in a native call that blocks all threads.

    The parent ends it earlier, unless it has been killed itself.
    """
    if seconds is not None:
        with open(os.devnull, "w") as nowhere:  # noqa: PTH123 - a descriptor is wanted
            faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)


def _pickled_error(error: Exception) -> bytes:
    """Return a pickled error, or one with its text if it cannot be pickled."""
    try:
        answer = pickle.dumps((_ERROR, error))
        pickle.loads(answer)  # noqa: S301 - our own; some errors only fail here
    except Exception:
        return pickle.dumps((_ERROR, RuntimeError(f"{type(error).__name__}: {error}")))
    return answer


def _single_call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Iterator[Any]:
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
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class ChildProcesses:
    """A pool of child processes, each with a single thread of linear algebra.

    Attributes:
        stopped: Set once all were ended.
    """

    def __init__(self, *, idle_seconds: float | None = None) -> None:
        """Start without processes.

        Args:
            idle_seconds: Time without work after which a process ends; None: never.
        """
        self._idle_seconds = idle_seconds
        self._lock = threading.Lock()
        self._idle: list[ChildProcess] = []
        self._busy: set[ChildProcess] = set()
        self.stopped = threading.Event()

    def take(
        self, function: Callable[..., object], instead_of: ChildProcess | None = None
    ) -> ChildProcess:
        """Return a process that answers, to be returned by `give_back`.

        Args:
            function: The function that it will call; the modules that this needs are loaded now.
            instead_of: A taken process to discard, dead or not; None: an additional one.

        Raises:
            CrashError: If it does not start.
        """
        if instead_of is not None:
            self._discard(instead_of)
        with self._lock:
            was_idle = bool(self._idle) and instead_of is None
            if was_idle:
                child = self._idle.pop()
            else:
                child = ChildProcess(environment=_ONE_THREAD, idle_seconds=self._idle_seconds)
            self._busy.add(child)
        try:
            child.call(_confirm_loaded, function)
        except CrashError as error:
            if was_idle:
                return self.take(function, child)
            self._discard(child)
            raise CrashError(f"the worker processes cannot start ({error})") from None
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
        """End all processes, even during a call."""
        self.stopped.set()
        with self._lock:
            children = [*self._idle, *self._busy]
        for child in children:
            child.kill()
        with self._lock:
            idle, self._idle = self._idle, []
        for child in idle:
            child.close()

    def _discard(self, child: ChildProcess) -> None:
        with self._lock:
            self._busy.discard(child)
        child.close()


def _confirm_loaded(_function: Callable[..., object]) -> bool:
    """Return True: the argument was unpickled, so its module is loaded."""
    return True


def kept_processes() -> ChildProcesses:
    """Return the pool of this process; each of its processes ends after a minute without work."""
    return _processes_of(os.getpid())


@cache
def _processes_of(_process: int) -> ChildProcesses:
    """Return the pool of a process by its number: a fork must not use the pool of its parent."""
    children = ChildProcesses(idle_seconds=_IDLE_SECONDS)
    atexit.register(children.stop)
    return children


_Part = TypeVar("_Part")
_Found = TypeVar("_Found")
_MOST_SHARED = 4
"""Number of shared objects that a process keeps for later parts of work."""


def shared_work(
    compute: Callable[[Any, _Part], _Found],
    shared: object,
    parts: Sequence[_Part],
    workers: int,
    processes: ChildProcesses,
) -> Iterator[_Found]:
    """Yield the results of parts of some work, in their order.

    If the caller stops, parts that have not started are skipped, and the others are waited for.

    Args:
        compute: Returns the result, never None, from the shared object and a part; it must be
            picklable, by its name in a module.
        shared: Object that all parts need; a process keeps it, with its cached state, for the next.
        parts: The parts.
        workers: Number of processes that work at a time.
        processes: The pool of processes.

    Raises:
        CrashError: If a process dies.
        Exception: The function's error.
    """
    token = _token_of(shared)

    def result_of(part: _Part) -> _Found:
        child = processes.take(_part_result)
        try:
            result = child.call(_part_result, compute, token, None, part)
            if result is None:
                result = child.call(_part_result, compute, token, shared, part)
            return result
        finally:
            processes.give_back(child)

    with ThreadPoolExecutor(workers, thread_name_prefix="graspless-work") as threads:
        try:
            yield from threads.map(result_of, parts)
        finally:
            threads.shutdown(wait=True, cancel_futures=True)


_token_of: Derived[Any, str] = Derived(lambda _: uuid4().hex, most=math.inf)
"""Returns a token that identifies an object in all processes."""
_SHARED: dict[str, Any] = {}
"""Shared objects that this process has received, by token."""


def _part_result(
    compute: Callable[[Any, Any], Any], token: str, shared: object | None, part: Any
) -> Any:
    """Return the result of a part, in a child; None if the shared object has not been sent yet."""
    if shared is not None:
        if len(_SHARED) >= _MOST_SHARED:
            del _SHARED[next(iter(_SHARED))]
        _SHARED[token] = shared
    return compute(_SHARED[token], part) if token in _SHARED else None
