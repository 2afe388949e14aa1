"""Declared motion: sliding, sticking, separating and penetrating contacts, by hand."""

import math

import numpy as np
import pytest

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import HalfSpace
from graspless_pin.geometry.contact.contact_points import (
    SPEED_TOLERANCE,
    BodyKind,
    ContactArrays,
    ContactPoint,
    contacts_that_stay,
    support_velocities,
    velocities_at,
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


def apply_motion(contacts, twist, center, velocities=None, name: str = "object"):
    """The contacts that stay, and their sliding velocities."""
    others = np.zeros((len(contacts), 3)) if velocities is None else np.array(velocities)
    motion = np.array(twist, dtype=float), np.array(center), others
    kept, sliding = contacts_that_stay(contacts, *motion, name)
    assert sliding.shape == (len(contacts), 3)
    assert not sliding.flags.writeable
    return tuple(contacts[k] for k in kept), sliding[kept]


# A cube of edge 0.2 on the table, its centre at CENTER, with a finger on its back.
BACK = contact((-0.1, 0.0, 0.1), (1, 0, 0), "finger", BodyKind.HAND)
LEFT = contact((-0.1, 0.0, 0.0), (0, 0, 1))
RIGHT = contact((0.1, 0.0, 0.0), (0, 0, 1))
SCENE = [BACK, LEFT, RIGHT]


def test_velocities_agree_with_finite_differences_of_a_rotation() -> None:
    rng = np.random.default_rng(3)
    twist, points, step = rng.normal(size=6), rng.normal(size=(5, 3)), 1e-6
    axis = twist[3:] / np.linalg.norm(twist[3:])
    angle = step * np.linalg.norm(twist[3:])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    moved = (points - CENTER) @ turn.T + CENTER + step * twist[:3]
    assert np.allclose(velocities_at(twist, CENTER, points), (moved - points) / step, atol=1e-5)


def test_a_cube_that_tips_over_its_edge_sticks_there_and_leaves_elsewhere() -> None:
    # Turning about the y axis through the right edge: v = omega x (c - edge).
    omega = np.array([0.0, 0.2, 0.0])
    velocity = np.cross(omega, CENTER - RIGHT.position)
    twist = np.concatenate([velocity, omega])
    kept, sliding = apply_motion([LEFT, RIGHT], twist, CENTER)
    assert kept == (RIGHT,)
    assert np.allclose(sliding, np.zeros((1, 3)))


TOUCH = [contact((0, 0, 0), (0, 0, 1))]
FOLLOW = np.array([[0.05, 0, 0], [0, 0, 0], [0, 0, 0]])
TURN = [0, 0, 0, 0.3, 0.5, 0]
AT_BACK = velocities_at(np.array(TURN), CENTER, BACK.position[None])
MOTIONS = {
    # contacts, twist, velocities of the bodies, and how each slides
    "no motion": (SCENE, [np.zeros(6)], np.zeros((3, 3))),
    "pushed by a finger": (SCENE, [[0.05, 0, 0, 0, 0, 0], FOLLOW],
                           [[0, 0, 0], [0.05, 0, 0], [0.05, 0, 0]]),
    "a ball that rolls": (TOUCH, [[0.1, 0, 0, 0, 1.0, 0]], [[0, 0, 0]]),
    "a ball that spins": (TOUCH, [[0, 0, 0, 0, 0, 1.0]], [[0, 0, 0]]),
    "a ball that slips": (TOUCH, [[0.12, 0, 0, 0, 1.0, 0]], [[0.02, 0, 0]]),
    "a tip that turns along": ([BACK], [TURN, AT_BACK], [[0, 0, 0]]),
}  # fmt: skip


@pytest.mark.parametrize(("touching", "motion", "sliding"), MOTIONS.values(), ids=MOTIONS)
def test_contacts_stick_roll_or_slide(touching, motion, sliding) -> None:
    twist, *of_bodies = motion
    kept, found = apply_motion(touching, twist, CENTER, *of_bodies)
    assert kept == tuple(touching)
    assert np.allclose(found, sliding, rtol=0.0)
    assert (found.any(axis=1) == np.any(sliding, axis=1)).all()


def conveyor(velocity: object) -> Support:
    T = np.eye(4)
    T[:3, 3] = [0.5, 0.0, 0.0]
    return Support("table", HalfSpace(), T, velocity=np.asarray(velocity, dtype=float))


def test_a_conveyor_slides_under_a_held_object_and_carries_a_free_one() -> None:
    belt = conveyor([0.3, 0.1, 0, 0, 0, 0])
    velocities = support_velocities(SCENE, [belt])
    assert np.allclose(velocities, [[0, 0, 0], [0.3, 0.1, 0], [0.3, 0.1, 0]])
    kept, held = apply_motion(SCENE, np.zeros(6), CENTER, velocities)
    assert kept == tuple(SCENE)
    assert not held[0].any()
    assert np.allclose(held[1:], -velocities[1:])
    kept, carried = apply_motion([LEFT, RIGHT], [0.3, 0.1, 0, 0, 0, 0], CENTER, velocities[1:])
    assert kept == (LEFT, RIGHT)
    assert not carried.any()


def test_a_turntable_moves_about_the_origin_of_its_own_frame() -> None:
    table = conveyor([0, 0, 0, 0, 0, 2.0])
    velocities = support_velocities([LEFT, RIGHT], [table])
    assert np.allclose(velocities, [[0, -1.2, 0], [0, -0.8, 0]])
    # The object turns with it.
    center = np.array([0.0, 0.0, 0.1])
    twist = [0, -1.0, 0, 0, 0, 2.0]
    kept, sliding = apply_motion([LEFT, RIGHT], twist, center, velocities)
    assert kept == (LEFT, RIGHT)
    assert not sliding.any()


def test_a_support_that_rises_into_the_object_is_named() -> None:
    lift = conveyor([0, 0, 0.05, 0, 0, 0])
    velocities = support_velocities([LEFT], [lift])
    with pytest.raises(SceneError, match=r"into support 'table' at 0\.05 m/s"):
        apply_motion([LEFT], np.zeros(6), CENTER, velocities)


def test_an_unknown_support_is_named_with_those_that_are_there() -> None:
    floor = Support("floor", HalfSpace(), np.eye(4))
    with pytest.raises(ArgumentError, match="unknown support 'table'; known: floor"):
        support_velocities(SCENE, [floor])


def test_sliding_has_no_part_along_the_normal() -> None:
    normal = np.array([0.0009, 0.0, 1.0]) / math.hypot(0.0009, 1.0)
    tilted = contact((0, 0, 0), tuple(normal.tolist()))
    kept, sliding = apply_motion([tilted], [0.1, 0, 0, 0, 0, 0], CENTER)
    assert kept == (tilted,)
    assert sliding.any()
    assert abs(sliding[0] @ normal) < 1e-17


def test_driving_into_bodies_names_each_with_its_speed() -> None:
    with pytest.raises(SceneError, match=r"object 'cube' into support 'table' at 0\.02 m/s"):
        apply_motion([LEFT, RIGHT], [0, 0, -0.02, 0, 0, 0], CENTER, name="cube")
    with pytest.raises(SceneError, match=r"hand link 'finger' at 0\.03 m/s, support 'table' at"):
        apply_motion(SCENE, [-0.03, 0, -0.02, 0, 0, 0], CENTER)


def test_the_answer_does_not_depend_on_the_unit_of_time() -> None:
    twist = np.array([0.05, 0.0, 1e-6, 0.0, 0.0, 0.0])
    for speed in (1e-6, 1e6):
        kept, sliding = apply_motion([LEFT], speed * twist, CENTER)
        assert kept == (LEFT,)
        assert sliding.any()


def test_no_contacts_give_no_rows() -> None:
    kept, sliding = apply_motion([], [0.1, 0, 0, 0, 0, 0], CENTER)
    assert kept == ()
    assert sliding.shape == (0, 3)


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
    kept, sliding = apply_motion(touching, twist, np.zeros(3))
    assert len(kept) == 2
    assert sliding.any(axis=1).tolist() == [True, slip > SPEED_TOLERANCE]
