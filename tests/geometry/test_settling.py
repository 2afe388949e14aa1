"""Settling objects: poses worked out by hand, and tightness on random ones."""

from __future__ import annotations

import numpy as np
import pytest
from hand_tools import random_pose
from hypothesis import given, settings
from hypothesis import strategies as st
from planar_fingers import ball, body

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shape import Compound
from graspless_pin.geometry.bodies.shapes import Box, Cylinder, HalfSpace
from graspless_pin.geometry.contact.distances import nearest_separation
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.posing.settling import settle_object

FLOOR = Support("floor", HalfSpace(), np.eye(4))
WALL = Support("wall", HalfSpace(), pose_matrix((0.5, 0, 0), (0, -np.pi / 2, 0)))  # solid: x >= 0.5


def slope(angle: float) -> Support:
    return Support("slope", HalfSpace(), pose_matrix((0, 0, 0), (0, angle, 0)))


def distance(target, support) -> float:
    return nearest_separation(support.collision_bodies(), target.collision_bodies()).distance


CUBE = Box((0.1, 0.1, 0.1))
STEP = Support("step", Box((0.2, 0.2, 0.1)), pose_matrix((0, 0, 0.05)))
ALONG, UP = np.array([np.cos(0.5), 0, -np.sin(0.5)]), np.array([np.sin(0.5), 0, np.cos(0.5)])
STOP = Support("stop", Box((0.1, 1.0, 0.1)), pose_matrix(0.35 * ALONG + 0.05 * UP, (0, 0.5, 0)))
DOWN = (0, 0, -1)
RESTS = {
    # the object, the supports, the direction, where its middle comes to rest
    **{f"a ball from {z} m": (ball(0.05, (0.1, 0.2, z)), [FLOOR], DOWN, (0.1, 0.2, 0.05))
       for z in (0.3, 0.05, 0.02, -0.01)},
    "over a step": (body(CUBE, (0.12, 0, 1.0)), [FLOOR, STEP], DOWN, (0.12, 0, 0.15)),
    "beside a step": (body(CUBE, (0.16, 0, 1.0)), [FLOOR, STEP], DOWN, (0.16, 0, 0.05)),
    "into a corner": (body(CUBE, (0.1, 0.3, 0.05)), [FLOOR, WALL], (1, 0, 0), (0.45, 0.3, 0.05)),
    "down a slope to a stop": (body(CUBE, 0.05 * UP, (0, 0.5, 0)), [slope(0.5), STOP], ALONG,
                               0.25 * ALONG + 0.05 * UP),
    "a ball in a vee": (ball(0.05, (0, 0, 0.5)), [slope(np.pi / 4), slope(-np.pi / 4)], DOWN,
                        (0, 0, 0.05 * np.sqrt(2.0))),
}  # fmt: skip


@pytest.mark.parametrize(("target", "supports", "way", "place"), RESTS.values(), ids=RESTS)
def test_where_an_object_comes_to_rest(target, supports, way, place):
    settled = settle_object(target, supports, way)
    expected = pose_matrix(place, target.T_world_object[:3, :3])
    np.testing.assert_allclose(settled.T_world_object, expected, rtol=0, atol=1e-8)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), angle=st.floats(-1.0, 1.0))
def test_a_turned_box_touches_a_slope_with_its_lowest_corner(seed, angle):
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.02, 0.3, 3)
    T = random_pose(rng)
    target = body(Box(tuple(size)), T[:3, 3], T[:3, :3])
    settled = settle_object(target, [slope(angle)])
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8)
    corners = T[:3, :3] @ (0.5 * size[:, None] * signs) + T[:3, [3]]
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    drop = (normal @ corners).min() / np.cos(angle)
    np.testing.assert_allclose(
        settled.T_world_object, pose_matrix(T[:3, 3] - [0, 0, drop], T[:3, :3]), rtol=0, atol=1e-7
    )


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_a_settled_object_touches_and_a_little_further_overlaps(seed):
    rng = np.random.default_rng(seed)
    T = random_pose(rng)
    shape = [Box((0.1, 0.15, 0.2)), Cylinder(0.08, 0.2)][seed % 2]
    target = body(shape, (0.0, 0.0, 1.0), T[:3, :3])
    block = Support("block", Box((0.3, 0.3, 0.3)), pose_matrix((0, 0, 0), random_pose(rng)[:3, :3]))
    way = np.array([0.05, -0.03, -1.0])
    settled = settle_object(target, [block], way)
    shift = settled.T_world_object[:3, 3] - target.T_world_object[:3, 3]
    np.testing.assert_allclose(np.cross(shift, way), 0.0, atol=1e-12)
    assert abs(distance(settled, block)) < 1e-6
    further = body(shape, settled.T_world_object[:3, 3] + 1e-3 * way, T[:3, :3])
    assert distance(further, block) < 0.0
    again = settle_object(settled, [block], way)
    np.testing.assert_allclose(again.T_world_object, settled.T_world_object, rtol=0, atol=1e-5)


def test_nothing_else_of_the_object_changes():
    target = ball(0.05, (0, 0, 1.0))
    settled = settle_object(target, [FLOOR])
    assert (settled.name, settled.shape, settled.mass) == (target.name, target.shape, target.mass)
    assert target.T_world_object[2, 3] == 1.0


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_compound_settles_as_one_body_whatever_part_comes_first(order):
    parts, poses = (Box((0.08, 0.03, 0.03)), Cylinder(0.01, 0.2)), np.repeat(np.eye(4)[None], 2, 0)
    poses[0, 2, 3] = 0.115
    hammer = Compound(tuple(parts[k] for k in order), poses[list(order)])
    target = ManipulatedObject.from_shape("hammer", hammer, pose_matrix((0.1, 0, 1)), mass=1.0)
    settled = settle_object(target, [Support("floor", HalfSpace(), np.eye(4))])
    np.testing.assert_allclose(settled.T_world_object, pose_matrix((0.1, 0, 0.1)), atol=1e-6)


def test_no_support_in_the_way_is_an_error():
    with pytest.raises(SceneError, match=r"meets no support in the direction .*'floor'"):
        settle_object(ball(0.05, (0, 0, 1.0)), [FLOOR], (0, 0, 1))
    with pytest.raises(SceneError, match="there is none"):
        settle_object(ball(0.05, (0, 0, 1.0)), [])


def test_an_overlap_across_the_way_is_an_error():
    with pytest.raises(SceneError, match=r"overlaps support 'wall' by 10\.00 mm"):
        settle_object(ball(0.05, (0.46, 0, 1.0)), [FLOOR, WALL])


@pytest.mark.parametrize("direction", [(0, 0, 0), (0, 0, np.inf), (0, 1), "down"])
def test_a_bad_direction_is_named(direction):
    with pytest.raises(ArgumentError, match=r"direction: (needs|is|has)"):
        settle_object(ball(0.05, (0, 0, 1.0)), [FLOOR], direction)
