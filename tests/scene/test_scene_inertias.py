"""Inertias of a scene's problem: of the object, the hand, hybrid fingers, and in its documents."""

import json

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
from example_robot_data import load as load_example  # pyright: ignore[reportMissingImports]
from scene_tools import ALLEGRO, BOX, EXAMPLES, PAPER, content, hand_of, loaded

from graspless_pin import load_scene
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.problem.inertias import hybrid_contacts, moving_joints
from graspless_pin.report.document import solution_document, write_document
from graspless_pin.report.provenance import problem_sha256, same_problem
from graspless_pin.report.reading import read_solution
from graspless_pin.scene.scene import Scene


def known(inertia: np.ndarray | None) -> np.ndarray:
    assert inertia is not None
    return inertia


def test_the_hand_has_pinocchios_joint_space_inertia():
    scene = load_scene(ALLEGRO)
    model = load_example("allegro_right_hand").model
    q = np.array([hand_of(scene).q[name] for name in model.names[1:]])
    expected = pin.crba(model, model.createData(), q)
    problem = scene.problem()
    np.testing.assert_allclose(known(problem.joint_inertia), expected, atol=1e-14)
    assert not known(problem.joint_inertia).flags.writeable
    np.testing.assert_array_equal(moving_joints(problem), range(16))


def test_the_object_has_the_inertia_of_its_shape_in_world_axes(tmp_path):
    data = content(BOX)
    data["object"] |= {"shape": {"type": "box", "size": [0.1, 0.2, 0.3]}, "mass": 12.0}
    data["object"]["pose"] = {"rpy": [0.0, 0.0, np.pi / 2]}
    data["contacts"] = [{"body": "floor", "position": [0, 0, -0.1], "normal": [0, 0, 1]}]
    problem = loaded(tmp_path, data).problem()
    expected = np.diag([12.0, 12.0, 12.0, 0.10, 0.13, 0.05])
    np.testing.assert_allclose(known(problem.object_inertia), expected, atol=1e-12)
    data["object"]["inertia"] = [0.3, 0.4, 0.5]
    stated = known(loaded(tmp_path, data).problem().object_inertia)
    np.testing.assert_allclose(stated[3:, 3:], np.diag([0.4, 0.3, 0.5]), atol=1e-12)
    data["object"]["inertia"] = [[0.3, 0.1, 0], [0.1, 0.4, 0], [0, 0, 0.5]]
    stated = known(loaded(tmp_path, data).problem().object_inertia)
    np.testing.assert_allclose(stated[3:5, 3:5], [[0.4, -0.1], [-0.1, 0.3]], atol=1e-12)


def test_a_hybrid_finger_has_no_inertia(tmp_path):
    data = content(PAPER / "cuboid_at_rest.yaml")
    data["hand"]["control"] = {"finger_6/finger": "hybrid"}
    problem = loaded(tmp_path, data).problem()
    np.testing.assert_allclose(known(problem.joint_inertia), np.diag([1e-4, 0.0]), atol=1e-15)
    np.testing.assert_array_equal(hybrid_contacts(problem), [-1, 1])
    np.testing.assert_array_equal(moving_joints(problem), [0])


def massless(folder) -> Scene:
    """The paper's cuboid, one of its levers without a mass."""
    lever = (EXAMPLES.parent / "robots" / "lever_100mm.urdf").read_text()
    start, end = lever.index("<inertial>"), lever.index("</inertial>") + len("</inertial>")
    (folder / "light.urdf").write_text(lever[:start] + lever[end:])
    data = content(BOX)
    del data["hand"]["robot"]
    data["hand"]["urdf"] = "light.urdf"
    return loaded(folder, data)


def test_massless_links_solve_and_are_named_where_inertia_counts(tmp_path):
    scene = massless(tmp_path)
    assert scene.solve("margin").found
    with pytest.raises(ArgumentError, match=r"joint_inertia: is singular at joint 'hinge': it mov"):
        moving_joints(scene.problem())
    data = content(tmp_path / "scene.yaml")
    data["hand"]["armature"] = 1e-4
    problem = loaded(tmp_path, data).problem()
    np.testing.assert_array_equal(known(problem.joint_inertia), [[1e-4]])
    np.testing.assert_array_equal(moving_joints(problem), [0])


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("hand", "armature"), -1, r"hand.armature: found -1; needs .*number"),
        (("hand", "armature"), {"hing": 1}, r"hand.armature: unknown finger or joint 'hing'"),
        (("hand", "armture"), 1e-4, r"hand.armture: .*did you mean 'armature'\?"),
        (("object", "inertia"), [1, 1, 3], r"object.inertia: has the principal moments 1, 1 and 3"),
        (("object", "inertia"), [1, 0, 1], r"object.inertia.*: found 0; needs"),
        (("object", "inertia"), 2, r"object.inertia: found 2; needs"),
    ],
)
def test_wrong_keys_are_named(tmp_path, keys, value, message):
    data = content(BOX)
    data[keys[0]][keys[1]] = value
    with pytest.raises(SceneError, match=rf"scene.yaml:\d+: {message}"):
        loaded(tmp_path, data)


def test_documents_carry_both(tmp_path):
    scene = load_scene(ALLEGRO)
    solution = scene.solve("margin")
    write_document(solution_document(solution, scene), tmp_path / "a.json")
    document = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    problem = read_solution(document).problem
    for name in ("object_inertia", "joint_inertia"):
        np.testing.assert_array_equal(getattr(problem, name), getattr(solution.problem, name))
    assert same_problem(problem, solution.problem)
    document["joint_inertia"][0][0] *= 2.0
    other = read_solution(document).problem
    assert not same_problem(other, solution.problem)
    assert problem_sha256(other) != problem_sha256(solution.problem)
    del document["joint_inertia"]
    older = read_solution(document).problem
    assert older.joint_inertia is None
    assert same_problem(older, solution.problem)
    for wrong in ([[1.0]], [["a"] * 16] * 16, 3):
        document["joint_inertia"] = wrong
        with pytest.raises(ArgumentError, match="joint_inertia"):
            read_solution(document)


def test_links_of_impossible_inertia_still_solve_and_have_documents(tmp_path):
    massless(tmp_path)
    file = tmp_path / "light.urdf"
    inertial = '<inertial><mass value="0"/><inertia ixx="-1" iyy="-1" izz="-1"/></inertial>'
    lever = '<link name="lever">'
    file.write_text(file.read_text().replace(lever, lever + inertial))
    data = content(tmp_path / "scene.yaml")
    data["contacts"] = [
        {"body": "tip", "position": [0, -0.1, 0], "normal": [0, 1, 0]},
        {"body": "floor", "position": [0, 0, -0.1], "normal": [0, 0, 1]},
    ]
    scene = loaded(tmp_path, data)
    solution = scene.solve("margin")
    assert known(solution.problem.joint_inertia)[0, 0] == -1.0
    document = solution_document(solution, scene)
    assert known(read_solution(document).problem.joint_inertia)[0, 0] == -1.0
    with pytest.raises(ArgumentError, match=r"singular at joint 'hinge'"):
        moving_joints(scene.problem())
