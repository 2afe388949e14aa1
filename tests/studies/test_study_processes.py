"""Studies in other processes: any number of workers, killed runs, dying workers, Dask."""

import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Future
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from distributed import LocalCluster
from study_tools import FRICTION, SLOPE, Here, data, study, study_file

from graspless_pin.errors import StudyError
from graspless_pin.studies import evaluation, load_study, read_results, run_study
from graspless_pin.studies.executors import LocalProcesses, dask_executor

SAMPLES = 32
NO_DASHBOARD: Any = None
SLOW = {"minimum_friction": True}  # tens of milliseconds a sample, so that a kill meets a run
RUN = """
import sys
from graspless_pin.studies import load_study, run_study
run_study(load_study(sys.argv[1]), sys.argv[2], workers=int(sys.argv[3]), progress=False)
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


def test_the_number_of_processes_does_not_matter(tmp_path):
    made = load_study(study_file(tmp_path, sobol()))
    here(made, tmp_path / "one.parquet")
    table = run_study(made, tmp_path / "more.parquet", workers=2, progress=False)
    assert len(table) == SAMPLES
    one, more = ((tmp_path / f"{name}.parquet").read_bytes() for name in ("one", "more"))
    assert one == more


def test_a_study_killed_three_times_gives_the_same_table(tmp_path):
    file = study_file(tmp_path, sobol(compute=SLOW))
    output, journal = tmp_path / "out.parquet", tmp_path / "out.parquet.journal"
    rng = random.Random(1)  # noqa: S311 - when to kill is no secret
    rows = 0
    for workers in (2, 1, 1):
        child = started(file, output, workers)
        until = rows + rng.randint(1, SAMPLES // 8)
        while rows_in(journal) < until:
            assert child.poll() is None, "the study ended before it was killed"
            time.sleep(0.002)
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        assert not output.exists()
        rows = rows_in(journal)
    assert started(file, output, 1).wait() == 0
    here(load_study(file), tmp_path / "whole.parquet")
    assert output.read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    assert len(read_results(output)) == SAMPLES and rows < SAMPLES


def test_workers_end_with_a_killed_parent(tmp_path):
    file = study_file(tmp_path, sobol(compute=SLOW))
    child = started(file, tmp_path / "out.parquet", 1)
    while not rows_in(tmp_path / "out.parquet.journal"):
        assert child.poll() is None
        time.sleep(0.002)
    children = Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split()
    assert children
    child.kill()
    child.wait()
    deadline = time.monotonic() + 20.0
    while any(map(is_running, children)):
        assert time.monotonic() < deadline, "workers outlive their parent"
        time.sleep(0.02)


def started(file, output, workers):
    """A run of a study in a process group of its own."""
    return subprocess.Popen(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", RUN, str(file), str(output), str(workers)], start_new_session=True
    )


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
    table = run_study(made, tmp_path / "out.csv", workers=2, progress=False)
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


def test_workers_have_one_thread_of_linear_algebra(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    force = LocalProcesses(1)
    try:
        assert force.submit(os.getenv, "OPENBLAS_NUM_THREADS").result() == "1"
        assert force.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
    finally:
        force.close()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"


def test_a_script_is_not_run_again_by_its_workers(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(f"print('once')\n{RUN}", encoding="utf-8")
    file = study_file(tmp_path, data({"friction": FRICTION}))
    done = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, str(script), str(file), str(tmp_path / "out.csv"), "1"],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "once\n", "")
    assert len(read_results(tmp_path / "out.csv")) == 3


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
