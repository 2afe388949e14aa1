"""A mug with a handle, cut into convex pieces: its contacts, and posing in and around it.

Its hollow and its handle's opening are free.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
import trimesh
from cutting_here import cut_here
from hand_tools import joint, link, random_pose, write_urdf
from planar_fingers import body
from scipy.spatial.transform import Rotation
from tests.geometry.contact_tools import find_contacts

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import Box, HalfSpace, MeshShape, Sphere
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.geometry.contact.distances import nearest_separation
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.posing.closing import close_hand
from graspless_pin.geometry.posing.fingertips import place_fingertips
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.geometry.posing.settling import settle_object
from graspless_pin.geometry.robots.description import FingerSpec

SIDES = 12
RADIUS = 0.04
WALL = 0.006
HEIGHT = 0.1
BOTTOM = 0.008
HANDLE = 0.076  # outermost x of the handle, whose opening is x = 0.042 to 0.064, z = +-0.024


def whole_mug() -> trimesh.Trimesh:
    """A mug of flat sides about the middle of its height, with corners at the angle zero."""
    outer = trimesh.creation.cylinder(RADIUS, HEIGHT, sections=SIDES)
    hollow = trimesh.creation.cylinder(RADIUS - WALL, HEIGHT, sections=SIDES)
    hollow.apply_translation([0.0, 0.0, BOTTOM])
    frame = trimesh.creation.box([0.046, 0.012, 0.072])
    opening = trimesh.creation.box([0.022, 0.02, 0.048])
    handle = trimesh.boolean.difference([frame, opening])
    handle.apply_translation([0.053, 0.0, 0.0])
    full = trimesh.boolean.union([outer, handle])
    return trimesh.boolean.difference([full, hollow])


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MeshShape]:
    """The mug in convex pieces, cut once for all workers of a test run."""
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    path = tmp_path_factory.mktemp("mug") / "mug.ply"
    whole_mug().export(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(shared))
        cut_here(patch)
        yield MeshShape(path, convex="decompose", concavity=0.05)


@pytest.fixture(scope="module")
def mug(cut: MeshShape) -> tuple[Any, ...]:
    """Its pieces."""
    return cut.pieces()


def rim() -> np.ndarray:
    """Corners (SIDES, 3) of the mug's base."""
    turns = 2.0 * math.pi * np.arange(SIDES) / SIDES
    return np.column_stack(
        [RADIUS * np.cos(turns), RADIUS * np.sin(turns), np.full(SIDES, -0.5 * HEIGHT)]
    )


GROUNDS = {
    "half-space": (coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), 0.0),
    "box": (coal.Box(1.0, 1.0, 0.2), 0.1),
}


def bodies(pieces: tuple[Any, ...], T: np.ndarray) -> list[CollisionBody]:
    return [CollisionBody("mug", piece, T) for piece in pieces]


def mismatch(found: np.ndarray, expected: np.ndarray) -> float:
    distances = np.linalg.norm(found[:, None] - expected[None], axis=2)
    return float(max(distances.min(axis=0).max(), distances.min(axis=1).max()))


@pytest.mark.parametrize("ground", GROUNDS)
def test_the_mug_stands_on_its_base_in_random_poses(mug: tuple[Any, ...], ground: str) -> None:
    rng = np.random.default_rng(11)
    for k in range(12):
        gap = rng.uniform(-5e-4, 5e-4) if k % 4 else (0.0, 1e-6, -1e-6)[k // 4 % 3]
        world = random_pose(rng)
        turn = (0.0, 0.0, rng.uniform(-3, 3))
        T = world @ pose_matrix([*rng.uniform(-0.1, 0.1, 2), 0.5 * HEIGHT + gap], turn)
        geometry, top = GROUNDS[ground]
        floor = CollisionBody("ground", geometry, world @ pose_matrix([0, 0, -top]))
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


def test_lying_on_its_handle_the_mug_touches_with_rim_and_handle(mug: tuple[Any, ...]) -> None:
    # Turned about y, the handle points down and stands on the floor with its flat side.
    T = pose_matrix([0, 0, HANDLE], (0.0, 0.5 * math.pi, 0.0))
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
INNER_BOTTOM = BOTTOM - 0.5 * HEIGHT
# point of the mug's surface that is touched, and the normal out of the mug there
TOUCHES = {
    "outside": (OUTER * ASIDE + 0.02 * UP, ASIDE),
    "inside": (INNER * ASIDE - 0.01 * UP, -ASIDE),
    "inside, other side": (-INNER * ASIDE + 0.03 * UP, ASIDE),
    "bottom from within": (np.array([0.003, 0.005, INNER_BOTTOM]), UP),
    "base from below": (np.array([0.01, -0.01, -0.5 * HEIGHT]), -UP),
    "handle from outside": (np.array([HANDLE, 0.001, 0.01]), EAST),
    "handle from within": (np.array([0.064, 0.002, -0.004]), -EAST),
    "handle from below, within": (np.array([0.053, -0.001, 0.024]), -UP),
}


@pytest.mark.parametrize("name", TOUCHES)
def test_a_fingertip_touches_the_mug_where_its_surface_is(mug: tuple[Any, ...], name: str) -> None:
    point, outward = TOUCHES[name]
    rng = np.random.default_rng(5)
    for _ in range(4):
        world, gap = random_pose(rng), rng.uniform(-5e-4, 5e-4)
        center = world @ pose_matrix(point + (0.008 + gap) * outward)
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


TIP = 0.008  # m, radius of the fingers here; the handle's opening is 0.022 m wide
REACH = 0.15  # m that they slide
OPENING = 0.053  # x of the middle of the handle's opening
INSIDE = 0.064  # x of the handle's inner side
LEAN = 2e-4  # m: CoACD fills hollows a little

FLOOR = Support("floor", HalfSpace(), np.eye(4))


@pytest.fixture
def hull(cut: MeshShape) -> MeshShape:
    return replace(cut, convex="hull")


def slider(folder: Path, start: object, way: object, *, reach: float = REACH) -> Hand:
    """A ball on a slide from a point along a direction."""
    turn = Rotation.align_vectors([way], [[1.0, 0.0, 0.0]])[0]
    limit = f'lower="0" upper="{reach}" effort="5"'
    parts = joint("slide", "base", "tip", "prismatic", limit, origin="", axis="1 0 0")
    file = write_urdf(
        folder, link("base") + parts + link("tip", f'<sphere radius="{TIP}"/>'), "slider.urdf"
    )
    pose = pose_matrix(np.asarray(start, dtype=float), turn.as_matrix())
    return Hand.from_urdf(file, T_world_base=pose, fingers={"finger": FingerSpec(("slide",))})


def test_a_finger_goes_through_the_handles_opening(tmp_path, cut, hull):
    hand = slider(tmp_path, (OPENING, -0.07, 0.0), (0, 1, 0))
    through = close_hand(hand, body(cut), rates={"slide": 1.0})
    assert through.hand.q["slide"] == REACH
    assert through.fingers[0].at_limit == ("slide",)
    assert not through.all_touch
    stopped = close_hand(hand, body(hull), rates={"slide": 1.0})
    assert stopped.touching == ("tip",)
    assert stopped.hand.q["slide"] < 0.07


@pytest.mark.parametrize(
    ("start", "way", "distance"),
    [
        ((OPENING, 0.0, 0.0), (1, 0, 0), INSIDE - OPENING - TIP),  # hooks the handle
        ((0.0, 0.0, 0.01), (0, 0, -1), 0.01 + 0.5 * HEIGHT - BOTTOM - TIP),  # to the bottom
        (
            (0.0, 0.0, 0.01),  # to a flat side of the wall, from within
            (-np.cos(np.pi / SIDES), np.sin(np.pi / SIDES), 0.0),
            (RADIUS - WALL) * np.cos(np.pi / SIDES) - TIP,
        ),
        ((0.12, 0.0, 0.0), (-1, 0, 0), 0.12 - HANDLE - TIP),  # to the handle, from outside
    ],
)
def test_a_finger_closes_on_the_surface_that_is_there(tmp_path, cut, start, way, distance):
    result = close_hand(slider(tmp_path, start, way), body(cut), rates={"slide": 1.0})
    assert result.touching == ("tip",)
    assert result.hand.q["slide"] == pytest.approx(distance, abs=LEAN)
    assert 0.0 <= result.fingers[0].distance <= 1e-5
    found = find_contacts(body(cut).collision_bodies(), result.hand.collision_bodies(), ())
    assert [contact.body for contact in found] == ["tip"]
    assert found[0].normal == pytest.approx(np.asarray(way) / np.linalg.norm(way), abs=1e-2)


def test_a_fingertip_is_placed_inside_the_handle(tmp_path, cut, hull):
    # The slide leads through the opening; the goal is beside it, on the handle's inner side.
    goal = {"finger": ((INSIDE, 0.001, 0.004), (1, 0, 0))}
    hand = slider(tmp_path, (INSIDE - TIP, -0.06, 0.004), (0, 1, 0))
    placed = place_fingertips(hand, body(cut), goal, tolerance=LEAN)
    assert placed.reached
    assert placed.hand.q["slide"] == pytest.approx(0.061, abs=1e-6)
    with pytest.raises(ArgumentError, match="inside the surface of object 'object'"):
        place_fingertips(hand, body(hull), goal)


def test_a_goal_on_a_seam_within_the_mug_is_refused(tmp_path, cut):
    hand = slider(tmp_path, (0, 0, 0.2), (0, 0, -1))
    target, on_seams = body(cut), 0
    middle = np.array([0.0, 0.0, 0.5 * (BOTTOM - HEIGHT)])  # of the bottom
    for point in middle + np.random.default_rng(2).uniform(-0.02, 0.02, (60, 3)) * [1, 1, 0.1]:
        with pytest.raises(ArgumentError, match="inside") as error:
            place_fingertips(hand, target, {"finger": (point, (0, 0, -1))})
        on_seams += "two of its convex pieces meet" in str(error.value)
    assert on_seams > 0


@pytest.mark.parametrize("start", [0.3, 0.055, 0.048])
def test_the_mug_settles_on_its_base(cut, start):
    mug = body(cut, (0.02, 0.01, start), Rotation.from_euler("z", 0.4).as_matrix(), name="mug")
    settled = settle_object(mug, [FLOOR])
    np.testing.assert_allclose(
        settled.T_world_object[:3, 3], [0.02, 0.01, 0.5 * HEIGHT], rtol=0, atol=3e-6
    )
    found = find_contacts(settled.collision_bodies(), [], FLOOR.collision_bodies(), max_points=12)
    assert len(found) == SIDES


def test_the_mug_settles_over_a_peg_with_its_hollow(cut, hull):
    upside_down = Rotation.from_euler("x", np.pi).as_matrix()
    peg = Support("peg", Box((0.01, 0.01, 0.15)), pose_matrix((0, 0, 0.075)))
    over = settle_object(body(cut, (0, 0, 0.5), upside_down), [FLOOR, peg])
    # The bottom's inner side, at the depth BOTTOM, comes to lie on the peg.
    assert over.T_world_object[2, 3] == pytest.approx(0.15 - 0.5 * HEIGHT + BOTTOM, abs=LEAN)
    on_top = settle_object(body(hull, (0, 0, 0.5), upside_down), [FLOOR, peg])
    assert on_top.T_world_object[2, 3] == pytest.approx(0.15 + 0.5 * HEIGHT, abs=1e-6)


def test_a_ball_settles_in_the_mug(cut):
    mug = Support("mug", cut, pose_matrix((0, 0, 0.5 * HEIGHT)))
    settled = settle_object(body(Sphere(0.01), (0.005, 0.0, 0.3)), [FLOOR, mug])
    assert settled.T_world_object[2, 3] == pytest.approx(BOTTOM + 0.01, abs=LEAN)
    distance = nearest_separation(mug.collision_bodies(), settled.collision_bodies()).distance
    assert abs(distance) < 1e-6


def test_overlaps_are_with_the_mug_and_not_with_its_hull(tmp_path, cut, hull):
    def overlaps(shape: MeshShape, center: object):
        hand = slider(tmp_path, center, (0, 1, 0))
        return unwanted_overlaps(hand, [Support("mug", shape, np.eye(4))])

    for free in ((0, 0, 0.0), (OPENING, 0, 0)):
        assert overlaps(cut, free) == ()
        assert len(overlaps(hull, free)) == 1
    (overlap,) = overlaps(cut, (HANDLE + TIP - 0.003, 0, 0))
    assert (overlap.link, overlap.other, overlap.kind) == ("tip", "mug", BodyKind.SUPPORT)
    assert overlap.depth == pytest.approx(0.003, abs=1e-5)
