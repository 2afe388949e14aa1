"""The worked planners: their paths keep the margin, and would not without being asked."""

import csv
import importlib
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from graspless_pin import maximize_margin
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "slide_and_pivot"
TIPS = Counter({"finger_1_tip": 1, "finger_2_tip": 1, "finger_3_tip": 1})
SLIDING, PIVOTING = TIPS + Counter(slope=4), TIPS + Counter(slope=2)


@pytest.fixture(scope="module", autouse=True)
def scripts():
    """As if they were run where they are."""
    sys.path.insert(0, str(FOLDER))
    yield
    sys.path.remove(str(FOLDER))
    for name in {file.stem for file in FOLDER.glob("*.py")} & set(sys.modules):
        del sys.modules[name]


def script(name):
    return importlib.import_module(name)


@pytest.fixture(scope="module")
def task(scripts):
    return script("task").Task()


@pytest.fixture(scope="module")
def planned(task):
    return script("with_ompl").plan(task)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("planner") / "out"


@pytest.fixture(scope="module")
def result(scripts, folder):
    return script("follow_with_pink").main(folder)


def test_the_path_leads_forward_from_start_to_goal_and_keeps_the_margin(task, planned):
    assert planned[0] == pytest.approx(script("task").START)
    assert planned[-1] == pytest.approx(script("task").GOAL)
    assert (np.diff(planned[:, 0]) >= 0.0).all()
    assert len(planned) > 2  # it had to go around something
    assert task.smallest_margin(task.waypoints(planned)) >= script("with_ompl").REQUIRED


def test_the_same_seed_gives_the_same_path(task, planned):
    assert np.array_equal(script("with_ompl").plan(task), planned)


def test_what_is_planned_without_a_margin_violates_it(task):
    """It is reachable and within limits all along; only the margin speaks against it."""
    straight = script("with_ompl").plan(task, -np.inf)
    profile = task.profile(task.waypoints(straight))
    assert profile.found and len(straight) == 2
    assert profile.smallest_margin < 0.6 * script("with_ompl").REQUIRED
    state = task.along(straight)[profile.margins.argmin()]
    scene = task.evaluator.scene_at(*task.configuration(state), task.box_rate(state[0]))
    certificate = maximize_margin(scene.problem()).certificate
    assert certificate.bound < 0.6 * script("with_ompl").REQUIRED  # over all modes and torques


@pytest.mark.parametrize(("name", "library"), [("drake", "pydrake"), ("torch", "torch")])
def test_planners_that_optimise_reach_the_same_margin(task, name, library):
    pytest.importorskip(library)
    states = script(f"with_{name}").plan(task)
    assert states[0] == pytest.approx(script("task").START)
    assert states[-1] == pytest.approx(script("task").GOAL)
    best = task.evaluator.evaluate().margin  # of START: no path that slides at once has more
    assert task.smallest_margin(task.waypoints(states)) == pytest.approx(best, rel=0.05)


@pytest.mark.parametrize("state", [[0.3, -0.01, 0.2], [1.4, 0.0, -0.2]])
def test_rates_of_joints_and_box_are_those_of_differences(task, state):
    step, state = 1e-6, np.array(state)
    for k, rates in enumerate(task.joint_rates(state).T):
        off = step * np.eye(3)[k]
        change = task.joints(state + off) - task.joints(state - off)
        np.testing.assert_allclose(rates, change / (2.0 * step), atol=1e-6)
    before, after = task.box(state[0] - step), task.box(state[0] + step)
    spin = (after.rotation - before.rotation) @ before.rotation.T / (2.0 * step)
    twist = [*(after.translation - before.translation) / (2.0 * step), *spin[[2, 0, 1], [1, 2, 0]]]
    np.testing.assert_allclose(task.box_rate(state[0]), twist, atol=1e-6)


@pytest.mark.parametrize("name", ["best", "least"])
def test_states_pass_a_fresh_verification(result, name):
    """Contacts, forces and torques as plain JSON, checked with numpy alone."""
    profile, kept = getattr(result, name), script("follow_with_pink").KEPT
    assert len(profile.evaluations) == len(result.states)
    assert profile.smallest_margin >= kept - 1e-6
    for state in profile.evaluations[::4]:
        document = json.loads(json.dumps(solution_document(state.solution, state.scene)))
        verification = verify_document(document)
        assert verification.proven, str(verification)
        passed = {check.name for check in verification.checks if check.passed}
        assert {"balance of forces", "inside friction cones", "margin as stated"} <= passed
        assert {"torques J^T f + g as stated", "torques within limits"} <= passed
        assert document["margin"] >= kept - 1e-6
        limits = [(joint["lower"], joint["upper"]) for joint in document["joints"]]
        assert limits == [(-0.6, 0.6)] * 9
        assert max(abs(joint["torque"]) for joint in document["joints"]) <= 0.6 + 1e-6


def test_contacts_slide_and_then_stick(result):
    for state, evaluation in zip(result.states, result.best.evaluations, strict=True):
        slides = evaluation.contacts.sliding.any(axis=1)
        assert Counter(evaluation.contacts.bodies) == (SLIDING if state[0] < 1.0 else PIVOTING)
        assert slides.tolist() == [False] * 3 + ([True] * 4 if state[0] < 1.0 else [False] * 2)
    (change,) = result.best.contact_changes
    assert result.states[change.waypoint][0] == 1.0


def test_pink_keeps_the_fingertips_on_their_points(result, task):
    """And the hand hits neither itself nor the slope."""
    for evaluation in result.best.evaluations[::4]:
        assert unwanted_overlaps(evaluation.scene.hand, evaluation.scene.supports) == ()
    assert result.tip_error < 2e-4
    lower, upper = task.model.lowerPositionLimit, task.model.upperPositionLimit
    order = [result.best.position_names.index(name) for name in task.names]
    followed = result.best.positions[:, order]
    assert ((lower <= followed) & (followed <= upper)).all()
    # The fingers and the carriage move gently: no joint jumps from one state to the next.
    assert np.abs(np.diff(followed, axis=0)).max() < 0.15


def test_written_files_can_be_read(result, folder):
    with (folder / "path.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["margin_N"]) for row in rows] == result.least.margins.tolist()
    trajectory = json.loads((folder / "trajectory.json").read_text(encoding="utf-8"))
    assert len(trajectory["points"]) == len(rows)
    assert trajectory["joint_names"] == list(result.least.position_names)
    height, width, _ = imread(folder / "path.png").shape
    assert width > height > 500


def test_planners_are_compared(planned, capsys, monkeypatch):
    compare = script("compare")
    monkeypatch.setattr(script("with_ompl"), "plan", lambda task: planned)
    monkeypatch.setattr(compare, "PLANNERS", {"ompl": "with_ompl", "another": "with_another"})
    compare.main()
    _, straight, ompl, left_out = capsys.readouterr().out.splitlines()
    assert straight.startswith("straight line") and ompl.startswith("ompl")
    margins = [float(row.split(" N ")[0].split()[-1]) for row in (straight, ompl)]
    assert margins[0] < script("with_ompl").REQUIRED <= margins[1]
    assert left_out == "another: left out (No module named 'with_another')"
