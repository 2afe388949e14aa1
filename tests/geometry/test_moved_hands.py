"""Hands mounted elsewhere, and where their links are."""

from dataclasses import replace

import numpy as np
import pytest
from hand_tools import random_pose

from graspless_pin import Hand, load_scene
from graspless_pin.errors import ArgumentError


@pytest.mark.parametrize("name", ["allegro_box_on_slope", "two_hands_slide_crate"])
def test_a_hand_mounted_elsewhere_is_one_assembled_there(name):
    hand = load_scene(f"examples/{name}.yaml").hand
    assert hand is not None
    rng = np.random.default_rng(3)
    T = random_pose(rng)
    first, *others = hand.base_poses
    way = T @ np.linalg.inv(hand.T_world_base)
    together = {prefix: way @ pose for prefix, pose in hand.base_poses.items()}
    for moved, poses in (
        (hand.with_base_at(T), together),
        (hand.with_base_at({first: T}), {**hand.base_poses, first: T}),
    ):
        mounts = [replace(one, T_world_base=poses[one.prefix]) for one in hand.mounts]
        q = {joint: hand.q[joint] for joint in hand.control.joints}
        anew = Hand.assemble(mounts, q=q)
        for link in hand.link_names:
            np.testing.assert_allclose(moved.pose_of(link), anew.pose_of(link), atol=1e-12)
        np.testing.assert_allclose(
            moved.gravity_torques((0, 0, -9.81)), anew.gravity_torques((0, 0, -9.81)), atol=1e-12
        )
    for prefix in (first, *others):
        np.testing.assert_allclose(hand.with_base_at(T).base_poses[prefix], together[prefix])


def test_poses_of_links_at_other_configurations():
    hand = load_scene("examples/trihand_pivot_box.yaml").hand
    assert hand is not None
    q = np.array([hand.q[joint] for joint in hand.control.joints]) + 0.01
    named = dict(zip(hand.control.joints, q.tolist(), strict=True))
    bent = hand.with_configuration(named)
    for link in hand.link_names:
        np.testing.assert_array_equal(hand.pose_of(link, q), bent.pose_of(link))
        np.testing.assert_array_equal(hand.pose_of(link, named), bent.pose_of(link))
    assert np.abs(bent.pose_of("finger_1_tip") - hand.pose_of("finger_1_tip")).max() > 1e-3


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda hand: hand.pose_of("finger_1_tipp"), "link: unknown .* mean 'finger_1_tip'"),
        (lambda hand: hand.pose_of("palm", {"finger_1": 0.0}), "q: unknown joint 'finger_1'"),
        (lambda hand: hand.pose_of("palm", [0.0]), r"q: needs shape \(9,\)"),
        (lambda hand: hand.with_base_at(np.ones((4, 4))), "T_world_base"),
        (lambda hand: hand.with_base_at({"left/": np.eye(4)}), "unknown mount 'left/'"),
    ],
)
def test_what_is_no_link_configuration_or_base_is_named(ask, message):
    with pytest.raises(ArgumentError, match=message):
        ask(load_scene("examples/trihand_pivot_box.yaml").hand)
