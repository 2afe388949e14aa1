"""Samples in processes of their own: what crashes or takes too long becomes its row."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence

from graspless_pin.child_process import ChildProcess
from graspless_pin.child_processes import ChildProcesses, kept_processes
from graspless_pin.errors import CrashError, OverrunError, StudyError
from graspless_pin.studies.sample_evaluation import Failure, Row, failure_row
from graspless_pin.studies.study import Sample, Study

EvaluateSamples = Callable[[Study, Sequence[tuple[int, Sample]]], Iterator[Row]]
"""Yields the rows of samples, such as `evaluate_each`."""

_TRIES = 2
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
    rest = deque(samples)
    rows: list[Row] = []
    tries = 0

    def give_up(why: Failure, error: str) -> None:
        rows.append(failure_row(rest.popleft()[0], why, error))

    child = _taken(processes)
    begin = time.perf_counter()
    try:
        while rest and not processes.stopped.is_set():
            if not child.is_running:
                child = _taken(processes, child)
            try:
                for row in child.iterate(evaluation, study, tuple(rest), limit=limit):
                    rows.append(row)
                    rest.popleft()
                    tries = 0
            except OverrunError as error:
                give_up(Failure.OUT_OF_TIME, f"{error} (sample_time_limit)")
                tries = 0
            except CrashError as error:
                if processes.stopped.is_set():
                    break
                tries += 1
                if tries == _TRIES:
                    give_up(Failure.CRASHED, f"{error}, and so was a second one")
                    tries = 0
    finally:
        processes.give_back(child)
    return rows, time.perf_counter() - begin


def start_in(processes: ChildProcesses) -> None:
    """Have one more process ready.

    Raises:
        StudyError: If it does not start.
    """
    processes.give_back(_taken(processes))


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
        return processes.taken(_ready, instead_of)
    except CrashError as error:
        raise StudyError(str(error)) from None


def _ready() -> bool:
    """Answer. Where this can be called, what evaluates samples has been loaded."""
    return True
