"""Control modes of fingers: force, position and hybrid, in J and in the optimum."""

import numpy as np
import pytest
from scenes import assert_holds, cuboid_arguments

from graspless_pin import (
    ControlMode,
    FingerContacts,
    QuasistaticProblem,
    assemble_joint_space,
    maximize_margin,
    minimize_torque,
)

NORMALS = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0, 0.6, 0.8]])


def test_force_fingers_are_stacked_block_by_block():
    one, two = np.arange(12.0).reshape(6, 2), np.array([[7.0], [8.0], [9.0]])
    space = assemble_joint_space(
        NORMALS,
        [
            FingerContacts(ControlMode.FORCE, [3, 0], one, torque_limits=(-1.0, [2.0, 3.0])),
            FingerContacts(ControlMode.FORCE, [1], two, joint_names=["thumb"]),
        ],
    )
    expected = np.zeros((12, 3))
    expected[9:12, :2], expected[0:3, :2] = one[:3], one[3:]
    expected[3:6, 2:] = two
    np.testing.assert_array_equal(space.jacobian, expected)
    assert space.torque_limits[0].tolist() == [-1.0, -1.0, -10.0]
    assert space.torque_limits[1].tolist() == [2.0, 3.0, 10.0]
    assert space.joint_names == ("finger_1_joint_1", "finger_1_joint_2", "thumb")
    for array in (space.jacobian, *space.torque_limits):
        assert not array.flags.writeable


def test_a_hybrid_finger_is_one_column_n_that_only_pushes():
    space = assemble_joint_space(
        NORMALS,
        [
            FingerContacts(ControlMode.HYBRID, [3], max_force=8.0),
            FingerContacts(ControlMode.HYBRID, [1], joint_names=["push"]),
        ],
    )
    expected = np.zeros((12, 2))
    expected[9:, 0] = [0.0, 0.6, 0.8]
    expected[3:6, 1] = [0.0, 1.0, 0.0]
    np.testing.assert_array_equal(space.jacobian, expected)
    assert space.torque_limits[0].tolist() == [0.0, 0.0]
    assert space.torque_limits[1].tolist() == [8.0, np.inf]
    assert space.joint_names == ("finger_1_joint_1", "push")


def test_a_position_finger_has_no_column():
    space = assemble_joint_space(
        NORMALS,
        [
            FingerContacts(ControlMode.POSITION, [0, 2]),
            FingerContacts(ControlMode.FORCE, [1], np.ones((3, 1))),
        ],
    )
    assert space.jacobian.shape == (12, 1)
    assert space.joint_names == ("finger_2_joint_1",)
    assert assemble_joint_space(NORMALS, []).jacobian.shape == (12, 0)


def held_cuboid(fingers):
    """The paper's cuboid at rest with its two fingers (contacts 0 and 5) controlled otherwise."""
    arguments = cuboid_arguments()
    space = assemble_joint_space(np.array(arguments["normals"]), fingers)
    arguments |= {
        "jacobian": space.jacobian,
        "torque_limits": space.torque_limits,
        "joint_names": space.joint_names,
    }
    return QuasistaticProblem(**arguments)


def test_hybrid_fingers_command_their_normal_forces():
    hybrid = [FingerContacts(ControlMode.HYBRID, [contact]) for contact in (0, 5)]
    problem = held_cuboid(hybrid)
    solution = maximize_margin(problem)
    assert solution.found
    normal = np.einsum("ij,ij->i", problem.normals, solution.contact_forces)
    np.testing.assert_allclose(solution.torques, normal[[0, 5]], atol=1e-9)
    # The same margin as with levers whose torque is 0.1 m times the normal force.
    assert solution.margin == pytest.approx(1.6504, rel=2e-4)
    smallest = minimize_torque(problem, 0.1)
    # Limits of 50 N are far: the paper's 0.9618 N m at 0.1 m.
    assert smallest.max_torque == pytest.approx(9.618, rel=2e-4)
    assert_holds(smallest)


def test_the_largest_commanded_force_is_respected():
    weak, strong = (
        assemble_joint_space([[0, 0, 1]], [FingerContacts(ControlMode.HYBRID, [0], max_force=most)])
        for most in (4.0, 6.0)
    )
    problem = QuasistaticProblem(
        [[0, 0, -0.1]], [[0, 0, 1]], [0, 0, -5, 0, 0, 0], weak.jacobian,
        friction=0.5, torque_limits=weak.torque_limits,
    )  # fmt: skip
    assert not maximize_margin(problem).found
    solution = maximize_margin(problem.with_changes(torque_limits=strong.torque_limits))
    np.testing.assert_allclose(solution.torques, [5.0], atol=1e-6)


def test_a_position_finger_is_the_environment():
    problem = held_cuboid([FingerContacts(ControlMode.POSITION, [0, 5])])
    assert problem.joint_count == 0
    solution = maximize_margin(problem)
    assert solution.torques.shape == (0,) and solution.max_torque == 0.0
    assert solution.margin == pytest.approx(1.6504, rel=2e-4)
    smallest = minimize_torque(problem, 0.1)
    assert smallest.found
    assert smallest.margin >= 0.1 - 1e-6
    assert smallest.max_torque == 0.0


def test_a_control_mode_may_be_given_by_name():
    space = assemble_joint_space(NORMALS, [FingerContacts("hybrid", [0])])  # type: ignore[arg-type]
    np.testing.assert_array_equal(space.jacobian[:3, 0], NORMALS[0])
