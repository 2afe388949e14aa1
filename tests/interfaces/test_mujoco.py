"""Whole scenes from MuJoCo and back: against MuJoCo's own figures, by hand, and round trips."""

from __future__ import annotations

import re
import warnings
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspless_pin import Scene, load_scene
from graspless_pin.errors import ArgumentError, GrasplessPinWarning, RobotError, SceneError
from graspless_pin.findings import FindingCode, Severity, capture
from graspless_pin.geometry import Cone, HalfSpace, ManipulatedObject, Support
from graspless_pin.geometry.poses import rigid
from graspless_pin.interfaces.mujoco import scene_from_mjcf, scene_to_mjcf
from graspless_pin.problem import ControlMode
from graspless_pin.scene import Load
from graspless_pin.simulation.protocol import load_mujoco
from graspless_pin.simulation.scene_document import CUSTOM_TEXT

mujoco = load_mujoco()
EXAMPLES = Path(__file__).parents[2] / "examples"

TILT = np.radians(30.0)
PUSH = 3.0
"""N, the most that each finger gives, once by gear and ctrlrange and once by forcerange."""
PINCHED = f"""
<mujoco model="pinched">
  <compiler angle="radian"/>
  <option gravity="0 0 -10" cone="elliptic" impratio="100" timestep="0.001"
          integrator="implicitfast"/>
  <default><geom friction="0.1 0 0"/></default>
  <worldbody>
    <body name="slope" euler="0 {TILT} 0">
      <geom type="box" size="0.3 0.3 0.05" pos="0 0 -0.05" condim="1" priority="2"/>
    </body>
    <body name="box" euler="0 {TILT} 0"
          pos="{0.025 * np.sin(TILT)} 0 {0.025 * np.cos(TILT)}">
      <freejoint/>
      <geom type="box" size="0.03 0.02 0.025" mass="0.5"/>
    </body>
    <body name="left" euler="0 {TILT} 0"
          pos="{0.025 * np.sin(TILT)} 0.03 {0.025 * np.cos(TILT)}" gravcomp="1">
      <joint name="left" type="slide" axis="0 -1 0" range="-0.05 0.05"/>
      <geom type="sphere" size="0.01" mass="0.05" friction="0.6 0 0"/>
    </body>
    <body name="right" euler="0 {TILT} 0"
          pos="{0.025 * np.sin(TILT)} -0.03 {0.025 * np.cos(TILT)}" gravcomp="1">
      <joint name="right" type="slide" axis="0 1 0" range="-0.05 0.05"/>
      <geom type="sphere" size="0.01" mass="0.05" friction="0.6 0 0"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="left" joint="left" gear="2" ctrlrange="{-PUSH / 2} {PUSH / 2}"/>
    <motor name="right" joint="right" forcerange="{-PUSH} {PUSH}"/>
  </actuator>
</mujoco>"""


def model_of(text: str) -> Any:
    return mujoco.MjModel.from_xml_string(text)


def test_a_box_pinched_on_a_slope_has_the_margin_worked_out_by_hand(tmp_path: Path) -> None:
    """The slope bears the normal part; each finger half of what pulls down the slope."""
    (tmp_path / "pinched.xml").write_text(PINCHED)
    down = 0.5 * 10.0 * np.sin(TILT) / 2.0
    by_hand = (0.6 * PUSH - down) / np.hypot(1.0, 0.6)
    spec = mujoco.MjSpec.from_string(PINCHED)
    for source in (tmp_path / "pinched.xml", model_of(PINCHED), spec):
        scene = scene_from_mjcf(source).with_changes(cone="round")
        assert scene.hand is not None
        assert not scene.count_own_weight
        assert scene.hand.actuated_joint_names == ("left", "right")
        np.testing.assert_allclose(scene.hand.effort_limits[1], PUSH)
        found = {support.name: support.friction for support in scene.supports}
        assert found == {"slope": 0.0}
        assert scene.solve().margin == pytest.approx(by_hand, abs=1e-6)


@pytest.mark.parametrize("ends", [("left", "right"), ("right", "left")])
def test_one_motor_moves_both_fingers_that_an_equality_couples(ends: tuple[str, str]) -> None:
    """Each finger, a tree of its own, presses with half of the motor's force."""
    motor = f'<motor name="right" joint="right" forcerange="{-PUSH} {PUSH}"/>'
    assert motor in PINCHED
    couple = '<equality><joint joint1="{}" joint2="{}"/></equality></mujoco>'.format(*ends)
    text = PINCHED.replace(motor, "").replace('gear="2"', 'gear="4"').replace("</mujoco>", couple)
    scene = scene_from_mjcf(model_of(text)).with_changes(cone="round")
    assert scene.hand is not None
    np.testing.assert_allclose(scene.hand.effort_limits[1], 2.0 * PUSH)
    least = float(np.abs(scene.solve("torque", margin=0.0).torques).max())
    assert least == pytest.approx(0.5 * 10.0 * np.sin(TILT) / 0.6, abs=1e-4)


@pytest.mark.parametrize(("share", "stays"), [(1.15, True), (0.85, False)])
def test_mujoco_loses_the_box_where_the_scene_says(share: float, stays: bool) -> None:
    model = model_of(PINCHED)
    scene = scene_from_mjcf(model).with_changes(cone="round")
    least = float(np.abs(scene.solve("torque", margin=0.0).torques).max())
    assert least == pytest.approx(0.5 * 10.0 * np.sin(TILT) / 2.0 / 0.6, abs=1e-4)
    data = mujoco.MjData(model)
    data.ctrl[:] = share * least / 2.0, share * least
    start = None
    for _ in range(600):
        mujoco.mj_step(model, data)
        if start is None and data.time > 0.1:
            start = np.array(data.qpos[:3])
    moved = float(np.linalg.norm(data.qpos[:3] - start))
    assert (moved < 1e-3) == stays
    assert stays or moved > 1e-2


def scenes() -> list[Any]:
    return [
        "panda_carry_bar", "allegro_box_on_slope", "trihand_push_box", "two_hands_slide_crate",
        "allegro_mug_against_wall", "paper/sphere_on_slope",
    ]  # fmt: skip


@pytest.mark.parametrize("name", scenes())
def test_a_scene_comes_back_from_mujoco_as_the_same_problem(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrasplessPinWarning)  # a limit of 140 N looks odd
        scene = load_scene(EXAMPLES / f"{name}.yaml").with_changes(motion=None)
        back = scene_from_mjcf(model_of(scene_to_mjcf(scene)))
    before, after = contact_rows(scene), contact_rows(back)
    assert [row[0] for row in before] == [row[0] for row in after]
    for one, other in zip(before, after, strict=True):
        np.testing.assert_allclose(one[1], other[1], atol=1e-7)
    problem, again = scene.problem(), back.problem()
    order = [again.joint_names.index(joint) for joint in problem.joint_names]
    for field in ("lower_torque", "upper_torque", "gravity_torques"):
        values = getattr(again, field)[order]
        np.testing.assert_allclose(values, getattr(problem, field), atol=1e-9)
    np.testing.assert_allclose(again.external_wrench, problem.external_wrench, atol=1e-9)
    np.testing.assert_allclose(back.object.own_inertia, scene.object.own_inertia, atol=1e-9)
    assert back.solve().margin == pytest.approx(scene.solve().margin, abs=1e-6)
    assert back.solve("torque").margin == pytest.approx(scene.solve("torque").margin, abs=1e-6)
    assert back.solve_options == scene.solve_options
    assert back.controller == scene.controller


def test_a_cone_comes_back_as_a_hull_about_it() -> None:
    cone = ManipulatedObject.from_shape("cone", Cone(0.03, 0.06), rigid([0.0, 0.0, 0.03]), mass=1.0)
    floor = Support("floor", HalfSpace(), np.eye(4), friction=0.5)
    scene = Scene(name="cone", object=cone, supports=(floor,), friction={"default": 0.5})
    back = scene_from_mjcf(model_of(scene_to_mjcf(scene)))
    radii = np.linalg.norm(back.contacts.arrays.positions[:, :2], axis=1)
    np.testing.assert_allclose(radii, 0.03, rtol=2e-3)
    assert back.solve().found


def test_a_payload_comes_back_as_part_of_the_object() -> None:
    scene = load_scene(EXAMPLES / "paper" / "cuboid_at_rest.yaml")
    at = np.array([0.01, 0.02, 0.03])
    scene = scene.with_changes(loads=[Load("payload", mass=0.2, at=at)])
    back = scene_from_mjcf(model_of(scene_to_mjcf(scene)))
    made, target = scene.object, back.object
    center = (made.mass * made.center_of_mass + 0.2 * at) / (made.mass + 0.2)
    np.testing.assert_allclose(target.center_of_mass, center, atol=1e-9)
    assert target.mass == pytest.approx(made.mass + 0.2)
    arms = made.center_of_mass - center, at - center
    inertia = made.own_inertia + sum(
        mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        for mass, arm in zip((made.mass, 0.2), arms, strict=True)
    )
    np.testing.assert_allclose(target.own_inertia, inertia, atol=1e-9)
    assert back.solve().margin == pytest.approx(scene.solve().margin, abs=1e-6)


def contact_rows(scene: Scene) -> list[tuple[str, np.ndarray]]:
    """Contacts with friction, sorted: what touches, and the figures."""
    found, problem = scene.contacts, scene.problem()
    rows = np.column_stack([problem.positions, problem.normals, problem.friction])
    keys = np.round(rows, 5) + 0.0
    pairs = sorted(zip(found.bodies, keys.tolist(), rows.tolist(), strict=True))
    return [(body, np.array(row)) for body, _, row in pairs]


def test_control_modes_and_limits_that_differ_both_ways_come_back() -> None:
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml")
    assert scene.hand is not None
    changed = scene.with_changes({
        "hand.control": {"finger_1": "hybrid", "finger_2_spread": "position"},
        "hand.effort_limits": {"finger_3": [-0.2, 0.5]}, "max_normal_force": 20.0,
    }).with_changes(motion=None)  # fmt: skip
    back = scene_from_mjcf(model_of(scene_to_mjcf(changed)))
    assert back.hand is not None
    assert changed.hand is not None
    assert back.hand.control == changed.hand.control
    assert back.hand.control.joints["finger_2_spread"] is ControlMode.POSITION
    np.testing.assert_allclose(back.hand.effort_limits, changed.hand.effort_limits)
    assert back.max_normal_force == 20.0
    assert back.solve().margin == pytest.approx(changed.solve().margin, abs=1e-6)


TENDONS = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="ball" pos="0 0 -0.05"><freejoint/><geom size="0.04" mass="0.1"/></body>
  <body name="palm" pos="0 0 0.3" euler="0.3 0 0">
    <geom type="box" size="0.02 0.02 0.02"/>
    <body name="a1" pos="0.02 0 0"><joint name="a1" axis="0 1 0" range="-1 1" ref="0.1"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0.05 0 0"/>
      <body name="a2" pos="0.06 0 0"><joint name="a2" axis="0 1 0" range="-1 1"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 0.05 0 0"/>
        <body name="a3" pos="0.06 0 0"><joint name="a3" axis="0 1 0" range="-2 2"/>
          <geom type="capsule" size="0.01" fromto="0 0 0 0.05 0 0"/></body></body></body>
    <body name="b1" pos="-0.02 0 0"><joint name="b1" axis="0 1 0" range="-1 1"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 -0.05 0 0"/>
      <body name="b2" pos="-0.06 0 0"><joint name="b2" axis="1 1 0" range="-1 1"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 -0.05 0 0"/></body></body>
    <body name="c1" pos="0 0.04 0"><joint name="c1" axis="1 0 0" range="-1 1"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0 0.05 0"/>
      <body name="c2" pos="0 0.06 0"><joint name="c2" axis="1 0 0" range="-1 1"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 0 0.05 0"/></body></body>
  </body></worldbody>
  <tendon>
    <fixed name="pull"><joint joint="b1" coef="0.01"/><joint joint="b2" coef="0.004"/></fixed>
    <fixed name="sum"><joint joint="a3" coef="1"/><joint joint="a1" coef="-0.5"/>
      <joint joint="a2" coef="-0.25"/></fixed>
  </tendon>
  <equality>
    <tendon tendon1="sum" polycoef="0.07 0 0 0 0"/>
    <joint joint1="c2" joint2="c1" polycoef="0.05 0.8 0 0 0"/>
  </equality>
  <actuator>
    <motor joint="a1" ctrlrange="-1 1"/><motor joint="a2" ctrlrange="-2 2"/>
    <motor tendon="pull" gear="2" ctrlrange="0 10"/><motor joint="c1" forcerange="-3 3"/>
  </actuator>
  <keyframe><key name="bent" qpos="0 0 -0.05 1 0 0 0  0.2 0.3 0.22 0.1 -0.1 0.2 0.21"/></keyframe>
</mujoco>"""


def test_tendons_and_couplings_come_back() -> None:
    model = model_of(TENDONS)
    with capture():  # the third joint's place in the keyframe is not quite that of its coupling
        scene = scene_from_mjcf(model)
    back = scene_from_mjcf(model_of(scene_to_mjcf(scene)))
    one, other = scene.hand, back.hand
    assert one is not None
    assert other is not None
    assert len(one.actuation.tendons) == 1
    assert one.actuation.passive
    assert len(one.tree.coupling.leaders) == 5
    order = [other.actuated_joint_names.index(name) for name in one.actuated_joint_names]
    assert np.isinf(one.effort_limits).sum() == 0
    np.testing.assert_allclose(np.array(other.effort_limits)[:, order], one.effort_limits)
    joints = [other.joint_names.index(name) for name in one.joint_names]
    np.testing.assert_allclose(other.positions[joints], one.positions, atol=1e-12)
    found = other.actuation.from_joints[np.ix_(joints, order)]
    np.testing.assert_allclose(np.abs(found), np.abs(one.actuation.from_joints), atol=1e-12)
    gravity = np.array([1.0, 2.0, -9.0])
    np.testing.assert_allclose(
        np.abs(other.gravity_torques(gravity)[order]),
        np.abs(one.gravity_torques(gravity)),
        atol=1e-9,
    )


@pytest.mark.parametrize("factors", ["0.05 0", "0.05 0.8"])
def test_a_coupling_comes_back_whatever_its_factor(factors: str) -> None:
    text = TENDONS.replace('polycoef="0.05 0.8', f'polycoef="{factors}')
    with capture():
        scene = scene_from_mjcf(model_of(text))
        back = scene_from_mjcf(model_of(scene_to_mjcf(scene)))
    positions = []
    for hand in (scene.hand, back.hand):
        assert hand is not None
        moved = hand.with_configuration({"c1": 0.3, "a1": -0.1})
        positions.append(dict(zip(hand.joint_names, moved.positions.tolist(), strict=True)))
    assert positions[0] == pytest.approx(positions[1], abs=1e-12)
    offset, factor = map(float, factors.split())
    assert positions[1]["c2"] == pytest.approx(offset + factor * 0.3)


TWO_GEOMS = """
<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 0.1" {floor}/>
  <body name="tool" pos="0.1 0 0.02" euler="0 0 20">
    <freejoint/>
    <geom name="head" type="box" size="0.03 0.02 0.02" mass="0.3" {head}/>
    <geom name="look" type="sphere" size="0.05" mass="0.1" contype="0" conaffinity="0"/>
    <body name="handle" pos="0.1 0 0" euler="0 90 0">
      <geom name="grip" type="cylinder" size="0.02 0.06" pos="0 0.01 0.02" mass="0.2" {head}/>
    </body>
  </body>
</worldbody>{contact}</mujoco>"""


def test_an_object_of_several_geoms_has_mujocos_energy_and_is_where_its_geoms_are() -> None:
    model = model_of(TWO_GEOMS.format(floor="", head="", contact=""))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    data.qpos[3:7] = rng.normal(size=4)
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    data.qvel[:] = rng.normal(size=6)
    mujoco.mj_forward(model, data)
    mujoco.mj_energyVel(model, data)
    made = scene_from_mjcf(model, data).object
    v, omega = data.qvel[:3], data.xmat[1].reshape(3, 3) @ data.qvel[3:]
    arm = made.center_of_mass_world - data.xpos[1]
    twist = np.concatenate([v + np.cross(omega, arm), omega])
    assert 0.5 * twist @ made.spatial_inertia() @ twist == pytest.approx(data.energy[1], rel=1e-9)
    np.testing.assert_allclose(made.center_of_mass_world, data.subtree_com[1], atol=1e-12)
    geoms = [model.geom(name).id for name in ("head", "grip")]
    poses = [body.T_world_geometry for body in made.collision_bodies()]
    np.testing.assert_allclose([T[:3, 3] for T in poses], data.geom_xpos[geoms], atol=1e-12)
    axes = data.geom_xmat[geoms].reshape(-1, 3, 3)
    np.testing.assert_allclose([T[:3, :3] for T in poses], axes, atol=1e-12)
    moved = made.with_pose(np.eye(4)).collision_bodies()
    steps = [made.T_world_object @ body.T_world_geometry for body in moved]
    np.testing.assert_allclose(steps, poses, atol=1e-12)


@pytest.mark.parametrize(
    ("floor", "head", "contact"),
    [
        *(
            (f'friction="{one}" priority="{rank}" condim="{dim}"', f'friction="{other}"', "")
            for one, other, rank, dim in product((0.2, 0.9), (0.5,), (-1, 0, 1), (1, 3))
        ),
        ("", "", '<contact><pair geom1="floor" geom2="head" friction="0.3 0.3"/></contact>'),
    ],
)
def test_friction_of_a_pair_is_what_mujoco_computes_with(
    floor: str, head: str, contact: str
) -> None:
    text = TWO_GEOMS.format(floor=floor, head=head, contact=contact)
    text = text.replace('name="grip"', 'name="grip" contype="0" conaffinity="0"')
    model = model_of(text)
    data = mujoco.MjData(model)
    data.qpos[2] -= 1e-4
    mujoco.mj_forward(model, data)
    assert data.ncon
    with capture():  # the two geoms may differ
        [support] = scene_from_mjcf(model, data).supports
    theirs = data.contact[0]
    assert support.friction == pytest.approx(theirs.friction[0] if theirs.dim > 1 else 0.0)


def test_what_cannot_be_taken_over_is_named() -> None:
    more = """
      <body name="drawer" pos="0 0.3 0"><joint name="slides" type="slide"/>
        <geom type="box" size="0.1 0.1 0.1"/></body>
      <body name="egg" pos="0 -0.3 0"><geom type="ellipsoid" size="0.1 0.1 0.05"/></body>
      <geom name="sticky" type="box" size="1 1 0.1" pos="0 0 -1" condim="4"/>
      <geom name="other_kind" type="box" size="1 1 0.1" pos="0 0 -2" contype="4" conaffinity="4"/>
    """
    tied = '<equality><weld name="glue" body1="tool"/></equality>'
    text = TWO_GEOMS.format(floor="", head="", contact=tied).replace(
        "</worldbody>", more + "</worldbody>"
    )
    model = model_of(text)
    data = mujoco.MjData(model)
    data.xfrc_applied[1, :3] = 0.0, 1.0, 2.0
    with capture() as found:
        scene = scene_from_mjcf(model, data)
    codes = {one.code for one in found}
    assert codes == {FindingCode.LEFT_OUT_OF_MJCF, FindingCode.NO_MOTORS}
    [graver] = [one for one in found if one.severity is Severity.SERIOUS]
    assert graver.subject == "hand" and "no joint torques" in graver.message
    assert scene.findings[0] == graver and "hand_body" in graver.advice
    assert {one.subject for one in found} == {"drawer", "geom_7", "sticky", "glue", "hand"}
    assert any("ellipsoid" in one.message for one in found)
    assert {support.name for support in scene.supports} == {"floor", "drawer", "sticky"}
    assert set(scene.load_findings) == set(found)
    [load] = scene.loads
    np.testing.assert_allclose(load.force, [0.0, 1.0, 2.0])
    # MuJoCo's forces act at the centre of mass of the body; that of the whole object is elsewhere.
    body_center = mujoco_center(model, 1)
    lever = body_center - scene.object.center_of_mass_world
    np.testing.assert_allclose(load.moment, np.cross(lever, load.force), atol=1e-12)


@pytest.mark.parametrize(
    ("option", "subjects"),
    [
        ('<option><flag contact="disable"/></option>', {"contact"}),
        ('<option><flag actuation="disable"/></option>', {"actuation"}),
        ('<option actuatorgroupdisable="0 2"/>', {"actuatorgroupdisable"}),
        ('<option o_friction="1 1 0 0 0"><flag override="enable"/></option>', {"override"}),
        ('<option o_friction="1 1 0 0 0"/>', set()),
    ],
)
def test_options_that_switch_off_what_counts_here_are_named(option: str, subjects: set) -> None:
    text = PINCHED.replace("<worldbody>", option + "<worldbody>")
    with capture() as found:
        scene = scene_from_mjcf(model_of(text))
    assert {one.subject for one in found} == subjects
    expected = scene_from_mjcf(model_of(PINCHED)).solve()
    assert scene.solve().margin == pytest.approx(expected.margin)


def mujoco_center(model: Any, body: int) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return np.array(data.xipos[body])


@pytest.mark.parametrize("data", ["[1]", "5", "null", "{"])
def test_a_custom_text_that_is_no_object_is_refused(data: str) -> None:
    custom = f'</worldbody><custom><text name="{CUSTOM_TEXT}" data="{data}"/></custom>'
    with pytest.raises(SceneError, match=f"custom text '{CUSTOM_TEXT}' is not (a )?JSON"):
        scene_from_mjcf(model_of(PINCHED.replace("</worldbody>", custom)))


def test_object_keyframe_and_hand_are_chosen_by_name() -> None:
    text = PINCHED.replace(
        "</worldbody>",
        '<body name="ball" pos="0 0 1"><freejoint/><geom size="0.02" mass="0.1"/></body>'
        "</worldbody>"
        '<keyframe><key name="apart" qpos="0 0 2 1 0 0 0  -0.01 0.02  0 0 3 1 0 0 0"/>'
        '<key name="again" qpos="0 0 2 1 0 0 0  -0.01 0.02  0 0 3 1 0 0 0"/></keyframe>',
    )
    model = model_of(text)
    with pytest.raises(ArgumentError, match=r"keyframe: .*'apart', 'again'"):
        scene_from_mjcf(model, object_body="ball")
    with pytest.raises(ArgumentError, match=r"object_body: .*box, ball"):
        scene_from_mjcf(model, keyframe="apart")
    with pytest.raises(ArgumentError, match=r"unknown keyframe 'apat'.*apart"):
        scene_from_mjcf(model, keyframe="apat")
    wrong: Any
    for wrong in (0.5, True, [0], -1, 2):
        with pytest.raises(ArgumentError, match=re.escape(f"keyframe: is {wrong!r}; it must be")):
            scene_from_mjcf(model, keyframe=wrong)
    with pytest.raises(ArgumentError, match=r"keyframe: is 0, but the model has no keyframes"):
        scene_from_mjcf(model_of(PINCHED), keyframe=0)
    with pytest.raises(ArgumentError, match=r"data: is 5; it must be the model's MjData"):
        scene_from_mjcf(model, data=5)
    with pytest.raises(ArgumentError, match=r"unknown body 'bal'.*ball"):
        scene_from_mjcf(model, keyframe=0, object_body="bal")
    with pytest.raises(SceneError, match="'left' is moved by motors"):
        scene_from_mjcf(model, keyframe=0, object_body="left")
    with pytest.raises(ArgumentError, match="source: needs the path"):
        scene_from_mjcf(3)
    with pytest.warns(GrasplessPinWarning, match="body 'box' can move"):
        scene = scene_from_mjcf(model, keyframe="apart", object_body="ball")
    assert scene.object.T_world_object[2, 3] == 3.0
    assert scene.hand is not None
    assert scene.hand.q == {"left": -0.01, "right": 0.02}
    with capture() as found:
        alone = scene_from_mjcf(model, keyframe=1, object_body="ball", hand_body="left")
    assert {one.subject for one in found} == {"box", "right"}
    assert alone.hand is not None
    assert alone.hand.joint_names == ()


def test_objects_that_are_not_rigid_or_of_no_known_shape_are_refused() -> None:
    text = TWO_GEOMS.format(floor="", head="", contact="")
    hinged = text.replace('<geom name="grip"', '<joint name="hinge"/><geom name="grip"')
    with pytest.raises(SceneError, match=r"'tool' has joints inside \('hinge'\)"):
        scene_from_mjcf(model_of(hinged))
    with pytest.raises(RobotError, match="'tool' has the collision shape 'ellipsoid'"):
        scene_from_mjcf(
            model_of(text.replace('name="head" type="box"', 'name="head" type="ellipsoid"'))
        )


def test_the_text_of_an_mjcf_is_not_taken_for_its_path() -> None:
    with pytest.raises(ArgumentError, match=r"source: is the text of an MJCF.*MjSpec.from_string"):
        scene_from_mjcf(TWO_GEOMS)


def test_what_no_mjcf_can_say_is_refused() -> None:
    scene = load_scene(EXAMPLES / "paper/sphere_on_slope.yaml").with_changes(motion=None)
    for change, words in (
        ({"loads": [Load("cable", force=[0.0, 0.0, 1.0])]}, "loads: 'cable'"),
        ({"given_contacts": ()}, "contacts: are given"),
    ):
        with pytest.raises(SceneError, match=words):
            scene_to_mjcf(scene.with_changes(**change))


def test_a_scene_of_a_file_is_saved_and_one_of_a_model_is_not(tmp_path: Path) -> None:
    (tmp_path / "pinched.xml").write_text(PINCHED)
    scene = scene_from_mjcf(tmp_path / "pinched.xml")
    again = load_scene(scene.save(tmp_path / "pinched.yaml"))
    assert again.solve().margin == pytest.approx(scene.solve().margin, abs=1e-9)
    with pytest.raises(SceneError, match="was not read from a file"):
        scene_from_mjcf(model_of(PINCHED)).save(tmp_path / "model.yaml")


def test_weight_that_an_mjcf_takes_off_the_joints_is_told_where_it_counts(tmp_path: Path) -> None:
    (tmp_path / "pinched.xml").write_text(PINCHED)
    saved = tmp_path / "pinched.yaml"
    scene_from_mjcf(tmp_path / "pinched.xml").save(saved)
    told = "gravcomp for 'left', 'right', but here joints carry the weight"
    assert told not in str(load_scene(saved).findings)
    saved.write_text(saved.read_text().replace(", count_own_weight: false", ""))
    (found,) = load_scene(saved).findings
    assert (found.code, found.key) == (FindingCode.LEFT_OUT_OF_MJCF, ("hand", "count_own_weight"))
    assert told in found.message


def test_a_scene_of_several_geoms_and_meshes_without_files_is_saved(tmp_path: Path) -> None:
    mesh = (
        '<asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 .1 .1 0 0 0 .05 0 .1 .05"/></asset>'
    )
    block = '<geom name="block" type="mesh" mesh="wedge" mass="0.1" pos="0 0 0.05"/>'
    text = TWO_GEOMS.format(floor="", head="", contact="").replace("<mujoco>", f"<mujoco>{mesh}")
    scene = scene_from_mjcf(
        model_of(text.replace('<geom name="look"', f'{block}<geom name="look"'))
    )
    again = load_scene(scene.save(tmp_path / "several.yaml"))
    assert [part.kind for part in again.object.shape.parts] == ["box", "hull", "cylinder"]  # pyright: ignore
    np.testing.assert_allclose(again.object.own_inertia, scene.object.own_inertia, atol=1e-12)
    one, two = scene.problem(), again.problem()
    np.testing.assert_allclose(two.positions, one.positions, atol=1e-9)
    assert again.solve().margin == pytest.approx(scene.solve().margin, abs=1e-9)
