"""Motions between two states: where they are valid, against states that are close together."""

from typing import Any

import numpy as np
import pytest
from planning_scenes import example, shifted, turned
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

from graspless_pin import Evaluator
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import Box
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.planning import StateStatus
from graspless_pin.planning.edges import ScrewMotion


@pytest.mark.parametrize("turn", [0.0, 1e-6, 0.4, 2.5])
def test_a_screw_motion_is_an_exponential(turn):
    rng = np.random.default_rng(3)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    spatial, axis = np.zeros((4, 4)), rng.normal(size=3)
    spatial[:3, :3] = np.cross(np.eye(3), turn * axis / np.linalg.norm(axis)).T
    spatial[:3, 3] = rng.normal(size=3)
    center = rng.normal(size=3)
    motion = ScrewMotion.between(T, expm(spatial) @ T, center)
    for fraction in (0.0, 0.3, 1.0):
        pose, twist = motion.pose_and_twist(fraction)
        np.testing.assert_allclose(pose, expm(fraction * spatial) @ T, atol=1e-9)
        velocities = spatial @ pose @ [*center, 1.0]
        spin = spatial[[2, 0, 1], [1, 2, 0]]
        np.testing.assert_allclose(twist, [*velocities[:3], *spin], atol=1e-9)
    np.testing.assert_allclose(motion.lengths, [np.linalg.norm(twist[:3]), turn], atol=1e-9)


def along(evaluator: Evaluator, motion: tuple, fraction: float) -> Any:
    """A state on a motion as `evaluate` takes it, worked out by logarithms of matrices."""
    q0, q1, T0, T1 = motion
    spatial = np.real(logm(T1 @ np.linalg.inv(T0)))
    spatial[np.abs(spatial) < 1e-12] = 0.0  # a twist of rounding is one with a direction
    pose = expm(fraction * spatial) @ T0
    center = pose @ [*evaluator.scene.object.center_of_mass, 1.0]
    twist = np.array([*(spatial @ center)[:3], spatial[2, 1], spatial[0, 2], spatial[1, 0]])
    return q0 + fraction * (q1 - q0), pose, twist


def moves() -> dict:
    """Scenes, motions (q0, q1, T0, T1), and a margin that some states on the way have, N."""
    found = {}
    scene = example("trihand_slide_and_pivot")
    evaluator = Evaluator(scene)
    names, home, T = evaluator.joint_names, evaluator.configuration(), scene.object.T_world_object
    ahead, uphill = home.copy(), 0.05 * T[:3, 0]
    ahead[names.index("carriage_x")] += uphill[0]
    ahead[names.index("carriage_z")] += uphill[2]
    tilted = ahead.copy()
    tilted[names.index("carriage_pitch")] -= 0.02
    slid = shifted(T, uphill)
    found["slides as the hand tilts"] = scene, (home, tilted, T, slid), 0.68
    found["slides without the hand"] = scene, (home, home, T, slid), 0.3
    wall = Support("wall", Box((0.02, 0.5, 0.5)), pose_matrix([0.09, 0.0, 0.1]))
    found["runs into a wall"] = (
        scene.with_changes(supports=(*scene.supports, wall)),
        (home, ahead, T, slid),
        0.3,
    )
    post = Support("post", Box((0.02, 0.3, 0.02)), pose_matrix([-0.2, 0.0, 0.17]))
    lifted = home.copy()
    lifted[names.index("carriage_z")] += 0.004
    found["a link runs into a post"] = (
        scene.with_changes(supports=(*scene.supports, post)),
        (home, lifted, T, T),
        0.0,
    )
    scene = example("trihand_pivot_box")
    home = Evaluator(scene).configuration()
    T = scene.object.T_world_object
    found["pivots away from the fingers"] = scene, (home, home, T, turned(T, -0.05)), 0.5
    return found


MOVES = moves()


@pytest.mark.parametrize("name", MOVES)
def test_a_motion_fails_where_states_close_together_do(name):
    scene, motion, margin = MOVES[name]
    evaluator = Evaluator(scene)
    resolution = (2e-4, 2e-3)
    fault = evaluator.first_invalid(*motion, margin=margin, resolution=resolution)
    assert evaluator.is_valid_motion(*motion, margin=margin, resolution=resolution) is (
        fault is None
    )
    dense = Evaluator(scene)

    def is_good(fraction: float) -> bool:
        state = dense.evaluate(*along(dense, motion, fraction))
        return state.found and state.margin >= margin

    fractions = np.linspace(0.0, 1.0, 101)
    good = np.array([is_good(fraction) for fraction in fractions])
    if fault is None:
        assert good.all()
        return
    assert 0.0 < fault.fraction < 1.0 and fault.last_valid is not None  # that is what is tried
    T0, T1 = motion[2:]
    length, angle = ScrewMotion.between(T0, T1, scene.object.center_of_mass).lengths
    way = np.abs(motion[1] - motion[0]).max() / resolution[0]  # each is a length or a small angle
    finest = 1.0 / max(length / resolution[0], angle / resolution[1], way)
    assert 0.0 < fault.fraction - fault.last_valid <= max(finest, 0.01)
    first = fractions[int(np.argmin(good))]
    assert first - 0.01 - 1e-9 <= fault.fraction
    assert fault.last_valid <= first + 1e-9
    assert not fault.validity.valid
    assert str(fault).endswith(f": {fault.validity}")  # what is printed has the reason


def test_reasons_on_the_way():
    """What stops each of these motions is known beforehand."""
    reasons = {}
    for name, (scene, motion, margin) in MOVES.items():
        fault = Evaluator(scene).first_invalid(*motion, margin=margin)
        reasons[name] = set(fault.validity.reasons) if fault else set()
    assert reasons["slides as the hand tilts"] == {StateStatus.BELOW_MARGIN}
    assert StateStatus.HAND_TOUCHES_NOTHING in reasons["slides without the hand"]
    assert reasons["runs into a wall"] == {StateStatus.BLOCKED}
    assert reasons["a link runs into a post"] == {StateStatus.HAND_THROUGH_SUPPORT}
    assert reasons["pivots away from the fingers"]


def test_a_push_up_a_slope_is_no_pull_down_it():
    scene, (q0, _, T0, T1), _ = MOVES["slides as the hand tilts"]
    evaluator = Evaluator(scene)
    q1 = q0 + np.eye(len(q0))[0] * (T1 - T0)[0, 3] + np.eye(len(q0))[1] * (T1 - T0)[2, 3]
    assert evaluator.is_valid_motion(q0, q1, T0, T1, margin=0.6)
    back = evaluator.first_invalid(q1, q0, T1, T0, margin=0.6)
    assert back is not None
    assert (back.fraction, back.last_valid) == (0.0, None)
    assert back.validity.reasons == (StateStatus.INFEASIBLE,)
    # What it does at rest there is another matter.
    assert evaluator.is_valid_motion(q1, q1, T1, margin=0.6)


def test_a_motion_may_end_at_a_wall():
    scene, (q0, _, T0, _), _ = MOVES["slides as the hand tilts"]
    T1 = shifted(T0, 0.03 * T0[:3, 0])
    q1 = q0 + np.eye(len(q0))[0] * (T1 - T0)[0, 3] + np.eye(len(q0))[1] * (T1 - T0)[2, 3]
    for into, valid in ((-0.2e-3, True), (0.5e-3, True), (3e-3, False)):  # m
        front = np.array(T1)
        front[:3, 3] += T1[:3, 0] * (0.05 + 0.01 - into)
        wall = Support("wall", Box((0.02, 0.5, 0.5)), front)
        evaluator = Evaluator(scene.with_changes(supports=(*scene.supports, wall)))
        fault = evaluator.first_invalid(q0, q1, T0, T1, margin=0.1)
        assert evaluator.validity(q1, T1, np.zeros(6), margin=0.1).valid
        assert (fault is None) is valid
        if fault is not None:
            assert fault.validity.reasons == (StateStatus.BLOCKED,)


def test_margins_along_a_motion():
    scene, motion, _ = MOVES["slides as the hand tilts"]
    evaluator, dense = Evaluator(scene), Evaluator(scene)
    found = evaluator.motion_margins(*motion)
    assert found.fractions[0] == 0.0 and found.fractions[-1] == 1.0
    assert (np.diff(found.fractions) > 0.0).all()
    for fraction, margin in zip(found.fractions, found.margins, strict=True):
        state = dense.evaluate(*along(dense, motion, fraction))
        assert margin == pytest.approx(state.margin, abs=1e-6)
    assert found.smallest == found.margins.min()
    lost = Evaluator(scene).motion_margins(motion[0], motion[0], *motion[2:])
    assert lost.smallest == lost.margins[-1] == -np.inf and lost.fractions[-1] < 1.0


def test_what_is_left_out_stays_as_in_the_scene():
    scene = example("trihand_push_box")
    evaluator = Evaluator(scene)
    q, T = evaluator.configuration(), scene.object.T_world_object
    at_rest = evaluator.motion_margins()
    assert at_rest.fractions.tolist() == [0.0]  # nothing moves
    assert at_rest.margins[0] == evaluator.evaluate(twist=np.zeros(6)).margin
    opened = {name: value + 0.1 for name, value in scene.hand.q.items() if "distal" in name}
    one = evaluator.first_invalid(q1=opened, margin=0.1)
    other = evaluator.first_invalid(q, evaluator.configuration(opened), T, T, margin=0.1)
    assert one is not None and other is not None
    assert one.fraction == other.fraction and one.validity.reasons == other.validity.reasons


@pytest.mark.parametrize("wrong", [(0.0, 0.1), (1e-3,), (np.nan, 0.1), 1e-3])
def test_a_resolution_that_is_none(wrong):
    evaluator = Evaluator(example("trihand_push_box"))
    with pytest.raises(ArgumentError, match="resolution"):
        evaluator.is_valid_motion(resolution=wrong)


def test_a_pose_that_is_none():
    evaluator = Evaluator(example("trihand_push_box"))
    with pytest.raises(ArgumentError, match="T1_world_object"):
        evaluator.first_invalid(T1_world_object=2.0 * np.eye(4))
