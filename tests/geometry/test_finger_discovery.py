"""Palms and fingers found from the tree, and what becomes of the joints above a palm."""

import numpy as np
import pytest
from hand_tools import joint, link, write_urdf

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.inspection import list_robots
from graspless_pin.geometry.robots.description import FingerSpec
from graspless_pin.problem import ControlMode

BALL = '<sphere radius="0.01"/>'


def links(*names):
    return "".join(link(name) for name in names)


def two_fingers(palm, prefix):
    """Two fingers of two joints; the first one alone ends in a shape, on a fixed tip."""
    body = links(*(f"{prefix}{name}" for name in ("a0", "a1", "b1", "b_frame")))
    body += link(f"{prefix}b0", BALL.replace("0.01", "0.05"))
    body += link(f"{prefix}a_tip", BALL) + link(f"{prefix}a_frame")
    for finger in "ab":
        body += joint(f"{prefix}{finger}_0_joint", palm, f"{prefix}{finger}0")
        body += joint(f"{prefix}{finger}_1_joint", f"{prefix}{finger}0", f"{prefix}{finger}1")
    body += joint(f"{prefix}a_mount", f"{prefix}a1", f"{prefix}a_tip", "fixed", limit="")
    body += joint(f"{prefix}a_view", f"{prefix}a1", f"{prefix}a_frame", "fixed", limit="")
    return body + joint(f"{prefix}b_view", f"{prefix}b1", f"{prefix}b_frame", "fixed", limit="")


ARM = (
    links("base", "upper", "lower", "flange", "palm")
    + joint("shoulder", "base", "upper")
    + joint("elbow", "upper", "lower")
    + joint("wrist", "lower", "flange", "fixed", limit="")
    + joint("adapter", "flange", "palm", "fixed", limit="")
)


@pytest.fixture
def on_arm(tmp_path):
    return write_urdf(tmp_path, ARM + two_fingers("palm", ""))


def test_a_bare_hand_has_a_palm_fingers_and_no_arm(tmp_path):
    hand = Hand.from_urdf(write_urdf(tmp_path, link("palm") + two_fingers("palm", "")))
    assert hand.palms == ("palm",)
    assert dict(hand.fingers) == {
        "a": FingerSpec(("a_0_joint", "a_1_joint"), ("a0", "a1", "a_tip", "a_frame"), "a_tip"),
        "b": FingerSpec(("b_0_joint", "b_1_joint"), ("b0", "b1", "b_frame"), "b_frame"),
    }
    assert not hand.arms
    assert hand.actuated_joint_names == hand.joint_names


def test_joints_above_the_palm_are_held_unless_asked_for(on_arm):
    hand = Hand.from_urdf(on_arm)
    assert hand.palms == ("palm",)
    assert list(hand.fingers) == ["a", "b"]
    assert dict(hand.arms) == {"arm": ("shoulder", "elbow")}
    fingers = ("a_0_joint", "a_1_joint", "b_0_joint", "b_1_joint")
    assert hand.actuated_joint_names == fingers
    assert hand.control.joints["elbow"] is ControlMode.POSITION
    for control in ("force", {"arm": "force"}, {"shoulder": "force", "elbow": "force"}):
        whole = Hand.from_urdf(on_arm, control=control)
        assert whole.actuated_joint_names == ("shoulder", "elbow", *fingers)
    some = Hand.from_urdf(on_arm, control={"arm": "force", "elbow": "position"})
    assert some.actuated_joint_names == ("shoulder", *fingers)


def test_a_named_palm_or_named_fingers_come_first(on_arm, tmp_path):
    file = tmp_path / "robot.yaml"
    file.write_text("name: r\nurdf: robot.urdf\npalm: upper\n")
    hand = Hand.assemble([Mount(file)])
    assert hand.palms == ("upper",)
    assert [spec.joints[0] for spec in hand.fingers.values()] == ["elbow"]
    assert hand.actuated_joint_names == hand.joint_names[1:]
    given = Hand.from_urdf(on_arm, fingers={"all": FingerSpec(("elbow", "a_0_joint"))})
    assert list(given.fingers) == ["all"]
    assert given.control.joints["elbow"] is ControlMode.FORCE
    assert given.control.joints["shoulder"] is ControlMode.POSITION


def test_a_chain_has_no_palm_and_keeps_all_its_joints(tmp_path):
    hand = Hand.from_urdf(write_urdf(tmp_path, ARM))
    assert hand.palms == ()
    assert not hand.fingers
    assert hand.actuated_joint_names == ("shoulder", "elbow")


def test_two_hands_on_a_body_with_a_neck(tmp_path):
    body = links("torso", "arm_l", "arm_r", "palm_l", "palm_r", "neck", "head")
    body += joint("nod", "torso", "neck") + joint("turn", "neck", "head")
    for side in "lr":
        body += joint(f"shoulder_{side}", "torso", f"arm_{side}")
        body += joint(f"mount_{side}", f"arm_{side}", f"palm_{side}", "fixed", limit="")
        body += two_fingers(f"palm_{side}", f"{side}_")
    hand = Hand.from_urdf(write_urdf(tmp_path, body))
    assert hand.palms == ("palm_l", "palm_r")
    assert list(hand.fingers) == ["l_a", "l_b", "r_a", "r_b"]
    assert dict(hand.arms) == {"arm": ("shoulder_l", "shoulder_r")}
    held = {n for n, mode in hand.control.joints.items() if mode is ControlMode.POSITION}
    assert held == {"nod", "turn", "shoulder_l", "shoulder_r"}


def test_the_palm_is_the_lowest_link_that_all_branches_hang_on(tmp_path):
    body = links("base", "hand", "plate", "camera", "a", "b")
    body += joint("i", "base", "hand", "fixed", limit="") + joint(
        "j", "hand", "plate", "fixed", limit=""
    )
    body += joint("k", "hand", "camera", "fixed", limit="")
    body += joint("left", "plate", "a") + joint("right", "plate", "b")
    assert Hand.from_urdf(write_urdf(tmp_path, body)).palms == ("plate",)
    body = body.replace(
        '<parent link="plate"/><child link="b"/>', '<parent link="hand"/><child link="b"/>'
    )
    assert Hand.from_urdf(write_urdf(tmp_path, body)).palms == ("hand",)


def test_a_linkage_of_one_motor_is_one_finger_however_it_branches(tmp_path):
    follow = '<mimic joint="motor" multiplier="{}"/>'
    body = links("palm", "crank", "bar", "pad", "pad2")
    body += joint("motor", "palm", "crank")
    body += joint("push", "palm", "bar", extra=follow.format(1))
    body += joint("tilt", "bar", "pad", extra=follow.format(-1))
    body += joint("tilt2", "bar", "pad2", extra=follow.format(-1))
    hand = Hand.from_urdf(write_urdf(tmp_path, body))
    assert hand.palms == ("palm",)
    assert [spec.joints for spec in hand.fingers.values()] == [
        ("motor",),
        ("push", "tilt", "tilt2"),
    ]


def test_what_cannot_touch_is_no_finger_beside_others(tmp_path):
    """As TIAGo's motors, dots on their axes, and bare links of the PR2's gripper."""
    body = link("palm") + two_fingers("palm", "")
    body += link("spool", BALL.replace("0.01", "0.001")) + joint("c_motor", "palm", "spool")
    body += link("bare") + joint("c_slide", "palm", "bare", "prismatic")
    file = write_urdf(tmp_path, body)
    hand = Hand.from_urdf(file)
    assert list(hand.fingers) == ["a", "b"]
    assert {"c_motor", "c_slide"} < set(hand.actuated_joint_names)
    (listed,) = list_robots([str(file)])
    assert list(listed.fingers) == ["a", "b"]


def test_fingers_whose_names_say_nothing_are_numbered_under_the_mounts_prefix(tmp_path):
    body = links("palm", "a", "b") + joint("j_1", "palm", "a") + joint("j_2", "palm", "b")
    file = write_urdf(tmp_path, body)
    pose = np.eye(4)
    hand = Hand.assemble([Mount(file, pose, "l_"), Mount(file, pose, "r_")])
    assert list(hand.fingers) == ["l_finger_1", "l_finger_2", "r_finger_1", "r_finger_2"]
    assert hand.fingers["r_finger_2"].joints == ("r_j_2",)
    assert Hand.from_urdf(file, control={"finger_1": "position"}).actuated_joint_names == ("j_2",)


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_floating_base_is_fixed_where_the_robot_is_mounted(tmp_path, kind):
    body = link("world") + joint("root", "world", "palm", kind, limit="") + link("palm")
    T = np.eye(4)
    T[:3, 3] = [1.0, 2.0, 3.0]
    hand = Hand.from_urdf(write_urdf(tmp_path, body + two_fingers("palm", "")), T_world_base=T)
    assert "root" not in hand.joint_names
    assert hand.palms == ("palm",)
    np.testing.assert_allclose(hand.pose_of("palm")[:3, 3], [1.1, 2.02, 3.0], atol=1e-12)


def test_modes_and_limits_of_fingers_on_one_motor():
    hand = Hand.assemble([Mount("panda_hand")], control={"right": "position"})
    assert hand.actuated_joint_names == ()
    limited = Hand.assemble([Mount("panda_hand")], effort_limits={"right": (-60.0, 0.0)})
    np.testing.assert_array_equal(limited.effort_limits, [[-60.0], [0.0]])
    for control, message in [
        ({"left": "force", "right": "position"}, "moves this finger and 'left'; give both"),
        ({"right": "hybrid"}, "moves the fingers left, right; a hybrid finger needs joints"),
        ({"arm": "force"}, "unknown finger or joint 'arm'"),
    ]:
        with pytest.raises(ArgumentError, match=message):
            Hand.assemble([Mount("panda_hand")], control=control)
    with pytest.raises(ArgumentError, match=r"control\['arm'\]: hybrid control is per finger"):
        Hand.assemble([Mount("panda")], control={"arm": "hybrid"})


def bar(name, length, aside=0.0):
    """A link whose shape goes along z, from its joint or beside it."""
    return (
        f'<link name="{name}"><collision><origin xyz="{aside} 0 {0.5 * length}"/><geometry>'
        f'<box size="0.01 0.02 {abs(length)}"/></geometry></collision></link>'
    )


def hinge(name, parent, child, place, ends="-0.1 1.5"):
    lower, upper = ends.split()
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="0 1 0"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="2" velocity="1"/></joint>'
    )


# An arm of one joint whose last link ends in a jaw 8 cm long, and a jaw that closes on it.
JAWS = (
    bar("base", 0.05) + hinge("wrist", "base", "gripper", "0 0 0.05", "-1 1")
    + bar("gripper", 0.12, -0.01) + hinge("jaw_hinge", "gripper", "jaw", "0.01 0 0.04")
    + bar("jaw", 0.08)
)  # fmt: skip


def test_a_jaw_that_closes_on_a_fixed_one_is_a_finger(tmp_path):
    hand = Hand.from_urdf(write_urdf(tmp_path, JAWS))
    assert hand.palms == ("gripper",)
    assert [spec.joints for spec in hand.fingers.values()] == [("jaw_hinge",)]
    assert dict(hand.arms) == {"arm": ("wrist",)}
    assert hand.actuated_joint_names == ("jaw_hinge",)


@pytest.mark.parametrize(
    "body",
    [
        # An arm that folds onto its upper arm.
        bar("base", 0.05) + hinge("shoulder", "base", "upper", "0 0 0.05", "-1 1")
        + bar("upper", 0.1, -0.01) + hinge("elbow", "upper", "lower", "0.01 0 0.1", "0 3")
        + bar("lower", 0.08),
        # A wrist that turns about its own axis.
        JAWS.replace('"0 1 0"/><limit lower="-0.1"', '"0 0 1"/><limit lower="0"'),
        # A link that is beside the one before all the time, and one that never comes near it.
        JAWS.replace('lower="-0.1" upper="1.5"', 'lower="-0.1" upper="0.2"'),
        JAWS.replace('lower="-0.1" upper="1.5"', 'lower="1.2" upper="1.9"'),
    ],
)  # fmt: skip
def test_a_chain_that_ends_in_no_jaw_has_no_palm(tmp_path, body):
    hand = Hand.from_urdf(write_urdf(tmp_path, body))
    assert not hand.palms and not hand.fingers
