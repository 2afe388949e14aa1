"""Control modes, own weight and gravity of a scene, against arrays and Pinocchio."""

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
from example_robot_data import load as load_example  # pyright: ignore[reportMissingImports]
from scene_tools import ALLEGRO, PAPER, content, hand_of, loaded

from graspless_pin import QuasistaticProblem, load_scene, maximize_margin, minimize_torque
from graspless_pin.errors import SceneError
from graspless_pin.findings import FindingCode

Q = np.sqrt(0.5)
POSITIONS = np.array(
    [
        [0.05 * Q, -0.1, 0.05 * Q],
        [0.05 * Q, 0.1, 0.05 * Q],
        [0, -0.1, -0.2 * Q],
        [0, 0.1, -0.2 * Q],
        [-0.2 * Q, 0.1, 0],
        [-0.2 * Q, -0.1, 0],
    ]
)
NORMALS = np.array([[0, 1, 0], [0, -1, 0], *[[Q, 0, Q]] * 4])
FIRST = np.array([-Q, 0, Q])


def cuboid(jacobian, limits) -> QuasistaticProblem:
    """The paper's cuboid at rest from arrays, fingers first, with another Jacobian."""
    tangents = np.stack([np.tile(FIRST, (6, 1)), np.cross(NORMALS, FIRST)], axis=2)
    return QuasistaticProblem(
        POSITIONS,
        NORMALS,
        [0, 0, -9.8, 0, 0, 0],
        jacobian,
        friction=0.3,
        tangents=tangents,
        torque_limits=limits,
        cone_edges=6,
    )


def controlled(tmp_path, control, **hand):
    data = content(PAPER / "cuboid_at_rest.yaml")
    data["hand"] |= {"control": control, **hand}
    return loaded(tmp_path, data)


def assert_same_answers(scene, problem):
    best, other = scene.solve("margin"), maximize_margin(problem)
    assert best.found and other.found
    assert best.margin == pytest.approx(other.margin, abs=1e-5)
    least, other = scene.solve("torque", margin=0.1), minimize_torque(problem, margin=0.1)
    assert least.max_torque == pytest.approx(other.max_torque, abs=1e-5)
    np.testing.assert_allclose(least.torques, other.torques, atol=1e-4)


def test_a_position_controlled_finger_has_no_torque(tmp_path):
    scene = controlled(tmp_path, {"finger_1/finger": "position"})
    jacobian = np.zeros((18, 1))
    jacobian[4, 0] = -0.1
    np.testing.assert_allclose(scene.problem().jacobian, jacobian, atol=1e-7)
    assert scene.problem().joint_names == ("finger_6/hinge",)
    assert_same_answers(scene, cuboid(jacobian, 10.0 * np.array([[-1.0], [1.0]])))


def test_a_position_controlled_hand_is_environment(tmp_path):
    scene = controlled(tmp_path, "position")
    assert scene.problem().jacobian.shape == (18, 0)
    solution = scene.solve("margin")
    assert solution.max_torque == 0.0
    other = maximize_margin(cuboid(np.zeros((18, 0)), (np.zeros(0), np.zeros(0))))
    assert solution.margin == pytest.approx(other.margin, abs=1e-5)


@pytest.mark.parametrize("limit", [None, 12.0])
def test_a_hybrid_finger_commands_its_normal_force(tmp_path, limit):
    given = {} if limit is None else {"hybrid_force_limit": limit}
    scene = controlled(tmp_path, {"finger_6/finger": "hybrid"}, **given)
    problem = scene.problem()
    jacobian = np.zeros((18, 2))
    jacobian[1, 0] = -0.1
    jacobian[3:6, 1] = NORMALS[1]  # J_i = n: f_com = n^T f
    np.testing.assert_allclose(problem.jacobian, jacobian, atol=1e-7)
    assert problem.joint_names == ("finger_1/hinge", "finger_6/finger.normal_force")
    most = 50.0 if limit is None else limit
    np.testing.assert_array_equal(problem.lower_torque, [-10, 0])
    np.testing.assert_array_equal(problem.upper_torque, [10, most])
    assert_same_answers(scene, cuboid(jacobian, (np.array([-10, 0.0]), np.array([10, most]))))
    best = scene.solve("margin")
    normal_force = NORMALS[1] @ best.contact_forces[1]
    assert best.torques[1] == pytest.approx(normal_force, abs=1e-9)
    assert 0.0 < normal_force <= most + 1e-6


def test_a_limit_of_hybrid_fingers_is_told_where_there_is_none(tmp_path):
    def told(control):
        found = controlled(tmp_path, control, hybrid_force_limit=12.0).findings
        return [one.place for one in found if one.code is FindingCode.UNUSED_OPTION]

    assert told({"finger_6/finger": "hybrid"}) == []
    assert told("force") == [f"{tmp_path / 'scene.yaml'}:9: hand.hybrid_force_limit"]


def test_a_hybrid_finger_has_one_contact(tmp_path):
    data = content(PAPER / "cuboid_at_rest.yaml")
    data["hand"]["control"] = {"finger_6/finger": "hybrid"}
    data["contacts"] = [
        {"body": "finger_6/tip", "position": [x, 0.1, 0], "normal": [0, -1, 0]} for x in (0, 0.01)
    ]
    with pytest.raises(
        SceneError, match=r"scene.yaml: hybrid finger 'finger_6/finger' .* exactly one contact"
    ):
        loaded(tmp_path, data).problem()


@pytest.mark.parametrize("gravity", [(0, 0, -9.81), (1.5, -2.0, -9.0), (0, 9.81, 0)])
def test_gravity_pulls_on_object_and_links(tmp_path, gravity):
    data = content(ALLEGRO)
    data["gravity"] = list(gravity)
    data["object"]["mass"] = 2.5
    scene = loaded(tmp_path, data)
    problem = scene.problem()
    np.testing.assert_allclose(problem.external_wrench, [*(2.5 * np.array(gravity)), 0, 0, 0])
    model = load_example("allegro_right_hand").model
    model.gravity.linear = hand_of(scene).T_world_base[:3, :3].T @ np.array(gravity, dtype=float)
    q = np.array([hand_of(scene).q[name] for name in model.names[1:]])
    expected = pin.computeGeneralizedGravity(model, model.createData(), q)
    assert np.abs(expected).max() > 0.02
    np.testing.assert_allclose(problem.gravity_torques, expected, atol=1e-12)


def test_own_weight_counts_against_the_limits_unless_switched_off(tmp_path):
    """The thumb touches nothing and needs 0.0375 N m for itself."""
    data = content(ALLEGRO)
    data["hand"]["effort_limits"] = {"thumb": 0.03}
    assert not loaded(tmp_path, data).solve("margin").found
    data["hand"]["count_own_weight"] = False
    free = loaded(tmp_path, data)
    np.testing.assert_array_equal(free.problem().gravity_torques, np.zeros(16))
    solution = free.solve("margin")
    assert solution.found
    np.testing.assert_array_equal(solution.torques, solution.contact_torques)
    with_weight = load_scene(ALLEGRO).solve("margin")
    difference = with_weight.torques - with_weight.contact_torques
    np.testing.assert_allclose(difference, with_weight.problem.gravity_torques, atol=1e-12)
    # Far from its limits the hand's weight moves no contact force.
    assert with_weight.margin == pytest.approx(solution.margin, abs=1e-6)
