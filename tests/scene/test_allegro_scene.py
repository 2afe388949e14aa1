"""The Allegro example against Pinocchio alone, from its JSON document, and under rigid motions."""

import copy
import json

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
from example_robot_data import load as load_example  # pyright: ignore[reportMissingImports]
from scene_tools import EXAMPLES, content, loaded
from scipy.spatial.transform import Rotation

from graspless_pin import load_scene
from graspless_pin.report import solution_document

FILES = [EXAMPLES / f"{name}.yaml" for name in ("allegro_box_on_slope", "allegro_push_up_slope")]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_torques_are_rneas_under_the_contact_forces(file):
    """As an outsider reads them in the JSON document, with a bare model of the hand."""
    scene = load_scene(file)
    document = json.loads(json.dumps(solution_document(scene.solve("margin"), scene)))
    model = load_example("allegro_right_hand").model
    q = np.array([document["hand"]["q"][name] for name in model.names[1:]])
    T_world_base = pin.SE3(np.array(document["hand"]["base_pose"]))
    model.gravity.linear = T_world_base.rotation.T @ np.array(document["gravity"])
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    external = [pin.Force.Zero() for _ in range(model.njoints)]
    on_hand = [one for one in document["contacts"] if model.existBodyName(one["bodies"][0])]
    assert len(on_hand) >= 3
    for contact in on_hand:
        joint = model.frames[model.getFrameId(contact["bodies"][0], pin.BODY)].parentJoint
        on_link = -np.array(contact["force"])
        wrench = pin.Force(np.r_[on_link, np.cross(contact["position"], on_link)])
        external[joint] += (T_world_base * data.oMi[joint]).actInv(wrench)
    torques = pin.rnea(model, data, q, np.zeros(16), np.zeros(16), external)
    expected = dict(zip(model.names[1:], torques, strict=True))
    reported = {joint["name"]: joint["torque"] for joint in document["joints"]}
    assert reported == pytest.approx(expected, abs=1e-8)
    assert max(map(abs, reported.values())) > 0.05


def moved_scene(folder, data, R, shift):
    """The same scene seen from another world frame: every pose and vector of the file moved."""
    data = copy.deepcopy(data)

    def move(pose):
        own = Rotation.from_euler("xyz", pose.get("rpy", [0, 0, 0])).as_matrix()
        position = R @ np.array(pose.get("position", [0, 0, 0]), dtype=float) + shift
        return {"position": position.tolist(), "matrix": (R @ own).tolist()}

    def turn(vector):
        return (R @ np.array(vector, dtype=float)).tolist()

    data["gravity"] = turn(data["gravity"])
    data["tangent_axes"] = [turn(axis) for axis in data["tangent_axes"]]
    data["hand"]["base_pose"] = move(data["hand"]["base_pose"])
    data["object"]["pose"] = move(data["object"]["pose"])
    for support in data["supports"]:
        support["pose"] = move(support["pose"])
    if "motion" in data:
        twist = data["motion"]["object_twist"]
        data["motion"]["object_twist"] = {key: turn(value) for key, value in twist.items()}
    return loaded(folder, data)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_rigid_motion_of_the_whole_scene_changes_only_the_frame(tmp_path, file, seed):
    rng = np.random.default_rng(seed)
    R = Rotation.random(rng=rng).as_matrix()
    shift = rng.uniform(-2, 2, 3)
    data = content(file)
    data["tangent_axes"].append([0, 1, 0])  # for the fingers: no axis is left to the default rule
    scene, moved = loaded(tmp_path, data), moved_scene(tmp_path, data, R, shift)
    assert moved.contacts.bodies == scene.contacts.bodies
    here, there = scene.problem(), moved.problem()
    blocks = here.jacobian.reshape(-1, 3, 16)
    for name, expected, tolerance in (
        ("positions", here.positions @ R.T, 1e-7),
        ("normals", here.normals @ R.T, 1e-7),
        ("tangents", np.einsum("ij,mjk->mik", R, here.tangents), 1e-6),
        ("sliding", here.sliding @ R.T, 1e-7),
        ("jacobian", np.einsum("ij,mjk->mik", R, blocks).reshape(-1, 16), 1e-7),
        ("gravity_torques", here.gravity_torques, 1e-9),
        ("friction", here.friction, 0.0),
    ):
        np.testing.assert_allclose(getattr(there, name), expected, atol=tolerance, err_msg=name)
    best, other = scene.solve("margin"), moved.solve("margin")
    for first, second in ((best, other), (scene.solve("torque"), moved.solve("torque"))):
        assert first.found and second.found
        assert second.margin == pytest.approx(first.margin, abs=1e-6)
        assert second.max_torque == pytest.approx(first.max_torque, abs=1e-7)
    np.testing.assert_allclose(other.contact_forces, best.contact_forces @ R.T, atol=1e-5)
    np.testing.assert_allclose(other.torques, best.torques, atol=1e-6)
