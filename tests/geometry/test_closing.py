"""Closing fingers: hand-worked angles, gaps measured afterwards, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from planar_fingers import (
    KNUCKLE,
    LOWER,
    RADIUS,
    UPPER,
    allegro,
    ball,
    jaws,
    lever,
    plate_above,
    two_link_finger,
)

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.contact.distances import nearest_separation
from graspless_pin.geometry.posing.closing import close_hand

GAP = 1e-5


def gaps(hand, target) -> dict[str, float]:
    """Smallest signed distance of each link."""
    found: dict[str, float] = {}
    for shape in hand.collision_bodies():
        distance = nearest_separation([shape], target.collision_bodies()).distance
        found[shape.name] = min(found.get(shape.name, np.inf), distance)
    return found


def lever_angle(height: float) -> float:
    """q where the tip sphere of the 0.15 m lever touches y = height from below.

    Its centre is at radius hypot(0.15, 0.01) and starts at the angle atan2(0.01, 0.15).
    """
    return np.arcsin((height - RADIUS) / np.hypot(0.15, RADIUS)) - np.arctan2(RADIUS, 0.15)


@settings(max_examples=10)
@given(height=st.floats(0.025, 0.13))
def test_a_lever_closes_on_a_plate_at_the_angle_of_its_sine(height):
    result = close_hand(lever(), plate_above(height))
    assert result.hand.q["hinge"] == pytest.approx(lever_angle(height), abs=GAP / 0.05)
    (finger,) = result.fingers
    assert (finger.touching, finger.at_limit) == (("tip",), ())
    assert 0.0 <= finger.distance <= GAP
    assert result.all_touch


def test_a_lever_closes_downwards_on_a_plate_below():
    plate = plate_above(-0.12)  # its upper side is at y = -0.1
    result = close_hand(lever(), plate)
    expected = -np.arcsin((0.1 - RADIUS) / np.hypot(0.15, RADIUS)) - np.arctan2(RADIUS, 0.15)
    assert result.hand.q["hinge"] == pytest.approx(expected, abs=1e-3)


def test_a_smaller_gap_comes_closer():
    for gap in (1e-3, 1e-4, 1e-7):
        (finger,) = close_hand(lever(), plate_above(0.1), gap=gap).fingers
        assert 0.0 <= finger.distance <= gap


def test_out_of_reach_ends_at_the_limit_with_the_distance():
    result = close_hand(lever(), plate_above(0.2))
    (finger,) = result.fingers
    assert (finger.touching, finger.at_limit) == ((), ("hinge",))
    assert result.hand.q["hinge"] == 1.57
    highest = np.hypot(0.15, RADIUS) * np.sin(1.57 + np.arctan2(RADIUS, 0.15)) + RADIUS
    assert finger.distance == pytest.approx(0.2 - highest, abs=1e-7)
    assert not result.all_touch
    assert "touches nothing" in str(result)
    assert "hinge" in str(result)


def test_a_jaw_moves_by_the_known_distance_to_a_sphere(tmp_path):
    result = close_hand(jaws(tmp_path), ball(0.02, (0.0, 0.0, 0.0)))
    # The pads start 0.05 m from the middle.
    assert result.hand.q["left_slide"] == pytest.approx(0.03, abs=GAP)
    assert result.hand.q["right_slide"] == pytest.approx(0.03, abs=GAP)
    assert result.touching == ("left", "right")


@pytest.mark.parametrize(("offset", "first"), [(-0.01, "left"), (0.01, "right")])
def test_coupled_jaws_stop_at_the_first_touch(tmp_path, offset, first):
    result = close_hand(jaws(tmp_path), ball(0.02, (offset, 0.0, 0.0)), fingers=[first])
    assert result.touching == (first,)
    assert result.hand.q["left_slide"] == pytest.approx(0.02, abs=GAP)
    both = close_hand(jaws(tmp_path), ball(0.02, (offset, 0.0, 0.0)))
    assert both.touching == (first,)
    assert [finger.finger for finger in both.fingers] == ["left", "right"]
    assert max(finger.distance for finger in both.fingers) == pytest.approx(0.02, abs=2 * GAP)


def test_wrapping_freezes_the_first_joint_and_goes_on_with_the_second(tmp_path):
    height = 0.04
    hand = two_link_finger(tmp_path, second=-1.2)
    first = np.arcsin((height - RADIUS) / KNUCKLE)
    second = np.arcsin((height - RADIUS - UPPER * np.sin(first)) / LOWER) - first
    stopped = close_hand(hand, plate_above(height))
    assert stopped.touching == ("upper",)
    assert stopped.hand.q["first"] == pytest.approx(first, abs=1e-3)
    assert stopped.hand.q["second"] == pytest.approx(first - 1.2, abs=1e-3)
    wrapped = close_hand(hand, plate_above(height), wrap=True)
    assert wrapped.touching == ("upper", "lower")
    assert wrapped.hand.q["first"] == stopped.hand.q["first"]
    assert wrapped.hand.q["second"] == pytest.approx(second, abs=1e-3)


def test_wrapping_keeps_joints_that_move_a_touching_link(tmp_path):
    # The lower link touches first, so that nothing is left to move.
    hand = two_link_finger(tmp_path, second=0.3)
    plain, wrapped = (close_hand(hand, plate_above(0.05), wrap=w) for w in (False, True))
    assert wrapped.touching == ("lower",)
    assert wrapped.hand.q == plain.hand.q
    with pytest.raises(ArgumentError, match="wrap: is 'no'; it must be True or False"):
        close_hand(hand, plate_above(0.05), wrap="no")  # pyright: ignore[reportArgumentType]


def test_rates_turn_hold_and_weight_joints(tmp_path):
    hand = two_link_finger(tmp_path)
    plate = plate_above(0.06)
    held = close_hand(hand, plate, rates={"second": 0.0})
    assert held.hand.q["second"] == 0.0
    assert held.hand.q["first"] == pytest.approx(np.arcsin(0.05 / (UPPER + LOWER)), abs=1e-3)
    weighted = close_hand(hand, plate, rates={"second": 2.0})
    assert weighted.hand.q["second"] == pytest.approx(2.0 * weighted.hand.q["first"])
    away = close_hand(hand, plate, rates={"first": -1.0, "second": -1.0})
    assert away.hand.q == {"first": -1.5, "second": -2.0}
    assert away.fingers[0].at_limit == ("first", "second")


def test_closing_twice_changes_nothing():
    hand = allegro(joint_12=1.2)
    target = ball(0.05, (0.0612, 0.01, 0.05))
    once = close_hand(hand, target, wrap=True)
    twice = close_hand(once.hand, target, wrap=True)
    assert twice.hand.q == once.hand.q
    assert twice.touching == once.touching


@settings(max_examples=5, suppress_health_check=[HealthCheck.too_slow])
@given(
    x=st.floats(0.06, 0.09),
    y=st.floats(-0.02, 0.02),
    z=st.floats(0.03, 0.1),
    wrap=st.booleans(),
)
def test_no_finger_ends_in_the_object(x, y, z, wrap):
    target = ball(0.03, (x, y, z))
    result = close_hand(allegro(), target, fingers=["index", "middle", "ring"], wrap=wrap)
    measured = gaps(result.hand, target)
    assert min(measured.values()) >= 0.0
    touching = {link for link, gap in measured.items() if gap <= GAP}
    assert touching == set(result.touching)


def test_a_start_in_the_object_is_refused():
    with pytest.raises(SceneError, match=r"'tip' overlaps object 'plate' by 5\.00 mm"):
        close_hand(lever(), plate_above(0.015))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fingers": ["pinky"]}, "unknown finger 'pinky'; known: finger"),
        ({"fingers": "finger"}, "a list of names"),
        ({"rates": {"wrist": 1.0}}, "unknown joint of the closing fingers 'wrist'; known: hinge"),
        ({"rates": {"hinge": np.nan}}, "rates.*finite number"),
        ({"rates": {"hinge": "fast"}}, r"rates\['hinge'\]: is 'fast'; it must be a finite number"),
        ({"gap": 0.0}, "gap: needs a positive length"),
        ({"gap": "x"}, "gap: is 'x'; it must be a finite number"),
    ],
)
def test_bad_arguments_are_named(options, message):
    with pytest.raises(ArgumentError, match=message):
        close_hand(lever(), plate_above(0.1), **options)


def test_a_rate_for_a_mimic_joint_is_refused(tmp_path):
    with pytest.raises(ArgumentError, match="unknown joint of the closing fingers 'right_slide'"):
        close_hand(jaws(tmp_path), ball(0.02, (0, 0, 0)), rates={"right_slide": 1.0})
