"""Every example runs as it stands, without a screen and from any folder."""

import json
import runpy
from pathlib import Path

import pytest
from typer.testing import CliRunner

from graspless_pin.cli.commands import app

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
# tests/planning/test_planner_example.py runs the planners, which take their time, and looks closer.
SCRIPTS = sorted(set(EXAMPLES.rglob("*.py")) - set(EXAMPLES.glob("slide_and_pivot/*.py")))
SCENES = sorted(file for file in EXAMPLES.rglob("*.yaml") if file.parent.name != "studies")


def label(file: Path) -> str:
    return file.relative_to(EXAMPLES).as_posix()


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize("file", SCRIPTS, ids=label)
def test_script(file, capsys):
    runpy.run_path(str(file), run_name="__main__")
    seen = capsys.readouterr()
    assert seen.out.strip()
    assert seen.err == ""


@pytest.mark.sampled(6)
@pytest.mark.parametrize("file", SCENES, ids=label)
def test_scene(file):
    """The scene's own algorithm finds an answer, and no warning is left to explain."""
    result = CliRunner().invoke(
        app, ["solve", str(file), "--json", "out.json"], catch_exceptions=False
    )
    assert result.exit_code == 0, result.output
    # A margin that planning uses and this algorithm does not is a note.
    assert all("[unused-option]" in line for line in result.stderr.splitlines())
    document = json.loads(Path("out.json").read_text(encoding="utf-8"))
    assert document["found"] and document["margin"] > 0.0
    assert document["scene"] in result.stdout
