"""Putting fingertips on points: worked out by hand, round trips, and honest residuals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hand_tools import joint, link, random_q, write_urdf
from hypothesis import given, settings
from hypothesis import strategies as st
from planar_fingers import (
    LOWER,
    RADIUS,
    UPPER,
    allegro,
    ball,
    body,
    jaws,
    lever,
    plate_above,
    two_link_finger,
)

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.shapes import Box
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.fingertips import place_fingertips
from graspless_pin.geometry.robots.description import FingerSpec

INTO_PLATE = (0.0, 1.0, 0.0)
TIP_RADIUS = 0.012  # of the Allegro's fingertips
TIPS = {"index": "link_3.0_tip", "middle": "link_7.0_tip", "thumb": "link_15.0_tip"}


def test_a_two_link_finger_takes_the_elbow_of_the_cosine_rule(tmp_path):
    hand = two_link_finger(tmp_path, first=0.2, second=0.5)
    x, y = 0.09, 0.05
    placed = place_fingertips(hand, plate_above(y), {"finger": ((x, y, 0.0), INTO_PLATE)})
    center = np.array([x, y - RADIUS])
    reach = float(center @ center)
    bend = np.arccos((reach - UPPER**2 - LOWER**2) / (2 * UPPER * LOWER))
    first = np.arctan2(*center[::-1]) - np.arctan2(
        LOWER * np.sin(bend), UPPER + LOWER * np.cos(bend)
    )
    assert placed.hand.q == pytest.approx({"first": first, "second": bend}, abs=1e-6)
    (tip,) = placed.fingertips
    assert (tip.finger, tip.link, tip.overlapping) == ("finger", "lower", ())
    assert tip.residual < 1e-7
    np.testing.assert_allclose(tip.position, [x, y, 0.0], atol=1e-7)
    assert placed.reached


def test_the_other_elbow_is_taken_where_the_first_would_be_in_the_object(tmp_path):
    # From here the elbow would stick through the plate.
    hand = two_link_finger(tmp_path, first=1.4, second=-1.6)
    placed = place_fingertips(hand, plate_above(0.03), {"finger": ((0.09, 0.03, 0), INTO_PLATE)})
    assert placed.reached
    assert placed.hand.q["second"] > 0.0
    only_one = place_fingertips(
        hand, plate_above(0.03), {"finger": ((0.09, 0.03, 0), INTO_PLATE)}, starts=1
    )
    assert not only_one.reached
    assert only_one.fingertips[0].overlapping == ("upper",)
    assert "inside" in str(only_one)


def test_an_unreachable_point_leaves_the_distance_that_cannot_be_bridged(tmp_path):
    hand = two_link_finger(tmp_path, first=0.2, second=0.3)
    target = plate_above(0.03)
    placed = place_fingertips(hand, target, {"finger": ((0.3, 0.03, 0.0), INTO_PLATE)})
    short = np.hypot(0.3, 0.03 - RADIUS) - (UPPER + LOWER)
    assert placed.fingertips[0].residual == pytest.approx(short, abs=1e-6)
    assert not placed.reached
    assert f"{short * 1e3:.3f} mm from its point" in str(placed)


def test_joint_limits_hold():
    # The tip would have to be behind the hinge, beyond the limit of 1.57.
    target = plate_above(0.1)
    placed = place_fingertips(lever(), target, {"finger": ((-0.1, 0.1, 0.0), INTO_PLATE)})
    assert placed.hand.q["hinge"] == pytest.approx(1.57, abs=1e-5)
    assert placed.fingertips[0].residual > 0.09
    assert placed.fingertips[0].at_limit == ("hinge",)
    assert "at their limit: hinge" in str(placed)


def three_link_finger(folder: Path, **q: float) -> Hand:
    """Links of 0.06, 0.06 and 0.04 m in a plane, each joint from -0.5 to 1.5: one to spare."""
    limit = 'lower="-0.5" upper="1.5" effort="2"'
    text = link("base")
    for name, parent, x in (("a", "base", 0.0), ("b", "a", 0.06), ("c", "b", 0.06)):
        origin = f'xyz="{x} 0 0"'
        text += joint(f"q{name}", parent, name, limit=limit, origin=origin, axis="0 0 1")
        text += link(name) if name != "c" else ""
    ball = f'<origin xyz="0.04 0 0"/><geometry><sphere radius="{RADIUS}"/></geometry>'
    text += f'<link name="c"><collision>{ball}</collision></link>'
    fingers = {"finger": FingerSpec(("qa", "qb", "qc"), tip="c")}
    return Hand.from_urdf(write_urdf(folder, text), fingers=fingers, q=q)


@pytest.mark.parametrize("qc", [-0.5, 1.5, -0.45])
def test_a_joint_to_spare_keeps_the_others_off_their_limits(tmp_path, qc):
    # The tip is at its goal already, with a joint at or near its limit.
    hand = three_link_finger(tmp_path, qa=0.5, qb=0.6, qc=qc)
    point = hand.pose_of("c") @ [0.04, RADIUS, 0.0, 1.0]
    normal = hand.pose_of("c")[:3, 1]
    target = ball(0.01, point[:3] + 0.01 * normal)
    placed = place_fingertips(hand, target, {"finger": (point[:3], normal)})
    assert placed.reached
    assert placed.fingertips[0].at_limit == ()
    for position in placed.hand.q.values():
        assert -0.5 + 0.09 * 2.0 < position < 1.5 - 0.09 * 2.0
    # Where no joint is near its limit, the finger stays as it is.
    easy = three_link_finger(tmp_path, qa=0.5, qb=0.6, qc=0.4)
    point = easy.pose_of("c") @ [0.04, RADIUS, 0.0, 1.0]
    normal = easy.pose_of("c")[:3, 1]
    target = ball(0.01, point[:3] + 0.01 * normal)
    still = place_fingertips(easy, target, {"finger": (point[:3], normal)})
    assert still.hand.q == pytest.approx(dict(easy.q), abs=1e-5)


@pytest.mark.parametrize(("second", "expected"), [(1.0, 1.0), (-1.0, 1.0)])
def test_a_limit_is_kept_only_where_the_point_asks_for_it(tmp_path, second, expected):
    # The elbow that is bent backwards stands at its limit; of the other one it is the only posture.
    hand = two_link_finger(tmp_path, first=1.5, second=second)
    center = hand.pose_of("lower")[:3] @ [LOWER, 0.0, 0.0, 1.0]
    normal = hand.pose_of("lower")[:3, 0]
    point = center + RADIUS * normal
    target = ball(0.003, point + 0.003 * normal)
    placed = place_fingertips(hand, target, {"finger": (point, normal)})
    assert placed.reached
    assert placed.hand.q["second"] == pytest.approx(expected, abs=1e-4)
    at_limit = ("first",) if second == expected else ()
    assert placed.fingertips[0].at_limit == at_limit
    assert ("at their limit: first" in str(placed)) == bool(at_limit)


@settings(max_examples=3)
@given(seed=st.integers(0, 10**6), finger=st.sampled_from(sorted(TIPS)))
def test_an_allegro_finger_finds_its_way_back_to_where_it_was(seed, finger):
    rng = np.random.default_rng(seed)
    there = allegro().with_configuration(random_q(allegro(), rng))
    center = there.pose_of(TIPS[finger])[:3, 3]
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    point = center + TIP_RADIUS * normal
    target = ball(0.004, point + 0.004 * normal)
    placed = place_fingertips(allegro(), target, {finger: (point, 3.0 * normal)})
    assert placed.fingertips[0].residual <= placed.tolerance
    reached = placed.hand.pose_of(TIPS[finger])[:3, 3]
    np.testing.assert_allclose(reached, center, atol=placed.tolerance)


def test_jaws_on_one_motor_share_the_miss(tmp_path):
    # The left pad should go 0.03 m, the right one 0.01 m: both go 0.02 m. The pads' corners lie on
    # the line from jaw to jaw only on average.
    target = body(Box((0.06, 0.02, 0.02)), (0.01, 0.0, 0.0), name="bar")
    goals = {"left": ((-0.02, 0, 0), (1, 0, 0)), "right": ((0.04, 0, 0), (-1, 0, 0))}
    placed = place_fingertips(jaws(tmp_path), target, goals, starts=1)
    assert placed.hand.q["left_slide"] == pytest.approx(0.02, abs=1e-6)
    assert [tip.residual for tip in placed.fingertips] == pytest.approx([0.01, 0.01], abs=1e-6)


@pytest.mark.parametrize(
    ("goals", "message"),
    [
        ({}, "at least one finger"),
        ({"pinky": ((0, 0.1, 0), INTO_PLATE)}, "unknown finger 'pinky'"),
        ({"finger": ((0, 0.1), INTO_PLATE)}, "the point needs three finite numbers"),
        ({"finger": ((0, 0.1, 0), (0, np.nan, 0))}, "the normal needs three finite numbers"),
        ({"finger": ((0, 0.1, 0), (0, 0, 0))}, "the normal must not be zero"),
        ({"finger": "there"}, r"needs \(point, normal\)"),
        ({"finger": ((0, 0.1, 0), (0, -1, 0))}, "points out of object 'plate'"),
        ({"finger": ((0, 0.08, 0), INTO_PLATE)}, r"20\.0 mm outside .* is \[0\.0, 0\.1, 0\.0\]"),
        ({"finger": ((0, 0.105, 0), INTO_PLATE)}, r"5\.0 mm inside .* is \[0\.0, 0\.1, 0\.0\]"),
    ],
)
def test_bad_goals_are_named(goals, message):
    with pytest.raises(ArgumentError, match=message):
        place_fingertips(lever(), plate_above(0.1), goals)


@pytest.mark.parametrize(
    "options", [{"tolerance": 0.0}, {"tolerance": "x"}, {"starts": 0}, {"starts": "x"}]
)
def test_bad_options_are_named(options):
    (name,) = options
    with pytest.raises(ArgumentError, match=f"^{name}: "):
        place_fingertips(
            lever(), plate_above(0.1), {"finger": ((0.1, 0.1, 0), INTO_PLATE)}, **options
        )
