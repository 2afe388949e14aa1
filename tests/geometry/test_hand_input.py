"""Configurations, control modes, effort limits: defaults and the messages for mistakes."""

import warnings
from typing import Any

import numpy as np
import pytest
from hand_tools import joint, link, write_urdf

from graspless_pin.errors import ArgumentError, GrasplessPinWarning
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.robots.description import FingerSpec


@pytest.fixture(scope="module")
def allegro():
    return Hand.assemble([Mount("allegro_right")])


@pytest.fixture
def coupled(tmp_path):
    body = "".join(link(name) for name in ("base", "a", "b", "c"))
    body += joint("lead", "base", "a", limit='lower="-1" upper="2" effort="2"')
    body += joint("follow", "a", "b", extra='<mimic joint="lead" offset="-0.25"/>')
    body += joint("free", "b", "c", "continuous", limit='effort="3"')
    return write_urdf(tmp_path, body)


def test_unnamed_joints_stand_at_zero_or_at_the_nearest_limit(allegro):
    assert allegro.q["joint_12.0"] == 0.263
    assert {q for name, q in allegro.q.items() if name != "joint_12.0"} == {0.0}


def test_joint_order_is_the_models(allegro):
    numbers = [*range(4), *range(12, 16), *range(4, 8), *range(8, 12)]
    assert allegro.joint_names == tuple(f"joint_{n}.0" for n in numbers)
    assert allegro.actuated_joint_names == allegro.joint_names


def test_a_named_mimic_joint_must_agree(coupled):
    hand = Hand.from_urdf(coupled, q={"lead": 0.5, "follow": 0.25, "free": 40.0})
    assert hand.q == {"lead": 0.5, "follow": 0.25, "free": 40.0}


FLAGS = [True, *[0.0] * 15]
LIMITS: dict[str, Any] = {"index": [0, True]}


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda hand: hand.with_configuration(FLAGS), "q: needs numbers, got"),
        (lambda hand: hand.with_configuration(np.array(FLAGS, bool)), "q: needs numbers, got"),
        (lambda hand: hand.with_configuration({"joint_0.0": False}), r"q\['joint_0.0'\]: is False"),
        (lambda hand: hand.with_configuration({"joint_0.0": "0"}), r"not text; write 0"),
        (lambda hand: hand.with_base_at(np.eye(4, dtype=bool)), "T_world_base: needs numbers"),
        (
            lambda _: Hand.assemble([Mount("allegro_right")], effort_limits=LIMITS),
            r"effort_limits\['index'\]: needs a number or a pair, got \[0, True\]",
        ),
    ],
)
def test_true_and_false_are_no_numbers(allegro, ask, message):
    with pytest.raises(ArgumentError, match=message):
        ask(allegro)


def test_limits_come_from_urdf_robot_file_and_caller_in_rising_order(allegro):
    urdf = Hand.from_model_name("allegro_right_hand")
    np.testing.assert_array_equal(urdf.effort_limits[1], np.full(16, 15.0))
    np.testing.assert_array_equal(allegro.effort_limits, [[-0.7] * 16, [0.7] * 16])
    limits = {"joint_2.0": (-0.1, 0.2), "index": 0.5}
    hand = Hand.assemble([Mount("allegro_right")], effort_limits=limits)
    np.testing.assert_array_equal(hand.effort_limits[0], [-0.5, -0.5, -0.1, -0.5] + [-0.7] * 12)
    np.testing.assert_array_equal(hand.effort_limits[1], [0.5, 0.5, 0.2, 0.5] + [0.7] * 12)


def one_joint(tmp_path, effort):
    limit = f'lower="-1" upper="1" {effort}'
    body = link("base") + link("a") + joint("hinge", "base", "a", limit=limit)
    return write_urdf(tmp_path, body)


@pytest.mark.parametrize(
    ("effort", "value"),
    [('effort="0"', "0"), ('effort="inf"', "inf"), ('effort="1000"', "1000"), ("", "inf")],
)
def test_placeholder_efforts_warn(tmp_path, effort, value):
    """Of a chain without a palm, which counts as an arm: 100 N m may be its own."""
    file = one_joint(tmp_path, effort)
    told = "unlimited" if value == "inf" else value
    with pytest.warns(GrasplessPinWarning, match=rf"'hinge' \({told}\); give .*effort_limits"):
        hand = Hand.from_urdf(file)
    np.testing.assert_array_equal(hand.effort_limits, [[-float(value)], [float(value)]])


def test_no_placeholder_warning_where_it_does_not_matter(tmp_path):
    file = one_joint(tmp_path, 'effort="0"')
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hand = Hand.from_urdf(file, effort_limits={"hinge": 1.5})
        Hand.from_urdf(file, control="position")
        Hand.from_urdf(one_joint(tmp_path, 'effort="99"'))
        hand.with_configuration({"hinge": 0.5})
    np.testing.assert_array_equal(hand.effort_limits, [[-1.5], [1.5]])


def assembled(**options):
    return Hand.assemble([Mount("allegro_right")], **options)


def with_fingers(**fingers):
    return Hand.from_model_name("allegro_right_hand", fingers=fingers)


ORIGIN = [[0, 0, 0]]
MISTAKES = [
    # What `graspless-pin solve` says of scenes is in tests/cli/test_bad_scenes.py.
    (lambda h: h.with_configuration({"joint_99": 0.0}), r"q: unknown joint 'joint_99'; did you mean"
     r" 'joint_9.0'. known: joint_0.0, joint_1.0"),
    (lambda h: h.with_configuration({"joint_1.0": 2.0}), r"'joint_1.0'\]: is 2, outside .*1.61\]"),
    (lambda h: h.with_configuration({"joint_12.0": 0.0}), r"the joint's limits \[0.263, 1.396\]"),
    (lambda h: h.with_configuration({"joint_1.0": float("nan")}), "must be a finite number"),
    (lambda h: h.with_configuration({"joint_1.0": "bent"}), "is 'bent'; it must be a finite"),
    (lambda _: assembled(control="soft"), "is 'soft'; it must be one of 'force', 'position'"),
    (lambda _: assembled(control={"joint_1.0": "hybrid"}), "hybrid control is per finger"),
    (lambda _: assembled(control={"index": "hybrid", "joint_1.0": "force"}),
     "finger 'index' is under hybrid control"),
    (lambda _: assembled(effort_limits={"index": float("inf")}), "needs a finite number"),
    (lambda _: assembled(effort_limits={"index": "strong"}), "a number or a pair, got 'strong'"),
    (lambda _: assembled(effort_limits={"index": (1.0, 2.0, 3.0)}), "a finite number or a pair"),
    (lambda _: with_fingers(f=FingerSpec(("nope",))),
     r"fingers\['f'\]: unknown joint 'nope'; known: joint_0.0"),
    (lambda _: with_fingers(f=FingerSpec((), ("nope",))), "unknown link 'nope'"),
    (lambda _: with_fingers(f=FingerSpec(("joint_0.0",), tip="nope")), "unknown link 'nope'"),
    (lambda _: with_fingers(f=FingerSpec(("joint_0.0",)), g=FingerSpec(("joint_1.0",))),
     r"fingers\['g'\]: link 'link_1.0' already belongs to finger 'f'"),
    (lambda h: h.contact_jacobian(["nail"], ORIGIN), "links: unknown link 'nail'; known:"),
    (lambda h: h.contact_jacobian(["palm_link"], [0, 0, 0]), r"points: needs shape \(1, 3\)"),
    (lambda h: h.contact_jacobian(["palm_link"], [[0, 0, np.inf]]), "points: needs finite"),
    (lambda h: h.gravity_torques(-9.8), "gravity: has shape"),
    (lambda h: h.pose_of("nail"), "unknown link 'nail'"),
    (lambda h: h.finger_of("nail"), "unknown link 'nail'"),
    (lambda h: h.point_velocities(["palm_link"], ORIGIN, {"joint_1.0": np.nan}),
     "joint_velocities.*finite number"),
    (lambda h: h.point_velocities(["palm_link"], ORIGIN, None, [1, 2, 3]), "base_twist: has shape"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "message"), MISTAKES)
def test_mistakes_are_named(allegro, call, message):
    with pytest.raises(ArgumentError, match=message):
        call(allegro)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"q": {"lead": 0.5, "follow": 0.5}}, r"q\['follow'\]: .*'lead' and is at 0.25"),
        ({"q": {"lead": 1.9}}, r"q\['follow'\]: is 1.65 because it mimics 'lead', outside .* 1\]"),
        ({"control": {"follow": "position"}}, r"control\['follow'\]: .*mimics"),
        ({"effort_limits": {"follow": 1.0}}, r"effort_limits\['follow'\]: .*mimics"),
    ],
)
def test_mimic_joints_have_nothing_of_their_own(coupled, options, message):
    with pytest.raises(ArgumentError, match=message):
        Hand.from_urdf(coupled, **options)
    with pytest.raises(ArgumentError, match="joint_velocities: unknown independent joint 'follow'"):
        Hand.from_urdf(coupled).point_velocities(["a"], ORIGIN, {"follow": 1.0})


def test_no_contact_gives_an_empty_jacobian(allegro):
    assert allegro.contact_jacobian([], np.empty((0, 3))).shape == (0, 16)


def test_a_hand_without_joints_has_no_columns(tmp_path):
    hand = Hand.from_urdf(write_urdf(tmp_path, link("palm", '<box size="1 1 1"/>')))
    assert hand.contact_jacobian(["palm"], [[0, 0, 0]]).shape == (3, 0)
    assert hand.gravity_torques([0, 0, -9.8]).shape == (0,)
    assert [body.name for body in hand.collision_bodies()] == ["palm"]


def test_arrays_are_read_only(allegro):
    for array in (*allegro.effort_limits, allegro.positions, allegro.T_world_base):
        assert not array.flags.writeable
    with pytest.raises(TypeError):
        allegro.q["joint_1.0"] = 1.0
