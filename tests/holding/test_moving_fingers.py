"""A hand that does not rest while the object does: told apart from an object that moves."""

from __future__ import annotations

import json

import numpy as np
import pytest
from cases import GRAVITY, HALF, block_on_slope, box_inertia, pressed_on_wall

from graspless_pin import QuasistaticProblem, Stability, maximize_margin, stability
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.report.verify.outcome import Check

WEIGHT, INERTIA = 0.2, 0.02


def beside_an_idle_finger(coupling: float = 0.0) -> QuasistaticProblem:
    """A finger presses a cube on a wall, from 9.81 N on; another touches nothing."""
    one = pressed_on_wall()
    return QuasistaticProblem(
        one.positions, one.normals, one.external_wrench,
        np.hstack([one.jacobian, np.zeros((15, 1))]), friction=0.5, joint_units=["N", "N m"],
        joint_names=["press", "idle"], gravity_torques=[0.0, WEIGHT], object_inertia=box_inertia(),
        joint_inertia=[[0.01, coupling], [coupling, INERTIA]],
    )  # fmt: skip


def test_an_idle_finger_that_carries_its_weight_rests() -> None:
    said = stability(beside_an_idle_finger(), [20.0, WEIGHT])
    assert said.status is Stability.STRONG and said.moves is None


@pytest.mark.parametrize("off", [3e-17, -1e-15, 1e-14])
def test_what_rounding_leaves_of_torques_moves_no_idle_finger(off: float) -> None:
    """Weight and torque are worked out in two ways: they agree to a few bits."""
    problem, torques = beside_an_idle_finger(), [20.0, WEIGHT + off]
    said = stability(problem, torques)
    assert said.status is Stability.STRONG and said.moves is None
    wanted = {"rest is an outcome", "rest is the only outcome"}
    checks = [one for one in checked_document(problem, torques) if one.name in wanted]
    assert len(checks) == 2 and all(one.passed for one in checks)


@pytest.mark.parametrize("torque", [0.5, -0.1, 0.21, WEIGHT + 1e-9])
def test_an_idle_finger_with_another_torque_moves_by_itself(torque: float) -> None:
    said = stability(beside_an_idle_finger(), [20.0, torque])
    assert said.status is Stability.NONE and said.moves == "finger"
    assert said.motion is not None
    np.testing.assert_allclose(said.motion.object_acceleration, 0.0, atol=1e-9)
    np.testing.assert_allclose(
        said.motion.joint_accelerations, [0.0, (torque - WEIGHT) / INERTIA], atol=1e-9
    )
    assert "slipping" not in said.motion.states
    left = f"{abs(torque - WEIGHT):.2g} N m"
    assert str(said) == (
        f"fails: joint 'idle' moves by itself: torques do not balance weight, {left} are "
        "unbalanced at joint 'idle'; the object stays in this outcome, which is not proven to be "
        "the only one"
    )


@pytest.mark.parametrize("idle", [WEIGHT, 0.5])
def test_an_object_that_falls_is_what_is_told(idle: float) -> None:
    """5 N bear half of the 9.81 N, whatever the other finger does."""
    said = stability(beside_an_idle_finger(), [5.0, idle])
    assert said.status is Stability.NONE and said.moves == "object"
    assert said.motion is not None
    assert said.motion.object_acceleration[2] == pytest.approx(5.0 - GRAVITY)
    assert "the object can slip down" in str(said)


def test_an_object_that_hardly_slips_is_what_is_told() -> None:
    """Friction of 0.5 bears 4.905 N of a push along a table; 5 mN more move cube and finger."""
    table = block_on_slope(0.5, 0.0)
    jacobian = np.zeros((15, 1))
    jacobian[12] = -1.0
    pushed = QuasistaticProblem(
        [*table.positions, (HALF, 0.0, -HALF)], [*table.normals, (-1.0, 0.0, 0.0)],
        table.external_wrench, jacobian, friction=[0.5] * 4 + [0.0], joint_units=["N"],
        object_inertia=box_inertia(), joint_inertia=[[0.05]],
    )  # fmt: skip
    assert stability(pushed, [4.9]).status is Stability.STRONG
    said = stability(pushed, [4.91])
    assert said.status is Stability.NONE and said.motion is not None
    assert 0.0 < said.motion.point_acceleration < said.acceleration_limit
    assert said.moves == "object" and said.holding == "fails"


def test_a_weak_verdict_moves_the_object() -> None:
    said = stability(pressed_on_wall(friction=0.5), [9.0])
    assert said.moves == "object"


def wedged_finger(friction: float) -> QuasistaticProblem:
    """A cube on a table, and a finger that slides along tan 3 to its side, and is pulled back.

    Along d = (0.316, 0, 0.949) contact forces inside a cone of 0.5 push it on, or hold it back
    where they press enough: at rest with 3.16 N or more, or it leaves. The table bears 0.8 times
    9.81 N and more by friction.
    """
    corners = [(x, y, -0.05) for x in (-0.05, 0.05) for y in (-0.05, 0.05)]
    jacobian = np.zeros((15, 1))
    jacobian[12:, 0] = np.array([1.0, 0.0, 3.0]) / np.sqrt(10.0)
    return QuasistaticProblem(
        [*corners, (-0.05, 0.0, -0.04)], [(0.0, 0.0, 1.0)] * 4 + [(1.0, 0.0, 0.0)],
        [0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0], jacobian, friction=[friction] * 4 + [0.5],
        joint_units=["N"], object_inertia=box_inertia(), joint_inertia=[[INERTIA]],
    )  # fmt: skip


def test_a_finger_that_may_leave_moves_no_object_that_stays() -> None:
    """Friction may keep the finger, or it goes by itself: the object stays in either outcome."""
    problem, torques = wedged_finger(0.8), [-0.1]
    said = stability(problem, torques)
    assert said.status is Stability.STRONG and said.proof is not None
    assert said.proof.tree is not None
    assert said.leaving == problem.joint_names
    assert "may move away by itself, as friction alone keeps it" in str(said)
    assert said.holding == "finger_moves" and str(said).startswith("stays: ")
    wanted = {"rest is an outcome", "rest is the only outcome", "holding and stability agree"}
    told = list(checked_document(problem, torques))
    checks = [one for one in told if one.name in wanted]
    assert len(checks) == 3 and all(one.passed for one in checks)
    assert not any("are assumed" in one.detail for one in told)


def test_a_finger_that_is_pushed_on_does_not_leave() -> None:
    """The wedged finger with its torque the other way, and one that presses on a wall."""
    for problem, torque in ((wedged_finger(0.8), 0.1), (pressed_on_wall(friction=0.5), 20.0)):
        said = stability(problem, [torque])
        assert said.status is Stability.STRONG and said.leaving == ()


def test_a_finger_that_shares_an_arm_with_the_other_is_no_proof_of_an_object_at_rest() -> None:
    """Whatever comes out obeys the coupled dynamics: the idle joint pushes the pressing one."""
    said = stability(beside_an_idle_finger(coupling=0.005), [20.0, 0.5])
    assert said.status is Stability.NONE and said.motion is not None
    left = np.array([[0.01, 0.005], [0.005, INERTIA]]) @ said.motion.joint_accelerations - [
        20.0,
        0.3,
    ]
    pressed = said.motion.contact_forces[4] @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(left, [pressed, 0.0], atol=1e-6)


def checked_document(problem: QuasistaticProblem, torques: list[float]) -> list[Check]:
    """Return the checks of a document whose verdict and torques are these."""
    solution = maximize_margin(problem, static_friction="coulomb")
    made = json.loads(json.dumps(solution_document(solution, verdict=stability(problem, torques))))
    for joint, own in zip(made["joints"], torques, strict=True):
        joint["torque"] = own
    return list(verify_document(made).checks)


def test_the_document_of_a_finger_that_moves_is_checked() -> None:
    said = stability(beside_an_idle_finger(), [20.0, 0.5])
    assert said.moves == "finger"
    checks = checked_document(beside_an_idle_finger(), [20.0, 0.5])
    lines = [line for line in checks if "motion" in line.name or line.name == "rest is no outcome"]
    assert len(lines) > 1 and all(line.passed for line in lines)
