"""The worked planner: its path keeps the margin everywhere, and would not without being asked."""

import csv
import importlib.util
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from graspless_pin import load_scene, maximize_margin
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

SCRIPT = Path(__file__).resolve().parents[2] / "examples" / "plan_slide_and_pivot.py"
TIPS = Counter({"finger_1_tip": 1, "finger_2_tip": 1, "finger_3_tip": 1})
SLIDING, PIVOTING = TIPS + Counter(slope=4), TIPS + Counter(slope=2)


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("plan_slide_and_pivot", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("planner") / "out"


@pytest.fixture(scope="module")
def result(example, folder):
    return example.main(folder)


@pytest.fixture
def manoeuvre(example):
    return example.Manoeuvre(load_scene(example.SCENE))


def test_the_path_leads_forward_from_start_to_goal_and_keeps_the_margin(example, result):
    assert result.best.smallest_margin >= example.REQUIRED
    assert np.abs(result.least.torques).max() < 0.6
    for path in (result.corners, result.states):
        assert path[0] == pytest.approx(example.START)
        assert path[-1] == pytest.approx(example.GOAL)
        assert (np.diff(path[:, 0]) > 0.0).all()
    assert len(result.corners) > 2  # it had to go around something


@pytest.mark.parametrize("name", ["best", "least"])
def test_states_pass_a_fresh_verification(example, result, name):
    """Contacts, forces and torques as plain JSON, checked with numpy alone."""
    profile = getattr(result, name)
    assert len(profile.evaluations) == len(result.states)
    for state in profile.evaluations[::4]:
        document = json.loads(json.dumps(solution_document(state.solution, state.scene)))
        verification = verify_document(document)
        assert verification.proven, str(verification)
        passed = {check.name for check in verification.checks if check.passed}
        assert {"balance of forces", "inside friction cones", "margin as stated"} <= passed
        assert {"torques J^T f + g as stated", "torques within limits"} <= passed
        assert document["margin"] >= example.REQUIRED - 1e-6
        limits = [(joint["lower"], joint["upper"]) for joint in document["joints"]]
        assert limits == [(-0.6, 0.6)] * 9
        assert max(abs(joint["torque"]) for joint in document["joints"]) <= 0.6 + 1e-6


def test_the_shortest_path_violates_the_margin(example, result, manoeuvre):
    """It is reachable and within limits all along; only the margin speaks against it."""
    length = [
        np.linalg.norm(np.diff(path, axis=0) / example.UNITS, axis=1).sum()
        for path in (result.careless, result.states)
    ]
    assert length[0] == pytest.approx(
        np.linalg.norm((example.GOAL - example.START) / example.UNITS)
    )
    assert length[0] < length[1]
    assert all(manoeuvre.is_reachable(state) for state in result.careless)
    assert np.isfinite(result.careless_margins).all()
    assert result.careless_margins.min() < 0.75 * example.REQUIRED

    worst = result.careless[result.careless_margins.argmin()]
    scene = manoeuvre.evaluator.scene_at(*manoeuvre.query(worst, manoeuvre.joints(worst)))
    certificate = maximize_margin(scene.problem()).certificate
    assert certificate.bound < 0.75 * example.REQUIRED  # proven over all modes and torques


def test_the_last_moment_of_the_slide_keeps_the_margin(example, result, manoeuvre):
    """The state in which the pivot begins is also one in which the slide ends."""
    middle = result.states[len(result.states) // 2]
    assert middle[0] == 1.0
    assert manoeuvre.margin(middle - [1e-9, 0.0, 0.0]) >= example.REQUIRED


def test_contacts_slide_and_then_stick(result):
    for state, evaluation in zip(result.states, result.best.evaluations, strict=True):
        slides = evaluation.contacts.sliding.any(axis=1)
        assert Counter(evaluation.contacts.bodies) == (SLIDING if state[0] < 1.0 else PIVOTING)
        assert slides.tolist() == [False] * 3 + ([True] * 4 if state[0] < 1.0 else [False] * 2)
    assert [change.waypoint for change in result.best.contact_changes] == [40]


def test_pink_keeps_the_fingertips_on_their_points(result, manoeuvre):
    """And the hand hits neither itself nor the slope."""
    for evaluation in result.best.evaluations[::4]:
        assert unwanted_overlaps(evaluation.scene.hand, evaluation.scene.supports) == ()
    assert result.tip_error < 1e-4
    lower, upper = manoeuvre.model.lowerPositionLimit, manoeuvre.model.upperPositionLimit
    order = [result.best.position_names.index(name) for name in manoeuvre.names]
    followed = result.best.positions[:, order]
    assert ((lower <= followed) & (followed <= upper)).all()
    # The fingers and the carriage move gently: no joint jumps from one state to the next.
    assert np.abs(np.diff(followed, axis=0)).max() < 0.1


def test_the_box_moves_as_declared(example, manoeuvre):
    """The twist of a state is the derivative of the box's pose."""
    step = 1e-6
    for progress in (0.3, 1.4):
        before, after = manoeuvre.box(progress - step), manoeuvre.box(progress + step)
        seconds = 2.0 * step * example.STAGE_TIME
        spin = (after.rotation - before.rotation) @ before.rotation.T / seconds
        twist = manoeuvre.twist(progress)
        assert (after.translation - before.translation) / seconds == pytest.approx(
            twist[:3], abs=1e-7
        )
        assert [spin[2, 1], spin[0, 2], spin[1, 0]] == pytest.approx(twist[3:], abs=1e-6)


def test_written_files_can_be_read(result, folder):
    with (folder / "path.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["margin_N"]) for row in rows] == result.least.margins.tolist()
    trajectory = json.loads((folder / "trajectory.json").read_text(encoding="utf-8"))
    assert len(trajectory["points"]) == len(rows)
    assert trajectory["joint_names"] == list(result.least.position_names)
    height, width, _ = imread(folder / "path.png").shape
    assert width > height > 500


def test_the_same_seed_gives_the_same_path(example, result, manoeuvre):
    again = example.plan(manoeuvre.is_reachable, 1)
    assert np.array_equal(example.dense(again), result.careless)
