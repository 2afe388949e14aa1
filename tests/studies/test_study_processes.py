"""Studies in other processes: any number of workers, killed runs, dying workers, Dask."""

import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, wait
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from distributed import Client, LocalCluster
from faulty_evaluations import hangs_at_seven, misbehaves, tells_threads
from study_tools import FRICTION, SLOPE, Here, data, study, study_file

from graspless_pin.errors import StudyError
from graspless_pin.studies import (
    load_study,
    read_results,
    results_summary,
    run_study,
)
from graspless_pin.studies.executors import dask_executor

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


def test_the_number_of_processes_does_not_matter(tmp_path):
    made = load_study(study_file(tmp_path, sobol()))
    here(made, tmp_path / "one.parquet")
    table = run_study(made, tmp_path / "more.parquet", workers=2, progress=False)
    assert len(table) == SAMPLES
    one, more = ((tmp_path / f"{name}.parquet").read_bytes() for name in ("one", "more"))
    assert one == more


def test_processes_have_one_thread_of_linear_algebra(tmp_path, monkeypatch):
    """The parent keeps as many as it had. What starts slowly and is not needed, they leave."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.setattr("graspless_pin.studies.executors.evaluate_each", tells_threads)
    table = run_study(
        study({"friction": FRICTION}), tmp_path / "out.csv", workers=1, progress=False
    )
    assert set(table["error"]) == {"1 1 []"} and os.environ["OPENBLAS_NUM_THREADS"] == "7"


@pytest.fixture(scope="module")
def slow_table(tmp_path_factory):
    """The file of the slow study's table."""
    folder = tmp_path_factory.mktemp("slow")
    here(load_study(study_file(folder, sobol(compute=SLOW))), folder / "whole.parquet")
    return (folder / "whole.parquet").read_bytes()


def test_a_study_killed_twice_gives_the_same_table(tmp_path, slow_table):
    file = study_file(tmp_path, sobol(compute=SLOW))
    output, journal = tmp_path / "out.parquet", tmp_path / "out.parquet.journal"
    rng = random.Random(1)  # noqa: S311 - when to kill is no secret
    rows = 0
    for workers in (2, 0):
        child = started(tmp_path, file, output, workers)
        until = rows + rng.randint(1, SAMPLES // 8)
        while rows_in(journal) < until:
            assert child.poll() is None, "the study ended before it was killed"
            time.sleep(0.002)
        tasks = Path(f"/proc/{child.pid}/task").glob("*/children")
        children = [pid for task in tasks for pid in task.read_text().split()]
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
    assert output.read_bytes() == slow_table
    assert len(read_results(output)) == SAMPLES and rows < SAMPLES


def assert_end(processes):
    deadline = time.monotonic() + 300.0
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


TOLD = {
    3: ("crashed", "the process was ended by SIGSEGV, and so was a second one"),
    7: ("out_of_time", "took longer than 3 s (sample_time_limit)"),
}


def assert_bad_samples_are_rows(tmp_path, monkeypatch, **options):
    """They have outcomes of their own; all others are as they always are."""
    content = sobol(compute={"sample_time_limit": 3}, description=str(tmp_path / "died"))
    made = load_study(study_file(tmp_path, content))
    expected = here(made, tmp_path / "whole.csv")
    monkeypatch.setattr("graspless_pin.studies.executors.evaluate_each", misbehaves)
    table: Any = run_study(made, tmp_path / "out.csv", progress=False, **options)
    bad = list(TOLD)
    assert list(zip(table["status"][bad], table["error"][bad], strict=True)) == [*TOLD.values()]
    assert not table["found"][bad].any() and table["margin_N"][bad].isna().all()
    pd.testing.assert_frame_equal(
        table.drop(index=bad).drop(columns="error"), expected.drop(index=bad).drop(columns="error")
    )
    assert (tmp_path / "died").exists()
    told = "24 samples: 22 found, 0 infeasible, 0 failed, 1 crashed, 1 out of time\n"
    assert results_summary(table).startswith(told)
    assert "first failure at sample 3: the process was ended by SIGSEGV" in results_summary(table)
    pd.testing.assert_frame_equal(read_results(tmp_path / "out.csv"), table)


def test_samples_that_crash_or_hang_are_rows(tmp_path, monkeypatch):
    assert_bad_samples_are_rows(tmp_path, monkeypatch, workers=2)


def test_samples_that_crash_or_hang_on_dask_are_rows(tmp_path, monkeypatch, cluster):
    with dask_executor(cluster.scheduler_address) as (executor, _):
        before = processes_of(cluster)
        assert_bad_samples_are_rows(tmp_path, monkeypatch, executor=executor, workers=2)
        assert len(before) == 2
        assert processes_of(cluster) == before, "workers of Dask died"


def processes_of(cluster) -> Any:
    """Return the process of each worker: a task may go to the same one every time."""
    with Client(cluster) as client:
        return client.run(os.getpid)


def test_an_interrupt_does_not_wait_for_a_sample_that_hangs(tmp_path, monkeypatch):
    """And keeps the rows before it, those of its chunk too."""
    hanging = tmp_path / "hanging"
    made = load_study(study_file(tmp_path, sobol(description=str(hanging))))
    monkeypatch.setattr("graspless_pin.studies.executors.evaluate_each", hangs_at_seven)

    def wait_for_the_hang(running, **options):
        while True:
            done, rest = wait(running, timeout=0.1, **options)
            if done:
                return done, rest
            if hanging.exists():
                raise KeyboardInterrupt

    monkeypatch.setattr("graspless_pin.studies.executors.wait", wait_for_the_hang)
    monkeypatch.setattr("graspless_pin.studies.executors._CHUNK_SECONDS", 1e3)
    with pytest.raises(KeyboardInterrupt):
        run_study(made, tmp_path / "out.csv", workers=1, progress=False)
    # Rows that come fast are sent together, never more than were there before.
    assert 3 <= rows_in(tmp_path / "out.csv.journal") <= 7
    monkeypatch.undo()
    again = here(made, tmp_path / "out.csv")
    pd.testing.assert_frame_equal(again, here(made, tmp_path / "whole.csv"))


def test_processes_that_do_not_start_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr("graspless_pin.child_process._PROGRAM", "raise SystemExit(7)")
    with pytest.raises(StudyError, match=r"worker processes do not start \(.* exit code 7\)"):
        run_study(study({"friction": FRICTION}), tmp_path / "out.csv", workers=2, progress=False)
    assert not (tmp_path / "out.csv").exists()


@pytest.fixture(scope="module")
def cluster():
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", silence_logs=50,
        dashboard_address=NO_DASHBOARD, scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
    ) as running:  # fmt: skip
        yield running


def test_dask_gives_the_same_table_where_workers_are_lost(tmp_path, cluster, slow_table):
    """Each is killed once while it has samples; its nanny starts another one."""
    made = load_study(study_file(tmp_path, sobol(compute=SLOW)))
    before = processes_of(cluster)
    with (
        dask_executor(cluster.scheduler_address) as (executor, threads),
        Client(cluster) as client,
    ):
        assert threads == 2
        assert os.getpid() not in {executor.submit(os.getpid).result() for _ in range(8)}
        losing = Losing(executor, {3: 0, 8: 1}, [*before.values()])
        run_study(made, tmp_path / "dask.parquet", executor=losing, workers=threads, progress=False)
        client.wait_for_workers(2, timeout=300)
    assert losing.alone == [False, False] and losing.submitted > 8
    assert not {*before.values()} & {*processes_of(cluster).values()}
    assert (tmp_path / "dask.parquet").read_bytes() == slow_table


class Losing(Executor):
    """Gives work to an executor, some of whose processes it kills on the way."""

    def __init__(self, executor, losses, processes):
        self.executor, self.losses, self.processes = executor, losses, processes
        self.submitted, self.alone = 0, []

    def submit(self, fn, /, *args, **kwargs):
        future = self.executor.submit(fn, *args, **kwargs)
        self.submitted += 1
        if self.submitted in self.losses:
            self.alone.append(future.done())
            os.kill(self.processes[self.losses[self.submitted]], signal.SIGKILL)
        return future


def test_no_scheduler_is_told_so():
    with (
        pytest.raises(StudyError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:1'"),
        dask_executor("tcp://127.0.0.1:1", timeout=0.3),
    ):
        pass
