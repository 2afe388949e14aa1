"""An object that a hand carries along, against problems that are put together for each state."""

import json
import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
from planning_scenes import example, solved_alone

from graspless_pin import (
    Evaluator,
    QuasistaticProblem,
    Waypoint,
    evaluate_path,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.errors import ArgumentError, StateError
from graspless_pin.planning import StateStatus, state_loops
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.scene import Acceleration, Load
from graspless_pin.scene.stated import GivenContact, Motion

ARM = tuple(f"panda_joint{k}" for k in range(1, 8))
GRIP = "panda_finger_joint1"


@cache
def bar(*, force: bool = False) -> Any:
    """The bar that a Panda carries; whether torques of the arm are asked for, too."""
    scene = example("panda_carry_bar")
    if not force:
        return scene
    hand, mounts = scene.hand, scene.hand.mounts
    own = type(hand).assemble(mounts, q=hand.q, control={"arm": "force"})
    return scene.with_changes(hand=own)


def drawn(evaluator: Evaluator, count: int, seed: int) -> np.ndarray:
    """Configurations that are uniform within the limits."""
    lower, upper = evaluator.joint_limits
    return np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))


def problem_at(scene: Any, q: np.ndarray) -> QuasistaticProblem:
    """The problem in a state: contacts and their frames turned and shifted as the hand is."""
    hand = scene.hand.with_configuration(dict(zip(ARM, q.tolist(), strict=True)))
    there, here = (one.pose_of("panda_hand") for one in (scene.hand, hand))
    move = here @ np.linalg.inv(there)
    R, own, start = move[:3, :3], scene.contacts.arrays, scene.problem()
    points = own.positions @ R.T + move[:3, 3]
    center = R @ scene.object.center_of_mass_world + move[:3, 3]
    weight = scene.object.mass * scene.gravity
    return QuasistaticProblem(
        points - center, own.normals @ R.T, [*weight, 0.0, 0.0, 0.0],
        hand.contact_jacobian(own.bodies, points),
        friction=start.friction, tangents=R @ start.tangents,
        torque_limits=hand.effort_limits, max_normal_force=scene.max_normal_force,
        joint_names=hand.actuated_joint_names, joint_units=hand.effort_units,
        gravity_torques=hand.gravity_torques(scene.gravity),
    )  # fmt: skip


@pytest.mark.parametrize("force", [False, True], ids=["gripper", "gripper and arm"])
@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_states_are_those_of_the_same_contacts_moved_along(algorithm, force):
    scene = bar(force=force)
    evaluator = Evaluator(
        scene, attached_to="panda_hand", algorithm=algorithm, collisions=False, margin=0.5
    )
    q = drawn(evaluator, 30, 1)
    solve = maximize_margin if algorithm == "margin" else minimize_torque

    found = evaluator.evaluate_many(q, workers=1)

    for k in range(len(q)):
        options: Any = {} if algorithm == "margin" else {"margin": 0.5}
        expected = solve(problem_at(scene, q[k]), **options)
        assert expected.found == found.found[k]
        if not expected.found:
            assert found.statuses[k] is StateStatus.INFEASIBLE
            continue
        assert found.bounds[k] == pytest.approx(expected.certificate.bound, rel=1e-7, abs=2e-7)
        assert found.residuals[k] <= 1e-7
        if algorithm == "margin":
            assert found.margins[k] == pytest.approx(expected.margin, abs=1e-8)
        else:
            most = np.abs(found.torques[k]).max()
            assert most == pytest.approx(expected.max_torque, abs=1e-8)
    assert found.found.sum() > 20
    assert found.torque_names == ((*ARM, GRIP) if force else (GRIP,))


def test_margins_are_those_of_contacts_that_are_found_anew():
    evaluator = Evaluator(bar(), attached_to="panda_hand")
    q = drawn(evaluator, 60, 2)

    found = evaluator.evaluate_many(q, workers=1)

    alike = 0
    for k in np.flatnonzero(found.found)[:30]:
        there = evaluator.scene_at(q[k])
        if there.contacts.bodies == evaluator.scene.contacts.bodies:  # else it leans on something
            alike += 1
            assert found.margins[k] == pytest.approx(there.solve("margin").margin, abs=1e-5)
    assert alike > 15


def test_a_whole_answer_is_in_world_axes_and_verified():
    """Where the arm is under force control, too, as the states' loop has it out of J."""
    scene = bar(force=True)
    for algorithm in ("margin", "torque"):
        evaluator = Evaluator(
            scene, attached_to="panda_hand", algorithm=algorithm, collisions=False
        )
        for q in drawn(evaluator, 4, 3):
            answer = evaluator.evaluate(q)
            if not answer.found:
                continue
            problem, expected = answer.solution.problem, problem_at(scene, q)
            np.testing.assert_allclose(problem.jacobian, expected.jacobian, atol=1e-12)
            np.testing.assert_allclose(problem.positions, expected.positions, atol=1e-12)
            np.testing.assert_allclose(answer.scene.problem().normals, problem.normals, atol=1e-12)
            forces = answer.solution.contact_forces.ravel()
            assert problem.W @ forces == pytest.approx(-problem.external_wrench, abs=1e-6)
            assert answer.torques == pytest.approx(
                expected.jacobian.T @ forces + expected.gravity_torques, abs=1e-6
            )
            document = json.loads(json.dumps(solution_document(answer.solution, answer.scene)))
            assert verify_document(document).passed
            many = evaluator.evaluate_many(q[None], workers=1)
            assert many.bounds[0] == pytest.approx(answer.solution.certificate.bound, abs=2e-7)


def test_the_arm_bears_itself_and_the_object_whatever_the_grip():
    """Torques are the slopes of the potential energy."""
    evaluator = Evaluator(bar(force=True), attached_to="panda_hand", collisions=False)
    q, step = drawn(evaluator, 40, 4), 1e-5

    states = evaluator.evaluate_many(q, workers=1)

    for k in np.flatnonzero(states.found)[:5]:
        hand = evaluator.scene_at(q[k]).hand
        assert hand is not None
        own = hand.gravity_torques(evaluator.scene.gravity)[:7]
        for joint in range(7):
            ends = [q[k] + sign * step * np.eye(7)[joint] for sign in (1.0, -1.0)]
            high, low = (
                evaluator.scene_at(end).object.center_of_mass_world[2]
                for end in np.clip(ends, *evaluator.joint_limits)
            )
            slope = 0.4 * 9.81 * (high - low) / (2.0 * step)
            assert states.torques[k, joint] - own[joint] == pytest.approx(slope, abs=1e-6)


def test_a_grip_about_the_middle_by_hand():
    """Gravity turns from along the pads to across them as the last joint turns.

    Along them friction bears the weight, 0.6 of the squeeze; across them one pad does by itself.
    In between the pads bear different loads, and the moment of that as long as it is small.
    """
    scene = bar()
    middle = np.array(scene.object.T_world_object)
    middle[:3, 3] = [0.45, 0.0, 0.25]
    scene = scene.with_changes(object=scene.object.with_pose(middle))
    evaluator = Evaluator(
        scene, attached_to="panda_hand", algorithm="torque", margin=0.0, collisions=False
    )
    level = {"panda_joint6": 2.3113407 - 0.5 * np.pi}
    for turn in (0.0, 0.1, 0.39, 0.5 * np.pi):
        state = evaluator.evaluate({**level, "panda_joint7": 0.7853982 + turn})
        weight = 0.4 * 9.81
        across, along = weight * np.sin(turn), weight * np.cos(turn) / 0.6
        assert state.torques == pytest.approx([-max(across, along)], abs=1e-5)


def test_states_that_are_refused_and_those_that_a_planner_checks():
    evaluator = Evaluator(bar(), attached_to="panda_hand")
    q = evaluator.configuration()
    outside, low, deep, beside = (q.copy() for _ in range(4))
    outside[0] = 9.0
    low[1], deep[1] = 0.2, 0.6  # the bar is in the table; and the hand, too
    beside[0] = 0.9  # the bar is in the box
    states = np.array([q, outside, low, deep, beside])

    found = evaluator.evaluate_many(states)

    assert found.statuses.tolist() == [
        StateStatus.FOUND,
        StateStatus.OUTSIDE_LIMITS,
        StateStatus.OVERLAP,
        StateStatus.HAND_THROUGH_SUPPORT,
        StateStatus.OVERLAP,
    ]
    assert "object 'bar' and 'table' overlap by" in evaluator.evaluate(low).reason
    assert "object 'bar' and 'box' overlap by" in evaluator.evaluate(beside).reason
    for state, status in zip(states, found.statuses, strict=True):
        assert evaluator.evaluate(state).status is status
        assert evaluator.is_feasible(state) == (status is StateStatus.FOUND)
    unchecked = Evaluator(bar(), attached_to="panda_hand", collisions=False)
    assert unchecked.are_feasible(states).tolist() == [True, False, True, True, True]


def test_feasible_states_are_those_whose_margin_reaches():
    evaluator = Evaluator(bar(), attached_to="panda_hand", collisions=False)
    q = drawn(evaluator, 40, 5)
    margins = evaluator.evaluate_many(q, workers=1).margins
    for margin in np.quantile(margins, [0.3, 0.7]).tolist():
        expected = margins >= margin
        np.testing.assert_array_equal(evaluator.are_feasible(q, margin=margin), expected)
        for k in range(0, len(q), 8):
            assert evaluator.is_feasible(q[k], margin=margin) == expected[k]


def test_most_states_of_a_path_are_answered_by_loops(monkeypatch):
    """And without loops, with round cones or after a process was asked they are the same."""
    evaluator = Evaluator(bar(), attached_to="panda_hand", collisions=False)
    rng = np.random.default_rng(6)
    steps = rng.normal(0.0, 0.01, (60, 7)).cumsum(axis=0)
    q = np.clip(evaluator.configuration() + steps, *evaluator.joint_limits)
    alone = solved_alone(monkeypatch)
    found = evaluator.evaluate_many(q, workers=1)
    assert found.found.all()
    assert len(alone) <= 20
    elsewhere = pickle.loads(pickle.dumps(evaluator))  # noqa: S301 - its own
    np.testing.assert_allclose(elsewhere.evaluate_many(q[:9]).margins, found.margins[:9], atol=1e-8)
    monkeypatch.setattr(state_loops, "core", None)
    without = Evaluator(bar(), attached_to="panda_hand", collisions=False)
    np.testing.assert_allclose(without.evaluate_many(q[:9]).margins, found.margins[:9], atol=1e-8)
    assert without.is_feasible(q[0], margin=1.0)
    smooth = Evaluator(bar().with_changes(cone="round"), attached_to="panda_hand", collisions=False)
    assert (smooth.evaluate_many(q[:3]).margins >= found.margins[:3] - 1e-6).all()


def test_stated_contacts_move_along():
    scene = bar()
    given = [GivenContact(one.body, one.position, one.normal) for one in scene.contacts.points]
    stated = Evaluator(
        scene.with_changes(given_contacts=given), attached_to="panda_hand", collisions=False
    )
    found = Evaluator(scene, attached_to="panda_hand", collisions=False)
    for q in drawn(found, 3, 7):
        there = stated.scene_at(q)
        assert there.solve("margin").margin == pytest.approx(found.evaluate(q).margin, abs=1e-7)
        assert stated.evaluate(q).margin == pytest.approx(found.evaluate(q).margin, abs=1e-7)


def test_rest_is_judged_where_the_object_is():
    evaluator = Evaluator(bar(), attached_to="panda_hand", stability="strong", collisions=False)
    state = evaluator.evaluate({"panda_joint6": 2.0})
    there = evaluator.scene_at({"panda_joint6": 2.0}).solve("margin", stability="strong")
    assert (state.found, state.solution.status) == (there.found, there.status)
    if there.found:
        assert state.margin == pytest.approx(there.margin, abs=1e-5)


@pytest.mark.parametrize(
    ("changes", "link", "message"),
    [
        ({}, "panda_hnd", "attached_to: unknown link 'panda_hnd'; .*panda_hand"),
        ({}, "panda_link0", "attached_to: link 'panda_link0' does not move with any joint"),
        ({}, "panda_leftfinger", "link 'panda_rightfinger' touches the object and does not move"),
        ({"hand": None}, "panda_hand", "attached_to: requires a hand, but the scene has none"),
        ({"motion": Motion(np.eye(6)[0])}, "panda_hand", "attached_to: the scene declares a mot"),
    ],
)
def test_what_cannot_carry_is_refused(changes, link, message):
    with pytest.raises(ArgumentError, match=message):
        Evaluator(bar().with_changes(**changes), attached_to=link)


def test_an_object_that_leans_on_something_is_refused():
    scene = example("panda_arm_drag_board").with_changes(motion=None)
    with pytest.raises(ArgumentError, match=r"support 'table' touches the object and does not"):
        Evaluator(scene, attached_to="panda_hand")
    away = scene.object.with_pose(np.diag([1.0, 1.0, 1.0, 1.0]) + 9.0 * np.eye(4, k=3))
    with pytest.raises(StateError, match="nothing touches object 'board'"):
        Evaluator(scene.with_changes(object=away, supports=()), attached_to="panda_hand")


def test_what_a_state_cannot_be_told_is_refused():
    evaluator = Evaluator(bar(), attached_to="panda_hand")
    assert evaluator.joint_names == ARM
    assert [len(limit) for limit in evaluator.joint_limits] == [7, 7]
    q, T = evaluator.configuration(), evaluator.scene.object.T_world_object
    for call in (evaluator.evaluate, evaluator.scene_at, evaluator.is_feasible):
        with pytest.raises(
            ArgumentError, match="T_world_object: is not supported, as the object moves with link"
        ):
            call(q, T)
        with pytest.raises(
            ArgumentError, match="twist: is not supported, as the object moves with link"
        ):
            call(q, None, np.zeros(6))
    for many in (evaluator.evaluate_many, evaluator.are_feasible):
        with pytest.raises(
            ArgumentError, match="T_world_object: is not supported, as the object moves with link"
        ):
            many(q[None], T)
    with pytest.raises(ArgumentError, match="'panda_finger_joint1' belongs to the grip"):
        evaluator.evaluate({GRIP: 0.03})
    with pytest.raises(ArgumentError, match="unknown joint 'elbow'"):
        evaluator.evaluate({"elbow": 0.03})
    with pytest.raises(ArgumentError, match=r"q: has shape \(8,\); expected \(7,\)"):
        evaluator.evaluate(np.zeros(8))
    with pytest.raises(ArgumentError, match="evaluator: is attached_to link 'panda_hand'"):
        evaluate_path(evaluator, [Waypoint()])


BEARING: dict[str, dict[str, Any]] = {
    "a payload at the middle": {"loads": [Load("bag", mass=0.1)]},
    "payloads in a field": {
        "loads": [Load("bag", mass=0.05, at=[0.15, 0.0, 0.0]), Load("wind", field=[0.5, 0.2, 0.0])]
    },
    "a tool's reaction and a cable": {
        "loads": [
            Load("tool", force=[0.1, 0.0, -1.0], at=[0.1, 0.0, 0.0], axes="object"),
            Load("cable", force=[0.3, 0.0, 0.5], moment=[0.0, 0.01, 0.0], at=[0.0, 0.01, 0.01]),
        ]
    },
    "a base that turns": {
        "acceleration": Acceleration([0.5, 0.0, 0.2], [0.1, 0.4, 0.2], [0.5, 0.3, 0.1], [0, 0, 1])
    },
    "an object that accelerates alone": {
        "acceleration": Acceleration([0.5, 0.0, 0.2], [0.1, 0.4, 0.2], of="object")
    },
    "an arm that stops with a payload": {
        "acceleration": Acceleration(
            angular=[0.0, 0.0, 0.2],
            joint_velocities={ARM[0]: 1.0, ARM[3]: -0.5},
            joint_accelerations={ARM[1]: -2.0, ARM[4]: 1.0},
        ),
        "loads": [Load("bag", mass=0.05, at=[0.15, 0.0, 0.0])],
    },
}


@pytest.mark.parametrize("force", [False, True], ids=["gripper", "gripper and arm"])
@pytest.mark.parametrize("name", BEARING)
def test_loads_bear_on_a_carried_object(name, force, monkeypatch):
    """In loops, as on the scene in each state with the same contacts moved along."""
    scene = bar(force=force).with_changes(supports=(), **BEARING[name])
    evaluator = Evaluator(scene, attached_to="panda_hand", algorithm="margin", collisions=False)
    alone = solved_alone(monkeypatch)
    turns = np.random.default_rng(5).normal(0.0, 0.3, (4, 7))
    steps = np.concatenate([turn * np.linspace(0.0, 1.0, 5)[:, None] for turn in turns])
    q = np.clip(evaluator.configuration() + steps, *evaluator.joint_limits)

    found = evaluator.evaluate_many(q, workers=1)

    assert found.found.all()
    assert len(alone) < len(q) / 2
    for k in range(len(q)):
        there = evaluator.scene_at(q[k]).problem()
        problem = problem_at(bar(force=force), q[k]).with_changes(
            external_wrench=there.external_wrench, gravity_torques=there.gravity_torques
        )
        expected = maximize_margin(problem)
        assert found.margins[k] == pytest.approx(expected.margin, rel=1e-9, abs=5e-9)
        forces = expected.contact_forces.ravel()
        arm = slice(0, 7 if force else 0)  # what it bears is the same with any grip
        expected_torques = problem.jacobian.T @ forces + problem.gravity_torques
        np.testing.assert_allclose(found.torques[k, arm], expected_torques[arm], atol=1e-6)


def test_validity_and_motions_of_a_carried_object():
    evaluator = Evaluator(bar(), attached_to="panda_hand", margin=4.0)
    free, there = {"panda_joint1": 0.3}, {"panda_joint1": 0.9}
    good, bad = evaluator.validity(free), evaluator.validity(there)
    assert good.valid and good.margin == pytest.approx(evaluator.evaluate(free).margin, abs=1e-6)
    assert bad.reasons == (StateStatus.OVERLAP,) and "'bar' and 'box' overlap" in bad.message
    assert evaluator.validity({"panda_joint1": 99.0}).reasons[0] is StateStatus.OUTSIDE_LIMITS
    assert evaluator.is_valid_motion({}, free)
    fault = evaluator.first_invalid({}, {"panda_joint1": 0.9, "panda_joint7": 0.8})
    assert fault is not None and fault.last_valid is not None
    ways = np.linspace(
        evaluator.configuration(), evaluator.configuration({**there, "panda_joint7": 0.8}), 400
    )
    valid = evaluator.are_feasible(ways, workers=1)
    assert fault.fraction == pytest.approx(int(np.argmin(valid)) / 399, abs=0.02)
    with pytest.raises(ArgumentError, match="q alone determines its pose"):
        evaluator.is_valid_motion({}, free, T1_world_object=np.eye(4))
    with pytest.raises(ArgumentError, match="not supported together with attached_to"):
        Evaluator(bar(), attached_to="panda_hand", pins=[("panda_leftfinger", "bar")])


def test_joints_may_be_let_outside_their_limits():
    evaluator = Evaluator(bar(), attached_to="panda_hand", position_limits=False, collisions=False)
    assert evaluator.evaluate({"panda_joint1": 3.1}).found
