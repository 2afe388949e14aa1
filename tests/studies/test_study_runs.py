"""Runs of a study in this process: the table, its files, going on, whose output it is."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml
from study_tools import CUBOID, HEIGHT, ROOT, Here, data, run, study, study_file

from graspless_pin import (
    contact_force_bounds,
    disturbance_margin,
    load_scene,
    maximize_margin,
    minimum_friction,
)
from graspless_pin.errors import ArgumentError, StudyError
from graspless_pin.studies import (
    Study,
    load_study,
    read_results,
    results,
    results_parts,
    results_summary,
)
from graspless_pin.studies.journal import JOURNAL_FORMAT, Journal

LOW = {"values": [0.0, 0.3]}  # without friction nothing holds the cuboid on its slope


@pytest.mark.parametrize("name", ["out.parquet", "out.csv"])
def test_the_table_is_that_of_a_plain_loop(tmp_path, name):
    made = study()
    table = run(made, tmp_path / name)
    expected = [maximize_margin(made.scene_at(sample).problem()) for sample in made.samples]
    assert len(expected) == 18
    assert table.columns.tolist() == [
        "sample", "height_mm", "slope_deg", "friction.default", "status", "found", "margin_N",
        "max_torque_Nm", "torque_finger_1/hinge_Nm", "torque_finger_6/hinge_Nm", "contacts",
        "nodes", "findings", "reason", "error",
    ]  # fmt: skip
    assert table["sample"].tolist() == list(range(18))
    assert list(zip(*(table.iloc[:, 1:4].to_numpy().T.tolist()), strict=True)) == list(made.samples)
    assert table["margin_N"].tolist() == [solution.margin for solution in expected]
    torques = table[["torque_finger_1/hinge_Nm", "torque_finger_6/hinge_Nm"]].to_numpy()
    np.testing.assert_array_equal(torques, [solution.torques for solution in expected])
    assert table["found"].all()
    assert table[["findings", "reason", "error"]].isna().all().all()
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_both_formats_read_back_alike(tmp_path):
    made = study({"friction": LOW, "hand.q.finger_1/hinge": {"values": [0.0, 1.0, 3.0]}})
    tables_read = []
    for name in ("out.parquet", "out.csv"):
        table = run(made, tmp_path / name)
        read = read_results(tmp_path / name)
        pd.testing.assert_frame_equal(read, table)
        assert read.attrs == table.attrs
        tables_read.append(read)
    pd.testing.assert_frame_equal(*tables_read)
    plain = pd.read_csv(tmp_path / "out.csv", comment="#")
    assert plain.columns.tolist() == tables_read[0].columns.tolist() and len(plain) == 6
    assert {"failed", "infeasible_forces", "optimal"} == set(plain["status"])


def test_the_metadata_tells_seed_versions_and_study(tmp_path):
    made = study(
        {"friction": {"from": 0.2, "to": 0.5}},
        sampling={"method": "sobol", "samples": 2, "seed": 7},
        name="seven",
    )
    run(made, tmp_path / "out.parquet")
    about = read_results(tmp_path / "out.parquet").attrs[results.KEY]
    assert about["seed"] == 7 and about["study"] == "seven" and about["samples"] == 2
    assert about["fingerprint"] == made.fingerprint
    assert about["versions"]["numpy"] == np.__version__
    assert about["entry"]["vary"] == {"friction": {"from": 0.2, "to": 0.5}}
    assert pd.read_parquet(tmp_path / "out.parquet").attrs == {results.KEY: about}
    run(made, tmp_path / "out.csv")
    assert read_results(tmp_path / "out.csv").attrs == {results.KEY: about}


def test_infeasible_and_failed_samples_are_rows(tmp_path):
    made = study({"friction": LOW, "hand.q.finger_1/hinge": {"values": [0.0, 3.0]}})
    table = run(made, tmp_path / "out.csv")
    assert table["status"].tolist() == ["infeasible_forces", "failed", "optimal", "failed"]
    assert table["found"].tolist() == [False, False, True, False]
    assert table["reason"][0].startswith("infeasible: no contact forces")
    error = table["error"][1]
    assert error.startswith("SceneError: cuboid_at_rest.yaml:") and "outside the joint's" in error
    assert str(CUBOID.parent) not in error
    assert table["margin_N"].isna().tolist() == [True, True, False, True]
    text = results_summary(table)
    assert text.startswith("4 samples: 1 found, 1 infeasible, 2 failed\nlargest margin 1.65 N at")
    assert "first failure at sample 1: SceneError" in text
    weak = {"hand.effort_limits.finger_1/finger": {"values": [0.2]}}
    table = run(study(weak, compute={"explain": True}), tmp_path / "explained.csv")
    assert table["reason"][0].count("\n") >= 1 and "N m" in table["reason"][0]


def test_figures_that_are_equal_are_told_once(tmp_path):
    compute = {"algorithm": "torque", "margin": 0.1}
    table = run(study({"object.mass": {"values": [1.0, 2.0]}}, compute=compute), tmp_path / "o.csv")
    text = results_summary(table)
    assert "\nmargin 0.1 N at all samples found\n" in text
    assert "largest margin" not in text and "largest max |torque|" in text


def test_guaranteed_torques_and_verdicts_have_their_column(tmp_path):
    vary = {"friction": {"values": [0.3]}}
    made = study(vary, compute={"stability": "strong", "verdict": True, "verdict_nodes": 400})
    assert made.scene.data["solve"].items() >= {"stability": "strong", "verdict_nodes": 400}.items()
    row = run(made, tmp_path / "out.csv").iloc[0]
    assert (row["status"], row["verdict"]) == ("optimal", "strong")
    plain = run(study(vary, compute={"verdict": True}), tmp_path / "plain.csv").iloc[0]
    assert plain["verdict"] == "strong"
    assert (plain["holding"], plain["stiffness_needed"], plain["growth_rate"]) == ("holds", 0, 0)


def test_analyses_have_columns(tmp_path):
    analyses = {"force_bounds": True, "disturbance_margin": True, "minimum_friction": True}
    compute = {"algorithm": "torque", "margin": 0.1, **analyses}
    made = study({"friction": {"values": [0.3]}}, compute=compute)
    row = run(made, tmp_path / "out.csv").iloc[0]
    solution = load_scene(CUBOID).solve("torque", margin=0.1)
    assert row["max_torque_Nm"] == solution.max_torque
    bounds = contact_force_bounds(solution.problem, solution.torques)
    assert row["smallest_margin_N"] == pytest.approx(bounds.smallest_margin, abs=1e-9)
    assert row["largest_margin_N"] == pytest.approx(bounds.largest_margin, abs=1e-9)
    held = disturbance_margin(solution.problem, solution.torques)
    assert row["disturbance_N"] == pytest.approx(held.magnitudes.min(), abs=1e-9)
    factor = minimum_friction(solution.problem).factor
    assert row["minimum_friction_factor"] == pytest.approx(factor, abs=1e-9)


def test_a_stopped_run_goes_on_where_it_was(tmp_path):
    made = study()
    whole = run(made, tmp_path / "whole.parquet")
    file = tmp_path / "out.parquet"
    seen = []
    for limit in (3, 5):
        here = Here(limit)
        with pytest.raises(
            StudyError, match=r"pulled the plug.*; the rows computed so far are kept: run"
        ):
            run(made, file, here)
        assert not file.exists()
        seen += here.samples
    rest = Here()
    table = run(made, file, rest)
    assert sorted(seen + rest.samples) == list(range(18)) and len(seen) > 3
    pd.testing.assert_frame_equal(table, whole)
    assert file.read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    assert not (tmp_path / "out.parquet.journal").exists()


@pytest.mark.parametrize("cut", [1, 9, 40])
def test_a_torn_last_line_is_dropped(tmp_path, cut):
    made = study()
    file, journal = tmp_path / "out.csv", tmp_path / "out.csv.journal"
    whole = run(made, file).copy()
    file.unlink()
    with pytest.raises(StudyError):
        run(made, file, Here(6))
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines)[:-cut])
    here = Here()
    pd.testing.assert_frame_equal(run(made, file, here), whole)
    *kept, torn = (json.loads(line.split(b" ", 1)[1])["sample"] for line in lines[1:])
    assert torn and {*torn} <= {*here.samples}
    assert len(here.samples) == 18 - sum(map(len, kept))


def test_a_finished_study_is_only_read(tmp_path):
    file = tmp_path / "out.parquet"
    first = run(study(), file)
    before = file.stat().st_mtime_ns
    journal = tmp_path / "out.parquet.journal"
    Journal(journal, {"format": JOURNAL_FORMAT, "fingerprint": study().fingerprint}).close()
    here = Here()
    pd.testing.assert_frame_equal(run(study(name="other name"), file, here), first)
    assert here.samples == [] and file.stat().st_mtime_ns == before
    assert not (tmp_path / "out.parquet.journal").exists()
    again = run(study(), file, here, fresh=True)
    assert len(here.samples) == 18
    pd.testing.assert_frame_equal(again, first)


def test_another_studys_output_is_kept(tmp_path):
    file = tmp_path / "out.csv"
    other = study({"friction": {"values": [0.3]}})
    run(other, file)
    before = file.read_bytes()
    here = Here()
    note = tmp_path / "note.csv"  # nor is any other file written over
    note.write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(StudyError, match=r"does not hold results of a study.*--overwrite"):
        run(study(), note)
    assert note.read_text(encoding="utf-8") == "a,b\n1,2\n"
    for options in ({}, {"fresh": True}):
        with pytest.raises(StudyError, match=r"holds the results of another study.*--overwrite"):
            run(study(), file, here, **options)
    for name in ("overwrite", "fresh"):
        with pytest.raises(ArgumentError, match=f"{name}: is 'no'; it must be True or False"):
            run(study(), file, here, **{name: "no"})
    assert here.samples == [] and file.read_bytes() == before
    with pytest.raises(StudyError, match="pulled the plug"):
        run(study(), file, Here(5), overwrite=True)
    assert file.read_bytes() == before
    rest = Here()
    assert len(run(study(), file, rest, overwrite=True)) == 18
    assert 0 < len(rest.samples) < 18


@pytest.mark.parametrize("line", ["notes", "3", '{"fingerprint": "of another study"}'])
def test_a_journal_beside_a_finished_study_is_kept(tmp_path, line):
    """Another study, told to replace the output, was stopped: its rows are not ours to drop."""
    journal = tmp_path / "out.csv.journal"
    table = run(study(), tmp_path / "out.csv")
    journal.write_text(f"{line}\n", encoding="utf-8")
    pd.testing.assert_frame_equal(run(study(), tmp_path / "out.csv"), table)
    assert journal.read_text(encoding="utf-8") == f"{line}\n"


def test_another_studys_journal_is_kept(tmp_path):
    file, journal = tmp_path / "out.csv", tmp_path / "out.csv.journal"
    with pytest.raises(StudyError, match="pulled the plug"):
        run(study(), file, Here(5))
    before = journal.read_bytes()
    other = study({"friction": {"values": [0.3]}})
    for options in ({}, {"fresh": True}):
        with pytest.raises(StudyError, match=r"out\.csv\.journal: holds the rows of another study"):
            run(other, file, **options)
    assert journal.read_bytes() == before
    journal.write_text("notes\n", encoding="utf-8")
    with pytest.raises(StudyError, match="is not the journal of a study"):
        run(other, file)
    assert len(run(other, file, overwrite=True)) == 1


def test_a_changed_scene_is_another_study(tmp_path):
    scene = tmp_path / "scene.yaml"
    text = CUBOID.read_text(encoding="utf-8")
    scene.write_text(text, encoding="utf-8")
    file = study_file(tmp_path, data({"height": HEIGHT}) | {"scene": "scene.yaml"})
    run(load_study(file), tmp_path / "out.csv")
    scene.write_text(text.replace("mass: 1.0", "mass: 1.1"), encoding="utf-8")
    with pytest.raises(StudyError, match="before it or its scene was changed"):
        run(load_study(file), tmp_path / "out.csv")
    scene.write_text(text.replace("mass: 1.0", "mass: 1.0 # kg"), encoding="utf-8")
    run(load_study(file), tmp_path / "out.csv")


@pytest.mark.parametrize("suffix", ["xml", "urdf.xacro", "glb", "STL"])
def test_a_changed_file_of_the_scene_is_another_study(tmp_path, suffix):
    content = yaml.safe_load(CUBOID.read_text(encoding="utf-8"))
    content["description"] = f"part.{suffix}"
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    found = set()
    for text in ("one", "another"):
        (tmp_path / f"part.{suffix}").write_text(text, encoding="utf-8")
        made = Study.from_data(data({"height": HEIGHT}) | {"scene": "scene.yaml"}, tmp_path)
        found.add(made.fingerprint)
    assert len(found) == 2


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("pincher.urdf", 'mass value="0.03"', 'mass value="0.04"'),
        ("tip.obj", "v 0.02 ", "v 0.03 "),
        ("pincher.srdf", 'value="0.1"', 'value="0.2"'),
        ("other.urdf", 'name="other"', 'name="another"'),
        ("parts.xacro", 'mass value="0.03"', 'mass value="0.04"'),
        ("figures.yaml", "reach: 1", "reach: 2"),
        ("arm.xml", 'range="-1 1"', 'range="-1 2"'),
        ("shell.obj", "v 0.02 ", "v 0.03 "),
    ],
)
def test_files_that_files_of_the_scene_name_are_the_studys_too(tmp_path, name, old, new):
    inertia = '<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/>'
    robot = (
        '<robot name="pincher"><link name="palm"/><joint name="hinge" type="revolute">'
        '<parent link="palm"/><child link="tip"/><limit lower="-1" upper="1" effort="1" '
        'velocity="1"/></joint><link name="tip"><inertial><mass value="0.03"/>'
        f"{inertia}</inertial><collision><geometry>"
        '<mesh filename="tip.obj"/></geometry></collision></link></robot>'
    )
    corners = "v 0 0 0\nv 0.02 0 0\nv 0 0.02 0\nv 0 0 0.02\n"
    state = '<group_state name="in" group="all"><joint name="hinge" value="0.1"/></group_state>'
    files = {
        "pincher.urdf": robot,
        "other.urdf": robot.replace('name="pincher"', 'name="other"'),
        "tip.obj": corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        "pincher.srdf": '<robot name="pincher"><group name="all"><joint name="hinge"/></group>'
        f"{state}</robot>",
        "pincher.yaml": "name: pincher\nurdf: pincher.urdf\n",
        "parts.xacro": robot,
        "figures.yaml": "reach: 1\n",
        "made.urdf.xacro": '<robot name="made" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:include filename="parts.xacro"/><xacro:property name="figures" '
        "value=\"${xacro.load_yaml('figures.yaml')}\"/><link name=\"${figures['reach']}\"/>"
        '<joint name="last" type="fixed"><parent link="tip"/>'
        "<child link=\"${figures['reach']}\"/></joint></robot>",
        "arm.xml": '<mujoco><asset><mesh name="shell" file="shell.obj"/></asset><worldbody><body>'
        '<joint name="hinge" range="-1 1"/><geom type="mesh" mesh="shell" contype="0" '
        'conaffinity="0"/></body></worldbody><actuator><motor joint="hinge" ctrlrange="-1 1"/>'
        "</actuator></mujoco>",
        "shell.obj": corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        "other.yaml": "name: other\nurdf: other.urdf\n",
        "made.yaml": "name: made\nurdf: made.urdf.xacro\n",
        "arm.yaml": "name: arm\nurdf: arm.xml\n",
        "scene.yaml": "friction: {default: 0.5}\nhand: {robot: pincher.yaml}\n"
        "object: {shape: {type: sphere, radius: 0.01}, mass: 0.1}\n",
    }
    for file, text in files.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    robots = ["pincher.yaml", "other.yaml", "made.yaml", "arm.yaml"]
    vary = {"hand.robot": {"values": robots}}

    def fingerprint():
        return Study.from_data({"scene": "scene.yaml", "vary": vary}, tmp_path).fingerprint

    before = fingerprint()
    (tmp_path / name).write_text(files[name].replace(old, new), encoding="utf-8")
    assert old in files[name] and fingerprint() != before
    (tmp_path / name).write_text(files[name], encoding="utf-8")
    assert fingerprint() == before


def test_other_versions_are_not_mixed(tmp_path, monkeypatch):
    file = tmp_path / "out.csv"
    with pytest.raises(StudyError, match="pulled the plug"):
        run(study(), file, Here(5))
    real = results.versions()
    newer = lambda: real | {"numpy": "99.0"}  # noqa: E731
    monkeypatch.setattr("graspless_pin.studies.run.versions", newer)
    with pytest.raises(StudyError, match=r"was begun with other versions.*--fresh"):
        run(study(), file)
    monkeypatch.undo()
    run(study(), file)
    monkeypatch.setattr("graspless_pin.studies.run.versions", newer)
    with pytest.raises(StudyError, match=r"was computed with other versions.*--fresh"):
        run(study(), file)


def test_two_runs_do_not_write_one_journal(tmp_path):
    made = study()
    file = tmp_path / "out.csv"

    class Meddling(Here):
        def submit(self, fn, /, *args, **kwargs):
            with pytest.raises(StudyError, match="another run is writing this file"):
                run(made, file)
            return super().submit(fn, *args, **kwargs)

    assert len(run(made, file, Meddling())) == 18


def test_a_damaged_result_is_no_result(tmp_path):
    for name in ("a.csv", "a.parquet"):
        (tmp_path / name).write_text("x", encoding="utf-8")
        with pytest.raises(StudyError, match="does not hold results of a study"):
            read_results(tmp_path / name)
        with pytest.raises(StudyError, match="there is no such file"):
            read_results(tmp_path / f"b{name}")
        (tmp_path / f"b{name}.journal").touch()
        with pytest.raises(StudyError, match="its study is not complete: run it again"):
            read_results(tmp_path / f"b{name}")


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_column_that_there_is_not_is_named(tmp_path, suffix):
    file = tmp_path / f"out.{suffix}"
    run(study({"friction": {"values": [0.3]}}), file)
    assert [len(part) for part in results_parts(file, ["sample"])] == [1]
    with pytest.raises(StudyError, match="has no column 'margin_n'; did you mean 'margin_N'"):
        list(results_parts(file, ["sample", "margin_n"]))


def test_the_largest_torque_stands_under_its_unit(tmp_path):
    """Of a hand with a prismatic joint alone N; where both kinds are, each has its column."""
    gripper = ROOT / "examples" / "panda_slide_cuboid_up_slope.yaml"
    vary = {"friction": {"values": [0.0, 0.5]}}
    lone = Study.from_data({"scene": str(gripper), "vary": {"object.mass": {"values": [0.5]}}})
    table = run(lone, tmp_path / "lone.csv")
    assert [name for name in table.columns if "torque" in name] == [
        "max_torque_N",
        "torque_panda_finger_joint1_N",
    ]
    assert table["max_torque_N"][0] == lone.scene_at(lone.samples[0]).solve().max_torque
    one = {"finger_1/finger": "force", "finger_6/finger": "position"}
    made = study({"fingers": {"values": {"both": "force", "one": one}, "key": "hand.control"}})
    table = run(made, tmp_path / "one.csv")
    assert table["fingers"].tolist() == ["both", "one"] and table["found"].all()
    assert table["torque_finger_6/hinge_Nm"].isna().tolist() == [False, True]
    hybrid = {"finger_1/finger": "force", "finger_6/finger": "hybrid"}
    fingers = {"values": {"hybrid": hybrid, "both": "force"}, "key": "hand.control"}
    mixed = study({"fingers": fingers, **vary})
    table = run(mixed, tmp_path / "mixed.csv")
    assert table.columns.tolist()[3:9] == [
        "status", "found", "margin_N", "max_torque_Nm", "max_torque_N", "torque_finger_1/hinge_Nm",
    ]  # fmt: skip
    assert table["found"].tolist() == [False, True, False, True]
    torques = mixed.scene_at(mixed.samples[1]).solve().torques
    assert table["max_torque_Nm"][1] == abs(torques[0])
    assert table["max_torque_N"][1] == abs(torques[1])
    torques = mixed.scene_at(mixed.samples[3]).solve().torques
    assert table["max_torque_Nm"][3] == abs(torques).max()
    assert table["max_torque_N"].isna().tolist() == [True, False, True, True]
    pd.testing.assert_frame_equal(read_results(tmp_path / "mixed.csv"), table)
    weak = {"scene": str(gripper), "vary": {"friction": {"values": [0.0]}}}
    table = run(Study.from_data(weak), tmp_path / "out.csv")
    assert not table["found"].any()
    assert [name for name in table.columns if "torque" in name] == ["max_torque_N"]


def test_the_time_of_a_search_can_be_limited(tmp_path):
    vary = {"friction": {"values": [0.3]}}
    for limit, ended in ((1e-9, True), (60.0, False)):
        analyses = {"minimum_friction": True, "force_bounds": True, "disturbance_margin": True}
        compute = {"time_limit": limit, "algorithm": "torque", "margin": 0.1, **analyses}
        row = run(study(vary, compute=compute), tmp_path / f"{limit}.csv").iloc[0]
        assert (row["status"] in ("limit_reached", "not_found_in_limit")) == ended, row["status"]
        # What was not proven is empty.
        columns = ("minimum_friction_factor", "smallest_margin_N", "disturbance_N")
        for name in columns:
            assert bool(pd.isna(row.get(name))) == ended, name


@pytest.mark.parametrize("limit", [{"time_limit": 0.0}, {"node_limit": 1}])
def test_limits_of_a_search_are_those_of_the_scene_unless_the_study_says_others(tmp_path, limit):
    scene = yaml.safe_load(CUBOID.read_text(encoding="utf-8")) | {"uncertainty": {"mass": 0.1}}
    scene["solve"] = {"algorithm": "torque", "margin": 0.1, **limit}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene), encoding="utf-8")
    entry = {"scene": "scene.yaml", "vary": {"friction": {"values": [0.3]}}}
    unlimited = dict.fromkeys(limit, 10**6)
    for compute, ended in (({}, True), (unlimited, False)):
        made = Study.from_data(entry | {"compute": compute}, tmp_path)
        row = run(made, tmp_path / "out.csv", overwrite=True).iloc[0]
        for status in (row["status"], row["robust_status"]):
            assert (status in ("limit_reached", "not_found_in_limit")) == ended, status


def test_a_limit_can_vary(tmp_path):
    vary = {"solve.node_limit": {"values": [1, 10**6]}}
    compute = {"algorithm": "torque", "margin": 0.1}
    table = run(study(vary, compute=compute), tmp_path / "out.csv")
    assert table["status"].tolist() == ["not_found_in_limit", "optimal"]
