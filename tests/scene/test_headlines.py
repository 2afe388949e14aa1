"""What a verdict says of small motions: `minimum_stiffness` in a sentence, in figures, in JSON."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scene_tools import EXAMPLES, PAPER, content, loaded
from test_geometric_stiffness import on_mesh, turned_icosphere
from test_minimum_stiffness import ball, board_on_cylinder, pressing_arm, standing
from tests.cli.cli_tools import run

from graspless_pin import (
    Controller,
    Scene,
    free_motions,
    load_scene,
    minimum_stiffness,
    stability,
)
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.report import solution_document

BOX_ON_SLOPE = EXAMPLES / "allegro_box_on_slope.yaml"


def test_fingers_that_buckle_are_told_from_an_object_that_goes(tmp_path: Path) -> None:
    scene = pressing_arm(tmp_path)
    torques = scene.problem().jacobian[:3].T @ [20.0, 0.0, 0.0]
    said, known = scene.stability(torques), minimum_stiffness(scene, torques)
    assert (said.stiffness_needed, said.growth_rate) == pytest.approx(
        (known.stiffness, known.growth), rel=1e-6
    )
    assert len(free_motions(scene.problem())) == 0 and said.holding == "needs_feedback"
    assert said.small_motions is not None and said.small_motions.unit == "N m/rad"
    assert "; without it the fingers buckle, growing at " in str(said)
    # "At least" is not less than what is needed.
    stated = float(str(said).split(" at least ")[1].split()[0])
    assert known.stiffness <= stated <= 1.1 * known.stiffness


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: standing(folder, ball(0.05), 0.25, {"shape": ball(0.2)}), "rolls"),
        (lambda folder: board_on_cylinder(folder, 0.15), "tilts"),
    ],
)
def test_what_no_feedback_stops_is_lost_after_the_first_instant(
    make: Callable[[Path], Scene], words: str, tmp_path: Path
) -> None:
    said = make(tmp_path).stability([])
    assert said.status == "strong" and said.stiffness_needed == np.inf and said.growth_rate > 1.0
    start = f"stays at the first instant; then the object {words}, growing at "
    assert str(said).startswith(start) and "/s: no joint feedback stops it (" in str(said)


def test_motions_that_do_not_grow_let_it_hold(tmp_path: Path) -> None:
    table = {"shape": {"type": "half_space"}}
    for scene in (
        standing(tmp_path, ball(0.05), 0.05, table),
        load_scene(PAPER / "cuboid_at_rest.yaml"),
    ):
        said = scene.stability(scene.solve().torques)
        assert (said.stiffness_needed, said.growth_rate, said.holding) == (0.0, 0.0, "holds")
        assert str(said).startswith("holds: the object provably stays at rest (")
        assert "); no small motion grows" in str(said)


def test_a_ball_that_rolls_about_is_neutral(tmp_path: Path) -> None:
    said = standing(tmp_path, ball(0.05), 0.05, {"shape": {"type": "half_space"}}).stability([])
    lead, _, neutral = str(said).partition("; no small motion grows; neutral: ")
    assert lead.startswith("holds: ")
    assert set(neutral.split(", ")) == {"the object rolls", "the object turns"}


def test_the_controller_decides_whether_it_holds() -> None:
    """Gains of fingers and joints come from the scene; the least stiffness is told either way."""
    scene = load_scene(BOX_ON_SLOPE)
    torques = scene.solve().torques
    free = scene.stability(torques)
    needed = free.stiffness_needed
    assert free.holding == "needs_feedback" and 0.0 < needed < 1.0
    least = "needs joint feedback of at least "
    for controller, holding, start in (
        (Controller(1.1 * needed), "holds", "holds with joint feedback of 0."),
        (0.5 * needed, "needs_feedback", least),
        (
            Controller({"default": 2.0, "index": 1}),
            "holds",
            "holds with joint feedback of 1 N m/rad at 'index', 2 N m/rad at 'mid",
        ),
        (Controller({"index": 0.1 * needed}), "needs_feedback", least),
        (Controller({"thumb": 5.0}), "needs_feedback", least),
    ):
        said = scene.with_changes(controller=controller).stability(torques)
        assert said.holding == holding and str(said).startswith(start)
        assert said.stiffness_needed == pytest.approx(needed, rel=1e-6)
    slower = scene.with_changes(controller=0.5 * needed).stability(torques)
    assert 0.1 < slower.growth_rate < free.growth_rate
    assert "; with joint feedback of 0.0" in str(slower)


def test_what_holds_without_torques_that_keep_rest(tmp_path: Path) -> None:
    """Rest that is none fails whatever the gains, and a joint alone is not the object."""
    scene = load_scene(BOX_ON_SLOPE).with_changes(controller=5.0)
    said = scene.stability(np.zeros(scene.problem().joint_count))
    assert said.holding in ("fails", "finger_moves") and np.isnan(said.stiffness_needed)
    known = standing(tmp_path, ball(0.05), 0.25, {"shape": ball(0.2)}).stability([])
    assert known.holding == "fails"


def test_gains_stand_in_the_file(tmp_path: Path) -> None:
    data = content(BOX_ON_SLOPE)
    data["hand"] = data["hand"] | {}
    data["controller"] = {"stiffness": {"index": 2.0, "default": 0.5}, "damping": 0.05}
    scene = loaded(tmp_path, data)
    assert scene.controller == Controller({"index": 2.0, "default": 0.5}, 0.05)
    again = pickle.loads(pickle.dumps(scene))  # noqa: S301 - our own bytes
    assert again.controller == scene.controller
    data["controller"] = {"stiffness": {"indx": 2.0}}
    with pytest.raises(SceneError, match=r"yaml:\d+: controller\b.*stiffness.indx: is not a joint"):
        loaded(tmp_path, data)
    data["controller"] = {"stiffness": -1.0}
    with pytest.raises(SceneError, match=r"scene.yaml:\d+: controller.stiffness: "):
        loaded(tmp_path, data)
    with pytest.raises(
        ArgumentError, match=r"stiffness.indx: is not a joint or finger; did you mean"
    ):
        scene.with_changes(controller=Controller({"indx": 2.0})).stability(np.zeros(16))
    with pytest.raises(ArgumentError, match="controller: found 'stiff'; needs a Controller"):
        scene.with_changes(controller="stiff")


def test_a_mesh_is_known_by_its_facets_and_by_what_they_stand_for() -> None:
    scene = load_scene(EXAMPLES / "allegro_mug_against_wall.yaml")
    torques = scene.solve("margin").torques
    said, known = scene.stability(torques), minimum_stiffness(scene, torques)
    assert said.stiffness_needed == pytest.approx(known.stiffness, rel=1e-6)
    assert said.small_motions is not None
    assert set(said.small_motions.growth_by_surface) == {"facets", "fitted"}
    assert "; without it the " in str(said) and "facets" not in str(said)
    again = pickle.loads(pickle.dumps(said.small_motions))  # noqa: S301 - our own bytes
    assert again.growth_by_surface == said.small_motions.growth_by_surface


def test_where_facets_and_surface_differ_both_are_told(tmp_path: Path) -> None:
    mesh = turned_icosphere()
    height = float(mesh.vertices[:, 2].max()) + 0.05
    said = on_mesh(tmp_path, mesh, height).stability([])
    assert "(on a mesh's facets 0 /s, on a smooth surface fitted to them 5." in str(said)
    # Contact forces are determined: the worse surface decides, whatever the other says.
    assert said.holding == "fails" and str(said).startswith("stays at the first instant; then ")


def test_a_problem_without_a_scene_is_known_where_nothing_rolls() -> None:
    rolling, still = (load_scene(file) for file in (BOX_ON_SLOPE, PAPER / "cuboid_at_rest.yaml"))
    said = stability(rolling.problem(), rolling.solve().torques)
    assert said.status == "strong" and np.isnan(said.stiffness_needed)
    assert "small motions not known: how contacts roll is only known for scenes with shapes" in str(
        said
    )
    assert stability(still.problem(), still.solve().torques).growth_rate == 0.0


def test_a_declared_motion_keeps_its_words() -> None:
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml")
    said = scene.stability(scene.solve().torques)
    assert str(said).startswith("keeps its motion: nothing else is an outcome (proof: ")
    assert str(said).endswith("; needs position feedback: 3 free motions")
    assert np.isnan(said.growth_rate) and said.holding == "needs_feedback"


def test_the_same_sentence_stands_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("graspless_pin.cli.solve._RANGES_TIME", 0.0)  # which are printed, too
    file = tmp_path / "solution.json"
    solved = run("solve", BOX_ON_SLOPE, "--json", file)
    scene = load_scene(BOX_ON_SLOPE)
    solution = scene.solve()
    said = scene.stability(solution.torques, node_limit=300)
    assert said.message in " ".join(solved.stdout.split())
    document = json.loads(file.read_text())
    assert document["stability"]["message"] == said.message
    stated = document["holding"]
    assert stated["status"] == "needs_feedback" and stated["controller"] == "constant torques"
    assert stated["acceleration"] == {"status": "strong"}
    assert said.small_motions is not None and said.small_motions.motion is not None
    np.testing.assert_allclose(stated["unstable_motion"], said.small_motions.motion, atol=1e-6)
    assert stated["stiffness_needed"] == pytest.approx(said.stiffness_needed, rel=1e-6)
    assert stated["growth_rate"] == pytest.approx(said.growth_rate, rel=1e-6)
    assert run("verify", file).exit_code == 0
    for claim in (
        {"status": "holds"},
        {"status": "fails"},
        {"growth_rate": 0.0},
        {"stiffness_needed": None},
        {"status": "may_fail"},
        {"acceleration": {"status": "weak"}},
    ):
        file.write_text(json.dumps(document | {"holding": stated | claim}))
        assert run("verify", file).exit_code == 1, claim
    alone = solution_document(solution, scene, stability(scene.problem(), solution.torques))
    assert alone["holding"]["stiffness_needed"] is alone["holding"]["growth_rate"] is None
    strong = run("solve", BOX_ON_SLOPE, "--stability", "strong").stdout
    assert "; without it the fingers buckle, growing at " in " ".join(strong.split())
