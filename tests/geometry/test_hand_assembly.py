"""Several robots as one hand."""

import numpy as np
import pytest
from hand_tools import difference_jacobian, random_pose

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.robots.description import FingerSpec


def test_two_levers_together_equal_two_alone():
    rng = np.random.default_rng(0)
    poses = [random_pose(rng), random_pose(rng)]
    both = Hand.assemble(
        [Mount("lever_150mm", poses[0], "l_"), Mount("lever_100mm", poses[1], "r_")],
        q={"l_hinge": 0.4, "r_hinge": -0.7},
    )
    points = rng.uniform(-1, 1, (2, 3))
    J = both.contact_jacobian(["l_tip", "r_lever"], points)
    assert both.joint_names == ("l_hinge", "r_hinge")
    for row, (source, angle, name, prefix) in enumerate(
        [("lever_150mm", 0.4, "tip", "l_"), ("lever_100mm", -0.7, "lever", "r_")]
    ):
        alone = Hand.assemble([Mount(source, poses[row])], q={"hinge": angle})
        rows = slice(3 * row, 3 * row + 3)
        np.testing.assert_allclose(
            J[rows, [row]], alone.contact_jacobian([name], points[[row]]), atol=1e-12
        )
        assert not J[rows, 1 - row].any()
        np.testing.assert_allclose(both.pose_of(prefix + name), alone.pose_of(name), atol=1e-12)
        np.testing.assert_array_equal(both.base_poses[prefix], poses[row])
    np.testing.assert_allclose(
        J, difference_jacobian(both, both.joint_names, ["l_tip", "r_lever"], points), atol=1e-8
    )
    assert both.finger_of("l_tip") == "l_finger"
    assert both.finger_of("r_base") is None


def test_bases_move_as_one_rigid_body():
    hand = Hand.assemble(
        [Mount("lever_100mm", random_pose(np.random.default_rng(s)), f"{s}_") for s in (2, 3)]
    )
    twist = np.array([0.1, -0.2, 0.3, 1.0, -0.5, 0.25])
    origins = np.array([pose[:3, 3] for pose in hand.base_poses.values()])
    velocities = hand.point_velocities(["2_base", "3_base"], origins, base_twist=twist)
    np.testing.assert_allclose(velocities[0], twist[:3], atol=1e-12)
    np.testing.assert_allclose(
        velocities[1] - velocities[0], np.cross(twist[3:], origins[1] - origins[0]), atol=1e-12
    )


def test_fingers_given_by_joints_take_the_links_they_move():
    hand = Hand.assemble(
        [Mount("allegro_right_hand", fingers={"thumb": FingerSpec(("joint_13.0", "joint_14.0"))})]
    )
    assert hand.fingers["thumb"].links == ("link_13.0", "link_14.0", "link_15.0", "link_15.0_tip")
    assert hand.finger_of("link_12.0") is None


def test_bad_mounts():
    with pytest.raises(ArgumentError, match=r"mounts: .*at least one"):
        Hand.assemble([])
    with pytest.raises(ArgumentError, match="T_world_base: "):
        Hand.assemble([Mount("lever_100mm", np.zeros((4, 4)))])
