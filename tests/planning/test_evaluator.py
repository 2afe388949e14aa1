"""The evaluator against loading and solving each state by itself."""

import pickle
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from planning_scenes import EXAMPLES, example, nearby, shifted, with_hybrid_finger

from graspless_pin import load_scene
from graspless_pin.errors import ArgumentError, NoSolutionError, SceneError, SolverUnavailableError
from graspless_pin.findings import Severity
from graspless_pin.planning import Evaluator, StateStatus
from graspless_pin.scene.stated import GivenContact, HandMotion, Motion

SCENES = (
    "allegro_box_on_slope",
    "allegro_sphere_on_slope",
    "allegro_tumble_box",
    "panda_slide_cuboid_up_slope",
    "trihand_pivot_box",
    "trihand_push_box",
    "paper/cuboid_at_rest",
    "paper/sphere_on_slope",
)


def fresh(name, q, T=None, twist=None):
    """The state as a scene of its own, loaded anew."""
    scene: Any = load_scene(EXAMPLES / f"{name}.yaml")
    changes: dict[str, Any] = {}
    if q is not None:
        changes["hand"] = scene.hand.with_configuration(q)
    if T is not None:
        changes["object"] = scene.object.with_pose(T)
    if twist is not None:
        changes["motion"] = Motion(np.asarray(twist))
    return scene.with_changes(**changes)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("algorithm", ["margin", "torque"])
@pytest.mark.parametrize("name", SCENES)
def test_it_equals_loading_and_solving(name, algorithm):
    evaluator = Evaluator(example(name), algorithm=algorithm, margin=0.05)
    rng = np.random.default_rng(3)
    seen = Counter()
    for _ in range(6):
        q = nearby(evaluator, rng, 0.004)
        named = dict(zip(evaluator.joint_names, q.tolist(), strict=True))
        T = shifted(evaluator.scene.object.T_world_object, rng.normal(0.0, 1e-4, 3))
        answer = evaluator.evaluate(q, T)
        seen[answer.status] += 1
        options = {"margin": 0.05} if algorithm == "torque" else {}
        try:
            scene = fresh(name, named, T)
            expected = scene.solve(algorithm, **options)
        except SceneError as error:
            assert not answer.has_contacts
            assert answer.reason == str(error)
            continue
        serious = [one.message for one in scene.findings if one.severity is Severity.SERIOUS]
        if serious:
            assert not answer.has_contacts
            assert serious[0].startswith(answer.reason)
            continue
        assert answer.found == expected.found
        if expected.found:
            size = max(1.0, expected.margin)
            assert answer.margin == pytest.approx(expected.margin, abs=1e-6 * size)
            assert (
                np.abs(answer.torques).max() == pytest.approx(expected.max_torque, abs=1e-5)
                or algorithm == "margin"
            )
            assert answer.joint_names == expected.problem.joint_names
            assert answer.contacts.bodies == scene.contacts.bodies
        else:
            assert answer.reason == expected.status.message
    assert seen[StateStatus.FOUND] >= 1


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SCENES)
def test_is_feasible_agrees_with_evaluate(name):
    evaluator, decider = Evaluator(example(name), algorithm="margin"), Evaluator(example(name))
    rng = np.random.default_rng(4)
    decided = Counter()
    for _ in range(12):
        q = nearby(evaluator, rng, 0.006)
        answer = evaluator.evaluate(q)
        if not answer.found:
            assert not decider.is_feasible(q, margin=0.0)
            decided["none"] += 1
            continue
        step = 1e-5 * max(1.0, answer.margin)
        assert decider.is_feasible(q, margin=max(0.0, answer.margin - step))
        assert not decider.is_feasible(q, margin=answer.margin + step)
        assert decider.is_feasible(q, margin=0.5 * answer.margin)
        decided["found"] += 1
    assert decided["found"] >= 3


def test_a_search_with_many_modes_is_decided_alike():
    """Algorithm 2 of the tumbling box needs more than the relaxation."""
    evaluator = Evaluator(example("allegro_tumble_box"), algorithm="torque")
    rng = np.random.default_rng(5)
    programs = []
    for _ in range(5):
        q = nearby(evaluator, rng, 0.01)
        answer = evaluator.evaluate(q)
        cold = evaluator.scene_at(q).solve("torque")
        assert answer.solution.max_torque == pytest.approx(cold.max_torque, abs=1e-6)
        assert answer.solution.certificate.gap <= 1e-6
        programs.append(answer.solution.certificate.force_programs)
    assert max(programs) > 1


def test_names_arrays_and_partial_names_are_one():
    evaluator = Evaluator(example("allegro_box_on_slope"))
    q = evaluator.configuration()
    q[2] += 0.003
    by_array = evaluator.evaluate(q)
    by_names = evaluator.evaluate(dict(zip(evaluator.joint_names, q, strict=True)))
    partial = evaluator.evaluate({evaluator.joint_names[2]: q[2]})
    assert by_names.margin == pytest.approx(by_array.margin, rel=1e-8)
    assert partial.margin == pytest.approx(by_array.margin, rel=1e-8)
    assert abs(by_array.margin - evaluator.evaluate().margin) > 1e-5
    np.testing.assert_array_equal(evaluator.configuration({evaluator.joint_names[2]: q[2]}), q)


def test_the_twist_decides_what_slides():
    scene = example("trihand_push_box")
    evaluator = Evaluator(scene)
    declared, resting = evaluator.evaluate(), evaluator.evaluate(twist=np.zeros(6))
    expected = scene.solve()  # as the scene has it
    assert declared.margin == pytest.approx(expected.margin, abs=1e-9)
    np.testing.assert_allclose(declared.torques, expected.torques, atol=1e-9)
    assert declared.solution.problem.is_sliding.sum() == 4
    assert resting.solution.problem.is_sliding.sum() == 0
    other = evaluator.evaluate(twist=[0.0, 0.02, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(
        other.contacts.sliding[3:], np.tile([0.0, 0.02, 0.0], (4, 1)), atol=1e-12
    )
    along = np.array([0.05, 0, 0, 0, 0, 0])
    held = evaluator.evaluate(twist=Motion(along, HandMotion(along, {})))
    assert held.margin == pytest.approx(declared.margin, abs=1e-9)


T_BOX = example("trihand_push_box").object.T_world_object
ASIDE = shifted(T_BOX, [0.05, 0, 0])


@pytest.mark.parametrize(
    ("status", "arguments"),
    [
        (StateStatus.NO_CONTACT, {"T_world_object": shifted(T_BOX, [0, 0, 1.0])}),
        (StateStatus.OVERLAP, {"T_world_object": shifted(T_BOX, [0, 0, -0.02])}),
        (StateStatus.BLOCKED, {"twist": [0, 0, -0.1, 0, 0, 0]}),
        (StateStatus.PARTED, {"twist": [0, 0, 0.1, 0, 0, 0], "T_world_object": ASIDE}),
        (StateStatus.OUTSIDE_LIMITS, {"q": {"finger_1_distal": 5.0}}),
        (StateStatus.HAND_TOUCHES_NOTHING, {"T_world_object": ASIDE}),
        (StateStatus.INFEASIBLE, {"twist": [0.05, 0, 0, 0, 0, 0], "T_world_object": ASIDE}),
    ],
)
def test_a_bad_state_is_an_answer(status, arguments):
    evaluator = Evaluator(
        example("trihand_push_box"), need_hand=status is not StateStatus.INFEASIBLE
    )
    answer = evaluator.evaluate(**arguments)
    assert answer.status is status
    assert answer.reason
    assert answer.margin == -np.inf
    assert not answer.found
    assert not evaluator.is_feasible(**arguments, margin=0.0)
    with pytest.raises(NoSolutionError, match="no torques"):
        _ = answer.torques
    if status is not StateStatus.INFEASIBLE:
        assert answer.joint_names == ()
        with pytest.raises(NoSolutionError, match="was not solved"):
            _ = answer.contacts


def test_a_hand_with_mimic_joints_takes_its_independent_ones():
    """A follower outside its limits is an answer."""
    evaluator = Evaluator(example("panda_slide_cuboid_up_slope"))
    assert evaluator.joint_names == ("panda_finger_joint1",)
    assert evaluator.evaluate([0.02502]).found
    answer = evaluator.evaluate({"panda_finger_joint1": 0.05})
    assert answer.status is StateStatus.OUTSIDE_LIMITS
    assert "panda_finger_joint1" in answer.reason
    with pytest.raises(ArgumentError, match="mimics"):
        evaluator.evaluate({"panda_finger_joint2": 0.01})


def test_a_hybrid_finger_with_several_contacts_is_an_answer(tmp_path):
    scene = with_hybrid_finger("trihand_push_box", tmp_path)
    evaluator = Evaluator(scene)
    assert "finger_1.normal_force" in evaluator.evaluate().joint_names
    first = scene.contacts.points[0]
    beside = GivenContact(first.body, first.position + np.array([0, 0.005, 0]), first.normal)
    given = (GivenContact(first.body, first.position, first.normal), beside)
    answer = Evaluator(scene.with_changes(given_contacts=given)).evaluate()
    assert answer.status is StateStatus.AMBIGUOUS
    assert "finger_1" in answer.reason


def test_a_limit_that_ends_the_search_leaves_it_undecided():
    scene = example("paper/cuboid_at_rest")
    evaluator = Evaluator(scene, algorithm="torque", node_limit=1)
    answer = evaluator.evaluate()
    assert answer.status is StateStatus.UNDECIDED
    assert "limit" in answer.reason


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"q": {"thumb": 0.1}}, "unknown joint 'thumb'; known: finger_1_spread"),
        ({"q": [0.1, 0.2]}, r"q: has shape \(2,\); expected \(9,\)"),
        ({"q": {"finger_1_distal": np.nan}}, "NaN"),
        ({"q": "home"}, "real numbers"),
        ({"T_world_object": np.eye(3)}, "T_world_object"),
        ({"T_world_object": 2.0 * np.eye(4)}, "T_world_object"),
        ({"T_world_object": np.diag([2.0, 1.0, 1.0, 1.0])}, "not orthonormal"),
        ({"twist": [0.0, 1.0]}, r"twist: has shape \(2,\)"),
        ({"twist": [np.inf] * 6}, "twist: is inf"),
    ],
)
def test_bad_input_is_an_error(arguments, message):
    evaluator = Evaluator(example("trihand_push_box"))
    for ask in (evaluator.evaluate, evaluator.is_feasible, evaluator.scene_at):
        with pytest.raises(ArgumentError, match=message):
            ask(**arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"algorithm": "both"}, "algorithm: is 'both'"),
        ({"margin": -1.0}, "^margin: is -1.0"),
        ({"scale": "limits"}, "^scale: has no effect with algorithm 'margin'"),
        ({"margn": 0.2}, "^margn: is not an option; did you mean 'margin'"),
        ({"scale": "big", "algorithm": "torque"}, "scale: is 'big'"),
        ({"sign_rule": "any"}, "sign_rule: is 'any'"),
        ({"regularization": -1.0}, "regularization: is -1.0"),
        ({"node_limit": 0}, "node_limit: is 0"),
        ({"time_limit": -1.0}, "time_limit: is -1.0"),
        ({"collisions": "no"}, "collisions: is 'no'; it must be True or False"),
        ({"need_hand": None}, "need_hand: is None"),
        ({"position_limits": 0}, "position_limits: is 0"),
    ],
)
def test_bad_options_are_errors(options, message):
    with pytest.raises(ArgumentError, match=message):
        Evaluator(example("trihand_push_box"), **options)


def test_other_bad_ones():
    with pytest.raises(ArgumentError, match="must be a Scene"):
        Evaluator("scene.yaml")  # pyright: ignore[reportArgumentType]
    with pytest.raises(SolverUnavailableError, match="'cplex' is unknown or not installed"):
        Evaluator(example("trihand_push_box"), solver="cplex")
    with pytest.raises(ArgumentError, match=r"margin: is -0\.5"):
        Evaluator(example("trihand_push_box")).is_feasible(margin=-0.5)
    scene = example("trihand_push_box").with_changes(
        friction={"hand": 0.5}, name="nothing touches, overlap by", path=None
    )
    with pytest.raises(SceneError, match="no coefficient for 'table'"):
        Evaluator(scene).evaluate()


def test_threads_share_an_evaluator():
    evaluator = Evaluator(example("allegro_tumble_box"), algorithm="margin")
    rng = np.random.default_rng(6)
    states = [nearby(evaluator, rng, 0.01) for _ in range(16)]
    alone = [Evaluator(evaluator.scene, algorithm="margin").evaluate(q).margin for q in states]
    middle = 0.5 * (min(alone) + max(alone))
    with ThreadPoolExecutor(4) as pool:
        held = [pool.submit(evaluator.is_feasible, q, margin=middle) for q in states]
        together = list(pool.map(lambda q: evaluator.evaluate(q).margin, states))
    np.testing.assert_allclose(together, alone, atol=1e-6)
    assert [item.result() for item in held] == [margin >= middle for margin in alone]
    assert min(alone) < middle - 1e-4


@pytest.mark.parametrize("name", ["trihand_push_box", "allegro_mug_against_wall"])
def test_it_survives_pickling(name):
    evaluator = Evaluator(example(name), algorithm="torque", margin=0.2)
    before = evaluator.evaluate()
    other = pickle.loads(pickle.dumps(evaluator))  # noqa: S301 - our own bytes
    assert other.required_margin == 0.2
    np.testing.assert_allclose(other.evaluate().torques, before.torques, atol=1e-8)


def test_without_a_proof_a_state_is_not_called_feasible(monkeypatch):
    monkeypatch.setattr(
        "graspless_pin.planning.state_solver.reaches_margin", lambda *_, **__: (None, None)
    )
    assert not Evaluator(example("trihand_push_box")).is_feasible(margin=0.0)


def test_an_earlier_mode_proves_what_a_search_would():
    """After the search of one state its mode decides the next within two programs."""
    scene = example("allegro_tumble_box")
    evaluator = Evaluator(scene, algorithm="margin")
    first, again = evaluator.evaluate(), evaluator.evaluate()
    assert again.solution.certificate.force_programs <= 2
    assert again.margin == pytest.approx(first.margin, abs=1e-8)


def test_states_by_directions_are_solved_each_by_itself():
    """No state's answer is carried over: where an answer has a gap, two searches may differ."""
    scene = example("paper/cuboid_at_rest")
    options: dict[str, Any] = {"sign_rule": "direction", "direction_gap": 1e-3}
    evaluator = Evaluator(scene, algorithm="torque", margin=0.1, **options)
    expected = scene.solve("torque", margin=0.1, **options)
    for _ in range(2):
        solution = evaluator.evaluate().solution
        assert solution is not None
        assert solution.max_torque == expected.max_torque
        assert solution.rules.by_direction
    most = scene.solve("margin", **options).margin
    assert evaluator.is_feasible(margin=0.999 * most)
    assert not evaluator.is_feasible(margin=1.01 * most)
