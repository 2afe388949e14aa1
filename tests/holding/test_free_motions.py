"""Motions that no friction resists: of example scenes, by hand, and in any frame and units."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from graspless_pin import QuasistaticProblem, free_motions, load_scene
from graspless_pin.errors import ArgumentError

EXAMPLES = Path(__file__).parents[2] / "examples"
AT_REST = {
    "allegro_sphere_on_slope": 3,
    "trihand_pivot_box": 1,
    "allegro_box_on_slope": 0,
    "allegro_mug_against_wall": 0,
    "allegro_push_up_slope": 0,
    "allegro_tumble_box": 0,
    "panda_arm_drag_board": 0,
    "panda_slide_cuboid_up_slope": 0,
    "trihand_push_box": 0,
    "trihand_slide_and_pivot": 0,
    "two_hands_slide_crate": 0,
    "paper/cuboid_at_rest": 0,
    "paper/sphere_on_slope": 0,
}
"""With the declared motion taken away: all contacts at rest."""
IN_MOTION = {
    "trihand_pivot_box": 1,  # the pivoting
    "allegro_tumble_box": 1,  # the tumbling: two of four corners have lifted off
    "allegro_push_up_slope": 3,  # sliding on the slope, and turning there
    "trihand_push_box": 3,
    "two_hands_slide_crate": 3,
    "panda_slide_cuboid_up_slope": 0,  # two jaws on one joint, the arm under position control
    "paper/cuboid_sliding_up": 1,  # the fingers follow along the slope's line of fall only
}
ON_TABLE = np.array([[0.0, 0.0, -0.1]])
UP = np.array([[0.0, 0.0, 1.0]])


def touching(positions, normals, jacobian=None, **changes):
    given = {"friction": 0.5, **changes}
    return QuasistaticProblem(positions, normals, [0, 0, -9.8, 0, 0, 0], jacobian, **given)


def slips(problem, motion):
    """(M, 3) velocities of the object relative to the other body, world axes."""
    joints = (problem.jacobian @ motion[6:]).reshape(-1, 3)
    return motion[:3] + np.cross(motion[3:6], problem.positions) - joints


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", AT_REST)
def test_examples_at_rest(name):
    problem = load_scene(EXAMPLES / f"{name}.yaml").with_changes(motion=None).problem()
    motions = free_motions(problem)
    assert motions.shape == (AT_REST[name], 6 + problem.joint_count)
    for motion in motions:
        assert np.abs(slips(problem, motion)).max() < 1e-9 * np.abs(motion).max()
        assert np.linalg.norm(motion[:6]) > 0.01


@pytest.mark.parametrize("name", IN_MOTION)
def test_examples_in_their_declared_motion(name):
    problem = load_scene(EXAMPLES / f"{name}.yaml").problem()
    motions = free_motions(problem)
    assert len(motions) == IN_MOTION[name]
    for motion in motions:
        slip = slips(problem, motion)
        slip[problem.is_sliding] *= problem.normals[problem.is_sliding]
        assert np.abs(slip[~problem.is_sliding]).max(initial=0.0) < 1e-9
        assert np.abs(slip[problem.is_sliding].sum(axis=1)).max(initial=0.0) < 1e-9


def test_the_balls_motions_leave_its_fingers_where_they_touch():
    """A step along each: links and ball agree on where the contact points go."""
    scene = load_scene(EXAMPLES / "allegro_sphere_on_slope.yaml")
    assert scene.hand is not None
    problem, step = scene.problem(), 1e-6
    found = scene.contacts.arrays
    count = found.hand_count
    links, points = found.bodies[:count], found.positions[:count]
    center = scene.object.center_of_mass_world
    for motion in free_motions(problem):
        rates = dict(zip(problem.joint_names, motion[6:].tolist(), strict=True))
        on_links = scene.hand.point_velocities(links, points, rates)
        turn = Rotation.from_rotvec(step * motion[3:6]).as_matrix()
        on_ball = ((points - center) @ turn.T + center + step * motion[:3] - points) / step
        np.testing.assert_allclose(on_ball, on_links, atol=1e-6)


def test_a_ball_on_a_table_rolls_and_spins():
    motions = free_motions(touching(ON_TABLE, UP))
    assert motions.shape == (3, 6)
    assert not motions.flags.writeable
    for motion in motions:
        np.testing.assert_allclose(motion[:3], np.cross(motion[3:6], [0, 0, 0.1]), atol=1e-12)


def test_a_ball_between_two_walls_turns_about_the_line_between_them():
    ends = np.array([[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]])
    (motion,) = free_motions(touching(ends, -ends / 0.1))
    np.testing.assert_allclose(np.abs(motion), [0, 0, 0, 0, 1, 0], atol=1e-12)


def test_a_finger_that_can_follow_lets_the_ball_roll_along():
    """A slide under a ball that lies on nothing else: six motions, one of them with the slide."""
    alone = free_motions(touching(ON_TABLE, UP))
    jacobian = np.array([[1.0], [0.0], [0.0]])
    carried = free_motions(touching(ON_TABLE, UP, jacobian))
    assert (len(alone), len(carried)) == (3, 4)
    assert np.linalg.matrix_rank(carried[:, :6]) == 4
    # A joint that moves no contact changes nothing, and stands still.
    other = free_motions(touching(ON_TABLE, UP, np.hstack([jacobian, 0.0 * jacobian])))
    np.testing.assert_array_equal(other[:, 7], 0.0)
    assert len(other) == 4


def test_motions_of_joints_alone_are_left_out_and_kept_small():
    """Two slides side by side under a ball: what one can do the other can undo."""
    jacobian = np.array([[1.0, 2.0], [0.0, 0.0], [0.0, 0.0]])
    motions = free_motions(touching(ON_TABLE, UP, jacobian))
    assert len(motions) == 4
    # In units of their longest levers both go half the way.
    np.testing.assert_allclose(motions[:, 6], 2.0 * motions[:, 7], atol=1e-12)


@pytest.mark.parametrize(("friction", "sliding"), [(0.0, [0, 0, 0]), (0.5, [0.1, 0, 0])])
def test_what_slides_or_has_no_friction_only_keeps_touching(friction, sliding):
    motions = free_motions(touching(ON_TABLE, UP, friction=friction, sliding=[sliding]))
    assert len(motions) == 5
    heights = motions[:, 2]
    np.testing.assert_allclose(heights, 0.0, atol=1e-12)


@pytest.mark.parametrize("inertia", [None, [[0.0]]])
def test_a_hybrid_finger_follows_along_its_normal(inertia):
    ends = np.array([[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]])
    jacobian = np.zeros((6, 1))
    jacobian[1] = 1.0
    motions = free_motions(touching(ends, -ends / 0.1, jacobian, joint_inertia=inertia))
    # Turning about the line, and nothing else: the wall holds the other end.
    assert len(motions) == 1
    assert motions[0, 6] == pytest.approx(0.0, abs=1e-12)
    only = free_motions(touching(ends[:1], -ends[:1] / 0.1, jacobian[:3], joint_inertia=inertia))
    assert len(only) == 4
    if inertia is not None:
        np.testing.assert_array_equal(only[:, 6], 0.0)


def test_only_problems_have_motions():
    with pytest.raises(ArgumentError, match=r"^problem: is an int; it must be a Quasistatic"):
        free_motions(3)  # pyright: ignore[reportArgumentType]


def same_space(first, second):
    """Whether two sets of rows span the same space."""
    return len(first) == len(second) == np.linalg.matrix_rank(np.vstack([first, second]), tol=1e-6)


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.floats(-3, 3))
def test_frame_units_order_and_tangents_change_no_motion(seed, unit):
    rng = np.random.default_rng(seed)
    count, joints = int(rng.integers(1, 4)), int(rng.integers(0, 5))
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    positions = -0.1 * normals
    jacobian = rng.normal(size=(count, 3, joints)) * (rng.random((count, 1, joints)) < 0.5)
    friction = np.where(rng.random(count) < 0.2, 0.0, 0.5)
    made = touching(positions, normals, jacobian.reshape(3 * count, joints), friction=friction)
    motions = free_motions(made)
    order, length = rng.permutation(count), 10.0**unit
    R = Rotation.random(rng=rng).as_matrix()
    gears = 10.0 ** rng.uniform(-2, 2, joints)
    turned = np.einsum("ij,ljk->lik", R, jacobian)[order] * length * gears
    other = touching(
        length * positions[order] @ R.T,
        normals[order] @ R.T,
        turned.reshape(3 * count, joints),
        friction=friction[order],
    )
    back = free_motions(other) @ np.diag(1.0 / np.r_[[length] * 3, np.ones(3), 1.0 / gears])
    back[:, :3], back[:, 3:6] = back[:, :3] @ R, back[:, 3:6] @ R
    assert same_space(back, motions)
    for motion in motions:
        slip = slips(made, motion)
        assert np.abs(slip[friction > 0.0]).max(initial=0.0) < 1e-9
        assert np.abs((slip * normals).sum(axis=1)).max() < 1e-9


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_their_number_is_what_ranks_tell(seed):
    """Nullities of the exact constraint matrices, all at once and for the joints alone."""
    rng = np.random.default_rng(seed)
    count, joints = int(rng.integers(1, 5)), int(rng.integers(0, 6))
    positions, normals = rng.integers(-2, 3, (count, 3)), np.tile(UP, (count, 1))
    jacobian = rng.integers(-1, 2, (3 * count, joints)).astype(float)
    motions = free_motions(touching(positions, normals, jacobian))
    arms = [np.cross(np.eye(3), p).T @ -np.eye(3) for p in positions]
    object_rows = np.hstack([np.tile(np.eye(3), (count, 1)), np.vstack(arms)])
    both = np.hstack([object_rows, -jacobian])
    nullity = 6 + joints - np.linalg.matrix_rank(both)
    own = joints - np.linalg.matrix_rank(jacobian) if joints else 0
    assert len(motions) == nullity - own
