"""Every robot of the package: it loads, poses, and its Jacobians are right."""

import functools
import pickle
import warnings

import coal  # pyright: ignore[reportMissingImports]
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
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.mounts import Mount
from graspless_pin.geometry.poses import invert
from graspless_pin.geometry.robots.files import find_robot, load_robot, robot_names

LEVERS = {"lever_100mm", "lever_100mm_mirrored", "lever_150mm"}
NO_SOURCE = {
    "alex_psyonic_hands",
    "bravo7_gripper",
    "bravo7_jaws",
    "psyonic_left",
    "psyonic_right",
    "talos_gripper",
    "tiago_pro_gripper",
}
FINGERS = {
    "alex_psyonic_hands": 10,
    "allegro_left": 4,
    "allegro_right": 4,
    "bravo7_gripper": 2,
    "bravo7_jaws": 2,
    "dex3_left": 3,
    "dex3_right": 3,
    "g1_with_hands": 6,
    "panda": 2,
    "panda_hand": 2,
    "psyonic_left": 5,
    "psyonic_right": 5,
    "talos_gripper": 2,
    "tiago_pro_gripper": 2,
    "trihand": 3,
}
ACTUATORS = {
    "alex_psyonic_hands": 12,
    "allegro_left": 16,
    "allegro_right": 16,
    "bravo7_gripper": 2,
    "bravo7_jaws": 2,
    "dex3_left": 7,
    "dex3_right": 7,
    "g1_with_hands": 14,
    "panda": 1,
    "panda_hand": 1,
    "psyonic_left": 6,
    "psyonic_right": 6,
    "talos_gripper": 1,
    "tiago_pro_gripper": 1,
    "trihand": 9,
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
    assert set(robot_names()) == set(FINGERS) | LEVERS


@pytest.mark.parametrize("name", sorted(FINGERS))
def test_fingers_actuators_and_sources(name):
    robot, hand = load_robot(name), unposed(name)
    assert robot.name == name
    assert set(robot.effort_sources) == set(robot.effort_limits)
    assert len(hand.fingers) == FINGERS[name]
    assert len(hand.actuated_joint_names) == ACTUATORS[name]
    shaped = {body.name for body in hand.collision_bodies()}
    for spec in hand.fingers.values():
        assert spec.tip in spec.links
        assert spec.tip in shaped
    assert loaded(name)[1] == [GrasplessPinWarning] * (name in NO_SOURCE)
    assert bool(robot.effort_unknown) == (name in NO_SOURCE)
    lower, upper = hand.effort_limits
    assert np.all((lower < 0) & (upper > 0) & np.isfinite(upper))


@pytest.mark.parametrize("control", [None, "force"])
@pytest.mark.parametrize("name", sorted(FINGERS))
def test_jacobians_match_finite_differences_and_rnea(name, control):
    rng = np.random.default_rng(7)
    hand = posed(name, 8, control)
    links, points = sample_contacts(hand, rng)
    J = hand.contact_jacobian(links, points)
    expected = difference_jacobian(hand, hand.actuated_joint_names, links, points)
    np.testing.assert_allclose(J, expected, atol=1e-6)
    with_fixed = hand.contact_jacobian([*links, None], [*points, points[0]])
    np.testing.assert_array_equal(with_fixed, np.vstack([J, np.zeros((3, J.shape[1]))]))
    forces = rng.uniform(-20, 20, (len(links), 3))
    tau = hand.tree.coupling.S.T @ rnea(hand, links, points, forces, GRAVITY)
    leaders = [hand.joint_names[index] for index in hand.tree.coupling.leaders]
    columns = [leaders.index(joint) for joint in hand.actuated_joint_names]
    torques = J.T @ forces.ravel() + hand.gravity_torques(GRAVITY)
    np.testing.assert_allclose(torques, tau[columns], atol=1e-8)
    if control == "force":
        assert len(columns) == len(leaders)


@pytest.mark.parametrize("name", ["allegro_right", "psyonic_right", "tiago_pro_gripper", "trihand"])
def test_the_rate_of_a_gap_is_the_normal_times_the_jacobian(name):
    rng = np.random.default_rng(9)
    hand = posed(name, 10)
    ball = coal.Sphere(0.02)
    request = coal.DistanceRequest()
    request.gjk_tolerance = 1e-12
    request.enable_signed_distance = True
    step = 1e-5
    for finger, spec in hand.fingers.items():
        tip = str(spec.tip)
        index = [body.name for body in hand.collision_bodies()].index(tip)
        center = hand.collision_bodies()[index].T_world_geometry[:3, 3]
        away = rng.normal(size=3)
        T_ball = coal.Transform3s(np.eye(3), center + 0.09 * away / np.linalg.norm(away))

        def gap(at, index=index, T_ball=T_ball):
            body, result = at.collision_bodies()[index], coal.DistanceResult()
            T = body.T_world_geometry
            T_link = coal.Transform3s(T[:3, :3], T[:3, 3])
            coal.distance(body.geometry, T_link, ball, T_ball, request, result)
            return result.min_distance, np.array(result.getNearestPoint1()), T_ball

        distance, point, _ = gap(hand)
        assert 0.0 < distance < 0.09, finger
        normal = (T_ball.getTranslation() - point) / np.linalg.norm(T_ball.getTranslation() - point)
        rates = [
            (
                gap(hand.with_configuration({joint: hand.q[joint] + step}))[0]
                - gap(hand.with_configuration({joint: hand.q[joint] - step}))[0]
            )
            / (2 * step)
            for joint in hand.actuated_joint_names
        ]
        J = hand.contact_jacobian([tip], [point])
        np.testing.assert_allclose(rates, -normal @ J, atol=1e-6)
        assert np.abs(rates).max() > 1e-3


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
            hand.link_pose(link), other.get_transform(link, other.base_link), atol=1e-9
        )


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
    T = robot.link_pose(root) @ invert(hand.link_pose(root))
    assert set(hand.joint_names) < set(robot.joint_names)
    for link in hand.link_names:
        np.testing.assert_allclose(T @ hand.link_pose(link), robot.link_pose(link), atol=1e-9)
    kept = [joint in hand.actuated_joint_names for joint in robot.actuated_joint_names]
    np.testing.assert_array_equal(hand.effort_limits[1], robot.effort_limits[1][kept])


@pytest.mark.parametrize("name", ["allegro_right", "panda_hand", "psyonic_right", "trihand"])
def test_a_pickled_hand_is_the_same_hand(name):
    hand = posed(name, 13)
    links, points = sample_contacts(hand, np.random.default_rng(14))
    J = hand.contact_jacobian(links, points)
    copy = pickle.loads(pickle.dumps(hand))  # noqa: S301 - our own bytes
    np.testing.assert_array_equal(copy.contact_jacobian(links, points), J)
    assert copy.fingers == hand.fingers
    assert copy.control == hand.control
    for ours, theirs in zip(hand.collision_bodies(), copy.collision_bodies(), strict=True):
        assert ours.name == theirs.name
        assert ours.geometry == theirs.geometry
        np.testing.assert_array_equal(ours.T_world_geometry, theirs.T_world_geometry)
        assert not theirs.T_world_geometry.flags.writeable
    for array in (copy.positions, *copy.effort_limits, copy.T_world_base, copy.tree.lower):
        assert not array.flags.writeable
    with pytest.raises(TypeError):
        copy.fingers["x"] = None


def test_the_three_finger_hand_is_symmetric_and_flexes_inwards():
    hand = Hand.assemble([Mount("trihand")])
    mass = sum(inertia.mass for inertia in hand.tree.pinocchio_model.inertias.tolist()[1:]) + 0.3
    assert 0.5 < mass < 0.7
    bent = hand.with_configuration(
        {f"finger_{k}_{joint}": 0.5 for k in (1, 2, 3) for joint in ("proximal", "distal")}
    )
    radii = []
    for number in (1, 2, 3):
        straight = hand.link_pose(f"finger_{number}_tip")[:3, 3]
        tip = bent.link_pose(f"finger_{number}_tip")[:3, 3]
        angle = 2 * np.pi * (number - 1) / 3
        np.testing.assert_allclose(
            straight, [0.038 * np.cos(angle), 0.038 * np.sin(angle), 0.128], atol=1e-8
        )
        radii.append(tip[:2] @ [np.cos(angle), np.sin(angle)])
    expected = 0.038 - 0.055 * np.sin(0.5) - 0.036 * np.sin(1.0)
    np.testing.assert_allclose(radii, expected, atol=1e-8)


def test_fingers_of_a_gripper_share_one_motor():
    hand = Hand.assemble([Mount("panda_hand")], q={"panda_finger_joint1": 0.02})
    links = ["panda_leftfinger", "panda_rightfinger"]
    J = hand.contact_jacobian(links, [hand.link_pose(name)[:3, 3] for name in links])
    normals = [hand.link_pose("panda_hand")[:3, 1] * side for side in (-1.0, 1.0)]
    grip = 70.0 * np.concatenate(normals)  # both fingers press inwards with 70 N
    np.testing.assert_allclose(J.T @ grip, [-140.0], atol=1e-9)
    np.testing.assert_array_equal(hand.effort_limits, [[-140.0], [140.0]])
