"""Studies in other processes: any number of workers, killed runs, dying workers, Dask."""

import os
import random
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Future
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd
import pytest
from distributed import LocalCluster
from study_tools import FRICTION, SLOPE, Here, data, study, study_file

from graspless_pin.errors import StudyError
from graspless_pin.studies import evaluation, load_study, read_results, run_study
from graspless_pin.studies.executors import LocalProcesses, dask_executor

SAMPLES = 24
NO_DASHBOARD: Any = None
SLOW = {"minimum_friction": True}  # tens of milliseconds a sample, so that a kill meets a run
RUN = """
print("once", flush=True)  # a script without a guard for its worker processes
import sys
from concurrent.futures import ThreadPoolExecutor
from graspless_pin.studies import load_study, run_study
file, output, workers = *sys.argv[1:3], int(sys.argv[3])
executor = None if workers else ThreadPoolExecutor(1)  # without processes it starts sooner
run_study(load_study(file), output, executor=executor, workers=workers or 1, progress=False)
"""


def sobol(**more):
    vary = {
        "friction.default": {"from": 0.2, "to": 0.6},
        "object.mass": {"from": 0.5, "to": 3.0},
        "slope": {key: SLOPE[key] for key in ("from", "to", "unit", "turn")},
    }
    return data(vary, sampling={"method": "sobol", "samples": SAMPLES, "seed": 3}, **more)


def here(made, file):
    """The table as one process computes it, sample by sample."""
    return run_study(made, file, executor=Here(), workers=1, progress=False)


class Watched(LocalProcesses):
    """Local processes that tell what their environment was."""

    threads: ClassVar[set[str]] = set()

    def close(self):
        names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
        self.threads.update(self.submit(os.getenv, name).result() for name in names)
        super().close()


def test_the_number_of_processes_does_not_matter(tmp_path, monkeypatch):
    """They have one thread of linear algebra each; the parent keeps as many as it had."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.setattr("graspless_pin.studies.run.LocalProcesses", Watched)
    made = load_study(study_file(tmp_path, sobol()))
    here(made, tmp_path / "one.parquet")
    table = run_study(made, tmp_path / "more.parquet", workers=2, progress=False)
    assert len(table) == SAMPLES
    one, more = ((tmp_path / f"{name}.parquet").read_bytes() for name in ("one", "more"))
    assert one == more
    assert Watched.threads == {"1"} and os.environ["OPENBLAS_NUM_THREADS"] == "7"


def test_a_study_killed_three_times_gives_the_same_table(tmp_path):
    file = study_file(tmp_path, sobol(compute=SLOW))
    output, journal = tmp_path / "out.parquet", tmp_path / "out.parquet.journal"
    rng = random.Random(1)  # noqa: S311 - when to kill is no secret
    rows = 0
    for workers in (2, 0, 0):
        child = started(tmp_path, file, output, workers)
        until = rows + rng.randint(1, SAMPLES // 8)
        while rows_in(journal) < until:
            assert child.poll() is None, "the study ended before it was killed"
            time.sleep(0.002)
        children = Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split()
        assert len(children) >= workers
        child.kill()
        # What its workers print as they start would be read here, too; on standard error Python
        # tells that a killed process leaves semaphores.
        assert child.communicate()[0] == "once\n"
        assert_end(children)
        assert not output.exists()
        rows = rows_in(journal)
    last = started(tmp_path, file, output, 0)
    assert (*last.communicate(), last.returncode) == ("once\n", "", 0)
    here(load_study(file), tmp_path / "whole.parquet")
    assert output.read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    assert len(read_results(output)) == SAMPLES and rows < SAMPLES


def assert_end(processes):
    deadline = time.monotonic() + 20.0
    while any(map(is_running, processes)):
        assert time.monotonic() < deadline, "workers outlive their parent"
        time.sleep(0.02)


def started(folder, file, output, workers):
    """A script that runs a study."""
    script = folder / "script.py"
    script.write_text(RUN, encoding="utf-8")
    return subprocess.Popen(  # noqa: S603 - our own interpreter
        [sys.executable, str(script), str(file), str(output), str(workers)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def rows_in(journal):
    try:
        return max(journal.read_bytes().count(b"\n") - 1, 0)
    except FileNotFoundError:
        return 0


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_sample_that_kills_its_worker_is_a_row(tmp_path, monkeypatch):
    made = study({"friction.default": FRICTION})
    expected = here(made, tmp_path / "whole.csv")
    monkeypatch.setattr("graspless_pin.studies.run.evaluate_chunk", dies_at_one)
    table = run_study(made, tmp_path / "out.csv", workers=1, progress=False)
    assert_only_failure(table, expected, 1)


def dies_at_one(plan, samples):
    if any(number == 1 for number, _ in samples):
        os._exit(3)
    return evaluation.evaluate_chunk(plan, samples)


class Fragile(Here):
    """Workers that take all chunks under way with them when they die at one sample."""

    workers = 2

    def __init__(self, workers):
        super().__init__()
        self.broken = False
        self.renewed = 0

    def submit(self, fn, /, *args, **kwargs):
        if self.broken:
            raise BrokenExecutor
        if all(number != 7 for number, _ in args[1]):
            return super().submit(fn, *args, **kwargs)
        self.broken = True
        future = Future()
        future.set_exception(BrokenExecutor())
        return future

    def renew(self):
        self.broken = False
        self.renewed += 1

    def close(self):
        assert 2 <= self.renewed <= 12


def test_a_deadly_sample_is_found_in_its_chunk(tmp_path, monkeypatch):
    made = load_study(study_file(tmp_path, sobol()))
    expected = here(made, tmp_path / "whole.csv")
    monkeypatch.setattr("graspless_pin.studies.run.LocalProcesses", Fragile)
    table = run_study(made, tmp_path / "out.csv", workers=2, progress=False)
    assert_only_failure(table, expected, 7)


def assert_only_failure(table, expected, number):
    assert table["status"].tolist().count("failed") == 1
    assert table["error"][number] == "the worker process died"
    others = [other for other in range(len(table)) if other != number]
    pd.testing.assert_frame_equal(
        table.loc[others].drop(columns="error"), expected.loc[others].drop(columns="error")
    )


@pytest.fixture(scope="module")
def cluster():
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1",
        dashboard_address=NO_DASHBOARD, silence_logs=50,
    ) as running:  # fmt: skip
        yield running


def test_dask_gives_the_same_table(tmp_path, cluster):
    made = load_study(study_file(tmp_path, sobol()))
    here(made, tmp_path / "one.parquet")
    with dask_executor(cluster.scheduler_address) as (executor, threads):
        assert threads == 2
        where = {executor.submit(os.getpid).result() for _ in range(8)}
        assert os.getpid() not in where
        run_study(
            made, tmp_path / "dask.parquet", executor=executor, workers=threads, progress=False
        )
    one, more = ((tmp_path / f"{name}.parquet").read_bytes() for name in ("one", "dask"))
    assert one == more


def test_no_scheduler_is_told_so():
    with (
        pytest.raises(StudyError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:1'"),
        dask_executor("tcp://127.0.0.1:1", timeout=0.3),
    ):
        pass
