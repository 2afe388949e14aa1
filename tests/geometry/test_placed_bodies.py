"""Bodies that are placed together, contacts as arrays, and boxes by their signs."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from hypothesis import strategies as st
from tests.geometry.contact_tools import find_contacts

from graspless_pin.geometry.bodies.collision import BodyShapes, CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactArrays, ContactPoint

HALF = np.array([0.1, 0.2, 0.05])
PART = st.floats(-0.4, 0.4)


def three_balls() -> PlacedBodies:
    poses = np.array([np.eye(4)] * 3)
    poses[:, 2, 3] = [0.0, 1.0, 2.0]
    return PlacedBodies(BodyShapes(("a", "b", "c"), (coal.Sphere(0.1),) * 3), poses)


def test_placed_bodies_are_a_sequence_of_the_same_objects() -> None:
    balls = three_balls()
    assert len(balls) == 3
    assert [body.name for body in balls] == ["a", "b", "c"]
    assert balls[-1] is balls[2]
    assert balls[1:] == (balls[1], balls[2])
    assert balls[2].T_world_geometry[2, 3] == 2.0
    assert not balls[2].T_world_geometry.flags.writeable
    for index in (3, -4):
        with pytest.raises(IndexError):
            balls[index]


def test_bodies_given_one_by_one_stay_themselves() -> None:
    balls = three_balls()
    assert PlacedBodies.of(balls) is balls
    floor = CollisionBody("floor", coal.Box(1.0, 1.0, 0.2), np.eye(4))
    mixed = PlacedBodies.of([floor, balls[1]])
    assert mixed[0] is floor
    assert mixed[1] is balls[1]
    np.testing.assert_array_equal(mixed.poses, [floor.T_world_geometry, balls[1].T_world_geometry])
    assert PlacedBodies.of([]).poses.shape == (0, 4, 4)


def test_placed_and_single_bodies_touch_alike() -> None:
    T = np.eye(4)
    T[:3, 3] = [0.01, 0.02, 0.1 + 0.05 + 2e-4]
    box = CollisionBody("box", coal.Box(0.2, 0.2, 0.1), T)
    balls = three_balls()
    ours = find_contacts(box, balls, ())
    theirs = find_contacts([box], list(balls), ())
    assert [point.body for point in ours] == [point.body for point in theirs] == ["a"]
    np.testing.assert_array_equal(ours[0].position, theirs[0].position)
    assert ours[0].distance == pytest.approx(2e-4)


def test_contact_arrays_are_the_contacts() -> None:
    points = [
        ContactPoint(name, kind, np.full(3, float(k)), np.array([0.0, 0.0, 1.0]), 0.1 * k)
        for k, (name, kind) in enumerate([("tip", BodyKind.HAND), ("floor", BodyKind.SUPPORT)])
    ]
    arrays = ContactArrays.of(points)
    assert ContactArrays.of(arrays) is arrays
    assert (len(arrays), arrays.hand_count) == (2, 1)
    assert [point.body for point in arrays[:1]] == ["tip"]
    twice = arrays.followed_by(arrays).at_indices([3, 0])
    assert twice.bodies == ("floor", "tip")
    assert twice.kinds == (BodyKind.SUPPORT, BodyKind.HAND)
    np.testing.assert_array_equal(twice.positions, [[1.0] * 3, [0.0] * 3])
    assert twice[0].distance == 0.1
    assert not twice[0].position.flags.writeable
    with pytest.raises(IndexError):
        arrays[2]
