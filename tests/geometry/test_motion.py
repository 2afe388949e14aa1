"""Declared motion: sliding, sticking, separating and penetrating contacts, by hand."""

import math

import numpy as np
import pytest

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import HalfSpace
from graspless_pin.geometry.contact.contact_points import (
    SPEED_TOLERANCE,
    ContactArrays,
    ContactMotion,
    classify_motion,
    contacts_that_stay,
    support_velocities,
    twist_velocities,
)
from graspless_pin.geometry.contact.finding import BodyKind, ContactPoint

Q = math.sqrt(0.5)
CENTER = np.array([0.0, 0.0, 0.1])


def contact(
    position: tuple[float, float, float],
    normal: tuple[float, float, float],
    body: str = "table",
    kind: BodyKind = BodyKind.SUPPORT,
) -> ContactPoint:
    return ContactPoint(body, kind, np.array(position), np.array(normal), 0.0)


def apply_motion(contacts, *motion, name: str = "object"):
    """The contacts that stay, and their sliding velocities."""
    classified = classify_motion(contacts, *motion)
    kept = contacts_that_stay(contacts, classified, name)
    return tuple(contacts[k] for k in kept), classified.sliding[kept]


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


def test_a_cube_that_tips_over_its_edge_sticks_there_and_leaves_elsewhere() -> None:
    # Turning about the y axis through the right edge: v = omega x (c - edge).
    omega = np.array([0.0, 0.2, 0.0])
    velocity = np.cross(omega, CENTER - RIGHT.position)
    twist = np.concatenate([velocity, omega])
    motion = classify_motion([LEFT, RIGHT], twist, CENTER)
    assert motion.states == (ContactMotion.SEPARATING, ContactMotion.ROLLING)
    assert np.allclose(motion.normal_speeds, [0.04, 0.0])
    kept, sliding = apply_motion([LEFT, RIGHT], twist, CENTER)
    assert kept == (RIGHT,)
    assert np.allclose(sliding, np.zeros((1, 3)))


TOUCH = [contact((0, 0, 0), (0, 0, 1))]
STILL, SLIDES, ROLLS = ContactMotion.STICKING, ContactMotion.SLIDING, ContactMotion.ROLLING
FOLLOW = np.array([[0.05, 0, 0], [0, 0, 0], [0, 0, 0]])
TURN = [0, 0, 0, 0.3, 0.5, 0]
AT_BACK = twist_velocities(np.array(TURN), CENTER, BACK.position)
MOTIONS = {
    # contacts, twist, velocities of the bodies, what each does, and how it slides
    "no motion": (SCENE, [np.zeros(6)], [STILL] * 3, 0.0),
    "pushed by a finger": (SCENE, [[0.05, 0, 0, 0, 0, 0], FOLLOW], [STILL, SLIDES, SLIDES],
                           [[0, 0, 0], [0.05, 0, 0], [0.05, 0, 0]]),
    "a ball that rolls": (TOUCH, [[0.1, 0, 0, 0, 1.0, 0]], [ROLLS], 0.0),
    "a ball that spins": (TOUCH, [[0, 0, 0, 0, 0, 1.0]], [STILL], 0.0),
    "a ball that slips": (TOUCH, [[0.12, 0, 0, 0, 1.0, 0]], [SLIDES], [[0.02, 0, 0]]),
    "a tip that turns along": ([BACK], [TURN, AT_BACK, [[0.3, 0.5, 0]]], [STILL], 0.0),
    "a tip that rolls off": ([BACK], [TURN, AT_BACK, [[0.3, -0.1, 0]]], [ROLLS], 0.0),
    "a tip that rolls on what rests": ([BACK], [np.zeros(6), np.zeros((1, 3)), [[0, 1.0, 0]]],
                                       [ROLLS], 0.0),
}  # fmt: skip


@pytest.mark.parametrize(("touching", "motion", "states", "sliding"), MOTIONS.values(), ids=MOTIONS)
def test_contacts_stick_slide_or_roll(touching, motion, states, sliding) -> None:
    twist, *of_bodies = motion
    found = classify_motion(touching, twist, CENTER, *of_bodies)
    assert list(found.states) == states
    assert np.allclose(found.sliding, sliding)
    kept, _ = apply_motion(touching, twist, CENTER, *of_bodies)
    assert kept == tuple(touching)
    assert [state.sticks for state in ContactMotion] == [True, True, False, False, False]


def conveyor(velocity: object) -> Support:
    T = np.eye(4)
    T[:3, 3] = [0.5, 0.0, 0.0]
    return Support("table", HalfSpace(), T, velocity=np.asarray(velocity, dtype=float))


def test_a_conveyor_slides_under_a_held_object_and_carries_a_free_one() -> None:
    belt = conveyor([0.3, 0.1, 0, 0, 0, 0])
    velocities, turning = support_velocities(SCENE, [belt])
    assert np.allclose(velocities, [[0, 0, 0], [0.3, 0.1, 0], [0.3, 0.1, 0]])
    assert not turning.any()
    held = classify_motion(SCENE, np.zeros(6), CENTER, velocities, turning)
    assert held.states == (STILL, SLIDES, SLIDES)
    assert np.allclose(held.sliding[1:], -velocities[1:])
    carried = classify_motion([LEFT, RIGHT], [0.3, 0.1, 0, 0, 0, 0], CENTER, velocities[1:])
    assert carried.states == (ContactMotion.STICKING,) * 2


def test_a_turntable_moves_about_the_origin_of_its_own_frame() -> None:
    table = conveyor([0, 0, 0, 0, 0, 2.0])
    velocities, turning = support_velocities([LEFT, RIGHT], [table])
    assert np.allclose(velocities, [[0, -1.2, 0], [0, -0.8, 0]])
    assert np.allclose(turning, [[0, 0, 2.0]] * 2)
    # The object turns with it.
    center = np.array([0.0, 0.0, 0.1])
    twist = [0, -1.0, 0, 0, 0, 2.0]
    motion = classify_motion([LEFT, RIGHT], twist, center, velocities, turning)
    assert motion.states == (ContactMotion.STICKING,) * 2


def test_a_support_that_rises_into_the_object_is_named() -> None:
    lift = conveyor([0, 0, 0.05, 0, 0, 0])
    velocities, turning = support_velocities([LEFT], [lift])
    with pytest.raises(SceneError, match=r"into support 'table' at 0\.05 m/s"):
        apply_motion([LEFT], np.zeros(6), CENTER, velocities, turning)


def test_an_unknown_support_is_named_with_those_that_are_there() -> None:
    floor = Support("floor", HalfSpace(), np.eye(4))
    with pytest.raises(ArgumentError, match="has no support 'table'; known: 'floor'"):
        support_velocities(SCENE, [floor])


def test_sliding_has_no_part_along_the_normal() -> None:
    normal = np.array([0.001, 0.0, 1.0]) / math.hypot(0.001, 1.0)
    tilted = contact((0, 0, 0), tuple(normal.tolist()))
    motion = classify_motion([tilted], [0.1, 0, 0, 0, 0, 0], CENTER, speed_tolerance=0.01)
    assert motion.states == (ContactMotion.SLIDING,)
    assert abs(motion.sliding[0] @ normal) < 1e-17


def test_driving_into_bodies_names_each_with_its_speed() -> None:
    with pytest.raises(SceneError, match=r"object 'cube' into support 'table' at 0\.02 m/s"):
        apply_motion([LEFT, RIGHT], [0, 0, -0.02, 0, 0, 0], CENTER, name="cube")
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
    ("arrays", "argument"),
    [
        (([0, 0, 0], CENTER), "object_twist: has shape"),
        (([0, 0, 0, 0, 0, np.nan], CENTER), "object_twist: is NaN"),
        ((["x"] * 6, CENTER), "object_twist: is "),
        ((np.zeros(6), [0, 0]), "center_of_mass: has shape"),
        ((np.zeros(6), CENTER, np.zeros((2, 3))), "body_velocities: has shape"),
        ((np.zeros(6), CENTER, None, np.zeros((2, 3))), "body_angular_velocities: has shape"),
    ],
)
def test_bad_arrays_are_named(arrays, argument: str) -> None:
    with pytest.raises(ArgumentError, match=argument):
        classify_motion(SCENE, *arrays)


@pytest.mark.parametrize("far", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("slip", [0.1, 3e-3, 3e-4, 1e-6])
def test_turning_is_weighed_by_the_longest_arm(far, slip):
    """A contact near the axis of a turning object moves at a share of the fastest speed."""
    positions = np.array([[far, 0.0, 0.0], [0.0, slip * far, 0.0]])
    touching = ContactArrays(
        ("body",) * 2,
        (BodyKind.SUPPORT,) * 2,
        positions,
        np.array([[0.0, 0.0, 1.0]] * 2),
        (0.0,) * 2,
    )
    twist = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    first, second = classify_motion(touching, twist, np.zeros(3), None, None).states
    assert first is ContactMotion.SLIDING
    assert (second is ContactMotion.SLIDING) == (slip > SPEED_TOLERANCE)
