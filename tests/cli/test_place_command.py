"""`graspless-pin place`: from a hand that stands far off to a scene file in which it holds."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_tools import assert_refused, run
from test_new_scene import pincher

from graspless_pin import load_scene


@pytest.fixture(autouse=True)
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def place(*options: str) -> tuple[str, ...]:
    return ("place", "scene.yaml", "-o", "placed.yaml", "--workers", "1", *options)


def test_new_place_and_solve_are_three_commands() -> None:
    assert run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "0.4").exit_code == 0
    placed = run(*place("--candidates", "60", "--verdict-nodes", "0", "--approach", "0,0,-1"))
    assert placed.exit_code == 0 and placed.stderr == ""
    assert placed.stdout.startswith("margin ")
    assert placed.stdout.endswith("wrote placed.yaml\nnow: graspless-pin solve placed.yaml\n")
    scene = load_scene("placed.yaml")
    assert {"left_finger", "right_finger"} <= set(scene.contacts.bodies)
    assert scene.solve().margin >= 0.1
    solved = run("solve", "placed.yaml", "--no-verdict")
    assert solved.exit_code == 0 and "touches nothing" not in solved.stderr
    # What is there is not replaced, which is said before anything is tried.
    assert_refused(run(*place()), "placed.yaml: is there already; choose another name")
    wrong = run(*place("--overwrite", "--candidates", "60", "--verdict-nodes", "0", "--rank", "9"))
    assert wrong.exit_code == 2 and "--rank: is 9; " in wrong.stderr


def test_a_hand_without_a_place_is_an_answer() -> None:
    run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "0.4")
    none = run(*place("--candidates", "20", "--approach", "0,0,1"))
    assert none.exit_code == 1 and none.stderr == ""
    assert "0 of 20 candidates hold the object" in none.stdout
    assert "nowhere is the open hand clear of the supports" in none.stdout
    assert not Path("placed.yaml").exists()


def test_options_are_checked() -> None:
    run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "0.4")
    assert_refused(run(*place("--approach", "down")), "--approach: needs three numbers")
    assert_refused(run(*place("--finger", "thumb")), "fingers: unknown finger 'thumb'")
