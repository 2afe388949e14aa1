"""``graspless-pin study`` and the example studies."""

from contextlib import suppress

import pytest
from study_tools import FRICTION, ROOT, Here, data, study_file
from tests.cli.cli_tools import LINES, run

from graspless_pin.cli import study
from graspless_pin.errors import StudyError
from graspless_pin.studies import load_study, read_results, run_study
from graspless_pin.studies.run import check_study

EXAMPLES = sorted((ROOT / "examples" / "studies").glob("*.yaml"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_example_studies_can_run(file, tmp_path):
    study = load_study(file)
    check_study(study)
    assert len(study.samples) in (12, 30, 128, 10_000)
    ends = study.samples[0], study.samples[-1]
    assert all(study.scene_at(sample).solve().problem.contact_count >= 6 for sample in ends)


def test_a_study_from_the_command_line(tmp_path):
    file = study_file(tmp_path, data({"friction": FRICTION}))
    output = tmp_path / "new" / "out.parquet"
    result = run("study", file, "-o", output, "--workers", "1")
    assert result.exit_code == 0
    assert "3 samples: 3 found, 0 infeasible, 0 failed\nlargest margin 4.768 N at" in result.stdout
    assert f"{output} after" in result.stdout
    assert "3/3" in result.stderr
    assert len(read_results(output)) == 3
    again = run("study", file, "-o", output, "--no-progress")
    assert again.exit_code == 0 and again.stderr == ""
    told = run("study", file, "-o", output)
    assert told.stderr == f"{output} is complete; to compute it again: --fresh\n"


@pytest.mark.parametrize(("need_hand", "code"), [(True, 4), (False, 0)])
def test_a_hand_that_touches_nothing_is_no_success(tmp_path, need_hand, code):
    (tmp_path / "scene.yaml").write_text(LINES, encoding="utf-8")
    way = {"what": "hand", "along": [0, 1, 0]}
    made = {
        "scene": "scene.yaml",
        "vary": {"away": {"move": way, "values": [-0.167, 0.0, -0.05], "unit": "m"}},
        "compute": {"need_hand": need_hand},
    }
    file, output = study_file(tmp_path, made), tmp_path / "out.csv"
    run_study(load_study(file), output, executor=Here(), progress=False)
    result = run("study", file, "-o", output)
    assert result.exit_code == code, result.stdout
    lines, told = result.stdout.splitlines(), read_results(output)["findings"]
    if need_hand:
        assert lines[0] == (
            "3 samples: 3 found (2 of them with serious findings), 0 infeasible, 0 failed"
        )
        assert "at sample 1: away_m 0" in lines[1] and "at sample 1: away_m 0" in lines[2]
        assert lines[5] == "first serious finding at sample 0: hand-touches-nothing"
        assert told.isna().tolist() == [False, True, False]
    else:
        assert lines[0] == "3 samples: 3 found, 0 infeasible, 0 failed"
        assert told.isna().tolist() == [True] * 3


def test_going_on_is_told(tmp_path, capsys):
    made, output = load_study(study_file(tmp_path, data())), tmp_path / "out.csv"
    for limit, told in ((5, False), (18, True)):
        with suppress(StudyError):
            run_study(made, output, executor=Here(limit))
        stderr = capsys.readouterr().err
        assert ("continues: an earlier run computed 5 samples" in stderr) == told


def test_nothing_found(tmp_path):
    file = study_file(tmp_path, data({"friction": {"values": [0.0]}}))
    run_study(load_study(file), tmp_path / "out.csv", executor=Here(), progress=False)
    result = run("study", file, "-o", tmp_path / "out.csv")
    assert result.exit_code == 1
    assert result.stdout.startswith("1 sample: 0 found, 1 infeasible, 0 failed\n")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "out.txt"], "error: out.txt: '.txt' is not a known format"),
        (["-o", "out.csv", "--dask", "nowhere"], "error: no Dask scheduler answers at 'nowhere'"),
    ],
)
def test_bad_input(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    study_file(tmp_path, data({"friction": FRICTION}))
    result = run("study", "study.yaml", *options)
    assert result.exit_code == 2 and result.stdout == ""
    assert result.stderr.startswith(message)
    assert "Traceback" not in result.stderr


def test_interrupted(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(study, "compute_study", interrupted)
    file = study_file(tmp_path, data({"friction": FRICTION}))
    result = run("study", file, "-o", tmp_path / "out.csv")
    assert result.exit_code == 130
    assert result.stderr == "interrupted; run the same command again to continue\n"
