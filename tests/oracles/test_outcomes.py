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


def pressed_point(push):
    """A point of 1 kg on a slope above the critical one, pressed onto it by a hybrid finger."""
    angle = 1.3 * CRITICAL
    weight = [G * np.sin(angle), 0.0, -G * np.cos(angle)]
    need = (weight[0] + MU * weight[2]) / (MU + 0.3)
    return body([[0, 0, 0]] * 2, [[0, 0, 1], [0, 0, -1]], [MU, 0.3], weight,
                fingers=[(1, [0.0, 0.0, -1.0], 0.0)], torques=[push * need])  # fmt: skip


def followed_ball():
    """The ball before a hybrid finger of 3 N, which follows what it pushes."""
    case = replace(pushed_ball(0.0, 3.0), joint_inertia=np.zeros((1, 1)))
    case.jacobian[3, 0] = 1.0
    return case


ABOVE = 1.02 * CRITICAL
DOWN = G * (np.sin(ABOVE) - MU * np.cos(ABOVE))
ALONG = (1.0 / 0.1) / (2.0 + 0.5 / 0.1**2)
BACK = -G * np.sin(0.4) * np.cos(0.4) / (3.0 + np.sin(0.4) ** 2)
PRESS = 0.02 / 0.98 * (MU + 0.3) * pressed_point(0.98).torques[0]
BY_HAND = {
    "below the critical slope": (block_on_slope(0.3 * CRITICAL), "strong", {}, {}),
    "just below it": (block_on_slope(0.98 * CRITICAL), "strong", {}, {}),
    "above it": (block_on_slope(ABOVE), "none", dict(enumerate([DOWN, 0, 0, 0, 0, 0])), {}),
    "between walls, stays or falls": (slot(MU), "weak", {}, {}),
    "between smooth walls": (slot(0.0), "none", dict(enumerate([0, 0, -G, 0, 0, 0])),
                             {0: [0, 0, 0], 1: [0, 0, 0]}),
    "finger and ball go together": (pushed_ball(0.0, 1.0), "none", {0: ALONG, 6: ALONG / 0.1},
                                    {1: [2.0 * ALONG, 0, 0]}),
    "and so where they rub": (pushed_ball(0.0, 1.0, friction=0.4), "none",
                              {0: ALONG, 6: ALONG / 0.1}, {1: [2.0 * ALONG, 0, 0]}),
    "ball is pulled away": (pushed_ball(5.0, 1.0), "none", {0: 2.5, 6: 2.0}, {1: [0, 0, 0]}),
    "finger leaves the ball": (pushed_ball(0.0, -1.0), "none", None, {}),
    "finger holds against a pull": (pushed_ball(-10.0, 1.0), "strong", {}, {}),
    "wedge slides from under the mass": (wedge(0.4, 0.0), "none", {6: BACK, 0: -3.0 * BACK}, {}),
    "friction keeps the mass on it": (wedge(0.4, 1.05 * np.tan(0.4)), "strong", {}, {}),
    "or just not": (wedge(0.4, 0.95 * np.tan(0.4)), "none", {}, {}),
    "hybrid finger holds by its force": (pressed_point(1.02), "strong", {}, {}),
    "or just not, too": (pressed_point(0.98), "none", {0: PRESS}, {}),
    "hybrid finger follows": (followed_ball(), "none", {0: 1.5, 6: 1.5}, {1: [3.0, 0, 0]}),
}  # fmt: skip
"""Cases, what is said, and accelerations and forces of the motion; None: the object has none."""


@pytest.mark.parametrize("name", BY_HAND)
def test_cases_solved_by_hand(name):
    case, status, accelerations, forces = BY_HAND[name]
    answer = enumerate_outcomes(case, sectors=6)
    moves = status != "strong" and accelerations is not None
    assert (answer.status, answer.rest, answer.moving) == (status, status != "none", moves)
    assert (answer.outcome is not None) is moves
    if answer.outcome is None:
        assert not forces
        return
    for coordinate, value in (accelerations or {}).items():
        own = answer.outcome.acceleration[coordinate]
        assert own == pytest.approx(value, rel=1e-9, abs=1e-9)
    for contact, force in forces.items():
        np.testing.assert_allclose(answer.outcome.forces[contact], force, atol=1e-9)
    if status == "weak":
        assert answer.outcome.acceleration[2] < -1e-3 * G


def seeded(seed, contacts=2):
    rng = np.random.default_rng([7, seed])
    fingers, joints = int(rng.integers(0, contacts + 1)), int(rng.integers(1, 4))
    return random_rest_case(rng, contacts, fingers, joints)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", range(16))
def test_answers_are_consistent(seed):
    case = seeded(seed, 2 + (seed % 8 == 0))
    answer = enumerate_outcomes(case, sectors=8)
    assert answer.status != "between"
    if answer.outcome is not None:
        assert worst_violation(case, answer.outcome) <= EXACT
        assert case.object_motion(answer.outcome.acceleration) > 1e-3 * case.load_over_mass
    # With inertia some outcome always exists: where the object does not rest, it or a finger moves.
    if answer.rest is False and answer.moving is False:
        assert len(case.torques) > 0


@pytest.mark.sampled(1)
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


@pytest.mark.sampled(1)
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
