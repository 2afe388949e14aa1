"""Studies in other processes: any number of workers, killed runs, dying workers, Dask."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, wait
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from faulty_evaluations import crashes_at_the_end, hangs_at_seven, misbehaves
from study_tools import FRICTION, SLOPE, Here, data, study, study_file
from tests.core.child_calls import is_running

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
from graspless_pin.studies import load_study, run_study
file, output, workers = *sys.argv[1:3], int(sys.argv[3])
run_study(load_study(file), output, workers=workers, progress=False)
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


def test_a_killed_study_goes_on_and_gives_the_table_of_one_process(tmp_path):
    """Killed with one worker process, it goes on with two."""
    file = study_file(tmp_path, sobol(compute=SLOW))
    output, journal = tmp_path / "out.parquet", tmp_path / "out.parquet.journal"
    killed = started(tmp_path, file, output, workers=1)
    while rows_in(journal) < 3:
        assert killed.poll() is None, "the study ended before it was killed"
        time.sleep(0.002)
    tasks = Path(f"/proc/{killed.pid}/task").glob("*/children")
    children = [pid for task in tasks for pid in task.read_text().split()]
    assert len(children) == 1
    killed.kill()
    # What its workers print as they start would be read here, too; on standard error Python
    # tells that a killed process leaves semaphores.
    assert killed.communicate()[0] == "once\n"
    deadline = time.monotonic() + 300.0
    while any(map(is_running, children)):
        assert time.monotonic() < deadline, "workers outlive their parent"
        time.sleep(0.02)
    assert not output.exists() and 3 <= rows_in(journal) < SAMPLES
    last = started(tmp_path, file, output, workers=2)
    assert (*last.communicate(), last.returncode) == ("once\n", "", 0)
    here(load_study(file), tmp_path / "whole.parquet")
    assert output.read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    assert len(read_results(output)) == SAMPLES


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


CRASHED = ("crashed", "the process was ended by SIGSEGV, and a second process ended, too")
OUT_OF_TIME = ("out_of_time", "took longer than 3 s (sample_time_limit)")


def assert_bad_samples_are_rows(tmp_path, monkeypatch, evaluation, expected, **options):
    """They have outcomes of their own; all others are as they always are."""
    content = sobol(compute={"sample_time_limit": 3}, description=str(tmp_path / "died"))
    made = load_study(study_file(tmp_path, content))
    good = here(made, tmp_path / "whole.csv")
    monkeypatch.setattr("graspless_pin.studies.executors.evaluate_each", evaluation)
    table: Any = run_study(made, tmp_path / "out.csv", progress=False, **options)
    bad = list(expected)
    assert list(zip(table["status"][bad], table["error"][bad], strict=True)) == [*expected.values()]
    assert not table["found"][bad].any() and table["margin_N"][bad].isna().all()
    pd.testing.assert_frame_equal(
        table.drop(index=bad).drop(columns="error"), good.drop(index=bad).drop(columns="error"),
        check_exact=True,
    )  # fmt: skip
    pd.testing.assert_frame_equal(read_results(tmp_path / "out.csv"), table)
    return table


def test_samples_that_crash_or_hang_are_rows(tmp_path, monkeypatch):
    table = assert_bad_samples_are_rows(
        tmp_path, monkeypatch, misbehaves, {3: CRASHED, 23: OUT_OF_TIME}, workers=1
    )
    assert (tmp_path / "died").exists()
    told = "24 samples: 22 found, 0 infeasible, 0 failed, 1 crashed, 1 out of time\n"
    assert results_summary(table).startswith(told)
    assert "first failure at sample 3: the process was ended by SIGSEGV" in results_summary(table)


def test_an_interrupt_does_not_wait_for_a_sample_that_hangs(tmp_path, monkeypatch):
    """And keeps the rows before it, those of its chunk too.

    A worker process has one thread of linear algebra, the parent as many as it had. What starts
    slowly and is not needed, a worker leaves.
    """
    hanging = tmp_path / "hanging"
    made = load_study(study_file(tmp_path, sobol(description=str(hanging))))
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
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
    assert hanging.read_text(encoding="utf-8") == "1 1 []"
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"
    # Rows that come fast are sent together, never more than were there before.
    assert 3 <= rows_in(tmp_path / "out.csv.journal") <= 7
    monkeypatch.undo()
    again = here(made, tmp_path / "out.csv")
    pd.testing.assert_frame_equal(again, here(made, tmp_path / "whole.csv"))


def test_processes_that_do_not_start_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr("graspless_pin.child_process._PROGRAM", "raise SystemExit(7)")
    with pytest.raises(StudyError, match=r"worker processes cannot start \(.* exit code 7\)"):
        run_study(study({"friction": FRICTION}), tmp_path / "out.csv", workers=2, progress=False)
    assert not (tmp_path / "out.csv").exists()


@pytest.fixture
def cluster():
    """Two workers. Their processes are forked from one that has loaded what they need."""
    import dask.config  # all test processes load this module, and one of them runs this
    from distributed import LocalCluster
    from distributed.utils import get_mp_context

    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        get_mp_context().set_forkserver_preload(["distributed", "graspless_pin.studies"])
        with LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", silence_logs=50,
            dashboard_address=NO_DASHBOARD, scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
        ) as running:  # fmt: skip
            yield running


def processes_of(client) -> dict[str, int]:
    """The process of each worker: a task may go to the same one every time."""
    return client.run(os.getpid)


def test_dask_gives_the_same_table_where_a_worker_is_lost_and_a_sample_crashes(
    tmp_path, monkeypatch, cluster
):
    """A worker is killed while it has samples; its nanny starts another one. No sample ends one."""
    from distributed import Client

    with (
        dask_executor(cluster.scheduler_address) as (executor, threads),
        Client(cluster) as client,
    ):
        before = processes_of(client)
        assert threads == len(before) == 2 and os.getpid() not in before.values()
        losing = Losing(executor, client, before)
        assert_bad_samples_are_rows(
            tmp_path, monkeypatch, crashes_at_the_end, {23: CRASHED}, executor=losing, workers=2
        )
        client.wait_for_workers(2, timeout=300)
        kept = {*processes_of(client).values()} & {*before.values()}
        assert losing.lost is not None and kept == {*before.values()} - {losing.lost}


class Losing(Executor):
    """Gives work to an executor of Dask, and kills one of its processes that is computing."""

    def __init__(self, executor, client, processes):
        self.executor, self.client, self.processes = executor, client, processes
        self.submitted, self.lost = 0, None

    def submit(self, fn, /, *args, **kwargs):
        future = self.executor.submit(fn, *args, **kwargs)
        self.submitted += 1
        busy = [worker for worker, tasks in self.client.processing().items() if tasks]
        if self.lost is None and self.submitted >= 8 and busy:
            self.lost = self.processes[busy[0]]
            os.kill(self.lost, signal.SIGKILL)
        return future


def test_no_scheduler_is_told_so():
    with (
        pytest.raises(StudyError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:1'"),
        dask_executor("tcp://127.0.0.1:1", timeout=0.3),
    ):
        pass
