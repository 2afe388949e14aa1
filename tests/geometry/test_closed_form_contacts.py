"""Faces on half-spaces touch as the general search finds; spheres on faces, as coal measures."""

from __future__ import annotations

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from hand_tools import random_pose
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.bodies.collision import BodyShapes, CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.polytopes import Polytope
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.contact import finding
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactArrays
from graspless_pin.geometry.contact.distances import near_pairs, separation
from graspless_pin.geometry.contact.finding import (
    ContactLimits,
    contact_arrays,
    near_and_closed_form,
)
from graspless_pin.geometry.contact.patches import convex_set
from graspless_pin.geometry.poses import pose_matrix

LIMITS = ContactLimits()
FLOOR = CollisionBody("floor", coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), np.eye(4))


def prism(corners: int, radius: float = 0.05) -> object:
    angles = 2.0 * np.pi * np.arange(corners) / corners + 0.1
    ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return convex_geometry(
        np.vstack([np.column_stack([ring, np.full(corners, z)]) for z in (-0.03, 0.03)])
    )


SHAPES = {
    "box": coal.Box(0.1, 0.14, 0.06),
    "hull": convex_geometry(np.random.default_rng(7).normal(size=(12, 3)) * 0.04),
    "five-sided": prism(5),
    "forty-sided": prism(40),
    "needle": convex_geometry(
        0.01 * np.array([[0, 0, -3], [5, 0, -3], [5, 0.06, -3], [0, 0.06, -3], [2, 0.03, 3]])
    ),
}


def set_of(shape: str) -> Polytope:
    solid = convex_set(shape, SHAPES[shape])
    assert isinstance(solid, Polytope)
    return solid


def found_in_general(*args, **kwargs) -> ContactArrays:
    """The same contacts with none in closed form."""

    def none_closed_form(pieces, bodies, limits):
        pairs = near_pairs(pieces, bodies, limits.tolerance)
        return pairs, [], list(range(len(pairs)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(finding, "near_and_closed_form", none_closed_form)
        return contact_arrays(*args, **kwargs)


def assert_same(ours: ContactArrays, theirs: ContactArrays) -> None:
    assert ours.bodies == theirs.bodies
    assert ours.kinds == theirs.kinds
    np.testing.assert_allclose(ours.positions, theirs.positions, rtol=0, atol=1e-13)
    np.testing.assert_allclose(ours.normals, theirs.normals, rtol=0, atol=1e-13)
    np.testing.assert_allclose(ours.distances, theirs.distances, rtol=0, atol=1e-13)
    assert not ours.positions.flags.writeable
    assert not ours.normals.flags.writeable


def balls_around(rng: np.random.Generator, T: np.ndarray, solid: Polytope) -> PlacedBodies:
    """Twenty spheres over faces of a body at T, and twenty beside its corners."""
    names, balls, poses = [], [], []
    for k in range(40):
        face = int(rng.integers(len(solid.faces)))
        normal, corners = solid.face_normals[face], solid.vertices[solid.faces[face]]
        radius = rng.uniform(0.004, 0.01)
        if k < 20:
            point = rng.dirichlet(np.ones(len(corners))) @ corners
            point = point + (radius + rng.uniform(-4e-3, 3e-3)) * normal
        else:
            aside = rng.normal(size=3)
            outward = normal + 0.7 * aside / np.linalg.norm(aside)
            outward /= np.linalg.norm(outward)
            point = corners[0] + (radius + rng.uniform(0.0, 3e-3)) * outward
        poses.append(random_pose(rng).copy())
        poses[-1][:3, 3] = T[:3, :3] @ point + T[:3, 3]
        names.append(f"tip {k}")
        balls.append(coal.Sphere(radius))
    return PlacedBodies(BodyShapes(tuple(names), tuple(balls)), np.array(poses))


@pytest.mark.sampled(10)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(3))
def test_spheres_touch_where_coal_measures_them(shape: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = random_pose(rng)
    body = CollisionBody("thing", SHAPES[shape], T)
    balls = balls_around(rng, T, set_of(shape))
    ours = contact_arrays([body], balls, BodyKind.HAND)
    gaps = {ball.name: separation(body, ball).distance for ball in balls}
    touching = [ball for ball in balls if gaps[ball.name] <= LIMITS.tolerance]
    assert ours.bodies == tuple(ball.name for ball in touching)
    assert 10 < len(ours) < 40
    distances = np.array(ours.distances)
    np.testing.assert_allclose(distances, [gaps[one] for one in ours.bodies], rtol=0, atol=1e-6)
    centers = np.array([ball.T_world_geometry[:3, 3] for ball in touching])
    reach = np.array([ball.geometry.radius for ball in touching]) + 0.5 * distances
    expected = centers + reach[:, None] * ours.normals
    np.testing.assert_allclose(ours.positions, expected, rtol=0, atol=1e-12)


@settings(max_examples=50)
@given(
    shape=st.sampled_from(["box", "five-sided", "hull"]),
    face=st.integers(0, 100),
    turn=st.floats(-3.1, 3.1),
    tilt=st.tuples(st.floats(-6e-3, 6e-3), st.floats(-6e-3, 6e-3)),
    gap=st.floats(-6e-4, 1.2e-3),
    seed=st.integers(0, 1000),
)
# Its corner in the middle of three others stands 0.35 mm proud of them.
@example(shape="hull", face=65, turn=-1.0, tilt=(0.0, -0.00390625), gap=0.0, seed=0)
def test_a_face_on_a_plane_is_what_the_general_search_finds(
    shape: str, face: int, turn: float, tilt: tuple[float, float], gap: float, seed: int
) -> None:
    body, floor = on_floor(shape, face, turn, tilt, gap, seed)
    ours = contact_arrays([body], [floor], BodyKind.SUPPORT)
    theirs = found_in_general([body], [floor], BodyKind.SUPPORT)
    if len(ours) > 1:
        # Where the face is tilted, the search's first point changes with the gaps.
        start = np.linalg.norm(theirs.positions - ours.positions[0], axis=1).argmin()
        theirs = theirs.at_indices([*range(start, len(theirs)), *range(start)])
    assert_same(ours, theirs)


def on_floor(shape, face, turn, tilt, gap, seed=None) -> tuple[CollisionBody, CollisionBody]:
    """A body whose face is a gap over a floor, tilted, both moved and turned together."""
    solid = set_of(shape)
    normal = solid.face_normals[face % len(solid.face_normals)]
    down = Rotation.align_vectors([[0.0, 0.0, -1.0]], [normal])[0]
    turned = Rotation.from_euler("zxy", [turn, *tilt]) * down
    T = pose_matrix((0.1, -0.2, gap - turned.apply(solid.vertices)[:, 2].min()), turned.as_matrix())
    world = np.eye(4) if seed is None else random_pose(np.random.default_rng(seed))
    return (
        CollisionBody("thing", SHAPES[shape], world @ T),
        CollisionBody("floor", FLOOR.geometry, world),
    )


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("count", [3, 8])
def test_the_points_of_a_face_do_not_change_as_it_moves(shape: str, count: int) -> None:
    solid = set_of(shape)
    lowest = int(solid.face_normals[:, 2].argmin())
    rng = np.random.default_rng(3)
    places = []
    for _ in range(6):
        turn, tilt, gap = rng.uniform(-3, 3), rng.uniform(-2e-3, 2e-3, 2), rng.uniform(0, 3e-4)
        body, floor = on_floor(shape, lowest, turn, tuple(tilt), gap, int(rng.integers(1000)))
        found = contact_arrays([body], [floor], BodyKind.SUPPORT, ContactLimits(max_points=count))
        R, t = body.T_world_geometry[:3, :3], body.T_world_geometry[:3, 3]
        corners = found.positions + 0.5 * np.array(found.distances)[:, None] * found.normals
        places.append((corners - t) @ R)
    assert 2 <= len(places[0]) <= count
    for place in places[1:]:
        np.testing.assert_allclose(place, places[0], rtol=0, atol=1e-12)
    if shape != "forty-sided":
        level, floor = on_floor(shape, lowest, 0.3, (0.0, 0.0), 1e-5)
        assert_same(
            contact_arrays([level], [floor], BodyKind.SUPPORT, ContactLimits(max_points=count)),
            found_in_general([level], [floor], BodyKind.SUPPORT, ContactLimits(max_points=count)),
        )


@pytest.mark.parametrize(
    ("tilt", "gap", "points"),
    [
        ((0.0, 0.0), 5e-4, 4),  # all of the face
        ((0.0, 4e-3), 8e-4, 2),  # one edge is near: 0.1 m at this angle rises by 0.4 mm
        ((4e-3, 4e-3), 8e-4, 1),  # one corner
        ((0.0, 8e-3), 0.0, 2),  # tilted by more than passes for parallel
        ((0.0, 0.0), 2e-3, 0),  # out of reach
        ((4e-3, 4e-3), -4.9e-3, 4),  # as deep as passes
    ],
)
def test_a_face_that_is_near_in_part_is_left_to_the_general_search(tilt, gap, points) -> None:
    body, floor = on_floor("box", 5, 0.0, tilt, gap)
    ours = contact_arrays([body], [floor], BodyKind.SUPPORT)
    assert len(ours) == points
    assert_same(ours, found_in_general([body], [floor], BodyKind.SUPPORT))
    pieces, bodies = PlacedBodies.of([body]), PlacedBodies.of([floor])
    _, found, left = near_and_closed_form(pieces, bodies, LIMITS)
    assert sum(len(rows.gaps) for rows in found) == (4 if points == 4 else 0)
    assert left == ([] if points == 4 else [0])


def test_plain_and_other_contacts_keep_their_order() -> None:
    T = pose_matrix((0.0, 0.0, 0.03))
    box = CollisionBody("box", SHAPES["box"], T)

    def at(name: str, geometry: object, *place: float) -> CollisionBody:
        return CollisionBody(name, geometry, pose_matrix(place))

    ball, cube = coal.Sphere(0.01), coal.Box(0.02, 0.02, 0.02)
    others = [
        at("block", cube, 0.06, 0.0, 0.03),
        at("tip", ball, -0.06, 0.02, 0.03),
        FLOOR,
        at("twins", ball, 0.0, 0.0801, 0.03),  # two pieces of one name
        at("far", ball, 0.0, 1.0, 0.0),
        at("other tip", ball, 0.0, -0.08, 0.03),
        at("twins", ball, 0.03, 0.08, 0.03),
        at("on the edge", ball, 0.0571, 0.02, 0.0671),
    ]
    ours = contact_arrays([box], others, BodyKind.HAND)
    assert list(dict.fromkeys(ours.bodies)) == [
        "block", "tip", "floor", "twins", "other tip", "on the edge",
    ]  # fmt: skip
    assert ours.bodies.count("twins") == 2
    assert_same(ours, found_in_general([box], others, BodyKind.HAND))
