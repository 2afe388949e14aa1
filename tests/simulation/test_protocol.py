"""What the protocol says of scenes whose outcome is known: held or moved, and with which forces."""

import sys

import numpy as np
import pytest
from holding_scenes import holding_scenes
from scipy.spatial.transform import Rotation
from tests.scene.scene_tools import EXAMPLES, PAPER

from graspless_pin import load_scene
from graspless_pin.errors import ArgumentError, GrasplessPinError
from graspless_pin.geometry import Box, HalfSpace, ManipulatedObject, Support
from graspless_pin.geometry.poses import pose_matrix, turned_about
from graspless_pin.scene import Scene
from graspless_pin.simulation import SimulatedOutcome, simulate
from graspless_pin.simulation.protocol import change_of_pose

BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"
TILT = 0.35


def block(friction: float) -> Scene:
    """A block of 1 kg on a slope, and no hand."""
    T = pose_matrix((0.0, 0.0, 0.0), (0.0, TILT, 0.0))
    shape = Box((0.1, 0.08, 0.06))
    body = ManipulatedObject.from_shape("block", shape, T @ pose_matrix((0, 0, 0.03)), mass=1.0)
    return Scene("block", body, {"default": friction}, supports=(Support("slope", HalfSpace(), T),))


def outcomes(found):
    return [run.outcome for run in found.runs]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.5, 2.0, np.pi - 1e-6])
def test_a_change_of_pose_is_the_way_of_the_centre_and_the_angle(angle):
    body, turn = block(0.5).object, angle * np.array([2.0, -1.0, 2.0]) / 3.0
    T0 = pose_matrix((0.1, 0.2, 0.3), (0.4, -0.5, 0.6))
    T = (
        turned_about(T0[:3, 3], Rotation.from_rotvec(turn).as_matrix(), np.array([0.0, 0.03, 0.04]))
        @ T0
    )
    assert change_of_pose(body, T, T0) == pytest.approx((0.05, angle), rel=1e-6, abs=1e-12)


def test_a_block_holds_above_its_critical_friction_and_slips_below():
    held = simulate(block(1.001 * np.tan(TILT)), (), seconds=1.0)
    assert outcomes(held) == ["held", "held"]
    assert held.runs[0].displacement < 1e-6
    slipped = simulate(block(0.99 * np.tan(TILT)), (), seconds=1.0)
    assert outcomes(slipped) == ["moved", "moved"]
    run = slipped.runs[0]
    way = np.linalg.norm(run.T_world_object[:, :3, 3] - run.T_world_object[0, :3, 3], axis=1)
    a = 2.0 * np.polyfit(run.times, way, 2)[0]
    assert a == pytest.approx(0.01 * 9.81 * np.sin(TILT), rel=0.1)
    down = run.T_world_object[-1, :3, 3] - run.T_world_object[0, :3, 3]
    assert down / np.linalg.norm(down) == pytest.approx([np.cos(TILT), 0, -np.sin(TILT)], abs=1e-3)


def test_a_step_lets_all_act_at_once():
    """The way of a block that slides from rest, from the first instant on."""
    mu = 0.5 * np.tan(TILT)
    push = 2.0 * np.array([np.cos(TILT), 0.0, -np.sin(TILT)])
    run = simulate(block(mu), (), push=push, seconds=0.2, protocol="step").runs[0]
    way = np.linalg.norm(
        run.T_world_object[:, :3, 3] - block(mu).object.T_world_object[:3, 3], axis=1
    )
    a = 2.0 + 9.81 * 0.5 * np.sin(TILT)
    np.testing.assert_allclose(way, 0.5 * a * run.times**2, rtol=0.01, atol=2e-5)
    assert outcomes(simulate(block(2.5 * mu), (), seconds=0.5, protocol="step"))[0] == "held"


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("family", "number"), [("slope", 1), ("slope", 2)])
def test_a_step_leaves_at_rest_what_friction_stops(family, number):
    """Where a step is half the time constant of contacts these bounce, and drift off."""
    *_, scene = holding_scenes(family, number + 1)
    for solution in (scene.solve("margin"), scene.solve("torque", margin=0.1)):
        assert scene.stability(solution.torques).status == "strong"
        run = simulate(scene, solution.torques, seconds=1.0, protocol="step").runs[0]
        assert run.outcome == "held"
        assert run.displacement < 5e-5


def test_friction_factor_and_push_count():
    scene = block(1.001 * np.tan(TILT))
    assert simulate(scene, (), friction_factor=0.98, seconds=1.0).outcome == "moved"
    steep = block(0.8)
    along = np.array([np.cos(TILT), 0.0, -np.sin(TILT)])
    most = 9.81 * (0.8 * np.cos(TILT) - np.sin(TILT))
    assert simulate(steep, (), push=0.99 * most * along, seconds=0.5).outcome == "held"
    assert simulate(steep, (), push=1.02 * most * along, seconds=1.0).outcome == "moved"


@pytest.mark.parametrize("name", ["cuboid_at_rest", "sphere_on_slope"])
def test_the_papers_scenes_hold(name):
    scene = load_scene(PAPER / f"{name}.yaml")
    solution = scene.solve("margin")
    found = simulate(scene, solution.torques, seconds=1.0)
    assert outcomes(found) == ["held", "held"]
    normal = np.einsum("ij,ij->i", solution.problem.normals, solution.contact_forces)
    for index in range(2):
        link = scene.contacts.bodies[index]
        assert found.runs[0].normal_forces[link] == pytest.approx(normal[index], rel=1e-3)


def test_the_ball_needs_position_feedback():
    """The forces are determined, and the rest is no stable one."""
    scene = load_scene(BALL)
    solution = scene.solve()
    dropped = simulate(scene, solution.torques)
    assert outcomes(dropped) == ["moved", "moved"]
    kept = simulate(scene, solution.torques, controller=2.0, seconds=1.0)
    assert kept.outcome is SimulatedOutcome.HELD
    assert kept.runs[0].normal_forces["slope"] == pytest.approx(6.477, rel=1e-3)


def test_the_ball_falls_at_the_rate_of_its_instability():
    """Under Algorithm 1 what is left of the settling grows at 14 /s, until 1 N m/rad stop it."""
    scene = load_scene(BALL)
    torques = scene.solve("margin").torques
    run = simulate(scene, torques).runs[0]
    gone = np.linalg.norm(run.T_world_object[:, :3, 3] - scene.object.T_world_object[:3, 3], axis=1)
    grown = (gone > 1e-5) & (gone < 1e-3)
    rate = np.polyfit(run.times[grown], np.log(gone[grown]), 1)[0]
    assert rate == pytest.approx(14.0, rel=0.2)
    assert outcomes(simulate(scene, torques, controller=0.5))[0] == "moved"
    assert outcomes(simulate(scene, torques, controller=1.0, seconds=1.0))[0] == "held"


def test_a_box_falls_between_two_walls():
    """Algorithm 1 claims a margin of several newtons, of a squeeze that nothing makes."""
    fell = []
    for scene in holding_scenes("slot", 3):
        solution = scene.solve()
        assert solution.margin > 4.0
        fell.append(
            simulate(scene, solution.torques, seconds=0.5).outcome is SimulatedOutcome.MOVED
        )
    assert any(fell)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"controller": -1.0}, "stiffness: is -1.0"),
        ({"push": (1.0, 2.0)}, "push: has shape"),
        ({"friction_factor": np.nan}, "friction_factor: is nan"),
        ({"seconds": 0.0}, "seconds: is 0.0"),
        ({"protocol": "jump"}, "protocol: is 'jump'; it must be one of 'fixture', 'step'"),
        ({"seconds": 1e4}, "seconds: is 10000; it must be at most 600"),
    ],
)
def test_bad_arguments_are_refused(given, message):
    with pytest.raises(ArgumentError, match=message):
        simulate(block(0.5), (), **given)


def test_without_mujoco_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(GrasplessPinError, match=r"pip install 'graspless-pin\[simulate\]'"):
        simulate(block(0.5), ())


def test_a_simulation_that_gets_out_of_hand_is_said():
    with pytest.raises(GrasplessPinError, match=r"diverges: no finite state at"):
        simulate(block(0.5).with_changes(max_normal_force=1e3), (), push=(1e14, 0.0, 0.0))


def test_what_is_printed_is_short():
    scene = load_scene(PAPER / "sphere_on_slope.yaml")
    found = simulate(scene, scene.solve().torques_by_joint, seconds=0.1)
    lines = str(found).splitlines()
    assert lines[0].startswith("held: the object stays") and len(lines) == 6
    assert str(found.runs[0]).split()[-4:] == lines[4].split()
    for one in (found, found.runs[0]):
        assert len(repr(one)) < 600
