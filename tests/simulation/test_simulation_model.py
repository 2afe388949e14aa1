"""The MuJoCo model of a scene against the scene: shapes, poses, inertias, motors, friction."""

from dataclasses import replace

import numpy as np
import pytest
from tests.geometry.planar_fingers import TWO_LINKS, jaws, plate_above
from tests.scene.scene_tools import EXAMPLES, PAPER, content, loaded

from graspless_pin import Hand, load_scene
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry import Box, HalfSpace, ManipulatedObject, Support
from graspless_pin.geometry.contact.distances import separation
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.joint_columns import jointed_bodies
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.scene import Scene
from graspless_pin.simulation import simulate, simulation_model
from graspless_pin.simulation.protocol import load_mujoco

mujoco = load_mujoco()

BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"
MUG = EXAMPLES / "allegro_mug_against_wall.yaml"
STILL = np.eye(4)


def hand_of(scene: Scene) -> Hand:
    assert scene.hand is not None
    return scene.hand


def built(scene: Scene, torques=None, **options):
    """The model of a scene in MuJoCo at its start, and what it was made of."""
    given = np.zeros(scene.problem().joint_count) if torques is None else torques
    made = simulation_model(scene, given, **options)
    model = mujoco.MjModel.from_xml_string(made.xml)
    # Of shapes that are apart, distances are those of the detector that contacts go without.
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return made, model, data


@pytest.mark.parametrize("file", [BALL, MUG, PAPER / "cuboid_at_rest.yaml"], ids=lambda f: f.stem)
def test_distances_between_shapes_are_the_scenes(file):
    """MuJoCo's distances from the object to each hand shape against coal's."""
    scene = load_scene(file)
    _, model, data = built(scene)
    pieces = scene.object.placed_bodies
    checked = 0
    for number, body in enumerate(hand_of(scene).placed_bodies):
        geom = model.geom(f"hand/{body.name}/{number}").id
        for part in range(0, len(pieces), 7):
            own = model.geom(f"object/{part}").id
            found = mujoco.mj_geomDistance(model, data, own, geom, 1.0, None)
            expected = separation(pieces[part], body).distance
            assert found == pytest.approx(expected, abs=2e-5), body.name
            checked += 1
    assert checked > 1


@pytest.mark.parametrize("turn", np.arange(0.0, 0.2, 0.05).tolist())
def test_a_cone_is_as_round_as_the_scenes(turn, tmp_path):
    """MuJoCo has no cones: its hull's edges stand off by next to nothing, and its faces not."""
    data = content(BALL)
    data["object"] |= {
        "shape": {"type": "cone", "radius": 0.1, "length": 0.02},
        "pose": {"position": [0, 0, 0.01], "rpy": [0, 0, turn]},
    }
    data["supports"] = [{"name": "table", "shape": {"type": "half_space"}}]
    data["hand"]["base_pose"] = {"position": [0.3, 0, 0.01]}
    scene = loaded(tmp_path, {key: data[key] for key in ("friction", "hand", "object", "supports")})
    _, model, state = built(scene)
    (cone,) = scene.object.placed_bodies
    for number, body in enumerate(hand_of(scene).placed_bodies[:3]):
        geom = model.geom(f"hand/{body.name}/{number}").id
        found = mujoco.mj_geomDistance(model, state, model.geom("object/0").id, geom, 1.0, None)
        expected = separation(cone, body).distance
        assert found == pytest.approx(expected, abs=3e-5), body.name
        assert found < expected + 5e-7, "a body that touches the cone does not touch its hull"


def test_masses_and_weights_of_the_joints_that_move_are_the_hands():
    scene = load_scene(BALL)
    _, model, data = built(scene)
    hand = hand_of(scene)
    free = [model.joint(index).name for index in range(model.njnt - 1)]
    assert free == [f"joint_{index}.0" for index in (0, 1, 2, 3, 8, 9, 10, 11)]
    columns = [hand.actuated_joint_names.index(name) for name in free]
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    expected = hand.joint_inertia()[np.ix_(columns, columns)] + 1e-4 * np.eye(8)
    np.testing.assert_allclose(M[:8, :8], expected, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(
        data.qfrc_bias[:8], hand.gravity_torques(scene.gravity)[columns], atol=1e-9
    )


def test_the_object_has_its_mass_and_inertia():
    scene = load_scene(MUG)
    made, model, data = built(scene)
    body = model.body("object")
    assert body.mass == pytest.approx(scene.object.mass)
    np.testing.assert_allclose(
        data.body("object").xipos, made.object.center_of_mass_world, atol=1e-12
    )
    # It is where all contacts touch: next to where the scene has it.
    np.testing.assert_allclose(
        made.object.center_of_mass_world, scene.object.center_of_mass_world, atol=2e-6
    )
    R = data.body("object").ximat.reshape(3, 3)
    turn = made.object.T_world_object[:3, :3]
    own = turn @ scene.object.own_inertia @ turn.T
    np.testing.assert_allclose(R @ np.diag(body.inertia) @ R.T, own, rtol=1e-6, atol=1e-12)


def test_a_body_on_a_joint_has_its_axis_and_its_parent():
    hand = hand_of(load_scene(BALL))
    bodies = jointed_bodies(hand)
    step = 1e-6
    for index, body in enumerate(bodies):
        moved = jointed_bodies(hand.with_configuration({body.joint: hand.q[body.joint] + step}))
        turn = moved[index].T_world_body[:3, :3] @ body.T_world_body[:3, :3].T
        axis = np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) / step
        np.testing.assert_allclose(axis, body.axis, atol=1e-5)
        assert not body.linear
        if body.parent is not None:
            before, after = bodies[body.parent], moved[body.parent]
            np.testing.assert_array_equal(before.T_world_body, after.T_world_body)


def test_friction_is_the_other_bodys_and_is_multiplied():
    scene = load_scene(BALL)
    _, model, _ = built(scene, friction_factor=0.5)
    assert model.geom("support/slope/0").friction[0] == pytest.approx(0.175)
    assert model.geom("hand/link_3.0_tip/5").friction[0] == pytest.approx(0.45)
    assert model.geom("object/0").priority[0] < model.geom("support/slope/0").priority[0]


def test_the_document_is_complete_and_holds_the_torques():
    scene = load_scene(BALL)
    solution = scene.solve()
    made, model, _ = built(scene, solution.torques)
    names = hand_of(scene).actuated_joint_names
    expected = [solution.torques[names.index(motor)] for motor in made.motors]
    np.testing.assert_array_equal(made.commands, expected)
    np.testing.assert_array_equal(model.key("torques").ctrl, made.commands)
    assert model.opt.cone != mujoco.mjtCone.mjCONE_PYRAMIDAL
    weight = hand_of(scene).gravity_torques(scene.gravity)
    np.testing.assert_allclose(made.idle, [weight[names.index(motor)] for motor in made.motors])
    # A hand that weighs nothing falls nowhere.
    scene = load_scene(BALL).with_changes(count_own_weight=False)
    _, model, data = built(scene)
    np.testing.assert_allclose((data.qfrc_bias - data.qfrc_passive)[: model.nu], 0.0, atol=1e-12)


def test_a_hybrid_finger_presses_as_commanded(tmp_path):
    data = content(PAPER / "cuboid_at_rest.yaml")
    data["hand"]["control"] = {"finger_6/finger": "hybrid"}
    scene = loaded(tmp_path, data)
    solution = scene.solve("torque", margin=1.0)
    found = simulate(scene, solution.torques, seconds=0.5)
    assert found.model.motors == ("finger_1/hinge", "finger_6/finger.normal_force")
    assert found.outcome == "held"
    commanded = solution.torques[1]
    assert commanded > 1.0
    for run in found.runs:
        assert run.normal_forces["finger_6/tip"] == pytest.approx(commanded, rel=2e-3)


def test_coupled_joints_share_the_torque_of_their_motor(tmp_path):
    hand = jaws(tmp_path)
    box = ManipulatedObject.from_shape("box", Box((0.1, 0.04, 0.04)), STILL, mass=0.2)
    table = Support("table", HalfSpace(), pose_matrix((0.0, 0.0, -0.02)))
    # Friction on the table could bear a difference between the two.
    friction = {"hand": 0.5, "supports": 0.0}
    scene = Scene("jaws", box, friction, hand=hand, supports=(table,))
    found = simulate(scene, [3.0], seconds=0.3)
    assert found.model.motors == ("left_slide",)
    assert found.outcome == "held"
    for run in found.runs:
        assert run.joint_moves.shape[1] == 2
        forces = run.normal_forces
        assert forces["left"] == pytest.approx(1.5, rel=5e-3)
        assert forces["right"] == pytest.approx(1.5, rel=5e-3)


def test_a_tendons_tension_turns_into_torques_of_its_joints(tmp_path):
    (tmp_path / "two_links.urdf").write_text(f'<robot name="two_links">{TWO_LINKS}</robot>')
    file = tmp_path / "robot.yaml"
    file.write_text(
        "name: tendon\nurdf: two_links.urdf\nfingers: {finger: {joints: [first, second]}}\n"
        "tendons: {cable: {moment_arms: {first: 0.01, second: 0.02}}}\n"
        "effort_limits: {cable: {limit: 100, source: made up}}\n"
    )
    hand = Hand.assemble([Mount(file)])
    scene = Scene("tendon", plate_above(0.01), {"default": 0.5}, hand=hand)
    assert scene.problem().joint_names == ("cable", "cable.passive_1")
    made, _, _ = built(scene, [10.0, 0.0])
    assert made.motors == ("first", "second")
    np.testing.assert_allclose(made.commands, [0.1, 0.2], atol=1e-12)


def test_a_link_inside_a_support_does_not_meet_it():
    scene = load_scene(BALL)
    tip = hand_of(scene).pose_of("link_3.0_tip")[:3, 3]
    block = Support("block", Box((0.02, 0.02, 0.02)), pose_matrix(tip))
    crowded = scene.with_changes(supports=(*scene.supports, block))
    made, model, data = built(crowded)
    assert ("link_3.0_tip", "block") in made.left_out
    assert built(scene)[0].left_out == ()
    tips = {model.geom(int(geom)).name for contact in data.contact for geom in contact.geom}
    assert "support/block/0" not in {name for name in tips if name.startswith("hand")}


def test_what_moves_bad_torques_and_missing_friction_are_refused(tmp_path):
    moving = load_scene(PAPER / "cuboid_sliding_up.yaml")
    with pytest.raises(SceneError, match=r"cuboid_sliding_up.yaml: motion: .* leave the key out"):
        simulation_model(moving, np.zeros(2))
    scene = load_scene(PAPER / "cuboid_at_rest.yaml")
    belt = replace(scene.supports[0], velocity=np.array([0.1, 0, 0, 0, 0, 0]))
    with pytest.raises(SceneError, match="support 'slope' moves"):
        simulation_model(scene.with_changes(supports=(belt,)), np.zeros(2))
    scene = load_scene(PAPER / "cuboid_at_rest.yaml")
    with pytest.raises(ArgumentError, match=r"torques: has shape \(3,\)"):
        simulation_model(scene, np.zeros(3))
    bare = scene.with_changes(friction={"hand": 0.3}, given_contacts=None)
    with pytest.raises(SceneError, match=r"cuboid_at_rest.yaml: .* 'slope'"):
        simulation_model(bare, np.zeros(2))
