"""The enumeration of outcomes, on cases solved by hand and against itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.oracles.outcome_cases import random_rest_case
from tests.oracles.outcome_polish import EXACT
from tests.oracles.outcomes import enumerate_outcomes
from tests.oracles.rest_cases import Outcome, RestCase, worst_violation

G = 9.81
MU = 0.5
CRITICAL = np.arctan(MU)


def body(positions, normals, friction, wrench, *, mass=1.0, turning=1e-3, fingers=(), torques=()):
    """A case whose fingers have one joint each: (contact, direction of its motion, inertia)."""
    count = len(positions)
    jacobian = np.zeros((3 * count, len(fingers)))
    for column, (contact, direction, _) in enumerate(fingers):
        jacobian[3 * contact : 3 * contact + 3, column] = direction
    return RestCase(
        np.array(positions, dtype=float),
        np.array(normals, dtype=float),
        np.broadcast_to(np.array(friction, dtype=float), count),
        np.array([*wrench, 0.0, 0.0, 0.0]),
        jacobian,
        np.array(torques, dtype=float),
        np.diag([mass] * 3 + [turning] * 3),
        np.diag([inertia for *_, inertia in fingers]).reshape(len(fingers), len(fingers)),
    )


def block_on_slope(angle):
    feet = [[0.05, 0.0, -0.02], [-0.05, 0.05, -0.02], [-0.05, -0.05, -0.02]]
    weight = [G * np.sin(angle), 0.0, -G * np.cos(angle)]
    return body(feet, [[0, 0, 1]] * 3, MU, weight)


def slot(friction):
    """A body between two walls that do not press."""
    return body([[-0.05, 0, 0], [0.05, 0, 0]], [[1, 0, 0], [-1, 0, 0]], friction, [0, 0, -G])


def pushed_ball(force, torque, *, friction=0.0):
    """A ball of 2 kg on a smooth table, before a finger of 0.5 kg m^2 with a lever of 0.1 m."""
    positions, normals = [[0, 0, -0.1], [-0.1, 0, 0]], [[0, 0, 1], [1, 0, 0]]
    push = (1, [0.1, 0.0, 0.0], 0.5)
    return body(positions, normals, [0.0, friction], [force, 0, -2.0 * G], mass=2.0,
                fingers=[push], torques=[torque])  # fmt: skip


def wedge(angle, friction):
    """A point of 1 kg on a wedge of 3 kg that is free to move along x."""
    normal = [np.sin(angle), 0.0, np.cos(angle)]
    return body([[0, 0, 0]], [normal], friction, [0, 0, -G],
                fingers=[(0, [1.0, 0.0, 0.0], 3.0)], torques=[0.0])  # fmt: skip


@pytest.mark.parametrize("share", [0.3, 0.98])
def test_block_below_the_critical_slope_can_only_rest(share):
    answer = enumerate_outcomes(block_on_slope(share * CRITICAL))
    assert (answer.status, answer.rest, answer.moving) == ("strong", True, False)


def test_block_above_the_critical_slope_slides_down():
    angle = 1.02 * CRITICAL
    answer = enumerate_outcomes(block_on_slope(angle))
    assert (answer.status, answer.rest, answer.moving) == ("none", False, True)
    down = G * (np.sin(angle) - MU * np.cos(angle))
    assert answer.outcome is not None
    np.testing.assert_allclose(answer.outcome.acceleration, [down, 0, 0, 0, 0, 0], atol=1e-9)


def test_body_between_walls_stays_or_falls():
    answer = enumerate_outcomes(slot(MU))
    assert (answer.status, answer.rest, answer.moving) == ("weak", True, True)
    assert answer.outcome is not None
    assert answer.outcome.acceleration[2] < -1e-3 * G


def test_body_between_smooth_walls_falls():
    answer = enumerate_outcomes(slot(0.0))
    assert answer.status == "none"
    assert answer.outcome is not None
    np.testing.assert_allclose(answer.outcome.acceleration, [0, 0, -G, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(answer.outcome.forces, 0.0, atol=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_finger_and_ball_accelerate_together(friction):
    answer = enumerate_outcomes(pushed_ball(0.0, 1.0, friction=friction))
    assert answer.status == "none"
    assert answer.outcome is not None
    along = (1.0 / 0.1) / (2.0 + 0.5 / 0.1**2)
    np.testing.assert_allclose(answer.outcome.acceleration[0], along, rtol=1e-9)
    np.testing.assert_allclose(answer.outcome.acceleration[6], along / 0.1, rtol=1e-9)
    np.testing.assert_allclose(answer.outcome.forces[1], [2.0 * along, 0, 0], atol=1e-9)


def test_finger_with_inertia_stops_touching_a_ball_that_is_pulled_away():
    answer = enumerate_outcomes(pushed_ball(5.0, 1.0))
    assert answer.outcome is not None
    np.testing.assert_allclose(answer.outcome.acceleration[[0, 6]], [2.5, 2.0], rtol=1e-9)
    np.testing.assert_allclose(answer.outcome.forces[1], 0.0, atol=1e-9)


def test_finger_that_leaves_does_not_move_the_object():
    answer = enumerate_outcomes(pushed_ball(0.0, -1.0))
    assert (answer.status, answer.rest, answer.moving) == ("none", False, False)


def test_finger_that_holds_against_a_pull_can_only_rest():
    answer = enumerate_outcomes(pushed_ball(-10.0, 1.0))
    assert answer.status == "strong"


def test_wedge_slides_from_under_the_mass():
    angle = 0.4
    answer = enumerate_outcomes(wedge(angle, 0.0))
    assert answer.status == "none"
    assert answer.outcome is not None
    back = -G * np.sin(angle) * np.cos(angle) / (3.0 + np.sin(angle) ** 2)
    np.testing.assert_allclose(answer.outcome.acceleration[6], back, rtol=1e-9)
    np.testing.assert_allclose(answer.outcome.acceleration[0], -3.0 * back, rtol=1e-9)


def test_friction_keeps_the_mass_on_the_wedge():
    assert enumerate_outcomes(wedge(0.4, 1.05 * np.tan(0.4))).status == "strong"
    assert enumerate_outcomes(wedge(0.4, 0.95 * np.tan(0.4))).status == "none"


def pressed_point(push):
    """A point of 1 kg on a slope above the critical one, pressed onto it by a hybrid finger."""
    angle = 1.3 * CRITICAL
    weight = [G * np.sin(angle), 0.0, -G * np.cos(angle)]
    need = (weight[0] + MU * weight[2]) / (MU + 0.3)
    return body([[0, 0, 0]] * 2, [[0, 0, 1], [0, 0, -1]], [MU, 0.3], weight,
                fingers=[(1, [0.0, 0.0, -1.0], 0.0)], torques=[push * need])  # fmt: skip


def test_hybrid_finger_holds_by_the_force_that_it_commands():
    assert enumerate_outcomes(pressed_point(1.02)).status == "strong"
    case = pressed_point(0.98)
    answer = enumerate_outcomes(case)
    assert answer.status == "none"
    assert answer.outcome is not None
    down = 0.02 / 0.98 * (MU + 0.3) * case.torques[0]
    np.testing.assert_allclose(answer.outcome.acceleration[0], down, rtol=1e-9)


def test_hybrid_finger_follows_what_it_pushes():
    case = replace(pushed_ball(0.0, 3.0), joint_inertia=np.zeros((1, 1)))
    case.jacobian[3, 0] = 1.0
    answer = enumerate_outcomes(case)
    assert answer.outcome is not None
    np.testing.assert_allclose(answer.outcome.acceleration[[0, 6]], [1.5, 1.5], rtol=1e-9)
    np.testing.assert_allclose(answer.outcome.forces[1], [3.0, 0, 0], atol=1e-9)


def seeded(seed, contacts=2):
    rng = np.random.default_rng([7, seed])
    fingers, joints = int(rng.integers(0, contacts + 1)), int(rng.integers(1, 4))
    return random_rest_case(rng, contacts, fingers, joints)


@pytest.mark.parametrize("seed", range(16))
def test_answers_are_consistent(seed):
    case = seeded(seed, 2 + (seed % 4 == 0))
    answer = enumerate_outcomes(case, sectors=8)
    assert answer.status != "between"
    if answer.outcome is not None:
        assert worst_violation(case, answer.outcome) <= EXACT
        assert case.object_motion(answer.outcome.acceleration) > 1e-3 * case.load_over_mass
    # With inertia some outcome always exists: where the object does not rest, it or a finger moves.
    if answer.rest is False and answer.moving is False:
        assert len(case.torques) > 0


@pytest.mark.parametrize("seed", range(6))
def test_rotation_and_order_change_nothing(seed):
    case = seeded(seed)
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    both = np.kron(np.eye(2), turn)
    order = np.arange(len(case.normals))[::-1]
    rows = (turn @ case.jacobian.reshape(len(order), 3, -1))[order]
    turned = replace(
        case,
        positions=(case.positions @ turn.T)[order],
        normals=(case.normals @ turn.T)[order],
        friction=case.friction[order],
        external_wrench=both @ case.external_wrench,
        jacobian=rows.reshape(3 * len(order), -1),
        object_inertia=both @ case.object_inertia @ both.T,
    )
    first, second = (enumerate_outcomes(one, sectors=8) for one in (case, turned))
    assert (first.status, first.rest, first.moving) == (second.status, second.rest, second.moving)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_units_change_nothing(factor):
    case = seeded(2)
    light = replace(
        case,
        external_wrench=factor * case.external_wrench,
        torques=factor * case.torques,
        object_inertia=factor * case.object_inertia,
        joint_inertia=factor * case.joint_inertia,
    )
    assert enumerate_outcomes(light, sectors=8).status == enumerate_outcomes(case, sectors=8).status


def test_worst_violation_sees_each_condition():
    angle = 1.1 * CRITICAL
    case = block_on_slope(angle)
    outcome = enumerate_outcomes(case, sectors=8).outcome
    assert outcome is not None
    a, f = outcome
    assert worst_violation(case, outcome) <= EXACT
    into, apart = np.zeros(6), np.zeros(6)
    into[2], apart[2] = -0.1, 0.1
    spoilt = {
        "dynamics": Outcome(a * 1.1, f),
        "penetration": Outcome(a + into, f),
        "apart with a force": Outcome(a + apart, f),
        "against friction": Outcome(a, f * [-1.0, 1.0, 1.0]),
        "outside the cone": Outcome(a, f * [1.1, 1.0, 1.0]),
        "pulling": Outcome(a, f * [[1.0, 1.0, -1.0]]),
        "another direction": Outcome(a, f + np.array([0.0, 0.3, 0.0])),
    }
    for what, one in spoilt.items():
        assert worst_violation(case, one) > 1e-3, what


def test_worst_violation_sees_friction_in_another_direction():
    """All else holds: the cone's surface, the balance across the slip, and the slip itself."""
    for turn, right in ((0.0, True), (0.02, False)):
        rubbing = MU * G * np.array([np.cos(turn), np.sin(turn), 0.0])
        case = body([[0, 0, 0]], [[0, 0, 1]], MU, [8.0, rubbing[1], -G])
        a = np.array([8.0 - rubbing[0], 0.0, 0.0, 0.0, 0.0, 0.0])
        forces = np.array([[0.0, 0.0, G]]) - rubbing
        assert (worst_violation(case, Outcome(a, forces)) <= EXACT) is right
