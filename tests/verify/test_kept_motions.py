"""Verdicts under a declared motion are checked from documents alone; no tampering passes."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from rest_documents import (
    FEET,
    G,
    StatedBody,
    document,
    failures,
    is_refused,
    pushed,
    rest_lines,
    zeroed,
)
from tests.oracles.kept_cases import kept_problem

from graspless_pin import stability
from graspless_pin.report.verify.rest_bounds import (
    Kind,
    KnownStates,
    RestMultipliers,
    declared_motion_bound,
)


@pytest.mark.parametrize("goals", [range(1, 13), [0]])
def test_sides_are_worked_out_again(goals):
    made = copy.deepcopy(document("kept"))
    root = made["stability"]["proof"]["nodes"][0]
    some = next(
        side["multipliers"]
        for node in made["stability"]["proof"]["nodes"]
        for side in node["sides"]
    )
    claimed = [{"goal": goal, "multipliers": zeroed(some)} for goal in goals]
    made["stability"]["proof"]["nodes"] = [root | {"sides": claimed, "children": 0}]
    assert is_refused(made)


def test_friction_has_to_be_against_the_sliding():
    made = copy.deepcopy(document("lost"))
    made["joints"][0]["torque"] = 0.0
    # The weight on three feet that do not rub: balanced, and in the cones.
    lift = [[0.0, 0.0, share * G] for share in (0.5, 0.25, 0.25, 0.0)]
    made["stability"]["rest_forces"] = lift
    assert "rest is an outcome" in failures(made)
    made["contacts"] = [contact | {"friction": 0.0} for contact in made["contacts"]]
    assert "rest is an outcome" in {line.name for line in rest_lines(made) if line.passed}


def test_a_strong_verdict_without_its_sides_is_refused():
    made = copy.deepcopy(document("kept"))
    del made["stability"]["proof"]["nodes"][0]["sides"]
    assert is_refused(made)
    made = copy.deepcopy(document("lost"))
    made["stability"]["status"] = "strong"
    assert [line.passed for line in rest_lines(made)].count(None) == 1


def states_of(f, u, rng):
    """Return states that an outcome is in, as much or as little told as chance has it."""
    states = KnownStates.all_free(len(f))
    for contact, (force, slip) in enumerate(zip(f, u, strict=True)):
        speed, kind = float(np.hypot(*slip[1:])), rng.choice(list(Kind))
        if kind == Kind.OPEN and force[0] <= 0.0:
            states = states.with_state(contact, Kind.OPEN)
        elif kind in (Kind.CLOSED, Kind.STICKING, Kind.SLIPPING) and abs(slip[0]) < 1e-9:
            states = states.with_state(contact, Kind.CLOSED)
            if kind == Kind.STICKING and speed < 1e-9:
                states = states.with_state(contact, Kind.STICKING)
            elif kind == Kind.SLIPPING and speed > 1e-6:
                center = float(np.arctan2(slip[2], slip[1])) + rng.uniform(-0.2, 0.2)
                states = states.with_state(contact, Kind.SLIPPING, (center, 0.25))
    return states


@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", [5, 11, 13, 17, 40])
def test_bounds_hold_for_what_happens(number):
    """No multipliers bound an outcome away, whatever is said truly of its contacts."""
    case, _, problem = kept_problem(2, number)
    verdict = stability(problem, case.torques)
    assert verdict.motion is not None
    body, motion = StatedBody(case, problem, static_friction="coulomb"), verdict.motion
    dynamics = body.dynamics(body.load)
    acceleration = np.concatenate([motion.object_acceleration, motion.joint_accelerations])
    y, f = body.coordinates(dynamics, acceleration, motion.contact_forces)
    f[body.problem.slides, 1:] = 0.0
    u, rng, tight = dynamics.rows @ y, np.random.default_rng(number), np.inf
    for _ in range(400):
        states = states_of(f, u, rng)
        size = 10.0 ** rng.uniform(-3.0, 1.0)
        multipliers = RestMultipliers(
            np.zeros(len(y)), size * rng.normal(size=len(f)), size * rng.normal(size=(len(f), 2))
        )
        goal = rng.normal(size=y.shape)
        bound = declared_motion_bound(
            dynamics, states, multipliers, goal, 1.01 * float(f[:, 0].max())
        )
        assert bound >= goal @ y - 1e-7 * (1.0 + size)
        tight = min(tight, bound - goal @ y)
    assert tight < 5.0


def test_frictions_that_take_each_other_away_bound_no_outcome_away():
    """Two contacts of a finger stick, one above the other: rounding is all that these leave."""
    one = pushed()
    two = one.with_changes(
        positions=[*FEET, [-0.05, 0.0, 0.01], [-0.05, 0.0, -0.01]],
        normals=[*one.normals, [1, 0, 0]], tangents=[*one.tangents, one.tangents[-1]],
        sliding=[*one.sliding, [0, 0, 0]], friction=[*one.friction, 0.4], max_normal_force=50.0,
        jacobian=[*one.jacobian, *one.jacobian[-3:]],
    )  # fmt: skip
    case = SimpleNamespace(
        external_wrench=two.external_wrench, object_inertia=two.object_inertia,
        joint_inertia=two.joint_inertia, torques=(0.5 * G, 0.0),
    )  # fmt: skip
    body = StatedBody(case, two, static_friction="coulomb")
    dynamics, states = body.dynamics(body.load), KnownStates.all_free(5)
    for contact in (3, 4):
        states = states.with_state(contact, Kind.CLOSED).with_state(contact, Kind.STICKING)
    motion, normal, tangential = np.zeros(8), np.zeros(5), np.zeros((5, 2))
    tangential[3:, 0] = 1e20, -1e20
    multipliers = RestMultipliers(motion, normal, tangential)
    # The block slides on as it does, and nothing accelerates.
    assert declared_motion_bound(dynamics, states, multipliers, np.zeros(8), 10.0) >= 0.0
