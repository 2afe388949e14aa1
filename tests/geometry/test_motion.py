"""Declared motion: sliding, sticking, separating and penetrating contacts, by hand."""

import math

import numpy as np
import pytest

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.contacts import BodyKind, ContactPoint
from graspless_pin.geometry.motion import (
    ContactMotion,
    apply_motion,
    classify_motion,
    twist_velocities,
)

Q = math.sqrt(0.5)
CENTER = np.array([0.0, 0.0, 0.1])


def contact(
    position: tuple[float, float, float],
    normal: tuple[float, float, float],
    body: str = "table",
    kind: BodyKind = BodyKind.SUPPORT,
) -> ContactPoint:
    return ContactPoint(body, kind, np.array(position), np.array(normal), 0.0)


# A cube of edge 0.2 on the table, its centre at CENTER, with a finger on its back.
BACK = contact((-0.1, 0.0, 0.1), (1, 0, 0), "finger", BodyKind.HAND)
LEFT = contact((-0.1, 0.0, 0.0), (0, 0, 1))
RIGHT = contact((0.1, 0.0, 0.0), (0, 0, 1))
SCENE = [BACK, LEFT, RIGHT]


def test_twist_velocities_agree_with_finite_differences_of_a_rotation() -> None:
    rng = np.random.default_rng(3)
    twist, points, step = rng.normal(size=6), rng.normal(size=(5, 3)), 1e-6
    axis = twist[3:] / np.linalg.norm(twist[3:])
    angle = step * np.linalg.norm(twist[3:])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    moved = (points - CENTER) @ turn.T + CENTER + step * twist[:3]
    assert np.allclose(twist_velocities(twist, CENTER, points), (moved - points) / step, atol=1e-5)


def test_no_motion_sticks() -> None:
    motion = classify_motion(SCENE, np.zeros(6), CENTER)
    assert motion.states == (ContactMotion.STICKING,) * 3
    assert not motion.sliding.any()


def test_pushed_along_the_table_it_slides_there_and_sticks_to_the_finger_that_follows() -> None:
    follow = np.array([[0.05, 0, 0], [0, 0, 0], [0, 0, 0]])
    motion = classify_motion(SCENE, [0.05, 0, 0, 0, 0, 0], CENTER, follow)
    assert motion.states == (
        ContactMotion.STICKING,
        ContactMotion.SLIDING,
        ContactMotion.SLIDING,
    )
    assert np.allclose(motion.sliding, [[0, 0, 0], [0.05, 0, 0], [0.05, 0, 0]])


def test_up_the_paper_slope_all_corners_slide_with_the_object() -> None:
    corners = [contact((-0.1, y, x), (Q, 0, Q), "slope") for x, y in ((0.1, 1), (-0.1, 0))]
    kept, sliding = apply_motion(corners, [-0.0707, 0, 0.0707, 0, 0, 0], np.zeros(3))
    assert kept == tuple(corners)
    assert np.allclose(sliding, [[-0.0707, 0, 0.0707]] * 2)


def test_a_cube_that_tips_over_its_edge_sticks_there_and_leaves_elsewhere() -> None:
    # Turning about the y axis through the right edge: v = omega x (c - edge).
    omega = np.array([0.0, 0.2, 0.0])
    velocity = np.cross(omega, CENTER - RIGHT.position)
    twist = np.concatenate([velocity, omega])
    motion = classify_motion([LEFT, RIGHT], twist, CENTER)
    assert motion.states == (ContactMotion.SEPARATING, ContactMotion.STICKING)
    assert np.allclose(motion.normal_speeds, [0.04, 0.0])
    kept, sliding = apply_motion([LEFT, RIGHT], twist, CENTER)
    assert kept == (RIGHT,)
    assert np.allclose(sliding, np.zeros((1, 3)))


def test_a_rolling_ball_sticks() -> None:
    motion = classify_motion([contact((0, 0, 0), (0, 0, 1))], [0.1, 0, 0, 0, 1.0, 0], CENTER)
    assert motion.states == (ContactMotion.STICKING,)


def test_a_conveyor_drags_the_contact_against_its_own_motion() -> None:
    belt = np.array([[0.3, 0.1, 0.0]])
    motion = classify_motion([RIGHT], np.zeros(6), CENTER, belt)
    assert motion.states == (ContactMotion.SLIDING,)
    assert np.allclose(motion.sliding, -belt)


def test_sliding_has_no_part_along_the_normal() -> None:
    normal = np.array([0.001, 0.0, 1.0]) / math.hypot(0.001, 1.0)
    tilted = contact((0, 0, 0), tuple(normal.tolist()))
    motion = classify_motion([tilted], [0.1, 0, 0, 0, 0, 0], CENTER, speed_tolerance=0.01)
    assert motion.states == (ContactMotion.SLIDING,)
    assert abs(motion.sliding[0] @ normal) < 1e-17


def test_driving_into_bodies_names_each_with_its_speed() -> None:
    with pytest.raises(SceneError, match=r"object 'cube' into support 'table' at 0\.02 m/s"):
        apply_motion([LEFT, RIGHT], [0, 0, -0.02, 0, 0, 0], CENTER, object_name="cube")
    with pytest.raises(SceneError, match=r"hand link 'finger' at 0\.03 m/s, support 'table' at"):
        apply_motion(SCENE, [-0.03, 0, -0.02, 0, 0, 0], CENTER)


def test_the_answer_does_not_depend_on_the_unit_of_time() -> None:
    twist = np.array([0.05, 0.0, 1e-6, 0.0, 0.0, 0.0])
    slow, fast = (classify_motion([LEFT], s * twist, CENTER) for s in (1e-6, 1e6))
    assert slow.states == fast.states == (ContactMotion.SLIDING,)


def test_no_contacts_give_no_rows() -> None:
    kept, sliding = apply_motion([], [0.1, 0, 0, 0, 0, 0], CENTER)
    assert kept == ()
    assert sliding.shape == (0, 3)


@pytest.mark.parametrize(
    ("twist", "center", "velocities", "argument"),
    [
        ([0, 0, 0], CENTER, None, "object_twist: needs shape"),
        ([0, 0, 0, 0, 0, np.nan], CENTER, None, "object_twist: needs finite"),
        (["x"] * 6, CENTER, None, "object_twist: needs numbers"),
        (np.zeros(6), [0, 0], None, "center_of_mass: needs shape"),
        (np.zeros(6), CENTER, np.zeros((2, 3)), "body_velocities: needs shape"),
    ],
)
def test_bad_arrays_are_named(
    twist: object, center: object, velocities: object, argument: str
) -> None:
    with pytest.raises(ArgumentError, match=argument):
        classify_motion(SCENE, twist, center, velocities)  # pyright: ignore[reportArgumentType]
