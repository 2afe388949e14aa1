"""Motions in pictures: the object's and the links' ways against rigid-body kinematics."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from graspless_pin import Stability, load_scene
from graspless_pin.geometry.posing.finger_joints import hand_with_moved_actuators
from graspless_pin.holding.verdict import ContactState, DynamicOutcome
from graspless_pin.visualization import Role, draw_scene
from graspless_pin.visualization.drawing import object_radius
from graspless_pin.visualization.motion import MovingPicture, draw_motion, draw_small_motion

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def picture_of(name: str, motion: DynamicOutcome) -> MovingPicture:
    scene = load_scene(EXAMPLES / name)
    return draw_motion(scene.problem(), motion, scene=scene)


def outcome(joints: list[float], acceleration: list[float], size: float) -> DynamicOutcome:
    states = [ContactState.STICKING, ContactState.SLIPPING] + [ContactState.OPEN] * 8
    forces = np.zeros((10, 3))
    forces[:2] = (-2.0, 0.0, 1.0), (2.0, 0.0, 1.0)
    return DynamicOutcome(np.array(acceleration), np.array(joints), forces, tuple(states), size)


def test_the_object_goes_along_its_acceleration_and_turns_about_its_centre():
    motion = outcome([0.0, 0.0], [0.5, 0.0, -3.0, 0.0, 7.0, 0.0], 3.2)
    moving = picture_of("box_between_walls.yaml", motion)
    path, end = moving.paths[moving.path_of["object/box"]], moving.times[-1]
    np.testing.assert_array_equal(path[0], np.eye(4))
    np.testing.assert_allclose(path[-1] @ [0, 0, 0, 1], [0.25 * end**2, 0, -1.5 * end**2, 1])
    turn = Rotation.from_rotvec([0.0, 3.5 * end**2, 0.0]).as_matrix()
    np.testing.assert_allclose(path[-1][:3, :3], turn, atol=1e-12)
    way = 0.5 * motion.point_acceleration * end**2
    assert way == pytest.approx(0.6 * object_radius(moving.picture))
    still = [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    first, second = (
        picture_of("box_between_walls.yaml", outcome([0.0, joint], still, 1.0)).times[-1]
        for joint in (0.0, -300.0)
    )
    assert second < 0.5 * first
    assert 0.5 * 300.0 * second**2 == pytest.approx(0.6)


def test_links_go_where_forward_kinematics_has_them():
    motion = outcome([-40.0, 30.0], [0.0, 0.0, -1.0, 0.0, 0.0, 0.0], 1.0)
    scene = load_scene(EXAMPLES / "box_between_walls.yaml")
    moving = draw_motion(scene.problem(), motion, scene=scene)
    assert scene.hand is not None
    bent = hand_with_moved_actuators(
        scene.hand, 0.5 * moving.times[-1] ** 2 * motion.joint_accelerations
    )
    for link in ("right/tip", "left/tip"):
        (mesh,) = (m for m in moving.picture.of(Role.HAND) if m.name.split("/", 2)[2] == link)
        there = moving.paths[moving.path_of[mesh.name]][-1] @ scene.hand.pose_of(link)
        np.testing.assert_allclose(there, bent.pose_of(link), atol=1e-12)
        assert np.abs(there - scene.hand.pose_of(link)).max() > 0.01
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(there, scene.hand.pose_of(link), atol=1e-3)


def test_contacts_are_drawn_by_what_they_do():
    moving = picture_of(
        "box_between_walls.yaml", outcome([0.0, 0.0], [0.0, 0.0, -1.0, 0.0, 0.0, 0.0], 1.0)
    )
    roles = {mesh.contact: mesh.role for mesh in moving.picture.of(
        Role.OPEN_CONTACT, Role.STICKING_CONTACT, Role.SLIPPING_CONTACT)}  # fmt: skip
    assert [roles[index] for index in range(10)] == (
        [Role.STICKING_CONTACT, Role.SLIPPING_CONTACT] + [Role.OPEN_CONTACT] * 8
    )
    assert not moving.picture.of(Role.CONTACT)
    assert [m.contact for m in moving.picture.of(Role.NORMAL_FORCE)] == [0, 1]
    assert [m.contact for m in moving.picture.of(Role.FRICTION_FORCE)] == [0]
    assert [m.contact for m in moving.picture.of(Role.FRICTION_AT_LIMIT)] == [1]


def test_the_box_between_two_walls_slips_down():
    scene = load_scene(EXAMPLES / "box_between_walls.yaml")
    verdict = scene.stability(scene.solve().torques)
    assert verdict.status is Stability.WEAK
    assert str(verdict).startswith("may fail: the object can slip down, ")
    assert scene.stability(scene.solve("margin").torques).status is Stability.STRONG


def test_a_small_motion_grows_to_its_end():
    """Of a thirtieth at first, along the stated motion, hand and object together."""
    scene = load_scene(EXAMPLES / "allegro_sphere_on_slope.yaml")
    solution = scene.solve()
    small = scene.stability(solution.torques).small_motions
    assert small is not None and small.motion is not None and scene.hand is not None
    center = scene.object.center_of_mass_world
    picture = draw_scene(scene, solution)
    moving = draw_small_motion(
        picture, scene.problem(), small.motion, small.growth, scene.hand, center
    )
    assert moving.times[-1] == pytest.approx(np.log(30.0) / small.growth)
    path = moving.paths[moving.path_of["object/ball"]]
    turns = Rotation.from_matrix(path[:, :3, :3]).as_rotvec()
    grown = np.expm1(small.growth * moving.times)
    whole = turns[-1, np.argmax(np.abs(turns[-1]))] / small.motion[3 + np.argmax(np.abs(turns[-1]))]
    np.testing.assert_allclose(
        turns, np.outer(whole * grown / grown[-1], small.motion[3:6]), atol=1e-9
    )
    bent = hand_with_moved_actuators(scene.hand, whole * small.motion[6:])
    link = scene.contacts.bodies[0]
    (mesh, *_) = (m for m in moving.picture.of(Role.HAND) if m.name.split("/", 2)[2] == link)
    there = moving.paths[moving.path_of[mesh.name]][-1] @ scene.hand.pose_of(link)
    np.testing.assert_allclose(there, bent.pose_of(link), atol=1e-9)
