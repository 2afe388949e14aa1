"""Studies that place the hand of each sample, or close its fingers."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from study_tools import ROOT, Here, run, study_file

from graspless_pin import close_fingers, load_scene, place_hand
from graspless_pin.errors import SceneError, StudyError
from graspless_pin.studies import Study, load_study, results_summary, run_study
from graspless_pin.studies.sample_evaluation import evaluate_each

FAR = {
    "friction": {"hand": 0.8, "supports": 0.4},
    "hand": {"robot": "panda_hand", "base_pose": {"position": [0, 0, 1]}},
    "object": {
        "shape": {"type": "box", "size": [0.04, 0.05, 0.08]},
        "mass": 0.3,
        "pose": {"position": [0, 0, 0.04]},
    },
    "supports": [{"name": "table", "shape": {"type": "half_space"}}],
}
SEARCH: dict[str, Any] = {"candidates": 6, "verdict_nodes": 0}
PLACED: dict[str, Any] = {
    "scene": "far.yaml",
    "place": SEARCH,
    "vary": {
        "place.seed": {"values": [0, 1]},
        "object.mass": {"values": [0.3, 0.6]},
        "place.rank": {"from": 1, "to": 3, "steps": 3},
    },
}
PUSH = ROOT / "examples" / "trihand_push_box.yaml"


@pytest.fixture
def made(tmp_path):
    (tmp_path / "far.yaml").write_text(yaml.safe_dump(FAR), encoding="utf-8")
    return load_study(study_file(tmp_path, PLACED))


def test_a_sample_is_what_placing_by_hand_and_solving_give(made, monkeypatch):
    found = {}

    def kept(scene, *, seed, workers, **options):
        assert SEARCH.items() <= options.items() and (seed, scene.object.mass) not in found
        found[seed, scene.object.mass] = place_hand(scene, seed=seed, workers=workers, **options)
        return found[seed, scene.object.mass]

    monkeypatch.setattr("graspless_pin.studies.study.place_hand", kept)
    rows = [*evaluate_each(made, [*enumerate(made.samples)])]
    assert len(found) == 4  # one for all ranks of a seed and a mass
    for row, (seed, mass, rank) in zip(rows, made.samples, strict=True):
        places = found[seed, mass].places
        assert row["place_rank"] == rank and row["places_found"] == len(places)
        if rank > len(places):
            assert row["status"] == "not_placed" and not row["found"] and "margin_N" not in row
            few = f"there is no place of rank {rank:g}; places found: {len(places)}"
            none = f"no place among 6 candidates: {next(iter(found[seed, mass].faults.values()))} x"
            assert row["reason"].startswith(few if places else none)
            continue
        solved = places[int(rank) - 1].scene.solve()
        assert row["margin_N"] == pytest.approx(solved.margin, abs=1e-9)
        assert row["max_torque_N"] == pytest.approx(solved.max_torque, abs=1e-9)
    assert {len(one.places) for one in found.values()} >= {0, 2}
    assert [row["found"] for row in rows] == [False] * 6 + [True, True, False] * 2


def test_the_table_is_the_same_with_two_workers_and_after_a_crash(made, tmp_path):
    vary = {name: PLACED["vary"][name] for name in ("place.seed", "place.rank")}
    made = Study.from_data(PLACED | {"vary": vary}, tmp_path)
    whole = run_study(made, tmp_path / "whole.csv", workers=2, progress=False)
    told = "6 samples: 2 found, 0 infeasible, 4 not placed, 0 failed"
    assert results_summary(whole).startswith(told)
    file = tmp_path / "out.csv"
    with pytest.raises(StudyError, match="pulled the plug"):
        run(made, file, Here(3))
    rest = Here()
    pd.testing.assert_frame_equal(run(made, file, rest), whole)
    assert 0 < len(rest.samples) < 6
    assert file.read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_fingers_close_from_the_configuration_of_each_sample(tmp_path):
    vary = {
        "hand.q.finger_1_proximal": {"values": [-0.1, 0.4, 1.0]},
        "friction.hand": {"values": [0.6, 0.9]},
        "close.rates.finger_1_proximal": {"values": [0.0, 0.5]},
    }
    close: dict[str, Any] = {"fingers": ["finger_1", "finger_2"]}
    made = Study.from_data({"scene": str(PUSH), "close": close, "vary": vary})
    table = run(made, tmp_path / "out.csv")
    kept = set()
    for row, sample in zip(table.to_dict("records"), made.samples, strict=True):
        keys = dict(zip(vary, sample, strict=True))
        rates = {"finger_1_proximal": keys.pop("close.rates.finger_1_proximal")}
        closed = close_fingers(load_scene(PUSH).with_changes(keys), rates=rates, **close)
        solved, contacts = closed.scene.solve(), closed.scene.contacts.arrays
        there = made.scene_at(sample).contacts.arrays
        np.testing.assert_allclose(there.positions, contacts.positions, atol=1e-12)
        assert row["found"] and row["margin_N"] == pytest.approx(solved.margin, abs=1e-7)
        touches = closed.closing.fingers[0].touching
        assert pd.isna(row["open_fingers"]) if touches else row["open_fingers"] == "finger_1"
        kept.add(bool(touches))
    assert kept == {True, False}


def test_seeds_and_ranks_are_drawn_as_whole_numbers(made, tmp_path):
    vary = {"place.seed": {"from": 0, "to": 99}, "place.rank": {"from": 1, "to": 2}}
    sampling = {"method": "sobol", "samples": 16}
    drawn = Study.from_data(PLACED | {"vary": vary, "sampling": sampling}, tmp_path)
    seeds, ranks = zip(*drawn.samples, strict=True)
    assert {type(value) for value in (*seeds, *ranks)} == {int}
    assert len(set(seeds)) > 8 and set(ranks) == {1, 2}


MISTAKES = {
    "place: {sed: 1}": ":1: place.sed: unknown key; did you mean 'seed'?",
    "place: {rank: 0}": ":1: place.rank: found 0; needs a whole number >= 1",
    "place: {}\nclose: {}": "found place and close; place closes the fingers, too",
    "close: {}": ":4: vary['place.seed']: sets place.seed, but the study has no 'place'; add",
}


@pytest.mark.parametrize(("line", "message"), MISTAKES.items())
def test_a_mistake_is_named(made, tmp_path, line, message):
    file = tmp_path / "study.yaml"
    text = f"{line}\nscene: far.yaml\nvary:\n  place.seed: {{values: [0]}}\n"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(StudyError) as error:
        load_study(file)
    assert str(error.value).startswith(str(file)) and message in str(error.value)


@pytest.mark.parametrize(
    ("place", "seed", "message"),
    [
        ("{fingers: thumb}", 0, ":1: place.fingers: unknown finger 'thumb'; known:"),
        ("{}", -1, ":4: vary['place.seed']: at -1: "),
    ],
)
def test_a_mistake_of_an_option_is_named_before_anything_runs(made, tmp_path, place, seed, message):
    file, here = tmp_path / "study.yaml", Here()
    text = f"place: {place}\nscene: far.yaml\nvary:\n  place.seed: {{values: [{seed}]}}\n"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(StudyError) as error:
        run(load_study(file), tmp_path / "out.csv", here)
    assert str(error.value).startswith(f"{file}{message}") and not here.samples


def test_a_scene_without_a_hand_or_with_given_contacts_has_nothing_to_place(tmp_path):
    point = {"body": "table", "position": [0, 0, 0], "normal": [0, 0, 1]}
    vary = {"object.mass": {"values": [1.0]}}
    for change, said in (({"hand": None}, "has no hand"), ({"contacts": [point]}, "states its")):
        (tmp_path / "far.yaml").write_text(yaml.safe_dump(FAR | change), encoding="utf-8")
        for key in ("place", "close"):
            with pytest.raises(StudyError, match=f"{key}: the scene {said}"):
                Study.from_data({"scene": "far.yaml", key: {}, "vary": vary}, tmp_path)


def test_a_scene_without_a_place_is_told_as_an_error_where_it_is_asked_for(made):
    with pytest.raises(SceneError, match=r"far\.yaml: no place among 6 candidates"):
        made.scene_at((0, 0.3, 1))
