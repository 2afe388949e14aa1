"""Torques whose rest lasts under the controller, and joints that keep their positions."""

import copy
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.scene.scene_tools import EXAMPLES, content, loaded

from graspless_pin import (
    Controller,
    Scene,
    Status,
    contact_force_bounds,
    load_scene,
    minimum_stiffness,
)
from graspless_pin.errors import SceneError
from graspless_pin.holding.controller import Feedback
from graspless_pin.holding.small_motions import LinearizedMotion
from graspless_pin.holding.verdict_words import strong_words
from graspless_pin.programs.program import MatrixInequality, Program
from graspless_pin.report import scene_solution_text, solution_document, write_document
from graspless_pin.report.html import case_of_scene, report_html
from graspless_pin.report.verify import verify_document
from graspless_pin.solvers import least_within

BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"


@pytest.fixture(scope="module")
def ball() -> Scene:
    return load_scene(BALL)


def test_other_torques_of_the_same_margin_need_half_the_feedback(ball: Scene) -> None:
    """Many forces have the largest margin; the best case's own torques need the most feedback."""
    best = ball.solve("margin")
    needed = minimum_stiffness(ball, best.torques).stiffness
    held = ball.with_changes(controller=0.5 * needed)
    found = held.solve("margin", stability="strong")
    assert found.status is Status.STRONG and found.guarantee is not None
    assert found.guarantee.verdict is not None and found.guarantee.verdict.holding == "holds"
    assert found.margin == pytest.approx(best.margin, rel=1e-4)
    assert found.guarantee.gap == pytest.approx(0.0, abs=1e-4 * best.margin)
    assert minimum_stiffness(ball, found.torques).stiffness < 0.5 * needed


def test_less_feedback_costs_margin(ball: Scene) -> None:
    """Without any, no torques that are found hold; what is in between is a trade."""
    best = ball.solve("margin")
    needed = minimum_stiffness(ball, best.torques).stiffness
    margins = []
    for share in (0.3, 0.4, 1.01):
        found = ball.with_changes(controller=share * needed).solve("margin", stability="strong")
        assert found.found and found.guarantee is not None and found.guarantee.verdict is not None
        assert found.guarantee.verdict.holding == "holds"
        assert minimum_stiffness(ball, found.torques).stiffness < share * needed
        margins.append(found.margin)
    assert margins[0] < margins[1] < margins[2] == pytest.approx(best.margin, rel=1e-6)
    none = ball.with_changes(controller="torque").solve("margin", stability="strong")
    assert none.status is Status.STRONG_NOT_FOUND
    assert "with constant torques the object rolls" in none.explanation
    assert none.explanation.endswith(
        "- use the joint feedback that the verdict states, or another grip"
    )


def test_the_controller_that_is_not_stated_asks_for_the_first_instant_alone(ball: Scene) -> None:
    assert ball.controller == Controller() and not ball.controller.is_given
    found = ball.solve("margin", stability="strong")
    assert found.status is Status.OPTIMAL and found.guarantee is not None
    assert ball.stability(found.torques).holding == "needs_feedback"


def test_feedback_may_bring_two_frequencies_together() -> None:
    """K = 1e6 [[1 + k, s], [-s, 3]], s = 1/2, flutters where |2 - k| < 2 s, without damping."""
    K = 1e6 * np.array([[1.0, 0.5], [-0.5, 3.0]])
    motion = LinearizedMotion(
        np.eye(2), np.zeros((1, 3, 2, 2)), K, np.array([[1.0, 0.0]]), np.zeros((7, 2)),
        np.zeros(1), np.zeros(1),
    )  # fmt: skip
    (low, first), (second, high) = motion.stable_feedback(K, np.array([1e6]))
    assert (low, high) == (0.0, np.inf)
    assert (first, second) == pytest.approx((1.0, 3.0), rel=1e-3)
    between = replace(motion, gains=np.array([2e6]))
    assert between.fastest_growth(K)[0] == pytest.approx(1e3 * np.sqrt(3.0 + 0.5j).imag, rel=1e-3)


def test_feedback_that_destabilises_is_told_as_such(ball: Scene) -> None:
    said = ball.with_changes(controller=2.0).stability(ball.solve("margin").torques)
    small = said.small_motions
    assert small is not None and small.stable[-1] == (small.stiffness, np.inf)
    lost = replace(
        small, moving="the object rolls", growth=2.0, stable=((0.0, 1.5),), stiffness=0.0
    )
    lost = replace(lost, least_growth=2.0)
    assert "needs joint feedback of at most 1.5 N m/rad; with joint feedback of 2 N m/rad the" in (
        strong_words(replace(said, small_motions=lost))
    )
    both = replace(lost, stable=((0.0, 0.5), (1.0, 1.5)), stiffness=1.0)
    assert "feedback of at most 0.5 or 1 to 1.5 N m/rad;" in (
        strong_words(replace(said, small_motions=both))
    )


def interval(low: float, high: float) -> tuple[Program, MatrixInequality]:
    """x >= low, and [[high, x], [x, high]] is positive semidefinite for |x| <= high."""
    ones = np.ones(1)
    program = Program(
        0.0 * ones, -ones, np.zeros((0, 1)), np.zeros(0), np.ones((1, 1)),
        low * ones, np.array([np.inf]), -np.inf * ones, np.inf * ones,
        np.array([[-9.0], [9.0]]),
    )  # fmt: skip
    swap = np.array([[0.0, 1.0], [1.0, 0.0]])
    return program, MatrixInequality(high * np.eye(2), swap[None])


def test_a_semidefinite_program_of_one_number() -> None:
    assert least_within(*_with_list(interval(-1.0, 2.0))) == pytest.approx([2.0], abs=1e-6)
    assert least_within(*_with_list(interval(3.0, 2.0))) is None


def _with_list(made: tuple[Program, MatrixInequality]) -> tuple[Program, list[MatrixInequality]]:
    program, inequality = made
    return program, [inequality]


def document_of(scene: Scene, folder: Path) -> dict[str, Any]:
    solution = scene.solve()
    target = folder / "document.json"
    write_document(solution_document(solution, scene, scene.stability(solution.torques)), target)
    return json.loads(target.read_text())


def failing(document: dict[str, Any]) -> list[str]:
    return [one.name for one in verify_document(document).checks if one.passed is False]


def test_joints_that_keep_their_positions_hold_a_ball_in_a_wedge(
    ball: Scene, tmp_path: Path
) -> None:
    """The ball lies between the slope and links that stand still: whatever the torques are."""
    held = ball.with_changes(controller="position")
    for torques in (held.solve().torques, np.zeros(16)):
        said = held.stability(torques)
        assert said.holding == "holds" and said.joints_held
        assert str(said).startswith("holds with joints held in their positions: the object provabl")
    assert ball.stability(np.zeros(16)).holding != "holds"
    document = document_of(held, tmp_path)
    assert document["holding"]["controller"] == "joints held in their positions"
    assert failing(document) == []
    forged = copy.deepcopy(document)
    del forged["stability"]["joints_held"]
    assert failing(forged) != []


def test_fingers_that_stand_still_squeeze_nothing_for_sure(tmp_path: Path) -> None:
    """Two fingertips beside a box may touch it without any force."""
    scene = load_scene(EXAMPLES / "box_between_walls.yaml")
    torques = scene.solve("torque", margin=0.1, stability="strong").torques
    assert scene.stability(torques).holding == "holds"
    held = scene.with_changes(controller="position")
    said = held.stability(torques)
    assert said.holding == "may_fail" and said.motion is not None
    assert said.motion.object_acceleration[2] == pytest.approx(-9.81, rel=1e-6)
    assert failing(document_of(held, tmp_path)) == []
    strong = held.solve("torque", margin=0.1, stability="strong")
    assert strong.status is Status.INFEASIBLE_STRONG and strong.guarantee is not None
    assert strong.guarantee.tried == 1


def test_a_proof_for_joints_that_stand_still_is_none_for_constant_torques(
    ball: Scene, tmp_path: Path
) -> None:
    """And the other way round: a document cannot take one for the other."""
    free = document_of(ball.with_changes(controller=2.0), tmp_path)
    assert failing(free) == []
    forged = copy.deepcopy(free)
    forged["stability"]["joints_held"] = True
    assert "no small motion grows (facets)" in failing(forged)


def test_an_answer_says_that_held_joints_need_not_have_its_torques(ball: Scene) -> None:
    solution = ball.solve()
    bounds = contact_force_bounds(solution.problem, solution.torques)
    said = {
        stiffness: " ".join(
            scene_solution_text(
                ball.with_changes(controller=stiffness), solution, "", bounds
            ).split()
        )
        for stiffness in ("torque", "position")
    }
    remark = "Joints hold their positions with whatever torques this requires. The torques below "
    assert remark in said["position"] and remark not in said["torque"]
    assert "Held joints enforce that margin, " in said["position"]
    assert "These torques enforce that margin, " in said["torque"]
    held = ball.with_changes(controller="position")
    for case in (case_of_scene(held, solution), case_of_scene(ball, solution)):
        assert (remark in report_html(case)) is (case.scene is held)


@pytest.mark.parametrize(
    ("gains", "words"),
    [
        ({"index": 1.0, "ring": 2.0}, "1 N m/rad at 'index', 2 N m/rad at 'ring'"),
        ({"ring": 2.0}, "2 N m/rad at 'ring', none at 'index'"),
        ({"default": 2.0, "joint_0.0": 1.0},
         "1 N m/rad at 'joint_0.0', 2 N m/rad at 'ring', 'joint_1.0', 'joint_2.0', ..."),
        ({f"joint_{k}.0": 1.0 + 0.1 * k for k in range(12)},
         "1 N m/rad at 'joint_0.0' to 2.1 N m/rad at 'joint_11.0'"),
        ({"default": 2.0, "thumb": 1.0}, "2 N m/rad"),  # it touches nothing
    ],
)  # fmt: skip
def test_gains_that_differ_are_told_with_their_joints(
    ball: Scene, gains: dict[str, float], words: str, tmp_path: Path
) -> None:
    held = ball.with_changes(controller=Controller(gains))
    verdict = held.stability(held.solve().torques)
    assert verdict.controller == f"joint feedback of {words}"
    assert f"with joint feedback of {words}" in str(verdict)
    document = document_of(held, tmp_path)
    if verdict.holding == "holds":
        assert failing(document) == []
        for forged in ("1 N m/rad", "joint feedback of 9 N m/rad at 'index', none at 'ring'"):
            document["holding"]["controller"] = forged
            assert "the controller is that of the proof (facets)" in failing(document)


@pytest.mark.parametrize(
    ("stated", "controller"),
    [
        (0.3, Controller(0.3)),
        ("torque", Controller(0.0)),
        ("position", Controller(Feedback.POSITION)),
        ("any", Controller()),
        ({"stiffness": "torque", "damping": 0.1}, Controller(0.0, 0.1)),
        ({"damping": 0.1}, Controller("any", 0.1)),
    ],
)
def test_a_word_or_a_number_says_what_runs(
    stated: object, controller: Controller, tmp_path: Path
) -> None:
    scene = loaded(tmp_path, content(BALL) | {"controller": stated})
    assert scene.controller == controller
    again = load_scene(scene.save(tmp_path / "again.yaml"))
    assert again.controller == controller
    changed = scene.with_changes(controller="torque" if stated != "torque" else 0.25)
    assert load_scene(changed.save(tmp_path / "changed.yaml")).controller == changed.controller


def test_another_word_is_refused_with_those_that_would_do(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"yaml:\d+: controller.*position"):
        loaded(tmp_path, content(BALL) | {"controller": "positon"})


def test_simulated_joints_keep_their_positions(ball: Scene) -> None:
    pytest.importorskip("mujoco")
    from graspless_pin.simulation import simulate
    from graspless_pin.simulation.model import STIFF

    torques = ball.solve().torques
    small = ball.stability(torques).small_motions
    assert small is not None and small.motion is not None
    start = {"torque": 1e-4 * small.motion / np.abs(small.motion).max(), "position": None}
    moved = {}
    for controller in ("torque", "position"):
        held = ball.with_changes(controller=controller)
        (run,) = simulate(
            held, torques, seconds=2.0, displacement=start[controller], contact_models=[STIFF]
        ).runs
        moved[controller] = float(np.abs(run.joint_moves - run.joint_moves[0]).max())
        assert (run.outcome == "held") is (controller == "position")
    assert moved["position"] < 1e-3 < moved["torque"]


def with_gains(folder: Path, gains: object, **more: object) -> Scene:
    """The ball on a slope with an Allegro whose robot file states its gains."""
    robot = content(EXAMPLES.parent / "robots" / "allegro_right.yaml")
    (folder / "own.yaml").write_text(yaml.safe_dump(robot | {"controller": gains}))
    data = content(BALL)
    data["hand"] |= {"robot": "own.yaml"}
    return loaded(folder, data | more)


def test_robot_files_state_their_gains(ball: Scene, tmp_path: Path) -> None:
    torques = ball.solve().torques
    held = with_gains(tmp_path, {"stiffness": 2.0})
    assert held.stability(torques).holding == "holds"
    assert "joint feedback of 2 N m/rad" in str(held.stability(torques))
    own = with_gains(tmp_path, {"stiffness": 2.0}, controller="any")
    assert own.stability(torques).holding == "needs_feedback"
    by_finger = {"stiffness": {"thumb": 3.0, "default": 1.0}, "damping": 0.05}
    both = with_gains(tmp_path, by_finger)
    assert both.controller == Controller(by_finger["stiffness"], {"default": 0.05})
    again = load_scene(both.save(tmp_path / "again.yaml"))
    assert again.controller == both.controller


def test_gains_of_no_joint_are_refused_by_the_robot_file(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"own.yaml: controller.stiffness.thum: .*mean 'thumb'"):
        with_gains(tmp_path, {"stiffness": {"thum": 3.0}})
    with pytest.raises(SceneError, match=r"own.yaml:[0-9]+: controller.stiffness: found -1"):
        with_gains(tmp_path, {"stiffness": -1.0})
