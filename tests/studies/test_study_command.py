"""``graspless-pin study`` and the example studies."""

from contextlib import suppress

import pytest
import typer
from study_tools import FRICTION, ROOT, Here, data, study_file
from typer.testing import CliRunner

from graspless_pin.cli import studying
from graspless_pin.errors import StudyError
from graspless_pin.studies import load_study, read_results, run_study
from graspless_pin.studies.checks import check_study

APP = typer.Typer()
APP.command()(studying.study)
EXAMPLES = sorted((ROOT / "examples" / "studies").glob("*.yaml"))


def command(*arguments):
    words = [str(argument) for argument in arguments]
    return CliRunner().invoke(APP, words, catch_exceptions=False)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_example_studies_can_run(file, tmp_path):
    study = load_study(file)
    check_study(study)
    assert len(study.samples) in (30, 128, 10_000)
    some = study.samples[:: len(study.samples) // 4]
    assert all(study.scene_at(sample).solve().problem.contact_count >= 6 for sample in some)


def test_a_study_from_the_command_line(tmp_path):
    file = study_file(tmp_path, data({"friction": FRICTION}))
    output = tmp_path / "new" / "out.parquet"
    result = command(file, "-o", output, "--workers", 1)
    assert result.exit_code == 0
    assert "3 samples: 3 found, 0 infeasible, 0 failed\nlargest margin 4.768 N at" in result.stdout
    assert f"{output} after" in result.stdout
    assert "3/3" in result.stderr
    assert len(read_results(output)) == 3
    again = command(file, "-o", output, "--no-progress")
    assert again.exit_code == 0 and again.stderr == ""
    told = command(file, "-o", output)
    assert (
        told.stderr == f"{output} is complete: nothing is left to compute (--fresh begins anew)\n"
    )


def test_going_on_is_told(tmp_path, capsys):
    made, output = load_study(study_file(tmp_path, data())), tmp_path / "out.csv"
    for limit, told in ((5, False), (18, True)):
        with suppress(StudyError):
            run_study(made, output, executor=Here(limit))
        stderr = capsys.readouterr().err
        assert ("goes on: 5 samples are there from an earlier run" in stderr) == told
    assert output.is_file()


def test_nothing_found(tmp_path):
    file = study_file(tmp_path, data({"friction": {"values": [0.0]}}))
    run_study(load_study(file), tmp_path / "out.csv", executor=Here(), progress=False)
    result = command(file, "-o", tmp_path / "out.csv")
    assert result.exit_code == 1
    assert result.stdout.startswith("1 sample: 0 found, 1 infeasible, 0 failed\n")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "out.txt"], "error: out.txt: '.txt' is no known format"),
        (["-o", "study.yaml/out.csv"], "error: study.yaml/out.csv: there is no folder"),
        (["-o", "out.csv", "--dask", "nowhere"], "error: no Dask scheduler answers at 'nowhere'"),
    ],
)
def test_bad_input(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    study_file(tmp_path, data({"friction": FRICTION}))
    result = command("study.yaml", *options)
    assert result.exit_code == 2 and result.stdout == ""
    assert result.stderr.startswith(message)
    assert "Traceback" not in result.stderr


def test_interrupted(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(studying, "compute_study", interrupted)
    file = study_file(tmp_path, data({"friction": FRICTION}))
    result = command(file, "-o", tmp_path / "out.csv")
    assert result.exit_code == 130
    assert result.stderr == "interrupted; run the same command again to go on\n"
