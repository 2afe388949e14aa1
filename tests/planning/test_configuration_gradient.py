"""Gradients by the joints, against solving anew with the contacts found anew at other joints."""

from functools import cache

import numpy as np
import pytest
from planning_scenes import example, nearby, with_hybrid_finger

from graspless_pin import maximize_margin, minimize_torque
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.planning import Evaluator, configuration_gradient
from graspless_pin.planning.configuration_gradient import JointColumns
from graspless_pin.scene import Acceleration, Load

STEP = 1e-5
SCENES = (
    "allegro_box_on_slope",  # spheres on a plane, contacts merged with a slope below
    "allegro_sphere_on_slope",  # spheres on a sphere: normals turn
    "trihand_push_box",
    "trihand_pivot_box",
    "paper/cuboid_at_rest",  # one joint a finger
)
ON_LINKS = ("allegro_box_on_slope", "panda_slide_cuboid_up_slope", *SCENES[3:])


def optimum(solution, algorithm):
    return solution.margin if algorithm == "margin" else solution.max_torque


@cache
def state(name, algorithm, seed, changes=()):
    """An evaluator, a configuration where it finds torques, and what it found."""
    evaluator = Evaluator(example(name).with_changes(**dict(changes)), algorithm=algorithm)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        q = nearby(evaluator, rng, 0.004)
        answer = evaluator.evaluate(q)
        if answer.found:
            return evaluator, q, answer
    raise AssertionError(name)


def found_anew(evaluator):
    """The problem of a configuration, with its contacts found anew."""
    return lambda q: evaluator.scene_at(q).problem()


def differences(evaluator, q, answer, algorithm, problem_at, step=STEP):
    """Central differences of full solves in the state's mode, and how far off they may be.

    An optimum is known up to its proven gap, and what is read from its forces up to their residual.
    """
    run, options = maximize_margin, {"mode": answer.solution.mode}
    if algorithm == "torque":
        run, options["margin"] = minimize_torque, evaluator.required_margin
    slopes, errors = [], []
    for joint in np.eye(len(q)):
        ends = [run(problem_at(q + way * joint), **options) for way in (step, -step)]
        high, low = (optimum(end, algorithm) for end in ends)
        proofs = [end.certificate for end in ends]
        error = sum(abs(proof.gap) + proof.primal_residual * high for proof in proofs)
        slopes.append((high - low) / (2.0 * step))
        errors.append(error / (2.0 * step))
    return np.array(slopes), np.array(errors)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("algorithm", ["margin", "torque"])
@pytest.mark.parametrize("name", SCENES)
def test_gradient_is_the_difference_of_scenes(name, algorithm):
    checked, joints = 0, 0
    for seed in range(2):
        evaluator, q, answer = state(name, algorithm, seed)
        gradient = configuration_gradient(answer)
        assert gradient.joint_names == evaluator.joint_names
        expected, _ = differences(evaluator, q, answer, algorithm, found_anew(evaluator))
        size = np.abs(expected).max()
        assert size > 1e-4
        unique = gradient.unique
        np.testing.assert_allclose(
            gradient.values[unique], expected[unique], atol=2e-4 * size, rtol=1e-4
        )
        checked += int(unique.sum())
        joints += len(q)
    if name != "paper/cuboid_at_rest":
        assert checked == joints


def test_loads_and_accelerations_as_one_count():
    """The links feel the acceleration; what hangs on the object stays where it is."""
    changes = (
        ("loads", (Load("cable", force=[0.1, 0.0, 0.3], at=[0.0, 0.0, 0.02]),)),
        ("acceleration", Acceleration(linear=[1.0, 0.0, 2.0])),
    )
    evaluator, q, answer = state("allegro_box_on_slope", "torque", 0, changes)
    gradient = configuration_gradient(answer)
    expected, _ = differences(evaluator, q, answer, "torque", found_anew(evaluator))
    unique, size = gradient.unique, np.abs(expected).max()
    assert unique.any()
    np.testing.assert_allclose(
        gradient.values[unique], expected[unique], atol=2e-4 * size, rtol=1e-4
    )
    turning = evaluator.scene.with_changes(acceleration=Acceleration(angular=[0.0, 0.0, 1.0]))
    with pytest.raises(ArgumentError, match="acceleration is not only 'linear'"):
        configuration_gradient(Evaluator(turning, algorithm="torque").evaluate(q))


@pytest.mark.parametrize("name", ["allegro_sphere_on_slope", "trihand_pivot_box"])
def test_gaps_are_the_differences_of_gaps(name):
    evaluator, q, answer = state(name, "torque", 0)
    gradient = configuration_gradient(answer)
    np.testing.assert_array_equal(
        gradient.gaps, [answer.contacts.points[k].distance for k in gradient.contacts]
    )
    for column, joint in enumerate(np.eye(len(q))):
        ends = [evaluator.scene_at(q + sign * STEP * joint).contacts.points for sign in (1.0, -1.0)]
        high, low = (np.array([end[k].distance for k in gradient.contacts]) for end in ends)
        np.testing.assert_allclose(
            gradient.gap_gradient[:, column], (high - low) / (2.0 * STEP), atol=1e-6
        )


def carried(answer, q):
    """The problem when the hand's contacts stay where they are on their links, frames and all."""
    scene, problem = answer.scene, answer.solution.problem
    leaders = scene.hand.tree.coupling.leaders
    names = [scene.hand.joint_names[leader] for leader in leaders]
    hand = scene.hand.with_configuration(dict(zip(names, q.tolist(), strict=True)))
    arrays = {
        name: getattr(problem, name).copy()
        for name in ("positions", "normals", "tangents", "jacobian")
    }
    for k, point in enumerate(answer.contacts.points):
        if point.body not in hand.link_names:
            continue
        T = hand.pose_of(point.body) @ np.linalg.inv(scene.hand.pose_of(point.body))
        place = T[:3, :3] @ point.position + T[:3, 3]
        arrays["positions"][k] = place - scene.object.center_of_mass_world
        for name in ("normals", "tangents"):
            arrays[name][k] = T[:3, :3] @ arrays[name][k]
        arrays["jacobian"][3 * k : 3 * k + 3] = hand.contact_jacobian([point.body], place[None])
    return problem.with_changes(**arrays, gravity_torques=hand.gravity_torques(scene.gravity))


@pytest.mark.sampled(4)
@pytest.mark.parametrize("algorithm", ["margin", "torque"])
@pytest.mark.parametrize("name", ON_LINKS)
def test_contacts_that_follow_their_links(name, algorithm):
    evaluator, q, answer = state(name, algorithm, 2)
    gradient = configuration_gradient(answer, follows="link")
    # No contact is found anew, so that the step may be longer than where one may jump.
    expected, errors = differences(
        evaluator, q, answer, algorithm, lambda at: carried(answer, at), step=10.0 * STEP
    )
    size = max(np.abs(expected).max(), 1e-3)
    unique = gradient.unique
    off = np.abs(gradient.values - expected) - 1e-4 * np.abs(expected) - 2e-4 * size
    assert (off <= errors)[unique].all()
    assert (errors < 5e-4).all()
    assert not gradient.gap_gradient.any()
    if name not in ("paper/cuboid_at_rest", "panda_slide_cuboid_up_slope"):
        assert unique.sum() >= 4
        assert np.abs(expected[unique]).max() > 1e-3


@pytest.mark.parametrize("name", ["two_hands_slide_crate", "panda_arm_drag_board"])
def test_lever_arms_are_differentiated(name):
    """The kinematic Hessian of every joint and link, against differences of the Jacobian."""
    hand = example(name).hand
    columns = JointColumns(hand)
    rng = np.random.default_rng(0)
    links = rng.choice([link for link in hand.link_names if hand.tree.link_joints[link]], 4)
    leaders = list(hand.tree.coupling.leaders)
    names = [hand.joint_names[leader] for leader in leaders]
    for link in links:
        joint = hand.tree.link_joints[link]
        weights = rng.normal(size=(3, len(hand.actuated_joint_names)))
        by_joint = weights @ hand.actuation.from_joints.T
        T = hand.pose_of(link)
        local = rng.normal(size=3) * 0.05
        point = T[:3, :3] @ local + T[:3, 3]
        moved = columns.change_of_columns(joint, point, columns.velocity(joint, point))
        change = np.einsum("ij,ijk->k", by_joint, moved)
        expected = []
        for name in names:
            ends = []
            for sign in (1.0, -1.0):
                moved = hand.with_configuration({name: hand.q[name] + sign * STEP})
                T = moved.pose_of(link)
                place = T[:3, :3] @ local + T[:3, 3]
                ends.append(np.sum(weights * moved.contact_jacobian([link], place[None])))
            expected.append((ends[0] - ends[1]) / (2.0 * STEP))
        np.testing.assert_allclose(change @ hand.tree.coupling.S, expected, atol=1e-7)


def test_hybrid_fingers_have_gradients_too(tmp_path):
    scene = with_hybrid_finger("trihand_pivot_box", tmp_path)
    evaluator = Evaluator(scene, algorithm="margin")
    q = nearby(evaluator, np.random.default_rng(0), 0.004)
    answer = evaluator.evaluate(q)
    gradient = configuration_gradient(answer)
    expected, _ = differences(evaluator, q, answer, "margin", found_anew(evaluator))
    unique = gradient.unique
    assert unique.sum() >= 6
    np.testing.assert_allclose(gradient.values[unique], expected[unique], atol=1e-5)


def test_what_has_no_gradient():
    scene = example("trihand_push_box")
    with pytest.raises(NoSolutionError, match="no torques"):
        configuration_gradient(Evaluator(scene).evaluate({"finger_1_distal": 9.0}))
    with pytest.raises(ArgumentError, match="regularisation"):
        configuration_gradient(Evaluator(scene, regularization=1e-3).evaluate())
    with pytest.raises(ArgumentError, match="follows: is 'air'"):
        configuration_gradient(Evaluator(scene).evaluate(), follows="air")
    bare = scene.with_changes(hand=None, motion=None)
    with pytest.raises(ArgumentError, match="without a hand"):
        configuration_gradient(Evaluator(bare).evaluate())
