"""What is read out of Pinocchio's memory is what Pinocchio says."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest

from graspless_pin.geometry.hand import work_space
from graspless_pin.geometry.hand.work_space import WorkSpace

GRAVITIES = np.array([[0.0, 0.0, -9.81], [3.0, -2.0, 1.0], [0.0, 0.0, 0.0]])


def model_with_every_joint() -> pin.Model:
    """A chain, and a branch, of revolute, prismatic and continuous joints with masses."""
    model = pin.Model()
    rng = np.random.default_rng(4)
    parent = 0
    kinds = [pin.JointModelRX, pin.JointModelPY, pin.JointModelRUBZ, pin.JointModelRY]
    for index, kind in enumerate(kinds * 2):
        placement = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        joint = model.addJoint(0 if index == 4 else parent, kind(), placement, f"joint {index}")
        body = pin.Inertia(rng.uniform(0.1, 1.0), rng.normal(size=3), 0.01 * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        parent = joint
    return model


MODEL = model_with_every_joint()


def configurations(count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(5)
    return [pin.integrate(MODEL, pin.neutral(MODEL), rng.normal(size=8)) for _ in range(count)]


@pytest.mark.parametrize("in_one_block", [True, False])
def test_kinematics_and_weight_are_pinocchios(monkeypatch, in_one_block: bool) -> None:
    if in_one_block:
        assert work_space._pose_columns(MODEL.createData()) is not None
    else:
        monkeypatch.setattr(work_space, "_pose_columns", lambda data: None)
    space = WorkSpace(MODEL)
    kept = []
    for q, gravity in zip(configurations(6), [*GRAVITIES, *GRAVITIES], strict=True):
        data = MODEL.createData()
        J = pin.computeJointJacobians(MODEL, data, q)
        poses = np.array([pose.homogeneous for pose in data.oMi])
        found = space.kinematics(q)
        kept.append((found, poses))
        np.testing.assert_allclose(found.J, J, rtol=0, atol=1e-14)
        assert not found.J.flags.writeable
        assert not found.T_world_joint.flags.writeable
        other = MODEL.copy()
        other.gravity.linear = gravity
        expected = pin.computeGeneralizedGravity(other, other.createData(), q)
        np.testing.assert_array_equal(space.gravity_torques(q, gravity), expected)
    for found, poses in kept:  # and the next ones do not write over them
        np.testing.assert_array_equal(found.T_world_joint, poses)


def test_poses_that_lie_elsewhere_are_not_read_in_one_block() -> None:
    first, second, third = (pin.SE3.Random() for _ in range(3))
    disordered = SimpleNamespace(tolist=lambda: [first, third, second, first])
    assert work_space._pose_columns(SimpleNamespace(oMi=disordered)) is None


def test_a_work_space_serves_threads() -> None:
    space = WorkSpace(MODEL)
    states = configurations(40)
    expected = [space.kinematics(q) for q in states]
    weights = [space.gravity_torques(q, GRAVITIES[k % 3]) for k, q in enumerate(states)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(space.kinematics, states * 5))
        torques = list(
            pool.map(lambda k: space.gravity_torques(states[k], GRAVITIES[k % 3]), range(40))
        )
    for k, kinematics in enumerate(found):
        np.testing.assert_array_equal(kinematics.T_world_joint, expected[k % 40].T_world_joint)
        np.testing.assert_array_equal(kinematics.J, expected[k % 40].J)
    np.testing.assert_array_equal(torques, weights)
