"""ROS's messages as paths, and SRDFs: round trips, scipy's rotations, and mistakes by name."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from graspless_pin import Hand, Scene, Waypoint, evaluate_path, load_scene
from graspless_pin.errors import ArgumentError, GrasplessPinWarning, RobotError, SceneError
from graspless_pin.interfaces.ros import pose_from_message, waypoints_from_trajectory
from graspless_pin.planning import joint_trajectory
from graspless_pin.problem import ControlMode

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(EXAMPLES / "trihand_push_box.yaml").with_changes(motion=None)


@pytest.fixture(scope="module")
def message(scene: Scene) -> dict[str, Any]:
    assert scene.hand is not None
    q = dict(scene.hand.q)
    bent = q | {"finger_1_distal": q["finger_1_distal"] - 1e-4}
    path = [Waypoint(time=2.0), Waypoint(q=bent, time=3.5)]
    return joint_trajectory(evaluate_path(scene, path))


def as_object(message: Any) -> Any:
    """The same as an object with attributes, like a message of rclpy."""
    if isinstance(message, dict):
        return SimpleNamespace(**{key: as_object(value) for key, value in message.items()})
    return [as_object(one) for one in message] if isinstance(message, list) else message


def positions(scene: Scene, waypoints: list[Waypoint]) -> np.ndarray:
    assert scene.hand is not None
    rows = [scene.hand.with_configuration(one.q).positions for one in waypoints if one.q]
    return np.array(rows)


def test_a_profile_comes_back_from_its_message_in_every_form(
    scene: Scene, message: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "path.yaml").write_text(yaml.safe_dump(message) + "---\n")
    (tmp_path / "path.json").write_text(json.dumps(message))
    turned = deepcopy(message)
    turned["joint_names"].reverse()
    for point in turned["points"]:
        point["positions"].reverse()
        stamp = point["time_from_start"]
        point["time_from_start"] = {"secs": stamp["sec"], "nsecs": stamp["nanosec"]}
    forms = [
        message, as_object(message), tmp_path / "path.yaml", str(tmp_path / "path.json"), turned
    ]  # fmt: skip
    wanted = [point["positions"] for point in message["points"]]
    for form in forms:
        waypoints = waypoints_from_trajectory(scene, form)
        assert [one.time for one in waypoints] == [0.0, 1.5]
        np.testing.assert_array_equal(positions(scene, waypoints), wanted)
    profile = evaluate_path(scene, waypoints_from_trajectory(scene, message))
    assert profile.margins[0] == pytest.approx(scene.solve(regularization=1e-4).margin, abs=1e-9)
    assert joint_trajectory(profile)["points"][1]["positions"] == wanted[1]


def pose_message(T: np.ndarray, keys: tuple[str, str]) -> dict[str, Any]:
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat()
    position = dict(zip("xyz", T[:3, 3].tolist(), strict=True))
    return {keys[0]: position, keys[1]: dict(zip("xyzw", quaternion.tolist(), strict=True))}


POSE, TRANSFORM = ("position", "orientation"), ("translation", "rotation")


def test_poses_of_the_object_go_with_the_points(scene: Scene, message: dict[str, Any]) -> None:
    rng = np.random.default_rng(5)
    poses = []
    for R in Rotation.random(2, rng=rng).as_matrix():
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, rng.normal(size=3)
        poses.append(T)
    plain = [pose_message(T, POSE) for T in poses]
    path = {
        "joint_names": ["object"],
        "points": [
            {
                "transforms": [pose_message(T, TRANSFORM)],
                "time_from_start": point["time_from_start"],
            }
            for T, point in zip(poses, message["points"], strict=True)
        ],
    }
    stamped = [{"header": {}, "pose": one} for one in plain]
    for given in (plain, as_object(plain), stamped, path, as_object(path)):
        with_joints = waypoints_from_trajectory(scene, message, given)
        alone = waypoints_from_trajectory(scene, None, given)
        for one, other, T in zip(with_joints, alone, poses, strict=True):
            for found in (one, other):
                assert isinstance(found.T_world_object, np.ndarray)
                np.testing.assert_allclose(found.T_world_object, T, atol=1e-12)
            assert other.q is None
    assert [one.time for one in waypoints_from_trajectory(scene, None, path)] == [0.0, 1.5]
    late = deepcopy(path)
    late["points"][1]["time_from_start"]["sec"] += 1
    with pytest.raises(
        ArgumentError, match=r"point 1 is at 2.5 s, but point 1 of the joints is at 1.5"
    ):
        waypoints_from_trajectory(scene, message, late)
    with pytest.raises(ArgumentError, match="1 poses, but the trajectory has 2 points"):
        waypoints_from_trajectory(scene, message, plain[:1])
    assert np.allclose(pose_from_message(plain[0]), poses[0])


def renamed(message: dict[str, Any], old: str, new: str) -> None:
    message["joint_names"][message["joint_names"].index(old)] = new


def without(message: dict[str, Any], count: int) -> None:
    del message["joint_names"][:count]
    for point in message["points"]:
        del point["positions"][:count]


def put(message: dict[str, Any], value: Any) -> None:
    message["points"][1]["positions"][0] = value


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda m: renamed(m, "finger_1_distal", "finger_1_distl"), r"finger_1_distl'.*_distal"),
        (lambda m: without(m, 2), r"does not name '.*', '.*'; add them.*stay"),
        (lambda m: renamed(m, "finger_1_distal", "finger_2_distal"), "finger_2_distal' twice"),
        (lambda m: m["points"][1]["positions"].pop(), r"points\[1\].positions: has 8 numbers"),
        (lambda m: put(m, float("nan")), r"points\[1\].positions: is NaN"),
        (lambda m: put(m, 9.0), r"points\[1\].positions.*outside the joint's limits"),
        (lambda m: m["points"].clear(), "points: is empty"),
        (lambda m: m.pop("points"), "trajectory: has no 'points'"),
        (lambda m: m["points"][0].pop("time_from_start"), r"points\[0\]: has no 'time_from_start'"),
    ],
)  # fmt: skip
def test_mistakes_in_a_message_are_named(
    scene: Scene, message: dict[str, Any], spoil: Any, words: str
) -> None:
    spoilt = deepcopy(message)
    spoil(spoilt)
    with pytest.raises(ArgumentError, match=words):
        waypoints_from_trajectory(scene, spoilt)


def test_other_mistakes_are_named(scene: Scene, message: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "two.yaml").write_text(2 * (yaml.safe_dump(message) + "---\n"))
    with pytest.raises(ArgumentError, match=r"two\.yaml has 2 messages"):
        waypoints_from_trajectory(scene, tmp_path / "two.yaml")
    with pytest.raises(ArgumentError, match="there is no such file"):
        waypoints_from_trajectory(scene, tmp_path / "none.yaml")
    with pytest.raises(ArgumentError, match="give at least one of them"):
        waypoints_from_trajectory(scene)
    with pytest.raises(ArgumentError, match="has no hand"):
        waypoints_from_trajectory(scene.with_changes(hand=None), message)
    nothing = {"position": dict.fromkeys("xyz", 0.0), "orientation": dict.fromkeys("xyzw", 0.0)}
    with pytest.raises(ArgumentError, match="orientation: has the norm 0"):
        pose_from_message(nothing)
    partly = deepcopy(message)
    gone = partly["joint_names"][:2]
    without(partly, 2)
    waypoints = waypoints_from_trajectory(scene, partly, stay=gone)
    np.testing.assert_array_equal(
        positions(scene, waypoints), [point["positions"] for point in message["points"]]
    )


def in_degrees(message: dict[str, Any]) -> dict[str, Any]:
    turned = deepcopy(message)
    for point in turned["points"]:
        point["positions"] = np.degrees(point["positions"]).tolist()
    return turned


def test_angles_in_degrees_are_told(scene: Scene, message: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match=r"points\[0\].*outside.*all angles look like degrees"):
        waypoints_from_trajectory(scene, in_degrees(message))
    (tmp_path / "claw.urdf").write_text(URDF.replace("revolute", "continuous"))
    file = tmp_path / "scene.yaml"
    file.write_text(SCENE.format(srdf="null", states="", more=""))
    point = {"positions": [0.1, -0.2, 1.6], "time_from_start": 0.0}
    path = {"joint_names": ["j1", "j2", "j3"], "points": [point]}
    assert len(waypoints_from_trajectory(load_scene(file), path)) == 1
    with pytest.warns(GrasplessPinWarning, match="exceed a full turn.*give radians"):
        waypoints_from_trajectory(load_scene(file), in_degrees(path))


def test_messages_that_hold_a_trajectory_stand_for_it(
    scene: Scene, message: dict[str, Any]
) -> None:
    nothing = {"joint_names": [], "points": []}
    robot = {"joint_trajectory": message, "multi_dof_joint_trajectory": nothing}
    wanted = positions(scene, waypoints_from_trajectory(scene, message))
    for held in (robot, {"trajectory": message}, {"trajectory": robot}):
        for form in (held, as_object(held)):
            found = positions(scene, waypoints_from_trajectory(scene, form))
            np.testing.assert_array_equal(found, wanted)
    robot["multi_dof_joint_trajectory"] = nothing | {"joint_names": ["base"]}
    with pytest.raises(ArgumentError, match="pass its joint_trajectory, and the multi_dof"):
        waypoints_from_trajectory(scene, robot)
    with pytest.raises(ArgumentError, match="holds 2 trajectories under 'trajectory'; pass one"):
        waypoints_from_trajectory(scene, {"trajectory": [robot, robot]})


@pytest.mark.parametrize(("follower", "agrees"), [(0.01, True), (0.03, False)])
def test_joints_that_follow_may_be_named_where_they_agree(follower: float, agrees: bool) -> None:
    scene = load_scene(EXAMPLES / "panda_carry_bar.yaml")
    assert scene.hand is not None
    joints = dict(scene.hand.q) | {"panda_finger_joint1": 0.01, "panda_finger_joint2": follower}
    point = {"positions": list(joints.values()), "time_from_start": {"sec": 0, "nanosec": 0}}
    message = {"joint_names": list(joints), "points": [point]}
    if agrees:
        [waypoint] = waypoints_from_trajectory(scene, message)
        assert isinstance(waypoint.q, dict)
        assert waypoint.q["panda_finger_joint1"] == 0.01
    else:
        with pytest.raises(ArgumentError, match=r"points\[0\].positions.*panda_finger_joint2"):
            waypoints_from_trajectory(scene, message)


URDF = """
<robot name="claw"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
{}</robot>""".format(
    "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="2" velocity="1"/></joint>'
        for name, parent, child in (("j1", "base", "a"), ("j2", "a", "b"), ("j3", "b", "c"))
    )
)
SRDF = """
<robot name="claw">
  <group name="whole"><chain base_link="base" tip_link="c"/></group>
  <group name="end"><link name="c"/></group>
  <group name="both"><group name="end"/><joint name="j1"/></group>
  <group_state name="bent" group="whole">
    <joint name="j1" value="0.1"/><joint name="j2" value="0.2"/><joint name="wheel" value="1 0 0"/>
  </group_state>
  <group_state name="bent" group="end"><joint name="j3" value="0.3"/></group_state>
  <group_state name="other" group="end"><joint name="j3" value="-0.3"/></group_state>
  <group_state name="odd" group="whole"><joint name="j3" value="0.5"/></group_state>
  <group_state name="odd" group="both"><joint name="j3" value="0.6"/></group_state>
  <disable_collisions link1="a" link2="c" reason="Never"/>
</robot>"""
SCENE = """
hand: {{urdf: claw.urdf, srdf: {srdf}, group_states: [{states}], q: {{j2: -0.2}}{more}}}
object: {{shape: {{type: sphere, radius: 0.1}}, mass: 1.0}}
friction: 0.5
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "moveit").mkdir()
    (tmp_path / "claw.urdf").write_text(URDF)
    (tmp_path / "moveit" / "config.srdf").write_text(SRDF)
    return tmp_path


def test_an_srdf_that_is_named_gives_groups_states_and_pairs(folder: Path) -> None:
    assert not Hand.from_urdf(folder / "claw.urdf").group_states
    hand = Hand.from_urdf(
        folder / "claw.urdf", srdf=folder / "moveit" / "config.srdf", control={"both": "position"}
    )
    assert hand.tree.groups == {"whole": ("j1", "j2", "j3"), "end": ("j3",), "both": ("j3", "j1")}
    assert hand.tree.disabled_pairs == {frozenset("ac")}
    modes = {joint for joint, mode in hand.control.joints.items() if mode is ControlMode.POSITION}
    assert modes == {"j1", "j3"}
    bent = hand.with_configuration(hand.group_states["whole/bent"])
    assert dict(bent.q) == {"j1": 0.1, "j2": 0.2, "j3": 0.0}


def test_a_scene_names_states_of_its_srdf(folder: Path) -> None:
    text = SCENE.format(srdf="moveit/config.srdf", states="bent, end/other", more="")
    (folder / "scene.yaml").write_text(text)
    scene = load_scene(folder / "scene.yaml")
    assert scene.hand is not None
    assert dict(scene.hand.q) == {"j1": 0.1, "j2": -0.2, "j3": -0.3}
    (folder / "one.yaml").write_text(text.replace("[bent, end/other]", "end/other"))
    one = load_scene(folder / "one.yaml")
    assert dict(one.hand.q) == {"j1": 0.0, "j2": -0.2, "j3": -0.3}  # pyright: ignore
    assert load_scene(one.save(folder / "again.yaml")).hand.q == one.hand.q  # pyright: ignore
    inside = folder / "inside"
    inside.mkdir()
    moved = scene.with_changes(hand=scene.hand.with_configuration({"j1": 0.7}))
    again = load_scene(moved.save(inside / "again.yaml"))
    assert again.hand is not None
    assert dict(again.hand.q) == {"j1": 0.7, "j2": -0.2, "j3": -0.3}
    assert again.hand.tree.groups == scene.hand.tree.groups
    alone = scene.with_changes(path=None).save(folder / "alone.yaml")
    assert load_scene(alone).hand.group_states == scene.hand.group_states  # pyright: ignore


@pytest.mark.parametrize(
    ("states", "words"),
    [("bant", "unknown state 'bant'.*whole/bent"), ("odd", "'j3' at 0.5 and 0.6; give one")],
)
def test_states_that_are_unknown_or_disagree_are_named(
    folder: Path, states: str, words: str
) -> None:
    text = SCENE.format(srdf="moveit/config.srdf", states=states, more="")
    (folder / "scene.yaml").write_text(text)
    with pytest.raises(SceneError, match=words):
        load_scene(folder / "scene.yaml")


def test_what_an_srdf_says_of_other_robots_is_told_and_refused_where_it_is_asked_for(
    folder: Path,
) -> None:
    file = folder / "moveit" / "config.srdf"
    text = SRDF.replace('name="j2" value', 'name="j_2" value').replace('link2="c"', 'link2="cc"')
    text = text.replace('<joint name="j1"/></group>', '<joint name="j9"/></group>')
    file.write_text(text)
    told = r"config\.srdf names.*link 'cc'.*\(disable_collisions\).*'j9' .*'both'.*'j_2', "
    with pytest.warns(GrasplessPinWarning, match=told + "meant 'j2'.*'whole/bent'"):
        hand = Hand.from_urdf(folder / "claw.urdf", srdf=file, control={"end": "position"})
    assert hand.group_states["whole/bent"] == {"j1": 0.1}
    with pytest.raises(ArgumentError, match=r"control: 'both'.*config\.srdf: joint 'j9'"):
        Hand.from_urdf(folder / "claw.urdf", srdf=file, control={"both": "position"})
    scene = folder / "scene.yaml"
    scene.write_text(SCENE.format(srdf="moveit/config.srdf", states="end/other", more=""))
    with pytest.warns(GrasplessPinWarning, match="'whole/bent'"):
        assert load_scene(scene).hand.q["j3"] == -0.3  # pyright: ignore
    scene.write_text(SCENE.format(srdf="moveit/config.srdf", states="bent", more=""))
    with pytest.raises(SceneError, match=r"group_states: 'whole/bent'.*'j_2', meant 'j2'"):
        load_scene(scene)
    # Above the root link are joints of the file: an SRDF may name them.
    file.write_text(SRDF.replace('<chain base_link="base" tip_link="c"/>', '<link name="c"/>'))
    cut = SCENE.replace("{{urdf", "{{root_link: b, urdf").replace("j2: -0.2", "")
    scene.write_text(cut.format(srdf="moveit/config.srdf", states="end/bent", more=""))
    assert load_scene(scene).hand.q == {"j3": 0.3}  # pyright: ignore
    scene.write_text(cut.format(srdf="moveit/config.srdf", states="whole/bent", more=""))
    with pytest.raises(
        SceneError, match="'whole/bent' of an SRDF gives no position of a joint of this robot"
    ):
        load_scene(scene)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('value="0.2"', 'value="far"', r"'whole/bent' puts joint 'j2' at 'far'"),
        ('<group name="end"/>', '<group name="and"/>', "'both' contains 'and', which is no group"),
        ('<group name="end"/>', '<group name="both"/>', "'both' contains itself"),
        ('tip_link="c"', 'tip_link="d"', "chain from link 'base' to 'd'"),
        ("<robot", "<robot", ""),
    ],
)
def test_mistakes_in_an_srdf_are_named(folder: Path, old: str, new: str, words: str) -> None:
    file = folder / "moveit" / "config.srdf"
    file.write_text(SRDF.replace(old, new) if words else SRDF.replace("robot", "semantics"))
    with pytest.raises(RobotError, match=words or "starts with <robot>"):
        Hand.from_urdf(folder / "claw.urdf", srdf=file)
    (folder / "claw.srdf").write_text(file.read_text())
    with pytest.warns(GrasplessPinWarning, match=words or "starts with <robot>"):
        Hand.from_urdf(folder / "claw.urdf")
