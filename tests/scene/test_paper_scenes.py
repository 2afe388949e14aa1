"""The paper's 16 figures from YAML through URDF, Pinocchio and coal."""

import numpy as np
import pytest
from scene_tools import PAPER

from graspless_pin import load_scene

# File: Algorithm 1's margin and torques, Algorithm 2's torques, tolerance. The sphere's normals are
# printed to three digits; the scene has them exact, so its figures agree to the printed digits.
FIGURES = {
    "sphere_on_slope": (1.4507, (-0.7610, -0.7610), (-0.5187, -0.5187), 1e-3),
    "cuboid_at_rest": (1.6504, (-4.8348, 4.8348), (-0.9618, 0.9618), 2e-4),
    "cuboid_sliding_up": (2.3001, (-4.7700, 4.7700), (-1.5554, 1.5554), 2e-4),
    "cuboid_sliding_down": (3.9772, (-4.6023, 4.6023), (-0.8482, 0.8482), 2e-4),
}


@pytest.fixture(scope="module", params=FIGURES)
def case(request):
    return load_scene(PAPER / f"{request.param}.yaml"), FIGURES[request.param]


def test_every_paper_scene_is_checked():
    assert {file.stem for file in PAPER.glob("*.yaml")} == set(FIGURES)


def test_algorithm_1(case):
    """It is what the scenes themselves ask for."""
    scene, (margin, torques, _, tolerance) = case
    solution = scene.solve()
    assert solution.found and solution.algorithm == "margin"
    assert solution.margin == pytest.approx(margin, rel=tolerance)
    np.testing.assert_allclose(solution.torques, torques, rtol=tolerance)


def test_algorithm_2(case):
    scene, (_, _, torques, tolerance) = case
    solution = scene.solve("torque", margin=0.1)
    assert solution.found
    assert solution.margin == pytest.approx(0.1, rel=1e-5)
    assert solution.max_torque == pytest.approx(abs(torques[0]), rel=tolerance)
    np.testing.assert_allclose(solution.torques, torques, rtol=tolerance)


@pytest.mark.parametrize("name", [name for name in FIGURES if name.startswith("cuboid")])
def test_the_cuboids_contacts_are_the_papers(name):
    """Positions, normals, tangents and Jacobians against the vectors that the paper prints."""
    problem = load_scene(PAPER / f"{name}.yaml").problem()
    q = np.sqrt(0.5)
    h, a = 0.05 * q, 0.2 * q
    fingers = [(h, -0.1, h), (h, 0.1, h)]
    slope = [(0, -0.1, -a), (0, 0.1, -a), (-a, 0.1, 0), (-a, -0.1, 0)]
    np.testing.assert_allclose(problem.positions[:2], fingers, atol=1e-6)
    found = problem.positions[2:]
    distances = np.linalg.norm(found[:, None] - np.array(slope)[None], axis=2)
    assert sorted(distances.argmin(axis=1)) == [0, 1, 2, 3]
    assert distances.min(axis=1).max() < 1e-6
    normals = [(0, 1, 0), (0, -1, 0), *[(q, 0, q)] * 4]
    np.testing.assert_allclose(problem.normals, normals, atol=1e-7)
    np.testing.assert_allclose(problem.tangents[:, :, 0], [(-q, 0, q)] * 6, atol=1e-7)
    second = [(-q, 0, -q), (q, 0, q), *[(0, -1, 0)] * 4]
    np.testing.assert_allclose(np.abs(problem.tangents[:, :, 1]), np.abs(second), atol=1e-7)
    jacobian = np.zeros((18, 2))
    jacobian[1, 0] = jacobian[4, 1] = -0.1
    np.testing.assert_allclose(problem.jacobian, jacobian, atol=1e-7)


def test_the_spheres_contacts_are_the_papers():
    problem = load_scene(PAPER / "sphere_on_slope.yaml").problem()
    printed = [(-0.612, 0.707, 0.354), (-0.612, -0.707, 0.354), (0.707, 0, 0.707)]
    np.testing.assert_allclose(problem.normals, printed, atol=6e-4)
    np.testing.assert_allclose(problem.positions, -0.1 * np.array(printed), atol=1e-4)
    jacobian = np.zeros((9, 2))
    jacobian[:3, 0] = -0.15 * problem.normals[0]
    jacobian[3:6, 1] = -0.15 * problem.normals[1]
    np.testing.assert_allclose(problem.jacobian, jacobian, atol=1e-7)
