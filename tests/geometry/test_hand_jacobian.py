"""Jacobians, torques and shapes of hands against finite differences and Pinocchio's RNEA."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from hand_tools import (
    GRAVITY,
    difference_jacobian,
    joint,
    link,
    random_pose,
    random_q,
    rnea,
    sample_contacts,
    write_urdf,
)

from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import invert, pose_matrix


@pytest.fixture(scope="module", params=range(2))
def allegro(request):
    rng = np.random.default_rng(request.param)
    hand = Hand.assemble([Mount("allegro_right", random_pose(rng))])
    return hand.with_configuration(random_q(hand, rng))


def test_point_velocities_add_joints_and_base(allegro):
    rng = np.random.default_rng(3)
    links, points = sample_contacts(allegro, rng)
    rates = dict(zip(allegro.joint_names, rng.uniform(-1, 1, 16), strict=True))
    twist = rng.uniform(-1, 1, 6)
    J = allegro.contact_jacobian(links, points)
    by_joints = (J @ [rates[name] for name in allegro.actuated_joint_names]).reshape(-1, 3)
    arms = points - allegro.T_world_base[:3, 3]
    expected = by_joints + twist[:3] + np.cross(twist[3:], arms)
    np.testing.assert_allclose(
        allegro.point_velocities(links, points, rates, twist), expected, atol=1e-12
    )
    assert not allegro.point_velocities(links, points).any()


def test_collision_bodies_are_primitives_where_the_urdf_puts_them(allegro):
    bodies = allegro.collision_bodies()
    by_name = {body.name: body for body in bodies}
    assert len(by_name) == len(bodies) == 21
    spheres = {name for name in by_name if name.endswith("_tip")}
    for name, body in by_name.items():
        assert type(body.geometry) is (coal.Sphere if name in spheres else coal.Box)
    palm = by_name["palm_link"]
    np.testing.assert_allclose(2 * palm.geometry.halfSide, [0.0408, 0.1130, 0.095])
    np.testing.assert_allclose(
        palm.T_world_geometry,
        allegro.T_world_base @ pose_matrix([-0.0093, 0, -0.0475]),
        atol=1e-12,
    )
    tip = by_name["link_3.0_tip"]
    assert tip.geometry.radius == 0.012
    offset = (invert(allegro.pose_of("link_3.0")) @ tip.T_world_geometry)[:3, 3]
    np.testing.assert_allclose(offset, [0, 0, 0.0267], atol=1e-12)


CHAIN = (
    link("base")
    + link("a", mass=0.3)
    + link("b", '<cylinder radius="0.01" length="0.2"/>', mass=0.2)
    + link("c", '<box size="0.1 0.2 0.3"/>', mass=0.1)
    + link("d", mass=0.4)
)


def test_mimic_chains_in_any_order_with_every_joint_type(tmp_path):
    body = (
        CHAIN
        + joint("d", "c", "d", extra='<mimic joint="c" multiplier="0.5" offset="0.1"/>')
        + joint("c", "b", "c", "prismatic", extra='<mimic joint="a" multiplier="-2" offset="0.3"/>')
        + joint("b", "a", "b", "continuous", limit="")
        + joint("a", "base", "a", limit='lower="-0.2" upper="0.4" effort="2"')
    )
    rng = np.random.default_rng(6)
    hand = Hand.from_urdf(
        write_urdf(tmp_path, body),
        T_world_base=random_pose(rng),
        q={"a": 0.1, "b": 5.0},
        effort_limits={"b": 3.0},
    )
    assert hand.actuated_joint_names == ("a", "b")
    assert hand.q == pytest.approx({"a": 0.1, "b": 5.0, "c": 0.1, "d": 0.15})
    links = ["a", "b", "c", "d"]
    points = np.array([hand.pose_of(name)[:3, 3] for name in links]) + 0.02
    J = hand.contact_jacobian(links, points)
    np.testing.assert_allclose(J, difference_jacobian(hand, ["a", "b"], links, points), atol=1e-8)
    forces = rng.uniform(-5, 5, (4, 3))
    tau = rnea(hand, links, points, forces, GRAVITY)
    by_joint = dict(zip(hand.joint_names, tau, strict=True))
    expected = [by_joint["a"] - 2 * by_joint["c"] - by_joint["d"], by_joint["b"]]
    np.testing.assert_allclose(
        J.T @ forces.ravel() + hand.gravity_torques(GRAVITY), expected, atol=1e-10
    )
    shapes = {body.name: type(body.geometry) for body in hand.collision_bodies()}
    assert shapes == {"b": coal.Cylinder, "c": coal.Box}


def test_columns_follow_the_control_modes():
    fixed = Hand.assemble(
        [Mount("allegro_right")], control={"thumb": "position", "joint_13.0": "force"}
    )
    free = Hand.assemble([Mount("allegro_right")])
    links, points = ["link_15.0_tip", "link_3.0_tip"], np.full((2, 3), 0.05)
    kept = [free.actuated_joint_names.index(name) for name in fixed.actuated_joint_names]
    assert len(kept) == 13
    np.testing.assert_array_equal(
        fixed.contact_jacobian(links, points), free.contact_jacobian(links, points)[:, kept]
    )
    np.testing.assert_array_equal(
        fixed.gravity_torques(GRAVITY), free.gravity_torques(GRAVITY)[kept]
    )
    moving = fixed.point_velocities(links[:1], points[:1], {"joint_14.0": 1.0})
    assert np.abs(moving).max() > 1e-3
