"""Samples that begin with what was learned of others: of those before them in a fixed block."""

import re
from dataclasses import fields, replace

import numpy as np
import pytest
from study_tools import HEIGHT, PAPER, Here, data, study

from graspless_pin import compiled, load_scene
from graspless_pin.algorithms.batch_optimum import LoadSweep
from graspless_pin.errors import SceneError
from graspless_pin.scene import problem_data
from graspless_pin.scene.problem_data import jointed_contacts
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.scene_findings import ALL_CHECKS
from graspless_pin.studies import Study, run_study, sample_evaluation
from graspless_pin.studies.executors import _samples_to_send
from graspless_pin.studies.journal import JOURNAL_FORMAT, Journal
from graspless_pin.studies.run import check_study
from graspless_pin.studies.sample_evaluation import evaluate_each, stated_sample
from graspless_pin.studies.study import SampleParts
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
    run_study(made, whole, executor=Here(), workers=1, progress=False)
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


@pytest.mark.sampled(2)
@pytest.mark.parametrize("vary", [VARY, EVERYTHING], ids=["loads", "everything"])
@pytest.mark.parametrize("method", ["sobol", "grid"])
def test_a_row_depends_on_those_before_it_in_its_block_alone(vary, method):
    """Bit for bit: not on those after it, nor on whether rows come one by one."""
    made = replace(study(vary, sampling={"method": "sobol", "samples": 16, "seed": 5}), block=8)
    samples = [*enumerate(made.samples)]
    if method == "grid":  # neighbours that have most values in common
        samples = [*enumerate(sorted((one for _, one in samples), key=lambda one: one[3:]))]
    whole = [*evaluate_each(made, samples)]
    assert [row["sample"] for row in whole] == [*range(16)]
    assert {"optimal", "failed"} <= {row["status"] for row in whole} or vary is VARY
    assert [*evaluate_each(made, samples, one_by_one=True)] == whole
    for count in (1, 5, 9):
        assert [*evaluate_each(made, samples[:count])] == whole[:count]
    assert [*evaluate_each(made, samples[8:])] == whole[8:]


@pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")
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


@pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")
@pytest.mark.parametrize("one_by_one", [False, True])
def test_an_internal_error_in_a_loop_costs_one_sample_and_is_told(monkeypatch, one_by_one):
    made = blocked(count=16, block=16)
    samples = [*enumerate(made.samples)]
    whole = [*evaluate_each(made, samples)]
    bad = stated_sample(made.scene_at(samples[5][1]), ALL_CHECKS, None).loads
    advance = LoadSweep.advance

    def broken(self, problem, loads, begin, figures, torques):
        end = advance(self, problem, loads, begin, figures, torques)
        if (loads[begin : end + 1] == bad).all(axis=1).any():
            raise FloatingPointError("ours")
        return end

    monkeypatch.setattr(LoadSweep, "advance", broken)
    rows = [*evaluate_each(made, samples, one_by_one=one_by_one)]
    assert [row["sample"] for row in rows] == [*range(16)]
    assert rows[5]["status"] == "failed" and not rows[5]["found"]
    assert re.fullmatch(
        r"internal error in sample_evaluation\.py, line \d+: FloatingPointError: ours",
        rows[5]["error"],
    )
    for row, good in zip(rows, whole, strict=True):
        if row["sample"] != 5:
            assert row["status"] == good["status"]
            assert row["margin_N"] == pytest.approx(good["margin_N"], abs=1e-9)


def test_an_internal_error_in_a_search_costs_one_sample_and_is_told(monkeypatch):
    made, solve = blocked(count=8, block=1), sample_evaluation._solution

    def broken(scene, starts):
        if scene.object.mass > 2.5:
            raise IndexError("ours")
        return solve(scene, starts)

    monkeypatch.setattr(sample_evaluation, "_solution", broken)
    rows = [*evaluate_each(made, [*enumerate(made.samples)])]
    lost = [row for row in rows if "error" in row]
    assert len(rows) == 8 and 0 < len(lost) < 8
    for row in lost:
        assert (row["status"], row["found"]) == ("failed", False)
        assert row["error"].startswith("internal error in sample_evaluation.py, line ")
        assert row["error"].endswith(": IndexError: ours")
    # In the first look it ends no study.
    monkeypatch.setattr(Scene, "problem", lambda *_: 1 / 0)
    check_study(blocked(count=8))


def test_blocks_depend_on_the_study_alone():
    assert Study.from_data(data()).block == 1
    sampling = {"method": "sobol", "samples": 2**16}
    assert Study.from_data(data(VARY, sampling=sampling)).block == 64
    for limits in ({"time_limit": 9.0}, {"sample_time_limit": 9.0}):
        assert Study.from_data(data(VARY, sampling=sampling, compute=limits)).block == 1
    quick = {"algorithm": "margin", "time_limit": 0.1}
    by_section = VARY | {"solve": {"values": {"quick": quick, "whole": {"algorithm": "margin"}}}}
    assert Study.from_data(data(by_section, sampling=sampling)).block == 1


def test_a_process_after_a_crash_learns_again_what_was_learned():
    made = blocked(count=20)
    samples = [*enumerate(made.samples)][BLOCK:]
    rows = {n: {"sample": n, "status": "optimal"} for n in range(BLOCK, 2 * BLOCK + 3)}
    assert [n for n, _ in _samples_to_send(made, samples, rows)] == [*range(2 * BLOCK, 20)]
    rows[2 * BLOCK + 1]["status"] = "crashed"
    assert [n for n, _ in _samples_to_send(made, samples, rows)] == [16, 18, 19]


@pytest.mark.parametrize("method", ["sobol", "grid"])
def test_what_a_sample_takes_from_the_one_before_is_what_it_would_make(method):
    """Bit for bit, whatever varies beside friction, gravity and the largest normal force."""
    vary = {**EVERYTHING, "object.mass": {"values": [1.0, 2.0]}}
    vary["height"] = {**EVERYTHING["height"], "values": [150.0, 149.0]}
    vary |= {"cone_edges": {"values": [8, 16]}, "hand.count_own_weight": {"values": [True, False]}}
    made = study(vary, sampling={"method": "sobol", "samples": 64, "seed": 3})
    samples = [*made.samples]
    if method == "grid":
        samples = sorted(samples, key=lambda one: [repr(value) for value in one[::-1]])
    parts, before, taken = SampleParts(), None, 0
    for sample in samples:
        stated = stated_sample(made.scene_at(sample, parts), ALL_CHECKS, before)
        fresh = stated_sample(made.scene_at(sample), ALL_CHECKS, None)
        np.testing.assert_array_equal(stated.loads, fresh.loads, strict=True)
        assert stated.kind[1:] == fresh.kind[1:]
        for name in ("positions", "tangents"):
            ours, theirs = getattr(stated.kind.state, name), getattr(fresh.kind.state, name)
            np.testing.assert_array_equal(ours, theirs, strict=True)
        taken += before is not None and stated.kind.state is before.kind.state
        before = stated
    assert taken if method == "grid" else taken < len(samples)


def test_what_is_refused_is_so_for_values_that_were_seen():
    """A scene that is too heavy for its contacts, after one that is not."""
    vary = {
        "friction.default": {"values": [0.2, 0.3]},
        "max_normal_force": {"values": [1e-9, 20.0]},
        "gravity.2": {"values": [-1e4]},
    }
    made, parts = study(vary), SampleParts()
    for _ in range(2):
        for sample in made.samples:
            if sample[1] < 1.0:
                with pytest.raises(SceneError, match="the object weighs"):
                    made.scene_at(sample, parts)
            else:
                assert made.scene_at(sample, parts).friction == {"default": sample[0]}


@pytest.mark.sampled(6)
@pytest.mark.parametrize("file", sorted(PAPER.parent.rglob("*.yaml")), ids=lambda file: file.stem)
def test_contacts_and_joints_read_nothing_of_what_only_bears_on_them(file):
    """Every field that they are made of is read here: of those that are not, rows are renewed."""
    if file.parent.name in ("studies", "robots"):
        pytest.skip("no scene")
    read = set()

    class Watched(Scene):
        def __getattribute__(self, name):
            read.add(name)
            return super().__getattribute__(name)

    scene = load_scene(file)
    watched = object.__new__(Watched)
    vars(watched).update({field.name: getattr(scene, field.name) for field in fields(scene)})
    read.clear()
    jointed_contacts(watched)
    assert {"object", "supports", "hand"} <= read
    assert not read & problem_data._BEARING
