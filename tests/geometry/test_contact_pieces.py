"""Bodies of several convex pieces: seams leave no trace, steps and corners lose no contact."""

import itertools
import math

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from tests.geometry.contact_tools import find_contacts

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.contact.contact_points import ContactPoint
from graspless_pin.geometry.contact.merging import _rules_out_contact
from graspless_pin.geometry.poses import pose_matrix

FLOOR = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)


def place(position: ArrayLike, rotation: Rotation | None = None) -> np.ndarray:
    return pose_matrix(position, None if rotation is None else rotation.as_matrix())


Span = tuple[float, float]


def slab(name: str, x: Span, y: Span, z: Span, world: np.ndarray | None = None) -> CollisionBody:
    """An upright box between bounds."""
    low, high = np.array([x, y, z]).T
    T = place(0.5 * (low + high))
    return CollisionBody(name, coal.Box(*(high - low)), T if world is None else world @ T)


def moved(body: CollisionBody, world: np.ndarray) -> CollisionBody:
    return CollisionBody(body.name, body.geometry, world @ body.T_world_geometry)


def rows(contacts: tuple[ContactPoint, ...]) -> np.ndarray:
    """Position and normal, sorted."""
    table = np.array([[*c.position, *c.normal] for c in contacts]).reshape(-1, 6)
    table = np.round(table, 7) + 0.0
    return table[np.lexsort(table.T[::-1])]


def bricks(name: str, cuts: tuple[list[float], ...], world: np.ndarray) -> list[CollisionBody]:
    """A box cut along planes, of pieces that all have its name."""
    spans = [list(itertools.pairwise(cut)) for cut in cuts]
    return [slab(name, x, y, z, world) for x, y, z in itertools.product(*spans)]


cuts_of_a_box = st.tuples(
    *[
        st.lists(st.floats(-0.8 * half, 0.8 * half), max_size=2).map(
            lambda inner, h=half: sorted({-h, h, *(round(c, 3) for c in inner)})
        )
        for half in (0.04, 0.05, 0.03)
    ]
)
poses = st.builds(
    lambda rpy, shift: place(shift, Rotation.from_euler("xyz", rpy)),
    st.tuples(*[st.floats(-math.pi, math.pi)] * 3),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3),
)
gaps = st.floats(-5e-4, 5e-4)


@settings(max_examples=20)
@given(cuts_of_a_box, poses, gaps, st.floats(-3.0, 3.0), st.booleans())
def test_a_box_cut_in_pieces_stands_like_the_whole_one(
    cuts: tuple[list[float], ...], world: np.ndarray, gap: float, yaw: float, on_box: bool
) -> None:
    standing = world @ place((0.02, -0.01, 0.03 + gap), Rotation.from_euler("z", yaw))
    ground = CollisionBody("ground", FLOOR, world)
    if on_box:
        ground = CollisionBody("ground", coal.Box(0.6, 0.6, 0.1), world @ place((0, 0, -0.05)))
    whole = CollisionBody("box", coal.Box(0.08, 0.1, 0.06), standing)
    pieces = bricks("box", cuts, standing)
    expected = find_contacts(whole, [], [ground])
    assert len(expected) == 4
    found = find_contacts(pieces, [], [ground])
    assert np.allclose(rows(found), rows(expected), atol=2e-7)
    if on_box:
        assert np.allclose(
            rows(find_contacts(ground, [], pieces)), rows(find_contacts(ground, [], [whole]))
        )


@settings(max_examples=20)
@given(
    cuts_of_a_box,
    poses,
    gaps,
    st.tuples(st.floats(-0.039, 0.039), st.floats(-0.049, 0.049)),
    st.sampled_from([0.004, 0.01, 0.05]),
)
def test_a_sphere_on_a_face_touches_a_cut_box_in_one_point(
    cuts: tuple[list[float], ...],
    world: np.ndarray,
    gap: float,
    foot: tuple[float, float],
    radius: float,
) -> None:
    tip = CollisionBody("tip", coal.Sphere(radius), world @ place((*foot, 0.03 + radius + gap)))
    (point,) = find_contacts(bricks("box", cuts, world), [tip], [])
    expected = world[:3, :3] @ [*foot, 0.03 + 0.5 * gap] + world[:3, 3]
    assert np.allclose(point.position, expected, atol=1e-6)
    assert np.allclose(point.normal, -world[:3, 2], atol=1e-6)
    assert point.distance == pytest.approx(gap, abs=1e-6)


# An angle of two plates: a floor z <= 0 and a wall x <= 0, which meet in the edge along y.
ANGLE = (
    slab("angle", (0.0, 0.3), (-0.2, 0.2), (-0.02, 0.0)),
    slab("angle", (-0.02, 0.0), (-0.2, 0.2), (-0.02, 0.3)),
)


@settings(max_examples=15)
@given(poses, gaps, gaps, st.permutations([0, 1]))
def test_a_box_in_a_corner_touches_floor_and_wall_with_all_corners(
    world: np.ndarray, below: float, behind: float, order: list[int]
) -> None:
    box = moved(slab("box", (behind, 0.1 + behind), (-0.05, 0.05), (below, 0.1 + below)), world)
    corner = [moved(ANGLE[k], world) for k in order]
    contacts = find_contacts(box, [], corner)
    found = np.array([[*(c.normal @ world[:3, :3]), c.distance] for c in contacts])
    up, out = found[found[:, 2] > 0.99], found[found[:, 0] > 0.99]
    assert len(contacts) == 8
    assert len(up) == len(out) == 4
    assert np.allclose(up[:, 3], below, atol=1e-9)
    assert np.allclose(out[:, 3], behind, atol=1e-9)


@pytest.mark.parametrize("tilt", [5.0, 30.0, 45.0, 85.0])
def test_a_box_that_pivots_in_a_corner_leans_on_both_with_its_edge(tilt: float) -> None:
    side = slab("angle", (0.0, 0.3), (0.05, 0.07), (0.0, 0.3))  # a third wall, along which it turns
    turn = Rotation.from_euler("y", -tilt, degrees=True)
    box = CollisionBody("box", coal.Box(0.1, 0.1, 0.1), place(turn.apply([0.05, 0.0, 0.05]), turn))
    # Turned so, the lower left corner goes down along the wall: put it where both are touched.
    corners = [turn.apply([x, 0.0, z]) for x in (0.0, 0.1) for z in (0.0, 0.1)]
    low, left = min(c[2] for c in corners), min(c[0] for c in corners)
    box = moved(box, place((-left, 0.0, -low)))
    contacts = find_contacts(box, [], [*ANGLE, side])
    normals = np.array([c.normal for c in contacts])
    assert np.count_nonzero(normals @ [0, 0, 1] > 0.99) == 2
    assert np.count_nonzero(normals @ [1, 0, 0] > 0.99) == 2
    assert np.count_nonzero(normals @ [0, -1, 0] > 0.99) == 4
    assert len(contacts) == 8


def wedge() -> coal.CollisionGeometry:
    """A prism along y whose edge at the origin has an angle of 40 degrees, from -5 to 35."""
    angles = np.radians([-5, 35])
    outline = [(0.0, 0.0), *zip(0.1 * np.cos(angles), 0.1 * np.sin(angles), strict=True)]
    return convex_geometry(np.array([(x, y, z) for x, z in outline for y in (-0.05, 0.05)]))


def in_corner(*pieces: CollisionBody) -> tuple[ContactPoint, ...]:
    """Contacts of a wedge whose edge lies where a floor and a wall meet."""
    turn = Rotation.from_euler("y", -30, degrees=True)
    return find_contacts(CollisionBody("prism", wedge(), place((0, 0, 0), turn)), [], pieces)


def test_an_edge_in_the_very_corner_is_held_by_both_plates_and_a_side() -> None:
    contacts = in_corner(*ANGLE, slab("angle", (0.0, 0.3), (0.05, 0.07), (0.0, 0.3)))
    normals = np.array([c.normal for c in contacts])
    for way in ([0, 0, 1], [1, 0, 0]):
        held = [c for c, n in zip(contacts, normals, strict=True) if n @ way > 0.99]
        assert len(held) == 2
        assert np.allclose([c.position[[0, 2]] for c in held], 0.0, atol=1e-6)
    assert np.count_nonzero(normals @ [0, -1, 0] > 0.99) == 3


@pytest.mark.parametrize(("width", "held"), [(0.01, 2), (0.0115, 4), (0.03, 4)])
def test_a_ledge_in_a_corner_holds_an_edge_if_it_is_no_mere_lip(width: float, held: int) -> None:
    """A floor that goes on in front of the wall by a tenth of its size is one; less is a seam."""
    floor = slab("angle", (-0.1, width), (-0.1, 0.1), (-0.02, 0.0))
    wall = slab("angle", (-0.02, 0.0), (-0.1, 0.1), (-0.02, 0.3))
    assert len(in_corner(floor, wall)) == held


@pytest.mark.parametrize("lean", [-10.0, 0.0, 1.0, 3.0, 5.0])
def test_a_wall_that_leans_over_a_little_still_makes_a_corner(lean: float) -> None:
    floor = slab("angle", (-0.1, 0.1), (-0.1, 0.1), (-0.02, 0.0))
    side = slab("angle", (-0.2, 0.3), (0.05, 0.07), (0.0, 0.3))
    leaning = place((0, 0, 0), Rotation.from_euler("y", lean, degrees=True))
    wall = moved(slab("angle", (-0.05, 0.0), (-0.1, 0.1), (0.0, 0.3)), leaning)
    contacts = in_corner(floor, wall, side)
    assert len(contacts) == 7
    assert sum(contact.normal[2] > 0.99 for contact in contacts) == 2


@pytest.mark.parametrize("lean", [10.0, 20.0, 45.0, 90.0])
def test_below_a_piece_that_leans_over_it_a_floor_is_covered(lean: float) -> None:
    floor = slab("thing", (-0.1, 0.1), (-0.1, 0.1), (-0.02, 0.0))
    leaning = place((0, 0, 0), Rotation.from_euler("y", lean, degrees=True))
    over = moved(slab("thing", (-0.1, 0.0), (-0.1, 0.1), (-0.1, 0.1)), leaning)
    assert _rules_out_contact(over, floor, np.zeros(3), np.array([0.0, 0.0, 1.0]))


def test_a_table_stands_on_the_outermost_corners_of_its_legs() -> None:
    top = slab("table", (-0.2, 0.2), (-0.1, 0.1), (0.1, 0.12))
    legs = [
        slab("table", (x, x + 0.02), (y, y + 0.02), (0.0, 0.1))
        for x in (-0.2, 0.18)
        for y in (-0.1, 0.08)
    ]
    contacts = find_contacts([top, *legs], [], [CollisionBody("floor", FLOOR, np.eye(4))])
    corners = [(x, y, 0.0) for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    assert np.allclose(rows(contacts)[:, :3], corners)


def test_an_object_on_a_step_keeps_the_contacts_of_both_levels() -> None:
    stairs = [
        slab("stairs", (-0.5, 0.0), (-0.5, 0.5), (-0.2, 0.1)),
        slab("stairs", (0.0, 0.5), (-0.5, 0.5), (-0.2, 0.0)),
    ]
    bench = [
        slab("bench", (-0.1, 0.1), (-0.05, 0.05), (0.15, 0.17)),
        slab("bench", (-0.1, -0.08), (-0.05, 0.05), (0.1, 0.15)),
        slab("bench", (0.08, 0.1), (-0.05, 0.05), (0.0, 0.15)),
    ]
    contacts = find_contacts(bench, [], stairs)
    heights = sorted(round(float(c.position[2]), 9) for c in contacts)
    assert heights == [0.0] * 4 + [0.1] * 4
    assert np.allclose([c.normal for c in contacts], [0, 0, 1])


def test_a_finger_between_two_walls_of_one_object_touches_both() -> None:
    groove = [
        slab("groove", (-0.03, -0.01), (-0.05, 0.05), (0.0, 0.05)),
        slab("groove", (0.01, 0.03), (-0.05, 0.05), (0.0, 0.05)),
        slab("groove", (-0.03, 0.03), (-0.05, 0.05), (-0.02, 0.0)),
    ]
    tip = CollisionBody("tip", coal.Sphere(0.01), place((0, 0, 0.01)))
    contacts = find_contacts(groove, [tip], [])
    expected = [(-0.01, 0, 0.01, -1, 0, 0), (0, 0, 0, 0, 0, -1), (0.01, 0, 0.01, 1, 0, 0)]
    assert np.allclose(rows(contacts), expected, atol=1e-6)


def test_a_link_of_several_primitives_counts_as_one() -> None:
    # A rounded bar lies on a face: a cylinder with a sphere at either end.
    turn = Rotation.from_euler("y", 90, degrees=True)
    bar = [
        CollisionBody("bar", coal.Cylinder(0.01, 0.1), place((0, 0, 0.01), turn)),
        CollisionBody("bar", coal.Sphere(0.01), place((0.05, 0, 0.01))),
        CollisionBody("bar", coal.Sphere(0.01), place((-0.05, 0, 0.01))),
    ]
    block = slab("block", (-0.2, 0.2), (-0.1, 0.1), (-0.1, 0.0))
    contacts = find_contacts(block, bar, [])
    assert np.allclose(rows(contacts)[:, :3], [(-0.05, 0, 0), (0.05, 0, 0)], atol=1e-6)
    assert np.allclose([c.normal for c in contacts], [0, 0, -1], atol=1e-6)


def test_too_deep_an_overlap_with_pieces_is_found_too() -> None:
    ball = CollisionBody("ball", coal.Sphere(0.05), place((0, 0, 0.04)))
    pieces = bricks("block", ([-0.1, 0.0, 0.1], [-0.1, 0.0, 0.1], [-0.1, 0.0]), np.eye(4))
    with pytest.raises(SceneError, match=r"object 'block' overlap by 10\.00 mm"):
        find_contacts(pieces, [ball], [])


def test_an_object_needs_a_piece_and_no_piece_may_be_a_half_space() -> None:
    with pytest.raises(ArgumentError, match="object_bodies: needs at least one piece"):
        find_contacts([], [], [])
    floor = CollisionBody("thing", FLOOR, np.eye(4))
    with pytest.raises(SceneError, match="object 'thing' is a half-space"):
        find_contacts([slab("thing", (0.0, 1.0), (0.0, 1.0), (0.0, 1.0)), floor], [], [])
