"""Bodies relabelled, reordered or moved together: no contact is lost or doubled."""

from __future__ import annotations

import itertools
import math

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from hand_tools import random_pose
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from test_contacts_random import SHAPES
from tests.geometry.contact_tools import find_contacts

from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.contact.contact_points import ContactPoint
from graspless_pin.geometry.contact.distances import separation
from graspless_pin.geometry.contact.polygons import Polygon, planar_hull, reduce_polygon
from graspless_pin.geometry.poses import pose_matrix

HALF_SPACE = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
# Of the largest area that so many corners span, by leaving out one after the other.
LEAST_SHARE = {3: 0.5, 4: 0.75}
FACES = {"box": 0.03, "cylinder": 0.04, "cone": 0.04}  # height of the origin on the lower face


def placed_at(gap: float, name: str, shape: str, thing: CollisionBody, rng) -> CollisionBody:
    """A body in a random orientation, moved along a random direction until the gap is right."""
    turn = Rotation.random(rng=rng).as_matrix()
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    near, far = 0.0, 0.5
    while far - near > 1e-10:
        middle = 0.5 * (near + far)
        pose = pose_matrix(thing.T_world_geometry[:3, 3] + middle * way, turn)
        distance = separation(CollisionBody(name, SHAPES[shape], pose), thing).distance
        near, far = (near, middle) if distance > gap else (middle, far)
    return CollisionBody(
        name, SHAPES[shape], pose_matrix(thing.T_world_geometry[:3, 3] + far * way, turn)
    )


def crowd(seed: int) -> tuple[CollisionBody, list[CollisionBody], list[CollisionBody]]:
    """A thing that stands on a floor among two links and two supports, all at random."""
    rng = np.random.default_rng(seed)
    kind = rng.choice(sorted(FACES))
    stand = pose_matrix((0, 0, FACES[kind] + rng.uniform(-5e-4, 5e-4)), (0, 0, rng.uniform(-3, 3)))
    thing = CollisionBody("thing", SHAPES[kind], stand)
    names = rng.choice(sorted(SHAPES), 4)
    others = [
        placed_at(rng.choice([5e-4, 1e-4, -1e-4, -5e-4]), f"body {k}", shape, thing, rng)
        for k, shape in enumerate(names)
    ]
    return thing, others[:2], [*others[2:], CollisionBody("floor", HALF_SPACE, np.eye(4))]


def changed(body: CollisionBody, name: str, world: np.ndarray) -> CollisionBody:
    return CollisionBody(name, body.geometry, world @ body.T_world_geometry)


def by_body(contacts: tuple[ContactPoint, ...]) -> dict[str, list[ContactPoint]]:
    found: dict[str, list[ContactPoint]] = {}
    for contact in contacts:
        found.setdefault(contact.body, []).append(contact)
    return found


@settings(max_examples=12)
@example(seed=1504, places=[0, 1, 2, 3, 4], labels=["a", "b", "c", "e", "thing", "d"])
@given(
    seed=st.integers(0, 10**6),
    places=st.permutations(range(5)),
    labels=st.permutations(["a", "b", "c", "d", "e", "thing"]),
)
def test_relabelled_reordered_and_moved_together_the_contacts_are_the_same(seed, places, labels):
    thing, links, supports = crowd(seed)
    still = by_body(find_contacts(thing, links, supports))
    world = random_pose(np.random.default_rng(seed + 1))
    old: list[str] = ["body 0", "body 1", "body 2", "body 3", "floor", "thing"]
    new: dict[str, str] = dict(zip(old, labels, strict=True))
    bodies = [changed(body, new[body.name], world) for body in (*links, *supports)]
    moved = by_body(
        find_contacts(
            changed(thing, new["thing"], world),
            [bodies[k] for k in places if k < 2],
            [bodies[k] for k in places if k >= 2],
        )
    )
    assert set(moved) == {new[name] for name in still}
    assert set(still) == set(new) - {"thing"}
    for name, before in still.items():
        after = moved[new[name]]
        assert len(after) == len(before), name
        for one, other in zip(before, after, strict=True):
            position = world[:3, :3] @ one.position + world[:3, 3]
            # Where a rim meets an edge, rounding moves the nearest points by tens of micrometres.
            np.testing.assert_allclose(other.position, position, rtol=0, atol=2e-4)
            np.testing.assert_allclose(other.normal, world[:3, :3] @ one.normal, atol=3e-3)
            assert other.distance == pytest.approx(one.distance, abs=1e-7)
            assert other.kind is one.kind
        for one, other in itertools.combinations(before, 2):
            assert np.linalg.norm(one.position - other.position) > 9e-4, name


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_pieces_in_any_order_and_under_any_name_touch_alike(seed):
    # A bar in four blocks of different lengths, on a floor and against a plate.
    rng = np.random.default_rng(seed)
    cuts = np.cumsum([0.0, *rng.uniform(0.02, 0.06, 4)])
    gap, world = rng.uniform(-5e-4, 5e-4), random_pose(rng)
    blocks = [
        CollisionBody(
            "bar",
            coal.Box(stop - start, 0.04, 0.05),
            world @ pose_matrix((0.5 * (start + stop), 0.0, 0.025 + gap)),
        )
        for start, stop in itertools.pairwise(cuts)
    ]
    floor = CollisionBody("floor", HALF_SPACE, world)
    plate = CollisionBody(
        "plate", coal.Box(0.05, 0.02, 0.05), world @ pose_matrix((cuts[2], 0.03, 0.06))
    )
    shuffled = [changed(blocks[k], "rod", np.eye(4)) for k in rng.permutation(4)]
    on_floor = [(x, y, 0.5 * gap) for x in (0.0, cuts[-1]) for y in (-0.02, 0.02)]
    on_plate = [
        (cuts[2] + x, 0.02, z) for x in (-0.025, 0.025) for z in (max(gap, 0.035), 0.05 + gap)
    ]
    for pieces in (blocks, shuffled):
        found = by_body(find_contacts(pieces, [], [floor, plate]))
        for name, expected in (("floor", on_floor), ("plate", on_plate)):
            points = np.array([contact.position for contact in found[name]])
            local = (points - world[:3, 3]) @ world[:3, :3]
            distances = np.linalg.norm(local[:, None] - np.array(expected)[None], axis=2)
            assert distances.shape == (4, 4), name
            assert max(distances.min(axis=0).max(), distances.min(axis=1).max()) < 1e-8, name


def area(polygon: Polygon) -> float:
    following = [*polygon[1:], polygon[0]]
    return 0.5 * math.fsum(
        a[0] * b[1] - b[0] * a[1] for a, b in zip(polygon, following, strict=True)
    )


@settings(max_examples=25)
@given(
    millimetres=st.lists(
        st.tuples(st.integers(-100, 100), st.integers(-100, 100)),
        min_size=5,
        max_size=9,
        unique=True,
    ),
    count=st.integers(3, 8),
)
def test_a_bounded_count_keeps_corners_and_nearly_the_largest_area(millimetres, count):
    polygon = planar_hull([(1e-3 * u, 1e-3 * v) for u, v in millimetres])
    groups = reduce_polygon(polygon, 1e-6, count)
    assert [len(group) for group in groups] == [1] * min(count, len(polygon))
    kept = [polygon[group[0]] for group in groups]
    best = max(area(list(chosen)) for chosen in itertools.combinations(polygon, len(kept)))
    assert area(kept) >= LEAST_SHARE.get(count, 0.9) * best
