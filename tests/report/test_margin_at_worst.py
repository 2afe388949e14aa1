"""What is said of the margin at worst, and that its page explains every such sentence."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from report_cases import ALLEGRO

from graspless_pin import Scene, Status, TorqueSolution, contact_force_bounds, load_scene
from graspless_pin.report import scene_solution_text

ROOT = Path(__file__).resolve().parents[2]
SMALL = "These torques do not enforce that margin: it may be as small as"
RULE = "over all admissible contact forces."
BEYOND = (
    "over all admissible contact forces: a normal force may exceed max_normal_force by that much."
)
WEAK = 4.0  # N: a limit of normal forces that corners of the box may exceed


@cache
def answer(case: str) -> tuple[Scene, TorqueSolution]:
    if case == "walls":
        scene = load_scene(ROOT / "examples" / "box_between_walls.yaml")
        return scene, scene.solve()
    if case == "edge":
        scene = load_scene(ROOT / "examples" / "trihand_pivot_box.yaml")
        return scene, scene.solve()
    scene = load_scene(ALLEGRO)
    if case == "weak":
        scene = scene.with_changes(max_normal_force=WEAK)
    return scene, scene.solve("torque", margin=0.1)


@pytest.mark.parametrize(
    ("case", "status", "said"),
    [
        ("edge", Status.OPTIMAL, f"These torques enforce that margin, {RULE}"),
        ("corners", Status.OPTIMAL, f"{SMALL} # N, {RULE}"),
        ("weak", Status.OPTIMAL, f"{SMALL} -# N, {BEYOND}"),
        (
            "corners",
            Status.LIMIT_REACHED,
            f"{SMALL} # N (less is not ruled out), {RULE}",
        ),
        (
            "walls",
            Status.OPTIMAL,
            "These torques do not enforce any margin: contact forces are unbounded (jamming is "
            "possible).",
        ),
        (
            "corners",
            Status.NOT_FOUND_IN_LIMIT,
            "Whether these torques enforce that margin was not decided in time.",
        ),
    ],
)
def test_each_outcome_has_a_sentence_that_the_page_explains(case, status, said):
    scene, solution = answer(case)
    bounds = replace(contact_force_bounds(solution.problem, solution.torques), status=status)
    text = " ".join(scene_solution_text(scene, solution, "", bounds).split())
    assert said in re.sub(r"\d+(\.\d+)?", "#", text)
    page = (ROOT / "docs" / "margin.md").read_text(encoding="utf-8")
    explained = re.sub(r"\d+(\.\d+)?", "#", " ".join(page.split()))
    words = (
        said.removeprefix("These torques ").removesuffix(f", {RULE}").removesuffix(f", {BEYOND}")
    )
    assert words.removesuffix(".") in explained


def test_beyond_a_limit_the_margin_is_what_exceeds_it():
    _, solution = answer("weak")
    bounds = contact_force_bounds(solution.problem, solution.torques)
    assert bounds.smallest_margin == pytest.approx(WEAK - bounds.upper[:, 0].max(), abs=1e-6)
    assert bounds.smallest_margin < -0.5
