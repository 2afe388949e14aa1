"""Coupled joints and tendons: from the joints' torques to those of the actuators."""

import numpy as np
import pytest
from hand_tools import GRAVITY, difference_jacobian, joint, link, random_pose, rnea, write_urdf

from graspless_pin import QuasistaticProblem, minimize_torque
from graspless_pin.errors import (
    ArgumentError,
    GrasplessPinWarning,
    RobotError,
)
from graspless_pin.findings import FindingCode
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.coupling import resolve_couplings
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.inspection import audit_urdf
from graspless_pin.geometry.robots.description import JointCoupling

CHAIN = "".join(link(name, mass=0.1) for name in ("base", "a", "b", "c", "d"))
for _name, _parent, _child in [
    ("a", "base", "a"),
    ("b", "a", "b"),
    ("c", "b", "c"),
    ("d", "c", "d"),
]:
    CHAIN += joint(_name, _parent, _child)


def robot(tmp_path, extra, body=CHAIN):
    write_urdf(tmp_path, body)
    file = tmp_path / "robot.yaml"
    file.write_text(f"name: r\nurdf: robot.urdf\n{extra}")
    return file


def check_torques(hand, joint_map):
    """J and g(q) of the actuators are the map's transpose applied to all joints' torques."""
    rng = np.random.default_rng(0)
    links = ["b", "c", "d", "d"]
    points = np.array([hand.pose_of(name)[:3, 3] for name in links]) + 0.03
    forces = rng.uniform(-5, 5, (4, 3))
    tau = rnea(hand, links, points, forces, GRAVITY)
    J = hand.contact_jacobian(links, points)
    torques = J.T @ forces.ravel() + hand.gravity_torques(GRAVITY)
    np.testing.assert_allclose(torques, np.asarray(joint_map).T @ tau, atol=1e-10)
    return J, links, points


def test_a_joint_may_follow_several_and_chains_in_any_order():
    couplings = [
        JointCoupling("d", {"c": 2.0, "a": -1.0}, 0.1),
        JointCoupling("c", {"a": 0.5, "b": 0.5}, -0.2),
    ]
    coupling = resolve_couplings(["a", "b", "c", "d"], couplings)
    assert coupling.leaders == (0, 1)
    np.testing.assert_allclose(coupling.S, [[1, 0], [0, 1], [0.5, 0.5], [0.0, 1.0]])
    np.testing.assert_allclose(coupling.offset, [0, 0, -0.2, -0.3])
    assert coupling.drivers([3]) == [1]
    again = resolve_couplings(["a", "b", "c", "d"], couplings[::-1])
    np.testing.assert_array_equal(again.S, coupling.S)


def test_circles_and_missing_leaders():
    with pytest.raises(RobotError, match="circle: a -> b -> a; remove one"):
        resolve_couplings(["a", "b"], [JointCoupling("a", {"b": 1}), JointCoupling("b", {"a": 1})])
    with pytest.warns(GrasplessPinWarning, match="'b' -> 'x'; they are treated as independent"):
        coupling = resolve_couplings(["a", "b"], [JointCoupling("b", {"a": 1, "x": 1})])
    np.testing.assert_array_equal(coupling.S, np.eye(2))


def test_couplings_of_a_robot_file_move_the_joints_and_sum_the_torques(tmp_path):
    file = robot(
        tmp_path,
        "couplings:\n"
        "  c: {follows: {a: 0.5, b: -0.5}, offset: 0.05}\n"
        "  d: {follows: b, multiplier: 2}\n",
    )
    pose = random_pose(np.random.default_rng(1))
    hand = Hand.assemble([Mount(file, pose, "m_")], q={"m_a": 0.2, "m_b": -0.1})
    assert hand.q == pytest.approx({"m_a": 0.2, "m_b": -0.1, "m_c": 0.2, "m_d": -0.2})
    alone = Hand.assemble([Mount(file, pose)], q={"a": 0.2, "b": -0.1})
    assert alone.actuated_joint_names == ("a", "b")
    J, links, points = check_torques(alone, [[1, 0], [0, 1], [0.5, -0.5], [0, 2]])
    np.testing.assert_allclose(J, difference_jacobian(alone, ["a", "b"], links, points), atol=1e-8)
    with pytest.raises(ArgumentError, match=r"q\['c'\]: is 0, but this joint mimics 'a', 'b'"):
        alone.with_configuration({"c": 0.0})
    with pytest.raises(ArgumentError, match=r"q\['d'\]: is 1.6 because it mimics 'b', outside"):
        alone.with_configuration({"b": 0.8})


def test_a_robot_file_mends_a_dangling_mimic(tmp_path):
    body = CHAIN.replace(
        '<joint name="d" type="revolute">', '<joint name="d" type="revolute"><mimic joint="typo"/>'
    )
    file = robot(tmp_path, "couplings: {d: {follows: c}}", body)
    assert Hand.assemble([Mount(file)]).actuated_joint_names == ("a", "b", "c")


TENDON = """tendons:
  flexor: {moment_arms: {b: 0.01, c: 0.02}}
effort_limits:
  flexor: {limit: 50, source: s}
"""


def test_one_tendon_on_two_joints_holds_only_their_common_pull(tmp_path):
    hand = Hand.assemble([Mount(robot(tmp_path, TENDON))], q={"b": 0.3, "c": -0.2})
    assert hand.actuated_joint_names == ("a", "d", "flexor", "flexor.passive_1")
    np.testing.assert_array_equal(hand.effort_limits, [[-2, -2, 0, 0], [2, 2, 50, 0]])
    links, points = ["d", "d"], np.array([[0.3, 0.1, 0.2], [-0.1, 0.2, 0.4]])
    J = hand.contact_jacobian(links, points)
    joints = Hand.assemble([Mount(tmp_path / "robot.urdf")], q={"b": 0.3, "c": -0.2})
    # Forces that the tendon alone balances at 30 N: 0.3 N m at b, 0.6 N m at c, nothing elsewhere.
    J_joints = joints.contact_jacobian(links, points)
    forces = np.linalg.lstsq(J_joints.T, [0.0, 0.3, 0.6, 0.0], rcond=None)[0]
    np.testing.assert_allclose(J.T @ forces, [0, 0, 30.0, 0.0], atol=1e-10)
    # Torques across it are felt by the passive motion, which has no motor.
    forces = np.linalg.lstsq(J_joints.T, [0.0, 0.6, -0.3, 0.0], rcond=None)[0]
    across = J.T @ forces
    np.testing.assert_allclose(across[:3], 0.0, atol=1e-10)
    assert abs(across[3]) == pytest.approx(np.hypot(0.6, 0.3))


def test_gravity_and_contacts_go_through_tendons_alike(tmp_path):
    hand = Hand.assemble([Mount(robot(tmp_path, TENDON))], q={"b": 0.3, "c": -0.2})
    R = np.array([0.01, 0.02])
    across = hand.actuation.from_joints[1:3, 3]
    np.testing.assert_allclose([across @ R, across @ across], [0.0, 1.0], atol=1e-15)
    tendon = [0.0, *(R / (R @ R)), 0.0]
    check_torques(hand, np.column_stack([np.eye(4)[0], np.eye(4)[3], tendon, [0, *across, 0]]))


def test_as_many_tendons_as_joints_leave_nothing_passive(tmp_path):
    extra = """tendons:
  near: {moment_arms: {b: 0.01}}
  far: {moment_arms: {b: 0.01, c: 0.01}}
effort_limits:
  near: {limit: [-5, 20], source: s}
  far: {limit: 30, source: s}
"""
    hand = Hand.assemble([Mount(robot(tmp_path, extra), prefix="m_")])
    assert hand.actuated_joint_names == ("m_a", "m_d", "m_near", "m_far")
    np.testing.assert_array_equal(hand.effort_limits[0], [-2, -2, -5, 0])
    np.testing.assert_array_equal(hand.effort_limits[1], [2, 2, 20, 30])
    # 1 N on far alone: 0.01 N m at b and c. Then near must read 0.
    np.testing.assert_allclose(
        hand.actuation.from_joints.T @ [0.0, 0.01, 0.01, 0.0], [0, 0, 0, 1], atol=1e-12
    )


def test_a_tendon_may_pull_coupled_joints(tmp_path):
    extra = TENDON + "couplings: {c: {follows: b, multiplier: 2}}\n"
    hand = Hand.assemble([Mount(robot(tmp_path, extra))])
    assert hand.actuated_joint_names == ("a", "d", "flexor")
    # The pull is 0.01 + 2 * 0.02 m at b, which feels tau_b + 2 tau_c.
    np.testing.assert_allclose(hand.actuation.from_joints.T @ [0, 0.3, 0.1, 0], [0, 0, 10.0])


def test_position_controlled_tendons_have_no_column(tmp_path):
    file = robot(tmp_path, TENDON)
    hand = Hand.assemble([Mount(file)], control={"b": "position", "c": "position"})
    assert hand.actuated_joint_names == ("a", "d")


@pytest.mark.parametrize(
    ("extra", "options", "message"),
    [
        (TENDON, {"control": {"b": "position"}}, "joints of tendon flexor have different control"),
        (TENDON, {"effort_limits": {"b": 1.0}}, r"\['b'\]: tendon 'flexor' pulls this joint"),
        ("tendons: {a: {moment_arms: {b: 1}}}", {}, r"tendons\['a'\]: has the name of a joint"),
        ("tendons: {t: {moment_arms: {b: 0}}}", {}, r"tendons\['t'\]: needs a moment arm"),
        (
            "tendons: {s: {moment_arms: {b: 1}}, t: {moment_arms: {b: 2}}}",
            {},
            "s, t are redundant: they pull the same joints",
        ),
        (
            TENDON + "fingers: {f: {joints: [b, c]}}",
            {"effort_limits": {"f": 1.0}},
            r"\['f'\]: no joint motor moves this finger; give limits of its tendons",
        ),
    ],
)
def test_bad_tendons(tmp_path, extra, options, message):
    with pytest.raises(ArgumentError, match=message):
        Hand.assemble([Mount(robot(tmp_path, extra))], **options)


def test_a_tendon_without_limit_and_unknown_limits_warn(tmp_path):
    file = robot(tmp_path, "tendons: {t: {moment_arms: {b: 0.01}}}")
    with pytest.warns(GrasplessPinWarning, match=r"placeholders: 't' \(unlimited\)"):
        hand = Hand.assemble([Mount(file)])
    np.testing.assert_array_equal(hand.effort_limits[1], [2, 2, 2, np.inf])
    file = robot(tmp_path, "effort_limits: {a: {unknown: nobody knows}}")
    with pytest.warns(
        GrasplessPinWarning, match=r"declares to be unknown: 'a' \(2\): nobody knows"
    ):
        Hand.assemble([Mount(file)])
    Hand.assemble([Mount(file)], effort_limits={"a": 1.0})


STRAIGHT = """<robot name="r"><link name="base"/><link name="near"/><link name="far"/>
<joint name="b" type="revolute"><parent link="base"/><child link="near"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="c" type="revolute"><parent link="near"/><child link="far"/><origin xyz="0.05 0 0"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_an_underactuated_finger_holds_what_its_one_tendon_can_hold(tmp_path):
    """A straight finger under a load: 4 N at 30 mm, 3 N at 80 mm, tendon at 20 and 5 mm.

    Far joint: 0.03 * 3 = 0.005 t; near joint: 0.03 * 4 + 0.08 * 3 = 0.02 t; both give t = 18 N.
    """
    (tmp_path / "finger.urdf").write_text(STRAIGHT)
    file = tmp_path / "finger.yaml"
    file.write_text(
        "name: f\nurdf: finger.urdf\ntendons: {t: {moment_arms: {b: 0.02, c: 0.005}}}\n"
        "effort_limits: {t: {limit: 50, source: s}}\n"
    )
    hand = Hand.assemble([Mount(file)])
    points = np.array([[0.03, 0.0, 0.0], [0.08, 0.0, 0.0]])

    def solve(first, second):
        load = [0.0, -first - second, 0.0]
        moment = [0.0, 0.0, -0.03 * first - 0.08 * second]
        problem = QuasistaticProblem(
            points,
            [[0, 1, 0], [0, 1, 0]],
            [*load, *moment],
            hand.contact_jacobian(["near", "far"], points),
            friction=0.0,
            torque_limits=hand.effort_limits,
            joint_names=list(hand.actuated_joint_names),
        )
        return minimize_torque(problem, margin=0.0)

    held = solve(4.0, 3.0)
    np.testing.assert_allclose(held.torques, [18.0, 0.0], atol=1e-5)
    assert not solve(3.0, 4.0).found
    assert not solve(40.0, 30.0).found  # 180 N of tension


def test_a_joint_that_nobody_names_stands_where_its_followers_may(tmp_path):
    """Zero would take the follower to -0.028, outside its limits of 0 and 0.035."""
    narrow = joint("b", "a", "b", limit='lower="0" upper="0.035" effort="2"')
    body = CHAIN.replace(joint("b", "a", "b"), narrow)
    file = robot(tmp_path, "couplings:\n  b: {follows: {a: 0.5}, offset: -0.028}\n", body)
    hand = Hand.assemble([Mount(file)])
    by_name = dict(zip(hand.joint_names, hand.positions.tolist(), strict=True))
    assert by_name["a"] == pytest.approx(0.056)
    assert by_name["b"] == pytest.approx(0.0, abs=1e-15)
    again = hand.with_configuration({"a": by_name["a"]})
    np.testing.assert_array_equal(again.positions, hand.positions)
    said = [item.message for item in audit_urdf(file).findings if item.subject == "joint a"]
    assert said == ["zero is outside the limits of its followers; if not in q, it is at 0.056"]


@pytest.mark.parametrize(
    ("factor", "offset", "limits", "left_out"),
    [
        (-1.0, 0.0, (0.0, 0.548), True),  # a mirrored jaw with its twin's limits
        (1.0, 0.0, (0.5484, 1.0), True),  # a hair apart
        (-1.0, 0.0, (-0.548, 0.0), False),
        (1.0, 0.0, (0.3, 1.0), False),  # narrows its leader
        (1.0, 0.0, (0.0, 0.0), False),  # locks it
    ],
)
def test_limits_that_leave_a_leader_nowhere_to_go_are_left_out(
    tmp_path, factor, offset, limits, left_out
):
    written = 'lower="{:g}" upper="{:g}" effort="2"'
    body = CHAIN.replace(
        joint("a", "base", "a"), joint("a", "base", "a", limit=written.format(0, 0.548))
    )
    mimic = f'<mimic joint="a" multiplier="{factor}" offset="{offset}"/>'
    body = body.replace(
        joint("b", "a", "b"), joint("b", "a", "b", limit=written.format(*limits), extra=mimic)
    )
    file = write_urdf(tmp_path, body)
    code = FindingCode.CONTRADICTING_LIMITS
    found = [one for one in audit_urdf(file).findings if one.code is code]
    assert [one.subject for one in found] == ["joint b"] * left_out
    if not left_out:
        return
    assert "leave no range to a" in found[0].message
    with pytest.warns(GrasplessPinWarning, match="leave no range"):
        hand = Hand.from_urdf(file)
    for position in (0.0, 0.3, 0.548):
        moved = hand.with_configuration({"a": position})
        assert moved.q["b"] == factor * position + offset
    assert hand.tree.ranges[0][0] == 0.0 and hand.tree.ranges[1][0] == 0.548
