"""Several robots as one hand, and the paper's levers."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from hand_tools import GRAVITY, difference_jacobian, random_pose

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.mounts import Mount
from graspless_pin.geometry.robots.description import FingerSpec

Q = np.sqrt(0.5)
H, A = 0.05 * Q, 0.2 * Q
N1, N3 = np.array([-0.612, 0.707, 0.354]), np.array([-0.612, -0.707, 0.354])
SPHERE = [(n / np.linalg.norm(n), -0.1 * n / np.linalg.norm(n)) for n in (N1, N3)]
CUBOID = [
    (np.array([0.0, 1, 0]), np.array([H, -0.1, H])),
    (np.array([0.0, -1, 0]), np.array([H, 0.1, H])),
]


def lever_base_pose(point, normal, direction, length):
    """Return where to mount a lever so that its tip touches a point, pressing along a normal.

    With r the direction across the normal n, the tip's Jacobian at q = 0 is -length n^T.
    """
    n = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    r = direction - (np.asarray(direction) @ n) * n
    r /= np.linalg.norm(r)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([r, -n, np.cross(n, r)])
    T[:3, 3] = np.asarray(point, dtype=float) - length * r
    return T


def two_levers(sources, contacts, direction, length):
    return Hand.assemble(
        [
            Mount(source, lever_base_pose(p, n, direction, length), prefix)
            for source, prefix, (n, p) in zip(sources, ("left_", "right_"), contacts, strict=True)
        ]
    )


def poles(hand, contacts):
    """Tip centre plus radius along the normal: where the tip touches."""
    bodies = {body.name: body for body in hand.collision_bodies()}
    points = []
    for prefix, (n, _) in zip(("left_", "right_"), contacts, strict=True):
        tip = bodies[f"{prefix}tip"]
        assert isinstance(tip.geometry, coal.Sphere)
        points.append(tip.T_world_geometry[:3, 3] + tip.geometry.radius * n)
    return np.array(points)


def test_levers_on_the_sphere_have_the_papers_jacobian():
    hand = two_levers(["lever_150mm"] * 2, SPHERE, [0, 0, -1], 0.15)
    touching = poles(hand, SPHERE)
    np.testing.assert_allclose(touching, [p for _, p in SPHERE], atol=1e-12)
    J = hand.contact_jacobian(["left_tip", "right_tip"], touching)
    expected = np.zeros((6, 2))
    expected[:3, 0], expected[3:, 1] = -0.15 * SPHERE[0][0], -0.15 * SPHERE[1][0]
    np.testing.assert_allclose(J, expected, atol=1e-12)
    assert hand.actuated_joint_names == ("left_hinge", "right_hinge")
    np.testing.assert_array_equal(hand.effort_limits, [[-10, -10], [10, 10]])
    np.testing.assert_allclose(hand.gravity_torques(GRAVITY), 0.0, atol=1e-15)


def test_levers_on_the_cuboid_have_the_papers_jacobian():
    hand = two_levers(["lever_100mm", "lever_100mm_mirrored"], CUBOID, [0, 0, -1], 0.1)
    touching = poles(hand, CUBOID)
    np.testing.assert_allclose(touching, [p for _, p in CUBOID], atol=1e-12)
    J = hand.contact_jacobian(["left_tip", "right_tip"], touching)
    expected = np.zeros((6, 2))
    expected[1, 0] = expected[4, 1] = -0.1
    np.testing.assert_allclose(J, expected, atol=1e-12)
    np.testing.assert_allclose(hand.gravity_torques(GRAVITY), 0.0, atol=1e-15)


def test_two_levers_together_equal_two_alone():
    rng = np.random.default_rng(0)
    poses = [random_pose(rng), random_pose(rng)]
    both = Hand.assemble(
        [Mount("lever_150mm", poses[0], "l_"), Mount("lever_100mm", poses[1], "r_")],
        q={"l_hinge": 0.4, "r_hinge": -0.7},
    )
    points = rng.uniform(-1, 1, (2, 3))
    J = both.contact_jacobian(["l_tip", "r_lever"], points)
    assert both.joint_names == ("l_hinge", "r_hinge")
    for row, (source, angle, name, prefix) in enumerate(
        [("lever_150mm", 0.4, "tip", "l_"), ("lever_100mm", -0.7, "lever", "r_")]
    ):
        alone = Hand.assemble([Mount(source, poses[row])], q={"hinge": angle})
        rows = slice(3 * row, 3 * row + 3)
        np.testing.assert_allclose(
            J[rows, [row]], alone.contact_jacobian([name], points[[row]]), atol=1e-12
        )
        assert not J[rows, 1 - row].any()
        np.testing.assert_allclose(both.link_pose(prefix + name), alone.link_pose(name), atol=1e-12)
        np.testing.assert_array_equal(both.base_poses[prefix], poses[row])
    np.testing.assert_allclose(
        J, difference_jacobian(both, both.joint_names, ["l_tip", "r_lever"], points), atol=1e-8
    )
    assert both.finger_of("l_tip") == "l_finger"
    assert both.finger_of("r_base") is None


def test_an_arm_and_a_lever_keep_their_couplings_and_limits():
    hand = Hand.assemble(
        [
            Mount("panda", prefix="a_"),
            Mount("lever_100mm", random_pose(np.random.default_rng(1)), "b_"),
        ],
        control=dict.fromkeys([f"a_panda_joint{i}" for i in range(1, 8)], "position"),
        effort_limits={"a_panda_finger_joint1": (-5, 70)},
        q={"a_panda_finger_joint1": 0.02},
    )
    assert hand.actuated_joint_names == ("a_panda_finger_joint1", "b_hinge")
    assert hand.q["a_panda_finger_joint2"] == 0.02
    np.testing.assert_array_equal(hand.effort_limits, [[-5, -10], [70, 10]])


def test_bases_move_as_one_rigid_body():
    hand = Hand.assemble(
        [Mount("lever_100mm", random_pose(np.random.default_rng(s)), f"{s}_") for s in (2, 3)]
    )
    twist = np.array([0.1, -0.2, 0.3, 1.0, -0.5, 0.25])
    origins = np.array([pose[:3, 3] for pose in hand.base_poses.values()])
    velocities = hand.point_velocities(["2_base", "3_base"], origins, base_twist=twist)
    np.testing.assert_allclose(velocities[0], twist[:3], atol=1e-12)
    np.testing.assert_allclose(
        velocities[1] - velocities[0], np.cross(twist[3:], origins[1] - origins[0]), atol=1e-12
    )


def test_hybrid_finger_has_no_joint_column():
    hand = Hand.assemble(
        [Mount("lever_150mm", prefix="l_"), Mount("lever_150mm", prefix="r_")],
        control={"r_finger": "hybrid"},
    )
    assert hand.actuated_joint_names == ("l_hinge",)
    assert hand.control.hybrid_fingers == ("r_finger",)
    assert [hand.is_hybrid(name) for name in ("l_tip", "r_tip", "r_base")] == [False, True, False]


def test_fingers_given_by_joints_take_the_links_they_move():
    hand = Hand.assemble(
        [Mount("allegro_right_hand", fingers={"thumb": FingerSpec(("joint_13.0", "joint_14.0"))})]
    )
    assert hand.fingers["thumb"].links == ("link_13.0", "link_14.0", "link_15.0", "link_15.0_tip")
    assert hand.finger_of("link_12.0") is None


@pytest.mark.parametrize(
    ("mounts", "message"),
    [
        ([], "mounts: .*at least one"),
        ([Mount("lever_100mm"), Mount("lever_150mm")], "mounts: prefixes must differ"),
        ([Mount("lever_100mm", np.zeros((4, 4)))], "T_world_base: "),
        ([Mount("lever_100mm", package_dirs=["."])], "package_dirs: .*URDF"),
    ],
)
def test_bad_mounts(mounts, message):
    with pytest.raises(ArgumentError, match=message):
        Hand.assemble(mounts)
