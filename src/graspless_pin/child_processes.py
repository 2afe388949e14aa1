"""Child processes that are kept ready: one for each thread that asks at a time."""

from __future__ import annotations

import atexit
import os
import threading
from collections.abc import Callable
from functools import cache

from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import CrashError

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
        self, ready: Callable[[], object], instead_of: ChildProcess | None = None
    ) -> ChildProcess:
        """Return a process that answers, to be given back.

        Args:
            ready: What it answers first; the modules that this function needs are loaded then.
            instead_of: One that was taken and has died, or has to end; None: a further one.

        Raises:
            CrashError: If it does not start.
        """
        if instead_of is not None:
            self._drop(instead_of)
            return self._started(ready)
        with self._lock:
            child = self._idle.pop() if self._idle else None
        if child is None:
            return self._started(ready)
        with self._lock:
            self._busy.add(child)
        try:
            child.call(ready)
        except CrashError:
            return self.taken(ready, child)
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

    def _started(self, ready: Callable[[], object]) -> ChildProcess:
        child = ChildProcess(environment=_ONE_THREAD, idle_seconds=self._idle_seconds)
        with self._lock:
            self._busy.add(child)
        try:
            child.call(ready)
        except CrashError as error:
            self._drop(child)
            raise CrashError(f"the worker processes do not start ({error})") from None
        return child

    def _drop(self, child: ChildProcess) -> None:
        with self._lock:
            self._busy.discard(child)
        child.close()


def kept_processes() -> ChildProcesses:
    """Return the processes that this process keeps; each ends after a minute without work."""
    return _kept_by(os.getpid())


@cache
def _kept_by(_process: int) -> ChildProcesses:
    """One set for each process: those of a parent that has forked are not ours."""
    children = ChildProcesses(idle_seconds=_IDLE_SECONDS)
    atexit.register(children.stop)
    return children
