"""The broad phase: it keeps every pair that coal finds near, and drops most that are far."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.bodies.collision import BodyShapes, CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.contact.distances import near_pairs

SHAPES = (
    coal.Box(0.1, 0.3, 0.02),
    coal.Sphere(0.05),
    coal.Capsule(0.02, 0.2),
    coal.Cylinder(0.06, 0.1),
    coal.Cone(0.05, 0.2),
    convex_geometry(np.random.default_rng(3).normal(size=(15, 3)) * 0.05 + [0.2, 0.0, 0.1]),
)
TOLERANCE = 5e-3


def random_bodies(rng: np.random.Generator, count: int, spread: float) -> list[CollisionBody]:
    bodies = []
    for k in range(count):
        T = np.eye(4)
        T[:3, :3] = Rotation.random(rng=rng).as_matrix()
        T[:3, 3] = rng.uniform(-spread, spread, 3)
        bodies.append(CollisionBody(f"body {k}", SHAPES[k % len(SHAPES)], T))
    return bodies


def distance(first: CollisionBody, second: CollisionBody) -> float:
    poses = [
        coal.Transform3s(body.T_world_geometry[:3, :3].copy(), body.T_world_geometry[:3, 3].copy())
        for body in (first, second)
    ]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return float(
        coal.distance(first.geometry, poses[0], second.geometry, poses[1], request, result)
    )


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(5))
def test_no_near_pair_is_lost_and_most_far_ones_are_dropped(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = random_bodies(rng, 12, 0.2), random_bodies(rng, 18, 0.2)
    pairs = near_pairs(first, second, TOLERANCE)
    distances = np.array([[distance(a, b) for b in second] for a in first])
    near = set(zip(*(index.tolist() for index in np.nonzero(distances <= TOLERANCE)), strict=True))
    assert near
    assert near <= set(pairs)
    assert len(pairs) < 0.5 * distances.size
    assert pairs == sorted(pairs, key=lambda pair: (pair[1], pair[0]))


def test_a_half_space_is_always_near() -> None:
    floor = CollisionBody("floor", coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), np.eye(4))
    far = np.eye(4)
    far[:3, 3] = [1e3, -2e3, 5e3]
    ball = CollisionBody("ball", coal.Sphere(0.1), far)
    assert near_pairs([ball], [floor, ball, floor], TOLERANCE) == [(0, 0), (0, 1), (0, 2)]
    assert near_pairs([], [floor], TOLERANCE) == []
    assert near_pairs([ball], [], TOLERANCE) == []


@pytest.mark.parametrize("count", [1, 4])
def test_pieces_at_one_pose_are_near_what_they_are_near_one_by_one(count: int) -> None:
    rng = np.random.default_rng(count)
    (first,), second = random_bodies(rng, 1, 0.05), random_bodies(rng, 30, 0.3)
    shapes = BodyShapes(("piece",) * count, SHAPES[-count:])  # the hull is not about its origin
    together = PlacedBodies(shapes, first.T_world_geometry[None].repeat(count, axis=0))
    apart = [CollisionBody("piece", shape, first.T_world_geometry) for shape in SHAPES[-count:]]
    pairs = near_pairs(together, second, TOLERANCE)
    assert pairs == near_pairs(apart, second, TOLERANCE)
    assert 0 < len(pairs) < 0.8 * 30 * count
