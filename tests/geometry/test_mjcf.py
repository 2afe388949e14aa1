"""Hands from MJCF, against MuJoCo's own kinematics, weight and inertia."""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
import trimesh

from graspless_pin import Hand
from graspless_pin.errors import GrasplessPinWarning, RobotError
from graspless_pin.findings import FindingCode, capture
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.reading import read_robot
from graspless_pin.geometry.hand.robot_model import RobotModel
from graspless_pin.geometry.hand.tree import KinematicTree, build_tree
from graspless_pin.geometry.inspection import audit_urdf
from graspless_pin.geometry.robots.files import describe_urdf
from graspless_pin.simulation.protocol import load_mujoco

mujoco = load_mujoco()

HAND = """
<mujoco model="claw">
  <compiler angle="degree" meshdir="parts" autolimits="true"/>
  <default>
    <joint armature="0.002"/>
    <default class="finger"><geom type="capsule" size="0.008 0.02" mass="0.03"/></default>
  </default>
  <asset>
    <mesh name="wedge" file="wedge.stl" scale="0.5 1 2" refpos="0.01 0 0"/>
    <texture name="steel" type="2d" file="gone.png"/>
    <material name="steel" texture="steel"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="palm" pos="0.3 0.1 0.5" quat="0.9 0.1 0.3 -0.2">
      <geom type="mesh" mesh="wedge" pos="0.01 0.02 0.03" euler="20 30 40" material="steel"/>
      <geom name="pad" type="box" size="0.03 0.02 0.01" contype="0" conaffinity="0"/>
      <body name="near" pos="0.03 0 0.02" euler="10 -20 30">
        <joint name="spread" axis="0 0 1" range="-30 30" pos="0.001 0.002 0.003"/>
        <joint name="bend" axis="0 1 0" range="0 90" ref="15" pos="-0.004 0 0.002"/>
        <geom class="finger" pos="0 0 0.03" euler="0 90 0"/>
        <body name="far" pos="0 0 0.06">
          <joint name="curl" axis="0 1 0" range="0 90"/>
          <geom class="finger" pos="0 0 0.02"/>
          <body name="tip" pos="0 0 0.04">
            <joint name="end" axis="0 1 0" range="0 90"/>
            <geom type="sphere" size="0.01" mass="0.01"/>
          </body>
        </body>
      </body>
      <body name="slider" pos="-0.03 0 0.02">
        <joint name="reach" type="slide" axis="1 0 1" range="0 0.05" ref="0.01"/>
        <geom type="cylinder" size="0.01 0.03" mass="0.05"/>
        <body name="wheel" pos="0 0 0.04">
          <joint name="roll" axis="1 0 0" limited="false" armature="0"/>
          <geom type="box" size="0.01 0.02 0.03" mass="0.02"/>
        </body>
      </body>
    </body>
    <body name="cube" pos="0 0 0.1"><freejoint/><geom type="box" size="0.02 0.02 0.02"/></body>
  </worldbody>
  <tendon>
    <fixed name="link" range="-0.0005 0.0005">
      <joint joint="curl" coef="0.008"/><joint joint="end" coef="-0.01"/>
    </fixed>
  </tendon>
  <actuator>
    <motor name="a" joint="spread" gear="5" ctrlrange="-2 2"/>
    <position name="b" joint="bend" kp="10" forcerange="-0.7 0.9"/>
    <motor name="c" joint="curl" gear="3" ctrlrange="-1 1" forcerange="-0.2 0.2"/>
    <motor name="d" joint="reach" ctrlrange="0 4"/>
  </actuator>
</mujoco>
"""
JOINTS = ("spread", "bend", "curl", "end", "reach", "roll")
LINKS = ("palm", "near", "far", "tip", "slider", "wheel")


@pytest.fixture
def claw(tmp_path: Path) -> Path:
    """Return the hand's file, its mesh beside it; the picture that its material names is gone."""
    (tmp_path / "parts").mkdir()
    wedge = trimesh.convex.convex_hull(np.random.default_rng(3).uniform(-0.02, 0.03, (12, 3)))
    wedge.export(tmp_path / "parts" / "wedge.stl")
    path = tmp_path / "claw.xml"
    path.write_text(HAND)
    return path


def tree_of(path: Path, root_link: str | None = None) -> tuple[RobotModel, KinematicTree]:
    document = read_robot(replace(describe_urdf(path), root_link=root_link))
    return document, build_tree([(document, np.eye(4))])


def simulated(path: Path) -> tuple[Any, Any]:
    """Return MuJoCo's model and data."""
    text = path.read_text().replace(' material="steel"', "")
    for asset in ("texture", "material"):
        start = text.index(f"<{asset} ")
        text = text[:start] + text[text.index("/>", start) + 2 :]
    plain = path.with_name("plain.xml")
    plain.write_text(text)
    model = mujoco.MjModel.from_xml_path(str(plain))
    return model, mujoco.MjData(model)


def poses(tree: KinematicTree, q: np.ndarray) -> dict[str, np.ndarray]:
    model = tree.pinocchio_model
    data = model.createData()
    pin.framesForwardKinematics(model, data, tree.configuration(q))
    return {link: data.oMf[frame].homogeneous for link, frame in tree.link_frames.items()}


def test_kinematics_weight_and_inertia_are_mujoco_s(claw: Path) -> None:
    """Joints beside their body's origin, two in one body, and positions that begin elsewhere."""
    document, tree = tree_of(claw)
    model, data = simulated(claw)
    assert document.root == "palm"
    assert set(LINKS) < set(tree.link_frames)
    rng = np.random.default_rng(0)
    dofs = [model.joint(name).dofadr[0] for name in tree.joint_names]
    for _ in range(4):
        low, high = np.maximum(tree.lower, -3.0), np.minimum(tree.upper, 3.0)
        q = rng.uniform(low, high)
        for name, value in zip(tree.joint_names, q, strict=True):
            data.joint(name).qpos = value
        mujoco.mj_forward(model, data)
        T_palm_world = np.linalg.inv(world_pose(data, "palm"))
        placed = poses(tree, q)
        for link in LINKS:
            np.testing.assert_allclose(
                placed[link], T_palm_world @ world_pose(data, link), atol=1e-12
            )
        gravity = T_palm_world[:3, :3] @ model.opt.gravity
        np.testing.assert_allclose(
            tree.gravity_torques(q, gravity), data.qfrc_bias[dofs], atol=1e-12
        )
        whole = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, whole)
        np.testing.assert_allclose(tree.joint_inertia(q), whole[np.ix_(dofs, dofs)], atol=1e-12)


def world_pose(data: Any, body: str) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = data.body(body).xmat.reshape(3, 3), data.body(body).xpos
    return T


def test_shapes_are_where_mujoco_has_them(claw: Path) -> None:
    """MuJoCo moves meshes into frames of their own; capsules stay capsules."""
    _, tree = tree_of(claw)
    model, data = simulated(claw)
    mujoco.mj_forward(model, data)
    by_link = {item.link: item for item in tree.geometries}
    assert set(by_link) == set(LINKS)
    wedge = by_link["palm"]
    vertices = np.array([wedge.shape.point(i) for i in range(wedge.shape.num_points)])
    mine = vertices @ wedge.T_joint_geometry[:3, :3].T + wedge.T_joint_geometry[:3, 3]
    geom = next(g for g in range(model.ngeom) if model.geom_dataid[g] >= 0)
    theirs = model.mesh_vert @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    T_palm_world = np.linalg.inv(world_pose(data, "palm"))
    theirs = theirs @ T_palm_world[:3, :3].T + T_palm_world[:3, 3]
    distances = np.linalg.norm(mine[:, None] - theirs, axis=2)
    assert max(distances.min(axis=0).max(), distances.min(axis=1).max()) < 1e-8
    near = by_link["near"].shape
    assert isinstance(near, coal.Capsule)
    assert (near.radius, near.halfLength) == (0.008, 0.02)
    assert isinstance(by_link["slider"].shape, coal.Cylinder)
    np.testing.assert_allclose(by_link["wheel"].shape.halfSide, [0.01, 0.02, 0.03])


def test_a_mesh_may_be_turned_before(claw: Path) -> None:
    """Scaled alike along its axes; else no pose and scale say the same."""
    turned = 'scale="0.5 0.5 0.5" refpos="0.01 0 0" refquat="0.8 0.2 -0.4 0.4"'
    claw.write_text(HAND.replace('scale="0.5 1 2" refpos="0.01 0 0"', turned))
    test_shapes_are_where_mujoco_has_them(claw)
    claw.write_text(HAND.replace('refpos="0.01 0 0"', 'refquat="0.8 0.2 -0.4 0.4"'))
    with pytest.raises(RobotError, match="'wedge' is rotated and then scaled by"):
        tree_of(claw)


def test_limits_efforts_and_couplings(claw: Path) -> None:
    """A motor's is gear times its least bound both ways; one that only pushes has none known."""
    document, tree = tree_of(claw)
    limits = dict(zip(tree.joint_names, zip(tree.lower, tree.upper, strict=True), strict=True))
    assert limits["bend"] == pytest.approx((0.0, np.pi / 2))
    assert limits["reach"] == pytest.approx((0.0, 0.05))
    assert limits["roll"] == (-np.inf, np.inf)
    efforts = dict(
        zip(tree.joint_names, tree.pinocchio_model.upperEffortLimit.tolist(), strict=True)
    )
    assert efforts["spread"] == pytest.approx(10.0)
    assert efforts["bend"] == pytest.approx(0.7)
    assert efforts["curl"] == pytest.approx(0.6)
    assert efforts["reach"] >= 1e30
    (mimic,) = document.couplings
    assert (mimic.joint, dict(mimic.follows), mimic.offset) == ("end", {"curl": 0.8}, 0.0)


@pytest.mark.parametrize(
    ("equality", "joint", "follows", "offset"),
    [
        # MuJoCo's: q - ref of the one is a polynomial of q - ref of the other.
        ('<joint joint1="curl" joint2="bend" polycoef="0.1 0.5 0 0 0"/>', "curl", {"bend": 0.5},
         0.1 - 0.5 * np.radians(15)),
        # Without another joint it stays where it is put; of the rest MuJoCo takes no notice.
        ('<joint joint1="curl" polycoef="0.1 7 7 0 0"/>', "curl", {}, 0.1),
        ('<tendon tendon1="wire" polycoef="0.2 0 0 0 0"/>', "roll", {"spread": -0.25}, 0.05),
    ],
)  # fmt: skip
def test_equalities_couple_from_where_positions_begin(
    claw: Path, equality: str, joint: str, follows: dict[str, float], offset: float
) -> None:
    arms = '<joint joint="spread" coef="1"/><joint joint="roll" coef="4"/>'
    wire = f'<fixed name="wire">{arms}</fixed>' if "wire" in equality else ""
    text = HAND.replace("</tendon>", f"{wire}</tendon>")
    claw.write_text(text.replace("<tendon>", f"<equality>{equality}</equality><tendon>", 1))
    coupling = {m.joint: m for m in tree_of(claw)[0].couplings}[joint]
    assert dict(coupling.follows) == follows
    assert coupling.offset == pytest.approx(offset)


def test_a_tendon_of_something_else_is_not_the_hand_s(claw: Path) -> None:
    """A door beside the hand has a tendon over three joints; one of the hand may not join them."""
    leaf = '<body name="{0}"><joint name="hinge{0}"/><geom size="0.01"/>'
    door = "".join(map(leaf.format, "abc")) + "</body>" * 3
    arms = "".join(f'<joint joint="hinge{i}" coef="1"/>' for i in "abc")
    text = HAND.replace("</worldbody>", f"{door}</worldbody>")
    text = text.replace("</tendon>", f'<fixed name="wire">{arms}</fixed></tendon>')
    equality = '<equality><tendon tendon1="wire" polycoef="0.2 0 0 0 0"/></equality>'
    claw.write_text(text.replace("<tendon>", equality + "<tendon>"))
    assert set(tree_of(claw)[1].joint_names) == set(JOINTS)
    claw.write_text(claw.read_text().replace('joint="hingea"', 'joint="spread"'))
    with pytest.raises(RobotError, match=r"'no\. 1' couples joints of the hand to other joints"):
        tree_of(claw)


CHAINS = """
<mujoco>
  <compiler autolimits="true" angle="radian"/>
  <default><geom size="0.01"/><joint axis="0 1 0" range="0 1.5"/></default>
  <worldbody>
    <body name="palm"><geom/>
      <body><joint name="f1"/><geom/>
        <body pos="0 0 0.04"><joint name="f2" ref="0.2"/><geom/>
          <body pos="0 0 0.03"><joint name="f3"/><geom/></body></body></body>
      <body pos="0.05 0 0"><joint name="t1"/><geom/>
        <body pos="0 0 0.04"><joint name="t2"/><geom/>
          <body pos="0 0 0.03"><joint name="t3"/><geom/></body></body></body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="flexor">
      <joint joint="f1" coef="0.01"/><joint joint="f2" coef="0.006"/>
      <joint joint="f3" coef="-0.004"/>
    </fixed>
    <fixed name="belt" RANGE>
      <joint joint="t1" coef="0.01"/><joint joint="t2" coef="0.02"/><joint joint="t3" coef="0.04"/>
    </fixed>
    <fixed name="pair"><joint joint="t1" coef="0.01"/><joint joint="t2" coef="0.005"/></fixed>
  </tendon>
  <equality>EQUALITY</equality>
  <actuator>
    <motor name="pull" tendon="flexor" gear="2" ctrlrange="-5 40" forcerange="-3 50"/>
    <motor name="root" joint="t1" ctrlrange="-2 2"/>
    MOTORS
  </actuator>
</mujoco>
"""
HELD = 'range="0.0199 0.0201"'
LINKED = '<tendon tendon1="belt" tendon2="pair" polycoef="0.003 0.5 0 0 0"/>'


def chains(folder: Path, belt: str = HELD, equality: str = "", motors: str = "") -> Path:
    path = folder / "chains.xml"
    text = CHAINS.replace("RANGE", belt).replace("EQUALITY", equality).replace("MOTORS", motors)
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("belt", "equality", "lengths"),
    [(HELD, "", lambda belt, pair: belt - 0.02),
     ("", '<tendon tendon1="belt" polycoef="0.01 0 0 0 0"/>', lambda belt, pair: belt - 0.01),
     ("", LINKED, lambda belt, pair: belt - 0.5 * pair - 0.003)],
    ids=["range", "equality", "two tendons"],
)  # fmt: skip
def test_a_held_tendon_couples_any_number_of_joints(
    tmp_path: Path, belt: str, equality: str, lengths: Any
) -> None:
    """What MuJoCo says of the tendons' lengths holds wherever the independent joints stand."""
    path = chains(tmp_path, belt, equality)
    tree = tree_of(path)[1]
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    assert [tree.joint_names[index] for index in tree.coupling.leaders] == [
        "f1", "f2", "f3", "t1", "t2",
    ]  # fmt: skip
    for independent in np.random.default_rng(0).uniform(0.0, 1.0, (5, 5)):
        for name, value in zip(
            tree.joint_names, tree.coupling.S @ independent + tree.coupling.offset, strict=True
        ):
            data.joint(name).qpos = value
        mujoco.mj_fwdPosition(model, data)
        assert lengths(*data.ten_length[1:]) == pytest.approx(0.0, abs=1e-12)


def test_a_driven_tendon_is_an_actuator_with_mujoco_s_torques(tmp_path: Path) -> None:
    path = chains(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", GrasplessPinWarning)
        hand = Hand.from_urdf(path, effort_limits={"t2": 1.0})
    assert hand.actuated_joint_names[:3] == ("t1", "t2", "pull")
    assert hand.actuation.tendons == ("pull",)
    assert len(hand.actuation.passive) == 2
    np.testing.assert_array_equal([ends[2] for ends in hand.effort_limits], [-3.0, 40.0])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.ctrl[:] = [7.0, 0.0]
    mujoco.mj_forward(model, data)
    torques = [data.qfrc_actuator[model.joint(name).dofadr[0]] for name in hand.joint_names]
    felt = hand.actuation.from_joints.T @ torques
    np.testing.assert_allclose(felt, [0.0, 0.0, 7.0, 0.0, 0.0], atol=1e-12)
    declared = tmp_path / "chains.yaml"
    declared.write_text(
        "name: r\nurdf: chains.xml\ntendons: {own: {moment_arms: {f1: 0.02, f2: 0.01}}}\n"
        "effort_limits: {own: {limit: 9, source: me}}\n"
    )
    hand = Hand.assemble([Mount(declared)], effort_limits={"t2": 1.0, "f3": 1.0})
    assert hand.actuation.tendons == ("own",)


@pytest.mark.parametrize(
    ("motors", "said"),
    [('<motor name="e" joint="f2" ctrlrange="-1 1"/>', "motors of some of these joints"),
     ('<motor name="e" tendon="flexor" ctrlrange="0 1"/>', "other motors that pull the same way"),
     ('<motor name="e" body="palm"/>', "'e' acts through no joint and no fixed tendon")],
)  # fmt: skip
def test_motors_that_cannot_be_told_apart_are_named(tmp_path: Path, motors: str, said: str) -> None:
    if "body" in motors:
        motors = '<adhesion name="e" body="palm" ctrlrange="0 1" gain="1"/>'
    with capture() as told:
        hand = Hand.from_urdf(chains(tmp_path, motors=motors))
    messages = [one.message for one in told if one.code is FindingCode.SHARED_TENDON]
    assert messages
    assert said in messages[-1]
    assert ("pull" in hand.actuated_joint_names) == ("body" in motors)


def test_couplings_that_are_one_too_many_are_refused(tmp_path: Path) -> None:
    both = LINKED + '<joint joint1="t1" joint2="f1"/><joint joint1="t2" joint2="f1"/>'
    both += '<joint joint1="t3" joint2="f1"/>'
    with pytest.raises(RobotError, match="'belt' couples joints that all follow others"):
        tree_of(chains(tmp_path, equality=both.replace(LINKED, "")))


def test_what_mujoco_warns_of_leaves_no_file(
    claw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    claw.write_text(HAND.replace("<compiler ", '<compiler settotalmass="3" '))
    before = set(tmp_path.iterdir()), mujoco.get_mju_user_warning()
    with pytest.warns(GrasplessPinWarning, match="MuJoCo says: .*'settotalmass' is deprecated"):
        tree_of(claw)
    assert (set(tmp_path.iterdir()), mujoco.get_mju_user_warning()) == before


def test_it_is_a_hand(claw: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hand = Hand.from_urdf(claw, effort_limits={"reach": 5.0, "roll": 0.1})
    assert set(hand.joint_names) == set(JOINTS)
    assert "end" not in hand.actuated_joint_names
    report = audit_urdf(claw)
    assert report.loads
    assert set(report.joints) == set(JOINTS)


def test_a_capsule_of_a_urdf_keeps_its_shape(tmp_path: Path) -> None:
    """Pinocchio's reader of URDFs knows none and left it out."""
    urdf = tmp_path / "peg.urdf"
    urdf.write_text(
        '<robot name="peg"><link name="base"><collision><geometry>'
        '<capsule radius="0.01" length="0.06"/></geometry></collision></link></robot>'
    )
    (item,) = tree_of(urdf)[1].geometries
    assert isinstance(item.shape, coal.Capsule)
    assert (item.shape.radius, item.shape.halfLength) == (0.01, 0.03)


@pytest.mark.parametrize(("old", "new", "said"), [
    ('<joint name="roll" axis="1 0 0" limited="false" armature="0"/>',
     '<joint name="roll" type="ball"/>',
     "'roll' is a ball joint; use three hinge joints"),
    ("<tendon>", '<equality><connect name="bar" body1="tip" body2="wheel" anchor="0 0 0"/>'
     "</equality><tendon>", "'bar' closes a loop between 'tip' and 'wheel'"),
    ("<tendon>", '<equality><joint name="cam" joint1="curl" joint2="bend" polycoef="0 1 1 0 0"/>'
     "</equality><tendon>", "'cam' of joint 'curl' is not linear"),
    ('type="sphere" size="0.01"', 'type="ellipsoid" size="0.01 0.02 0.03"',
     "body 'tip' has the collision shape 'ellipsoid'; use boxes, spheres"),
    ('file="wedge.stl"', 'file="lost.stl"', "MuJoCo cannot read this MJCF (.*lost.stl"),
    ('class="finger" pos="0 0 0.02"', 'class="thumb"', "MuJoCo cannot read this MJCF"),
])  # fmt: skip
def test_what_a_urdf_cannot_say_is_refused_by_name(
    claw: Path, old: str, new: str, said: str
) -> None:
    assert old in HAND
    claw.write_text(HAND.replace(old, new))
    with pytest.raises(RobotError, match=said.replace("(", r"\(")) as caught:
        tree_of(claw)
    assert str(claw) in str(caught.value)


def test_visual_shapes_that_no_link_can_have_are_left_out(claw: Path) -> None:
    seen = '<geom type="{}" size="0.01 0.02 0.03" contype="0" conaffinity="0" mass="0.01"/>'
    both = seen.format("ellipsoid") + seen.format("box")
    claw.write_text(HAND.replace('<geom type="sphere" size="0.01" mass="0.01"/>', both))
    robot = read_robot(replace(describe_urdf(claw), visuals_collide=True))
    (tip,) = (link for link in robot.links if link.name == "tip")
    assert [type(one.shape).__name__ for one in tip.collisions] == ["Box"]
    assert len(tip.visuals) == 1


def test_a_figure_that_is_none_is_named(claw: Path) -> None:
    claw.write_text(HAND.replace('name="far" pos="0 0 0.06"', 'name="far" pos="0 0 2e12"'))
    with capture(), pytest.raises(RobotError, match="joint 'curl' has the value 2e"):
        read_robot(describe_urdf(claw))


def test_what_is_left_out_is_said(claw: Path) -> None:
    claw.write_text(HAND.replace('range="-30 30"', 'range="-30 30" stiffness="0.1"'))
    with pytest.warns(GrasplessPinWarning, match="springs; their torques are left out"):
        tree_of(claw)
    arms = '<joint joint="spread" coef="0.01"/><joint joint="roll" coef="0.02"/>'
    text = HAND.replace("</tendon>", f'<fixed name="wire">{arms}</fixed></tendon>')
    motor = '<motor name="e" tendon="wire" ctrlrange="-1 1"/></actuator>'
    claw.write_text(text.replace("</actuator>", motor))
    with pytest.warns(GrasplessPinWarning, match="spread: 0.01, roll: 0.02 m") as caught:
        tree = tree_of(claw)[1]
    assert "declare it under tendons" in str(caught[0].message)
    assert tree.pinocchio_model.upperEffortLimit[tree.joint_index["spread"]] >= 1e30


def test_a_tendon_s_motor_moves_the_leader_of_coupled_joints(claw: Path) -> None:
    """By hand: its force does c_curl + 0.8 c_end of work for each unit that the leader moves."""
    tendon = '<fixed name="wire"><joint joint="curl" coef="0.01"/><joint joint="end" coef="0.02"/>'
    text = HAND.replace("</tendon>", f"{tendon}</fixed></tendon>")
    old = '<motor name="c" joint="curl" gear="3" ctrlrange="-1 1" forcerange="-0.2 0.2"/>'
    assert old in text
    motor = '<motor name="c" tendon="wire" forcerange="-50 50"/>'
    claw.write_text(text.replace(old, motor))
    tree = tree_of(claw)[1]
    effort = tree.pinocchio_model.upperEffortLimit[tree.joint_index["curl"]]
    assert effort == pytest.approx(50.0 * (0.01 + 0.8 * 0.02))


def test_without_mujoco_it_says_what_to_install(
    claw: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RobotError, match=r"pip install 'graspless-pin\[simulate\]'"):
        tree_of(claw)


def test_several_trees_hang_on_the_world_until_one_is_chosen(claw: Path) -> None:
    text = HAND.replace('<body name="cube" pos="0 0 0.1"><freejoint/>',
                        '<body name="cube" pos="0 0 0.1"><joint name="door"/>')  # fmt: skip
    claw.write_text(text.replace("</actuator>", '<motor joint="door"/></actuator>'))
    document, tree = tree_of(claw)
    assert document.root == "world"
    assert "door" in tree.joint_names
    document, tree = tree_of(claw, root_link="near")
    assert document.root == "near"
    assert set(tree.joint_names) == {"curl", "end"}


@pytest.mark.parametrize("compiler", ["degree", "radian"])
def test_angles_that_look_like_radians_are_found(claw: Path, compiler: str) -> None:
    text = HAND.replace("0 90", "0 1.5").replace("-30 30", "-0.5 0.5")
    claw.write_text(text.replace('angle="degree"', f'angle="{compiler}"'))
    found = [one for one in audit_urdf(claw).findings if one.code is FindingCode.ANGLE_IN_RADIANS]
    assert len(found) == (compiler == "degree")
    assert all("larger than 1.5 degrees" in one.message for one in found)
    claw.write_text(HAND)
    assert FindingCode.ANGLE_IN_RADIANS not in {one.code for one in audit_urdf(claw).findings}
