"""Where samples are computed: processes on this machine, or the workers of a Dask scheduler."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from graspless_pin.child_processes import ChildProcesses
from graspless_pin.errors import StudyError
from graspless_pin.studies.supervision import compute_here, compute_in, start_in


@dataclass(frozen=True)
class Workforce:
    """Where samples are computed.

    Attributes:
        workers: How many chunks of samples it is kept busy with.
        submit: Submits samples: called with `evaluate_each`, the study and the samples.
        close: Ends it; what has not begun is dropped.
    """

    workers: int
    submit: Callable[..., Future[Any]]
    close: Callable[[], None]


def local_processes(workers: int) -> Workforce:
    """Start processes on this machine, with one thread of linear algebra each: see `compute_in`.

    Raises:
        StudyError: If they do not start.
    """
    processes = ChildProcesses()
    threads = ThreadPoolExecutor(workers, thread_name_prefix="graspless-study")

    def close() -> None:
        processes.stop()
        threads.shutdown(wait=True, cancel_futures=True)

    try:
        for ready in [threads.submit(start_in, processes) for _ in range(workers)]:
            ready.result()
    except BaseException:
        close()
        raise
    return Workforce(workers, partial(threads.submit, compute_in, processes), close)


def given_executor(executor: Executor, workers: int) -> Workforce:
    """Use somebody else's executor, which stays open."""
    return Workforce(workers, partial(executor.submit, compute_here), lambda: None)


@contextmanager
def dask_executor(address: str, timeout: float = 10.0) -> Iterator[tuple[Executor, int]]:
    """Return an executor on the workers of a Dask scheduler, and how many threads they have in all.

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
