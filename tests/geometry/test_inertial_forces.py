"""Inertial forces of links against Pinocchio's inverse dynamics and finite differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
from scipy.spatial.transform import Rotation

from graspless_pin import Hand
from graspless_pin.errors import ArgumentError
from graspless_pin.findings import capture
from graspless_pin.geometry.hand.joint_columns import STILL, RigidMotion, hand_motions

MODELS = ["panda", "allegro_right_hand"]


def moving(model: str, seed: int) -> tuple[Hand, dict[str, float], dict[str, float]]:
    rng = np.random.default_rng(seed)
    with capture():  # of effort limits, which do not matter here
        hand = Hand.from_model_name(model, control="force")
    tree = hand.tree
    leaders = [*tree.coupling.leaders]
    low, high = np.maximum(tree.lower, -3.0)[leaders], np.minimum(tree.upper, 3.0)[leaders]
    hand = hand.with_configuration(rng.uniform(low, high))
    names = [tree.joint_names[index] for index in leaders]
    rates, changes = (
        dict(zip(names, rng.normal(size=len(names)).tolist(), strict=True)) for _ in range(2)
    )
    return hand, rates, changes


def inverse_dynamics(hand: Hand, rates: np.ndarray, changes: np.ndarray) -> np.ndarray:
    model = hand.tree.pinocchio_model
    q = hand.tree.configuration(hand.positions)
    data = model.createData()
    weight = np.array(pin.computeGeneralizedGravity(model, data, q))
    return np.array(pin.rnea(model, data, q, rates, changes)) - weight


@pytest.mark.parametrize("model", MODELS)
def test_torques_are_those_of_inverse_dynamics(model: str) -> None:
    for seed in range(5):
        hand, rates, changes = moving(model, seed)
        S = hand.tree.coupling.S
        expected = S.T @ inverse_dynamics(
            hand, S @ list(rates.values()), S @ list(changes.values())
        )
        found = hand_motions(hand, STILL, rates, changes)
        np.testing.assert_allclose(found.torques(hand), expected, atol=1e-10)


@pytest.mark.parametrize("model", MODELS)
def test_a_base_that_translates_is_other_gravity(model: str) -> None:
    hand, _, _ = moving(model, 7)
    a = np.array([1.0, -2.0, 3.0])
    base = RigidMotion(np.zeros(6), np.r_[a, np.zeros(3)])
    torques = hand_motions(hand, base, {}, {}).torques(hand)
    np.testing.assert_allclose(torques, hand.gravity_torques(-a), atol=1e-10)


def test_a_base_that_turns_is_a_joint_below_all_others() -> None:
    """The Panda's first joint turns about the world's z axis: the rest is a hand on that base."""
    for seed in range(5):
        hand, rates, changes = moving("panda", seed)
        first = "panda_joint1"
        whole = hand_motions(hand, STILL, rates, changes)
        slower, steadier = ({name: one for name, one in part.items() if name != first}
                            for part in (rates, changes))  # fmt: skip
        base = RigidMotion(np.r_[np.zeros(5), rates[first]], np.r_[np.zeros(5), changes[first]])
        split = hand_motions(hand, base, slower, steadier)
        np.testing.assert_allclose(split.wrenches, whole.wrenches, atol=1e-9)
        np.testing.assert_allclose(split.torques(hand), whole.torques(hand), atol=1e-9)


def test_accelerations_of_points_by_differences() -> None:
    """Of a point of a frame whose pose at time t is known: position, then second difference."""
    rng = np.random.default_rng(3)
    v, w, a, alpha = rng.normal(size=(4, 3))
    motion = RigidMotion(np.r_[v, w], np.r_[a, alpha])
    point, h = rng.normal(size=3), 1e-4

    def pose(t: float) -> np.ndarray:
        """exp(V t + A t^2 / 2), which has these body velocities and accelerations at t = 0."""
        twist = (motion.velocity + 0.5 * t * motion.acceleration) * t
        return pin.exp6(pin.Motion(twist)).homogeneous

    there, here, back = (pose(t) @ np.r_[point, 1.0] for t in (h, 0.0, -h))
    np.testing.assert_allclose(
        motion.acceleration_of(point), ((there - 2.0 * here + back) / h**2)[:3], atol=1e-5
    )
    R = Rotation.from_matrix(pose(h)[:3, :3]).as_rotvec()
    np.testing.assert_allclose(R / h, w, atol=1e-3)


def test_unknown_joints_are_named() -> None:
    hand, _, _ = moving("panda", 0)
    with pytest.raises(ArgumentError, match=r"joint_accelerations: unknown independent joint 'j'"):
        hand_motions(hand, STILL, {}, {"j": 1.0})
