"""Gaps that a hand has to close before it is loaded, and runs that begin off the rest."""

from pathlib import Path

import numpy as np
import pytest
from tests.scene.scene_tools import EXAMPLES

from graspless_pin import Controller, Scene, load_scene, maximize_margin
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.posing.finger_joints import hand_with_moved_actuators
from graspless_pin.simulation import simulate
from graspless_pin.simulation.model import SOFT, STIFF, simulation_model

BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"
GAP = 5e-4


def off(scene: Scene, way: np.ndarray) -> Scene:
    """The scene with its object moved by (3,) m, contacts found with that much tolerance."""
    T = np.array(scene.object.T_world_object)
    T[:3, 3] += way
    return scene.with_changes(object=scene.object.with_pose(T))


def test_gaps_are_closed_by_joints_where_they_can() -> None:
    aside = off(load_scene(BALL), 0.2 * np.array([0.2 * GAP, GAP, 0.2 * GAP]))
    assert max(abs(point.distance) for point in aside.contacts.points) > 5e-5
    model = simulation_model(aside, aside.solve("margin").torques)
    moved = model.object.T_world_object - aside.object.T_world_object
    # The object leaves or enters the slope; the fingers follow it everywhere else.
    assert 1e-5 < np.linalg.norm(moved[:3, 3]) < 5e-5
    assert aside.hand is not None
    change = dict(zip(model.joints, model.closing, strict=True))
    turned = np.array([change.get(name, 0.0) for name in aside.problem().joint_names])
    closed = aside.with_changes(
        object=model.object, hand=hand_with_moved_actuators(aside.hand, turned)
    )
    assert max(abs(point.distance) for point in closed.contacts.points) < 5e-6


def test_a_gripper_does_not_shift_what_it_closes_on() -> None:
    """With all gaps on one side the object would go there as the fingers close."""
    scene = load_scene(BALL)
    torques = scene.solve("margin").torques
    held = off(scene, np.array([0.0, 0.5 * GAP, 0.0])).with_changes(controller=Controller(2.0))
    for run in simulate(held, torques, seconds=0.5).runs[:1]:
        assert run.outcome == "held" and run.displacement < 2e-4


def test_a_finger_that_friction_holds_touches_before_it_is_loaded() -> None:
    """Free, its tip would go off under these torques; contacts have gaps of some micrometres."""
    scene = load_scene(Path(__file__).with_name("grips") / "trihand_capsule_4.yaml")
    torques = np.array(
        [-0.00053, -0.00975, -0.06798, -0.02907, 0.6, 0.25097, 0.05616, 0.6, 0.25305]
    )
    problem, contacts = scene.problem(), scene.contacts.arrays
    own = np.array(problem.jacobian)[:3, :3]
    efforts = (torques - problem.gravity_torques)[:3]
    pressed = float(contacts.normals[0] @ np.linalg.solve(own.T, efforts))
    assert contacts.normals[0] @ own @ efforts < 0.0 < pressed
    (run,) = simulate(scene, torques, controller=0.0, contact_models=[STIFF]).runs
    assert run.outcome == "held"
    assert run.normal_forces[contacts.bodies[0]] == pytest.approx(pressed, rel=0.02)


def test_a_tip_deep_in_the_object_touches_when_it_is_out() -> None:
    """It goes 0.4 mm along a curve: 26 um beside the straight way, and off under its torques."""
    scene = load_scene(Path(__file__).with_name("grips") / "trihand_box_on_wall.yaml")
    (deep, *_) = scene.contacts.points
    assert deep.body == "finger_1_tip" and deep.distance < -4e-4
    torques = scene.solve("margin").torques
    (run,) = simulate(scene, torques, contact_models=[STIFF], seconds=0.5).runs
    assert run.outcome == "held"
    pressed = maximize_margin(scene.problem()).contact_forces[0] @ deep.normal
    assert run.normal_forces["finger_1_tip"] == pytest.approx(pressed, rel=0.05)


def test_a_run_begins_where_it_is_asked_to() -> None:
    scene = load_scene(BALL)
    torques = scene.solve("margin").torques
    small = scene.stability(torques).small_motions
    assert small is not None and small.motion is not None
    start = 1e-3 * small.motion
    (run,) = simulate(scene, torques, displacement=start, seconds=0.3, contact_models=[STIFF]).runs
    center = run.T_world_object[:, :3, 3] - scene.object.T_world_object[:3, 3]
    np.testing.assert_allclose(center[0], start[:3], atol=5e-5)
    turned = run.T_world_object[0, :3, :3] @ scene.object.T_world_object[:3, :3].T
    np.testing.assert_allclose([turned[2, 1], turned[0, 2], turned[1, 0]], start[3:6], atol=3e-4)
    # From rest a motion that nothing damps goes as the hyperbolic cosine.
    gone = np.linalg.norm(center, axis=1) / np.linalg.norm(center[0])
    grown = (gone > 3.0) & (gone < 20.0)
    rate = np.polyfit(run.times[grown], np.log(gone[grown]), 1)[0]
    assert rate == pytest.approx(small.growth, rel=0.15)


def test_bad_starts_are_refused() -> None:
    scene = load_scene(BALL)
    torques = scene.solve("margin").torques
    with pytest.raises(ArgumentError, match="displacement: has shape"):
        simulate(scene, torques, displacement=[0.0, 1.0])
    with pytest.raises(ArgumentError, match="contact_models: is empty"):
        simulate(scene, torques, contact_models=[])
    assert [run.contact_model for run in simulate(
        scene, torques, seconds=0.05, contact_models=[SOFT]).runs] == [SOFT]  # fmt: skip
