"""What is ruled out by the boxes and spheres around shapes is not deep, as coal measures it."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from hand_loops import may_be_deep
from scipy.spatial.transform import Rotation

from graspless_pin import compiled
from graspless_pin.geometry.bodies.collision import BodyShapes, PlacedBodies
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.contact.distances import deep_pairs, separation, solids_of
from graspless_pin.geometry.poses import rigid

COUNT = 60
DEPTH = 0.004


def placed(rng, shapes, spread=0.08) -> PlacedBodies:
    poses = np.tile(np.eye(4), (len(shapes), 1, 1))
    poses[:, :3, :3] = Rotation.random(len(shapes), rng=rng).as_matrix()
    poses[:, :3, 3] = rng.uniform(-spread, spread, (len(shapes), 3))
    names = tuple(map(str, range(len(shapes))))
    return PlacedBodies(BodyShapes(names, tuple(shapes)), poses)


def shape_of(rng, kind: int):
    a, b, c = rng.uniform(0.002, 0.06, 3)
    if kind == 3:
        return convex_geometry(rng.normal(size=(12, 3)) * [a, b, c])
    shapes = coal.Box(a, b, c), coal.Sphere(a), coal.Capsule(a, b), None, coal.Cylinder(a, b)
    return (*shapes, coal.Cone(a, b))[kind]


def shapes_of(rng, kinds) -> list:
    return [shape_of(rng, int(kind)) for kind in kinds]


def left_by(form: str, bodies: PlacedBodies, around: PlacedBodies, pairs) -> set[tuple[int, int]]:
    """The pairs that are left to be measured; the loops are asked for one after the other."""
    if form == "numpy":
        return set(map(tuple, deep_pairs(bodies, around, np.array(pairs), DEPTH).tolist()))
    assert compiled.core is not None
    left = set()
    for i, j in pairs:
        both = bodies is around
        own = parts(bodies, [i, j] if both else [i])
        others = parts(around, [] if both else [j])
        sets, beside = solids_of(own.shapes).compiled_sets, solids_of(others.shapes).compiled_sets
        pair = compiled.core.BodyPairs(sets, *(([0], [1]) if both else ([], [])))
        deep = may_be_deep(pair, sets, own.poses, beside, others.poses, DEPTH)
        if deep:
            left.add((i, j))
    return left


def parts(bodies: PlacedBodies, chosen: list[int]) -> PlacedBodies:
    names, shapes = bodies.shapes.names, bodies.shapes.geometries
    some = BodyShapes(tuple(names[k] for k in chosen), tuple(shapes[k] for k in chosen))
    return PlacedBodies(some, bodies.poses[chosen])


def pairs_within(bodies: PlacedBodies) -> list[tuple[int, int]]:
    return [(i, j) for j in range(len(bodies)) for i in range(j)]


def depths_of(bodies, around, pairs) -> dict[tuple[int, int], float]:
    return {(i, j): -separation(bodies[i], around[j]).distance for i, j in pairs}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(6))
def test_no_deep_pair_is_ruled_out(seed, form):
    rng = np.random.default_rng(seed)
    bodies = placed(rng, shapes_of(rng, rng.integers(0, 6, COUNT)))
    pairs = pairs_within(bodies)
    left = left_by(form, bodies, bodies, pairs)
    depths = depths_of(bodies, bodies, pairs)
    deep = {pair for pair, depth in depths.items() if depth > DEPTH + 1e-7}
    assert deep <= left
    assert deep and len(left) < 0.7 * len(pairs)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(6))
def test_boxes_and_spheres_are_told_apart(seed, form):
    """Two spheres exactly; in the loops, all directions in which two boxes can part, too."""
    rng = np.random.default_rng(100 + seed)
    bodies = placed(rng, shapes_of(rng, [0] * 30 + [1] * 15))
    pairs = pairs_within(bodies)
    left, depths = left_by(form, bodies, bodies, pairs), depths_of(bodies, bodies, pairs)
    exact = {(i, j) for i, j in left if (i < 30) == (j < 30) and (i >= 30 or form != "numpy")}
    assert all(depths[pair] > DEPTH - 1e-7 for pair in exact)
    assert exact


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(3))
def test_what_stands_around_is_compared_with_every_shape(seed, form):
    """Half-spaces and boxes, exactly where the shapes are spheres."""
    rng = np.random.default_rng(200 + seed)
    bodies = placed(rng, shapes_of(rng, [0] * 15 + [1] * 15 + [2] * 10))
    normal = rng.normal(size=3)
    floor = coal.Halfspace(normal / np.linalg.norm(normal), float(rng.uniform(-0.02, 0.02)))
    around = placed(rng, [floor, coal.Box(0.05, 0.04, 0.03), coal.Sphere(0.03)])
    pairs = [(k, m) for k in range(len(bodies)) for m in range(3)]
    left, depths = left_by(form, bodies, around, pairs), depths_of(bodies, around, pairs)
    assert {pair for pair, depth in depths.items() if depth > DEPTH + 1e-7} <= left
    sharp = {(k, m) for k in range(15, 30) for m in (0, 2)}
    if form != "numpy":
        sharp |= {(k, m) for k in range(15) for m in (0, 1)}
    assert all(depths[pair] > DEPTH - 1e-7 for pair in left & sharp)
    assert len(left) < len(depths)


@pytest.mark.skipif(compiled.core is None, reason="numpy compares with spheres alone")
@pytest.mark.parametrize("other", [coal.Box(0.1, 0.1, 0.02), coal.Halfspace(0.0, 0.0, 1.0, 0.01)])
def test_of_a_cylinder_the_corners_of_its_box_do_not_count(other):
    """Its axis is level over a face, and its box is turned by 45 degrees about it; it stands."""
    lying = Rotation.from_euler("ZXZ", [30.0, 90.0, 45.0], degrees=True).as_matrix()
    shapes = BodyShapes(("link", "plate"), (coal.Cylinder(0.02, 0.05), other))
    # The face is at 10 mm: 4 mm deep it reaches below 6 mm.
    for turn, lowest in ((lying, 0.02), (np.eye(3), 0.025)):
        for height, left in ((0.0061, set()), (0.0059, {(0, 0)})):
            poses = np.array([rigid([0.0, 0.0, height + lowest], turn), np.eye(4)])
            bodies = PlacedBodies(shapes, poses)
            assert left_by("compiled", parts(bodies, [0]), parts(bodies, [1]), [(0, 0)]) == left


def test_what_is_smaller_than_the_depth_may_be_deeper(form):
    """A sphere of 3 mm in the middle of a box is 23 mm deep."""
    shapes = BodyShapes(("tip", "block"), (coal.Sphere(0.003), coal.Box(0.04, 0.05, 0.06)))
    bodies = PlacedBodies(shapes, np.repeat(np.eye(4)[None], 2, axis=0))
    assert separation(bodies[0], bodies[1]).distance == pytest.approx(-0.023)
    assert left_by(form, bodies, bodies, [(0, 1)]) == {(0, 1)}
    assert left_by(form, parts(bodies, [0]), parts(bodies, [1]), [(0, 0)]) == {(0, 0)}
    assert left_by(form, parts(bodies, [1]), parts(bodies, [0]), [(0, 0)]) == {(0, 0)}
