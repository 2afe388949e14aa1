"""What is ruled out by the boxes and spheres around shapes is not deep, as coal measures it."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from graspless_pin import compiled
from graspless_pin.geometry.bodies.collision import BodyShapes, PlacedBodies
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.contact.distances import near_solids, separation, solids_of

COUNT = 60
DEPTH = 0.004


def placed(rng, shapes, spread=0.08) -> PlacedBodies:
    poses = np.tile(np.eye(4), (len(shapes), 1, 1))
    poses[:, :3, :3] = Rotation.random(len(shapes), rng=rng).as_matrix()
    poses[:, :3, 3] = rng.uniform(-spread, spread, (len(shapes), 3))
    names = tuple(map(str, range(len(shapes))))
    return PlacedBodies(BodyShapes(names, tuple(shapes)), poses)


def shape_of(rng, kind: int):
    a, b, c = rng.uniform(0.005, 0.06, 3)
    if kind == 3:
        return convex_geometry(rng.normal(size=(12, 3)) * [a, b, c])
    return (coal.Box(a, b, c), coal.Sphere(a), coal.Capsule(a, b))[kind]


def shapes_of(rng, kinds) -> list:
    return [shape_of(rng, int(kind)) for kind in kinds]


def within(bodies: PlacedBodies, depth: float, *, loops: bool = True) -> set[tuple[int, int]]:
    """The pairs that are left to be measured."""
    solids, count = solids_of(bodies.shapes), len(bodies)
    ones, twos = np.triu_indices(count, 1)
    if compiled.core is None or not loops:
        near = near_solids(bodies, solids, bodies, solids, -depth)
        return {(i, j) for i, j in near if i < j}
    pairs = compiled.core.BodyPairs(solids.for_loops, ones, twos)
    return set(pairs.within(bodies.poses, depth))


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("loops", [True, False], ids=["compiled", "numpy"])
def test_no_deep_pair_is_ruled_out(seed, loops):
    rng = np.random.default_rng(seed)
    bodies = placed(rng, shapes_of(rng, rng.integers(0, 4, COUNT)))
    left = within(bodies, DEPTH, loops=loops)
    deep = set()
    for i in range(COUNT):
        for j in range(i + 1, COUNT):
            if -separation(bodies[i], bodies[j]).distance > DEPTH + 1e-7:
                deep.add((i, j))
    assert deep <= left
    assert deep and len(left) < 0.6 * COUNT * (COUNT - 1) / 2


@pytest.mark.sampled(2)
@pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")
@pytest.mark.parametrize("seed", range(6))
def test_boxes_and_spheres_are_told_apart_exactly(seed):
    """All directions in which two boxes, two spheres, or a box and a centre outside, can part."""
    rng = np.random.default_rng(100 + seed)
    bodies = placed(rng, shapes_of(rng, [0] * 30 + [1] * 15))
    left = within(bodies, DEPTH)
    for i, j in sorted(left):
        if (i < 30) == (j < 30):
            assert -separation(bodies[i], bodies[j]).distance > DEPTH - 1e-7
    assert left


@pytest.mark.sampled(2)
@pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")
@pytest.mark.parametrize("seed", range(3))
def test_what_stands_around_is_compared_with_every_shape(seed):
    """Half-spaces, exactly where the shapes are boxes or spheres, and boxes."""
    rng = np.random.default_rng(200 + seed)
    bodies = placed(rng, shapes_of(rng, [0] * 15 + [1] * 15 + [2] * 10))
    normal = rng.normal(size=3)
    floor = coal.Halfspace(normal / np.linalg.norm(normal), float(rng.uniform(-0.02, 0.02)))
    around = placed(rng, [floor, coal.Box(0.05, 0.04, 0.03), coal.Sphere(0.03)])
    loops = compiled.core.BodyPairs(solids_of(bodies.shapes).for_loops, [], [])
    left = set(loops.beside(bodies.poses, solids_of(around.shapes).for_loops, around.poses, DEPTH))
    depths = {
        (k, m): -separation(bodies[k], around[m]).distance
        for k in range(len(bodies))
        for m in range(3)
    }
    assert {pair for pair, depth in depths.items() if depth > DEPTH + 1e-7} <= left
    sharp = {(k, 0) for k in range(30)} | {(k, 1) for k in range(15)}
    assert all(depths[pair] > DEPTH - 1e-7 for pair in left & sharp)
    assert len(left) < len(depths)
