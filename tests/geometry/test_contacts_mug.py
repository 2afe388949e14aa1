"""A mug cut into convex pieces: known support points and touches in random poses."""

import math
from collections.abc import Iterator
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from mugs import BOTTOM, HANDLE, HEIGHT, RADIUS, SIDES, WALL, cut_mug, rim
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.contact.finding import find_contacts

GROUNDS = {
    "half-space": (coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), 0.0),
    "box": (coal.Box(1.0, 1.0, 0.2), 0.1),
    "hull": (
        convex_geometry(
            np.array(
                [
                    (0.4 * math.cos(k), 0.4 * math.sin(k), z)
                    for k in np.arange(12) * math.pi / 6
                    for z in (-0.1, 0.1)
                ]
            )
        ),
        0.1,
    ),
}


@pytest.fixture(scope="module")
def mug(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, ...]]:
    """The pieces of the mug."""
    with cut_mug(tmp_path_factory) as shape:
        yield shape.pieces()


def place(position: object, rotation: Rotation | None = None) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = np.asarray(position, dtype=float)
    if rotation is not None:
        T[:3, :3] = rotation.as_matrix()
    return T


def bodies(pieces: tuple[Any, ...], T: np.ndarray) -> list[CollisionBody]:
    return [CollisionBody("mug", piece, T) for piece in pieces]


def random_world(rng: np.random.Generator) -> np.ndarray:
    return place(rng.uniform(-1.0, 1.0, 3), Rotation.random(rng=rng))


def mismatch(found: np.ndarray, expected: np.ndarray) -> float:
    distances = np.linalg.norm(found[:, None] - expected[None], axis=2)
    return float(max(distances.min(axis=0).max(), distances.min(axis=1).max()))


@pytest.mark.parametrize("ground", GROUNDS)
def test_the_mug_stands_on_its_base_in_random_poses(mug: tuple[Any, ...], ground: str) -> None:
    rng = np.random.default_rng(11)
    for k in range(60):
        gap = rng.uniform(-5e-4, 5e-4) if k % 4 else (0.0, 1e-6, -1e-6)[k // 4 % 3]
        world = random_world(rng)
        turn = Rotation.from_euler("z", rng.uniform(-3, 3))
        T = world @ place([*rng.uniform(-0.1, 0.1, 2), 0.5 * HEIGHT + gap], turn)
        geometry, top = GROUNDS[ground]
        floor = CollisionBody("ground", geometry, world @ place([0, 0, -top]))
        expected = rim() @ T[:3, :3].T + T[:3, 3] - 0.5 * gap * world[:3, 2]
        shuffled = tuple(mug[index] for index in rng.permutation(len(mug)))
        orders = [(bodies(shuffled, T), [floor], 1.0)]
        if ground != "half-space":
            orders.append(([floor], bodies(shuffled, T), -1.0))
        for first, second, sign in orders:
            contacts = find_contacts(first, [], second, max_points=SIDES)
            assert len(contacts) == SIDES, (k, gap)
            # CoACD moves corners by about a micrometre.
            assert mismatch(np.array([c.position for c in contacts]), expected) < 1e-5, (k, gap)
            for contact in contacts:
                assert contact.distance == pytest.approx(gap, abs=1e-5)
                assert np.allclose(contact.normal, sign * world[:3, 2], atol=1e-4)


def test_a_bounded_number_of_support_points_keeps_most_of_the_base(mug: tuple[Any, ...]) -> None:
    T = place([0, 0, 0.5 * HEIGHT])
    floor = CollisionBody("ground", GROUNDS["half-space"][0], np.eye(4))
    for count, share in ((8, 0.91), (4, 0.55), (3, 0.4)):
        points = np.array(
            [c.position[:2] for c in find_contacts(bodies(mug, T), [], [floor], max_points=count)]
        )
        assert len(points) == count
        assert np.allclose(np.hypot(*points.T), RADIUS, atol=1e-5)
        following = np.roll(points, -1, axis=0)
        area = 0.5 * np.sum(points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0])
        whole = 0.5 * SIDES * RADIUS**2 * math.sin(2 * math.pi / SIDES)
        assert area > share * whole


def test_lying_on_its_handle_the_mug_touches_with_rim_and_handle(mug: tuple[Any, ...]) -> None:
    # Turned about y, the handle points down and stands on the floor with its flat side.
    T = place([0, 0, HANDLE], Rotation.from_euler("y", 90, degrees=True))
    floor = CollisionBody("ground", GROUNDS["half-space"][0], np.eye(4))
    contacts = find_contacts(bodies(mug, T), [], [floor])
    found = np.array([c.position for c in contacts])
    corners = np.array([(x, y, 0.0) for x in (-0.036, 0.036) for y in (-0.006, 0.006)])
    assert len(contacts) == 4
    assert mismatch(found, corners) < 1e-5


FLAT = 7.0 * math.pi / SIDES  # a flat side away from the handle faces this way
ASIDE = np.array([math.cos(FLAT), math.sin(FLAT), 0.0])
OUTER = RADIUS * math.cos(math.pi / SIDES)
INNER = (RADIUS - WALL) * math.cos(math.pi / SIDES)
UP = np.array([0.0, 0.0, 1.0])
EAST = np.array([1.0, 0.0, 0.0])
FLOOR = BOTTOM - 0.5 * HEIGHT
# point of the mug's surface that is touched, and the normal out of the mug there
TOUCHES = {
    "outside": (OUTER * ASIDE + 0.02 * UP, ASIDE),
    "inside": (INNER * ASIDE - 0.01 * UP, -ASIDE),
    "inside, other side": (-INNER * ASIDE + 0.03 * UP, ASIDE),
    "bottom from within": (np.array([0.003, 0.005, FLOOR]), UP),
    "base from below": (np.array([0.01, -0.01, -0.5 * HEIGHT]), -UP),
    "handle from outside": (np.array([HANDLE, 0.001, 0.01]), EAST),
    "handle from within": (np.array([0.064, 0.002, -0.004]), -EAST),
    "handle from below, within": (np.array([0.053, -0.001, 0.024]), -UP),
}


@pytest.mark.parametrize("name", TOUCHES)
def test_a_fingertip_touches_the_mug_where_its_surface_is(mug: tuple[Any, ...], name: str) -> None:
    point, outward = TOUCHES[name]
    rng = np.random.default_rng(5)
    for _ in range(10):
        world, gap = random_world(rng), rng.uniform(-5e-4, 5e-4)
        center = world @ place(point + (0.008 + gap) * outward)
        contacts = find_contacts(
            bodies(mug, world), [CollisionBody("tip", coal.Sphere(0.008), center)], []
        )
        assert len(contacts) == 1
        expected = world[:3, :3] @ (point + 0.5 * gap * outward) + world[:3, 3]
        # CoACD fills hollows a little: where the surface is hollow, it may lean.
        slack = 3e-4 if "within" in name or "inside" in name else 1e-5
        assert np.linalg.norm(contacts[0].position - expected) < slack
        assert contacts[0].distance == pytest.approx(gap, abs=5e-5)
        assert (contacts[0].normal @ world[:3, :3]) @ outward < -0.999


def test_nothing_touches_a_fingertip_in_the_hollow_or_in_the_handle(mug: tuple[Any, ...]) -> None:
    for position in ((0, 0, 0), (0, 0, 0.04), (0.053, 0, 0)):
        tip = CollisionBody("tip", coal.Sphere(0.008), place(position))
        assert find_contacts(bodies(mug, np.eye(4)), [tip], []) == ()
