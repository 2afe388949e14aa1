"""Where samples are computed: processes on this machine, or the workers of a Dask scheduler.

Samples in processes of their own: what crashes or takes too long becomes its row.
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
"""Yields the rows of samples: `evaluate_each`, or what takes the same arguments."""

_MESSAGE_PAUSE = 0.02
"""Seconds between two messages of a process: each costs as much as a fast sample."""
_PROCESSES_OF_A_SAMPLE = 2
"""How many processes a sample may end: the first may have ended for another reason."""


def compute_in(
    processes: ChildProcesses,
    evaluation: EvaluateSamples,
    study: Study,
    samples: Sequence[tuple[int, Sample]],
) -> tuple[list[Row], float]:
    """Compute samples in one process, which is replaced when it dies or has to be ended.

    Args:
        processes: Where to take it from.
        evaluation: What yields their rows.
        study: The study.
        samples: Number and values of each sample.

    Returns:
        The rows, and the seconds that they took; only the first rows once the processes were
        stopped.

    Raises:
        StudyError: If processes do not start.
    """
    limit = study.entry.compute.sample_time_limit
    pause = _MESSAGE_PAUSE if limit is None else 0.0
    rows: dict[int, Row] = {}
    tries = 0

    def give_up(why: Failure, error: str) -> None:
        number = next(number for number, _ in samples if number not in rows)
        rows[number] = failure_row(number, why, error)

    child = _taken(processes)
    begin = time.perf_counter()
    try:
        while len(rows) < len(samples) and not processes.stopped.is_set():
            if not child.is_running:
                child = _taken(processes, child)
            rest = _rest(study, samples, rows)
            try:
                for more in child.iterate(_together, evaluation, study, rest, pause, limit=limit):
                    new = {row["sample"]: row for row in more}
                    tries = 0 if new.keys() - rows.keys() else tries
                    rows = new | rows
            except OverrunError as error:
                give_up(Failure.OUT_OF_TIME, f"{error} (sample_time_limit)")
                tries = 0
            except CrashError as error:
                if processes.stopped.is_set():
                    break
                # Which of several it was shows where the next process sends them one by one.
                tries += pause == 0.0
                pause = 0.0
                if tries == _PROCESSES_OF_A_SAMPLE:
                    give_up(Failure.CRASHED, f"{error}, and so was a second one")
                    tries = 0
    finally:
        processes.give_back(child)
    return [*rows.values()], time.perf_counter() - begin


def _rest(
    study: Study, samples: Sequence[tuple[int, Sample]], rows: Mapping[int, Row]
) -> tuple[tuple[int, Sample], ...]:
    """Return what has no row yet, and what it may learn from: of its block what came before."""
    first = next(number for number, _ in samples if number not in rows)
    crashed = {number for number, row in rows.items() if row["status"] == Failure.CRASHED}
    begin = first - first % study.block
    return tuple([one for one in samples if one[0] >= begin and one[0] not in crashed])


def _together(
    evaluation: EvaluateSamples,
    study: Study,
    samples: Sequence[tuple[int, Sample]],
    pause: float,
) -> Iterator[list[Row]]:
    """Yield the rows that an evaluation yields, if they come fast, many at a time.

    A list is never longer than all before it together: so much is lost with a process at most.

    Args:
        evaluation: What yields rows.
        study: The study.
        samples: Number and values of each sample.
        pause: Least seconds between two lists; 0: each row comes alone.
    """
    rows: list[Row] = []
    sent, last = 1, time.perf_counter()
    # Alone a row tells that its sample did not end the process.
    for row in evaluation(study, samples, one_by_one=pause == 0.0):
        rows.append(row)
        if len(rows) >= sent or time.perf_counter() - last >= pause:
            yield rows
            sent += len(rows)
            rows, last = [], time.perf_counter()
    if rows:
        yield rows


def compute_here(
    evaluation: EvaluateSamples, study: Study, samples: Sequence[tuple[int, Sample]]
) -> tuple[list[Row], float]:
    """Compute samples as `compute_in` does, beside the worker of an executor that calls this.

    The process that it needs is kept for further calls and ends when there have been none for a
    minute.
    """
    return compute_in(kept_processes(), evaluation, study, samples)


def _taken(processes: ChildProcesses, instead_of: ChildProcess | None = None) -> ChildProcess:
    """Return a process that has loaded what evaluates samples."""
    try:
        return processes.taken(_together, instead_of)
    except CrashError as error:
        raise StudyError(str(error)) from None


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

    def start_one() -> None:
        processes.give_back(_taken(processes))

    def close() -> None:
        processes.stop()
        threads.shutdown(wait=True, cancel_futures=True)

    try:
        for ready in [threads.submit(start_one) for _ in range(workers)]:
            ready.result()
    except BaseException:
        close()
        raise
    return Workforce(workers, partial(threads.submit, compute_in, processes), close)


@contextmanager
def dask_executor(address: str, timeout: float = 10.0) -> Iterator[tuple[Executor, int]]:
    """Return an executor on the workers of a Dask scheduler, and how many threads they have in all.

    Args:
        address: Of the scheduler, e.g. ``tcp://10.0.0.5:8786``.
        timeout: How long to wait for its answer, s.

    Raises:
        StudyError: If Dask is not installed, or the scheduler does not answer or has no workers.
    """
    with optional_import("this needs Dask", "dask", StudyError):
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
"""How long a chunk should take: long beside the way to a worker, short beside a progress bar."""
_LARGEST_CHUNK = 4096
_CHUNKS_OF_A_WORKER = 2
"""Chunks a worker: one that it computes, and one that waits for it."""


@dataclass(eq=False)
class Dispatch:
    """Sends chunks of samples to workers and keeps the rows that come back.

    Attributes:
        study: The study, which may grow between two runs.
        workforce: The workers.
        keep: Takes rows.
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
        """Run until samples have their rows.

        Args:
            missing: Their numbers, ascending.
            count: How many they are.

        Raises:
            StudyError: If workers are lost, or the study's record cannot keep a solution.
        """
        self._missing, self._remaining = missing, count
        while self._remaining or self._running:
            self._send()
            done, _ = wait(self._running, return_when=FIRST_COMPLETED)
            for future in done:
                self._receive(future)

    def close(self) -> None:
        """Close the workers; keep the rows that they have ready."""
        uncancelled = [future for future in self._running if not future.cancel()]
        self.workforce.close()
        for future in uncancelled:
            if future.done() and future.exception() is None:
                chunk = {*self._running[future]}
                self.keep([row for row in future.result()[0] if row["sample"] in chunk])

    def _send(self) -> None:
        while self._remaining and len(self._running) < _CHUNKS_OF_A_WORKER * self.workforce.workers:
            chunk = self._chunk()
            samples = [(number, self.study.samples[number]) for number in self._with_blocks(chunk)]
            try:
                future = self.workforce.submit(evaluate_each, self._plan, samples)
            except BrokenExecutor as error:
                raise _lost(error) from error
            self._running[future] = chunk

    def _chunk(self) -> list[int]:
        """Take the next samples off the queue: whole blocks, as far as they are missing."""
        block, size = self.study.block, self._size()
        # One more than the longest chunk: it tells whether its block ends.
        self._queue.extend(islice(self._missing, max(0, size + block - len(self._queue))))
        chunk: list[int] = []
        while self._queue and (len(chunk) < size or self._queue[0] // block == chunk[-1] // block):
            chunk.append(self._queue.popleft())
        self._remaining -= len(chunk)
        return chunk

    def _with_blocks(self, chunk: Sequence[int]) -> list[int]:
        """Return samples and what they may learn from: those before them in their blocks."""
        block = self.study.block
        last = {number // block: number for number in chunk}
        return [n for place, end in last.items() for n in range(place * block, end + 1)]

    @cached_property
    def _plan(self) -> Study:
        """The study as workers get it, with every chunk: without its samples."""
        return replace(self.study, samples=())

    def _size(self) -> int:
        """Return the next chunk's size: smaller toward the end, so that no worker ends late."""
        if self._pace is None:
            return 1
        fair_share = self._remaining / (_CHUNKS_OF_A_WORKER * self.workforce.workers)
        return max(1, min(int(_CHUNK_SECONDS / self._pace), int(fair_share), _LARGEST_CHUNK))

    def _receive(self, future: Future[Any]) -> None:
        """Keep the rows of a future."""
        chunk = {*self._running.pop(future)}
        try:
            rows, seconds = future.result()
        except StudyError:
            raise
        except Exception as error:
            raise _lost(error) from error
        self.keep([row for row in rows if row["sample"] in chunk])
        now = seconds / len(chunk)
        self._pace = now if self._pace is None else 0.5 * (self._pace + now)


def _lost(error: Exception) -> StudyError:
    return StudyError(
        f"a worker failed ({type(error).__name__}: {error}); the rows so far are kept: run "
        "the study again to go on"
    )
