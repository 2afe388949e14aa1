"""Chunks of samples to workers, whole blocks of them, and the rows that come back."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import Any

from graspless_pin.errors import StudyError
from graspless_pin.studies.executors import Workforce
from graspless_pin.studies.rows import Row
from graspless_pin.studies.sample_evaluation import evaluate_each
from graspless_pin.studies.study import Study

_CHUNK_SECONDS = 0.5
"""How long a chunk should take: long beside the way to a worker, short beside a progress bar."""
_LARGEST_CHUNK = 4096
_AHEAD = 2
"""Chunks a worker: one that it computes, and one that waits for it."""


@dataclass(eq=False)
class Dispatch:
    """Sends chunks of samples to workers and keeps the rows that come back.

    Attributes:
        study: The study, which may grow between two runs.
        force: The workers.
        keep: Takes rows.
    """

    study: Study
    force: Workforce
    keep: Callable[[list[Row]], None]
    _missing: Iterator[int] = field(default_factory=lambda: iter(()))
    _left: int = 0
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
        self._missing, self._left = missing, count
        while self._left or self._running:
            self._send()
            done, _ = wait(self._running, return_when=FIRST_COMPLETED)
            for future in done:
                self._receive(future)

    def close(self) -> None:
        """Close the workers; keep the rows that they have ready."""
        left = [future for future in self._running if not future.cancel()]
        self.force.close()
        for future in left:
            if future.done() and future.exception() is None:
                chunk = {*self._running[future]}
                self.keep([row for row in future.result()[0] if row["sample"] in chunk])

    def _send(self) -> None:
        while self._left and len(self._running) < _AHEAD * self.force.workers:
            chunk = self._chunk()
            samples = [(number, self.study.samples[number]) for number in self._with_blocks(chunk)]
            try:
                future = self.force.submit(evaluate_each, self._plan, samples)
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
        self._left -= len(chunk)
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
        fair = self._left / (_AHEAD * self.force.workers)
        return max(1, min(int(_CHUNK_SECONDS / self._pace), int(fair), _LARGEST_CHUNK))

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
