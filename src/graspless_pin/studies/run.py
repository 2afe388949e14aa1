"""Run a study: chunks of samples to workers, rows to the journal, at the end one table."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from graspless_pin.child_processes import usable_cores
from graspless_pin.drafts import remove_stale_drafts
from graspless_pin.errors import StudyError
from graspless_pin.problem.checks import whole_number
from graspless_pin.studies.checks import check_study
from graspless_pin.studies.executors import Workforce, given_executor, local_processes
from graspless_pin.studies.journal import JOURNAL_FORMAT, Journal, discard
from graspless_pin.studies.sample_evaluation import Failure, Row, evaluate_each
from graspless_pin.studies.study import Study
from graspless_pin.studies.tables import (
    KEY,
    check_columns,
    format_of,
    read_results,
    require_tables,
    results_table,
    write_results,
)
from graspless_pin.versions import versions

if TYPE_CHECKING:
    import pandas as pd

_CHUNK_SECONDS = 0.5
"""How long a chunk should take: long beside the way to a worker, short beside a progress bar."""
_LARGEST_CHUNK = 4096
_LONGEST_NAME = 220
"""Bytes of an output's name; its journal and draft have longer ones, and 255 is the end."""
_AHEAD = 2
"""Chunks a worker: one that it computes, and one that waits for it."""


def run_study(
    study: Study,
    output: str | Path,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: bool = True,
    overwrite: bool = False,
    fresh: bool = False,
) -> pd.DataFrame:
    """Compute all samples of a study and write the table.

    Rows go to a journal beside the output (``results.parquet.journal``) as they come. A run that
    was killed goes on from there, and a study whose output is complete is only read back.

    Args:
        study: The study.
        output: The table's file; ``.parquet`` or ``.csv``.
        executor: Where to compute; None: processes on this machine. Its workers need this package,
            and the scene's files at the same paths.
        workers: Processes, or how many chunks of samples the executor is kept busy with; None: the
            number of cores that this process may use.
        progress: Whether to show a progress bar on standard error, and whether a run goes on.
        overwrite: Whether what is not this study's may be replaced: the output and its journal.
        fresh: Whether to drop what an earlier run of this study has left.

    Returns:
        The table, one row a sample in the order of the samples: the same for the same seed,
        however many workers there are.

    Raises:
        StudyError: If the study cannot be computed at all, the output cannot be written or belongs
            to another study, or workers cannot be had.

    Examples:
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin import read_results, run_study
        >>> from graspless_pin.studies import Study, results_summary
        >>> vary = {"object.mass": {"values": [1.0, 2.0]}}  # kg
        >>> data = {"scene": "examples/paper/cuboid_at_rest.yaml", "vary": vary}
        >>> study = Study.from_data(data, folder=".")
        >>> with TemporaryDirectory() as folder:
        ...     table = run_study(study, f"{folder}/results.csv", workers=1, progress=False)
        ...     again = read_results(f"{folder}/results.csv")
        >>> table["margin_N"].round(3).tolist()
        [1.65, 1.875]
        >>> print(results_summary(again).splitlines()[0])
        2 samples: 2 found, 0 infeasible, 0 failed
    """
    require_tables()
    file = Path(output)
    format_of(file)
    _check_name(file)
    check_columns(study)
    count = whole_number("workers", usable_cores() if workers is None else workers, 1)
    journal_file = file.with_name(f"{file.name}.journal")
    if not fresh:
        finished = _finished(study, file, overwrite=overwrite, goes_on=journal_file.exists())
        if finished is not None and not _unrecorded(study, finished["status"].tolist()):
            discard(journal_file, study.fingerprint)
            remove_stale_drafts(file)
            if progress:
                _notice(f"{file} is complete: nothing is left to compute (--fresh begins anew)")
            return finished
    elif file.is_file() and not overwrite:
        _check_own(study, file)
    _check_folder(file)
    check_study(study)
    identity = {"format": JOURNAL_FORMAT, "fingerprint": study.fingerprint, "versions": versions()}
    journal = Journal(journal_file, identity, fresh=fresh, overwrite=overwrite)
    complete = False
    try:
        known = [journal.rows.get(n, {}).get("status") for n in range(len(study.samples))]
        again = _unrecorded(study, known)
        missing = [n for n, status in enumerate(known) if status is None or n in again]
        if missing:
            if progress and journal.rows:
                _notice(f"goes on: {len(journal.rows)} samples are there from an earlier run")
            _compute(study, missing, journal, executor, count, progress=progress)
        table = results_table(study, journal.rows)
        write_results(table, file)
        complete = True
    finally:
        journal.close(remove=complete)
    return table


def _unrecorded(study: Study, statuses: Sequence[str | None]) -> set[int]:
    """Return samples with a solution that the study's record lacks; without a record: none."""
    if study.record is None:
        return set()
    failures = {why.value for why in Failure}
    return {
        number
        for number, status in enumerate(statuses)
        if status is not None and status not in failures and not study.record.has(number)
    }


def _check_name(file: Path) -> None:
    """Refuse a name that leaves no room for the names of journal and draft."""
    length = len(os.fsencode(file.name))
    if length > _LONGEST_NAME:
        raise StudyError(
            f"{file}: its name has {length} bytes; give one of at most {_LONGEST_NAME}"
        )
    try:
        file.lstat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:
        raise StudyError(f"{str(file)!r}: is no path of a file ({error})") from None


def _check_folder(file: Path) -> None:
    if file.is_dir():
        raise StudyError(f"{file}: is a folder; name a file in it")
    if not file.parent.is_dir():
        raise StudyError(f"{file}: there is no folder {str(file.parent)!r}; make it first")
    if not os.access(file.parent, os.W_OK):
        raise StudyError(f"{file}: its folder cannot be written to; choose another output")


def _check_own(study: Study, file: Path) -> dict[str, Any]:
    """Return what a file says of its study, which has to be this one."""
    try:
        about: dict[str, Any] = read_results(file).attrs[KEY]
    except StudyError as error:
        raise StudyError(f"{error}; choose another output, or replace it (--overwrite)") from None
    if about["fingerprint"] != study.fingerprint:
        raise StudyError(
            f"{file}: holds the results of another study ({about['study']!r}, or of this one "
            "before it or its scene was changed); choose another output, or replace it "
            "(--overwrite)"
        )
    return about


def _finished(study: Study, file: Path, *, overwrite: bool, goes_on: bool) -> pd.DataFrame | None:
    """Return the table where the output is already complete; refuse another study's output."""
    if not file.is_file():
        return None
    try:
        about = _check_own(study, file)
    except StudyError:
        if overwrite:
            return None
        raise
    if about["versions"] != versions():
        if overwrite or goes_on:
            return None
        raise StudyError(
            f"{file}: was computed with other versions of the libraries ({about['versions']}); "
            "compute it again (--fresh), or choose another output"
        )
    return read_results(file)


def _compute(
    study: Study,
    missing: Sequence[int],
    journal: Journal,
    executor: Executor | None,
    count: int,
    *,
    progress: bool,
) -> None:
    with _progress_bar(progress) as bar:
        total = len(study.samples)
        task = bar.add_task(study.name, total=total, completed=total - len(missing))
        if executor is None:
            force = local_processes(min(count, len(missing)))
        else:
            force = given_executor(executor, count)

        def keep(rows: list[Row]) -> None:
            journal.append(rows)
            bar.advance(task, len(rows))

        _Dispatch(study, force, keep, deque(missing)).run()


@dataclass(eq=False)
class _Dispatch:
    """Sends chunks of samples to workers and keeps the rows that come back.

    Attributes:
        study: The study.
        force: The workers.
        keep: Takes rows.
        queue: Samples that are still to be sent.
        running: Chunk by future.
        pace: Seconds a sample, so far.
    """

    study: Study
    force: Workforce
    keep: Callable[[list[Row]], None]
    queue: deque[int]
    running: dict[Future[Any], list[int]] = field(default_factory=dict)
    pace: float | None = None

    def run(self) -> None:
        """Run until every sample has its row; close the workers."""
        try:
            while self.queue or self.running:
                self._send()
                done, _ = wait(self.running, return_when=FIRST_COMPLETED)
                for future in done:
                    self._receive(future)
        finally:
            left = [future for future in self.running if not future.cancel()]
            self.force.close()
            for future in left:
                if future.done() and future.exception() is None:
                    chunk = {*self.running[future]}
                    self.keep([row for row in future.result()[0] if row["sample"] in chunk])

    def _send(self) -> None:
        while self.queue and len(self.running) < _AHEAD * self.force.workers:
            chunk = self._chunk()
            samples = [(number, self.study.samples[number]) for number in self._with_blocks(chunk)]
            try:
                future = self.force.submit(evaluate_each, self._plan, samples)
            except BrokenExecutor as error:
                raise _lost(error) from error
            self.running[future] = chunk

    def _chunk(self) -> list[int]:
        """Take the next samples off the queue: whole blocks, as far as they are missing."""
        block, size = self.study.block, self._size()
        chunk: list[int] = []
        while self.queue and (len(chunk) < size or self.queue[0] // block == chunk[-1] // block):
            chunk.append(self.queue.popleft())
        return chunk

    def _with_blocks(self, chunk: Sequence[int]) -> list[int]:
        """Return samples and what they may learn from: those before them in their blocks."""
        block = self.study.block
        last = {number // block: number for number in chunk}
        return [n for place, end in last.items() for n in range(place * block, end + 1)]

    @cached_property
    def _plan(self) -> Study:
        """The study as workers get it, with every chunk: without the list of all samples."""
        return replace(self.study, samples=())

    def _size(self) -> int:
        """Return the next chunk's size: smaller toward the end, so that no worker ends late."""
        if self.pace is None:
            return 1
        fair = len(self.queue) / (_AHEAD * self.force.workers)
        return max(1, min(int(_CHUNK_SECONDS / self.pace), int(fair), _LARGEST_CHUNK))

    def _receive(self, future: Future[Any]) -> None:
        """Keep the rows of a future."""
        chunk = {*self.running.pop(future)}
        try:
            rows, seconds = future.result()
        except StudyError:
            raise
        except Exception as error:
            raise _lost(error) from error
        self.keep([row for row in rows if row["sample"] in chunk])
        now = seconds / len(chunk)
        self.pace = now if self.pace is None else 0.5 * (self.pace + now)


def _lost(error: Exception) -> StudyError:
    return StudyError(
        f"a worker failed ({type(error).__name__}: {error}); the rows so far are kept: run "
        "the study again to go on"
    )


def _progress_bar(shown: bool) -> Progress:
    """Return a bar with the samples done, the time so far and the time left."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=not shown,
    )


def _notice(text: str) -> None:
    """Print one line."""
    Console(stderr=True).print(text, markup=False, highlight=False, soft_wrap=True)
