"""What multipliers prove holds for every outcome: of random problems, states and multipliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import (
    block_between_walls,
    block_on_slope,
    dynamics_of,
    hybrid_on_wall,
    pressed_on_wall,
)
from numpy.typing import NDArray

from graspless_pin.holding.bounds import (
    OutcomeBounds,
    States,
    closing_tolerance,
    least_products,
    outcome_bound,
)
from graspless_pin.holding.dynamics import without_free_joints
from graspless_pin.holding.unstable_motion import find_motion, is_outcome
from graspless_pin.holding.verdict import ContactState, DualBound
from graspless_pin.problem import QuasistaticProblem

LIMIT = 1e6
MOVING: tuple[tuple[QuasistaticProblem, tuple[float, ...]], ...] = (
    (block_on_slope(0.3, 0.6), ()),
    (block_between_walls(0.5), ()),
    (pressed_on_wall(), (4.0,)),
    (pressed_on_wall().with_changes(external_wrench=[2.0, 1.0, -9.81, 0.3, 0.1, 0.2]), (3.0,)),
)


def beside_a_leaving_finger(pull: float) -> QuasistaticProblem:
    """The cube that slides down a slope, and a finger of two joints that leaves its side."""
    one = MOVING[0][0]
    jacobian = np.zeros((5, 3, 2))
    jacobian[4] = [[0.3, 0.0], [0.5, 0.2], [0.0, 1.0]]
    return QuasistaticProblem(
        [*one.positions, (0.0, -0.05, 0.0)], [*one.normals, (0.0, 1.0, 0.0)], one.external_wrench,
        jacobian.reshape(15, 2), friction=0.3, gravity_torques=[pull, -0.2 * pull],
        object_inertia=one.object_inertia, joint_inertia=[[0.02, 0.005], [0.005, 0.01]],
    )  # fmt: skip


@pytest.mark.parametrize("pull", [0.1, 1.0, 10.0])
def test_no_multipliers_prove_less_beside_what_joints_do_by_themselves(pull: float) -> None:
    dynamics = dynamics_of(beside_a_leaving_finger(pull), (0.0, 0.0))
    forces = find_motion(dynamics)
    assert forces is not None and forces[4, 0] == 0.0
    y = dynamics.scaled_acceleration(forces)
    u, rng = dynamics.contact_motion(y), np.random.default_rng(1)
    opened = forces[:, 0] <= 0.0
    less = without_free_joints(dynamics, opened, 10.0)
    # The finger's part of the motion is the load's, and the object has no part in it.
    np.testing.assert_allclose(less.free_motion[6:], y[6:], atol=1e-12)
    np.testing.assert_allclose(less.free_motion[:6], 0.0, atol=1e-12)
    np.testing.assert_allclose(dynamics.load, less.load + less.free_motion, atol=1e-15)
    states, tight = States.all_free(5).with_state(4, ContactState.OPEN), np.inf
    power = float(less.load @ y)
    assert power >= float((y - less.free_motion) @ (y - less.free_motion)) - 1e-12
    for _ in range(250):
        size = 10.0 ** rng.uniform(-3.0, 1.0)
        dual = DualBound(
            size * rng.normal(size=8), size * rng.normal(size=5), size * rng.normal(size=(5, 2))
        )
        goal = rng.normal(size=8), rng.normal(size=(5, 3))
        loads = forces[:, 0] * rng.uniform(0.0, 1.0, 5)
        told = _states_of(forces, u, rng)
        told = told.with_state(4, ContactState.OPEN) if rng.random() < 0.5 else states
        reached = float(goal[0] @ y + (goal[1] * forces).sum())
        bound = outcome_bound(less, told, loads, dual, goal, 10.0)
        assert bound >= reached - 1e-9 * max(1.0, abs(reached))
        tight = min(tight, bound - reached)
    assert tight < 50.0


@pytest.mark.parametrize("case", range(len(MOVING)))
def test_no_multipliers_prove_less_than_an_outcome_has(case: int) -> None:
    dynamics = dynamics_of(*MOVING[case])
    forces = find_motion(dynamics)
    assert forces is not None
    assert is_outcome(dynamics, forces)
    y = dynamics.scaled_acceleration(forces)
    u, rng = dynamics.contact_motion(y), np.random.default_rng(case)
    count = len(forces)
    tight = np.inf
    for _ in range(250):
        states = _states_of(forces, u, rng)
        size = 10.0 ** rng.uniform(-3.0, 1.0)
        dual = DualBound(
            size * rng.normal(size=len(y)), size * rng.normal(size=count),
            size * rng.normal(size=(count, 2)),
        )  # fmt: skip
        goal = rng.normal(size=len(y)), rng.normal(size=forces.shape)
        loads = forces[:, 0] * rng.uniform(0.0, 1.0, count)
        reached = float(goal[0] @ y + (goal[1] * forces).sum())
        bound = outcome_bound(dynamics, states, loads, dual, goal, 10.0)
        assert bound >= reached - 1e-9 * max(1.0, abs(reached))
        tight = min(tight, bound - reached)
    assert tight < 50.0


def _states_of(
    forces: NDArray[np.float64], u: NDArray[np.float64], rng: np.random.Generator
) -> States:
    """Return states that an outcome is in, as little or as much told as chance has it."""
    states = States.all_free(len(forces))
    for contact, (force, slip) in enumerate(zip(forces, u, strict=True)):
        if rng.random() < 0.3:
            continue
        if force[0] <= 0.0 and rng.random() < 0.7:
            states = states.with_state(contact, ContactState.OPEN)
        elif abs(slip[0]) < 1e-12:
            moves = float(np.hypot(*slip[1:]))
            if rng.random() < 0.3:
                states = states.with_state(contact, ContactState.CLOSED)
            elif moves > 1e-9 and force[0] > 0.0:
                width = rng.uniform(1e-3, 1.5)
                center = np.arctan2(slip[2], slip[1]) + width * rng.uniform(-1.0, 1.0)
                states = states.with_state(contact, ContactState.SLIPPING, center, width)
            elif moves < 1e-12:
                states = states.with_state(contact, ContactState.STICKING)
    return states


def test_the_least_product_with_an_arc_is_that_of_many_directions() -> None:
    rng = np.random.default_rng(0)
    vectors, center = rng.normal(size=(200, 2)), rng.uniform(-10.0, 10.0, 200)
    width = rng.uniform(0.0, np.pi, 200)
    share = np.linspace(-1.0, 1.0, 20001)
    angles = center[:, None] + width[:, None] * share
    products = vectors[:, :1] * np.cos(angles) + vectors[:, 1:] * np.sin(angles)
    np.testing.assert_allclose(
        least_products(vectors, center, width), products.min(axis=1), atol=1e-6
    )


@pytest.mark.sampled(4)
@pytest.mark.usefixtures("form")
@pytest.mark.parametrize("loaded", [0.0, 0.05])
@pytest.mark.parametrize(
    ("problem", "torques"), [*MOVING, (hybrid_on_wall(), (15.0,))], ids=lambda _: ""
)
def test_what_is_remembered_is_found_where_it_proves_something(
    problem: QuasistaticProblem, torques: tuple[float, ...], loaded: float
) -> None:
    dynamics = dynamics_of(problem, torques)
    count, n, rng = dynamics.contact_count, len(dynamics.load), np.random.default_rng(0)
    own = np.where(dynamics.is_commanded, 0.1 * rng.normal(size=count), 0.0)
    dynamics = replace(
        dynamics, load_change=0.1 * rng.normal(size=n), commanded_change=own,
        free_motion=1e-3 * rng.normal(size=n), load=0.9 * dynamics.load,
    )  # fmt: skip
    loads = np.where(np.arange(count) == count - 1, loaded, 0.0)
    known, duals = OutcomeBounds(dynamics, loads, 10.0), []
    for _ in range(300):  # more than it remembers
        size = 10.0 ** rng.uniform(-2.0, 1.0)
        duals.append(DualBound(
            size * rng.normal(size=n), size * rng.normal(size=count),
            size * rng.normal(size=(count, 2)),
        ))  # fmt: skip
        known.remember(duals[-1])
    goal = dynamics.load, np.zeros((count, 3))
    for _ in range(3):
        states = States.all_free(count)
        for contact, kind in enumerate(rng.choice(list(ContactState), count)):
            center, width = rng.uniform(-4.0, 4.0), rng.uniform(0.0, 1.5)
            most = 10.0 ** rng.uniform(-14.0, -2.0)
            states = states.with_state(contact, ContactState(kind), center, width, most=most)
        bounds = [outcome_bound(dynamics, states, loads, one, goal, 10.0) for one in duals[-256:]]
        enough = float(np.sort(bounds)[rng.integers(0, 3)]) + 1e-9
        found = known.remembered_proof(states, goal[0], enough)
        assert found is not None
        assert outcome_bound(dynamics, states, loads, found, goal, 10.0) <= enough + 1e-9
        assert known.remembered_proof(states, goal[0], float(np.min(bounds)) - 1e-6) is None
        other = goal[0], rng.normal(size=(count, 3))
        for dual in duals[-20:]:
            np.testing.assert_allclose(
                known.bound(states, dual, other),
                outcome_bound(dynamics, states, loads, dual, other, 10.0),
                rtol=1e-12,
            )


@pytest.mark.parametrize("case", range(len(MOVING)))
def test_compiled_sweeps_find_what_numpy_finds(case: int, monkeypatch: pytest.MonkeyPatch) -> None:
    dynamics = dynamics_of(*MOVING[case])
    found = find_motion(dynamics)
    monkeypatch.setattr("graspless_pin.holding.unstable_motion.core", None)
    expected = find_motion(dynamics)
    assert found is not None
    assert expected is not None
    np.testing.assert_allclose(
        dynamics.scaled_acceleration(found), dynamics.scaled_acceleration(expected), atol=1e-7
    )


@pytest.mark.usefixtures("form")
def test_closed_contacts_part_within_a_tolerance_that_is_paid_for() -> None:
    """The multiplier of a row that vanishes but for the tolerance, alone in the bound."""
    dynamics = dynamics_of(*MOVING[0])
    count, n = dynamics.contact_count, len(dynamics.load)
    states, normal = States.all_free(count).with_state(1, ContactState.CLOSED), np.zeros(count)
    normal[1] = -1e6
    goal = 1e6 * dynamics.rows[1, 0], np.zeros((count, 3))
    dual = DualBound(np.zeros(n), normal, np.zeros((count, 2)))
    bounds = OutcomeBounds(dynamics, np.zeros(count), 10.0)
    paid = 1e6 * closing_tolerance(dynamics)
    assert bounds.bound(states, dual, goal) == pytest.approx(paid, rel=1e-6)
    looser = States.all_free(count).with_state(1, ContactState.CLOSED, most=3e-6)
    assert bounds.bound(looser, dual, goal) == pytest.approx(3.0, rel=1e-6)
    # The only multipliers that are remembered are the first, too.
    bounds.remember(dual)
    assert bounds.remembered_proof(states, goal[0], 1.01 * paid) is dual
    assert bounds.remembered_proof(states, goal[0], 0.99 * paid) is None
