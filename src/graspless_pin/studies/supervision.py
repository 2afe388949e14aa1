"""Samples in processes of their own: what crashes or takes too long becomes its row."""

from __future__ import annotations

import atexit
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import cache

from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import CrashError, OverrunError, StudyError
from graspless_pin.studies.sample_evaluation import Failure, Row, failure_row
from graspless_pin.studies.study import Sample, Study

EvaluateSamples = Callable[[Study, Sequence[tuple[int, Sample]]], Iterator[Row]]
"""Yields the rows of samples, such as `evaluate_each`."""

_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "BLIS_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
}
_IDLE_SECONDS = 60.0
_TRIES = 2
"""How many processes a sample may end: the first may have ended for another reason."""


class Children:
    """Processes that compute samples, one for each thread that asks at a time."""

    def __init__(self, *, idle_seconds: float | None = None) -> None:
        """Start with none.

        Args:
            idle_seconds: After how long without work a process ends; None: never.
        """
        self._idle_seconds = idle_seconds
        self._lock = threading.Lock()
        self._idle: list[ChildProcess] = []
        self._busy: set[ChildProcess] = set()
        self._stopped = threading.Event()

    def compute(
        self, evaluation: EvaluateSamples, study: Study, samples: Sequence[tuple[int, Sample]]
    ) -> tuple[list[Row], float]:
        """Compute samples in one process, which is replaced when it dies or has to be ended.

        Args:
            evaluation: What yields their rows.
            study: The study.
            samples: Number and values of each sample.

        Returns:
            The rows, and the seconds that they took; only the first rows after `stop`.

        Raises:
            StudyError: If processes do not start.
        """
        limit = study.entry.compute.sample_time_limit
        rest = deque(samples)
        rows: list[Row] = []
        tries = 0

        def give_up(why: Failure, error: str) -> None:
            rows.append(failure_row(rest.popleft()[0], why, error))

        child = self._taken()
        begin = time.perf_counter()
        try:
            while rest and not self._stopped.is_set():
                if not child.is_running:
                    child = self._replaced(child)
                try:
                    for row in child.iterate(evaluation, study, tuple(rest), limit=limit):
                        rows.append(row)
                        rest.popleft()
                        tries = 0
                except OverrunError as error:
                    give_up(Failure.OUT_OF_TIME, f"{error} (sample_time_limit)")
                    tries = 0
                except CrashError as error:
                    if self._stopped.is_set():
                        break
                    tries += 1
                    if tries == _TRIES:
                        give_up(Failure.CRASHED, f"{error}, and so was a second one")
                        tries = 0
        finally:
            self._give_back(child)
        return rows, time.perf_counter() - begin

    def start(self) -> None:
        """Have one process ready.

        Raises:
            StudyError: If it does not start.
        """
        self._give_back(self._taken())

    def stop(self) -> None:
        """End all processes: what is computed just now ends with the rows that are there."""
        self._stopped.set()
        with self._lock:
            children = [*self._idle, *self._busy]
        for child in children:
            child.kill()
        with self._lock:
            idle, self._idle = self._idle, []
        for child in idle:
            child.close()

    def _taken(self) -> ChildProcess:
        """Return a process that answers."""
        with self._lock:
            child = self._idle.pop() if self._idle else None
        if child is None:
            return self._started()
        with self._lock:
            self._busy.add(child)
        try:
            child.call(_ready)
        except CrashError:
            return self._replaced(child)
        return child

    def _started(self) -> ChildProcess:
        child = ChildProcess(environment=_ONE_THREAD, idle_seconds=self._idle_seconds)
        with self._lock:
            self._busy.add(child)
        try:
            child.call(_ready)
        except CrashError as error:
            self._drop(child)
            raise StudyError(f"the worker processes do not start ({error})") from None
        return child

    def _replaced(self, child: ChildProcess) -> ChildProcess:
        self._drop(child)
        return self._started()

    def _drop(self, child: ChildProcess) -> None:
        with self._lock:
            self._busy.discard(child)
        child.close()

    def _give_back(self, child: ChildProcess) -> None:
        with self._lock:
            self._busy.discard(child)
            keep = not self._stopped.is_set()
            if keep:
                self._idle.append(child)
        if not keep:
            child.close()


def compute_here(
    evaluation: EvaluateSamples, study: Study, samples: Sequence[tuple[int, Sample]]
) -> tuple[list[Row], float]:
    """Compute samples as `Children.compute` does, beside the worker of an executor that calls this.

    The process that it needs is kept for further calls and ends when there have been none for a
    minute.
    """
    return _children_of(os.getpid()).compute(evaluation, study, samples)


@cache
def _children_of(_process: int) -> Children:
    """One set for each process: those of a parent that has forked are not ours."""
    children = Children(idle_seconds=_IDLE_SECONDS)
    atexit.register(children.stop)
    return children


def _ready() -> bool:
    """Answer. Where this can be called, what evaluates samples has been loaded."""
    return True
