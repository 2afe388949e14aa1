"""Where samples are computed: processes on this machine, or the workers of a Dask scheduler.

Samples run in child processes: one that crashes or runs out of time gets a row that says so.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import islice
from typing import Any

from graspless_pin.child_process import ChildProcess, ChildProcesses, kept_processes
from graspless_pin.errors import CrashError, OverrunError, StudyError, optional_import
from graspless_pin.studies.keys import Sample
from graspless_pin.studies.sample_evaluation import Failure, evaluate_each, failure_row
from graspless_pin.studies.study import Row, Study

EvaluateSamples = Callable[..., Iterator[Row]]
"""Yields the rows of samples: `evaluate_each` or a function with the same arguments."""

_MESSAGE_PAUSE = 0.02
"""Least seconds between two messages of a process: each costs as much as a fast sample."""
_PROCESSES_OF_A_SAMPLE = 2
"""Crashes after which a sample is given up: the first may have had another reason."""


def compute_in(
    processes: ChildProcesses,
    evaluation: EvaluateSamples,
    study: Study,
    samples: Sequence[tuple[int, Sample]],
) -> tuple[list[Row], float]:
    """Compute samples in one process, which is replaced when it crashes or runs out of time.

    Args:
        processes: The pool to take it from.
        evaluation: The function that yields the rows.
        study: The study.
        samples: Number and values of each sample.

    Returns:
        The rows, and the seconds that they took; not all rows if the processes were stopped.

    Raises:
        StudyError: If a process does not start.
    """
    limit = study.entry.compute.sample_time_limit
    pause = _MESSAGE_PAUSE if limit is None else 0.0
    rows: dict[int, Row] = {}
    crashes = 0

    def give_up(reason: Failure, error: str) -> None:
        number = next(number for number, _ in samples if number not in rows)
        rows[number] = failure_row(number, reason, error)

    child = _take_process(processes)
    begin = time.perf_counter()
    try:
        while len(rows) < len(samples) and not processes.stopped.is_set():
            if not child.is_running:
                child = _take_process(processes, child)
            unsent = _samples_to_send(study, samples, rows)
            try:
                for new_rows in child.iterate(
                    _row_batches, evaluation, study, unsent, pause, limit=limit
                ):
                    new_by_number = {row["sample"]: row for row in new_rows}
                    crashes = 0 if new_by_number.keys() - rows.keys() else crashes
                    rows = new_by_number | rows
            except OverrunError as error:
                give_up(Failure.OUT_OF_TIME, f"{error} (sample_time_limit)")
                crashes = 0
            except CrashError as error:
                if processes.stopped.is_set():
                    break
                # Rows sent one by one tell which of several samples crashes the next process.
                crashes += pause == 0.0
                pause = 0.0
                if crashes == _PROCESSES_OF_A_SAMPLE:
                    give_up(Failure.CRASHED, f"{error}, and a second process ended, too")
                    crashes = 0
    finally:
        processes.give_back(child)
    return [*rows.values()], time.perf_counter() - begin


def _samples_to_send(
    study: Study, samples: Sequence[tuple[int, Sample]], rows: Mapping[int, Row]
) -> tuple[tuple[int, Sample], ...]:
    """Return the samples from the block of the first one without a row on, without crashed ones."""
    next_number = next(number for number, _ in samples if number not in rows)
    crashed = {number for number, row in rows.items() if row["status"] == Failure.CRASHED}
    start = next_number - next_number % study.block
    return tuple([item for item in samples if item[0] >= start and item[0] not in crashed])


def _row_batches(
    evaluation: EvaluateSamples,
    study: Study,
    samples: Sequence[tuple[int, Sample]],
    pause: float,
) -> Iterator[list[Row]]:
    """Yield the rows of an evaluation in lists, with several rows each where they come fast.

    No list is longer than all lists before it together, which bounds what a crash loses.

    Args:
        evaluation: The function that yields the rows.
        study: The study.
        samples: Number and values of each sample.
        pause: Least seconds between two lists; 0: one row in each list.
    """
    rows: list[Row] = []
    sent_count, sent_at = 1, time.perf_counter()
    # A row sent at once shows that its sample did not crash the process.
    for row in evaluation(study, samples, one_by_one=pause == 0.0):
        rows.append(row)
        if len(rows) >= sent_count or time.perf_counter() - sent_at >= pause:
            yield rows
            sent_count += len(rows)
            rows, sent_at = [], time.perf_counter()
    if rows:
        yield rows


def compute_here(
    evaluation: EvaluateSamples, study: Study, samples: Sequence[tuple[int, Sample]]
) -> tuple[list[Row], float]:
    """Compute samples as `compute_in` does, in a child process of an executor's worker.

    The process is kept for further calls and ends after a minute without any.
    """
    return compute_in(kept_processes(), evaluation, study, samples)


def _take_process(processes: ChildProcesses, replaced: ChildProcess | None = None) -> ChildProcess:
    """Return a process that has imported the evaluation of samples."""
    try:
        return processes.take(_row_batches, replaced)
    except CrashError as error:
        raise StudyError(str(error)) from None


@dataclass(frozen=True)
class Workforce:
    """Where samples are computed.

    Attributes:
        workers: Number of workers; each gets `_CHUNKS_OF_A_WORKER` chunks at a time.
        submit: Submits samples: called with `evaluate_each`, the study and the samples.
        close: Ends the workers; samples that have not begun are dropped.
    """

    workers: int
    submit: Callable[..., Future[Any]]
    close: Callable[[], None]


def local_processes(workers: int) -> Workforce:
    """Start processes on this machine, each with one thread for linear algebra: see `compute_in`.

    Raises:
        StudyError: If they do not start.
    """
    processes = ChildProcesses()
    threads = ThreadPoolExecutor(workers, thread_name_prefix="graspless-study")

    def start_one() -> None:
        processes.give_back(_take_process(processes))

    def close() -> None:
        processes.stop()
        threads.shutdown(wait=True, cancel_futures=True)

    try:
        for started in [threads.submit(start_one) for _ in range(workers)]:
            started.result()
    except BaseException:
        close()
        raise
    return Workforce(workers, partial(threads.submit, compute_in, processes), close)


@contextmanager
def dask_executor(address: str, timeout: float = 10.0) -> Iterator[tuple[Executor, int]]:
    """Return an executor on the workers of a Dask scheduler, and their total number of threads.

    Args:
        address: Address of the scheduler, e.g. ``tcp://10.0.0.5:8786``.
        timeout: Longest wait for its answer, s.

    Raises:
        StudyError: If Dask is not installed, or the scheduler does not answer or has no workers.
    """
    with optional_import("computing on Dask workers needs Dask", "dask", StudyError):
        from distributed import Client
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


_CHUNK_SECONDS = 0.5
"""Intended duration of a chunk, s: long against its transfer, short for a progress bar."""
_LARGEST_CHUNK = 4096
_CHUNKS_OF_A_WORKER = 2
"""Chunks per worker: one that is computed, and one in the queue."""


@dataclass(eq=False)
class Dispatch:
    """Submits chunks of samples to workers and stores the rows that they return.

    Attributes:
        study: The study, which may get more samples between two runs.
        workforce: The workers.
        keep: Stores rows.
    """

    study: Study
    workforce: Workforce
    keep: Callable[[list[Row]], None]
    _missing: Iterator[int] = field(default_factory=lambda: iter(()))
    _remaining: int = 0
    _queue: deque[int] = field(default_factory=deque)
    _running: dict[Future[Any], list[int]] = field(default_factory=dict)
    _pace: float | None = None

    def run(self, missing: Iterator[int], count: int) -> None:
        """Run until all given samples have a row.

        Args:
            missing: Numbers of the samples, ascending.
            count: How many samples.

        Raises:
            StudyError: If workers are lost, or the study's record cannot store a solution.
        """
        self._missing, self._remaining = missing, count
        while self._remaining or self._running:
            self._submit_chunks()
            done, _ = wait(self._running, return_when=FIRST_COMPLETED)
            for future in done:
                self._keep_result(future)

    def close(self) -> None:
        """Close the workers; store the rows of chunks that are complete."""
        uncancelled = [future for future in self._running if not future.cancel()]
        self.workforce.close()
        for future in uncancelled:
            if future.done() and future.exception() is None:
                chunk = {*self._running[future]}
                self.keep([row for row in future.result()[0] if row["sample"] in chunk])

    def _submit_chunks(self) -> None:
        while self._remaining and len(self._running) < _CHUNKS_OF_A_WORKER * self.workforce.workers:
            chunk = self._next_chunk()
            samples = [(n, self.study.samples[n]) for n in self._with_predecessors(chunk)]
            try:
                future = self.workforce.submit(evaluate_each, self._study_without_samples, samples)
            except BrokenExecutor as error:
                raise _lost_worker_error(error) from error
            self._running[future] = chunk

    def _next_chunk(self) -> list[int]:
        """Return the numbers of the next chunk: the missing samples of whole blocks."""
        block, size = self.study.block, self._next_chunk_size()
        # One number beyond the longest chunk tells whether its last block is complete.
        self._queue.extend(islice(self._missing, max(0, size + block - len(self._queue))))
        chunk: list[int] = []
        while self._queue and (len(chunk) < size or self._queue[0] // block == chunk[-1] // block):
            chunk.append(self._queue.popleft())
        self._remaining -= len(chunk)
        return chunk

    def _with_predecessors(self, chunk: Sequence[int]) -> list[int]:
        """Return samples with those before them in their blocks, for their warm starts."""
        block = self.study.block
        last = {number // block: number for number in chunk}
        return [n for place, end in last.items() for n in range(place * block, end + 1)]

    @cached_property
    def _study_without_samples(self) -> Study:
        """The study as it is sent with each chunk: without its samples."""
        return replace(self.study, samples=())

    def _next_chunk_size(self) -> int:
        """Return the size of the next chunk: smaller toward the end, so that no worker is last."""
        if self._pace is None:
            return 1
        fair_share = self._remaining / (_CHUNKS_OF_A_WORKER * self.workforce.workers)
        return max(1, min(int(_CHUNK_SECONDS / self._pace), int(fair_share), _LARGEST_CHUNK))

    def _keep_result(self, future: Future[Any]) -> None:
        """Store the rows of a future, and update the seconds per sample."""
        chunk = {*self._running.pop(future)}
        try:
            rows, seconds = future.result()
        except StudyError:
            raise
        except Exception as error:
            raise _lost_worker_error(error) from error
        self.keep([row for row in rows if row["sample"] in chunk])
        pace = seconds / len(chunk)
        self._pace = pace if self._pace is None else 0.5 * (self._pace + pace)


def _lost_worker_error(error: Exception) -> StudyError:
    return StudyError(
        f"a worker failed ({type(error).__name__}: {error}); the rows computed so far are "
        "kept: run the study again to continue"
    )
