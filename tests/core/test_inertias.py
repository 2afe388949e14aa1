"""Inertias of a problem: what is taken, what is kept, and which columns of J are joints."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspless_pin import QuasistaticProblem
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.derived_inertias import with_derived_inertias
from graspless_pin.problem.inertias import hybrid_contacts, moving_joints

OBJECT = np.diag([2.0, 2.0, 2.0, 0.01, 0.02, 0.03])
JOINTS = np.array([[0.02, 0.005], [0.005, 0.01]])
NORMALS = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


def known(inertia: np.ndarray | None) -> np.ndarray:
    assert inertia is not None
    return inertia


def problem(jacobian=None, **changes):
    if jacobian is None:
        jacobian = np.zeros((6, 2))
        jacobian[2], jacobian[1, 1] = [0.1, 0.2], 0.3
    given = {"object_inertia": OBJECT, "joint_inertia": JOINTS, **changes}
    return QuasistaticProblem(
        [[0, 0, -0.1], [0, -0.1, 0]],
        NORMALS,
        [0, 0, -9.8, 0, 0, 0],
        jacobian,
        friction=0.3,
        **given,
    )


def test_inertias_are_read_only_copies():
    own = OBJECT.copy()
    made = problem(object_inertia=own)
    own[0, 0] = 5.0
    np.testing.assert_array_equal(made.object_inertia, OBJECT)
    np.testing.assert_array_equal(made.joint_inertia, JOINTS)
    assert not known(made.object_inertia).flags.writeable
    assert not known(made.joint_inertia).flags.writeable


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("object_inertia", np.eye(3), r"has shape \(3, 3\); expected \(6, 6\)"),
        ("object_inertia", np.full((6, 6), np.nan), r"is NaN at index \(0, 0\)"),
        ("object_inertia", np.diag([1, 1, 1, 1, 1, 0.0]), r"is 0.0 at index \(5, 5\); the diag"),
        ("object_inertia", -OBJECT, r"is -2.0 at index \(0, 0\); the diagonal must be positive"),
        ("object_inertia", np.diag([2, 2, 3, 1, 1, 1]), r"has .* for the mass; one free"),
        ("joint_inertia", np.eye(3), r"has shape \(3, 3\); expected \(2, 2\)"),
        ("joint_inertia", [[1, 0], [0, np.inf]], r"is inf at index \(1, 1\); it must be finite"),
        ("joint_inertia", [[1, 0.1], [0.1001, 1]], r"is 0.1 at index \(0, 1\) and 0.1001 at \(1, 0"
         r"\), beside 1.0 and 1.0 on the diagonal; the matrix must be symmetric"),
        ("joint_inertia", [[1, 0], [0, -1e-9]], r"is -1e-09 at index \(1, 1\); the diagonal must"),
        ("joint_inertia", [[0, 1e-9], [1e-9, 1]], r"beside 0.0 and 1.0 on the .* semidefinite"),
        ("joint_inertia", [[1, 2], [2, 1]], r"is 2.0 at index \(0, 1\) .* positive semidefinite"),
        ("joint_inertia", "heavy", r"must be an array of real numbers"),
    ],
)  # fmt: skip
def test_wrong_inertias_are_named(name, value, message):
    with pytest.raises(ArgumentError, match=rf"^{name}: .*{message}"):
        problem(**{name: value})


def test_three_joints_can_be_wrong_together_only():
    """Each pair is possible; the smallest eigenvalue is -0.8."""
    inertia = np.full((3, 3), -0.9) + 1.9 * np.eye(3)
    with pytest.raises(ArgumentError, match=r"^joint_inertia: has the eigenvalue -0.8 when"):
        problem(np.zeros((6, 3)), joint_inertia=inertia)


@given(st.floats(-9, 9), st.floats(-6, 6))
def test_units_change_nothing_about_what_is_taken(mass, length):
    """Masses in any unit and lengths in any unit: the same matrices are symmetric and definite."""
    units = 10.0 ** np.repeat([mass / 2, mass / 2 + length], 3)
    skew = OBJECT.copy()
    skew[0, 4] = skew[4, 0] = 0.05
    made = problem(object_inertia=skew * np.outer(units, units))
    np.testing.assert_allclose(known(made.object_inertia) / np.outer(units, units), skew)
    skew[4, 0] *= 1.001
    with pytest.raises(ArgumentError, match=r"symmetric"):
        problem(object_inertia=skew * np.outer(units, units))


def test_changes_keep_what_they_do_not_touch():
    made = problem()
    changed = made.with_changes(friction=0.5)
    assert changed.object_inertia is made.object_inertia
    assert changed.joint_inertia is made.joint_inertia
    assert made.with_changes(joint_inertia=None).joint_inertia is None
    heavier = made.with_changes(object_inertia=2 * OBJECT)
    np.testing.assert_array_equal(heavier.object_inertia, 2 * OBJECT)
    np.testing.assert_array_equal(heavier.joint_inertia, JOINTS)
    with pytest.raises(ArgumentError, match=r"^joint_inertia: has shape"):
        made.with_changes(joint_inertia=np.eye(3))
    with pytest.raises(
        ArgumentError, match=r"^inertia: is not an argument; known: .*joint_inertia"
    ):
        made.with_changes(inertia=1)


def test_other_joints_drop_the_joints_inertia_and_not_the_objects():
    other = problem().with_changes(
        jacobian=np.ones((6, 3)),
        joint_names=["a", "b", "c"],
        torque_limits=(-1.0, 1.0),
        gravity_torques=None,
    )
    assert other.joint_inertia is None
    np.testing.assert_array_equal(other.object_inertia, OBJECT)


def test_derived_inertias_are_made_once_when_they_are_asked_for():
    made = []

    def joints():
        made.append("joints")
        return JOINTS.copy()

    bare = problem(object_inertia=None, joint_inertia=None)
    late = with_derived_inertias(
        bare.with_changes(), {"object_inertia": OBJECT.copy, "joint_inertia": joints}
    )
    changed = late.with_changes(friction=0.1)
    assert made == []
    for each in (late, changed):
        np.testing.assert_array_equal(each.joint_inertia, JOINTS)
        assert each.joint_inertia is each.joint_inertia
        assert not known(each.joint_inertia).flags.writeable
    assert made == ["joints", "joints"]
    assert late.with_changes(joint_inertia=None).joint_inertia is None
    for one in (changed, problem()):
        again = pickle.loads(pickle.dumps(one))  # noqa: S301 - our own
        np.testing.assert_array_equal(again.object_inertia, OBJECT)
        np.testing.assert_array_equal(again.joint_inertia, JOINTS)


def commanding(factor=1.0, other=0.0):
    """A joint on the first contact, and a column of the second one's normal."""
    jacobian = np.zeros((6, 2))
    jacobian[2, 0], jacobian[3:, 1] = 0.1, factor * NORMALS[1]
    jacobian[4, 0] = other
    return jacobian


def test_a_column_without_inertia_that_commands_a_normal_force_is_a_hybrid_fingers():
    made = problem(commanding(), joint_inertia=np.diag([0.02, 0.0]))
    np.testing.assert_array_equal(hybrid_contacts(made), [-1, 1])
    np.testing.assert_array_equal(moving_joints(made), [0])


@pytest.mark.parametrize(
    ("jacobian", "inertia"),
    [
        (commanding(), np.diag([0.02, 0.01])),  # it has an inertia
        (commanding(-1.0), np.diag([0.02, 0.0])),  # it pulls
        (commanding(0.1), np.diag([0.02, 0.0])),  # it turns: a lever of 0.1 m
        (commanding(other=0.2), np.diag([0.02, 0.0])),  # another joint acts there
        (np.vstack([commanding()[3:], commanding()[3:]]), np.diag([0.02, 0.0])),  # two contacts
    ],
)
def test_other_columns_are_joints(jacobian, inertia):
    made = problem(jacobian, joint_inertia=inertia)
    np.testing.assert_array_equal(hybrid_contacts(made), [-1, -1])
    if inertia[1, 1] == 0.0:
        with pytest.raises(
            ArgumentError, match=r"joint_inertia: is singular at joint 'joint_2': it moves no mass"
        ):
            moving_joints(made)
    else:
        np.testing.assert_array_equal(moving_joints(made), [0, 1])


def test_joints_that_move_no_mass_together_are_refused():
    """Two joints about one axis, the mass beyond both: their opposite turning moves nothing."""
    made = problem(joint_inertia=np.full((2, 2), 0.3))
    with pytest.raises(ArgumentError, match=r"at joint 'joint_[12]': together with others"):
        moving_joints(made)
    armature = np.full((2, 2), 0.3) + 1e-6 * np.eye(2)
    np.testing.assert_array_equal(moving_joints(made.with_changes(joint_inertia=armature)), [0, 1])


def test_without_inertias_there_is_no_telling():
    made = problem(commanding(), joint_inertia=None)
    np.testing.assert_array_equal(hybrid_contacts(made), [-1, -1])
    with pytest.raises(ArgumentError, match=r"^joint_inertia: is missing"):
        moving_joints(made)


def test_no_joints_have_no_inertia():
    made = problem(np.zeros((6, 0)), joint_inertia=np.zeros((0, 0)))
    assert moving_joints(made).shape == (0,)
