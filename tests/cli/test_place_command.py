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
    placed = run(*place("--candidates", "16", "--verdict-nodes", "0", "--approach", "0,0,-1"))
    assert placed.exit_code == 0 and placed.stderr == ""
    assert placed.stdout.startswith("margin ")
    assert placed.stdout.endswith("wrote placed.yaml\nnext: graspless-pin solve placed.yaml\n")
    scene = load_scene("placed.yaml")
    assert {"left_finger", "right_finger"} <= set(scene.contacts.bodies)
    assert scene.solve().margin >= 0.1
    solved = run("solve", "placed.yaml", "--no-verdict")
    assert solved.exit_code == 0 and "touches nothing" not in solved.stderr
    # What is there is not replaced, which is said before anything is tried.
    assert_refused(run(*place()), "placed.yaml exists already; choose another name")
    wrong = run(*place("--overwrite", "--candidates", "9", "--verdict-nodes", "0", "--rank", "99"))
    assert wrong.exit_code == 2 and "--rank: is 99; " in wrong.stderr


def test_all_places_are_a_table_and_any_rank_can_be_written() -> None:
    run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "0.4")
    options = "--candidates", "10", "--verdict-nodes", "0", "--approach", "0,0,-1"
    told = run(*place(*options, "--all")).stdout.splitlines()
    head = next(k for k, line in enumerate(told) if line.split()[:2] == ["rank", "margin"])
    rows = [line.split() for line in told[head + 2 :] if line.split()[0].isdigit()]
    assert [int(row[0]) for row in rows] == list(range(1, len(rows) + 1)) and len(rows) > 2
    assert run(*place(*options, "--overwrite", "--rank", str(len(rows)))).exit_code == 0
    assert load_scene("placed.yaml").solve().margin == pytest.approx(float(rows[-1][1]), rel=1e-2)


def test_two_points_press_but_do_not_carry() -> None:
    run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "0.4")
    options = "--candidates", "8", "--verdict-nodes", "0", "--approach", "0,0,-1"
    none = run(*place(*options, "--carry"))  # the box turns about the line between the two
    assert none.exit_code == 1 and "the hand cannot carry the object by itself" in none.stdout
    pressed = run(*place(*options, "--press"))
    assert pressed.exit_code == 0 and "without supports none" in pressed.stdout
    refused = run(*place("--carry", "--press", "--overwrite"))
    assert_refused(refused, "--carry: cannot be combined with --press")


def test_a_hand_without_a_place_is_an_answer() -> None:
    run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "0.4")
    none = run(*place("--candidates", "5", "--approach", "0,0,1"))
    assert none.exit_code == 1 and none.stderr == ""
    assert "0 of 5 candidates hold the object" in none.stdout
    assert "almost everywhere the open hand or its arm touches a support; try" in none.stdout
    assert not Path("placed.yaml").exists()


def test_options_are_checked() -> None:
    run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "0.4")
    assert_refused(
        run(*place("--approach", "down")), "--approach: found 'down'; needs three numbers"
    )
    assert_refused(run(*place("--finger", "thumb")), "--finger: unknown finger 'thumb'")
