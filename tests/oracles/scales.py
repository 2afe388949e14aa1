"""Judge many scenes of every scale in parallel: ``python -m tests.oracles.scales``.

Each worker is a process of its own, so that a scene which ends it or never ends is one bad line
and not the end of the run. The exit code is 0 where no answer is wrong and at most 2 % of the
scenes are refused or unverified.
"""

from __future__ import annotations

import argparse
import faulthandler
import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NamedTuple

from tabulate import tabulate
from tests.oracles.outcome import Outcome

COUNT = 2500
WEAK = 5
"""Every so many seeds a scene with a hand that is weak beside the load."""
SEED_LIMIT = 300.0
"""Seconds after which a scene counts as one that never ends."""
_MOST_OPEN = 0.02


class Judged(NamedTuple):
    """One line of the run."""

    seed: int
    outcome: str
    detail: str
    error: float
    found: bool


def judged(seed: int) -> Judged:
    """Judge one scene; an error of any kind is a wrong answer."""
    from tests.oracles.judging import judge
    from tests.oracles.scale_scenes import scale_case, weak_case

    try:
        verdict = judge(weak_case(seed) if seed % WEAK == WEAK - 1 else scale_case(seed))
    except Exception as error:  # whatever the package raises is told
        where = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__}: {error!s:.200} ({where.name}, line {where.lineno})"
        return Judged(seed, Outcome.WRONG, told, 0.0, found=False)
    return Judged(seed, verdict.outcome, verdict.detail, verdict.error, verdict.found)


Judge = Callable[[int], Judged]


def _work(
    seeds: Sequence[int], judge_one: Judge, out: Connection, limit: float, trace: Path
) -> None:
    """Judge seeds one by one and send each line; where one takes too long, write that and end."""
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # solvers print from C
        os.dup2(silent, stream)
    with trace.open("w") as where:
        for seed in seeds:
            faulthandler.dump_traceback_later(limit, exit=True, file=where)
            out.send(judge_one(seed))
            faulthandler.cancel_dump_traceback_later()
    out.close()


class _Worker:
    """A process and the seeds that it has not told of yet."""

    def __init__(self, seeds: list[int], judge_one: Judge, limit: float, trace: Path) -> None:
        self.seeds, self._judge = seeds, judge_one
        self._limit, self._trace = limit, trace
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.inbox, outbox = context.Pipe(duplex=False)
        self._process: Any = context.Process(
            target=_work,
            args=(self.seeds, self._judge, outbox, self._limit, self._trace),
            daemon=True,
        )
        self._process.start()
        outbox.close()

    def line(self) -> Judged:
        """Return the next line, or one on the seed that ended the process."""
        try:
            line: Judged = self.inbox.recv()
        except EOFError:
            self._process.join()
            return self._lost()
        self.seeds.remove(line.seed)
        return line

    def _lost(self) -> Judged:
        why = f"the process ended with {self._process.exitcode}"
        if self._trace.exists() and (trace := self._trace.read_text().splitlines()):
            where = " < ".join(line.strip() for line in trace[1:9])
            why = f"no answer in {self._limit:.0f} s; it was in {where}"
        self._trace.unlink(missing_ok=True)
        seed = self.seeds.pop(0)
        if self.seeds:
            self._start()
        return Judged(seed, Outcome.WRONG, why, 0.0, found=False)


def run(
    seeds: Sequence[int], jobs: int, judge_one: Judge = judged, limit: float = SEED_LIMIT
) -> Iterator[Judged]:
    """Yield a line for each seed as workers finish them; one may take ``limit`` seconds."""
    with tempfile.TemporaryDirectory() as folder:
        workers = [
            _Worker(list(seeds[first::jobs]), judge_one, limit, Path(folder) / str(first))
            for first in range(min(jobs, len(seeds)))
        ]
        while workers := [worker for worker in workers if worker.seeds]:
            ready = wait([worker.inbox for worker in workers])
            yield from (worker.line() for worker in workers if worker.inbox in ready)


def summary(lines: Sequence[Judged]) -> str:
    """Return the table of outcomes, with the scenes that have a solution apart."""
    found = Counter(line.outcome for line in lines if line.found)
    counts = Counter(line.outcome for line in lines)
    rows = [
        [str(outcome), counts[outcome], f"{counts[outcome] / len(lines):.1%}", found[outcome]]
        for outcome in Outcome
    ]
    worst = max((line.error for line in lines if line.outcome == Outcome.AGREE), default=0.0)
    table = tabulate(rows, ["outcome", "scenes", "share", "of them feasible"], "pipe")
    return f"{table}\n\nworst relative error where they agree: {worst:.1e}"


def passes(lines: Sequence[Judged]) -> bool:
    """Whether none is wrong and few are open."""
    counts = Counter(line.outcome for line in lines)
    unanswered = counts[Outcome.REFUSED] + counts[Outcome.UNVERIFIED]
    return not counts[Outcome.WRONG] and unanswered <= _MOST_OPEN * len(lines)


def main() -> int:
    """Judge the scenes that the arguments name."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.scales", description=__doc__)
    parser.add_argument("--count", type=int, default=COUNT, help="scenes")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    chosen = parser.parse_args()
    # Workers are as many as processors: threads of theirs would only wait for each other.
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    start, lines = time.monotonic(), []
    for line in run(range(chosen.first, chosen.first + chosen.count), chosen.jobs):
        lines.append(line)
        if line.outcome != Outcome.AGREE:
            print(f"\r{line.seed}: {line.outcome}: {line.detail}", flush=True)
        if sys.stderr.isatty() or len(lines) % 100 == 0:
            end = "" if sys.stderr.isatty() else "\n"
            counts = Counter(str(one.outcome) for one in lines)
            told = ", ".join(f"{counts[name]} {name}" for name in Outcome if counts[name])
            took = time.monotonic() - start
            print(f"\r{len(lines)}/{chosen.count} in {took:.0f} s: {told}", end=end,
                  file=sys.stderr, flush=True)  # fmt: skip
    print(f"\n{summary(lines)}\n\n{len(lines)} scenes in {time.monotonic() - start:.0f} s")
    return 0 if passes(lines) else 1


if __name__ == "__main__":
    sys.exit(main())
