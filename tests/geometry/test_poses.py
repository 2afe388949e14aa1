import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.poses import (
    RIGIDITY_TOLERANCE,
    as_pose,
    invert,
    pose_matrix,
    roll_pitch_yaw,
)

STEEP = st.floats(-7.0, 7.0) | st.sampled_from([-0.5, 0.5]).map(lambda half: half * np.pi)
ANGLES = st.tuples(*[st.floats(-7.0, 7.0)] * 3)


@given(ANGLES)
def test_roll_pitch_yaw_as_in_urdf(rpy):
    T = pose_matrix([1.0, 2.0, 3.0], rpy)
    np.testing.assert_allclose(T[:3, :3], Rotation.from_euler("xyz", rpy).as_matrix(), atol=1e-12)
    assert T[:3, 3].tolist() == [1.0, 2.0, 3.0]


@given(st.tuples(st.floats(-7.0, 7.0), STEEP, st.floats(-7.0, 7.0)))
def test_a_rotation_s_angles_turn_as_it_does(rpy):
    R = pose_matrix(np.zeros(3), rpy)[:3, :3]
    again = roll_pitch_yaw(R)
    np.testing.assert_allclose(pose_matrix(np.zeros(3), again)[:3, :3], R, atol=1e-11)
    assert abs(again[1]) <= np.pi / 2


@given(st.tuples(*[st.floats(-2.0, 2.0)] * 4).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_quaternion_is_xyzw_of_any_length(quaternion):
    np.testing.assert_allclose(
        pose_matrix(np.zeros(3), quaternion)[:3, :3],
        Rotation.from_quat(quaternion).as_matrix(),
        atol=1e-12,
    )


@given(ANGLES, ANGLES)
def test_inverse_undoes(rpy, position):
    T = pose_matrix(position, rpy)
    np.testing.assert_allclose(invert(T) @ T, np.eye(4), atol=1e-12)


def test_rotation_matrix_and_no_rotation():
    R = Rotation.from_euler("z", 0.3).as_matrix()
    np.testing.assert_array_equal(pose_matrix([0, 0, 0], R)[:3, :3], R)
    np.testing.assert_array_equal(pose_matrix([0, 0, 1])[:3, :3], np.eye(3))


def test_pose_is_a_read_only_copy():
    T = np.eye(4)
    pose = as_pose("T", T)
    T[0, 3] = 5.0
    assert pose[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        pose[0, 3] = 1.0


MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])
SCALED = np.diag([1.0, 1.0, 1.1, 1.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: as_pose("T_world_base", np.eye(3)), r"T_world_base: .*\(4, 4\).*\(3, 3\)"),
        (lambda: as_pose("T_world_base", MIRROR), "T_world_base: .*reflection"),
        (lambda: as_pose("T_world_base", SCALED), "T_world_base: .*not orthonormal"),
        (lambda: as_pose("T_world_base", np.ones((4, 4))), "last row"),
        (lambda: as_pose("T_world_base", np.full((4, 4), np.nan)), "finite"),
        (lambda: as_pose("T_world_base", "here"), "needs numbers"),
        (lambda: pose_matrix([0, 0]), r"position: needs 3 numbers"),
        (lambda: pose_matrix([0, 0, 0], [1, 2]), "quaternion x, y, z, w"),
        (lambda: pose_matrix([0, 0, 0], [0, 0, 0, 0]), "must not be zero"),
        (lambda: pose_matrix([0, 0, 0], np.ones((3, 3))), "rotation: .*not orthonormal"),
    ],
)
def test_bad_poses_are_named(make, message):
    with pytest.raises(ArgumentError, match=message):
        make()


@settings(max_examples=80)
@given(
    angles=st.tuples(*[st.floats(-3.1, 3.1)] * 3),
    spoilt=st.sampled_from([(i, j) for i in range(3) for j in range(3)]),
    amount=st.floats(-3e-6, 3e-6),
    mirrored=st.booleans(),
)
def test_a_pose_is_rigid_up_to_the_tolerance(angles, spoilt, amount, mirrored):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix() @ np.diag(
        [1, 1, -1 if mirrored else 1]
    )
    T[spoilt] += amount
    error = np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max()
    if abs(error - RIGIDITY_TOLERANCE) < 1e-12:
        return  # rounding decides
    if error > RIGIDITY_TOLERANCE:
        with pytest.raises(ArgumentError, match="not orthonormal"):
            as_pose("T", T)
    elif mirrored:
        with pytest.raises(ArgumentError, match="reflection"):
            as_pose("T", T)
    else:
        np.testing.assert_array_equal(as_pose("T", T), T)


@pytest.mark.parametrize("place", [(0, 0), (1, 2), (2, 2), (0, 3), (2, 3), (3, 3)])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_no_pose(place, bad):
    pose = np.eye(4)
    pose[place] = bad
    with pytest.raises(ArgumentError, match=r"^T: "):
        as_pose("T", pose)
