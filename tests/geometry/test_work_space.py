"""What is read out of Pinocchio's memory and what compiled loops do is what Pinocchio says."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
from hand_loops import hand_loops

from graspless_pin import compiled
from graspless_pin.geometry.hand import work_space
from graspless_pin.geometry.hand.work_space import WorkSpace, joint_motions

needs_loops = pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")

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


def states_of(model: pin.Model, positions: np.ndarray, gravity: np.ndarray) -> tuple[Any, Any, Any]:
    """Poses and columns of the joints in states, and the torques that carry the weight."""
    parents, placements, axes = joint_motions(SimpleNamespace(pinocchio_model=model))
    inertias = model.inertias.tolist()
    loops = hand_loops(
        parents=parents,
        placements=placements,
        axes=axes,
        masses=np.array([inertia.mass for inertia in inertias]),
        centers=np.array([inertia.lever for inertia in inertias]).reshape(-1, 3),
        gravity=gravity,
    )
    _, _, _, J, weights, _, T = loops.at(positions)
    return T, J, weights


def states(count: int) -> np.ndarray:
    """Positions of all joints, many turns of the continuous ones among them."""
    return np.random.default_rng(6).normal(0.0, 3.0, (count, MODEL.nv))


def as_pinocchio_takes(positions: np.ndarray) -> np.ndarray:
    entries: list[float] = []
    for joint in range(1, MODEL.njoints):
        angle = positions[joint - 1]
        entries += [np.cos(angle), np.sin(angle)] if MODEL.nqs[joint] == 2 else [angle]
    return np.array(entries)


@needs_loops
@pytest.mark.parametrize("gravity", GRAVITIES, ids=str)
def test_chains_are_pinocchios(gravity: np.ndarray) -> None:
    space, positions = WorkSpace(MODEL), states(8)
    for q, *found in zip(positions, *states_of(MODEL, positions, gravity), strict=True):
        T, J, weights = found
        expected = space.kinematics(as_pinocchio_takes(q))
        np.testing.assert_allclose(T, expected.T_world_joint, rtol=0, atol=1e-13)
        np.testing.assert_allclose(J, expected.J, rtol=0, atol=1e-13)
        torques = space.gravity_torques(as_pinocchio_takes(q), gravity)
        np.testing.assert_allclose(weights, torques, rtol=0, atol=1e-12)


@needs_loops
def test_chains_may_be_no_joint() -> None:
    T, J, _ = states_of(pin.Model(), np.empty((1, 0)), np.zeros(3))
    np.testing.assert_array_equal(T, np.eye(4)[None, None])
    assert J.shape == (1, 6, 0)
