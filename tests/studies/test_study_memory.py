"""Memory does not grow with the samples, beyond some bytes each; counted, not measured."""

import tracemalloc
from concurrent.futures import Executor, Future
from typing import Any

import numpy as np
import pandas as pd
import pytest
from study_tools import study

from graspless_pin.studies import (
    compute_study,
    read_results,
    results,
    results_parts,
    results_summary,
)
from graspless_pin.studies.journal import JOURNAL_FORMAT, Journal

PART = 128
FEW, MANY = 4 * PART, 16 * PART
BYTES = 40
"""Of each sample: where its line stands in the journal takes eight, in an array that grows."""
GRID = {
    "friction.default": {"from": 0.2, "to": 0.6, "steps": 16},
    "object.mass": {"from": 0.5, "to": 3.0, "steps": 32},
}


class Made(Executor):
    """Makes rows up, of as many figures as those of a small hand; may keep them, as none should."""

    def __init__(self, *, keeps=False):
        self.kept = [] if keeps else None

    def submit(self, fn, /, *args, **kwargs):
        future: Future = Future()
        samples = args[-1]
        rows = [row_of(number) for number, _ in samples]
        if self.kept is not None:
            self.kept += rows
        future.set_result((rows, 1e-4 * len(samples)))
        return future


def row_of(number):
    row = {"sample": number, "status": "optimal", "found": True, "margin_N": 0.1 * number}
    row |= {f"torque_{k}_Nm": number / (k + 1) for k in range(8)}
    return row | {"contacts": 8, "nodes": 1}


def made(count):
    steps = {**GRID["object.mass"], "steps": count // 16}
    return study({**GRID, "object.mass": steps})


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    monkeypatch.setattr("graspless_pin.studies.results.PART_ROWS", PART)
    monkeypatch.setattr("graspless_pin.studies.run.check_study", lambda _: None)
    monkeypatch.setattr("graspless_pin.studies.executors._LARGEST_CHUNK", 32)


def most_bytes(call):
    """Return the most memory that Python and numpy have at a time while something runs."""
    call()  # modules that are loaded and values that are kept are there now
    tracemalloc.start()
    call()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["out.parquet", "out.csv"])
def test_memory_grows_by_bytes_a_sample(tmp_path, name):
    """Four times the samples; where somebody keeps their rows, this sees it."""

    def most(count, *, keeps=False):
        sampled, file = made(count), tmp_path / f"{count}_{name}"
        options = {"workers": 2, "progress": False, "fresh": True}

        def run():
            compute_study(sampled, file, executor=Made(keeps=keeps), **options)
            assert results_summary(file).startswith(f"{count} samples: {count} found")

        return most_bytes(run)

    few, many, kept = most(FEW), most(MANY), most(MANY, keeps=True)
    assert many - few < BYTES * (MANY - FEW)
    assert kept - few > 20 * BYTES * (MANY - FEW)


def test_a_run_that_goes_on_reads_no_rows(tmp_path):
    sizes = []
    for count in (FEW, MANY):
        file = tmp_path / f"{count}.journal"
        identity = {"format": JOURNAL_FORMAT, "fingerprint": "x", "versions": {}}
        journal = Journal(file, identity)
        journal.append(map(row_of, range(count)))
        journal.close()

        def opened(file=file, identity=identity):
            again = Journal(file, identity)
            again.close()
            return again

        assert opened().count == count
        sizes.append(most_bytes(opened))
    assert sizes[1] - sizes[0] < BYTES * (MANY - FEW)


def test_rows_in_any_order_make_the_same_table(tmp_path, monkeypatch):
    """In parts or in one: cells, types and metadata are the same; so are the bytes of CSV."""
    count = 4 * PART
    sampled, rng = made(count), np.random.default_rng(0)

    def table(name, order, rows):
        monkeypatch.setattr("graspless_pin.studies.results.PART_ROWS", rows)
        identity = {"format": JOURNAL_FORMAT, "fingerprint": name, "versions": {}}
        journal = Journal(tmp_path / f"{name}.journal", identity)
        journal.append([row_of(number) for number in order])
        results.write_results(sampled, journal, tmp_path / name)
        journal.close()
        return tmp_path / name

    for kind in ("csv", "parquet"):
        plain = table(f"a.{kind}", range(count), PART)
        mixed = table(f"b.{kind}", rng.permutation(count).tolist(), PART)
        whole = table(f"c.{kind}", range(count), count)
        monkeypatch.setattr("graspless_pin.studies.results.PART_ROWS", PART)  # of reading
        assert mixed.read_bytes() == plain.read_bytes()
        expected: Any = read_results(whole)
        pd.testing.assert_frame_equal(read_results(plain), expected)
        assert expected["margin_N"].tolist() == [0.1 * number for number in range(count)]
        parts = [*results_parts(plain, ["sample", "margin_N"])]
        assert [len(part) for part in parts] == [PART] * 4
        pd.testing.assert_frame_equal(
            pd.concat(parts, ignore_index=True), expected[["sample", "margin_N"]]
        )
        assert results_summary(plain) == results_summary(expected)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()
