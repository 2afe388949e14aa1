"""How far things may be off under torques chosen for it, against a linear program of its own."""

import json
from typing import Any

import numpy as np
import pytest
from analysis_scenes import contacts_alone
from scipy.optimize import linprog
from tests.oracles.uncertain_members import BALANCED, Balance, imbalance, yielding

from graspless_pin import QuasistaticProblem, minimize_torque, tolerances
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.report.robust import tolerances_data

COULOMB: dict[str, Any] = {"static_friction": "coulomb"}
WAYS = {"push": "force", "moment": "moment", "centre of mass": "center_of_mass"}


def served_together(problem, members, added):
    """Whether one vector of torques within limits balances all of (friction, wrench, made, offset).

    Torques that are made are ``made`` times the commanded ones, and the offset.
    """
    balance = Balance(problem)
    loaded, count = balance.loaded, len(balance.places)
    joints = int(loaded.sum())
    free = np.zeros((joints, 0)) if added is None else added[loaded]
    size = count + free.shape[1]
    width = joints + len(members) * size
    A, b, most = [], [], []
    for number, (friction, wrench, made, offset) in enumerate(members):
        rows = np.zeros((6 + joints, width))
        own = slice(joints + number * size, joints + number * size + count)
        rows[:, own] = balance.rows + balance.by_friction * friction[balance.places]
        rows[6:, :joints] = -np.diag(made[loaded])
        rows[6:, own.stop : own.stop + free.shape[1]] = -made[loaded][:, None] * free
        A.append(rows)
        b.append(np.concatenate([-wrench, offset[loaded]]))
        for place in range(problem.contact_count):
            pressed = np.zeros(width)
            pressed[own] = balance.places == place
            most.append(pressed)
    limits = np.tile(problem.max_normal_force, len(members))
    bounds = list(zip(problem.lower_torque[loaded], problem.upper_torque[loaded], strict=True))
    bounds += ([(0, None)] * count + [(None, None)] * free.shape[1]) * len(members)
    A, b = np.vstack(A), np.concatenate(b)
    sizes = np.abs(A).max(axis=1)
    answer = linprog(
        np.zeros(width), A_ub=np.array(most), b_ub=limits, A_eq=A / sizes[:, None], b_eq=b / sizes,
        bounds=bounds, method="highs",
    )  # fmt: skip
    assert answer.status in (0, 2), answer.message
    return answer.status == 0


def changed(problem, quantity, off, sizes):
    """Return friction, wrench, factors and offsets with a quantity off.

    Args:
        off: Share, or (3,) or (L,).
    """
    mu, w = problem.friction, problem.external_wrench
    made, offset = np.ones(sizes), np.zeros(sizes)
    if quantity in (Quantity.MASS_MORE, Quantity.MASS_LESS):
        w = (1.0 + off) * w
    elif quantity is Quantity.CENTER:
        w = w + np.concatenate([np.zeros(3), np.cross(off, w[:3])])
    elif quantity is Quantity.PUSH:
        w = w + np.concatenate([off, np.zeros(3)])
    elif quantity is Quantity.MOMENT:
        w = w + np.concatenate([np.zeros(3), off])
    elif quantity is Quantity.FRICTION:
        mu = (1.0 - off) * mu
    elif quantity is Quantity.JOINT:
        offset = off
    else:
        made = (1.0 + off) * made
    return mu, w, made, offset


def what_is_off(problem, quantity, member):
    """Read from a member in conflict how far the quantity is off."""
    corner = member.corner
    if corner is None:
        return 0.0 * np.zeros(3) if quantity.value in WAYS else _nothing(problem, quantity)
    if quantity in (Quantity.MASS_MORE, Quantity.MASS_LESS):
        return corner.mass
    if quantity.value in WAYS:
        return getattr(corner, WAYS[quantity.value])
    if quantity is Quantity.FRICTION:
        return 1.0 - float((member.problem.friction / problem.friction).min())
    if quantity is Quantity.JOINT:
        return member.offsets
    return float(np.ptp(np.append(member.factors, 1.0))) * np.sign(member.factors.sum() - 1.0)


def _nothing(problem, quantity):
    return np.zeros(problem.joint_count) if quantity is Quantity.JOINT else 0.0


def drawn(rng, problem, quantity, size):
    """Draw how far a quantity is off at a size."""
    if quantity.value in WAYS:
        way = rng.normal(size=3)
        return size * way / np.linalg.norm(way)
    if quantity is Quantity.JOINT:
        joints = np.flatnonzero(problem.jacobian.any(axis=0))
        return size * rng.choice([-1.0, 1.0]) * np.eye(problem.joint_count)[rng.choice(joints)]
    less = quantity in (Quantity.MASS_LESS, Quantity.TORQUE_LESS)
    return (-1.0 if less else 1.0) * size * rng.uniform()


@pytest.mark.parametrize(
    ("name", "feedback", "quantities"),
    [
        ("paper/cuboid_at_rest", None, [one for one in Quantity if one != "moment"]),
        ("allegro_sphere_on_slope", 1.0, ["more mass", "push", "friction"]),
        ("allegro_mug_against_wall", None, ["less mass", "one joint's torque"]),
    ],
)
def test_torques_for_each_bear_it_and_none_bear_more(name, feedback, quantities):
    problem = contacts_alone(name)
    torques = minimize_torque(problem, 0.05, **COULOMB).torques
    off = tolerances(
        problem, torques, feedback=feedback, quantities=quantities, attainable=True, **COULOMB
    )
    added = None if feedback is None else yielding(problem)
    rng, count = np.random.default_rng(0), problem.joint_count
    assert [one.quantity for one in off.attainable] == [one.quantity for one in off.each]
    for given, one in zip(off.each, off.attainable, strict=True):
        assert one.balanced >= given.balanced
        assert one.failing == np.inf or one.balanced >= 0.985 * one.failing or one.balanced == 0.0
        if one.quantity is Quantity.TILT:
            continue
        assert (one.torques <= problem.upper_torque + 1e-9).all()
        for _ in range(6):
            there = drawn(rng, problem, one.quantity, 0.99 * one.balanced)
            mu, w, made, offset = changed(problem, one.quantity, there, count)
            member = problem.with_changes(friction=mu, external_wrench=w)
            assert imbalance(member, made * one.torques + offset, added) < 2.0 * BALANCED
        if not np.isfinite(one.failing):
            continue
        assert one.conflict
        if one.free_motion is not None:
            continue  # what is balanced is rounding
        if one.quantity.value in WAYS:
            lengths = [
                np.linalg.norm(what_is_off(problem, one.quantity, of)) for of in one.conflict
            ]
            assert max(lengths) <= (1.0 + 1e-9) * one.failing
        for times, served in ((1.01, False), (0.98 * one.balanced / one.failing, True)):
            at = [times * what_is_off(problem, one.quantity, member) for member in one.conflict]
            members = [changed(problem, one.quantity, there, count) for there in at]
            assert served_together(problem, members, added) is served, (one.quantity, times)


def test_a_motion_that_no_contact_resists_is_named():
    """A ball rolls: no torques are right for two masses along that motion."""
    problem = contacts_alone("allegro_sphere_on_slope")
    torques = minimize_torque(problem, 0.05, **COULOMB).torques
    off = tolerances(problem, torques, quantities=["more mass"], attainable=True, **COULOMB)
    (one,) = off.attainable
    assert one.balanced < 1e-3 and one.why == "free motion"
    motion = one.free_motion
    assert motion is not None
    rows = np.hstack([problem.W.T, -problem.jacobian])
    assert np.abs(rows @ motion).max() < 1e-8 * np.abs(motion).max() * np.abs(rows).max()
    # Contacts do no work on it: load and motors do none together, without weights of joints.
    power = motion[:6] @ problem.external_wrench, motion[6:] @ torques
    assert sum(power) == pytest.approx(0.0, abs=1e-6 * np.abs(power).max())
    works = [motion[:6] @ member.problem.external_wrench for member in one.conflict]
    assert np.ptp(works) > 1e-9
    assert "free motion" in str(off)
    (told,) = tolerances_data(off)
    told = json.loads(json.dumps(told))["attainable"]
    assert len(told["conflict"]) == 2 and told["complete"]


def test_a_block_bears_a_push_as_its_feet_do_by_hand():
    """No joints: torques change nothing, and both answers are the same."""
    feet = [[0.1, 0.0, -0.05], [-0.05, 0.08, -0.05], [-0.05, -0.08, -0.05]]
    problem = QuasistaticProblem(
        feet, [[0.0, 0.0, 1.0]] * 3, [0.0, 0.0, -9.8, 0.0, 0.0, 0.0], friction=0.5, cone_edges=16
    )
    off = tolerances(problem, np.zeros(0), attainable=True, **COULOMB)
    for given, one in zip(off.each, off.attainable, strict=True):
        assert one.balanced == pytest.approx(given.balanced, rel=0.015) or given.failing == np.inf


def test_a_centre_of_mass_may_be_off_to_the_nearest_edge_between_the_feet():
    """By hand: 4.71 cm, halfway between two corners of the polygon that stands for the disc."""
    way = np.radians(61.875)
    half = 0.16 / np.tan(way)
    feet = [[0.1, 0.0, -0.05], [-0.06, half, -0.05], [-0.06, -half, -0.05]]
    problem = QuasistaticProblem(
        feet, [[0.0, 0.0, 1.0]] * 3, [0.0, 0.0, -9.8, 0.0, 0.0, 0.0], friction=0.5
    )
    off = tolerances(
        problem, np.zeros(0), quantities=["centre of mass"], attainable=True, **COULOMB
    )
    (one,), edge = off.attainable, 0.1 * np.cos(way)
    assert 0.98 * edge <= one.balanced <= (1.0 + 1e-6) * edge
    assert (1.0 - 1e-6) * edge <= one.failing <= 1.02 * edge
    ways = [[np.cos(way), np.sin(way), 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    np.testing.assert_allclose(off.each[0].along(ways), [edge, 0.1, 0.06], rtol=1e-5)


def test_time_that_is_over_leaves_it_open():
    problem = contacts_alone("paper/cuboid_at_rest")
    torques = minimize_torque(problem, 0.05, **COULOMB).torques
    off = tolerances(
        problem, torques, quantities=["friction"], attainable=True, time_limit=1e-9, **COULOMB
    )
    (one,) = off.attainable
    assert not one.complete and one.failing == np.inf
    assert one.balanced == off.of("friction").balanced
    assert "not decided in time" in str(off)
