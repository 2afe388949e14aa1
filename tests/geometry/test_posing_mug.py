"""Posing around a mug cut into convex pieces: its hollow and its handle's opening are free."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_tools import joint, link, write_urdf
from mugs import BOTTOM, HANDLE, HEIGHT, RADIUS, SIDES, WALL, cut_mug
from planar_fingers import body
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import Box, HalfSpace, MeshShape, Sphere
from graspless_pin.geometry.contact.distances import nearest_separation
from graspless_pin.geometry.contact.finding import BodyKind, find_contacts
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.posing.closing import close_hand
from graspless_pin.geometry.posing.fingertips import place_fingertips
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.geometry.posing.settling import settle_object
from graspless_pin.geometry.robots.description import FingerSpec

TIP = 0.008  # m, radius of the fingers here; the handle's opening is 0.022 m wide
REACH = 0.15  # m that they slide
OPENING = 0.053  # x of the middle of the handle's opening
INSIDE = 0.064  # x of the handle's inner side
LEAN = 2e-4  # m: CoACD fills hollows a little

FLOOR = Support("floor", HalfSpace(), np.eye(4))


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MeshShape]:
    with cut_mug(tmp_path_factory) as shape:
        yield shape


@pytest.fixture
def hull(cut: MeshShape) -> MeshShape:
    return replace(cut, convex="hull")


def slider(folder: Path, start: object, way: object, *, reach: float = REACH) -> Hand:
    """A ball on a slide from a point along a direction."""
    turn = Rotation.align_vectors([way], [[1.0, 0.0, 0.0]])[0]
    limit = f'lower="0" upper="{reach}" effort="5"'
    parts = joint("slide", "base", "tip", "prismatic", limit)
    parts = parts.replace('xyz="0.1 0.02 0" rpy="0.2 0 0.1"', 'xyz="0 0 0"')
    parts = parts.replace('axis xyz="0 0.6 0.8"', 'axis xyz="1 0 0"')
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
