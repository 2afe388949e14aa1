"""Profiles along paths: twists, changes of contacts, continuity, and exports read back."""

import csv
import json

import numpy as np
import pytest
from planning_scenes import example, shifted, turned
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.planning import (
    Evaluator,
    StateStatus,
    Waypoint,
    evaluate_path,
    joint_trajectory,
    write_path_csv,
)
from graspless_pin.planning.edges import segment_twist


def pivoting(angles, times=None):
    """The pivoting box turned on about its edge; the hand stays."""
    T = example("trihand_pivot_box").object.T_world_object
    times = [None] * len(angles) if times is None else times
    return [
        Waypoint(None, turned(T, -angle), time) for angle, time in zip(angles, times, strict=True)
    ]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(8))
def test_the_twist_is_the_screw_between_two_poses(seed):
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    v, omega = rng.normal(size=3), rng.normal(size=3) * rng.choice([0.0, 1e-6, 0.5, 2.0])
    duration, center = 0.7, rng.normal(size=3)
    world_center = T[:3, :3] @ center + T[:3, 3]
    spatial = np.zeros((4, 4))
    spatial[:3, :3] = np.cross(np.eye(3), omega)
    spatial[:3, 3] = v - np.cross(omega, world_center)
    twist = segment_twist(T, expm(spatial * duration) @ T, duration, center)
    np.testing.assert_allclose(twist, [*v, *omega], atol=1e-9)


def test_pivoting_poses_give_the_declared_twist():
    scene = example("trihand_pivot_box")
    profile = evaluate_path(scene, pivoting([0.0, 0.001, 0.002], [0.0, 0.002, 0.004]))
    np.testing.assert_allclose(profile.twists[0], scene.motion.object_twist, atol=1e-6)
    # Of the path, not of the computation.
    assert str(profile).startswith("a path of 0.004 s, 3 waypoints, smallest margin ")
    assert profile.found
    # The last waypoint goes on as it came.
    np.testing.assert_allclose(profile.twists[-1][3:], [0.0, -0.5, 0.0], atol=1e-9)
    assert not profile.contact_changes


def test_sliding_is_declared_along_the_path():
    scene = example("trihand_push_box")
    T = scene.object.T_world_object
    path = [Waypoint(None, shifted(T, [0.0, 1e-5 * k, 0.0])) for k in (0, 1, 0)]
    profile = evaluate_path(scene, path)
    forth, back = (profile.evaluations[k].contacts.sliding[3:] for k in (0, 1))
    np.testing.assert_allclose(forth, np.tile([0.0, 1e-5, 0.0], (4, 1)), atol=1e-12)
    np.testing.assert_allclose(back, -forth, atol=1e-12)
    still = evaluate_path(scene, [Waypoint(), Waypoint()])
    assert not still.twists.any()
    assert not still.evaluations[0].solution.problem.is_sliding.any()


def test_every_waypoint_is_the_evaluators_answer():
    scene = example("trihand_pivot_box")
    evaluator = Evaluator(scene, algorithm="torque", margin=0.2)
    path = pivoting(np.linspace(0.0, 0.003, 4))
    profile = evaluate_path(evaluator, path, regularization=0.0)
    for k, waypoint in enumerate(path):
        answer = evaluator.evaluate(None, waypoint.T_world_object, profile.twists[k])
        assert profile.margins[k] == pytest.approx(answer.margin, abs=1e-7)
        np.testing.assert_allclose(profile.torques[k], answer.torques, atol=1e-6)
    assert profile.torque_names == evaluator.evaluate().joint_names
    assert profile.smallest_margin == profile.margins.min()


def test_where_two_motions_meet_both_are_solved():
    """Pushed forth, then pulled back: at the turning point the table's friction turns round."""
    scene = example("trihand_push_box")
    T = scene.object.T_world_object
    forth = np.array([0.01, 0, 0])
    steps = [0 * forth, 1e-3 * forth, 2e-3 * forth, 1e-3 * forth]
    evaluator = Evaluator(scene)
    profile = evaluate_path(
        evaluator, [Waypoint(None, shifted(T, step)) for step in steps], regularization=0.0
    )
    came, leaves = (
        evaluator.evaluate(None, profile.object_poses[2], [sign * 1e-5, 0, 0, 0, 0, 0])
        for sign in (1.0, -1.0)
    )
    assert came.found and came.margin > 0.1 and not leaves.found
    assert profile.arrival_margins[2] == pytest.approx(came.margin, abs=1e-6)
    assert profile.margins[2] == -np.inf
    # Elsewhere the motion goes on as it came, and is solved once.
    assert [profile.arrivals[k] is profile.evaluations[k] for k in range(4)] == [
        True, True, False, True,
    ]  # fmt: skip
    # The other way round it is the arrival that fails.
    back = evaluate_path(evaluator, [Waypoint(None, shifted(T, steps[k])) for k in (1, 0, 1)])
    assert np.isfinite(back.margins[1]) and back.arrival_margins[1] == -np.inf
    assert back.failures == (0, 1) and back.smallest_margin == -np.inf
    assert back.failure_reason(1) == back.arrivals[1].reason != ""
    assert "at 1 s: no torques at waypoint 1, infeasible" in str(back)


def test_setting_down_is_no_failure():
    scene = example("trihand_push_box")
    T = scene.object.T_world_object
    path = [Waypoint(None, shifted(T, [0, 0, 1e-4])), Waypoint(), Waypoint()]
    profile = evaluate_path(scene, path)
    down = Evaluator(scene).evaluate(None, T, profile.twists[0])
    assert down.status is StateStatus.BLOCKED
    assert profile.arrivals[1] is profile.evaluations[1] and profile.evaluations[1].found


def redundant_path(count):
    """An Allegro hand moves a little: many of its torques have the ball's largest margin."""
    scene = example("allegro_sphere_on_slope")
    moving = scene.hand.joint_names[:3]
    return scene, [
        Waypoint({name: scene.hand.q[name] + angle for name in moving})
        for angle in np.linspace(0.0, 1e-3, count)
    ]


@pytest.mark.parametrize(("algorithm", "solver"), [("margin", "highs"), ("torque", "piqp")])
def test_regularised_torques_are_continuous_where_contacts_are(algorithm, solver):
    """Halving the steps halves the changes: no jump is left.

    Without the regularisation there are jumps: a vertex next door may be far away.
    """
    changes = []
    for count, options in ((9, {}), (17, {}), (9, {"regularization": 0.0})):
        scene, path = redundant_path(count)
        evaluator = Evaluator(scene, algorithm=algorithm, solver=solver)
        profile = evaluate_path(evaluator, path, **options)
        assert profile.found
        assert not profile.contact_changes
        changes.append(np.abs(np.diff(profile.torques, axis=0)).max())
    assert changes[1] == pytest.approx(0.5 * changes[0], rel=0.1)
    assert changes[2] > 100.0 * changes[0] or algorithm == "torque"


def changing():
    """A push that stops, and then the box is lifted off finger and table."""
    scene = example("trihand_push_box")
    T = scene.object.T_world_object
    steps = [[0, 0, 0], [1e-5, 0, 0], [1e-5, 0, 0], [1e-5, 0, 0], [0, 0, 0.1]]
    return scene, [Waypoint(None, shifted(T, step)) for step in steps]


def test_changes_of_contacts_are_marked():
    scene, path = changing()
    profile = evaluate_path(scene, path[:4])
    assert profile.found
    (change,) = profile.contact_changes
    assert change.waypoint == 1
    assert change.stops_sliding == ("table",) * 4
    assert (change.gained, change.lost, change.starts_sliding) == ((), (), ())
    assert "stops sliding on table x 4" in str(profile)
    # A waypoint without torques is part of the profile.
    profile = evaluate_path(scene, path)
    assert not profile.found
    assert profile.failures == (3, 4)
    assert profile.smallest_margin == -np.inf
    assert profile.evaluations[4].status is StateStatus.NO_CONTACT
    assert np.isnan(profile.torques[4]).all()
    # Towards the last waypoint the box lifts off the table; the fingers move along.
    assert profile.contact_changes[1].lost == ("table",) * 4
    assert "at 4 s: no torques at waypoint 4" in str(profile)
    with pytest.raises(NoSolutionError, match="waypoint 3 has no torques"):
        joint_trajectory(profile)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ([], "is empty"),
        ([Waypoint(time=0.0), Waypoint()], "1 of 2 have a time"),
        ([Waypoint(time=0.0), Waypoint(time=0.0)], "times must increase"),
        ([Waypoint(time=np.nan)], "NaN"),
        ([Waypoint(), Waypoint(T_world_object=np.zeros((4, 4)))], r"waypoints\[1\].T_world_object"),
        ([Waypoint(q={"thumb": 1.0})], r"waypoints\[0\].q: unknown joint 'thumb'"),
        ([Waypoint(), Waypoint(q=[0.1])], r"waypoints\[1\].q: has shape \(1,\)"),
        (Waypoint(), "waypoints: must be a list of waypoints"),
    ],
)
def test_bad_paths(path, message):
    with pytest.raises(ArgumentError, match=message):
        evaluate_path(example("trihand_push_box"), path)


def table_of(profile, folder) -> list[dict[str, str]]:
    write_path_csv(profile, folder / "path.csv")
    with (folder / "path.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_reads_back(tmp_path):
    profile = evaluate_path(example("trihand_pivot_box"), pivoting([0.0, 0.001, 0.002], [1, 2, 4]))
    rows = table_of(profile, tmp_path)
    assert [float(row["time_s"]) for row in rows] == [1.0, 2.0, 4.0]
    assert {row["status"] for row in rows} == {"found"}
    assert [float(row["arrival_margin_N"]) for row in rows] == profile.arrival_margins.tolist()
    assert [float(row["margin_N"]) for row in rows] == profile.margins.tolist()
    for column, name in enumerate(profile.torque_names):
        values = [float(row[f"torque_{name}_N_m"]) for row in rows]
        assert values == profile.torques[:, column].tolist()
    for column, name in enumerate(profile.position_names):
        values = [float(row[f"position_{name}_rad"]) for row in rows]
        assert values == profile.positions[:, column].tolist()
    assert rows[0]["contacts"].split() == list(profile.evaluations[0].contacts.bodies)
    assert {row["contacts_change"] for row in rows} == {"0"}
    pose = [float(rows[1][f"object_{axis}"]) for axis in ("x_m", "y_m", "z_m")]
    assert pose == profile.object_poses[1, :3, 3].tolist()
    turn = Rotation.from_quat([float(rows[1][f"object_q{axis}"]) for axis in "xyzw"])
    np.testing.assert_allclose(turn.as_matrix(), profile.object_poses[1, :3, :3], atol=1e-12)


def test_the_table_of_a_path_with_gaps(tmp_path):
    """And that of a hand with a prismatic joint, which has metres and newtons."""
    profile = evaluate_path(*changing())
    rows = table_of(profile, tmp_path)
    assert [row["contacts_change"] for row in rows] == ["0", "1", "0", "1", "1"]
    assert rows[4]["status"] == "no_contact"
    assert rows[4]["margin_N"] == rows[4]["contacts"] == ""
    assert all(value == "" for name, value in rows[4].items() if name.startswith("torque_"))
    with pytest.raises(ArgumentError, match="cannot write"):
        write_path_csv(profile, tmp_path / "nowhere" / "path.csv")
    (row,) = table_of(evaluate_path(example("panda_slide_cuboid_up_slope"), [Waypoint()]), tmp_path)
    assert [*row][-2:] == ["position_panda_finger_joint1_m", "torque_panda_finger_joint1_N"]


def test_the_trajectory_reads_back():
    profile = evaluate_path(example("trihand_pivot_box"), pivoting([0.0, 0.001], [2.5, 3.75]))
    message = json.loads(json.dumps(joint_trajectory(profile)))
    assert message["joint_names"] == list(profile.position_names)
    first, last = message["points"]
    assert first["time_from_start"] == {"sec": 0, "nanosec": 0}
    assert last["time_from_start"] == {"sec": 1, "nanosec": 250_000_000}
    assert last["positions"] == profile.positions[1].tolist()
    assert dict(zip(message["joint_names"], last["effort"], strict=True)) == dict(
        zip(profile.torque_names, profile.torques[1].tolist(), strict=True)
    )
    assert set(message) == {"header", "joint_names", "points"}
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert set(last) == {"positions", "velocities", "accelerations", "effort", "time_from_start"}
    profile = evaluate_path(example("panda_arm_drag_board"), [Waypoint()])
    message = joint_trajectory(profile)
    efforts = dict(zip(message["joint_names"], message["points"][0]["effort"], strict=True))
    assert profile.torque_names == ("panda_finger_joint1",)
    assert efforts["panda_finger_joint1"] == profile.torques[0, 0] < 0.0
    assert efforts["panda_joint1"] == 0.0


def test_a_configuration_is_a_waypoint_without_a_time():
    scene = example("trihand_pivot_box")
    name = Evaluator(scene).joint_names[0]
    at = float(Evaluator(scene).configuration()[0])
    bare = evaluate_path(scene, [{name: at}, {name: at + 1e-4}])
    stated = evaluate_path(scene, [Waypoint({name: at}), Waypoint({name: at + 1e-4})])
    assert bare.found == stated.found
    np.testing.assert_array_equal(bare.positions, stated.positions)
    np.testing.assert_array_equal(
        evaluate_path(scene, bare.positions.tolist()).positions, bare.positions
    )
    with pytest.raises(ArgumentError, match="q: is 'x'"):
        evaluate_path(scene, ["x"])
