"""Where samples are computed: processes on this machine, or the workers of a Dask scheduler."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import connection, get_context, parent_process
from types import ModuleType
from typing import Any

from graspless_pin.errors import GrasplessPinWarning, StudyError

_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class LocalProcesses:
    """Processes on this machine, with one thread of linear algebra each.

    They are started afresh and not forked, and do not run the script that starts them again. Where
    one dies, all are replaced.
    """

    def __init__(self, workers: int) -> None:
        """Start the processes.

        Raises:
            StudyError: If they do not start.
        """
        self.workers = workers
        self._pool = self._started()

    def submit(self, call: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit a call."""
        return self._pool.submit(call, *arguments)

    def renew(self) -> None:
        """Replace processes of which one has died."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = self._started()

    def close(self) -> None:
        """End the processes; what has not begun is dropped."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _started(self) -> ProcessPoolExecutor:
        pool = ProcessPoolExecutor(
            self.workers, mp_context=get_context("spawn"), initializer=_begin_worker
        )
        try:
            with _one_thread_each(), _without_script():
                # Processes are started one a call, as long as none is idle.
                for ready in [pool.submit(_worker_id) for _ in range(self.workers)]:
                    ready.result()
        except BrokenExecutor as error:
            raise StudyError(f"the worker processes do not start ({error})") from None
        return pool


class GivenExecutor:
    """Somebody else's executor."""

    def __init__(self, executor: Executor, workers: int) -> None:
        """Use an executor.

        Args:
            executor: Any executor.
            workers: How many chunks of samples it is kept busy with.
        """
        self.workers = workers
        self._executor = executor

    def submit(self, call: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit a call."""
        return self._executor.submit(call, *arguments)

    def renew(self) -> None:
        """There is nothing that could be replaced.

        Raises:
            StudyError: Always.
        """
        raise StudyError(
            "the executor lost a worker; the rows so far are kept: run the study again to go on"
        )

    def close(self) -> None:
        """Leave the executor to its owner."""


@contextmanager
def dask_executor(address: str, timeout: float = 10.0) -> Iterator[tuple[Executor, int]]:
    """An executor on the workers of a Dask scheduler, and how many threads they have in all.

    Args:
        address: Of the scheduler, e.g. ``tcp://10.0.0.5:8786``.
        timeout: How long to wait for its answer, s.

    Raises:
        StudyError: If Dask is not installed, or the scheduler does not answer or has no workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise StudyError(f"this needs Dask ({error}): pip install 'graspless-pin[dask]'") from None
    try:
        client = Client(address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError) as error:
        raise StudyError(
            f"no Dask scheduler answers at {address!r} ({error}); start one with 'dask scheduler', "
            "and workers with 'dask worker ADDRESS'"
        ) from None
    with client:
        workers: Sequence[Any] = list(client.scheduler_info(n_workers=-1)["workers"].values())
        if not workers:
            raise StudyError(
                f"the Dask scheduler at {address!r} has no workers; start some with 'dask worker "
                f"{address}'"
            )
        yield client.get_executor(), sum(worker["nthreads"] for worker in workers)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started in here do their linear algebra in one thread: all cores are taken."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _without_script() -> Iterator[None]:
    """Processes started in here do not import the main script: what they run is in this package.

    Else a script without ``if __name__ == "__main__":`` would run its study again in each of them.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


def _begin_worker() -> None:
    """Prepare a worker process: it ends with its parent, and only the parent hears Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What is to be said of the scene, the parent says once.
    warnings.simplefilter("ignore", GrasplessPinWarning)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    """End this process when its parent does, even if that was killed."""
    connection.wait([sentinel])
    os._exit(1)


def _worker_id() -> int:
    from graspless_pin.studies import evaluation  # noqa: F401 - import it before the first sample

    return os.getpid()
