"""Timings of an arm's path against scenes that accelerate so, solved on their own."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from planning_scenes import example

from graspless_pin import Scene, maximize_margin
from graspless_pin.errors import ArgumentError, NoSolutionError, SceneError
from graspless_pin.planning import (
    PathTiming,
    TimingLimit,
    fastest_timing,
    joint_trajectory,
)
from graspless_pin.scene import Acceleration, Load

PATH = [{}, {"panda_joint1": 0.4}, {"panda_joint1": 1.0, "panda_joint2": 0.3}]
FAST = 20.0  # rad/s, beyond what contacts allow


def carried() -> Scene:
    return example("panda_stop_with_board").with_changes(acceleration=None)


def timed(scene: Scene, path: Any, **limits: Any) -> PathTiming:
    return fastest_timing(scene, path, attached_to="panda_hand", points=40, **limits)


@cache
def timing(torque: float | None = None, margin: float = 0.0, fastest: float = FAST) -> PathTiming:
    torques = None if torque is None else [torque]
    return timed(carried(), PATH, velocity_limits=fastest, margin=margin, torques=torques)


def accelerating(scene: Scene, found: PathTiming, k: int, faster: float = 1.0) -> Scene:
    """The scene at a point of a timing, all in a frame that moves as the arm does there."""
    hand = scene.hand
    assert hand is not None
    there = hand.with_configuration(dict(zip(found.joint_names, found.positions[k], strict=True)))
    step = there.pose_of("panda_hand") @ np.linalg.inv(hand.pose_of("panda_hand"))
    rates, changes = faster * found.velocities[k], faster**2 * found.accelerations[k]
    told = Acceleration(
        joint_velocities=dict(zip(found.joint_names, rates.tolist(), strict=True)),
        joint_accelerations=dict(zip(found.joint_names, changes.tolist(), strict=True)),
    )
    moved = scene.object.with_pose(step @ scene.object.T_world_object)
    return scene.with_changes(hand=there, object=moved, acceleration=told)


def margin_at(found: PathTiming, k: int, faster: float = 1.0) -> float:
    """The margin under plain Coulomb friction, with the pyramids turned as the hand is."""
    start, there = carried(), accelerating(carried(), found, k, faster)
    R = there.object.T_world_object[:3, :3] @ start.object.T_world_object[:3, :3].T
    before, problem = start.problem(), there.problem()
    np.testing.assert_allclose(problem.positions, before.positions @ R.T, atol=1e-6)
    solution = maximize_margin(
        problem.with_changes(tangents=R @ before.tangents), static_friction="coulomb"
    )
    return solution.margin if solution.found else -np.inf


@pytest.mark.parametrize("margin", [0.0, 0.5])
def test_margins_are_those_of_accelerating_scenes(margin: float) -> None:
    """Each point keeps the margin, and no shorter time of the whole does at all of them."""
    found = timing(margin=margin)
    assert found.found
    points = range(0, len(found.times), 3)
    # The motor's weight along the path is not that of the start: any torque within limits.
    margins = [margin_at(found, k) for k in points]
    np.testing.assert_allclose(margins, found.margins[::3], atol=1e-5)
    assert found.margins.min() == pytest.approx(margin, abs=1e-5)
    lost = [margin_at(found, k, faster=1.05) for k in points]
    assert min(lost) < margin - 1e-3


def test_constant_torques_are_slower() -> None:
    free, firm, loose = timing(), timing(-100.0), timing(-60.0)
    assert free.duration < firm.duration < loose.duration
    assert TimingLimit.CONTACTS in loose.limits
    assert all(loose.limiting_contacts)
    assert set(loose.bodies) == {"panda_leftfinger", "panda_rightfinger"}
    assert "limited by contacts" in str(loose)


def test_motion_is_consistent_from_rest_to_rest() -> None:
    """Velocities and accelerations are the differences of positions in time."""
    found = timing(-60.0)
    assert found.speeds[[0, -1]].tolist() == [0.0, 0.0]
    steps = np.diff(found.times)[:, None]
    mean = 0.5 * (found.velocities[1:] + found.velocities[:-1])
    np.testing.assert_allclose(np.diff(found.positions, axis=0) / steps, mean, atol=0.03)
    np.testing.assert_allclose(
        np.diff(found.velocities, axis=0) / steps,
        found.accelerations[:-1],
        atol=0.05 * np.abs(found.accelerations).max(),
    )


def test_joint_velocities_are_kept() -> None:
    found = timing(fastest=0.8)
    assert np.abs(found.velocities).max() == pytest.approx(0.8, rel=1e-6)
    assert found.limits.count(TimingLimit.VELOCITY) > 20
    assert found.margins.min() > 0.1
    by_name = timed(carried(), PATH, velocity_limits={"panda_joint1": 0.8})
    assert by_name.duration < found.duration + 1e-9
    first = by_name.joint_names.index("panda_joint1")
    assert np.abs(by_name.velocities[:, first]).max() == pytest.approx(0.8, rel=1e-6)


def test_velocities_of_the_robot_file_are_kept() -> None:
    """The Panda's URDF states 2.175 rad/s for the first four joints, and 2.61 for the others."""
    found = timed(carried(), PATH)
    first = found.joint_names.index("panda_joint1")
    assert np.abs(found.velocities[:, first]).max() == pytest.approx(2.175, rel=1e-6)
    one = timed(carried(), PATH, velocity_limits={"panda_joint1": 9.0})
    assert np.abs(one.velocities[:, first]).max() > 3.0
    second = one.joint_names.index("panda_joint2")
    assert np.abs(one.velocities[:, second]).max() <= 2.175 * (1.0 + 1e-6)


def test_joints_that_do_not_move_limit_nothing() -> None:
    """A joint that stands still has no share in the speed along the path, whatever its limit."""
    slow = dict.fromkeys(timing().joint_names, FAST) | {"panda_joint7": 0.1}
    found = timed(carried(), PATH, velocity_limits=slow)
    assert found.duration == pytest.approx(timing().duration, rel=1e-3)
    assert TimingLimit.VELOCITY not in found.limits


def test_joint_torques_are_kept() -> None:
    """Against the torques of an arm under force control, with what it carries as contacts."""
    limits = {"panda_joint1": 20.0, "panda_joint2": 45.0}
    found = timed(carried(), PATH, velocity_limits=FAST, torque_limits=limits)
    assert found.found and found.duration > timing().duration
    assert TimingLimit.TORQUE in found.limits
    forced = carried().with_changes({"hand.control": "force"})
    worst = np.zeros(2)
    for k in range(0, len(found.times), 3):
        solution = accelerating(forced, found, k).solve("margin", static_friction="coulomb")
        torques = solution.torques_by_joint if solution.found else {}
        assert solution.found
        worst = np.maximum(worst, [abs(torques[name]) / most for name, most in limits.items()])
    assert worst.max() < 1.001
    assert worst.max() > 0.97


def test_joint_accelerations_are_kept() -> None:
    found = timed(carried(), PATH, velocity_limits=FAST, acceleration_limits={"panda_joint1": 5.0})
    first = found.joint_names.index("panda_joint1")
    assert np.abs(found.accelerations[:, first]).max() == pytest.approx(5.0, rel=1e-2)
    assert TimingLimit.ACCELERATION in found.limits
    assert found.duration > 1.5 * timing().duration


def test_a_timing_is_a_trajectory() -> None:
    found = timing(-60.0)
    message = joint_trajectory(found)
    assert message["joint_names"] == list(found.joint_names)
    last = message["points"][-1]
    seconds = last["time_from_start"]["sec"] + 1e-9 * last["time_from_start"]["nanosec"]
    assert seconds == pytest.approx(found.duration, abs=1e-8)
    assert last["velocities"] == found.velocities[-1].tolist()
    with pytest.raises(NoSolutionError, match="no timing to export"):
        joint_trajectory(timing(-5.0))


def test_loads_count() -> None:
    heavy = carried().with_changes(loads=[Load("bag", mass=0.3, at=[0.0, 0.0, -0.1])])
    slower = timed(heavy, PATH, velocity_limits=FAST, torques=[-100.0])
    assert slower.duration > timing(-100.0).duration


def test_too_little_force_has_no_timing() -> None:
    found = timing(-5.0)
    assert not found.found and np.isnan(found.duration)
    start = (
        "no timing: the given torques (panda_finger_joint1 -5) do not hold the object at rest at"
    )
    assert str(found).startswith(start)
    assert "other torques within the motors' limits do: leave torques out" in found.reason


def test_a_reason_tells_which_limit_leaves_no_timing() -> None:
    scene = carried()
    found = timed(scene, PATH, velocity_limits=FAST, torque_limits={"panda_joint2": 5.0})
    assert "joint 'panda_joint2' needs" in found.reason
    assert "torque_limits allows 5; raise it" in found.reason
    weak = scene.with_changes({"hand.effort_limits": {"panda_finger_joint1": 3.0}})
    reason = timed(weak, PATH, velocity_limits=FAST).reason
    assert reason.startswith("no torques within the motors' limits hold the object at")
    assert "stronger motors would: raise effort_limits (panda_finger_joint1 [-3, 3])" in reason
    reason = timed(scene, PATH, velocity_limits=FAST, margin=50.0).reason
    assert "no motors would with this friction and max_normal_force" in reason
    assert reason.endswith("or ask for less margin")


def test_what_is_wrong_is_said() -> None:
    scene = carried()
    with pytest.raises(ArgumentError, match="needs at least two different configurations, found 1"):
        timed(scene, [{}], velocity_limits=1.0)
    with pytest.raises(ArgumentError, match="two equal ones in succession"):
        timed(scene, [{}, {}], velocity_limits=1.0)
    with pytest.raises(ArgumentError, match=r"velocity_limits: unknown joint 'elbow'"):
        timed(scene, PATH, velocity_limits={"elbow": 1.0})
    with pytest.raises(ArgumentError, match=r"velocity_limits: is 0"):
        timed(scene, PATH, velocity_limits=0.0)
    with pytest.raises(ArgumentError, match=r"path\[1\]: .*is 60, outside the joint's limits"):
        timed(scene, [{}, {"panda_joint1": 60.0}], velocity_limits=1.0)
    near = 2.8973 - 0.001  # rad; the spline swings beyond the limit between the two
    path = [{}, {"panda_joint1": near}, {"panda_joint1": near, "panda_joint2": 0.4}]
    with pytest.raises(ArgumentError, match=r"path: the spline .* limit: q\['panda_joint1"):
        timed(scene, path, velocity_limits=1.0)
    with pytest.raises(ArgumentError, match=r"torques\['panda_finger_joint1'\]: is -200, outside"):
        timed(scene, PATH, velocity_limits=1.0, torques=[-200.0])
    with pytest.raises(ArgumentError, match="unknown joint 'gripper'; known: panda_finger_joint1"):
        timed(scene, PATH, velocity_limits=1.0, torques={"gripper": -60.0})
    with pytest.raises(ArgumentError, match=r"torques: has shape \(2,\); expected \(1,\)"):
        timed(scene, PATH, velocity_limits=1.0, torques=[-60.0, 0.0])
    by_name = timed(scene, PATH, velocity_limits=FAST, torques={"panda_finger_joint1": -60.0})
    assert by_name.duration == pytest.approx(timing(-60.0).duration)
    with pytest.raises(ArgumentError, match="'panda_finger_joint1' belongs to the grip"):
        timed(scene, [{}, {"panda_finger_joint1": 0.02}], velocity_limits=1.0)
    with pytest.raises(SceneError, match="acceleration: is stated"):
        timed(example("panda_stop_with_board"), PATH, velocity_limits=1.0)
    board = example("panda_arm_drag_board").with_changes(motion=None)
    with pytest.raises(ArgumentError, match="'table' touches the object"):
        timed(board, PATH, velocity_limits=1.0)
