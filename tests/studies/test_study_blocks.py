"""Samples that begin with what was learned of others: of those before them in a fixed block."""

from dataclasses import replace

import numpy as np
import pytest
from study_tools import HEIGHT, PAPER, Here, data, study

from graspless_pin import compiled
from graspless_pin.studies import Study, run_study, sample_evaluation
from graspless_pin.studies.journal import JOURNAL_FORMAT, Journal
from graspless_pin.studies.sample_evaluation import evaluate_each
from graspless_pin.studies.supervision import _rest
from graspless_pin.versions import versions

BLOCK = 8
VARY = {
    "friction.default": {"from": 0.1, "to": 0.7},
    "object.mass": {"from": 0.5, "to": 3.0},
    "hand.effort_limits.finger_1/hinge": {"from": 3.0, "to": 8.0},
}


def blocked(count=20, block=BLOCK, **more):
    sampling = {"method": "sobol", "samples": count, "seed": 5}
    return replace(study(VARY, sampling=sampling, **more), block=block)


def test_margins_are_those_of_samples_alone(tmp_path):
    tables = [
        run_study(made, tmp_path / f"{k}.csv", executor=Here(), workers=1, progress=False)
        for k, made in enumerate((blocked(), blocked(block=1)))
    ]
    learned, alone = tables
    assert learned["status"].tolist() == alone["status"].tolist()
    np.testing.assert_allclose(learned["margin_N"], alone["margin_N"], atol=1e-9)
    np.testing.assert_allclose(learned["max_torque_Nm"], alone["max_torque_Nm"], atol=1e-8)
    assert learned["margin_N"].tolist() != alone["margin_N"].tolist()


def test_a_run_that_stops_inside_a_block_gives_the_same_table(tmp_path, monkeypatch):
    """What a sample learns from is computed again, its rows are not."""
    made, whole, parts = blocked(), tmp_path / "whole.parquet", tmp_path / "parts.parquet"
    run_study(made, whole, workers=2, progress=False)
    rows = [*evaluate_each(made, [*enumerate(made.samples)])]
    identity = {"format": JOURNAL_FORMAT, "fingerprint": made.fingerprint, "versions": versions()}
    journal = Journal(parts.with_name(f"{parts.name}.journal"), identity)
    journal.append(rows[:3] + rows[11:13])
    journal.close()
    executor = Here()
    run_study(made, parts, executor=executor, workers=1, progress=False)
    assert executor.samples == [*range(20)]  # those of three blocks from their beginnings
    assert parts.read_bytes() == whole.read_bytes()


EVERYTHING = {
    **VARY,
    "object.mass": {"values": [1.0, -1.0, 2.0]},
    "gravity.2": {"from": -12.0, "to": -8.0},
    "max_normal_force": {"from": 20.0, "to": 60.0},
    "height": {"values": [150.0, 149.0, 500.0], "unit": "mm", "move": HEIGHT["move"]},
    "solve.algorithm": {"values": ["margin", "torque"]},
    "supports.slope.friction": {"values": [0.0, 0.3]},
}


@pytest.mark.parametrize("vary", [VARY, EVERYTHING], ids=["loads", "everything"])
@pytest.mark.parametrize("method", ["sobol", "grid"])
def test_a_row_depends_on_those_before_it_in_its_block_alone(vary, method):
    """Bit for bit: not on those after it, nor on whether rows come one by one."""
    made = replace(study(vary, sampling={"method": "sobol", "samples": 32, "seed": 5}), block=16)
    samples = [*enumerate(made.samples)]
    if method == "grid":  # neighbours that have most values in common
        samples = [*enumerate(sorted((one for _, one in samples), key=lambda one: one[3:]))]
    whole = [*evaluate_each(made, samples)]
    assert [row["sample"] for row in whole] == [*range(32)]
    assert {"optimal", "failed"} <= {row["status"] for row in whole} or vary is VARY
    assert [*evaluate_each(made, samples, one_by_one=True)] == whole
    for count in (1, 5, 17, 30):
        assert [*evaluate_each(made, samples[:count])] == whole[:count]
    assert [*evaluate_each(made, samples[16:])] == whole[16:]


@pytest.mark.skipif(compiled.loaded_states is None, reason="nothing was compiled")
@pytest.mark.parametrize("slides", [False, True], ids=["at rest", "sliding"])
def test_samples_whose_contacts_stay_are_found_in_one_loop(slides, monkeypatch):
    """Friction, mass, gravity, limits: told by what stays the same, whatever varies."""
    alone = []
    row = sample_evaluation._row
    monkeypatch.setattr(
        sample_evaluation, "_row", lambda *told: (alone.append(told[1]), row(*told))[1]
    )
    vary = {**VARY, **{key: EVERYTHING[key] for key in ("gravity.2", "max_normal_force")}}
    more = {"scene": str(PAPER / "cuboid_sliding_up.yaml")} if slides else {}
    sampling = {"method": "sobol", "samples": 64, "seed": 5}
    made = replace(Study.from_data({**data(vary, sampling=sampling), **more}), block=32)
    rows = [*evaluate_each(made, [*enumerate(made.samples)])]
    assert 0 < sum(row["found"] for row in rows) < len(rows) == 64
    # A search is left what has no torques, and where the friction of the first node has no motion.
    assert {row["sample"] for row in rows if not row["found"] or row["nodes"] > 1} == {*alone}


def test_blocks_depend_on_the_study_alone():
    assert Study.from_data(data()).block == 1
    sampling = {"method": "sobol", "samples": 2**16}
    assert Study.from_data(data(VARY, sampling=sampling)).block == 64
    for limits in ({"time_limit": 9.0}, {"sample_time_limit": 9.0}):
        assert Study.from_data(data(VARY, sampling=sampling, compute=limits)).block == 1


def test_a_process_after_a_crash_learns_again_what_was_learned():
    made = blocked(count=20)
    samples = [*enumerate(made.samples)][BLOCK:]
    rows = {n: {"sample": n, "status": "optimal"} for n in range(BLOCK, 2 * BLOCK + 3)}
    assert [n for n, _ in _rest(made, samples, rows)] == [*range(2 * BLOCK, 20)]
    rows[2 * BLOCK + 1]["status"] = "crashed"
    assert [n for n, _ in _rest(made, samples, rows)] == [16, 18, 19]
