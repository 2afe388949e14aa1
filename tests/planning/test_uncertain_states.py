"""States of scenes of which not all is known exactly, against each one's scene, made anew."""

import pickle
from typing import Any

import numpy as np
import pytest
from planning_scenes import example, nearby, shifted
from tests.oracles.uncertain_members import BALANCED, unbalanced

from graspless_pin import Coverage, Evaluator, Uncertainty, Waypoint, evaluate_path
from graspless_pin.errors import ArgumentError
from graspless_pin.planning import StateStatus, configuration_gradient

MUG, BAR, BOX = "allegro_mug_against_wall", "panda_carry_bar", "trihand_push_box"
BALL = "allegro_sphere_on_slope"
FIGURES = {"mass": 0.2, "center_of_mass": 0.005, "friction": 0.1}
UNKNOWN = Uncertainty(**FIGURES)
COULOMB: dict[str, Any] = {"static_friction": "coulomb"}


def states_of(evaluator: Evaluator, count: int, spread: float) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.array([nearby(evaluator, rng, spread) for _ in range(count)])


@pytest.mark.parametrize(
    ("name", "carrier", "spread"), [(MUG, None, 0.001), (BAR, "panda_hand", 0.2)]
)
def test_states_are_those_of_their_scenes(name: str, carrier: str | None, spread: float) -> None:
    evaluator = Evaluator(
        example(name), attached_to=carrier, uncertainty=UNKNOWN, algorithm="margin", **COULOMB
    )
    q = states_of(evaluator, 12, spread)
    states = evaluator.evaluate_many(q, evaluations=[0])
    found, whole = np.flatnonzero(states.found).tolist(), states.evaluations[0]
    assert len(found) >= 10
    assert set(states.coverages[found]) == {Coverage.WHOLE_SET}
    assert whole.robust is not None and len(whole.robust.members) >= 8
    assert states.contact_counts[0] == len(whole.contacts.bodies)
    np.testing.assert_allclose(states.bounds[found], states.margins[found], rtol=1e-6)
    np.testing.assert_array_equal(states.torques[0], whole.torques)
    middle = float(np.median(states.margins[found]))
    feasible, compared = evaluator.are_feasible(q, margin=middle), 0
    for number in found:
        scene = evaluator.scene_at(q[number])
        if scene.contacts.bodies != whole.contacts.bodies:
            continue  # the bar touches something, which bears nothing in the evaluator
        compared += 1
        anew = scene.solve("margin", uncertainty=UNKNOWN, **COULOMB)
        assert states.margins[number] == pytest.approx(anew.margin, rel=1e-7)
        assert feasible[number] == (anew.margin >= middle * (1.0 - 1e-8))
    assert compared >= 8 and 0 < feasible.sum() < len(found)
    good = q[int(np.argmax(feasible))]
    for margin, holds in ((middle, True), (1.1 * states.margins.max(), False)):
        told = evaluator.validity(good, margin=margin)
        assert told.valid == evaluator.is_feasible(good, margin=margin) == holds
        assert told.reasons == (() if holds else (StateStatus.BELOW_MARGIN,))


def test_of_balls_what_is_proven_counts_and_not_the_bound() -> None:
    """Affine forces serve less than no torques are better than."""
    unknown = Uncertainty(mass=0.1, center_of_mass=0.005, force_radius=0.3)
    evaluator = Evaluator(example(MUG), uncertainty=unknown, algorithm="margin", **COULOMB)
    told = evaluator.scene.solve("margin", uncertainty=unknown, **COULOMB)
    assert told.policy is not None and told.margin < 0.999 * told.bound
    assert evaluator.scene.hand is not None
    q = [evaluator.scene.hand.q[name] for name in evaluator.joint_names]
    states, between = evaluator.evaluate_many([q]), 0.5 * (told.margin + told.bound)
    assert states.margins[0] == pytest.approx(told.margin, rel=1e-6)
    assert states.gaps[0] == pytest.approx(told.bound - told.margin, rel=1e-3)
    assert states.residuals[0] == pytest.approx(told.policy.residual(), abs=1e-7)
    np.testing.assert_allclose(states.torques[0], told.torques, atol=1e-6)
    for margin, feasible in ((0.999 * told.margin, True), (between, False)):
        assert evaluator.is_feasible(q, margin=margin) == feasible
        assert evaluator.validity(q, margin=margin).valid == feasible


def test_members_of_a_state_are_in_balance() -> None:
    evaluator = Evaluator(
        example(MUG), uncertainty=UNKNOWN, algorithm="torque", margin=0.05, **COULOMB
    )
    state = evaluator.evaluate(states_of(evaluator, 1, 0.001)[0])
    assert state.robust is not None
    assert max(unbalanced(state.scene, FIGURES, state.robust, 200, 4)) <= BALANCED


def test_modes_of_earlier_states_change_no_answer() -> None:
    given: dict[str, Any] = {"uncertainty": UNKNOWN, "attached_to": "panda_hand"}
    evaluator = Evaluator(example(BAR), **given)
    q = states_of(evaluator, 4, 0.2)
    margins = Evaluator(example(BAR), **given).evaluate_many(q).margins
    middle = float(np.median(margins))
    expected = (margins >= middle).tolist()
    assert True in expected and False in expected
    for order in (range(4), reversed(range(4))):
        for number in order:
            assert evaluator.is_feasible(q[number], margin=middle) == expected[number]
    again = pickle.loads(pickle.dumps(evaluator))  # noqa: S301 - our own
    assert again.are_feasible(q, margin=middle).tolist() == expected
    assert again.uncertainty.mass == UNKNOWN.mass


@pytest.mark.parametrize(
    ("name", "given", "spread"),
    [
        (MUG, COULOMB, 0.001),
        (BAR, {"attached_to": "panda_hand"}, 0.2),
        (BALL, COULOMB, 0.001),
    ],
)
def test_earlier_torques_prove_margins_and_no_more(
    name: str, given: dict[str, Any], spread: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With what one state has taught, others are known to reach a margin without a search."""
    scene = example(name)
    if name == BALL:
        scene = scene.with_changes({"controller": {"stiffness": 1.0}})
    given = {"uncertainty": Uncertainty(mass=0.1, center_of_mass=0.002), **given}
    evaluator, other = Evaluator(scene, **given), Evaluator(scene, algorithm="margin", **given)
    q = states_of(evaluator, 4, spread)
    margins = other.evaluate_many(q).margins
    assert evaluator.is_feasible(q[0], margin=margins[0])

    def searched(*_: Any, **__: Any) -> None:
        raise AssertionError

    with monkeypatch.context() as patched:
        patched.setattr("graspless_pin.planning.uncertain_states.solve_uncertain", searched)
        for number in range(1, 4):
            assert evaluator.is_feasible(q[number], margin=0.7 * margins[number])
            with pytest.raises(AssertionError):
                evaluator.is_feasible(q[number], margin=1.001 * margins[number])
    for number in range(1, 4):
        for share, feasible in ((0.999, True), (1.001, False)):
            asked = share * margins[number]
            assert evaluator.is_feasible(q[number], margin=asked) == feasible


def test_a_known_scene_is_the_set_of_itself() -> None:
    exact = Evaluator(example(BAR), attached_to="panda_hand", **COULOMB)
    uncertain = Evaluator(
        example(BAR), attached_to="panda_hand", uncertainty=Uncertainty(), **COULOMB
    )
    q = states_of(exact, 5, 0.2)
    states = uncertain.evaluate_many(q)
    np.testing.assert_allclose(states.margins, exact.evaluate_many(q).margins, rtol=1e-7)
    assert set(exact.evaluate_many(q).coverages) == {None}


def test_motions_and_paths_are_for_the_whole_set() -> None:
    """Three fingers push a box up a slope, with the stiffness of their joints."""
    scene = example("trihand_slide_and_pivot").with_changes({"controller": {"stiffness": 5.0}})
    unknown = Uncertainty(mass=0.1, center_of_mass=0.002)
    evaluator = Evaluator(scene, uncertainty=unknown)
    T0, q0 = scene.object.T_world_object, evaluator.configuration()
    way = 0.02 * T0[:3, 0]
    T1, q1 = shifted(T0, way), q0.copy()
    q1[:2] += way[[0, 2]]  # the hand's carriage goes along
    found = evaluator.motion_margins(q0, q1, T0, T1)
    twist = [*way, 0.0, 0.0, 0.0]
    ends = [
        evaluator.scene_at(q, pose, twist).solve("margin", uncertainty=unknown).margin
        for q, pose in ((q0, T0), (q1, T1))
    ]
    np.testing.assert_allclose(found.margins[[0, -1]], ends, rtol=1e-7)
    assert (found.margins < Evaluator(scene).motion_margins(q0, q1, T0, T1).margins).all()
    for share, valid in ((0.9, True), (1.1, False)):
        asked = share * found.smallest
        assert evaluator.is_valid_motion(q0, q1, T0, T1, margin=asked) == valid
        assert (evaluator.first_invalid(q0, q1, T0, T1, margin=asked) is None) == valid
    profile = evaluate_path(evaluator, [Waypoint(q0, T0), Waypoint(q1, T1)])
    np.testing.assert_allclose(profile.margins, ends, rtol=1e-3)
    assert all(one.robust is not None for one in profile.evaluations)


def test_a_set_that_nothing_serves_is_an_answer_among_many() -> None:
    """It has no value, and so no gap: to ask for one ended all states of the call."""
    evaluator = Evaluator(
        example(BOX), uncertainty=Uncertainty(force=20.0), algorithm="margin", **COULOMB
    )  # N; the box weighs 9.81 N

    states = evaluator.evaluate_many([{}, {}], evaluations=[1])

    assert states.statuses.tolist() == [StateStatus.INFEASIBLE] * 2
    assert states.margins.tolist() == [-np.inf] * 2 and np.isnan(states.gaps).all()
    assert np.isnan(states.torques).all() and (states.contact_counts > 0).all()


def test_a_scene_says_what_is_not_known_and_where_nothing_serves_it() -> None:
    scene = example(BOX).with_changes(uncertainty=Uncertainty(mass=0.2))
    state = Evaluator(scene, uncertainty=True, **COULOMB).evaluate()
    assert state.status is StateStatus.INFEASIBLE and state.robust is not None
    assert "no torques are feasible for all of these members:" in state.reason
    assert Evaluator(scene, **COULOMB).evaluate().found
    stiff = scene.with_changes({"controller": {"stiffness": 1.0}})
    held = Evaluator(stiff, uncertainty=True, **COULOMB).evaluate()
    assert held.found and held.robust is not None and held.robust.feedback is not None
    with pytest.raises(ArgumentError, match="for which gradients by the joints are not available"):
        configuration_gradient(held)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"uncertainty": True}, "has no uncertainty; give"),
        ({"uncertainty": 0.2}, "give an Uncertainty"),
        ({"uncertainty": UNKNOWN, "stability": "strong"}, "stability: is 'strong'"),
        (
            {"uncertainty": UNKNOWN, "pins": [("finger_1_tip", "object")]},
            "pins: are not supported together",
        ),
        ({"uncertainty": Uncertainty(friction=[0.1, 0.2])}, "friction: is given for each contact"),
        ({"uncertainty": Uncertainty(friction={"wal": 0.2})}, "friction"),
        ({"uncertainty": Uncertainty(center_of_mass=2.0)}, "center_of_mass may be off"),
    ],
)
def test_what_is_not_served_is_refused(given: dict[str, Any], told: str) -> None:
    with pytest.raises(ArgumentError, match=told):
        Evaluator(example(BOX), **given)
