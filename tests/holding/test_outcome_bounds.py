"""What multipliers prove holds for every outcome: of random problems, states and multipliers."""

from __future__ import annotations

import numpy as np
import pytest
from cases import block_between_walls, block_on_slope, pressed_on_wall
from numpy.typing import NDArray

from graspless_pin.holding.bounds import States, least_along, outcome_bound
from graspless_pin.holding.dynamics import Dynamics, scaled_dynamics
from graspless_pin.holding.moving import find_motion, is_outcome
from graspless_pin.holding.verdict import ContactState, DualBound
from graspless_pin.problem import QuasistaticProblem

LIMIT = 1e6
MOVING: tuple[tuple[QuasistaticProblem, tuple[float, ...]], ...] = (
    (block_on_slope(0.3, 0.6), ()),
    (block_between_walls(0.5), ()),
    (pressed_on_wall(), (4.0,)),
    (pressed_on_wall().with_changes(external_wrench=[2.0, 1.0, -9.81, 0.3, 0.1, 0.2]), (3.0,)),
)


def dynamics_of(problem: QuasistaticProblem, torques: tuple[float, ...]) -> Dynamics:
    count = problem.joint_count
    inertia = np.zeros((6 + count, 6 + count))
    inertia[:6, :6], inertia[6:, 6:] = problem.object_inertia, problem.joint_inertia
    hybrid = np.full(count, -1)
    made = scaled_dynamics(problem, np.array(torques), inertia, hybrid, 1e-3)
    assert made is not None
    return made


@pytest.mark.parametrize("case", range(len(MOVING)))
def test_no_multipliers_prove_less_than_an_outcome_has(case: int) -> None:
    dynamics = dynamics_of(*MOVING[case])
    forces = find_motion(dynamics)
    assert forces is not None
    assert is_outcome(dynamics, forces)
    y = dynamics.motion(forces)
    u, rng = dynamics.slips(y), np.random.default_rng(case)
    count = len(forces)
    tight = np.inf
    for _ in range(2000):
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
    states = States.unknown(len(forces))
    for contact, (force, slip) in enumerate(zip(forces, u, strict=True)):
        if rng.random() < 0.3:
            continue
        if force[0] <= 0.0 and rng.random() < 0.7:
            states = states.changed(contact, ContactState.OPEN)
        elif abs(slip[0]) < 1e-12:
            moves = float(np.hypot(*slip[1:]))
            if rng.random() < 0.3:
                states = states.changed(contact, ContactState.CLOSED)
            elif moves > 1e-9 and force[0] > 0.0:
                width = rng.uniform(1e-3, 1.5)
                center = np.arctan2(slip[2], slip[1]) + width * rng.uniform(-1.0, 1.0)
                states = states.changed(contact, ContactState.SLIPPING, center, width)
            elif moves < 1e-12:
                states = states.changed(contact, ContactState.STICKING)
    return states


def test_the_least_product_with_an_arc_is_that_of_many_directions() -> None:
    rng = np.random.default_rng(0)
    vectors, center = rng.normal(size=(200, 2)), rng.uniform(-10.0, 10.0, 200)
    width = rng.uniform(0.0, np.pi, 200)
    share = np.linspace(-1.0, 1.0, 20001)
    angles = center[:, None] + width[:, None] * share
    products = vectors[:, :1] * np.cos(angles) + vectors[:, 1:] * np.sin(angles)
    np.testing.assert_allclose(least_along(vectors, center, width), products.min(axis=1), atol=1e-6)
