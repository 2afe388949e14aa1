"""Contacts of single scenes, worked out by hand: the paper's, and one for each rule."""

import math
from dataclasses import replace
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from tests.geometry.contact_tools import find_contacts

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.shapes import (
    Box,
    Cylinder,
    HalfSpace,
    Shape,
    Sphere,
)
from graspless_pin.geometry.poses import pose_matrix

Q = math.sqrt(0.5)


def body(name: str, shape: Shape, T: np.ndarray) -> CollisionBody:
    return CollisionBody(name, shape.pieces()[0], T)


def at(x: float, y: float, z: float, rpy: tuple[float, float, float] | None = None) -> np.ndarray:
    return pose_matrix((x, y, z), rpy)


def sorted_rows(points: object) -> np.ndarray:
    rows = np.round(np.array(points, dtype=float), 9) + 0.0
    return rows[np.lexsort(rows.T[::-1])]


def test_the_common_part_of_two_faces_is_what_counts() -> None:
    plate, table = Box((0.4, 0.4, 0.1)), body("table", Box((1, 1, 1)), at(0, 0, -0.5))
    contacts = find_contacts(body("plate", plate, at(0.4, 0.4, 0.05)), [], [table])
    corners = [(0.2, 0.2, 0), (0.2, 0.5, 0), (0.5, 0.2, 0), (0.5, 0.5, 0)]
    assert np.allclose(sorted_rows([c.position for c in contacts]), corners)


def test_crossed_bars_touch_in_a_square_and_crossed_cylinders_in_a_point() -> None:
    bar = body("bar", Box((0.4, 0.02, 0.02)), at(0, 0, 0.01))
    cross = body("cross", Box((0.02, 0.4, 0.02)), at(0.05, 0, -0.01))
    points = sorted_rows([c.position for c in find_contacts(bar, [], [cross])])
    assert np.allclose(points, [(x, y, 0) for x in (0.04, 0.06) for y in (-0.01, 0.01)])
    one = body("one", Cylinder(0.02, 0.3), at(0, 0, 0.02, (math.pi / 2, 0, 0)))
    two = body("two", Cylinder(0.03, 0.3), at(0.01, 0, -0.03, (0, math.pi / 2, 0)))
    (point,) = find_contacts(one, [], [two])
    assert np.allclose(point.position, [0, 0, 0], atol=1e-6)
    assert np.allclose(point.normal, [0, 0, 1], atol=1e-4)


def test_parallel_cylinders_touch_along_the_common_part_of_their_lines() -> None:
    one = body("one", Cylinder(0.02, 0.2), at(0.05, 0, 0.02, (0, math.pi / 2, 0)))
    two = body("two", Cylinder(0.03, 0.2), at(0, 0, -0.03, (0, math.pi / 2, 0)))
    points = sorted_rows([c.position for c in find_contacts(one, [], [two])])
    assert np.allclose(points, [(-0.05, 0, 0), (0.1, 0, 0)], atol=3e-5)


def test_crossing_edges_touch_in_a_point_with_their_common_normal() -> None:
    # Two cubes standing on edge: the lower one's top edge runs along y, the upper one's along x.
    half = 0.1 * Q
    lower = body("lower", Box((0.1, 0.1, 0.1)), at(0, 0, -half, (0, math.pi / 4, 0)))
    upper = body("upper", Box((0.1, 0.1, 0.1)), at(0.01, 0.02, half, (math.pi / 4, 0, 0)))
    (point,) = find_contacts(upper, [], [lower])
    assert np.allclose(point.position, [0, 0.02, 0], atol=1e-12)
    assert np.allclose(point.normal, [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("tilt", [1e-4, 4e-3])
def test_a_slightly_tilted_wide_box_keeps_its_corners_as_far_as_they_are_near(tilt: float) -> None:
    box = body("box", Box((0.6, 0.2, 0.1)), at(0, 0, 0.05 + 0.3 * tilt, (0, tilt, 0)))
    contacts = find_contacts(box, [], [body("ground", HalfSpace(), at(0, 0, 0))])
    near = [c for c in contacts if c.position[0] > 0]
    assert len(near) == 2
    assert len(contacts) == (4 if 0.6 * tilt < 1e-3 else 2)


def test_a_box_tilted_by_a_degree_stands_on_its_edge_and_then_on_its_corner() -> None:
    ground = body("ground", HalfSpace(), at(0, 0, 0))
    degree = math.radians(1)
    edge = body("box", Box((0.1, 0.1, 0.1)), at(0, 0, 0.0508, (0, degree, 0)))
    assert len(find_contacts(edge, [], [ground])) == 2
    corner = body("box", Box((0.1, 0.1, 0.1)), at(0, 0, 0.0516, (degree, degree, 0)))
    assert len(find_contacts(corner, [], [ground])) == 1


@pytest.mark.parametrize("size", [1e-4, 9e-4, 0.1])
def test_a_cube_of_any_size_stands_on_its_corners_within_a_tolerance_of_its_size(
    size: float,
) -> None:
    cube = body("cube", Box((size, size, size)), at(0, 0, 0.5 * size))
    for other in (HalfSpace(), Box((1, 1, 1))):
        ground = body("ground", other, at(0, 0, -0.5 if isinstance(other, Box) else 0))
        contacts = find_contacts(cube, [], [ground], tolerance=0.01 * size)
        corners = [(x, y, 0) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
        assert np.allclose(sorted_rows([c.position / size for c in contacts]), corners)


def test_far_bodies_do_not_touch() -> None:
    ball = body("ball", Sphere(0.05), at(0, 0, 0.0511))
    others = [
        body("ground", HalfSpace(), at(0, 0, 0)),
        body("table", Box((1, 1, 1)), at(0, 0, -0.5)),
        body("wall", Box((0.1, 0.1, 0.1)), at(3, 0, 0)),
    ]
    assert find_contacts(ball, [], others) == ()
    assert len(find_contacts(ball, [], others, tolerance=2e-3)) == 2
    assert find_contacts(ball, [], []) == ()


def test_too_deep_an_overlap_names_both_bodies_and_the_depth() -> None:
    ball = body("ball", Sphere(0.05), at(0, 0, 0.042))
    message = r"support 'ground' and object 'ball' overlap by 8\.00 mm, more than max_penetration"
    with pytest.raises(SceneError, match=message):
        find_contacts(ball, [], [body("ground", HalfSpace(), at(0, 0, 0))])
    with pytest.raises(SceneError, match=r"hand link 'palm' and object 'ball' overlap by 8\.00 mm"):
        find_contacts(ball, [body("palm", Box((0.1, 0.1, 0.1)), at(0, 0, -0.05))], [])
    assert (
        len(find_contacts(ball, [], [body("g", HalfSpace(), at(0, 0, 0))], max_penetration=0.01))
        == 1
    )


def test_a_half_space_need_not_go_through_its_origin() -> None:
    ground = CollisionBody("ground", coal.Halfspace(np.array([1.0, 0, 0]), 0.2), np.eye(4))
    (point,) = find_contacts(body("ball", Sphere(0.1), at(0.3, 0.7, 0.1)), [], [ground])
    assert np.allclose(point.position, [0.2, 0.7, 0.1])
    assert np.allclose(point.normal, [1, 0, 0])


def test_records_are_read_only() -> None:
    ball = body("ball", Sphere(0.1), at(0, 0, 0.1))
    (point,) = find_contacts(ball, [], [body("ground", HalfSpace(), at(0, 0, 0))])
    with pytest.raises(ValueError, match="read-only"):
        point.position[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        point.normal[0] = 1.0
    with pytest.raises(ArgumentError, match=r"T_world_geometry: needs shape \(4, 4\)"):
        replace(ball, T_world_geometry=np.eye(3))


def test_geometry_without_a_convex_inside_is_refused_by_name() -> None:
    soup = CollisionBody("soup", coal.BVHModelOBBRSS(), np.eye(4))
    ball = body("ball", Sphere(0.1), at(0, 0, 0))
    with pytest.raises(SceneError, match="body 'soup': contacts cannot be found for a BVH"):
        find_contacts(ball, [soup], [])


@pytest.mark.parametrize("name", ["tolerance", "max_penetration", "merge_distance"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_limits_are_checked(name: str, value: float) -> None:
    ball = body("ball", Sphere(0.1), at(0, 0, 0))
    limits: dict[str, Any] = {name: value}
    with pytest.raises(ArgumentError, match=f"{name}: needs a positive length"):
        find_contacts(ball, [], [], **limits)
    with pytest.raises(ArgumentError, match="max_points: needs at least 3"):
        find_contacts(ball, [], [], max_points=2)
