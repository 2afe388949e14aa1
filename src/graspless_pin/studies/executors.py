"""Where samples are computed: processes on this machine, or the workers of a Dask scheduler."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

from graspless_pin.errors import StudyError
from graspless_pin.studies.study import Sample, Study
from graspless_pin.studies.supervision import Children, EvaluateSamples, compute_here

Samples = Sequence[tuple[int, Sample]]
"""Number and values of each sample."""


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class LocalProcesses:
    """Processes on this machine, with one thread of linear algebra each: see `Children`."""

    def __init__(self, workers: int) -> None:
        """Start the processes.

        Raises:
            StudyError: If they do not start.
        """
        self.workers = workers
        self._children = Children()
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="graspless-study")
        try:
            for ready in [self._threads.submit(self._children.start) for _ in range(workers)]:
                ready.result()
        except BaseException:
            self.close()
            raise

    def submit(self, evaluation: EvaluateSamples, study: Study, samples: Samples) -> Future[Any]:
        """Submit samples."""
        return self._threads.submit(self._children.compute, evaluation, study, samples)

    def close(self) -> None:
        """End the processes; what has not begun is dropped."""
        self._children.stop()
        self._threads.shutdown(wait=True, cancel_futures=True)


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

    def submit(self, evaluation: EvaluateSamples, study: Study, samples: Samples) -> Future[Any]:
        """Submit samples."""
        return self._executor.submit(compute_here, evaluation, study, samples)

    def close(self) -> None:
        """Leave the executor to its owner."""


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
