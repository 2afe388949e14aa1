"""A study of the paper's cuboid on all cores, against a plain loop over Algorithm 1."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from tabulate import tabulate

from benchmarks.timing import as_new, timed
from graspless_pin import QuasistaticProblem, maximize_margin
from graspless_pin.child_process import usable_cores
from graspless_pin.studies import Study, load_study, run_study
from graspless_pin.studies.executors import Workforce, local_processes
from graspless_pin.studies.keys import Sample

_STUDY = Path(__file__).parents[1] / "examples" / "studies" / "cuboid_friction_slope_height.yaml"
_SAMPLES = 2000
_EVERY = 10


class Counted(Executor):
    """Processes that are already there, asked directly; adds up the seconds that samples take."""

    def __init__(self, processes: Workforce) -> None:
        self.seconds = 0.0
        self._processes = processes

    def submit(self, _here: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
        future = self._processes.submit(*args)
        future.add_done_callback(self._count)
        return future

    def _count(self, future: Future[Any]) -> None:
        self.seconds += future.result()[1]


def cuboid_study() -> str:
    """Samples a second of a part of the 10 000-sample study, and of two plain loops."""
    whole = load_study(_STUDY)
    part = replace(whole, samples=whole.samples[:_SAMPLES], fingerprint=f"{whole.fingerprint} part")
    few = part.samples[::_EVERY]
    problems = [part.scene_at(sample).problem() for sample in few]
    # The loops run before and after the study: other work on the machine hits both.
    loops = [partial(_solve_all, problems), partial(_load_and_solve_all, part, few)]
    before = [timed(loop) for loop in loops]
    cores = usable_cores()
    processes = local_processes(cores)
    counted = Counted(processes)
    try:
        with tempfile.TemporaryDirectory() as folder:
            output = Path(folder) / "out.parquet"
            study = timed(
                partial(run_study, part, output, executor=counted, workers=cores, progress=False)
            )
    finally:
        processes.close()
    seconds = [0.5 * (a + timed(b)) / len(few) for a, b in zip(before, loops, strict=True)]
    rate = _SAMPLES / study
    names = ["`maximize_margin`, problems ready", "scene, problem and `maximize_margin`"]
    rows = [
        [f"a loop over {name}", 1, 1.0 / each, rate * each]
        for name, each in zip(names, seconds, strict=True)
    ]
    rows.append(["`run_study`", cores, rate, 1.0])
    headers = ["", "processes", "samples a second", "`run_study` over it"]
    table = tabulate(rows, headers, "pipe", floatfmt=("", "", ".0f", ".2f"))
    return (
        f"### A study\n\n{_SAMPLES} of the 10 000 samples of the paper's cuboid over friction, "
        f"slope and finger height, in processes that are ready. They were busy with samples "
        f"{100.0 * counted.seconds / (cores * study):.0f} % of the time.\n\n{table}"
    )


def _solve_all(problems: list[QuasistaticProblem]) -> None:
    for problem in problems:
        maximize_margin(as_new(problem))


def _load_and_solve_all(study: Study, samples: Sequence[Sample]) -> None:
    for sample in samples:
        maximize_margin(study.scene_at(sample).problem())
