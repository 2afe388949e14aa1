"""Many states at once against `evaluate` for each of them."""

import os
import signal
from typing import Any, cast

import numpy as np
import pytest
from planning_scenes import example, nearby, shifted, solved_alone, with_hybrid_finger

from graspless_pin import Margin, SolveOptions, compiled, load_scene
from graspless_pin.errors import ArgumentError, CrashError
from graspless_pin.planning import Evaluator, StateStatus, many_states
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.scene import batch_states
from graspless_pin.scene.contact_arrays import touching_of
from graspless_pin.scene.stated import HandMotion, Motion


def varied(count: int, seed: int = 0) -> tuple[Evaluator, dict[str, Any]]:
    """A pushed box in good states and in all kinds of bad ones."""
    evaluator = Evaluator(example("trihand_push_box"))
    rng = np.random.default_rng(seed)
    q = np.array([nearby(evaluator, rng, 0.002) for _ in range(count)])
    q[3::12, 0] = 9.0
    T = evaluator.scene.object.T_world_object
    steps = rng.normal(0.0, 2e-5, (count, 3))
    steps[4::12] = [0.0, 0.0, 1.0]
    steps[5::12] = [0.0, 0.0, -0.02]
    steps[8::12] = [0.05, 0.0, 0.0]
    twists = np.tile([0.05, 0.0, 0.0, 0.0, 0.0, 0.0], (count, 1))
    twists[6::12] = [0.0, 0.0, -0.1, 0.0, 0.0, 0.0]
    twists[7::12] = 0.0
    poses = np.array([shifted(T, step) for step in steps])
    return evaluator, {"q": q, "T_world_object": poses, "twist": twists}


@pytest.mark.parametrize("need_hand", [True, False])
def test_each_state_is_what_evaluate_finds(need_hand):
    evaluator, states = varied(36)
    evaluator = Evaluator(evaluator.scene, need_hand=need_hand)
    alone = Evaluator(evaluator.scene, need_hand=need_hand)

    found = evaluator.evaluate_many(**states, evaluations=[0, 5])

    assert set(found.statuses) == {
        StateStatus.FOUND, StateStatus.NO_CONTACT, StateStatus.OVERLAP, StateStatus.BLOCKED,
        StateStatus.OUTSIDE_LIMITS,
        StateStatus.HAND_TOUCHES_NOTHING if need_hand else StateStatus.INFEASIBLE,
    }  # fmt: skip
    for k in range(36):
        answer = alone.evaluate(**{name: values[k] for name, values in states.items()})
        assert found.statuses[k] is answer.status
        assert found.margins[k] == pytest.approx(answer.margin, abs=1e-9)
        if not answer.has_contacts:
            assert found.contact_counts[k] == 0
            assert np.isnan([found.bounds[k], found.gaps[k], *found.torques[k]]).all()
            continue
        certificate = answer.solution.certificate
        assert found.contact_counts[k] == len(answer.contacts.bodies)
        assert found.bounds[k] == pytest.approx(certificate.bound, abs=2e-7)
        assert (found.gaps[k] <= 1e-6) == answer.found
        assert np.isfinite(found.torques[k]).all() == answer.found
        if answer.found:
            # The torques returned bear the margin that is stated beside them.
            assert found.residuals[k] <= 1e-7
            assert found.torque_names == answer.joint_names
    kept = found.evaluations
    assert list(kept) == [0, 5]
    np.testing.assert_array_equal(kept[0].torques, found.torques[0])
    assert kept[5].status is StateStatus.OVERLAP
    assert kept[5].reason


FOLLOWED = ("trihand_push_box", "allegro_push_up_slope", "allegro_tumble_box")


@pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")
@pytest.mark.parametrize(
    ("name", "algorithm", "spread"),
    [
        ("allegro_box_on_slope", "margin", 0.01),
        ("allegro_box_on_slope", "torque", 0.01),
        *(pytest.param(name, "margin", 1e-4, marks=pytest.mark.sampled(4)) for name in FOLLOWED),
    ],
)
def test_states_that_are_like_none_before_are_answered_by_loops(
    name, algorithm, spread, monkeypatch
):
    """Also those of an object that the hand follows. Others have learned nothing."""
    evaluator = Evaluator(example(name), algorithm=algorithm)
    rng = np.random.default_rng(5)
    q = np.array([nearby(evaluator, rng, spread) for _ in range(32)])
    alone = solved_alone(monkeypatch)

    found = evaluator.evaluate_many(q, workers=1)

    assert len(alone) <= 12
    assert len(set(found.contact_counts.tolist())) > (2 if spread > 1e-3 else 0)
    for k in range(0, len(q), 2):
        answer = Evaluator(evaluator.scene, algorithm=algorithm).evaluate(q[k])
        assert found.statuses[k] is answer.status
        if answer.found:
            bound = answer.solution.certificate.bound
            assert found.bounds[k] == pytest.approx(bound, abs=2e-7)
        if algorithm == "margin":
            within = 1e-9 if name == "allegro_box_on_slope" else 1e-6
            assert found.margins[k] == pytest.approx(answer.margin, abs=within)
        elif answer.found:
            torques = np.abs(found.torques[k]).max(), np.abs(answer.torques).max()
            assert torques[0] == pytest.approx(torques[1], abs=1e-9)


def test_an_object_in_the_air_is_held_by_hands_alone():
    """Nothing stands around: loops are given no body but the hands."""
    crate = example("two_hands_slide_crate").with_changes(supports=(), motion=None)
    evaluator = Evaluator(crate)
    rng = np.random.default_rng(4)
    q = np.array([nearby(evaluator, rng, 1e-4) for _ in range(4)])

    found = evaluator.evaluate_many(q, workers=1)

    assert found.found.all()
    for k in range(len(q)):
        expected = evaluator.scene_at(q[k]).solve("margin").margin
        assert found.margins[k] == pytest.approx(expected, abs=1e-6)


def test_with_a_regularization_torques_are_those_of_evaluate():
    evaluator = Evaluator(example("trihand_push_box"), regularization=1e-3)
    rng = np.random.default_rng(2)
    q = np.array([nearby(evaluator, rng, 0.002) for _ in range(5)])

    found = evaluator.evaluate_many(q)

    expected = [evaluator.evaluate(one).torques for one in q]
    np.testing.assert_allclose(found.torques, expected, atol=1e-6)


def test_neither_order_nor_chunks_change_the_answers(monkeypatch):
    evaluator, states = varied(40)
    expected = Evaluator(evaluator.scene).evaluate_many(**states)
    order = np.random.default_rng(1).permutation(40)
    back = np.argsort(order)
    monkeypatch.setattr(many_states, "_STATES_AT_ONCE", 7)
    seen: list[tuple[int, int]] = []

    turned = evaluator.evaluate_many(
        **{name: values[order] for name, values in states.items()},
        workers=1,
        progress=lambda done, count: seen.append((done, count)),
    )

    assert seen == [(done, 40) for done in (7, 14, 21, 28, 35, 40)]
    np.testing.assert_allclose(turned.margins[back], expected.margins, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(turned.statuses[back], expected.statuses)


def test_processes_find_the_same_and_go_on_after_one_died():
    evaluator, states = varied(24)
    here = evaluator.evaluate_many(**states, workers=1)
    margin = float(np.median(here.margins[here.found]))

    there = evaluator.evaluate_many(**states, workers=2)

    np.testing.assert_array_equal(there.statuses, here.statuses)
    np.testing.assert_array_equal(there.contact_counts, here.contact_counts)
    np.testing.assert_allclose(there.margins, here.margins, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.bounds, here.bounds, rtol=0, atol=2e-7)
    solver = StateSolver(Configurations(evaluator.scene), Margin(), SolveOptions())
    one = {name: of[:1] for name, of in states.items()}
    state = many_states.checked_states(solver.configurations, **one)
    with pytest.raises(CrashError):
        many_states.computed_arrays(end_the_process, solver, state, 2, None)
    feasible = evaluator.are_feasible(**states, margin=margin, workers=2)
    np.testing.assert_array_equal(feasible, here.margins >= margin)
    with pytest.raises(ArgumentError, match=r"unknown joint 'thumb'"):
        evaluator.evaluate_many({"thumb": 0.1}, states["T_world_object"], workers=2)


@pytest.mark.parametrize(
    ("seconds", "count", "used"),
    [
        (1e-5, 20_000, 1),  # two processes took 0.9 s to save 0.1 s
        (1e-4, 100_000, 4),
        (1e-2, 800, 1),
        (1e-2, 1000, 2),  # 5 s are left
        (1e-2, 1400, 4),
    ],
)
def test_processes_are_used_where_they_pay(monkeypatch, seconds, count, used):
    """The work that is left, told by the processor time so far, against what starting takes."""
    clock, asked = [0.0], []

    def compute(_, states):
        # What the first states teach is not held against all others.
        clock[0] += len(states.each["q"]) * seconds * (50.0 if clock[0] == 0.0 else 1.0)
        return (np.zeros(states.total),)

    def processes(compute, solver, states, begin, workers):
        asked.append((begin, workers))
        yield slice(begin, states.total), (np.zeros(states.total - begin),)

    monkeypatch.setattr(many_states, "thread_time", lambda: clock[0])
    monkeypatch.setattr(many_states, "usable_cores", lambda: 4)
    monkeypatch.setattr(many_states, "_found_by_processes", processes)
    states = many_states.StateArrays(count, {"q": np.zeros((count, 1))}, {})
    (found,) = many_states.computed_arrays(compute, cast("StateSolver", None), states, None, None)
    assert len(found) == count
    assert asked == ([] if used == 1 else [(500, used)])


def end_the_process(solver: StateSolver, states: many_states.StateArrays) -> Any:
    os.kill(os.getpid(), signal.SIGKILL)


def test_what_is_given_once_holds_for_all():
    evaluator = Evaluator(example("trihand_push_box"))
    q = evaluator.configuration() + np.linspace(0.0, 1e-3, 3)[:, None]
    T = shifted(evaluator.scene.object.T_world_object, [1e-5, 0.0, 0.0])

    found = evaluator.evaluate_many(q, T, np.zeros(6))

    expected = [evaluator.evaluate(one, T, np.zeros(6)).margin for one in q]
    np.testing.assert_allclose(found.margins, expected, atol=1e-9)
    assert str(found).splitlines()[:2] == ["3 states", "3: torques were found"]
    assert repr(found) == "<EvaluatedStates: 3 states>"
    none = evaluator.evaluate_many(q[:0])
    assert len(none) == 0
    assert none.torques.shape == (0, len(found.torque_names))
    assert not found.margins.flags.writeable


def test_forces_of_hybrid_fingers_have_columns_of_their_own(tmp_path):
    evaluator = Evaluator(with_hybrid_finger("trihand_push_box", tmp_path))
    T = evaluator.scene.object.T_world_object

    found = evaluator.evaluate_many(T_world_object=[T, shifted(T, [0.0, 0.0, 1.0])])

    answer = evaluator.evaluate()
    names, units = found.torque_names, found.torque_units
    assert "finger_1.normal_force" in names
    assert dict(zip(names, units, strict=True)).items() >= answer.joint_units.items()
    own = [names.index(name) for name in answer.joint_names]
    np.testing.assert_allclose(found.torques[0, own], answer.torques, atol=1e-8)
    assert found.statuses[1] is StateStatus.NO_CONTACT


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, r"give q, \(K, 9\)"),
        ({"q": np.zeros((3, 8))}, r"q: has shape \(3, 8\); expected \(any, 9\)"),
        ({"q": np.full((2, 9), np.nan)}, r"q: is NaN at index \(0, 0\)"),
        ({"T_world_object": np.stack([np.eye(4), 2 * np.eye(4)])}, r"T_world_object\[1\]"),
        ({"twist": np.zeros((2, 5))}, r"twist: has shape \(2, 5\)"),
        ({"q": [[0.0] * 9, [0.0] * 8]}, r"q: is \[\[0.0, .* array of real numbers"),
        ({"q": [{}, np.zeros(9)]}, r"q: is \[\{\}, .* array of real numbers"),
        ({"q": np.zeros((3, 9)), "twist": np.zeros((2, 6))}, "has 2 states, but q has 3"),
        ({"q": np.zeros((3, 9)), "workers": 0}, "workers: is 0"),
        ({"q": np.zeros((3, 9)), "evaluations": 3}, "evaluations: must be a list of indices"),
        ({"q": np.array([[np.inf, -np.inf, *np.zeros(7)]])}, "q: is inf"),
        ({"q": np.zeros((3, 9)), "evaluations": [3]}, r"evaluations: is 3; .* from 0 to 2"),
    ],
)
def test_bad_input_is_an_error(arguments, message):
    with pytest.raises(ArgumentError, match=message):
        Evaluator(example("trihand_push_box")).evaluate_many(**arguments)


def test_states_are_taken_by_the_names_of_joints():
    evaluator = Evaluator(example("trihand_push_box"))
    q = evaluator.configuration()
    first, second = evaluator.joint_names[:2]
    named = [{first: float(q[0])}, {second: float(q[1]) + 1e-4}]
    moved = np.array([q, q])
    moved[1, 1] += 1e-4
    found = evaluator.evaluate_many(named)
    np.testing.assert_allclose(found.margins, evaluator.evaluate_many(moved).margins, rtol=1e-9)
    with pytest.raises(ArgumentError, match=r"q\[1\]: .*did you mean"):
        evaluator.evaluate_many([named[0], {f"{first}x": 0.0}])


def test_a_joint_that_follows_another_is_named_where_it_stands_or_not_at_all():
    evaluator = Evaluator(example("panda_slide_cuboid_up_slope"))
    leader, follower = "panda_finger_joint1", "panda_finger_joint2"
    q = {leader: 0.02502, follower: 0.02502}
    assert evaluator.evaluate_many([q]).found.tolist() == [evaluator.evaluate(q).found] == [True]
    assert evaluator.configuration({**q, leader: 0.9, follower: 0.9}) == [0.9]
    for wrong in ({follower: 0.01}, {leader: 0.02502, follower: 0.03}):
        for ask in (evaluator.evaluate, evaluator.is_feasible, evaluator.configuration):
            with pytest.raises(ArgumentError, match="mimics"):
                ask(wrong)
        for ask in (evaluator.evaluate_many, evaluator.are_feasible):
            with pytest.raises(ArgumentError, match=r"^q\[1\]\['panda_finger_joint2'\]: .*mimics"):
                ask([q, wrong])


def test_progress_is_told_to_a_function():
    evaluator = Evaluator(example("trihand_push_box"))
    q = evaluator.configuration()[None]
    for ask in (evaluator.evaluate_many, evaluator.are_feasible):
        with pytest.raises(ArgumentError, match="progress: is 3"):
            ask(q, progress=3)  # pyright: ignore[reportArgumentType]


def test_a_margin_is_asked_for_as_of_one_state():
    evaluator = Evaluator(example("trihand_push_box"), margin=0.2)
    q = np.array([evaluator.configuration()] * 2)
    best = evaluator.evaluate().margin
    assert evaluator.are_feasible(q).tolist() == [best >= 0.2] * 2
    assert evaluator.are_feasible(q, margin=best + 0.01).tolist() == [False, False]
    with pytest.raises(ArgumentError, match="margin: is -1"):
        evaluator.are_feasible(q, margin=-1.0)


def test_a_hand_that_moves_by_itself_is_left_to_the_search():
    scene = example("trihand_push_box")
    twist = scene.motion.object_twist
    slides = batch_states._has_fixed_sliding
    assert slides(scene) and slides(scene.with_changes(motion=None))
    own = Motion(twist, HandMotion(np.zeros(6), {}))
    assert not slides(scene.with_changes(motion=own))
    # The fastest contact decides what counts as no speed at the pivot of a turning object: it is
    # known up to where the hand touches, no farther than the corner that the box turns about.
    box = example("trihand_pivot_box")
    turn = box.motion.object_twist[3:]
    center, touching = box.object.center_of_mass_world, touching_of(box)
    arms = touching.positions[touching.hand_count :] - center
    about, reach = np.cross(-turn, arms[0]), float(np.linalg.norm(arms[0]))

    def creeping(share: float) -> Motion:
        along = (arms[0] - arms[1]) / np.linalg.norm(arms[0] - arms[1])
        return Motion(np.concatenate((about + share * np.linalg.norm(turn) * along, turn)))

    for share, is_told in ((0.0, True), (0.9e-3 * reach, True), (1.1e-3 * reach, True)):
        assert slides(box.with_changes(motion=creeping(share))) is is_told
    between = 1e-3 * (reach + 0.3 * box.contact_tolerance)
    assert not slides(box.with_changes(motion=creeping(between)))


GANTRY = "".join(
    f'<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>'
    f'<axis xyz="{axis}"/><limit lower="-0.2" upper="0.2" effort="9" velocity="1"/></joint>'
    for name, parent, child, axis in (
        ("x", "base", "beam", "1 0 0"), ("y", "beam", "slide", "0 1 0"),
        ("z", "slide", "tip", "0 0 1"),
    )
)  # fmt: skip


def test_edges_and_depths_are_left_to_the_general_search(tmp_path, by_numpy):
    """A sphere is moved over the upper edge of a box, from deep inside it to where it is off."""
    sphere = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'
    links = '<link name="base"/><link name="beam"/><link name="slide"/>'
    urdf = f'<robot name="gantry">{links}<link name="tip">{sphere}</link>{GANTRY}</robot>'
    (tmp_path / "gantry.urdf").write_text(urdf)
    (tmp_path / "scene.yaml").write_text(
        "friction: 0.5\nmax_normal_force: 9\ntangent_axes: [[1, 0, 0.5]]\n"
        "hand: {urdf: gantry.urdf, q: {z: 0.11}}\n"
        "object: {shape: {type: box, size: [0.1, 0.1, 0.1]}, mass: 0.3,\n"
        "  pose: {position: [0, 0, 0.05]}}\n"
        "supports: [{name: floor, shape: {type: half_space}}]\n"
    )
    scene = load_scene(tmp_path / "scene.yaml")
    x, height = np.linspace(0.04, 0.06, 20), np.linspace(-0.008, 0.0015, 12)
    q = np.array([[a, 0.01, 0.11 + h] for a in x for h in height])
    found = Evaluator(scene, collisions=False).evaluate_many(q)
    expected = by_numpy(lambda: Evaluator(scene, collisions=False).evaluate_many(q))
    assert found.statuses.tolist() == expected.statuses.tolist()
    np.testing.assert_allclose(found.margins, expected.margins, rtol=1e-6, atol=1e-7)
    assert {StateStatus.FOUND, StateStatus.OVERLAP, StateStatus.HAND_TOUCHES_NOTHING} == set(
        found.statuses
    )
