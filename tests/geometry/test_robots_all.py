"""Every robot of the package: it loads, poses, and its Jacobians are right."""

import functools
import warnings

import numpy as np
import pytest
import yourdfpy
from hand_tools import (
    GRAVITY,
    difference_jacobian,
    random_pose,
    random_q,
    rnea,
    sample_contacts,
)

from graspless_pin.errors import GrasplessPinWarning
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import invert
from graspless_pin.geometry.robots.files import find_robot, load_robot, robot_names

LEVERS = {"lever_100mm", "lever_100mm_mirrored", "lever_150mm"}
ROBOTS = {  # fingers, actuators, whether the robot's efforts have a source
    "alex_psyonic_hands": (10, 12, False),
    "allegro_left": (4, 16, True),
    "allegro_right": (4, 16, True),
    "bravo7_gripper": (2, 2, False),
    "bravo7_jaws": (2, 2, False),
    "dex3_left": (3, 7, True),
    "dex3_right": (3, 7, True),
    "g1_with_hands": (6, 14, True),
    "panda": (2, 1, True),
    "panda_hand": (2, 1, True),
    "psyonic_left": (5, 6, False),
    "psyonic_right": (5, 6, False),
    "talos_gripper": (2, 1, False),
    "tiago_pro_gripper": (2, 1, False),
    "trihand": (3, 9, True),
}


@functools.cache
def loaded(name, control=None):
    """The hand at a random mount, and the warnings it gave."""
    pose = random_pose(np.random.default_rng(len(name)))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        hand = Hand.assemble([Mount(name, pose)], control=control)
    return hand, [item.category for item in caught]


def unposed(name, control=None):
    return loaded(name, control)[0]


def posed(name, seed, control=None):
    hand = unposed(name, control)
    return hand.with_configuration(random_q(hand, np.random.default_rng(seed)))


def test_every_robot_file_is_listed_here():
    assert set(robot_names()) == set(ROBOTS) | LEVERS


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", ROBOTS)
def test_fingers_actuators_and_sources(name):
    robot, hand = load_robot(name), unposed(name)
    fingers, actuators, sourced = ROBOTS[name]
    assert robot.name == name
    assert set(robot.effort_sources) == set(robot.effort_limits)
    assert (len(hand.fingers), len(hand.actuated_joint_names)) == (fingers, actuators)
    shaped = {body.name for body in hand.collision_bodies()}
    for spec in hand.fingers.values():
        assert spec.tip in spec.links
        assert spec.tip in shaped
    assert loaded(name)[1] == [GrasplessPinWarning] * (not sourced)
    assert bool(robot.effort_unknown) == (not sourced)
    lower, upper = hand.effort_limits
    assert np.all((lower < 0) & (upper > 0) & np.isfinite(upper))


@pytest.mark.sampled(4)
@pytest.mark.parametrize("control", [None, "force"])
@pytest.mark.parametrize("name", ROBOTS)
def test_jacobians_match_finite_differences_and_rnea(name, control):
    rng = np.random.default_rng(7)
    hand = posed(name, 8, control)
    links, points = sample_contacts(hand, rng)
    J = hand.contact_jacobian(links, points)
    expected = difference_jacobian(hand, hand.actuated_joint_names, links, points)
    np.testing.assert_allclose(J, expected, atol=1e-8)
    with_fixed = hand.contact_jacobian([*links, None], [*points, points[0]])
    np.testing.assert_array_equal(with_fixed, np.vstack([J, np.zeros((3, J.shape[1]))]))
    forces = rng.uniform(-20, 20, (len(links), 3))
    tau = hand.tree.coupling.S.T @ rnea(hand, links, points, forces, GRAVITY)
    leaders = [hand.joint_names[index] for index in hand.tree.coupling.leaders]
    columns = [leaders.index(joint) for joint in hand.actuated_joint_names]
    torques = J.T @ forces.ravel() + hand.gravity_torques(GRAVITY)
    np.testing.assert_allclose(torques, tau[columns], atol=1e-10)
    if control == "force":
        assert len(columns) == len(leaders)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("model", ["panda", "talos_full", "allegro_left_hand", "bravo7_gripper"])
def test_link_poses_and_mimic_joints_agree_with_yourdfpy(model):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrasplessPinWarning)
        hand = Hand.from_model_name(model)
    hand = hand.with_configuration(random_q(hand, np.random.default_rng(11)))
    other = yourdfpy.URDF.load(
        str(find_robot(model).urdf_path),
        load_meshes=False,
        load_collision_meshes=False,
        build_collision_scene_graph=False,
    )
    other.update_cfg({name: hand.q[name] for name in other.actuated_joint_names})
    assert sorted(other.actuated_joint_names) == sorted(
        hand.joint_names[index] for index in hand.tree.coupling.leaders
    )
    for link in hand.link_names:
        np.testing.assert_allclose(
            hand.pose_of(link), other.get_transform(link, other.base_link), atol=1e-9
        )


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("part", "whole"),
    [
        ("panda_hand", "panda"),
        ("bravo7_jaws", "bravo7_gripper"),
        ("dex3_right", "g1_with_hands"),
        ("psyonic_left", "alex_psyonic_hands"),
    ],
)
def test_a_hand_alone_is_the_hand_of_the_whole_robot(part, whole):
    hand, robot = unposed(part), posed(whole, 12)
    hand = hand.with_configuration({name: robot.q[name] for name in hand.joint_names})
    root = hand.link_names[0]
    T = robot.pose_of(root) @ invert(hand.pose_of(root))
    assert set(hand.joint_names) < set(robot.joint_names)
    for link in hand.link_names:
        np.testing.assert_allclose(T @ hand.pose_of(link), robot.pose_of(link), atol=1e-9)
    kept = [joint in hand.actuated_joint_names for joint in robot.actuated_joint_names]
    np.testing.assert_array_equal(hand.effort_limits[1], robot.effort_limits[1][kept])


def test_the_three_finger_hand_is_symmetric_and_flexes_inwards():
    hand = Hand.assemble([Mount("trihand")])
    mass = sum(inertia.mass for inertia in hand.tree.pinocchio_model.inertias.tolist()[1:]) + 0.3
    assert 0.5 < mass < 0.7
    bent = hand.with_configuration(
        {f"finger_{k}_{joint}": 0.5 for k in (1, 2, 3) for joint in ("proximal", "distal")}
    )
    radii = []
    for number in (1, 2, 3):
        straight = hand.pose_of(f"finger_{number}_tip")[:3, 3]
        tip = bent.pose_of(f"finger_{number}_tip")[:3, 3]
        angle = 2 * np.pi * (number - 1) / 3
        np.testing.assert_allclose(
            straight, [0.038 * np.cos(angle), 0.038 * np.sin(angle), 0.128], atol=1e-8
        )
        radii.append(tip[:2] @ [np.cos(angle), np.sin(angle)])
    expected = 0.038 - 0.055 * np.sin(0.5) - 0.036 * np.sin(1.0)
    np.testing.assert_allclose(radii, expected, atol=1e-8)
