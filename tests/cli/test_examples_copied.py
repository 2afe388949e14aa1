"""`graspless-pin example`: for people without a clone."""

from pathlib import Path

import numpy as np
import pytest
from cli_tools import run

from graspless_pin import load_scene
from graspless_pin.cli.example import copy_example, example_files

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_all_are_listed_with_their_names_and_in_the_wheel() -> None:
    result = run("example")
    assert result.exit_code == 0
    listed = [line.split("  ")[0] for line in result.stdout.splitlines()]
    assert sorted(listed) == sorted(path.stem for path in EXAMPLES.rglob("*.yaml"))
    assert "Allegro hand keeps a box from sliding down a slope" in result.stdout
    # The build puts the folder beside the modules.
    project = (EXAMPLES.parent / "pyproject.toml").read_text()
    assert '"examples" = "graspless_pin/examples"' in project


@pytest.mark.parametrize("name", ["allegro_mug_against_wall", "trihand_slide_and_pivot"])
def test_a_copy_with_its_files_is_the_same_scene(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("example", name)
    assert result.exit_code == 0
    assert f"next: graspless-pin solve {name}.yaml" in result.stdout
    assert sum(path.is_file() for path in tmp_path.rglob("*")) == 2
    mine, theirs = load_scene(f"{name}.yaml").problem(), load_scene(EXAMPLES / f"{name}.yaml")
    np.testing.assert_array_equal(mine.jacobian, theirs.problem().jacobian)


def test_a_study_brings_its_scene(tmp_path: Path) -> None:
    copied = copy_example(example_files()["cuboid_friction_slope_height"], tmp_path)
    assert [str(path) for path in copied] == [
        "studies/cuboid_friction_slope_height.yaml", "paper/cuboid_at_rest.yaml",
    ]  # fmt: skip


def test_a_scene_brings_the_table_of_its_plan(tmp_path: Path) -> None:
    copied = copy_example(example_files()["pivot_against_wall"], tmp_path)
    assert [str(path) for path in copied] == [
        "pivot_against_wall.yaml", "pivot_against_wall.csv", "robots/point_finger.urdf",
    ]  # fmt: skip


def test_nothing_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").mkdir()
    mine = tmp_path / "meshes" / "mug.stl"
    mine.write_text("mine")
    result = run("example", "allegro_mug_against_wall")
    assert result.exit_code == 2
    assert "meshes/mug.stl is in this folder already; nothing was copied" in result.stderr
    assert mine.read_text() == "mine"
    assert not (tmp_path / "allegro_mug_against_wall.yaml").exists()


def test_a_name_that_is_none_is_answered_by_near_ones() -> None:
    result = run("example", "alegro_box_slope")
    assert result.exit_code == 2
    assert "did you mean 'allegro_box_on_slope'?" in result.stderr.replace("\n", " ")
