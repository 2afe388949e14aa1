"""``graspless-pin plot``."""

import pytest
from PIL import Image
from study_tools import Here, study
from tests.cli.cli_tools import run

from graspless_pin.cli import plot
from graspless_pin.studies import read_results, results_summary, run_study

MASSES = {"object.mass": {"values": [1.0, 2.0]}}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The cuboid over friction and mass, of which friction alone decides what is found."""
    vary = {
        "solve.sign_rule": {"values": ["strict"]},
        "friction.default": {"values": [0.0, 0.3]},
        "object.mass": {"values": [1.0, 2.0]},
    }
    file = tmp_path_factory.mktemp("plot") / "results.parquet"
    run_study(study(vary), file, executor=Here(), progress=False)
    return file


@pytest.mark.parametrize("kind", ["line", "map", "boundary"])
def test_a_picture_of_each_kind(results, tmp_path, monkeypatch, kind):
    drawn = []
    for name in ("margin_plot", "margin_heat_map", "outcome_boundary"):
        draw = getattr(plot, name)
        monkeypatch.setattr(
            plot, name, lambda *args, draw=draw, **more: drawn.append(draw(*args, **more))
        )
    output = tmp_path / "new" / "picture.png"
    result = run("plot", results, "-o", output, "--kind", kind)
    assert result.exit_code == 0 and result.stdout == f"wrote {output}\n"
    with Image.open(output) as image:
        assert image.size == (960, 720)
    (axes,) = drawn
    assert axes.get_xlabel() == "friction coefficient, default"
    assert axes.get_ylabel() == ("margin e [N]" if kind == "line" else "object.mass [kg]")


@pytest.mark.parametrize("vary", [{"solve.margin": {"values": [0.1, 0.3]}}, MASSES])
def test_torques_are_drawn_where_margins_are_required(tmp_path, vary):
    """The margins are those that were asked for, and say nothing."""
    file, picture = tmp_path / "results.csv", tmp_path / "picture.svg"
    asked = study(vary, compute={"algorithm": "torque"})
    run_study(asked, file, executor=Here(), progress=False)
    assert "smallest max |torque| 0.96" in results_summary(file)
    assert run("plot", file, "-o", picture).exit_code == 0
    assert "largest |torque| [N m]" in picture.read_text(encoding="utf-8")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["$\\frac$", "$x", "_x^{", "😀", "x" * 200])
def test_columns_have_any_name(results, tmp_path, monkeypatch, recwarn, name):
    """A dollar begins no mathematics, and letters that no font has are not told of."""
    table, picture = read_results(results).rename(columns={"margin_N": name}), tmp_path / "x.png"
    monkeypatch.setattr(plot, "read_results", lambda _: table)
    result = run("plot", results, "-o", picture, "--value", name)
    assert (result.exit_code, result.stdout) == (0, f"wrote {picture}\n")
    assert not [str(one.message) for one in recwarn]


def test_columns_can_be_chosen(results, tmp_path):
    picture = tmp_path / "picture.svg"
    options = ["--kind", "boundary", "--x", "object.mass_kg", "--y", "friction.default"]
    result = run("plot", results, "-o", picture, *options, "--value", "status")
    assert result.exit_code == 0 and picture.read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--x", "mass"], "error: --x: is 'mass'; the table has the columns"),
        (["--kind", "boundary", "--value", "mode"], "error: outcome: is 'mode'"),
        (
            ["--controller", "1"],
            "error: --controller: has an effect only with --kind squeeze or tolerances",
        ),
        (["--y", "object.mass_kg"], "error: --y: has an effect only with --kind map or boundary"),
        (
            ["--kind", "squeeze", "--x", "mass"],
            "error: --x: has an effect only with the table of a study",
        ),
        (["-o", "picture.txt"], "error: --output: picture.txt must end with .png"),
    ],
)
def test_bad_input_is_told(results, tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    result = run("plot", results, "-o", "picture.png", *options)
    assert result.exit_code == 2 and result.stderr.startswith(message)


def test_one_variable_has_no_map(tmp_path):
    file = tmp_path / "few.csv"
    run_study(study({"friction": {"values": [0.0, 0.3]}}), file, executor=Here(), progress=False)
    result = run("plot", file, "-o", tmp_path / "picture.png", "--kind", "map")
    assert result.exit_code == 2 and "--y: has no default: no other column of" in result.stderr
